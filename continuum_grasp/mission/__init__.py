"""A whole grasp under control: what is to be done, the closed loop that does it, and many plants on which it must."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.mission.lift import NotLifted as NotLifted
    from continuum_grasp.mission.lift import Shortfall as Shortfall
    from continuum_grasp.mission.outcomes import Outcome as Outcome
    from continuum_grasp.mission.outcomes import TrialsResult as TrialsResult
    from continuum_grasp.mission.plant import Variation as Variation
    from continuum_grasp.mission.precheck import Exceeded as Exceeded
    from continuum_grasp.mission.precheck import check_mission as check_mission
    from continuum_grasp.mission.result import MissionRun as MissionRun
    from continuum_grasp.mission.run import run_mission as run_mission
    from continuum_grasp.mission.run import run_trials as run_trials

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
