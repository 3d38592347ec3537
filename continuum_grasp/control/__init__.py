"""Nonlinear model predictive control in real time: problem, real-time iterations, estimator, controller, supervisor."""
