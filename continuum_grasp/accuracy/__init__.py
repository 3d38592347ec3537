"""Error of a finger model against the exact rod, and the choice of a model by tolerance."""

from lazy_loader import attach_stub

__all__ = ["AccuracyReport", "Chosen", "accuracy_report", "choose_fidelity"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
