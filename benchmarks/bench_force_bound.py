"""What the sensors of a mission can tell of the held force: the Cramér-Rao bound beside the filter's error.

Run ``python -m benchmarks.bench_force_bound`` in the root of the repository (5 s of one core per plant). The loop's
readings are linearized along the estimates of each plant, about friction coefficient, stiffness, friction states of the
tendons, shape, place of the object and friction at the contacts. The bound is that of R. D. Gill and B. Y. Levit
(doi:10.2307/3318681) with what the scene states as known before; where unknowns wander it is that of P. Tichavsky,
C. H. Muravchik and A. Nehorai (doi:10.1109/78.668800), whose recursion is that of a Kalman filter along the true
motion. A motion of the finger that the model lacks is not in it.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report, Table
from continuum_grasp.control import Estimator
from continuum_grasp.mission.assign import assign
from continuum_grasp.mission.run import MissionRunner
from continuum_grasp.mission.trials import variations
from continuum_grasp.mission.verdict import force_estimate
from continuum_grasp.scene.load import load
from continuum_grasp.scene.mission import MissionScene

Array = NDArray[np.float64]

MISSION = "configs/mission/mug_servo.yaml"
_WANDERS = ("unknown_contact_friction", "object_")
"""Disturbances that change while a plant is held: friction turns out of the plane, and the object is pressed in."""
_KNOWN = {
    "nothing": (),
    "stiffness and friction coefficient": ("bending_stiffness_error", "tendon_friction_error"),
    "friction at the contacts": ("unknown_contact_friction",),
    "place of the object": ("object_",),
}
"""What is taken to be read without noise, by how the names of the estimated begin. None of friction states: that would
read the finger's motion to micrometers."""
_EXACT = 1e-5
"""Standard deviation of such a reading, per that at the start [1]."""


@dataclass(frozen=True)
class Linearized:
    """An estimator's model along a motion of K periods, by the estimated (nz).

    Attributes
    ----------
    names : tuple of str
        Name and unit of each estimated quantity.
    motion : (K, nz, nz) ndarray
        Derivative of the state after a period.
    readings : (K, ny, nz) ndarray
        Derivative of the readings, of variance ``noise`` (ny).
    force : (K, nz) ndarray
        Derivative of the held force [N].
    """

    names: tuple[str, ...]
    motion: Array
    readings: Array
    noise: Array
    force: Array

    def knowing(self, at: list[int], variance: Array) -> Linearized:
        """The same where estimated quantities at these indices are read too, with these variances."""
        rows = np.tile(np.eye(len(self.names))[at], (len(self.motion), 1, 1))
        return replace(self, readings=np.hstack([self.readings, rows]), noise=np.append(self.noise, variance))


def force_std(of: Linearized, initial: Array, wander: Array) -> Array:
    """Compute the Cramér-Rao bound of the held force after each reading, as a standard deviation (K) [N].

    Parameters
    ----------
    of : Linearized
        The readings along the motion.
    initial, wander : (nz,) ndarray
        Variance of each unknown at the start, and by how much it grows in a period; zero for constants.

    Examples
    --------
    An unknown constant that is read four times with a standard deviation of 2:

    >>> import numpy as np
    >>> one = np.ones((4, 1, 1))
    >>> readings = Linearized(("force [N]",), one, one, np.array([4.0]), np.ones((4, 1)))
    >>> force_std(readings, np.array([1e9]), np.array([0.0])).round(3).tolist()
    [2.0, 1.414, 1.155, 1.0]
    """
    covariance, found = np.diag(initial), np.zeros(len(of.motion))
    unit = np.eye(initial.size)
    for k, (motion, readings) in enumerate(zip(of.motion, of.readings, strict=True)):
        if k > 0:
            # At the start of a period, so that its reading shows it: a contact of 2 kN/m that moves by what the object
            # may in a period, 0.2 mm, presses by 0.4 N, of which nothing is seen before the finger has given way.
            covariance = motion @ (covariance + np.diag(wander)) @ motion.T
        for row, variance in zip(readings, of.noise, strict=True):
            # One reading after the other, in the form that keeps the covariance positive (Joseph).
            gain = covariance @ row / (row @ covariance @ row + variance)
            rest = unit - np.outer(gain, row)
            covariance = rest @ covariance @ rest.T + variance * np.outer(gain, gain)
        found[k] = np.sqrt(max(0.0, of.force[k] @ covariance @ of.force[k]))
    return found


def linearized(estimator: Estimator, held: int, measurements: Array, inputs: Array) -> Linearized:
    """Filter the readings (K, ny) under inputs (K, nu) of a run, and linearize the model along the estimates."""
    model, settings = estimator.estimation, estimator.settings
    if model.contact_forces is None:
        raise ValueError("the held force is that of a contact with an object")
    p = ca.DM(estimator.prediction.p_nominal)
    steps = int(settings["substeps"])
    parts: dict[str, list[Array]] = {"motion": [], "readings": [], "force": []}
    before, moved = np.zeros(inputs.shape[1]), np.eye(model.nz)
    estimator.reset()
    for reading, u in zip(measurements, inputs, strict=True):
        found = estimator.step(reading, before)
        parts["motion"].append(moved)
        parts["readings"].append(np.array(model.outputs(found.z, before, p)[1]))
        parts["force"].append(np.array(model.contact_forces(found.z, before, found.p)[1])[held])
        z, moved = ca.DM(found.z), np.eye(model.nz)
        for _ in range(steps):
            z, by, _ = model.step(z, u, p, estimator.period / steps)
            moved = np.array(by) @ moved
        before = u
    arrays: Mapping[str, Any] = {name: np.array(rows) for name, rows in parts.items()}
    return Linearized(names=model.z_names, noise=np.asarray(settings["variance"]), **arrays)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plants", type=int, default=8, help="the first plants that are drawn")
    parser.add_argument("--seed", type=int, default=20263, help="seed of the plants")
    asked = parser.parse_args()
    mission = load(MISSION, [f"trials.seed={asked.seed}", f"trials.count={asked.plants}"])
    if not isinstance(mission, MissionScene):
        raise TypeError(f"{MISSION} is no mission")
    (one,) = assign(mission)
    runner, estimator = MissionRunner([one]), Estimator(one.control)
    held = estimator.prediction.contact_names.index(one.contact)
    start = np.asarray(estimator.settings["initial"])
    drift = np.asarray(estimator.settings["noise"]) * estimator.period
    wanders = np.array([name.startswith(_WANDERS) for name in estimator.names])
    rows, bounds = [], []
    for number, variation in enumerate(variations(mission.trials)):
        run = runner.run(variation)
        span, loop = run.timetable.span("hold"), run.runs[0]
        late = (loop.t[:-1] >= 0.5 * (span.start + span.end)) & (loop.t[:-1] < span.end)
        count = int(np.flatnonzero(late)[-1]) + 1
        readings = linearized(estimator, held, loop.y[:count], loop.u[:count])
        own = []
        for known in _KNOWN.values():
            at = [k for k, name in enumerate(readings.names) if known and name.startswith(known)]
            more = readings.knowing(at, _EXACT**2 * start[at])
            both = (force_std(more, start, drift * share) for share in (wanders, 0.0))
            own += [100.0 * float(found[late[:count]].mean()) / one.force for found in both]
        std = force_estimate(one, loop)[1]
        stated = 100.0 * float(np.mean(std[: len(late)][late])) / one.force
        rows.append([number, 100.0 * run.verdict.force_estimate_error, stated, own[0], own[1]])
        bounds.append(own)
        print(rows[-1], flush=True)
    found = np.array([row[1:] for row in rows])
    report = Report("force_bound", asked.seed)
    columns = ["plant", "error of the estimate [%]", "stated [%]", "bound [%]", "bound, nothing wanders [%]"]
    total = ["all, r.m.s.", *np.sqrt(np.mean(found**2, axis=0))]
    note = "Standard deviations and errors per held force, over the second half of the hold."
    report.tables.append(Table("Held force and its bound", columns, [*rows, total], note))
    means = np.sqrt(np.mean(np.square(bounds), axis=0)).reshape(-1, 2)
    known_rows = [[name, *values] for name, values in zip(_KNOWN, means.tolist(), strict=True)]
    report.tables.append(
        Table("Bound where something is read without noise", ["read", *columns[3:]], known_rows, "R.m.s.")
    )
    for file in report.write():
        print(file)
    print(report.status)


if __name__ == "__main__":
    main()
