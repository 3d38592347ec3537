"""Fastest motions of a scene, which steps must resolve: of the finger itself, and of its contacts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain, product

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene import INTEGRATORS
from continuum_grasp.simulation.linearized import damping_matrix, slope_matrix

_EVEN, _EXTREME = 12, 6
"""States that are spread evenly over a motion, and states of greatest force or fastest friction [1]."""


def contact_frequency(core: Core, states: Array, u: Array, w: Array, p: Array) -> float:
    """Fastest oscillation [rad/s] that the springs of contacts would make by themselves: the largest over some states.

    All contacts of the system are closed; elastic forces of the finger are left out. States are (count, nx).
    """
    system: System = core.model
    frequencies = [0.0]
    for x in np.atleast_2d(states):
        still = _at_rest(system, x)
        gap = core.touch(still, u, w, p)[0]
        closed = gap + _full(system)
        opened = -np.abs(gap) - 1.0
        slopes = [core.pressed_linearization(still, u, w, p, press) for press in (closed, opened)]
        frequencies.append(system.spring_frequency(slopes[0] - slopes[1]))
    return max(frequencies)


def pressed_radius(core: Core, states: Array, u: Array, w: Array, p: Array) -> float:
    """Return the largest absolute eigenvalue of the linearized motion of a system with contacts over some states [1/s].

    The states (count, nx) count unchanged, and also at rest with open contacts closed, because these may close within a
    step. The result is infinite if numbers are not finite.
    """

    def slopes() -> Iterator[Array]:
        for x in np.atleast_2d(states):
            gap = core.touch(x, u, w, p)[0]
            yield core.pressed_linearization(x, u, w, p, np.zeros_like(gap))
            closing = np.maximum(gap + _full(core.model), 0.0)
            yield core.pressed_linearization(_at_rest(core.model, x), u, w, p, closing)

    return _radius(slopes())


def representative_states(core: Core, states: Array, u: Array, w: Array) -> Array:
    """Select states from the states (T, nx) of a motion of a system with contacts, under inputs and forces (T, size).

    The selection is evenly spread, plus the states of the greatest normal forces and of the fastest friction, because
    the system is stiffest there.
    """
    system: System = core.model
    friction = system.friction_states
    # 2.0: friction state beyond which a step was too long to mean anything
    sane = np.all(np.isfinite(states), axis=1) & np.all(np.abs(states[:, friction]) < 2.0, axis=1)
    finite = np.flatnonzero(sane)
    chosen = [finite[:: max(1, len(finite) // _EVEN)]]
    rows = states[finite], u[finite], w[finite]
    forces = np.asarray(core.batch("touch", *rows)[1]).sum(axis=1)
    chosen.append(finite[np.argsort(forces)[-_EXTREME:]])
    if friction.start < friction.stop:
        rates = np.abs(np.asarray(core.batch("forward_dynamics", *rows))[:, friction]).max(axis=1)
        chosen.append(finite[np.argsort(rates)[-_EXTREME:]])
    return states[np.unique(np.concatenate(chosen))]


def _full(system: System) -> float:
    """Return the least depth of a contact with its full stiffness [m]."""
    return 1.001 * system.touch_law.rounding if system.touch_law else 0.0  # beyond the end of the rounded onset


def _at_rest(system: System, x: Array) -> Array:
    """Return the state without velocities; these would damp closing contacts in a wrong way."""
    still = x.copy()
    n = system.n
    still[n : 2 * n] = 0.0
    pose = system.object_states
    still[pose.stop : system.friction_states.start] = 0.0
    return still


_MOVED, _ROUGH = 1e-6, 1e-3
"""Change of a state in difference quotients of a step, per 1 plus its size; and the error of the quotients [1]."""


def spectral_radius(core: Core, q: Array, u: Array, w: Array, p: Array, qd: Array | None = None) -> float:
    """Largest absolute eigenvalue of the linearized motion over shapes (count, n), and of the tendons' lag [1/s].

    Infinite where the model's numbers are not finite, or its mass matrix is singular to rounding. Velocities (count, n)
    matter to quadratic damping alone; by default they come from `rates_sprung_back` of the model.
    """
    model = core.model
    if qd is None:
        rest = (_states(model, shape, np.zeros(model.n), u)[0] for shape in np.atleast_2d(q))
        moving = np.array([model.rates_sprung_back(x, u, p) for x in rest])
    else:
        moving = np.atleast_2d(qd)
    if model.structure.own_tendons or model.friction_names:
        # With friction, both stuck (stiffest) and sliding; on winches also in tension, if commands leave
        # them slack.
        moving = moving * model.structure.has_law("damping")
        pairs = zip(np.atleast_2d(q), moving, strict=True)
        states = chain.from_iterable(_states(model, shape, rates, u) for shape, rates in pairs)
        return _radius(core.linearization(x, u, w, p)[0] for x in states)
    lags = [channel.time_constant for channel in model.finger.channels if channel.time_constant is not None]
    if "drive_time_constant [s]" in model.p_names:
        lags = [float(p[model.p_names.index("drive_time_constant [s]")])]

    def slopes() -> Iterator[Array]:
        for shape, rates in zip(np.atleast_2d(q), moving, strict=True):
            mass = core.mass_matrix(shape, u, p)
            stiffness = core.statics(shape, u, w, p)[1]
            usable = np.all(np.isfinite(mass)) and np.linalg.cond(mass) * np.finfo(float).eps <= 1.0
            damping = damping_matrix(core, shape, u, p, rates)
            yield slope_matrix(mass, stiffness, damping) if usable else np.full_like(mass, np.inf)

    return float(max([_radius(slopes()), *(1.0 / lag for lag in lags)]))


def explicit_rate(core: Core, q: Array, u: Array, w: Array, p: Array) -> float:
    """Steps per second of the explicit method that the fastest motion about shapes asks for; see `spectral_radius`."""
    return spectral_radius(core, q, u, w, p) / INTEGRATORS["rk4"].target


def _radius(slopes: Iterable[Array]) -> float:
    """Largest absolute eigenvalue of some matrices; infinite where the numbers are not finite."""
    largest = 0.0
    for slope in slopes:
        if not np.all(np.isfinite(slope)):
            return math.inf
        largest = max(largest, float(np.abs(np.linalg.eigvals(slope)).max(initial=0.0)))
    return largest


def _states(model: FingerModel, shape: Array, rates: Array, u: Array) -> list[Array]:
    """States of a shape, by its drives and friction."""
    states = len(model.friction_names)
    drives = [model.drives_at(shape, u)]
    if model.structure.winches:
        # 1/4: tension of tendons that pull, per the natural one: what is stiff about them does not depend on it
        finger = model.finger
        drives.append(model.drives_at(shape, u, pulled=0.25 * finger.natural_tension(finger.tendon_list[0])))
    return [
        np.concatenate([shape, rates, lag, np.full(states, sliding)])
        for lag, sliding in product(drives, model.structure.stiffest_friction)
    ]


def grows(core: Core, method: str, q: Array, u: Array, w: Array, p: Array, step: float) -> bool:
    """Whether a linearized step of a method from rest in a shape grows faster than the linearized motion, by its
    drives and friction.
    """
    follow = core.step_function(method)
    for x in _states(core.model, q, np.zeros_like(q), u):
        moved = np.diag(_MOVED * (1.0 + np.abs(x)))
        ends = [np.array(follow(x[:, None] + way * moved, u, u, u, w, w, w, p, step)) for way in (0.5, -0.5)]
        factors = (ends[0] - ends[1]) / moved.diagonal()
        slope = core.linearization(x, u, w, p)[0]
        if not np.all(np.isfinite(factors)) or not np.all(np.isfinite(slope)):
            return True
        true = math.exp(step * max(0.0, float(np.linalg.eigvals(slope).real.max())))
        if np.abs(np.linalg.eigvals(factors)).max() > (1.0 + _ROUGH) * true:
            return True
    return False
