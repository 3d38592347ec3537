"""Nonlinear model predictive control in real time: problem, real-time iterations, estimator, controller, supervisor."""

from lazy_loader import attach_stub

__all__ = [
    "Anomaly",
    "Command",
    "CommandStatus",
    "ControlLog",
    "ControlProblem",
    "Controller",
    "Estimator",
    "Health",
    "MeasurementVerdict",
    "OffsetCause",
    "Prediction",
    "Residual",
    "Row",
    "RtiSolver",
    "Setpoints",
    "Sight",
    "Stages",
    "Trip",
    "rti",
    "stages_of",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
