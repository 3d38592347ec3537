"""Nonlinear model predictive control: plans by IPOPT, real-time iterations and estimation in C, closed loops.

Rooms inside: ``problem`` (the stages of a scene), ``rti`` (the online solver), ``estimator`` and ``controller``,
``plan`` (the offline solver), ``loop`` (controller against plant).
"""
