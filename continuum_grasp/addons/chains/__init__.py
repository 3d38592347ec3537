"""Fingers as chains of hinges for MuJoCo."""

from lazy_loader import attach_stub

__all__ = ["export_mjcf"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
