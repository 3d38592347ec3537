"""Error of a finger model against the exact rod, and the choice of a model by tolerance."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.accuracy.choose import Chosen as Chosen
    from continuum_grasp.accuracy.choose import choose_fidelity as choose_fidelity
    from continuum_grasp.accuracy.report import AccuracyReport as AccuracyReport
    from continuum_grasp.accuracy.report import accuracy_report as accuracy_report

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
