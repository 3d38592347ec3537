"""Tracked and bounded quantities, read off the plant itself, and the performance of a closed loop by them."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, split_unit
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.closed_loop.tracking import Tracking, amount
from continuum_grasp.control import BoundedRows, Outputs, Prediction, Stages, stages_of
from continuum_grasp.scene import ControlScene
from continuum_grasp.simulation import ContactHistory

_FINE = 64
"""Number of sections along the backbone that zones check [1]: many times the controller's four per element, to detect
violations between these."""


@dataclass(frozen=True)
class Bound:
    """Excess over a bound (K,), negative within it, in its unit; ``scale`` is a large excess."""

    name: str
    unit: str
    excess: Array = field(repr=False)
    scale: float


class Readings:
    """Values over time of everything that the controller's problem names; bending is per element of its model."""

    def __init__(self, scene: ControlScene, plant: PlantModel, stages: Stages, prediction: Prediction) -> None:
        self._scene = scene
        self._plant = plant
        self._stages = stages
        self._prediction = prediction
        self._numbers = plant.__getstate__()
        self._length = plant.scene.finger.rod.length

    @staticmethod
    def of_scene(scene: ControlScene, plant: PlantModel) -> Readings:
        """Readings of a plant that no controller moves."""
        model = Prediction(scene)
        return Readings(scene, plant, stages_of(scene, model), model)

    @property
    def plant(self) -> PlantModel:
        """The plant of this run; missions give their equations other numbers in every run."""
        p, outside = self._numbers
        if not np.array_equal(self._plant.p, p) or self._plant.outside != outside:
            self._plant = copy(self._plant)
            self._plant.__setstate__(self._numbers)
        return self._plant

    def _rows(self, value: ca.SX, x: Array, u: Array, w: Array) -> Array:
        """Rows (K, size) of an expression of the plant at states, inputs and forces."""
        function = self.plant.function("read", value=value)
        # A map takes and returns columns; a call with several columns has them side by side.
        mapped = function.map(len(x))(x.T, u.T, w.T)
        return np.array(mapped).reshape(-1, len(x), order="F").T

    def tip(self, x: Array, u: Array, w: Array) -> Array:
        """Tip positions (K, 2) [m]."""
        return self._rows(self.plant.tip, x, u, w)

    def backbone(self, x: Array, u: Array, w: Array, points: int) -> Array:
        """Backbones (K, points, 2) [m], evenly spaced from base to tip."""
        return self._sections(np.linspace(0.0, self._length, points), x, u, w)

    def _sections(self, at: Array, x: Array, u: Array, w: Array) -> Array:
        where = self.plant.sections([float(s) for s in at])[0]
        return self._rows(ca.vec(where), x, u, w).reshape(len(x), len(at), 2)

    def range_use(self, x: Array, u: Array, w: Array) -> Array:
        """Share of its bending range that each element of the plant uses (K, elements)."""
        return self._rows(self.plant.range_use, x, u, w)

    def contacts(self, x: Array, u: Array, w: Array) -> ContactHistory | None:
        """Gaps and forces of all contacts; None without an object."""
        plant = self.plant
        if not plant.system.touch_names:
            return None
        names = tuple(plant.system.touch_names)
        return ContactHistory.from_expressions(names, plant.touch, lambda value: self._rows(value, x, u, w))

    # -- what is tracked ----------------------------------------------------------------------------------------------

    def tracked(self, x: Array, u: Array, w: Array, held: Array) -> Array:
        """Outputs (K, nr) in the order of the setpoints; ``held`` (K, nu) are the inputs before."""
        cost = self._scene.controller.cost
        terms = Outputs.of(cost, self._prediction).terms
        plant = self.plant.quantities(self._prediction, u, (u - held) / self._stages.stage)
        of_state = ca.vertcat(*[term.value(plant, cost) for term in terms if term.of_state])
        columns = [self._rows(of_state, x, u, w)]
        # Terms of the input count the commands as given, whatever the drive made of them.
        return np.hstack([*columns, *[term.value(plant, cost) for term in terms if not term.of_state]])

    # -- what is bounded ----------------------------------------------------------------------------------------------

    def bounds(self, x: Array, u: Array, w: Array, held: Array, period: float) -> list[Bound]:
        """By how much each bound is exceeded at K instants; zones themselves, without the clearance asked for."""
        scene = self._scene
        bounds = self._scene.controller.bounds
        unit = split_unit(self._stages.u_names[0]).unit
        beyond = np.maximum(u - self._stages.u_max, self._stages.u_min - u).max(axis=1)
        span = float(np.max(self._stages.u_max - self._stages.u_min))
        exceeded = [Bound("input", unit, beyond, span)]
        limit = scene.controller.input.rate_max
        if limit is not None:
            change = np.abs(u - held).max(axis=1) / period
            exceeded.append(Bound("input rate", f"{unit}/s", change - limit, limit))
        limits, _ = BoundedRows.curvature_limits(bounds, self.plant.system.finger_model)
        if np.all(np.isfinite(limits)):
            kappa = self._rows(self.plant.curvature, x, u, w)
            exceeded.append(Bound("curvature", "1/m", (np.abs(kappa) - limits).max(axis=1), float(limits.min())))
        if bounds.speed is not None:
            rates = self.plant.quantities(self._prediction, u, None).bending_rate()
            limit = bounds.speed
            exceeded.append(Bound("speed", "rad/s", np.abs(self._rows(rates, x, u, w)).max(axis=1) - limit, limit))
        if bounds.keep_out:
            at = np.linspace(0.0, self._length, _FINE + 1)[1:]
            fine = self._sections(at, x, u, w)
            half = self.plant.scene.finger.profile.half_thickness(at)
            for name, zone in bounds.keep_out.items():
                of = slice(None) if zone.of == "backbone" else slice(-1, None)
                # The surface, half a thickness from the backbone, without the clearance that is asked for.
                depth = half[of] - zone.distance(*fine[:, of].transpose(2, 0, 1))
                exceeded.append(Bound(name, "m", depth.max(axis=1), self._length))
        return exceeded


@dataclass(frozen=True)
class BoundExcess:
    """Greatest excess over a bound (negative: the least distance from it), and its duration."""

    name: str
    unit: str
    worst: float
    share: float


@dataclass(frozen=True)
class PhaseTimes:
    """Time that a phase of the controller took, or the whole step [s]."""

    name: str
    median: float
    p99: float
    max: float


@dataclass(frozen=True)
class Metrics:
    """A closed loop in numbers.

    ``tracking`` has the errors per tracked quantity; distances of points are Euclidean, over all of them for sections.
    ``cost`` is the sum of the controller's own running cost over the run of the plant. ``effort_rms`` belongs to the
    deviation of the input from the setpoint of effort, or else from its least value [N or N m], ``rate_rms`` to its
    rate [N/s or N m/s]. ``late`` counts steps that took longer than the deadline; ``mismatch`` is the greatest mean
    squared normalized innovation of a sensor, about 1 if sensors and model agree.
    """

    tracking: tuple[Tracking, ...]
    cost: float
    effort_rms: float
    rate_rms: float
    input_unit: str
    violations: tuple[BoundExcess, ...]
    times: tuple[PhaseTimes, ...]
    late: int
    statuses: dict[str, int]
    anomalies: dict[str, int]
    health: dict[str, int]
    mismatch: float

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Return a table of four columns: the quantity, and three values with their units."""
        rows = [("tracking error", "r.m.s.", "max", "final")]
        rows += [(t.name, amount(t.rms, t.unit), amount(t.max, t.unit), amount(t.final, t.unit)) for t in self.tracking]
        rows.append(("bound", "worst", "exceeded", ""))
        rows += [(v.name, amount(v.worst, v.unit), f"{100 * v.share:.1f} %", "") for v in self.violations]
        return rows + self.time_rows()

    def time_rows(self) -> list[tuple[str, str, str, str]]:
        """Return the rows of this table with the times of the phases of a step and of the whole step."""
        rows = [(t.name, amount(t.median, "s"), amount(t.p99, "s"), amount(t.max, "s")) for t in self.times]
        return [("time", "median", "99 %", "max"), *rows] if rows else []

    def pairs(self) -> dict[str, str]:
        """Single values by name."""
        counts = {"status": self.statuses, "anomalies": self.anomalies, "health": self.health}
        words = {k: ", ".join(f"{n} {name}" for name, n in v.items()) or "none" for k, v in counts.items()}
        return {
            "closed-loop cost": f"{self.cost:.6g}",
            "effort": f"{amount(self.effort_rms, self.input_unit)} r.m.s.",
            "input rate": f"{amount(self.rate_rms, self.input_unit + '/s')} r.m.s.",
            "late": f"{self.late}" if self.times else "not measured",
            **words,
            "mismatch": f"{self.mismatch:.2g} at most",
        }


def violation_of(bound: Bound) -> BoundExcess:
    """Evaluate a bound; what exceeds it by rounding alone does not count."""
    worst = float(bound.excess.max())
    rounding = 1e-9 * max(1.0, float(np.abs(bound.excess).max()))
    return BoundExcess(bound.name, bound.unit, worst, float(np.mean(bound.excess > rounding)))
