"""A scene as a page in which its C runs as WebAssembly."""

from lazy_loader import attach_stub

__all__ = ["Page", "export_web"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
