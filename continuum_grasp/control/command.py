"""What a controller answers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.status import CALL_RATE, Anomaly, Health, Status, Trip, health_text, texts

if TYPE_CHECKING:
    from continuum_grasp.control.controller import Controller

__all__ = ["Command", "Estimate", "Plan", "Times"]

Array = NDArray[np.float64]

_HEALTH = tuple(Health)


class Plan(NamedTuple):
    """States (N + 1, nx) and inputs (N, nu) over the horizon."""

    x: Array
    u: Array


class Estimate(NamedTuple):
    """What the plan starts from.

    Attributes
    ----------
    x : (nx,) ndarray
        State, of the prediction's ``x_names``.
    p : (np,) ndarray
        Parameters with the estimated disturbances.
    std : (nz,) ndarray or None
        Standard deviations of states and disturbances at the time of the measurement; None without an estimator.
    """

    x: Array
    p: Array
    std: Array | None


class Times(NamedTuple):
    """Durations of the phases [s]."""

    estimate: float
    prepare: float
    feedback: float


class Command:
    """What a controller answers.

    Attributes
    ----------
    u : (nu,) ndarray
        Tip moment [N m] or tensions [N] to apply until the next command; finite, within the rate limit, and within the
        limits of the input unless ``Anomaly.BEYOND_LIMIT`` says that one was moved past the last command.
    status : Status
        How the command came about.
    health : Health
        Whether sensors, model and call rate agree; ``suspect`` names what does not, ``health_text`` says it in words.
    """

    __slots__ = ("_control", "_out", "health", "status", "u")

    def __init__(self, control: Controller, status: Status, out: Array) -> None:
        self._control, self._out = control, out
        self.status = status
        self.health = _HEALTH[int(out[5])]
        self.u = out[control._parts["u"]]

    def __repr__(self) -> str:
        odd = f", anomalies={self.anomalies}" if self.anomaly else ""
        health = f", health={self.health.name} ({self.suspect})" if self.health else ""
        return f"Command(u={self.u.tolist()}, status={self.status.name}{health}{odd})"

    def __reduce__(self) -> tuple[Any, ...]:  # without the controller, but for the layout of its numbers
        control = self._control
        stages = SimpleNamespace(nx=control.stages.nx, nu=control.stages.nu, nd=control.stages.nd)
        names = {name: getattr(control, name) for name in ("_parts", "measurement_names", "sensor_names")}
        return Command, (SimpleNamespace(**names, stages=stages), self.status, self._out)

    def _part(self, name: str) -> Array:
        return self._out[self._control._parts[name]]

    @property
    def fallback(self) -> bool:
        """Whether there was no new plan."""
        return self.status.fallback

    @property
    def plan(self) -> Plan:
        """The last plan that was solved; all zero where there is none yet."""
        stages = self._control.stages
        x, u = self._part("plan_x"), self._part("plan_u")
        return Plan(x.reshape(-1, stages.nx), u.reshape(-1, stages.nu))

    @property
    def estimate(self) -> Estimate:
        """State and parameters."""
        variance = self._part("variance")
        std = np.sqrt(np.maximum(variance, 0.0)) if variance.size else None
        return Estimate(self._part("x")[: self._control.stages.nd], self._part("p"), std)

    @property
    def time(self) -> Times:
        """Durations of the phases."""
        return Times(*(1e-9 * self._part("ticks")).tolist())

    @property
    def iterations(self) -> int:
        """Factorisations of the quadratic programme beyond the first."""
        return int(self._out[1])

    @property
    def violation(self) -> float:
        """Largest violation of a soft row, in shares of its bound's scale."""
        return float(self._out[2])

    @property
    def residual(self) -> float:
        """Largest residual of the optimality conditions, relative."""
        return float(self._out[3])

    @property
    def cost(self) -> float:
        """Cost of the quadratic programme at its solution."""
        return float(self._out[4])

    @property
    def suspect(self) -> str | None:
        """What contradicts the model most (tip, tension, bending or call rate), or the reading that is frozen."""
        sensor, entry = int(self._out[6]), int(self._out[7])
        if self.health in (Health.FROZEN, Health.TRIPPED) and entry >= 0:
            return self._control.measurement_names[entry].split(" ")[0]
        names = (*self._control.sensor_names, CALL_RATE)
        return names[sensor] if self.health and 0 <= sensor < len(names) else None

    @property
    def trip(self) -> Trip:
        """Why the controller is tripped."""
        return Trip(int(self._out[8]))

    @property
    def rung(self) -> int:
        """How often the weight of the command's rate is raised fourfold: 0, 1 or 2."""
        return int(self._out[9])

    @property
    def mismatch(self) -> float:
        """Mean squared normalized innovation of the sensor that contradicts the model most; about 1: all is well."""
        return float(self._out[10])

    @property
    def activity(self) -> float:
        """Mean squared change of the command, per that at its rate limit."""
        return float(self._out[11])

    @property
    def health_text(self) -> str:
        """The health in words, with its likely cause; empty for OK."""
        return health_text(self.health, self.suspect, self.trip)

    @property
    def anomaly(self) -> Anomaly:
        """What was noticed."""
        return Anomaly(int(self._out[0]))

    @property
    def anomalies(self) -> tuple[str, ...]:
        """What was noticed, in words; those of measurements begin with their name."""
        return texts(int(self._out[0]), self._part("verdict").tolist(), self._control.measurement_names)

    @property
    def innovation(self) -> tuple[Array, Array]:
        """Measured minus expected of each compared quantity, taken one by one, and its variance (0: not compared)."""
        return self._part("innovation"), self._part("innovation_variance")
