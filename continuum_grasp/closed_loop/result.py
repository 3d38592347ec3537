"""Result of a closed loop."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import Array, amount_text, split_unit
from continuum_grasp.closed_loop.bags import Topics, columns_of_rows, named_topics, write_topics
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.closed_loop.readings import Bound, Metrics, PhaseTimes, Readings, violation_of
from continuum_grasp.closed_loop.tracking import Tracked, amount, missed_setpoints, rms, tracked_groups, tracking_of
from continuum_grasp.control import Adapted, ControlLog, spread
from continuum_grasp.core import CodeKind
from continuum_grasp.results import Dimension, File, MotionResult, Picture, Stored
from continuum_grasp.scene import ControlScene, Scene
from continuum_grasp.simulation import ContactHistory, scene_under


@dataclass(frozen=True)
class ControlRun(MotionResult):
    """A closed loop of K control periods; SI units, world frame. ``stored`` lists its arrays.

    Attributes
    ----------
    anomalies : tuple of tuple of str
        Anomalies of each step in words.
    health : tuple of str
        Whether sensors, model and call rate agreed at each step: ok, mismatch, detuned, frozen or tripped.
    health_texts : tuple of str
        The same in words, with the suspected part and its likely cause; empty for ok.
    adapted : mapping of str to Adapted
        Parameters of ``estimator.adapt`` at the end by name: value, deviation, and whether measurements tell it.
    events : tuple of (float, str)
        Start of each phase of the schedule [s].
    ended : {"finished", "tripped", "stopped"}
        Tripped: it ran its time, but the supervisor sent the command to the safe input.
    """

    kind: ClassVar[str] = "mpc"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("t", "(time,)", "s", "instants at which commands were given, and the end"),
        Stored("x", "(time, state)", "", "states of the plant"),
        Stored("u", "(period, input)", "", "commands"),
        Stored("w", "(time, force_component)", "", "forces on the plant that the controller does not know"),
        Stored("y", "(period, measured)", "", "measurements as they arrived"),
        Stored("estimate", "(period, model_state)", "", "estimated states of the controller's model"),
        Stored("parameters", "(period, parameter)", "", "estimated parameters of the controller's model"),
        Stored("given_parameters", "(period, parameter)", "", "parameters as they were given to it"),
        Stored("std", "(period, estimated)", "", "standard deviations of what ``estimated_names`` says"),
        Stored("contact_force_estimate", "(period, touch)", "N", "estimated normal forces of the finger on the object"),
        Stored("contact_force_std", "(period, touch)", "N", "their standard deviations, by all that is estimated"),
        Stored("r", "(time, setpoint)", "", "setpoints"),
        Stored("tracked", "(time, setpoint)", "", "tracked quantities, on the plant"),
        Stored("tip", "(time, xy)", "m", "tip of the plant, world"),
        Stored("plan_tip", "(period, stage, xy)", "m", "predicted paths of the tip, world"),
        Stored("iterations", "(period,)", "1", "iterations of the solver"),
        Stored("violation", "(period,)", "1", "greatest violation of a soft constraint in each plan"),
        Stored("phase_times", "(period, phase)", "s", "time that each phase of a step took"),
        Stored("mismatch", "(period,)", "1", "mean squared normalized innovation, by which the supervisor judges"),
        Stored("activity", "(period,)", "", "activity of the command, by which the supervisor judges"),
        Stored("bounds", "(bound, time)", "", "amount by which each bound was exceeded on the plant", "excesses"),
        Stored("status", "(period,)", "text", "status of each command"),
        Stored("health", "(period,)", "text", "whether sensors, model and call rate agreed"),
        *ContactHistory.stored,
        Stored("object_pose", "(time, pose)", "", "pose of an object that moves: x, y [m], angle [rad], height [m]"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension.TIME,
        Dimension("period", "instants at which commands were given", "command_times", "s"),
        Dimension("state", "states of the plant", "x_names"),
        Dimension("input", "tendon tensions or tip moment", "u_names"),
        Dimension("force_component", "forces and moments on the plant"),
        Dimension("measured", "measured quantities", "y_names"),
        Dimension("model_state", "states of the controller's model, first among the estimates", "estimated_names"),
        Dimension("parameter", "parameters of the controller's model", "p_names"),
        Dimension("estimated", "estimated quantities: states, then disturbances", "estimated_names"),
        Dimension("touch", "places where the controller's model touches the object", "touch_names"),
        Dimension("setpoint", "what follows setpoints, and inputs that cost no effort", "r_names"),
        Dimension("stage", "nodes of the horizon"),
        Dimension("phase", "phases of a step", "phase_names"),
        Dimension("bound", "bounds", "bound_names"),
        Dimension.XY,
        Dimension.POSE,
        ContactHistory.dimension,
    )
    texts: ClassVar[tuple[File, ...]] = (
        File("report.txt", "continuum_grasp.closed_loop.result:ControlRun.report"),
        File("log.csv", "continuum_grasp.closed_loop.result:log_text"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("path", "continuum_grasp.plotting.control:plot_control_path"),
        Picture("inputs", "continuum_grasp.plotting.control:plot_inputs"),
        Picture("tracking", "continuum_grasp.plotting.control:plot_tracking"),
        Picture("error", "continuum_grasp.plotting.control:plot_tracking_error"),
        Picture("bounds", "continuum_grasp.plotting.control:plot_bounds"),
        Picture("times", "continuum_grasp.plotting.control:plot_controller_times", needs="timed_phases"),
        Picture("disturbances", "continuum_grasp.plotting.control:plot_disturbances", needs="disturbance_names"),
    )
    frames: ClassVar[str] = "continuum_grasp.plotting.control:control_frames"
    page: ClassVar[str] = "loop"

    scene: ControlScene
    readings: Readings = field(repr=False)
    t: Array
    x: Array
    u: Array
    w: Array
    y: Array
    estimate: Array
    parameters: Array
    given_parameters: Array
    std: Array
    contact_force_estimate: Array | None
    contact_force_std: Array | None
    r: Array
    tracked: Array
    tip: Array
    plan_tip: Array
    bounds: tuple[Bound, ...]
    status: tuple[str, ...]
    iterations: NDArray[np.int64]
    violation: Array
    phase_names: tuple[str, ...]
    phase_times: Array
    anomalies: tuple[tuple[str, ...], ...]
    health: tuple[str, ...]
    health_texts: tuple[str, ...]
    mismatch: Array
    activity: Array
    adapted: Mapping[str, Adapted]
    events: tuple[tuple[float, str], ...]
    ended: str
    x_names: tuple[str, ...]
    u_names: tuple[str, ...]
    y_names: tuple[str, ...]
    r_names: tuple[str, ...]
    p_names: tuple[str, ...]
    estimated_names: tuple[str, ...]
    u_min: Array
    u_max: Array
    weights: Array
    period: float
    statistics: Mapping[str, Any]

    @property
    def simulated(self) -> Scene:
        """Scene of a simulation of the recorded commands, in steps of the control period.

        The finger is the controller's, without the differences of the scene's ``plant``, under the scene's loads;
        plants other than the scene's own are not simulated. A tip moment lags behind the command by
        ``controller.input.time_constant``.
        """
        return self.simulated_on(None)

    def simulated_on(self, plant: Scene | None) -> Scene:
        """Scene of a simulation of the recorded commands on a plant; None: the finger that the controller knows."""
        return scene_under(self.scene, self.t, self.u, plant=plant)

    @property
    def outcome(self) -> str:
        """Outcome of the run, or ``missed`` if it finished far from a setpoint; ``status`` belongs to each command."""
        return "missed" if self.ended == "finished" and self.missed else self.ended

    @cached_property
    def missed(self) -> tuple[str, ...]:
        """Quantities that end far from setpoints which stood long enough to be met, in words."""
        return missed_setpoints(self.r_names, self.tracked, self.r, self.t, self.scene.reference, self.scene.finger.rod)

    def pairs(self) -> dict[str, str]:
        """Time, errors of tracked quantities, times of the controller, counts."""
        metrics = self.metrics()
        errors = {
            f"error of the {term.name}": (
                f"{amount_text(term.rms, term.unit)} r.m.s., {amount_text(term.max, term.unit)} at most"
            )
            for term in metrics.tracking[:2]
        }
        total = 1e3 * self.phase_times.sum(axis=1)
        times = f"{np.median(total):.3g} ms in the median, {total.max():.3g} ms at most" if total.size else "none"
        times = times if self.timed_phases else "not measured"
        counts = metrics.pairs()
        return {
            "time": f"{self.t[-1]:g} s in {len(self.u)} periods of {1e3 * self.period:g} ms",
            **errors,
            "time of a step": times,
            **{key: counts[key] for key in ("late", "status", "health") if key in counts},
            **{name: str(value) for name, value in self.adapted.items()},
        }

    @property
    def timed_phases(self) -> tuple[str, ...]:
        """Phases of a step whose times count: none of a controller that was compiled quickly."""
        return () if self.statistics.get("controller_code", "") == CodeKind.QUICK else self.phase_names

    @property
    def code(self) -> str:
        """Code that ran controller and plant, in words."""
        kinds = {part: self.statistics.get(f"{part}_code", "") for part in ("controller", "plant")}
        return ", ".join(f"{part} {kind}" for part, kind in kinds.items() if kind)

    @property
    def command_times(self) -> Array:
        """Instants (K,) of the commands [s]."""
        return self.t[:-1]

    @property
    def bound_names(self) -> tuple[str, ...]:
        """Name and unit of each bound."""
        return tuple(f"{bound.name} [{bound.unit}]" for bound in self.bounds)

    @property
    def deadline(self) -> float:
        """Time after which a command counts as late [s]."""
        return self.scene.controller.deadline or self.period

    @property
    def object_pose(self) -> Array | None:
        """Pose of an object that moves (K + 1, 3 or 4): x, y [m], angle [rad], height [m]; None without one."""
        pose = self.x[:, self.readings.plant.system.object_states]
        return pose if pose.shape[1] else None

    @cached_property
    def contacts(self) -> ContactHistory | None:
        """Gaps and forces of all contacts; None without an object."""
        return self.readings.contacts(self.x, self._inputs, self.w)

    def metrics(self) -> Metrics:
        """Compute tracking error, effort, violations, times and counts."""
        error = self.tracked - self.r
        u = self.u
        names = [split_unit(name).name for name in self.r_names]
        commanded = [split_unit(name).name for name in self.u_names]
        inputs = [names.index(name) for name in commanded if name in names]
        away = error[:-1, inputs] if inputs else u - np.array(self.scene.rest_input)
        held = np.vstack([u[:1], u[:-1]])
        steps = self.phase_times.sum(axis=1) if self.timed_phases else np.zeros(0)
        durations = zip((*self.phase_names, "step"), (*self.phase_times.T, steps), strict=True)
        return Metrics(
            tracking=tuple(tracking_of(group, error) for group in self.tracked_groups),
            cost=float(0.5 * self.period * np.sum(self.weights * error[:-1] ** 2)),
            effort_rms=rms(np.linalg.norm(away, axis=1)),
            rate_rms=rms(np.linalg.norm(u - held, axis=1) / self.period),
            input_unit=split_unit(self.u_names[0]).unit,
            violations=tuple(map(violation_of, self.bounds)),
            times=tuple(PhaseTimes(name, **spread(column)) for name, column in durations) if steps.size else (),
            late=int(np.sum(steps > self.deadline)),
            statuses=dict(Counter(self.status)),
            anomalies=dict(Counter(word for words in self.anomalies for word in words)),
            health=dict(Counter(self.health)),
            mismatch=float(self.mismatch.max(initial=0.0)),
        )

    @property
    def tracked_groups(self) -> tuple[Tracked, ...]:
        """Columns of ``tracked`` and ``r`` that follow setpoints, by cost term."""
        return tracked_groups(self.r_names)

    @cached_property
    def tip_reference(self) -> Array | None:
        """Setpoints of the tip (K + 1, 2) [m]; None where the cost does not track it."""
        if "tip_x [m]" not in self.r_names:
            return None
        k = self.r_names.index("tip_x [m]")
        return self.r[:, k : k + 2]

    @cached_property
    def _disturbed(self) -> list[tuple[int, int]]:
        """Columns in ``parameters`` and in ``std`` of each disturbance."""
        columns = {split_unit(name).name: k for k, name in enumerate(self.p_names)}
        added_to = [_parameter(name) for name in self.estimated_names]
        return [(columns[name], k) for k, name in enumerate(added_to) if name in columns]

    @property
    def touch_names(self) -> tuple[str, ...]:
        """Places where the controller's model touches the object: ``finger.1`` and so on, ``finger.tip``."""
        return () if self.contact_force_std is None else self.scene.contact_names

    @property
    def disturbance_names(self) -> tuple[str, ...]:
        """Name and unit of each estimated disturbance."""
        return tuple(self.estimated_names[k] for _, k in self._disturbed)

    @property
    def disturbance(self) -> Array:
        """Estimated disturbances (K, nd): what parameters are estimated to be beside what they are given as."""
        columns = [column for column, _ in self._disturbed]
        away = self.parameters[:, columns] - self.given_parameters[:, columns]
        for j, name in enumerate(self.disturbance_names):
            # An error of the stiffness is relative; forces and moments add to what was given.
            if name.endswith(_RELATIVE):
                away[:, j] /= self.given_parameters[:, columns[j]]
        return away

    @property
    def disturbance_std(self) -> Array:
        """Standard deviations of the disturbances (K, nd)."""
        return self.std[:, [k for _, k in self._disturbed]]

    @property
    def tripped(self) -> bool:
        """Whether the supervisor sent the command to the safe input."""
        return "tripped" in self.health

    @cached_property
    def incidents(self) -> tuple[tuple[float, str, str], ...]:
        """Time [s], health and text of each change of the health to something that is not ok."""
        incidents = []
        before = "ok"
        for t, health, text in zip(self.t, self.health, self.health_texts, strict=False):
            if health not in (before, "ok"):
                incidents.append((float(t), health, text))
            before = health
        return tuple(incidents)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: incidents, commands that are not the solver's, bends beyond the plant's range."""
        first: dict[str, str] = {}
        for t, health, text in self.incidents:
            first.setdefault(health, f"{health} at {t:.3g} s: {text}")
        warnings = list(first.values())
        odd = {word: n for word, n in self.metrics().statuses.items() if word not in _GOOD}
        if odd:
            counts = ", ".join(f"{n} {word}" for word, n in odd.items())
            warnings.append(f"of {len(self.status)} commands, {counts}")
        warnings += self.missed
        for bound in self.bounds:
            k = int(bound.excess.argmax())
            # 1e-3: share of a bound's scale, of zones the finger's length, by which it is exceeded where there is a
            # warning
            if bound.excess[k] > 1e-3 * bound.scale:
                beyond = f"{bound.name}: exceeded by {amount(bound.excess[k], bound.unit)} at {self.t[k]:.3g} s"
                warnings.append(
                    f"{beyond}; likely cause: a start or a setpoint beyond it, a low penalty, or a finger that differs "
                    "from the model (more clearance, or a tighter bound)"
                )
        use = self._range_use
        if use.max(initial=0.0) > 1.0:
            warnings.append(
                f"the plant is bent to {use.max():.2f} times its bending range, where the model loses accuracy: use "
                "more plant.fidelity.elements"
            )
        return tuple(warnings)

    @cached_property
    def _range_use(self) -> Array:
        """Share of its bending range that each element of the plant uses at each instant (K + 1, elements)."""
        return self.readings.range_use(self.x, self._inputs, self.w)

    def wider_plant(self) -> PlantModel | None:
        """Return the plant's model with ranges that cover its bends; None if they do already, or cannot grow."""
        plant = self.readings.plant
        peaks = self._range_use.max(axis=0, initial=0.0)
        if peaks.max() <= 1.0 or plant.control.plant.guides is not None:
            return None
        ranges = plant.system.finger_model.ranges
        # 1.25: range per bend of a motion that left the range before and is credible up to twice the range
        wider = PlantModel(plant.control, reached=(1.25 * np.minimum(peaks, 2.0) * ranges).tolist())
        return None if wider.system.finger_model.ranges == ranges else wider

    @property
    def _inputs(self) -> Array:
        """Inputs (K + 1, nu) at all instants."""
        return np.vstack([self.u, self.u[-1:]]) if len(self.u) else np.zeros((1, len(self.u_names)))

    def backbone(self, indices: ArrayLike, points: int = 50) -> Array:
        """Backbones (len(indices), points, 2) of the plant at some of the instants [m]."""
        k = np.atleast_1d(np.asarray(indices, dtype=int))
        return self.readings.backbone(self.x[k], self._inputs[k], self.w[k], points)

    @property
    def excesses(self) -> Array:
        """Excess over each bound (bounds, K + 1)."""
        return np.array([bound.excess for bound in self.bounds])

    @property
    def log(self) -> ControlLog:
        """Log of measurements and commands."""
        return ControlLog(self.t[:-1], self.u, self.y, self.u_names, self.y_names, self.scene.name or "run")

    def write_mcap(self, file: str | os.PathLike[str], fingers: Mapping[str, ControlRun] | None = None) -> Path:
        """Write the run as a bag of ROS 2, for Foxglove and Rerun; ``replay`` and ``compare`` read it too.

        Topics are ``/measured``, ``/estimate``, ``/commands``, ``/reference`` and ``/health``, with a message per
        period whose definition is in the file; stamps count from the start of the run.

        Parameters
        ----------
        file : path-like
        fingers : mapping of str to ControlRun, optional
            Runs of all fingers of a mission, instead of this one; names of topics begin with the finger's.

        Returns
        -------
        pathlib.Path

        Raises
        ------
        InputError
            If the libraries for bags are not installed.
        """
        named = {"": self} if fingers is None else {f"/{name}": run for name, run in fingers.items()}
        topics = {topic: columns for prefix, run in named.items() for topic, columns in _topics(run, prefix).items()}
        return write_topics(topics, file)

    def details(self) -> dict[str, Any]:
        """Metrics, events, and the names of all columns; ``status`` is how the run ended."""
        keys = ("x", "u", "y", "r", "p", "estimated", "phase")
        return {
            "status": self.outcome,
            "seed": self.scene.plant.seed,
            "metrics": asdict(self.metrics()),
            "events": [list(event) for event in self.events],
            "incidents": [list(incident) for incident in self.incidents],
            "anomalies": {str(k): list(words) for k, words in enumerate(self.anomalies) if words},
            "adapted": {name: value.as_dict() for name, value in self.adapted.items()},
            "names": {
                **{key: list(getattr(self, f"{key}_names")) for key in keys},
                "bounds": list(self.bound_names),
                "contacts": [] if self.contacts is None else list(self.contacts.names),
            },
        }

    def report(self) -> str:
        """The table as text."""
        metrics = self.metrics()
        time = f"{self.t[-1]:g} s in {len(self.u)} periods of {1e3 * self.period:g} ms"
        pairs = metrics.pairs() | {name: str(value) for name, value in self.adapted.items()}
        pairs |= {"load limit": self.scene.borne_loads} if self.scene.estimator else {}
        pairs |= {"code": self.code}
        head = [self.name or "closed loop", f"{self.outcome}: {time}", ""]
        return "\n".join([*head, *self.aligned(metrics.rows()), "", *self.aligned(list(pairs.items()), (0, 1)), ""])


_GOOD = frozenset(("solved", "iteration_limit", "row_violated"))
"""Statuses of commands that come from the solver."""
_RELATIVE = "_error [1]"


def _parameter(name: str) -> str:
    """The parameter that a disturbance of the estimator adds to, by its name without unit and what tells them apart."""
    return split_unit(name).name.removeprefix("unknown_").removesuffix("_error")


def log_text(run: ControlRun) -> str:
    """Return commands and measurements of a run as CSV; only the headings if it was stopped within two periods."""
    return run.log.text() if len(run.u) > 1 else ""


def _topics(run: ControlRun, prefix: str) -> Topics:
    """Topics of a simulated loop; their names begin with a prefix."""
    t = run.t[:-1]
    nx = run.estimate.shape[1]
    estimate = columns_of_rows("estimated_", run.estimated_names[:nx], run.estimate)
    estimate |= columns_of_rows("estimated_", run.disturbance_names, run.disturbance)
    if run.std.size:
        estimate |= columns_of_rows("std_", run.estimated_names, run.std)
    if run.contact_force_estimate is not None:
        estimate |= columns_of_rows(
            "contact_force_", [f"{name} [N]" for name in run.touch_names], run.contact_force_estimate
        )
    health: dict[str, Sequence[Any] | Array] = {
        "status": run.status,
        "health": run.health,
        "text": run.health_texts,
        "mismatch [1]": run.mismatch,
        "violation [1]": run.violation,
        "iterations [1]": run.iterations.astype(float),
    }
    return named_topics(
        prefix,
        {
            "measured": (t, columns_of_rows("", run.y_names, run.y)),
            "estimate": (t, estimate),
            "commands": (t, columns_of_rows(ControlLog.COMMANDED, run.u_names, run.u)),
            "reference": (t, columns_of_rows("reference_", run.r_names, run.r[:-1])),
            "health": (t, health),
        },
    )
