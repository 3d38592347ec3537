"""Finding how fingers hold an object, and proving that they do."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.grasp.bound import least_normal_force_bound as least_normal_force_bound
    from continuum_grasp.grasp.certificate.certificate import Certificate as Certificate
    from continuum_grasp.grasp.certificate.certificate import certify as certify
    from continuum_grasp.grasp.certificate.check import Check as Check
    from continuum_grasp.grasp.quality.quality import Quality as Quality
    from continuum_grasp.grasp.result import GraspResult as GraspResult
    from continuum_grasp.grasp.robust.result import Robustness as Robustness
    from continuum_grasp.grasp.robust.result import Trials as Trials
    from continuum_grasp.grasp.solve import optimize_grasp as optimize_grasp
    from continuum_grasp.grasp.values import Contact as Contact
    from continuum_grasp.grasp.values import FingerPosture as FingerPosture
    from continuum_grasp.grasp.values import Reason as Reason
    from continuum_grasp.grasp.values import Status as Status

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
_GONE = dict.fromkeys(
    ("closing_path", "ClosingPath", "ClosingStatus"),
    "continuum_grasp.simulate closes a finger on the object of its scene, a mission several",
)
__getattr__, __dir__ = lazy_names(__name__, _MODULES, _GONE)
