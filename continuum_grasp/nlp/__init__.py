"""Nonlinear problems: named blocks, budget, solvers by name, what a solver run gave."""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp._lazy import lazy_names

_MODULES = {
    "continuum_grasp.nlp.attempt": ("Attempt", "Multipliers", "Start", "Status"),
    "continuum_grasp.nlp.blocks": ("Block", "Constraints", "Violation"),
    "continuum_grasp.nlp.budget": ("Budget",),
    "continuum_grasp.nlp.problem": ("NLP",),
    "continuum_grasp.nlp.solver": ("Settings", "Solver", "new_solver"),
}
__all__ = [name for names in _MODULES.values() for name in names]

if TYPE_CHECKING:
    from continuum_grasp.nlp.attempt import Attempt as Attempt
    from continuum_grasp.nlp.attempt import Multipliers as Multipliers
    from continuum_grasp.nlp.attempt import Start as Start
    from continuum_grasp.nlp.attempt import Status as Status
    from continuum_grasp.nlp.blocks import Block as Block
    from continuum_grasp.nlp.blocks import Constraints as Constraints
    from continuum_grasp.nlp.blocks import Violation as Violation
    from continuum_grasp.nlp.budget import Budget as Budget
    from continuum_grasp.nlp.problem import NLP as NLP
    from continuum_grasp.nlp.solver import Settings as Settings
    from continuum_grasp.nlp.solver import Solver as Solver
    from continuum_grasp.nlp.solver import new_solver as new_solver

__getattr__, __dir__ = lazy_names(__name__, _MODULES)
