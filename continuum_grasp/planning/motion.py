"""The motion of a plan as scaled functions of state, control and duration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.ocp.bounds import HARD, state_bounds
from continuum_grasp.control.ocp.cost_terms import Outputs, cost_terms
from continuum_grasp.control.ocp.setpoints import setpoints
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, find_compiler
from continuum_grasp.planning.shooting import Term, derived
from continuum_grasp.scene.plan import PlanScene
from continuum_grasp.simulation.signals import interpolate

Array = NDArray[np.float64]

_COMPILE_FROM = 150_000
"""Instructions of the second derivatives at all intervals from which on compiling them pays."""


@dataclass(frozen=True)
class _Scales:
    """What one unit of the problem amounts to."""

    x: Array
    u: Array
    rate: Array
    time: float
    objective: float


class Motion:
    """State, control and duration of a plan, and how the state moves.

    The state s is that of the model and, where the input is a straight line over each interval, the input; the control
    v is the input, or its rate. Everything is scaled; time runs from 0 to 1.

    Attributes
    ----------
    prediction : Prediction
        The model.
    tracked : Outputs or None
        What is tracked; changes of the input are not among these, since their rows depend on the duration.
    bounded : BoundedRows
        Bounds of the state.
    linear : bool
        Whether the input is part of the state.
    nx, nu, ns, nv : int
        Sizes of the model's state and input, of state and control here.
    scales : _Scales
    """

    def __init__(self, scene: PlanScene) -> None:
        self.scene = scene
        self.prediction = model = Prediction(scene)
        self.tracked = None
        if scene.cost is not None:
            terms = tuple(term for term in cost_terms(scene.cost) if term.key != "input_rate")
            self.tracked = Outputs(scene.cost, model, terms)
        self.bounded = state_bounds(scene.bounds, scene.bounds.curvature_limit(scene.finger), model)
        self.linear = scene.input.form == "linear"
        self.nx, self.nu = self.prediction.nx, self.prediction.nu
        self.ns, self.nv = self.nx + (self.nu if self.linear else 0), self.nu
        self._setpoints = None if self.tracked is None else setpoints(self.tracked, scene.reference)
        self.scales = self._scales()

    # -- units --------------------------------------------------------------------------------------------------------

    def _scales(self) -> _Scales:
        scene, model = self.scene, self.prediction
        least, most = scene.input_limits
        time = self.first_duration
        u = np.full(self.nu, most - least if self.nu == 2 else most)
        objective = {
            "least_time": time,
            "least_effort": float(u @ u) * time,
            "least_input_rate": float(u @ u) / time,
            "tracking": 1.0,
        }[scene.objective]
        reach = np.abs(model.shapes(16)).max(axis=0)
        x = np.array([self._unit(k, reach, float(u[0]), time) for k in range(self.nx)])
        return _Scales(x, u, u / time, time, objective)

    def _unit(self, k: int, reach: Array, input_range: float, time: float) -> float:
        n, tendons = len(reach), self.scene.finger.tendons
        name, unit = self.prediction.x_names[k].rstrip("]").split(" [")
        if k < n:
            return float(reach[k])
        if k < 2 * n:
            return float(reach[k - n]) * 2.0 * np.pi / time
        if name.startswith("tip_moment"):
            lag = tendons.time_constant if tendons is not None else self.scene.input.time_constant
            moment = input_range * (tendons.offset if tendons is not None else 1.0)
            return moment if name == "tip_moment" else moment / (lag or time)
        length = 0.1 * self.scene.finger.rod.length
        return {"m": length, "m/s": length / time, "rad/s": 1.0 / time}.get(unit, 1.0)

    @property
    def first_duration(self) -> float:
        """Duration from which the search begins [s]."""
        least, most = self.scene.duration_range
        return float(np.sqrt(least * most))

    @property
    def exact(self) -> bool:
        """Whether the exact Hessian is wanted."""
        return self.scene.solver.hessian == "exact"

    @cached_property
    def hard(self) -> NDArray[np.bool_]:
        """Which of the state's bounds (ns) are hard."""
        return np.asarray(self.bounded.linear >= HARD.linear)

    @property
    def units(self) -> Array:
        """Physical amounts of one unit of x, u, time and objective."""
        found = self.scales
        return np.concatenate([found.x, found.u, [found.time, found.objective]])

    @property
    def s_scale(self) -> Array:
        """Physical amounts of one unit of each state."""
        return np.concatenate([self.scales.x, self.scales.u]) if self.linear else self.scales.x

    # -- numbers that the functions read ------------------------------------------------------------------------------

    def numbers(self, times: ArrayLike) -> Array:
        """Parameters and setpoints (len(times), nd) at instants [s]."""
        instants = np.atleast_1d(np.asarray(times, dtype=float))
        p = parameters_over_time(self.scene, self.prediction, instants)
        r = np.zeros((len(instants), 0)) if self._setpoints is None else self._setpoints.rows(instants)
        return np.hstack([p, r, np.tile(self.units, (len(instants), 1))])

    @property
    def length(self) -> float:
        """Length of the finger [m]."""
        return self.scene.finger.rod.length

    # -- functions ----------------------------------------------------------------------------------------------------

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Scaled s, v and T, and the numbers d: parameters, setpoints, units (so that the code serves all units)."""
        size = self.prediction.np + self.nr + self.nx + self.nu + 2
        return ca.SX.sym("s", self.ns), ca.SX.sym("v", self.nv), ca.SX.sym("T"), ca.SX.sym("d", size)

    @property
    def nr(self) -> int:
        """Number of setpoints."""
        return 0 if self.tracked is None else len(self.tracked.names)

    @cached_property
    def outputs(self) -> ca.Function:
        """(x, u, p) -> what is tracked."""
        return self._function("outputs", ca.SX(0, 1) if self.tracked is None else self.tracked.value())

    @cached_property
    def rows(self) -> ca.Function:
        """(x, u, p) -> what the bounds of the state bound, relative to their scales."""
        return self._function("rows", self.bounded.column)

    def _function(self, name: str, value: ca.SX) -> ca.Function:
        given = [self.prediction.x, self.prediction.u, self.prediction.p]
        return ca.Function(name, given, [ca.densify(ca.cse([value])[0])])

    @cached_property
    def _units(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """What one unit of x, u, time and objective amounts to, as read from the numbers."""
        start = self.prediction.np + self.nr
        cuts = np.cumsum([start, self.nx, self.nu, 1, 1]).tolist()
        of_x, of_u, of_time, of_objective = ca.vertsplit(self.symbols[3], [0, *cuts])[1:]
        return of_x, of_u, of_time, of_objective

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
        z, out = ca.vertcat(s, v, duration), ca.vertcat(time * rate, running)
        term = derived("flow", z, d, out, exact=self.exact, squared=squared)
        work = term.hessian.n_instructions() * self.scene.intervals
        return compiled(term) if work > _COMPILE_FROM else term

    def _errors(self) -> ca.SX:
        """Errors whose half sum of squares per second is the objective."""
        x, u, _, p, r = self.physical
        objective = self.scene.objective
        _, of_u, of_time, _ = self._units
        rate = self.symbols[1] * of_u / of_time
        if objective == "least_effort":
            return ca.SX(np.sqrt(2.0) * (u - ca.DM(self.scene.initial_input)))
        if objective == "least_input_rate" and self.linear:
            return ca.SX(np.sqrt(2.0) * rate)
        if self.tracked is not None:
            weighted: ca.SX = ca.DM(np.sqrt(self.tracked.weights[:, 0])) * (self.outputs(x, u, p) - r)
            rate_weight = self.scene.cost.input_rate if self.scene.cost is not None else None
            if rate_weight and self.linear:
                return ca.vertcat(weighted, np.sqrt(rate_weight) * rate)
            return weighted
        return ca.SX(0, 1)

    def of_state(self, name: str, expression: ca.SX, *, squared: ca.SX | None = None) -> Term:
        """A term that reads s alone."""
        s, _, _, d = self.symbols
        return derived(name, s, d, expression, exact=self.exact, squared=squared)

    # -- between the problem and the world --------------------------------------------------------------------------

    def scaled_state(self, x: ArrayLike, u: ArrayLike) -> Array:
        """States (..., ns) of the problem."""
        parts = [np.asarray(x) / self.scales.x]
        return np.concatenate([*parts, np.asarray(u) / self.scales.u] if self.linear else parts, axis=-1)


def compiled(term: Term) -> Term:
    """The same term as compiled code, or the term itself where nothing can be compiled."""
    compiler = find_compiler()
    if compiler is None:
        return term
    generator = ca.CodeGenerator("term.c", {"with_mem": False, "static_aux": True})
    functions = (term.value, term.jacobian, term.hessian)
    for function in functions:
        generator.add(function)
    try:
        library = str(library_for(generator.dump(), compiler))
    except (CompileError, OSError):
        return term
    return Term(*(ca.external(function.name(), library) for function in functions))


def parameters_over_time(scene: PlanScene, model: Prediction, times: ArrayLike) -> Array:
    """Parameters (len(times), np) of the model at instants [s]: nominal ones, and the known forces."""
    instants, length = np.atleast_1d(np.asarray(times, dtype=float)), scene.finger.rod.length
    p = np.tile(np.array(model.p_nominal, dtype=float), (len(instants), 1))
    names = list(model.p_names)
    for load in scene.loads:
        place = [k for k, at in enumerate(scene.contacts) if abs(at - load.at) <= 1e-9 * length]
        start = names.index(f"contact_{place[0] + 1}_x [N]" if place else "tip_x [N]")
        force = load.force
        p[:, start : start + 2] += np.array(force) if isinstance(force, tuple) else interpolate(force, instants)[0]
    return p
