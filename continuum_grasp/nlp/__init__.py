"""Nonlinear problems: named blocks, budget, solvers by name, what a solver run gave."""

from lazy_loader import attach_stub

__all__ = [
    "NLP",
    "Attempt",
    "Block",
    "Budget",
    "Constraints",
    "Multipliers",
    "Settings",
    "Solver",
    "SolverStatus",
    "Start",
    "Violation",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
