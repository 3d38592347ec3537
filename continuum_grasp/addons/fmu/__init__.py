"""Fingers, their controllers, and plants of closed loops as functional mock-up units (FMI 2.0 and 3.0)."""

from lazy_loader import attach_stub

__all__ = ["FunctionalMockupUnit", "export_fmu"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
