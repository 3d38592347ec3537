"""The optimal control problem of a scene: what is tracked, what is bounded, on which grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.stages import ABSENT, Stages
from continuum_grasp.control.stiffness import fastest_rate
from continuum_grasp.control.transcription import cost_function, step_function, terminal_function
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.controller import Bounds, DiscZone, HalfPlaneZone, Horizon, Penalty

__all__ = ["stages_of"]

Array = NDArray[np.float64]

_HARD = Penalty(linear=1e4, quadratic=1e6)
"""Price at which a row is kept wherever it can be."""
_TARGET = 1.5
"""Product of sub-step and fastest rate; rk4 is stable up to 2.7."""
_EXPLICIT_UP_TO = 4
"""Explicit sub-steps per stage up to which they are taken."""
_IMPLICIT_STEP = 0.010
"""Longest implicit step [s]."""
_PER_ELEMENT = 4
"""Sections of every element that a zone sees."""


def stages_of(scene: ControlScene, prediction: Prediction | None = None) -> Stages:
    """The problem of a scene as functions of a stage.

    Parameters
    ----------
    scene : ControlScene
        The scene.
    prediction : Prediction, optional
        Its model, where it is made already.

    Returns
    -------
    Stages

    Raises
    ------
    InputError
        If the pieces do not fit together.
    """
    model = Prediction(scene) if prediction is None else prediction
    horizon, limits = scene.controller.horizon, scene.controller.input
    remembers = limits.rate_max is not None or bool(scene.controller.cost.input_rate)
    held = ca.SX.sym("held", model.nu if remembers else 0)
    x, u, p = ca.vertcat(model.x, held), model.u, model.p

    def function(name: str, output: str, value: ca.SX) -> ca.Function:
        return ca.Function(name, [x, u, p], [ca.densify(ca.cse([value])[0])], ["x", "u", "p"], [output])

    change = (u - held) / horizon.stage if remembers else None
    tracked = _tracked(scene, model, change)
    outputs = function("outputs", "y", tracked.column)
    bounded = _bounded(scene, model)
    ns = len(bounded.names)
    if limits.rate_max is not None and change is not None:
        names = [f"{n.split(' ')[0]}_rate" for n in model.u_names]
        bounded.add(names, change / limits.rate_max, -1.0, 1.0, _HARD)
    rows = function("rows", "c", bounded.column)
    dynamics = function("dynamics", "xd", model.dynamics(model.x, u, p))
    u_min, u_max = _input_limits(scene)
    method, substeps = _integration(horizon, model, u_min, u_max)
    return Stages(
        step=step_function(dynamics, x.numel(), method),
        cost=cost_function(outputs, rows, horizon.stage),
        terminal=terminal_function(outputs, rows, tracked.of_state, ns),
        outputs=outputs,
        dynamics=dynamics,
        rows=rows,
        stages=horizon.stages,
        stage=horizon.stage,
        substeps=substeps,
        method=method,
        nd=model.nx,
        ns=ns,
        nt=tracked.of_state,
        x_names=(*model.x_names, *[f"held_{n}" for n in model.u_names if remembers]),
        u_names=model.u_names,
        p_names=model.p_names,
        r_names=tuple(tracked.names),
        c_names=tuple(bounded.names),
        u_min=u_min,
        u_max=u_max,
        c_min=np.array(bounded.least),
        c_max=np.array(bounded.most),
        linear=np.array([penalty.linear for penalty in bounded.penalties]),
        quadratic=np.array([penalty.quadratic for penalty in bounded.penalties]),
        weights=np.array(tracked.running),
        terminal_weights=np.array(tracked.terminal),
        p_nominal=np.array(model.p_nominal),
    )


def _integration(horizon: Horizon, model: Prediction, u_min: Array, u_max: Array) -> tuple[str, int]:
    """Method and steps per stage, from the stiffness where the scene does not say."""
    if horizon.method == "sdirk2":
        return "sdirk2", horizon.substeps or math.ceil(horizon.stage / _IMPLICIT_STEP - 1e-9)
    if horizon.substeps is not None:
        return "rk4", horizon.substeps
    wanted = max(1, math.ceil(horizon.stage * fastest_rate(model, u_min, u_max) / _TARGET))
    if horizon.method == "rk4" or wanted <= _EXPLICIT_UP_TO:
        return "rk4", wanted
    return "sdirk2", math.ceil(horizon.stage / _IMPLICIT_STEP - 1e-9)


@dataclass
class _Tracked:
    """What the cost tracks, and its weights."""

    names: list[str] = field(default_factory=list)
    values: list[ca.SX] = field(default_factory=list)
    running: list[float] = field(default_factory=list)
    terminal: list[float] = field(default_factory=list)
    of_state: int = 0

    def add(self, names: list[str], value: ca.SX, running: float, terminal: float | None) -> None:
        self.names += names
        self.values.append(value)
        self.running += [running] * len(names)
        self.terminal += [terminal or 0.0] * len(names)
        if terminal is not None:
            self.of_state = len(self.names)

    @property
    def column(self) -> ca.SX:
        return ca.vertcat(*self.values)


def _tracked(scene: ControlScene, model: Prediction, change: ca.SX | None) -> _Tracked:
    """Outputs in the order of ``Stages``: those of the state first."""
    cost, found = scene.controller.cost, _Tracked()
    given = (model.x, model.u, model.p)
    elements = len(model.system.finger_model.lengths)
    if cost.tip is not None:
        found.add(["tip_x [m]", "tip_y [m]"], model.tip(*given), cost.tip.running, cost.tip.terminal)
    if cost.bending is not None:
        names = [f"bending_{k + 1} [rad]" for k in range(elements)]
        found.add(names, model.bending(*given), cost.bending.running, cost.bending.terminal)
    if cost.shape is not None:
        names = [f"section_{k + 1}_{axis} [m]" for k in range(len(cost.shape.at)) for axis in "xy"]
        where = ca.vec(model.sections(cost.shape.at)(*given)[0])
        found.add(names, where, cost.shape.running, cost.shape.terminal)
    if cost.contact_force is not None:
        force = model.contact_force(*given)
        followed = [model.contact_names.index(name) for name in scene.followed_contacts]
        names = [f"contact_force_{name} [N]" for name in scene.followed_contacts]
        found.add(names, force[followed], cost.contact_force.running, cost.contact_force.terminal)
    if cost.speed is not None:
        names = [f"bending_rate_{k + 1} [rad/s]" for k in range(elements)]
        found.add(names, model.bending_rate(*given), cost.speed.running, cost.speed.terminal)
    if cost.effort:
        found.add(list(model.u_names), model.u, cost.effort, None)
    if cost.input_rate and change is not None:
        names = [f"{n.split(' ')[0]}_rate [{n.split('[')[1][:-1]}/s]" for n in model.u_names]
        found.add(names, change, cost.input_rate, None)
    return found


@dataclass
class _Bounded:
    """Rows, their bounds and penalties."""

    names: list[str] = field(default_factory=list)
    values: list[ca.SX] = field(default_factory=list)
    least: list[float] = field(default_factory=list)
    most: list[float] = field(default_factory=list)
    penalties: list[Penalty] = field(default_factory=list)

    def add(self, names: list[str], value: ca.SX, least: float, most: float, penalty: Penalty) -> None:
        self.names += names
        self.values.append(value)
        self.least += [least] * len(names)
        self.most += [most] * len(names)
        self.penalties += [penalty] * len(names)

    @property
    def column(self) -> ca.SX:
        return ca.vertcat(*self.values) if self.values else ca.SX(0, 1)


def _bounded(scene: ControlScene, model: Prediction) -> _Bounded:
    """Rows of the state alone."""
    bounds, found = scene.controller.bounds, _Bounded()
    penalty = _penalty(bounds.penalty)
    given = (model.x, model.u, model.p)
    if bounds.curvature is not None:
        kappa = model.curvature(*given)
        limits = np.minimum(_range_of_nodes(model, kappa.numel()), scene.curvature_limit)
        names = [f"curvature_{k + 1}" for k in range(kappa.numel())]
        found.add(names, kappa / ca.DM(limits), -1.0, 1.0, penalty)
    if bounds.speed is not None:
        rate = model.bending_rate(*given)
        names = [f"bending_rate_{k + 1}" for k in range(rate.numel())]
        found.add(names, rate / bounds.speed, -1.0, 1.0, penalty)
    _add_zones(found, bounds, model)
    return found


def _add_zones(found: _Bounded, bounds: Bounds, model: Prediction) -> None:
    """Distance of the finger's surface from each zone, per finger length."""
    finger = model.scene.finger
    for name, zone in bounds.keep_out.items():
        places = [finger.rod.length]
        if zone.of == "backbone":
            lengths = model.system.finger_model.lengths
            ends = np.cumsum([0.0, *lengths])
            places = [ends[k] + h * (j + 1) / _PER_ELEMENT for k, h in enumerate(lengths) for j in range(_PER_ELEMENT)]
        where = model.sections(tuple(min(s, finger.rod.length) for s in places))(model.x, model.u, model.p)[0]
        away = zone.clearance + finger.thickness_radius
        gaps = ca.vertcat(*[_gap(zone, where[:, k]) for k in range(len(places))]) - away
        labels = [name] if len(places) == 1 else [f"{name}_{k + 1}" for k in range(len(places))]
        found.add(labels, gaps / finger.rod.length, 0.0, ABSENT, _penalty(zone.penalty))


def _gap(zone: HalfPlaneZone | DiscZone, at: ca.SX) -> ca.SX:
    """Distance of a point from the edge of a zone, positive outside [m]."""
    if isinstance(zone, HalfPlaneZone):
        nx, ny = math.cos(zone.normal_angle), math.sin(zone.normal_angle)
        return nx * (at[0] - zone.point[0]) + ny * (at[1] - zone.point[1])
    dx, dy = at[0] - zone.center[0], at[1] - zone.center[1]
    return ca.sqrt(dx * dx + dy * dy + 1e-12) - zone.radius


def _penalty(given: Penalty | str) -> Penalty:
    return given if isinstance(given, Penalty) else _HARD


def _range_of_nodes(model: Prediction, count: int) -> Array:
    """Greatest curvature that the bending range allows at each node, or on each arc [1/m]."""
    finger = model.system.finger_model
    per_length: Array = np.array(finger.ranges) / np.array(finger.lengths)
    if count == len(per_length):
        return per_length
    nodes: Array = np.minimum(np.append(per_length, per_length[-1]), np.append(per_length[0], per_length))
    return nodes


def _input_limits(scene: ControlScene) -> tuple[Array, Array]:
    tendons = scene.finger.tendons
    if tendons is not None:
        return np.full(2, tendons.min_tension), np.full(2, tendons.max_tension)
    most = scene.controller.input.moment_max or 0.0
    return np.array([-most]), np.array([most])
