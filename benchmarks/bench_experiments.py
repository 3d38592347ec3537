"""Proposed experiments against an even spread of twice as many, on fingers that the design did not know.

A finger under its own weight carries one of five weights at its tip, is pulled by two tendons and turned by its
clamp. Unknown are stiffness, linear density, clamp angle and where the tendons run. The even spread goes through the
choices of every condition in turn, as one would without a design. Every trial is another finger, up to a quarter off in
each number, with other noise of 0.5 mm; ``covered`` is the share of 95 % intervals of `identify` that hold the truth.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import continuum_grasp as cg
from benchmarks.report import begun
from continuum_grasp.addons.identification import Poses, Reading, design_experiments
from continuum_grasp.addons.identification.scene import IdentifyScene

_SIGMA = 5e-4
"""Noise of a camera [m]."""
_NAMES = ("bending_stiffness", "linear_density", "clamp_angle", "tendon_offset")
_CHOICES: dict[str, list[float]] = {
    "load_1_y": [0.0, -0.05, -0.1, -0.15, -0.2],
    "tension_1": [1.0, 4.0, 8.0, 12.0],
    "tension_2": [1.0, 4.0, 8.0, 12.0],
    "base_angle": [-1.2, -0.6, 0.0, 0.6, 1.2],
}
"""Weights [N], tensions [N] and angles of the base [rad] that there are."""


def scene(rows: int) -> IdentifyScene:
    """The finger as it is assumed."""
    conditions = [{"name": name, "column": name, "choices": values} for name, values in _CHOICES.items()]
    measured = [{"quantity": axis, "column": axis, "sigma": _SIGMA} for axis in "xy"]
    return IdentifyScene(
        finger={
            "rod": {"length": 0.2, "linear_density": 0.05, "bending_stiffness": 0.006},
            "tendons": {"offset": 0.005, "max_tension": 20.0},
        },
        gravity=(0.0, -9.81),
        loads=[{"kind": "force", "at": 0.2, "force": (0.0, 0.0)}],
        fidelity={"family": "clothoid", "elements": 2},
        estimate=[{"name": name} for name in _NAMES],
        data=[{"kind": "static", "propose": rows, "conditions": conditions, "measured": measured}],
    )


def even(rows: int) -> list[dict[str, float]]:
    """Rows that go through the choices of one condition after the other; the others are as they are first, or level."""
    first = {
        name: values[len(values) // 2] if min(values) < 0.0 < max(values) else values[0]
        for name, values in _CHOICES.items()
    }
    every = [{**first, name: value} for name, values in _CHOICES.items() for value in values if value != first[name]]
    return [every[k] for k in np.linspace(0, len(every) - 1, rows).round().astype(int)]


def main() -> None:
    asked, report = begun(__doc__, "experiments", fingers=40, rows=6, seed=34)
    assumed = scene(asked.rows)
    plan = design_experiments(assumed)
    names = list(_CHOICES)
    cells = [plan.pose_headings.index(name) for name in names]
    proposed = [{n: float(row[c]) for n, c in zip(names, cells, strict=True)} for row in plan.pose_rows]
    ways = {f"{asked.rows} proposed": proposed, f"{2 * asked.rows} spread": even(2 * asked.rows)}
    print(plan.pairs())
    for way, rows in ways.items():
        print(way, rows)
    plain = cg.Scene(**{name: getattr(assumed, name) for name in cg.Scene.model_fields})
    found: dict[str, list[Any]] = {way: [] for way in ways}
    for number in range(asked.fingers):
        rng = np.random.default_rng([asked.seed, number])
        stiffness, density, offset = np.array([0.006, 0.05, 0.005]) * rng.uniform(0.8, 1.25, 3)
        clamp = float(rng.uniform(-0.1, 0.1))
        rod = {"finger.rod.bending_stiffness": float(stiffness), "finger.rod.linear_density": float(density)}
        true = plain.changed({**rod, "finger.tendons.offset": float(offset)})
        for way, rows in ways.items():
            given = {name: np.array([row[name] for row in rows]) for name in names}
            of_true = {**given, "base_angle": given["base_angle"] + clamp}
            empty = [Reading(axis, np.zeros(len(rows))) for axis in "xy"]
            exact = cg.compare(true, Poses(empty, of_true)).predictions.reshape(-1, 2)
            seen = exact + _SIGMA * rng.standard_normal(exact.shape)
            data = Poses([Reading(axis, seen[:, k], sigma=_SIGMA) for k, axis in enumerate("xy")], given)
            fit = cg.identify(plain, data, parameters=list(_NAMES))
            truth = np.array([stiffness, density, clamp, offset])
            low, high = fit.intervals.T
            found[way].append([high - low, fit.values - truth, (low <= truth) & (truth <= high)])
        print(number, flush=True)
    columns = ["unknown", "unit", "poses", "interval, median width", "error, r.m.s.", "covered [%]"]
    table = report.table("Poses", columns, note=__doc__ or "")
    for k, (name, unit) in enumerate(zip(plan.names, plan.units, strict=True)):
        for way in ways:
            width, off, inside = np.array(found[way], dtype=float)[:, :, k].T
            numbers = np.median(width), np.sqrt(np.mean(off**2)), 100.0 * np.mean(inside)
            table.add(name, unit, way, *map(float, numbers))
    report.finish()


if __name__ == "__main__":
    main()
