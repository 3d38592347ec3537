"""Nonlinear model predictive control in real time: problem, real-time iterations, estimator, controller, supervisor."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.control.command import Command as Command
    from continuum_grasp.control.controller import Controller as Controller
    from continuum_grasp.control.estimation.contact_detector import Contact as Contact
    from continuum_grasp.control.estimation.contact_detector import ContactDetector as ContactDetector
    from continuum_grasp.control.estimation.contact_detector import DetectedContact as DetectedContact
    from continuum_grasp.control.estimation.estimator import Estimator as Estimator
    from continuum_grasp.control.log import ControlLog as ControlLog
    from continuum_grasp.control.ocp.bounds import Row as Row
    from continuum_grasp.control.ocp.control_problem import ControlProblem as ControlProblem
    from continuum_grasp.control.ocp.cost_terms import Residual as Residual
    from continuum_grasp.control.ocp.scene_problem import stages_of as stages_of
    from continuum_grasp.control.ocp.setpoints import Setpoints as Setpoints
    from continuum_grasp.control.ocp.stages import Stages as Stages
    from continuum_grasp.control.prediction import Prediction as Prediction
    from continuum_grasp.control.rti_solver import RtiSolver as RtiSolver
    from continuum_grasp.control.rti_solver import rti as rti
    from continuum_grasp.control.status import Anomaly as Anomaly
    from continuum_grasp.control.status import Health as Health
    from continuum_grasp.control.status import Status as Status
    from continuum_grasp.control.status import Trip as Trip

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
_GONE = {
    "RealTimeIteration": "continuum_grasp.rti takes a ControlProblem, with sqp_iterations=20 to its optimum",
    "run_periodic": "continuum_grasp.closed_loop.run_hardware takes a driver with read() and write(command)",
}
__getattr__, __dir__ = lazy_names(__name__, _MODULES, _GONE)
