"""Design by gradient: numbers of a grasp scene chosen so that grasps of one or many objects are best."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.design.evaluation import CaseValues as CaseValues
    from continuum_grasp.design.evaluation import Evaluation as Evaluation
    from continuum_grasp.design.evaluation import Row as Row
    from continuum_grasp.design.optimize import optimize_design as optimize_design
    from continuum_grasp.design.result import DesignResult as DesignResult
    from continuum_grasp.design.result import Influence as Influence
    from continuum_grasp.design.result import Status as Status
    from continuum_grasp.design.result import WorstCase as WorstCase

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
