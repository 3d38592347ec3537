"""The command line: one file per verb."""

from lazy_loader import attach_stub

__all__ = ["Output", "app", "main", "option", "verb"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
