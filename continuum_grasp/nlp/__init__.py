"""Nonlinear problems: named blocks, budget, solvers by name, what a solver run gave."""

from __future__ import annotations

from continuum_grasp.nlp.attempt import Attempt, Budget, Multipliers, OptionSet, Start, Status
from continuum_grasp.nlp.problem import NLP, Block, Constraints, Violation
from continuum_grasp.nlp.solver import Settings, Solver, new_solver, outcome_words

__all__ = [
    "NLP",
    "Attempt",
    "Block",
    "Budget",
    "Constraints",
    "Multipliers",
    "OptionSet",
    "Settings",
    "Solver",
    "Start",
    "Status",
    "Violation",
    "new_solver",
    "outcome_words",
]
