"""Closed loops of models that are no continuum finger: a cart-pole that swings up, and a finger of two rigid links."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.mpc_cases import Case
from continuum_grasp.control import ControlProblem

Array = NDArray[np.float64]

NAMES = ("cart_pole", "two_links")
HEAVIER = 1.1
"""Mass of the plant's pole, or payload, over that of the model."""


def case(name: str, steps: int = 400) -> Case:
    """One of ``NAMES``."""
    return {"cart_pole": cart_pole, "two_links": two_links}[name](steps)


def cart_pole(steps: int) -> Case:
    """From hanging to upright; then the position's setpoint switches every two seconds, unannounced."""
    x = ca.SX.sym("x", 4)
    position, angle, speed, rate = ca.vertsplit(x)
    force, pole = ca.SX.sym("force"), ca.SX.sym("pole")
    cart, length, gravity = 1.0, 0.5, 9.81  # kg, m, m/s2
    sine, cosine = ca.sin(angle), ca.cos(angle)
    swing, mass = force + pole * sine * length * rate**2, cart + pole * sine**2
    turned = ((cart + pole) * gravity * sine - cosine * swing) / (mass * length)
    problem = ControlProblem(
        states=x,
        inputs=force,
        parameters=pole,
        nominal={"pole": 0.2},
        dynamics=[speed, rate, (swing - pole * gravity * sine * cosine) / mass, turned],
        cost={
            "position": (position, 1.0, 1.0),
            "upright": (ca.sin(angle / 2), 40.0, 40.0),
            "rates": (ca.vertcat(speed, rate), 0.1, 1.0),
            "force": (force, 0.01),
        },
        bounds={"force": (-12.0, 12.0), "x_0": (-0.5, 0.5)},
        stages=25,
        stage=0.04,
        substeps=2,
    )
    wanted = np.where(np.arange(steps) < 100, 0.0, 0.3 * (-1.0) ** (np.arange(steps) // 50))
    references = np.zeros((steps, 26, 5))
    references[:, :, 0] = wanted[:, None]
    return _case("cart_pole", "cart-pole, swing-up and steps", problem, [0.0, np.pi - 0.1, 0.0, 0.0], references)


def two_links(steps: int) -> Case:
    """The tip on a circle that a wall cuts, which is announced."""
    q, qd, torque, payload = ca.SX.sym("q", 2), ca.SX.sym("qd", 2), ca.SX.sym("torque", 2), ca.SX.sym("payload")
    l1, l2, m1, m2, rotor, damping = 0.05, 0.04, 0.03, 0.02, 5e-5, 1e-3  # m, kg, kg m2, N m s
    a, b = q[0], q[0] + q[1]
    tip = ca.vertcat(l1 * ca.cos(a) + l2 * ca.cos(b), l1 * ca.sin(a) + l2 * ca.sin(b))
    middles = [0.5 * l1 * ca.vertcat(ca.cos(a), ca.sin(a)), tip - 0.5 * l2 * ca.vertcat(ca.cos(b), ca.sin(b))]
    bodies = [(m1, middles[0]), (m2, middles[1]), (payload, tip)]
    turning = (m1 * l1**2 * qd[0] ** 2 + m2 * l2**2 * (qd[0] + qd[1]) ** 2) / 24 + 0.5 * rotor * ca.sumsqr(qd)
    kinetic = turning + sum(0.5 * m * ca.sumsqr(ca.jtimes(r, q, qd)) for m, r in bodies)
    potential = sum(9.81 * m * r[1] for m, r in bodies)
    momentum = ca.gradient(kinetic, qd)
    known = torque - damping * qd - ca.gradient(potential, q) + ca.gradient(kinetic, q) - ca.jtimes(momentum, q, qd)
    problem = ControlProblem(
        states=ca.vertcat(q, qd),
        inputs=torque,
        parameters=payload,
        nominal={"payload": 0.04},
        dynamics=ca.vertcat(qd, ca.solve(ca.jacobian(momentum, qd), known)),
        cost={"tip": (tip, 1e4, 1e3), "qd": (qd, 1e-3), "torque": (torque, 10.0)},
        bounds={"torque_0": (-0.08, 0.08), "torque_1": (-0.05, 0.05), "q_1": (0.05, 2.5)},
        rows={"wall": (tip[0], -ca.inf, 0.075)},
        stages=30,
        stage=0.01,
        substeps=2,
    )
    phase = 0.04 * (np.arange(steps)[:, None] + np.arange(31))
    references = np.zeros((steps, 31, 6))
    references[:, :, 0], references[:, :, 1] = 0.06 + 0.02 * np.cos(phase), 0.02 + 0.02 * np.sin(phase)
    return _case("two_links", "two rigid links, tip on a circle cut by a wall", problem, [-0.6, 1.5, 0, 0], references)


def _case(name: str, what: str, problem: ControlProblem, x0: Any, references: Array) -> Case:
    s = problem.stages
    heavier = np.tile(HEAVIER * s.p_nominal, (len(references), 1))
    return Case(name, what, None, s, np.array(x0, float), np.zeros(s.nu), s.p_nominal, heavier, references)
