"""The functions of a finger as C for use where there is no Python and no CasADi, functional mock-up units, MuJoCo."""

from continuum_grasp.export.casadi_source import export_casadi
from continuum_grasp.export.fmu.write import FunctionalMockupUnit, export_fmu
from continuum_grasp.export.mjcf import HingeChain, export_mjcf
from continuum_grasp.export.package import Package, export_c

__all__ = ["FunctionalMockupUnit", "HingeChain", "Package", "export_c", "export_casadi", "export_fmu", "export_mjcf"]
