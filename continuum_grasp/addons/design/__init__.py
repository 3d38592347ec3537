"""Design by gradient: numbers of a grasp scene chosen so that grasps of one or many objects are best."""

from lazy_loader import attach_stub

__all__ = [
    "CaseValues",
    "Design",
    "DesignNumber",
    "DesignResult",
    "DesignSolver",
    "DesignStatus",
    "DesignVariable",
    "Evaluation",
    "Influence",
    "QuantityLimit",
    "Tolerance",
    "WorstCase",
    "optimize_design",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
