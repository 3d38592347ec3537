"""Planar tendon-driven continuum fingers: physics written once, compiled C, simulation, grasping and control.

Everything here is loaded when it is first used; importing the package is quick.
"""

from lazy_loader import attach_stub

__version__ = "1.0.0"

__getattr__, __dir__, _names = attach_stub(__name__, __file__)
__all__ = ["__version__", *_names]
