"""The record of a run that a page plays back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.addons.web.plant import WebPlant
from continuum_grasp.base import Array, InputError
from continuum_grasp.closed_loop import ControlRun
from continuum_grasp.model import System
from continuum_grasp.simulation import Trajectory

_MOST = 1200
"""Most frames of a record."""
_DIGITS = 8
"""Digits of recorded numbers: contacts are stiff, 1e-7 of a length is a force that is seen."""


@dataclass(frozen=True)
class RecordedStates:
    """States of a page's plant over time, as they were recorded."""

    t: list[float]
    """Instants [s]; states, inputs and forces at them follow."""
    x: list[Any]
    u: list[Any]
    w: list[Any]
    z: list[Any] | None = None
    """State from which the controller would start; None without one."""
    known: list[Any] | None = None
    """Parameters of the finger as the controller knows them."""
    changes: Sequence[Any] = ()
    """Weights of setpoints, least and greatest input from instants on: ``t``, ``weights``, ``low`` and ``high``."""
    reference: list[Any] | None = None
    """Setpoints, in rows that are ``dt`` apart."""
    dt: float = 0.0
    """Time between rows of setpoints, and of the inputs and forces that go on from where one takes over [s]."""

    def frames(self) -> dict[str, Any]:
        """Frames that are played back."""
        return {name: getattr(self, name) for name in ("t", "x", "u", "w", "z", "known", "changes")}

    def table(self) -> dict[str, Any]:
        """Inputs and forces in rows of even steps."""
        at = np.arange(0.0, self.t[-1] + self.dt, self.dt)
        return {"dt": self.dt, "u": self._at(self.u, at), "w": self._at(self.w, at)}

    def _at(self, rows: list[Any], at: Array) -> list[Any]:
        columns = [np.interp(at, self.t, column) for column in np.array(rows).T]
        return rounded(np.array(columns).T.reshape(len(at), -1))


def rounded(rows: ArrayLike) -> list[Any]:
    """Numbers that are short in JSON."""
    return [[float(f"{v:.{_DIGITS}g}") for v in row] for row in np.asarray(rows, dtype=float)]


def frames_of(t: Array) -> NDArray[np.intp]:
    """Indices of the instants that are shown."""
    # 1.0 / 60.0: least time between frames of a record [s]; screens show no more
    least = max((1.0 / 60.0), float(t[-1]) / _MOST)
    chosen = [0]
    for k in range(1, len(t)):
        if t[k] - t[chosen[-1]] >= least * (1.0 - 1e-9):
            chosen.append(k)
    if chosen[-1] != len(t) - 1:
        chosen.append(len(t) - 1)
    return np.array(chosen)


def trajectory_record(run: Trajectory, plant: WebPlant) -> RecordedStates:
    known = _columns(run.x_names, run.x)
    if not known.keys() >= set(plant.x_names):
        known = _with_tip(run) | known
    return _record(plant, run.t, known, _columns(run.u_names, run.u), _columns(run.w_names, run.w))


def _with_tip(run: Trajectory) -> dict[str, Array]:
    """Curvature at the tip of matched clothoids, which the models of a page have as a coordinate: its inputs may
    jump.
    """
    finger, options = run.model.structure.asked
    system = System(finger, **options) if run.system is None else run.system
    rows = [np.array(system.curvature(x, u, system.p_nominal)).ravel() for x, u in zip(run.x, run.u, strict=True)]
    columns = {f"kappa_{k}": column for k, column in enumerate(np.array(rows).T)}
    rates = {f"{name}_rate [1/m/s]": np.gradient(column, run.t) for name, column in columns.items()}
    return {f"{name} [1/m]": column for name, column in columns.items()} | rates


def loop_record(run: ControlRun, plant: WebPlant, changes: Sequence[Any] = ()) -> RecordedStates:
    """The record of a closed loop, and what changed of its controller."""
    periods = len(run.u)
    u = np.vstack([run.u, run.u[-1:]])
    z = np.zeros((periods, len(run.estimated_names)))
    z[:, : run.estimate.shape[1]] = run.estimate
    for name, column in zip(run.disturbance_names, run.disturbance.T, strict=True):
        z[:, run.estimated_names.index(name)] = column
    columns = _columns(run.x_names, run.x), _columns(run.u_names, u), _columns(run.readings.plant.w_names, run.w)
    record = _record(plant, run.t, *columns)
    known = run.given_parameters
    chosen = frames_of(run.t)
    at = np.arange(0.0, run.t[-1] + record.dt, record.dt)
    return replace(
        record,
        z=rounded(np.vstack([z, z[-1:]])[chosen]),
        known=rounded(np.vstack([known, known[-1:]])[chosen]),
        reference=rounded(np.array([np.interp(at, run.t, column) for column in run.r.T]).T),
        changes=[_rounded_change(change) for change in changes],
    )


def _rounded_change(change: Mapping[str, Any]) -> dict[str, Any]:
    """A change with rounded numbers, at its exact instant."""
    return {name: value if name == "t" else rounded([value])[0] for name, value in change.items()}


def _columns(names: Any, rows: Array) -> dict[str, Array]:
    return dict(zip(names, rows.T, strict=True))


def _record(plant: WebPlant, t: Array, x: dict[str, Array], u: dict[str, Array], w: dict[str, Array]) -> RecordedStates:
    missing = [name for name in (*plant.x_names, *plant.u_names) if name not in {**x, **u}]
    if missing:
        lacks = ", ".join(missing[:3])
        raise InputError(f"this run lacks states of the page's model ({lacks}): use animate")
    nothing = np.zeros(len(t))
    chosen = frames_of(t)
    forces = [w.get(name, nothing) if k not in plant.hands else nothing for k, name in enumerate(plant.system.w_names)]
    rows = [x[name] for name in plant.x_names], [u[name] for name in plant.u_names], forces
    state, inputs, pushing = (rounded(np.array(of).reshape(len(of), len(t)).T[chosen]) for of in rows)
    step = max(float(np.diff(t).min()), 0.005)
    return RecordedStates([float(f"{v:.7g}") for v in t[chosen]], state, inputs, pushing, dt=step)
