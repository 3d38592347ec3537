"""Shared by all packages: errors, checked arguments, interrupts, labels, shell lines, workers."""

from lazy_loader import attach_stub

__all__ = ["Addon", "ConfigurationKind", "ExportTarget"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
