"""The functions of a finger for use elsewhere: as C without Python and CasADi, for CasADi, MuJoCo, FMI and browsers."""

from continuum_grasp._lazy import lazy_names
from continuum_grasp.export.fmu.write import FunctionalMockupUnit, export_fmu
from continuum_grasp.export.functions import export_casadi
from continuum_grasp.export.manifest import Package
from continuum_grasp.export.mjcf.write import HingeChain, export_mjcf
from continuum_grasp.export.package import export_c
from continuum_grasp.export.web.page import Page, export_web

__getattr__, _ = lazy_names(__name__, {}, {"CasadiFiles": "export_casadi returns a Package"})

__all__ = [
    "FunctionalMockupUnit",
    "HingeChain",
    "Package",
    "Page",
    "export_c",
    "export_casadi",
    "export_fmu",
    "export_mjcf",
    "export_web",
]
