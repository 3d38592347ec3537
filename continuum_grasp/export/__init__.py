"""The functions of a finger as a C package for use where there is no Python and no CasADi."""

from continuum_grasp.export.package import Package, export_c

__all__ = ["Package", "export_c"]
