"""Nonlinear model predictive control in real time: problem, real-time iterations, estimator, controller, supervisor."""

from lazy_loader import attach_stub

__all__ = [
    "Anomaly",
    "Command",
    "CommandStatus",
    "ContactDetector",
    "ControlLog",
    "ControlProblem",
    "Controller",
    "DetectedContact",
    "Estimator",
    "Health",
    "Prediction",
    "Residual",
    "ResidualContact",
    "Row",
    "RtiSolver",
    "Setpoints",
    "Stages",
    "Trip",
    "rti",
    "stages_of",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
