"""The exact elastic rod by numpy and scipy: the independent reference of the finger model.

The names here are loaded when they are first used.
"""

from lazy_loader import attach_stub

__all__ = ["Elastica", "natural_frequencies", "solve_elastica"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
