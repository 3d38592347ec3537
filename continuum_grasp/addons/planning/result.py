"""A plan: what was found, how, and how it fares in a fine simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cached_property
from os import PathLike
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline

from continuum_grasp.addons.planning.motion import parameters_over_time
from continuum_grasp.addons.planning.scene import PlanScene
from continuum_grasp.base import Array, prefixed
from continuum_grasp.control import Prediction
from continuum_grasp.model import System
from continuum_grasp.results import Dimension, MotionResult, Picture, Stored
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import ContactHistory, scene_under

_PARTS = {
    "values": "bounded quantities",
    "lower": "its lower bound",
    "upper": "its upper bound",
    "multipliers": "decrease of the objective per outward shift of the bound",
}
"""Arrays of a constraint, and what they are."""


class PlanStatus(StrEnum):
    """Outcome of the search."""

    OPTIMAL = "optimal"
    """A local optimum."""
    FEASIBLE = "feasible"
    """All constraints are satisfied, but the solver stopped before the optimum, or the search before its end, or a fine
    simulation of the inputs is farther from the plan than ``check.tolerance``, with the tip or the object."""
    GOAL_MISSED = "goal_missed"
    """All constraints are satisfied, but a goal that has a weight is missed by more than its tolerance, or a setpoint
    that stood, or any goal in a fine simulation of the inputs."""
    INFEASIBLE = "infeasible"
    """No plan was found that satisfies all constraints; this one comes as near to the goal as was found."""
    NOT_SOLVED = "not_solved"
    """The solver stopped without a plan, or with one that misses a goal with a weight, and without showing that there
    is none."""
    STOPPED = "stopped"
    """The clock stopped the search before there was a plan: an emergency, which another machine may not meet."""


@dataclass(frozen=True)
class Constraint:
    """A bounded quantity.

    Attributes
    ----------
    name, key, unit : str
        ``key`` is the YAML key that sets it.
    values, lower, upper : (count, size) ndarray
        One line per node or interval, in ``unit``.
    multipliers : (count, size) ndarray
        Decrease of the objective per small outward shift of the bound; negative at lower
        bounds.
    """

    name: str
    key: str
    unit: str
    values: Array = field(repr=False)
    lower: Array = field(repr=False)
    upper: Array = field(repr=False)
    multipliers: Array = field(repr=False)

    @property
    def excess(self) -> float:
        """Largest amount by which a bound is left."""
        return float(np.maximum(self.lower - self.values, self.values - self.upper).max(initial=0.0))

    @property
    def active(self) -> bool:
        """Whether a bound holds the plan back somewhere."""
        # 1e-6: multiplier above which a bound counts as active, in the units of `Constraint.multipliers`
        return bool(np.any(np.abs(self.multipliers) > 1e-6))


@dataclass(frozen=True)
class Deviation:
    """Distance of a simulated motion from a plan."""

    model: str
    """Model that was simulated."""
    tip: float
    """Largest deviation of the tip [m]."""
    final_tip: float
    """Deviation of the tip at the end [m]."""
    final_rate: float
    """Largest bending rate at the end [rad/s]."""
    contact_forces: tuple[float, ...] = ()
    """Normal force at each place where the finger may touch the object, at the end [N]."""
    object: float = 0.0
    """Largest deviation of a point of an object that moves [m]."""
    final_object: float = 0.0
    """Deviation of the object at the end [m]."""


@dataclass(frozen=True)
class MotionPlan(MotionResult):
    """A motion from an initial state to a goal; SI units, world frame.

    Attributes
    ----------
    scene : PlanScene
    status : PlanStatus
    message : str
        One sentence on how it ended.
    t, x, u : ndarray
        See the stored arrays. Inputs are constant from their node to the next one, or linear in between
        (``input.form``); the last one holds after the end.
    objective : float
        The duration [s], the integral of the squared input or input rate (``objective_unit``), or the sum of ``cost``;
        without weighted goals, penalties of soft bounds, and ``smoothing``.
    constraints : mapping of str to Constraint
        All constraints by name, with their values and multipliers.
    iterations : int
        Iterations of the start that gave this plan.
    times : mapping of str to float
        Build, search, check, total [s].
    violated : tuple of str
        Broken constraints by name with their amounts, where there is no plan.
    advice : str
        Likely cause, and what to try.
    deviation, finer : Deviation or None
        Result of a fine simulation of the inputs, and of one on the finer model of ``check.finer``.
    warnings : tuple of str
    statistics : mapping
        Starts with their outcomes, unknowns, constraints, sub-steps.
    solver_state : mapping of str to ndarray
        Unknowns and multipliers, for a warm start.
    """

    kind: ClassVar[str] = "plan"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("t", "(time,)", "s", "instants of the nodes"),
        Stored("x", "(time, state)", "", "states"),
        Stored("u", "(time, input)", "", "inputs"),
        Stored("tip", "(time, xy)", "m", "world position of the tip"),
        *(
            Stored(f"constraint {{constraint}} {part}", "({constraint} place, {constraint} entry)", "", meaning)
            for part, meaning in _PARTS.items()
        ),
        Stored("solver w", "(unknown,)", "1", "scaled unknowns of the NLP, for a warm start", "solver_state.w"),
        Stored("solver bounds", "(unknown,)", "1", "multipliers of their bounds", "solver_state.bounds"),
        Stored(
            "solver constraints",
            "(condition,)",
            "1",
            "multipliers of its constraints",
            "solver_state.constraints",
        ),
        Stored("solver units", "(scaled,)", "", "units in which the unknowns are scaled", "solver_state.units"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension.TIME,
        Dimension("state", "states of the model", "x_names"),
        Dimension("input", "tendon tensions or tip moment", "u_names"),
        Dimension.XY,
        Dimension("{constraint} place", "nodes or intervals at which it holds"),
        Dimension("{constraint} entry", "its entries, in its unit (``constraints`` of ``meta.json``)"),
        Dimension("unknown", "unknowns of the NLP"),
        Dimension("condition", "constraints of the NLP"),
        Dimension("scaled", "kinds of unknowns"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("path", "continuum_grasp.addons.planning.pictures:plot_plan_path"),
        Picture("inputs", "continuum_grasp.plotting.control:plot_inputs"),
        Picture("coordinates", "continuum_grasp.plotting.motion:plot_coordinates"),
        Picture("contact_forces", "continuum_grasp.plotting.motion:plot_contact_forces", needs="contacts"),
    )
    frames: ClassVar[str] = "continuum_grasp.plotting.motion:motion_frames"

    scene: PlanScene
    status: PlanStatus
    message: str
    t: Array
    x: Array
    u: Array
    objective: float
    constraints: Mapping[str, Constraint] = field(default_factory=dict)
    iterations: int = 0
    times: Mapping[str, float] = field(default_factory=dict)
    violated: tuple[str, ...] = ()
    advice: str = ""
    deviation: Deviation | None = None
    finer: Deviation | None = None
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)
    solver_state: Mapping[str, Array] = field(default_factory=dict)

    def words(self) -> dict[str, list[str]]:
        """Names of the constraints."""
        return {"constraint": list(self.constraints)}

    @property
    def objective_unit(self) -> str:
        """Unit of the objective; empty where it sums terms of several units, as tracking does."""
        unit, *others = {of.unit for of in self.scene.finger.inputs}
        squared = f"({unit})2" if " " in unit else f"{unit}2"
        units = {"least_time": "s", "least_effort": f"{squared} s", "least_input_rate": f"{squared}/s"}
        return "" if others and self.scene.objective != "least_time" else units.get(self.scene.objective, "")

    @property
    def linear_inputs(self) -> bool:
        """Whether inputs go from node to node along straight lines, rather than hold."""
        return self.scene.input.form == "linear"

    @property
    def active_constraints(self) -> list[str]:
        """Names of the constraints that hold the plan back somewhere."""
        return [c.name for c in self.constraints.values() if c.active and not c.name.startswith("motion")]

    def pairs(self) -> dict[str, str]:
        """Objective, duration, where the tip ends, active constraints, effort, and how it fares in a simulation."""
        x, y = self.tip[-1]
        aim = self.scene.goal.contact_force
        asked = f"; asked {_listed(aim.value)}" if aim else ""
        rows = {
            "objective": f"{self.objective:.6g} {self.objective_unit} ({self.scene.objective})",
            "duration": f"{self.duration:.6g} s in {len(self.t) - 1} intervals",
            "tip at the end": f"({x:.4f}, {y:.4f}) m",
            "contact forces": f"{_listed(self.contact_forces[-1])} at the end{asked}",
            "active constraints": ", ".join(self.active_constraints) or "nothing",
            "solver": f"{self.iterations} iterations; {self.times.get('total', 0.0):.2f} s in all",
        }
        for name, check in (("fine simulation", self.deviation), ("finer model", self.finer)):
            if check is not None:
                text = f"tip up to {1e3 * check.tip:.3g} mm off the plan, {1e3 * check.final_tip:.3g} mm at the end"
                if check.object:
                    text += f"; object up to {1e3 * check.object:.3g} mm, {1e3 * check.final_object:.3g} mm at the end"
                rows[name] = f"{text} ({check.model})"
        if not self.contact_forces.size:
            del rows["contact forces"]
        return rows

    @property
    def solved(self) -> bool:
        """Whether all constraints are satisfied."""
        return self.status in (PlanStatus.OPTIMAL, PlanStatus.FEASIBLE, PlanStatus.GOAL_MISSED)

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.t[-1])

    @cached_property
    def prediction(self) -> Prediction:
        """The model."""
        return Prediction(self.scene)

    @property
    def system(self) -> System:
        """The finger with its object."""
        return self.prediction.system

    @property
    def x_names(self) -> list[str]:
        """Name and unit of each state."""
        return list(self.prediction.x_names)

    @property
    def u_names(self) -> list[str]:
        """Name and unit of each input."""
        return list(self.prediction.u_names)

    @property
    def simulated(self) -> Scene:
        """Scene of a simulation of the plan's own inputs, from the plan's initial state on, in steps of its nodes.

        The finger comes from the plan's scene, with its object, loads and fidelity. A tip moment acts as it follows the
        planned one by ``input.time_constant``.
        """
        return scene_under(self.scene, self.t, self.u, linear=self.linear_inputs)

    @property
    def n(self) -> int:
        """Number of bending coordinates."""
        return self.prediction.system.n

    def _over_time(self, function: ca.Function, indices: ArrayLike | None = None) -> Array:
        """First output (count, size) of a function of (x, u, p) at nodes."""
        chosen = np.arange(len(self.t)) if indices is None else np.atleast_1d(np.asarray(indices, dtype=int))
        return self._of(function, self.t[chosen], self.x[chosen], self.u[chosen])

    def _of(self, function: ca.Function, t: Array, x: Array, u: Array) -> Array:
        p = parameters_over_time(self.scene, self.prediction, t)
        return np.array(function.map(len(t))(*(ca.DM(v.T) for v in (x, u, p)))).T

    @cached_property
    def tip(self) -> Array:
        """Tip positions (N + 1, 2) [m]."""
        return self._over_time(self.prediction.tip)

    @cached_property
    def tip_path(self) -> Array:
        """Tip positions (8 N + 1, 2), between the nodes too [m]."""
        t = np.linspace(0.0, self.duration, 8 * (len(self.t) - 1) + 1)
        return self._of(self.prediction.tip, t, self.states_at(t), self.inputs_at(t))

    @cached_property
    def bending(self) -> Array:
        """Bending angle of each element (N + 1, elements) [rad]."""
        return self._over_time(self.prediction.bending)

    @cached_property
    def contact_forces(self) -> Array:
        """Normal force at each place where the finger may touch the object (N + 1, places) [N]."""
        if not self.prediction.contact_names:
            return np.zeros((len(self.t), 0))
        return self._over_time(self.prediction.contact_force)

    @cached_property
    def contacts(self) -> ContactHistory | None:
        """Forces at the contacts of the object; None without an object."""
        model = self.prediction
        if not model.system.touch_names:
            return None
        touch = dict(zip(model.system.touch.name_out(), model.system.touch(*model.arguments), strict=True))

        def rows(value: ca.SX) -> Array:
            return self._over_time(ca.Function("touch", [model.x, model.u, model.p], [value]))

        return ContactHistory.from_expressions(tuple(model.system.touch_names), touch, rows)

    def backbone(self, indices: ArrayLike, points: int = 50) -> Array:
        """Backbones (len(indices), points, 2) at some of the nodes [m]."""
        where = self.prediction.sections(tuple(np.linspace(0.0, self.length, points).tolist()))
        model = self.prediction
        # Column by column: x and y of one place after the other.
        flat = ca.Function("places", [model.x, model.u, model.p], [ca.vec(where(model.x, model.u, model.p)[0])])
        return self._over_time(flat, indices).reshape(-1, points, 2)

    def loads_at(self, index: int) -> list[tuple[Array, Array, str]]:
        """Known forces at a node: position (2,) [m], force (2,) [N], and kind."""
        places = self.backbone([index], 101)[0]
        constant = [(load.at / self.length, load.force) for load in self.scene.loads if isinstance(load.force, tuple)]
        return [(places[round(100 * share)], np.array(force), "load") for share, force in constant]

    def inputs_at(self, t: ArrayLike) -> Array:
        """Inputs (len(t), nu) at instants [s]; the last one after the end."""
        instants = np.atleast_1d(np.asarray(t, dtype=float))
        if self.scene.input.form == "linear":
            return np.stack([np.interp(instants, self.t, column) for column in self.u.T], axis=1)
        # A node counts to the interval that it begins, also where rounding put the instant a little before it.
        k = np.searchsorted(self.t, instants * (1 + 1e-12), side="right") - 1
        return np.asarray(self.u[np.clip(k, 0, len(self.u) - 1)])

    def states_at(self, t: ArrayLike) -> Array:
        """States (len(t), nx) at instants [s]; the last one after the end.

        Between the nodes coordinates are cubics that fit their rates there, all else is linear.
        """
        instants = np.clip(np.atleast_1d(np.asarray(t, dtype=float)), self.t[0], self.t[-1])
        states = np.stack([np.interp(instants, self.t, column) for column in self.x.T], axis=1)
        q = self.x[:, : self.n]
        rates = self.x[:, self.n : 2 * self.n]
        states[:, : self.n] = CubicHermiteSpline(self.t, q, rates)(instants)
        return states

    # -- files --------------------------------------------------------------------------------------------------------

    def stored_arrays(self) -> dict[str, Any]:
        """Declared arrays, and the arrays of each constraint."""
        parts = {f"constraint {n} {part}": getattr(c, part) for n, c in self.constraints.items() for part in _PARTS}
        return {**super().stored_arrays(), **parts}

    def details(self) -> dict[str, Any]:
        """Outcome of the search, and results of a fine simulation of the plan."""
        return {
            "message": self.message,
            "advice": self.advice,
            "violated": list(self.violated),
            "objective": self.objective,
            "iterations": self.iterations,
            "times": dict(self.times),
            "deviation": None if self.deviation is None else asdict(self.deviation),
            "finer": None if self.finer is None else asdict(self.finer),
            "constraints": {c.name: {"key": c.key, "unit": c.unit} for c in self.constraints.values()},
            "model": {"x_names": self.x_names, "u_names": self.u_names},
        }

    @classmethod
    def load(cls, folder: str | PathLike[str]) -> MotionPlan:
        """Read a plan from its run folder.

        Raises
        ------
        InputError
            There is no plan in the folder.
        """
        run = cls.read(folder)
        meta, data = run.meta, run.arrays
        constraints = {}
        for name, about in meta["constraints"].items():
            parts = [data[f"constraint {name} {part}"] for part in _PARTS]
            constraints[name] = Constraint(name, about["key"], about["unit"], *parts)
        state = {name.removeprefix("solver "): data[name] for name in data if name.startswith("solver ")}
        deviation, finer = (
            None if entries is None else Deviation(**{**entries, "contact_forces": tuple(entries["contact_forces"])})
            for entries in (meta["deviation"], meta["finer"])
        )
        return cls(
            scene=PlanScene(**meta["config"]),
            status=PlanStatus(meta["status"]),
            constraints=constraints,
            violated=tuple(meta["violated"]),
            deviation=deviation,
            finer=finer,
            warnings=tuple(meta["warnings"]),
            solver_state=state,
            t=data["t"],
            x=data["x"],
            u=data["u"],
            **{name: meta[name] for name in ("message", "advice", "objective", "iterations", "times", "statistics")},
        )


def qualified(message: str, how: str) -> str:
    """A message with what limits it; one sentence has one "but"."""
    return f"{message}; {how}" if ", but " in message else f"{message}, but {how}"


def _listed(forces: ArrayLike) -> str:
    """Write forces [N] in one unit."""
    factor, unit = prefixed("N", float(np.abs(forces).max(initial=0.0)))
    return ", ".join(f"{factor * force:.3g}" for force in np.asarray(forces)) + f" {unit}"
