"""The finger as a chain of hinges for MuJoCo."""

from continuum_grasp.export.mjcf.write import HingeChain, export_mjcf

__all__ = ["HingeChain", "export_mjcf"]
