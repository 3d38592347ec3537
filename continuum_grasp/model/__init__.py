"""The physics of the finger and of what it touches, written once as CasADi expressions."""

from lazy_loader import attach_stub

__all__ = ["FingerModel", "ModelOptions", "System", "TouchLaw", "stumpff"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
