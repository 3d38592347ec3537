"""Whole-horizon plans by IPOPT: least time, least effort, smoothest input, tracking."""

from lazy_loader import attach_stub

__all__ = [
    "Constraint",
    "DurationRange",
    "FineCheck",
    "Goal",
    "MotionPlan",
    "PlanBounds",
    "PlanInput",
    "PlanScene",
    "PlanSolver",
    "PlanStatus",
    "plan",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
