"""The functions of a finger as C for use where there is no Python and no CasADi; for MuJoCo, FMI and browsers."""

from continuum_grasp.export.fmu.write import FunctionalMockupUnit, export_fmu
from continuum_grasp.export.mjcf.write import HingeChain, export_mjcf
from continuum_grasp.export.package import Package, export_c
from continuum_grasp.export.web.page import Page, export_web

__all__ = [
    "FunctionalMockupUnit",
    "HingeChain",
    "Package",
    "Page",
    "export_c",
    "export_fmu",
    "export_mjcf",
    "export_web",
]
