"""Whole-horizon plans by IPOPT: least time, least effort, smoothest input, tracking."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.planning.result import Constraint as Constraint
    from continuum_grasp.planning.result import Plan as Plan
    from continuum_grasp.planning.result import PlanStatus as PlanStatus
    from continuum_grasp.planning.solve import plan as plan

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
