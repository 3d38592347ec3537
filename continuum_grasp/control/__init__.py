"""Nonlinear model predictive control in real time: problem, real-time iterations, estimator, controller, supervisor."""

from __future__ import annotations

from continuum_grasp._lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from continuum_grasp.control.command import Command as Command
    from continuum_grasp.control.controller import Controller as Controller
    from continuum_grasp.control.estimation.estimator import Estimator as Estimator
    from continuum_grasp.control.ocp.setpoints import setpoints as setpoints
    from continuum_grasp.control.ocp.stages import stages_of as stages_of
    from continuum_grasp.control.periodic import PeriodicRun as PeriodicRun
    from continuum_grasp.control.periodic import run_periodic as run_periodic
    from continuum_grasp.control.prediction import Prediction as Prediction
    from continuum_grasp.control.rti.iteration import RealTimeIteration as RealTimeIteration

_MODULES = {
    "continuum_grasp.control.command": ("Command",),
    "continuum_grasp.control.controller": ("Controller",),
    "continuum_grasp.control.estimation.estimator": ("Estimator",),
    "continuum_grasp.control.ocp.setpoints": ("setpoints",),
    "continuum_grasp.control.ocp.stages": ("stages_of",),
    "continuum_grasp.control.periodic": ("PeriodicRun", "run_periodic"),
    "continuum_grasp.control.prediction": ("Prediction",),
    "continuum_grasp.control.rti.iteration": ("RealTimeIteration",),
}
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
