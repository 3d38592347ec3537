"""Errors from setpoints: how far tracked quantities are from them, and which setpoints are missed at the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.control import Outputs
from continuum_grasp.scene import Reference, Rod

FINAL = 0.1
"""Last share of the run over which the final error is averaged: noise averages out, and a step has settled."""
_OFF = 0.05
"""Greatest error at the end of a setpoint that is met, per length of the finger [1]. For angles, twice this value
[rad], which moves the tip as far; for forces, twice this share of the greatest required one, as for weighted goals of
plans."""
_NEARING = 0.95
"""Share of its distance a tenth of the time before up to which a value off its setpoint still moves [1]: noise of a tip
stays moves means over a tenth by less."""


class Tracked(NamedTuple):
    """Columns of what a controller tracks that belong to one term; of points, x and y alternate."""

    label: str
    unit: str
    columns: tuple[int, ...]
    of_points: bool
    reference: str


def tracked_groups(names: Sequence[str]) -> tuple[Tracked, ...]:
    """Outputs of a controller that follow setpoints (name and unit each); terms of the input are left out."""
    return tuple(
        Tracked(term.label, term.entry.split("[")[1][:-1], columns, term.of_points, term.reference)
        for term, columns in Outputs.followed(names)
    )


@dataclass(frozen=True)
class Tracking:
    """Distance from the setpoints: root of the mean square, greatest, and the mean's over the last tenth."""

    name: str
    unit: str
    rms: float
    max: float
    final: float


def tracking_of(group: Tracked, error: Array) -> Tracking:
    """Evaluate the errors of one tracked quantity (K + 1, nr)."""
    errors = error[:, group.columns]
    last = errors[-max(1, round(FINAL * len(errors))) :].mean(axis=0)
    # A point's error is the length of its vector; other quantities are scalars, points of one dimension.
    size = 2 if group.of_points else 1
    sizes = np.linalg.norm(errors.reshape(len(errors), -1, size), axis=2)
    final = np.linalg.norm(last.reshape(-1, size), axis=1).max()
    return Tracking(group.label, group.unit, rms(sizes), float(sizes.max()), float(final))


def missed_setpoints(
    names: Sequence[str], tracked: Array, r: Array, t: Array, reference: Reference, rod: Rod
) -> tuple[str, ...]:
    """Say what ends how far from setpoints r (K + 1, nr) which stood long enough to be met, by names of columns."""
    messages = []
    for group in tracked_groups(names):
        rows = r[:, group.columns]
        off = tracking_of(group, tracked - r).final
        others = np.flatnonzero((rows != rows[-1]).any(axis=1))
        stood = t[-1] - t[others[-1] + 1 if others.size else 0]
        # Zeros that are not stated are a default, and no aim.
        aim = rows.any() or getattr(reference, group.reference) is not None
        # By the greatest force that the reference asks for over the run: a tenth of what bends the finger may be all of
        # it. One of zeros asks that nothing presses.
        force = float(np.abs(rows).max()) or rod.least_force
        limit = {"m": _OFF * rod.length, "rad": 2.0 * _OFF, "N": 2.0 * _OFF * force}[group.unit]
        # Instants are sums of rounded periods.
        if aim and off > limit and stood >= max(rod.slow_time, FINAL * t[-1]) * (1.0 - 1e-9):
            earlier = tracking_of(group, (tracked - r[-1])[: -max(1, round(FINAL * len(r)))]).final
            cause = (
                "it is still on its way, and needs more time or less damping"
                if off < _NEARING * earlier
                else "no input within its bounds holds a posture there, something is in the way, the finger "
                "differs from the model (estimator.disturbances finds by how much), or tendons "
                "are slack, so that commands have no effect (give drive.pretension)"
            )
            messages.append(
                f"{group.label}: {amount(off, group.unit)} off a setpoint that stood; likely cause: {cause}"
            )
    return tuple(messages)


def rms(values: Array) -> float:
    """Root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def amount(value: float, unit: str) -> str:
    """Format a value with a unit that people read."""
    times = (1e3, "ms") if abs(value) >= 1e-3 else (1e6, "us")
    factor, word = {"m": (1e3, "mm"), "s": times}.get(unit, (1.0, unit))
    return f"{value * factor:.3g} {word}".strip()
