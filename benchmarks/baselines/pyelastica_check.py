"""PyElastica's Cosserat rod against our reference, extrapolated to endless elements and no thickness."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.baselines.release_ours import rms_error
from benchmarks.baselines.release_peers import PeerRun, ReleasePeers
from benchmarks.report import Table
from continuum_grasp.accuracy.motion import Motion

ELEMENTS = (20, 40, 80)
THICKNESS = 5.0
TITLE = "PyElastica against our reference"
COLUMNS = ["", "steps per s", "r.m.s. error [mm]"]
SHOWN = 20
"""Elements of the rod whose speed is measured."""
_SHORT = 1e-3
"""Span over which the true section's steps are timed [s]."""


def check(peers: ReleasePeers, rod: Mapping[str, Any], reference: Motion) -> tuple[Table, str, PeerRun]:
    """Errors of PyElastica's rods, and what remains after extrapolation.

    Returns
    -------
    Table
    str, PeerRun
        Name under which the rod that is timed was made, and its motion.
    """
    rows: list[list[Any]] = []

    def make(elements: int, thickness: float, shifted: bool = True) -> tuple[str, PeerRun]:
        name = f"PyElastica {elements} elements, section {thickness:g} times as thick"
        name += "" if shifted else ", clamp as it is"
        settings = {"elements": elements, "thickness": thickness, "shifted": shifted}
        run = peers.make(name, "pyelastica", rod, settings)
        rows.append([name, run.steps, 1e3 * rms_error(run.tip, reference)])
        return name, run

    def add(name: str, tip: np.ndarray) -> None:
        rows.append([name, None, 1e3 * rms_error(tip, reference)])

    if not rod["uniform"]:  # the reference is checked by the uniform rod
        shown = make(SHOWN, THICKNESS)
        make(2 * SHOWN, THICKNESS)
        return Table(TITLE, COLUMNS, rows), *shown
    _, raw = make(SHOWN, THICKNESS, shifted=False)
    made = {n: make(n, THICKNESS) for n in ELEMENTS}
    _, thin = make(SHOWN, 0.5 * THICKNESS)
    tips = {n: run.tip for n, (_, run) in made.items()}
    limit = _to_zero([1.0 / (n - 0.5) ** 2 for n in ELEMENTS], [tips[n] for n in ELEMENTS])
    add(f"extrapolated over {', '.join(map(str, ELEMENTS))} elements", limit)
    add("and to no thickness", limit + (thin.tip - tips[SHOWN]) * 4.0 / 3.0)
    true = peers.make("true section", "pyelastica", rod, {"elements": SHOWN, "thickness": 1.0}, frames=0)
    times = []
    for _ in range(3):
        began = time.perf_counter()
        peers.run("true section", _SHORT)
        times.append(time.perf_counter() - began)
    note = (
        f"Clamp as it is: node 0 and element 0 are held, so that the first half element does not bend, which costs "
        f"{1e3 * rms_error(raw.tip, reference):.3g} mm with {SHOWN} elements; elsewhere the clamp is put half an "
        f"element behind the wall. With the true section the stable step is 1/{true.steps} s, and {SHOWN} elements "
        f"run at {_SHORT / min(times):.2g} times real time (timed over {1e3 * _SHORT:g} ms)."
    )
    return Table(TITLE, COLUMNS, rows, note), *made[SHOWN]


def _to_zero(at: list[float], values: list[np.ndarray]) -> np.ndarray:
    """Value at zero of the polynomial through some values."""
    total = np.zeros_like(values[0])
    for k, value in enumerate(values):
        weight = np.prod([other / (other - at[k]) for j, other in enumerate(at) if j != k])
        total = total + weight * value
    return total
