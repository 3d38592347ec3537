"""What a closed loop is to do, phase by phase, and what happens in it until it becomes a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.plant import Plant
from continuum_grasp.closed_loop.readings import Readings
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.status import Health
from continuum_grasp.errors import InputError
from continuum_grasp.scene.control import ControlScene

Array = NDArray[np.float64]

_CHECKED = 50
"""Periods that are integrated again with steps half as long [1]; their cost does not grow with the run."""


class Record:
    """Keeps every step."""

    def __init__(
        self, scene: ControlScene, stages: Stages, model: Prediction, plant: Plant, schedule: Schedule
    ) -> None:
        self._scene, self._stages, self._model, self._plant = scene, stages, model, plant
        self._schedule = schedule
        self._states = [plant.x]
        self._start = plant.t
        self._measured: list[Array] = []
        self._references: list[Array] = []
        self._commands: list[Any] = []
        self._parameters: list[Array] = []
        self.made_s = 0.0

    def add(self, measured: Array, reference: Array, p: Array | None, command: Any, state: Array) -> None:
        """Keep one step: measurement, setpoints and parameters at its begin, the command, the state at its end."""
        self._parameters.append(self._stages.p_nominal if p is None else p)
        self._measured.append(measured)
        self._references.append(reference)
        self._commands.append(command)
        self._states.append(state)

    def run(self, status: str, statistics: dict[str, Any], estimated_names: tuple[str, ...] = ()) -> ControlRun:
        """The result so far."""
        plant, model, stages, count = self._plant, self._model, self._stages, len(self._commands)
        commands = self._commands
        t = np.asarray(self._start + plant.period * np.arange(count + 1), dtype=float)
        x = np.array(self._states[: count + 1])
        u = np.array([c.u for c in commands]).reshape(count, stages.nu)
        rest = plant.model.rest_input
        held = np.vstack([rest, u])
        last = np.vstack([u, u[-1:] if count else rest])
        w = plant.model.forces(t)
        readings = Readings(self._scene, plant.model, stages, model)
        references = np.array([*self._references, self._schedule.rows(t[-1:])[0]])
        phases = tuple(commands[0].time._fields) if count else ()
        health = tuple(_word(getattr(c, "health", Health.OK)) for c in commands)
        return ControlRun(
            scene=self._scene,
            readings=readings,
            t=t,
            x=x,
            u=u,
            w=w,
            y=np.array(self._measured).reshape(count, len(plant.sensors.names)),
            estimate=_stack([c.estimate.x for c in commands], count),
            parameters=_stack([c.estimate.p for c in commands], count),
            given_parameters=_stack(self._parameters[:count], count),
            std=_stack([() if c.estimate.std is None else c.estimate.std for c in commands], count),
            r=references,
            tracked=readings.tracked(x, last, w, held),
            tip=readings.tip(x, last, w),
            plan_tip=self._planned_tips(),
            bounds=tuple(readings.bounds(x, last, w, held, plant.period)),
            status=tuple(_word(c.status) for c in commands),
            iterations=np.array([c.iterations for c in commands], dtype=np.int64),
            violation=np.array([c.violation for c in commands], dtype=float),
            phase_names=phases,
            phase_times=_stack([c.time for c in commands], count),
            anomalies=tuple(tuple(_word(a) for a in c.anomalies) for c in commands),
            health=health,
            health_texts=tuple(getattr(c, "health_text", "") for c in commands),
            mismatch=np.array([getattr(c, "mismatch", 0.0) for c in commands], dtype=float),
            activity=np.array([getattr(c, "activity", 0.0) for c in commands], dtype=float),
            events=tuple(self._schedule.events),
            ended="tripped" if status == "finished" and "tripped" in health else status,
            x_names=plant.model.x_names,
            u_names=stages.u_names,
            y_names=plant.sensors.names,
            r_names=stages.r_names,
            p_names=stages.p_names,
            estimated_names=estimated_names,
            u_min=stages.u_min,
            u_max=stages.u_max,
            weights=stages.weights,
            period=plant.period,
            statistics={
                "plant_method": plant.method.name,
                "plant_substeps": plant.method.substeps,
                "plant_fastest_rate": plant.method.radius,
                "plant_compiled": plant.compiled,
                "plant_error_m": self._plant_error(x, u, t, readings),
                "made_s": self.made_s,
                "controller": dict(statistics),
            },
        )

    def _planned_tips(self) -> Array:
        """Predicted tip paths (K, N + 1, 2) [m]."""
        nodes, model = self._stages.stages + 1, self._model
        if not self._commands:
            return np.zeros((0, nodes, 2))
        plans = np.concatenate([c.plan.x[:, : model.nx] for c in self._commands])
        inputs = np.concatenate([np.vstack([c.plan.u, c.plan.u[-1:]]) for c in self._commands])
        p = np.repeat([c.estimate.p for c in self._commands], nodes, axis=0)
        points = np.array(model.tip.map(len(plans))(plans.T, inputs.T, p.T)).T
        return points.reshape(-1, nodes, 2)

    def _plant_error(self, x: Array, u: Array, t: Array, readings: Readings) -> float:
        """Greatest change of the tip over single periods when the plant takes half as long steps [m]."""
        if not len(u):
            return 0.0
        chosen = np.unique(np.linspace(0, len(u) - 1, min(len(u), _CHECKED)).astype(int))
        finer = np.array([self._plant.replayed(x[k], u[k], float(t[k])) for k in chosen])
        after = chosen + 1
        w = self._plant.model.forces(t[after])
        moved = readings.tip(finer, u[chosen], w) - readings.tip(x[after], u[chosen], w)
        return float(np.linalg.norm(moved, axis=1).max())


def _stack(rows: list[Any], count: int) -> Array:
    return np.array(rows, dtype=float).reshape(count, -1) if count else np.zeros((0, 0))


def _word(status: Any) -> str:
    """A status by its name."""
    return status.name.lower() if isinstance(status, Enum) else str(status)


@dataclass(frozen=True)
class Moment:
    """What is known at an instant of a closed loop: time since the phase began [s], plant, last command."""

    t: float
    plant: Any
    command: Any


@dataclass(frozen=True)
class Phase:
    """A part of a closed loop with its own setpoints.

    Attributes
    ----------
    name : str
    rows : callable
        Setpoints (T, nr) at instants (T,) since the phase began [s].
    duration : float
        Longest time [s].
    until : callable, optional
        Says whether the phase is over before that; while it is open, the horizon sees this phase go on.
    p : (np,) ndarray, optional
        Parameters of the controller in this phase; nominal where not given.
    begin : callable, optional
        Called with controller and plant when the phase begins: to change weights, to let something go.
    """

    name: str
    rows: Callable[[Array], Array]
    duration: float = math.inf
    until: Callable[[Moment], bool] | None = None
    p: Array | None = None
    begin: Callable[[Any, Any], None] | None = None


@dataclass
class Schedule:
    """Phases one after the other.

    Attributes
    ----------
    phases : sequence of Phase
    current : int
        Index of the present phase.
    start : float
        When it began [s].
    events : list of (float, str)
        When each phase began.
    """

    phases: Sequence[Phase]
    current: int = 0
    start: float = 0.0
    events: list[tuple[float, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.phases:
            raise InputError("a closed loop needs one phase at least", key="schedule")

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self.phases[self.current]

    @property
    def duration(self) -> float:
        """Longest time of all phases [s]."""
        return sum(phase.duration for phase in self.phases)

    def enter(self, t: float, controller: Any, plant: Any) -> None:
        """Begin the first phase."""
        self.current, self.start = 0, t
        self._begin(controller, plant)

    def advance(self, t: float, controller: Any, plant: Any, command: Any) -> bool:
        """Go on to the next phase where the present one is over; False after the last."""
        phase = self.phase
        since = t - self.start
        over = since > phase.duration * (1 - 1e-9) - 1e-9
        if not over and phase.until is not None:
            over = phase.until(Moment(since, plant, command))
        if not over:
            return True
        if self.current + 1 == len(self.phases):
            return False
        self.current, self.start = self.current + 1, t
        self._begin(controller, plant)
        return True

    def _begin(self, controller: Any, plant: Any) -> None:
        if len(self.phases) > 1:
            self.events.append((self.start, self.phase.name))
        if self.phase.begin is not None:
            self.phase.begin(controller, plant)

    def rows(self, t: Array) -> Array:
        """Setpoints (T, nr) as they are foreseen now at instants (T,) [s]."""
        k, start = self.current, self.start
        found = self.phases[k].rows(t - start)
        while self.phases[k].until is None and k + 1 < len(self.phases):
            start, k = start + self.phases[k].duration, k + 1
            later = t >= start - 1e-9
            if not np.any(later):
                break
            found[later] = self.phases[k].rows(t[later] - start)
        return found
