"""What a closed loop gave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.closed_loop.metrics import Metrics, metrics_of
from continuum_grasp.closed_loop.readings import Bound, Readings
from continuum_grasp.control.ocp.cost_terms import Tracked, tracked_groups
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.simulation.contacts import ContactForces

__all__ = ["ControlRun"]

Array = NDArray[np.float64]

_ARRAYS = (
    "t",
    "x",
    "u",
    "w",
    "y",
    "estimate",
    "parameters",
    "given_parameters",
    "std",
    "r",
    "tracked",
    "tip",
    "plan_tip",
    "iterations",
    "violation",
    "phase_times",
    "mismatch",
    "activity",
)


@dataclass(frozen=True)
class ControlRun:
    """A closed loop of K control periods; SI units, world frame.

    Attributes
    ----------
    t : (K + 1,) ndarray
        Instants at which commands were given, and the end [s].
    x : (K + 1, nx) ndarray
        States of the plant.
    u : (K, nu) ndarray
        Commands.
    w : (K + 1, nw) ndarray
        Forces on the plant that the controller does not know.
    y : (K, ny) ndarray
        Measurements as they arrived.
    estimate, parameters : ndarray
        Estimated state (K, nx) and parameters (K, np) of the controller's model.
    given_parameters : (K, np) ndarray
        Parameters as they were given to it.
    std : ndarray
        Standard deviations (K, nz) of what ``estimated_names`` says.
    r, tracked : (K + 1, nr) ndarray
        Set-points, and what they are for, on the plant.
    tip : (K + 1, 2) ndarray
        Tip of the plant [m].
    plan_tip : (K, N + 1, 2) ndarray
        Tip paths that were predicted [m].
    bounds : tuple of Bound
        Amount by which each bound was exceeded on the plant (K + 1).
    status : tuple of str
        Of each command.
    iterations : (K,) ndarray
    violation : (K,) ndarray
        Greatest violation of a soft row in each plan.
    phase_names : tuple of str
    phase_times : (K, phases) ndarray
        Time that each phase of a step took [s].
    anomalies : tuple of tuple of str
        What was odd at each step.
    health : tuple of str
        Whether sensors, model and call rate agreed at each step: ok, mismatch, detuned, frozen or tripped.
    health_texts : tuple of str
        The same in words, with what is suspected and its likely cause; empty for ok.
    mismatch, activity : (K,) ndarray
        Means by which the supervisor judges; see ``Command``.
    events : tuple of (float, str)
        When each phase of the schedule began [s].
    ended : {"finished", "tripped", "stopped"}
        Tripped: it ran its time, but the supervisor sent the command to the safe input.
    """

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

    def __repr__(self) -> str:
        return f"ControlRun({self.ended}: {self.t[-1]:g} s in {len(self.u)} periods, tip at {self.tip[-1].tolist()} m)"

    @property
    def name(self) -> str | None:
        """Name of the scene."""
        return self.scene.name

    @property
    def length(self) -> float:
        """Length of the finger [m]."""
        return self.scene.finger.rod.length

    @property
    def deadline(self) -> float:
        """Time after which a command counts as late [s]."""
        return self.scene.controller.deadline or self.period

    @property
    def object_pose(self) -> Array | None:
        """Pose of an object that moves (K + 1, 3 or 4): x, y [m], angle [rad], height [m]; None without one."""
        return self.readings.object_pose(self.x)

    @cached_property
    def contacts(self) -> ContactForces | None:
        """Gaps and forces of all contacts; None without an object."""
        return self.readings.contacts(self.x, self._inputs, self.w)

    @cached_property
    def _metrics(self) -> Metrics:
        return metrics_of(self)

    def metrics(self) -> Metrics:
        """Tracking error, effort, violations, times and counts."""
        return self._metrics

    @property
    def tracked_groups(self) -> tuple[Tracked, ...]:
        """Columns of ``tracked`` and ``r`` that follow setpoints, by cost term."""
        return tracked_groups(self.r_names)

    @cached_property
    def tip_reference(self) -> Array | None:
        """Set-points of the tip (K + 1, 2) [m]; None where the cost does not track it."""
        if "tip_x [m]" not in self.r_names:
            return None
        k = self.r_names.index("tip_x [m]")
        return self.r[:, k : k + 2]

    @cached_property
    def _disturbed(self) -> list[tuple[int, int]]:
        """Columns in ``parameters`` and in ``std`` of each disturbance."""
        plain = {name: _parameter(name) for name in self.estimated_names}
        columns = {name: k for k, name in enumerate(self.p_names)}
        named = [(columns.get(plain[name]), k) for k, name in enumerate(self.estimated_names)]
        return [(column, k) for column, k in named if column is not None]

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
            if name.endswith(_RELATIVE):
                away[:, j] /= self.given_parameters[:, columns[j]]
        return away

    @property
    def disturbance_std(self) -> Array:
        """Their standard deviations (K, nd)."""
        return self.std[:, [k for _, k in self._disturbed]]

    @property
    def tripped(self) -> bool:
        """Whether the supervisor sent the command to the safe input."""
        return "tripped" in self.health

    @cached_property
    def incidents(self) -> tuple[tuple[float, str, str], ...]:
        """Time [s], health and text of each change of the health to something that is not ok."""
        found, before = [], "ok"
        for t, health, text in zip(self.t, self.health, self.health_texts, strict=False):
            if health not in (before, "ok"):
                found.append((float(t), health, text))
            before = health
        return tuple(found)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user must know: incidents, commands that are not the solver's, bends beyond the plant's range."""
        worst: dict[str, tuple[float, str]] = {}
        for t, health, text in self.incidents:
            worst.setdefault(health, (t, text))
        found = [f"{health} at {t:.3g} s: {text}" for health, (t, text) in worst.items()]
        odd = {word: n for word, n in self.metrics().statuses.items() if word not in _GOOD}
        if odd:
            told = ", ".join(f"{n} {word}" for word, n in odd.items())
            found.append(f"of {len(self.status)} commands, {told}")
        use = self.readings.range_use(self.x, self._inputs, self.w)
        if use.max(initial=0.0) > 1.0:
            found.append(
                f"the plant is bent to {use.max():.2f} times its declared range, where its model loses accuracy: raise "
                "plant.fidelity.bending_range"
            )
        return tuple(found)

    @property
    def _inputs(self) -> Array:
        """Inputs (K + 1, nu) at all instants."""
        return np.vstack([self.u, self.u[-1:]]) if len(self.u) else np.zeros((1, len(self.u_names)))

    def backbone(self, indices: ArrayLike, points: int = 50) -> Array:
        """Backbones (len(indices), points, 2) of the plant at some of the instants [m]."""
        k = np.atleast_1d(np.asarray(indices, dtype=int))
        return self.readings.backbone(self.x[k], self._inputs[k], self.w[k], points)

    def save(
        self,
        folder: str | Path,
        *,
        arrays: Mapping[str, ArrayLike] | None = None,
        meta: Mapping[str, Any] | None = None,
    ) -> Path:
        """Write ``result.npz``, ``meta.json`` and ``report.txt`` into a folder, each whole or not at all.

        Parameters
        ----------
        folder : path-like
        arrays, meta : mapping, optional
            More that is to stand in the two files.

        Returns
        -------
        pathlib.Path
            The folder.
        """
        from continuum_grasp.results import replacing, write_run

        stored = {name: getattr(self, name) for name in _ARRAYS}
        stored |= {"bounds": np.array([b.excess for b in self.bounds]), "status": np.array(self.status, dtype=str)}
        stored["health"] = np.array(self.health, dtype=str)
        if self.contacts is not None:
            stored |= self.contacts.arrays()
        if self.object_pose is not None:
            stored["object_pose"] = self.object_pose
        told = {
            "kind": "mpc",
            "config": self.scene.model_dump(mode="json"),
            "status": self.ended,
            "seed": self.scene.plant.seed,
            "warnings": list(self.warnings),
            "metrics": asdict(self.metrics()),
            "statistics": dict(self.statistics),
            "events": [list(event) for event in self.events],
            "incidents": [list(incident) for incident in self.incidents],
            "anomalies": {str(k): list(words) for k, words in enumerate(self.anomalies) if words},
            "names": {
                **{key: list(getattr(self, f"{key}_names")) for key in ("x", "u", "y", "r", "p", "estimated", "phase")},
                "bounds": [f"{b.name} [{b.unit}]" for b in self.bounds],
                "contacts": [] if self.contacts is None else list(self.contacts.names),
            },
        }
        target = write_run(folder, {**stored, **(arrays or {})}, {**told, **(meta or {})})
        with replacing(target / "report.txt") as temporary:
            temporary.write_text(self.report(), encoding="utf-8")
        return target

    def report(self) -> str:
        """The table as text."""
        found = self.metrics()
        lines = [self.name or "closed loop", f"{self.ended}: {self.t[-1]:g} s in {len(self.u)} periods", ""]
        rows = found.rows()
        widths = [max(len(row[k]) for row in rows) for k in range(4)]
        lines += ["  ".join([row[0].ljust(widths[0]), *(row[k].rjust(widths[k]) for k in (1, 2, 3))]) for row in rows]
        pairs = found.pairs()
        wide = max(map(len, pairs))
        return "\n".join([*lines, "", *(f"{key:<{wide}}  {value}" for key, value in pairs.items())]) + "\n"

    def plot(self, folder: str | Path) -> list[Path]:
        """Draw tip path, inputs, tracking error, bounds and times into a folder."""
        from continuum_grasp.plotting.control.control import save_control_pictures

        return save_control_pictures(self, Path(folder))

    def animate(self, path: str | Path, fps: int = 30) -> Path:
        """Write an animation of the plant with the predicted tip paths, GIF or MP4 by the suffix."""
        from continuum_grasp.plotting.control.frames import animate_control

        return animate_control(self, Path(path), fps)


_GOOD = frozenset(("solved", "iteration_limit", "row_violated"))
"""Statuses of commands that come from the solver."""
_RELATIVE = "_error [1]"


def _parameter(name: str) -> str:
    """The parameter that a disturbance of the estimator adds to, by its name without what tells them apart."""
    if name.endswith(_RELATIVE):
        return f"{name.removesuffix(_RELATIVE)} [N m2]"
    return name.removeprefix("unknown_")
