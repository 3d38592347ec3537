"""The functions of a finger for use elsewhere: as C without Python and CasADi, for CasADi, MuJoCo, FMI and browsers."""

from lazy_loader import attach_stub

__all__ = ["Package", "export_c", "export_casadi"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
