"""The model as C: generated, compiled, cached and loaded."""

from lazy_loader import attach_stub

__all__ = ["Core", "compile"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
