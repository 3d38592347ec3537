"""A scene as a page in which its C runs as WebAssembly."""

from continuum_grasp.export.web.page import Page, export_web

__all__ = ["Page", "export_web"]
