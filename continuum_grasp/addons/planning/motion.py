"""The motion of a plan as scaled functions of state, control and duration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.addons.planning.scene import PlanScene
from continuum_grasp.addons.planning.shooting import MOST_STEPS, Term, compiled, derived, fewest_evaluations
from continuum_grasp.base import Array, InputError
from continuum_grasp.closed_loop import missed_setpoints
from continuum_grasp.control import (
    BoundedRows,
    Prediction,
    Setpoints,
)
from continuum_grasp.simulation import interpolate


@dataclass(frozen=True)
class _Scales:
    """Physical amounts of the units of the problem."""

    x: Array
    u: Array
    rate: Array
    time: float
    objective: float


class PlannedMotion:
    """State, control and duration of a plan, and how the state moves.

    The state s (ns) is the model's state and, where the input is a straight line over each interval (``linear``), the
    input; the control v (nu) is the input, or its rate. Everything is scaled; time runs from 0 to 1.
    """

    def __init__(self, scene: PlanScene) -> None:
        self.scene = scene
        self.prediction = model = Prediction(scene)
        self.length = scene.finger.rod.length
        # Steps in the inputs alone are those of Gauss and Newton.
        self.exact = scene.solver.hessian == "exact" and scene.transcription != "single_shooting"
        self.tracked = self._setpoints = None
        if scene.cost is not None:
            # Rows of changes of the input depend on the duration.
            of = Setpoints.of_cost(scene.cost, model, scene.reference, without="input_rate")
            self.tracked, self._setpoints = of
        self.nr = 0 if self.tracked is None else len(self.tracked.names)
        self.bounded = BoundedRows.of_state(scene.bounds, model)
        for k, tendon in zip(self.bounded.groups.get("tension", ()), scene.finger.tendon_list, strict=False):
            self.bounded.least[k] = scene.least_tension / tendon.max_tension
        self.linear = scene.input.form == "linear"
        self.nx = model.nx
        self.nu = model.nu
        self.input_unit = scene.finger.inputs[0].unit
        self.ns = self.nx + (self.nu if self.linear else 0)
        self.first_duration = first_duration(scene)
        self.reach = reach_of(model)
        self.scales = scales = self._scales()
        self.s_scale = np.concatenate([scales.x, scales.u]) if self.linear else scales.x
        self.units = np.concatenate([scales.x, scales.u, [scales.time, scales.objective]])

    def _scales(self) -> _Scales:
        """Scales by which unknowns, defects and objective are of the order of one, as IPOPT's tolerances assume."""
        time = self.first_duration
        u = input_scale(self.scene)
        objective = objective_scale(self.scene)
        return _Scales(state_scales(self.prediction, self.reach, time), u, u / time, time, objective)

    def numbers(self, shares: ArrayLike) -> Array:
        """Parameters, setpoints and units (..., nd) that the functions read, at shares of the duration."""
        # Only where the duration is given does anything vary over time.
        instants = np.ravel(shares) * self.scene.duration_range[1]
        p = parameters_over_time(self.scene, self.prediction, instants)
        r = np.zeros((len(instants), 0)) if self._setpoints is None else self._setpoints.rows(instants)
        return np.hstack([p, r, np.tile(self.units, (len(instants), 1))]).reshape(*np.shape(shares), -1)

    def scaled_state(self, x: ArrayLike, u: ArrayLike) -> Array:
        """States (..., ns) of the problem."""
        parts = [np.asarray(x) / self.scales.x]
        if self.linear:
            parts.append(np.asarray(u) / self.scales.u)
        return np.concatenate(parts, axis=-1)

    @cached_property
    def _rates(self) -> Array:
        """Eigenvalues [1/s] that steps of single shooting are stable for."""
        return self.prediction.eigenvalues(*(np.array(limit) for limit in self.scene.input_limits))

    def hold(self, rates: Array) -> None:
        """Take steps that are stable for further eigenvalues [1/s], from a motion that was found."""
        self._rates = np.concatenate([self._rates, rates])

    @property
    def steps(self) -> tuple[int, int]:
        """Steps per interval of single shooting, and stages of each, that the stiffness asks for."""
        scene, rates = self.scene, self._rates
        # 2.0: factor by which a duration is expected to be longer than where the search begins
        longest = min(scene.duration_range[1], 2.0 * self.first_duration) / scene.intervals
        steps, stages = fewest_evaluations(rates, longest, scene.solver.substeps)
        if steps > MOST_STEPS:
            substeps = scene.solver.substeps
            lever = "leave out solver.substeps" if substeps else "raise intervals"
            raise InputError(
                f"single_shooting would have to follow rates of up to {np.abs(rates).max():.2g} 1/s, so each of "
                f"{scene.intervals} intervals needs more than {substeps or MOST_STEPS:,} steps: "
                + (lever if scene.sudden else f"use method: collocation, or {lever}"),
                key="solver.substeps" if substeps else "method",
            )
        return steps, stages

    # -- functions ----------------------------------------------------------------------------------------------------

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Scaled s, v and T, and the numbers d: parameters, setpoints, units (so that the code serves all units)."""
        size = self.prediction.np + self.nr + len(self.units)
        return ca.SX.sym("s", self.ns), ca.SX.sym("v", self.nu), ca.SX.sym("T"), ca.SX.sym("d", size)

    @property
    def node(self) -> tuple[ca.SX, ca.SX]:
        """Symbols z = [s, the input that is held there] of a node, and the numbers d."""
        s, v, _, d = self.symbols
        # Inputs that are linear in between are read from s; what is held has its columns all the same.
        held = ca.SX.sym("held", self.nu) if self.linear else v
        return ca.vertcat(s, held), d

    @cached_property
    def outputs(self) -> ca.Function:
        """(x, u, p) -> the tracked quantities."""
        tracked = ca.SX(0, 1) if self.tracked is None else self.tracked.value()
        return self._function("outputs", tracked)

    def missed_setpoints(self, x: Array, u: Array, duration: float) -> tuple[str, ...]:
        """Say what ends far from setpoints that stood, of states (N + 1, nx) and inputs (N + 1, nu)."""
        if self.tracked is None or self._setpoints is None:
            return ()
        t = np.linspace(0.0, duration, len(x))
        outputs = np.array(self.outputs(x.T, u.T, parameters_over_time(self.scene, self.prediction, t).T)).T
        return missed_setpoints(
            self.tracked.names, outputs, self._setpoints.rows(t), t, self.scene.reference, self.scene.finger.rod
        )

    @cached_property
    def rows(self) -> ca.Function:
        """(x, u, p) -> what the bounds of the state bound, relative to their scales."""
        return self._function("rows", self.bounded.column)

    def _function(self, name: str, value: ca.SX) -> ca.Function:
        symbols = [self.prediction.x, self.prediction.u, self.prediction.p]
        return ca.Function(name, symbols, [ca.densify(ca.cse([value])[0])])

    @cached_property
    def _units(self) -> list[ca.SX]:
        """Physical amounts of one unit of x, u, time and objective, as read from the numbers."""
        start = self.prediction.np + self.nr
        cuts = np.cumsum([start, self.nx, self.nu, 1, 1]).tolist()
        return list(ca.vertsplit(self.symbols[3], [0, *cuts])[1:])

    @cached_property
    def physical(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
        """x, u, T, p and setpoints r as expressions of the symbols."""
        s, v, duration, d = self.symbols
        of_x, of_u, of_time, _ = self._units
        u = s[self.nx :] if self.linear else v
        split = self.prediction.np
        return s[: self.nx] * of_x, u * of_u, of_time * duration, d[:split], d[split : split + self.nr]

    @cached_property
    def flow(self) -> Term:
        """(z = [s, v, T], d) -> rates of s and of the objective per scaled time; compiled where that pays."""
        s, v, duration, d = self.symbols
        x, u, time, p, _ = self.physical
        of_x, _, of_time, of_objective = self._units
        rate = self.prediction.dynamics(x, u, p) / of_x
        if self.linear:
            rate = ca.vertcat(rate, v / of_time)
        errors = self._errors()
        running = time * ca.dot(errors, errors) / 2 / of_objective
        squared = ca.sqrt(time / of_objective) * errors
        # The duration is an unknown: d/d(tau) = T d/dt, with tau from 0 to 1.
        z = ca.vertcat(s, v, duration)
        out = ca.vertcat(time * rate, running)
        term = derived("flow", z, d, out, exact=self.exact, squared=squared)
        work = term.hessian.n_instructions() * self.scene.intervals
        simulated = self.scene.transcription == "single_shooting"  # in many steps
        # 150_000: instructions of the second derivatives at all intervals from which on compiling them pays
        flow = compiled(term) if simulated or work > 150_000 else term
        return _with_given_friction(flow, self.prediction.x_names) if simulated else flow

    @cached_property
    def tendon_friction(self) -> list[int]:
        """Places in the state of the friction of tendons."""
        return [k for k, name in enumerate(self.prediction.x_names) if name.startswith("friction_")]

    @cached_property
    def motor_friction(self) -> dict[int, float]:
        """Places in the state of the dry friction of motors that no servo turns to an angle, and their
        ``presliding_angle``.
        """
        names = list(self.prediction.x_names)
        return {
            names.index(f"motor_friction_{k + 1} [1]"): drive.presliding_angle
            for k, drive in enumerate(self.scene.finger.winches)
            if drive.kind == "motor" and drive.position_gain is None and drive.presliding_angle is not None
        }

    @cached_property
    def friction_states(self) -> list[int]:
        """Places in the state of friction whose direction decides where the finger rests: of tendons, then of
        motors.
        """
        return [*self.tendon_friction, *self.motor_friction]

    def slid(self, q: Array, u: Array) -> Array:
        """Sliding per presliding from the unloaded finger to coordinates q (n) under inputs u (nu), per friction state.

        Of tendons, and of the motors that balance them.
        """
        finger = self.prediction.system.finger_model
        sliding = np.array(finger.sliding()(q, np.zeros(finger.nu), finger.p_nominal)).ravel()
        x = self.prediction.at_rest(q, u)
        # The angle is two states before its friction.
        turned = [x[k - 2] / presliding for k, presliding in self.motor_friction.items()]
        return np.concatenate([sliding[: len(self.tendon_friction)], turned])

    @cached_property
    def sliding(self) -> ca.SX:
        """Rate of sliding [1/s] as an expression of the symbols."""
        x, _, _, p, _ = self.physical
        z = x[self.friction_states]
        # A friction state follows what slides, but for its return from beyond its range.
        rate = self.prediction.dynamics(x, np.zeros(self.nu), p)[self.friction_states]
        memory = self.prediction.system.structure.memory
        return rate + (z - memory.clipped(z)) / memory.return_time

    def _errors(self) -> ca.SX:
        """Errors whose half sum of squares per second is the objective."""
        x, u, _, p, r = self.physical
        cost, objective = self.scene.cost, self.scene.objective
        _, of_u, of_time, _ = self._units
        rate = self.symbols[1] * of_u / of_time
        if objective == "least_effort":
            return ca.SX(np.sqrt(2.0) * (u - ca.DM(self.scene.initial_input)))
        if objective == "least_input_rate" and self.linear:
            return ca.SX(np.sqrt(2.0) * rate)
        if self.tracked is None or cost is None:
            return ca.SX(0, 1)
        weighted: ca.SX = ca.DM(np.sqrt(self.tracked.weights[:, 0])) * (self.outputs(x, u, p) - r)
        if cost.input_rate and self.linear:
            return ca.vertcat(weighted, np.sqrt(cost.input_rate) * rate)
        return weighted


def reach_of(model: Prediction) -> Array:
    """Greatest coordinates (n) of shapes within half the bending range."""
    # 16: shapes for its order of magnitude
    return np.asarray(np.abs(model.shapes(16)).max(axis=0))


def state_scales(model: Prediction, reach: Array, time: float) -> Array:
    """Sizes of the states (nx) of a motion over a time [s]."""
    n = len(reach)
    length = 0.1 * model.scene.finger.rod.length
    by_unit = {"[m]": length, "[m/s]": length / time, "[rad/s]": 1.0 / time}
    scales = np.array([by_unit.get(name.rpartition(" ")[2], 1.0) for name in model.x_names])
    # Greatest rate of an oscillation over the reach whose period is that time.
    scales[:n], scales[n : 2 * n] = reach, reach * 2.0 * np.pi / time
    for drive in model.driven:
        scales[[drive.state, *drive.rate]] = drive.most, *[drive.most / drive.lag] * len(drive.rate)
    return scales


def first_duration(scene: PlanScene) -> float:
    """Duration with which a search begins [s]: the given one, or the middle of the logarithms of what may be."""
    return float(np.sqrt(np.prod(scene.duration_range)))


def input_scale(scene: PlanScene) -> Array:
    """Sizes of the inputs (nu): their ranges, of a moment half of it."""
    least, greatest = (np.array(limit) for limit in scene.input_limits)
    return np.asarray(greatest - np.maximum(least, 0.0))


def objective_scale(scene: PlanScene) -> float:
    """Size of the objective, in its unit."""
    time = first_duration(scene)
    effort = float(input_scale(scene) @ input_scale(scene))
    scales = {"least_time": time, "least_effort": effort * time, "least_input_rate": effort / time, "tracking": 1.0}
    return scales[scene.objective]


def _with_given_friction(flow: Term, names: Sequence[str]) -> Term:
    """A flow in whose slopes friction acts as it does at each instant, whatever the inputs.

    Where it sticks, its own slopes hold for micrometers only: a finger looks locked. Measured on two winches with a
    friction of 0.15: with them, 40 steps of some 40 micrometers and no plan.
    """
    rows = [k for k, name in enumerate(names) if "friction_" in name]
    return replace(flow, jacobian=without_rows("flow_slope", flow.jacobian, rows)) if rows else flow


def without_rows(name: str, function: ca.Function, rows: list[int]) -> ca.Function:
    """A function (z, d) with some rows of zeros."""
    stay = np.ones(function.size1_out(0))
    stay[rows] = 0.0
    z, d = (ca.MX.sym(argument, function.size_in(k)) for k, argument in enumerate("zd"))
    value = ca.mtimes(ca.diag(ca.DM(stay)), function(z, d))
    return ca.Function(name, [z, d], [value], ["z", "d"], function.name_out())


def parameters_over_time(scene: PlanScene, model: Prediction, times: ArrayLike) -> Array:
    """Parameters (len(times), np) of the model at instants [s]: nominal ones, and the known forces."""
    instants = np.atleast_1d(np.asarray(times, dtype=float))
    length = scene.finger.rod.length
    p = np.tile(np.array(model.p_nominal, dtype=float), (len(instants), 1))
    names = list(model.p_names)
    for load in scene.loads:
        # With contacts, forces at them and at the tip are parameters; without, that at the tip alone is.
        place = [k for k, at in enumerate(scene.contacts) if abs(at - load.at) <= 1e-9 * length]
        name = f"contact_{place[0] + 1}_x [N]" if place else "tip_x [N]"
        start = names.index(name)
        p[:, start : start + 2] += interpolate(load.force, instants)[0]
    return p
