"""Whether residuals have the structure that a wrong law of the material or of the damping leaves.

Motions: one Gauss-Newton step towards a model that has further laws (a score test; C. R. Rao, 1948), so that all
samples count by their noise. Shapes at rest: what the data do beyond the model, linear or not, is compared with the
size and the direction of the bend.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import ContinuumGraspError
from continuum_grasp.identification.inference import infer, surely
from continuum_grasp.identification.problem import Build, Given, Problem, Solution
from continuum_grasp.identification.unknowns import Unknown, read_unknowns

Array = NDArray[np.float64]

_LEAST = 4
"""Least degrees of freedom beside a trend, and least rows of each way [1]."""
_PART = 0.25
"""Of the residuals' squares, the share that a trend must explain to be reported [1]: systematic, and not just seen."""
_MATTERS = 1e-3
"""Least change of a motion by a further law, r.m.s. per range of the readings [1]: a tenth of what models of real
fingers are off, and ten times what two integrators differ by."""
_FURTHER = {
    "quadratic_damping": (
        "damping",
        "large swings lose more of it, as the drag of the air makes them",
        "small swings lose more of it, as dry friction makes them, of the bending or in the tendons",
    ),
    "softening_ratio": (
        "stiffness",
        "the finger is softer in small bends than in large ones",
        "the finger is stiffer in small bends than in large ones, as dry friction makes it that sticks before it slips",
    ),
}
"""Parameters of the laws that are tried on motions; of what law they are, and what greater and smaller ones mean."""


def doubts_of_laws(problem: Problem, solution: Solution, given: Given, build: Build) -> list[str]:
    """What the residuals say against the laws of stiffness, damping and memory that the model has."""
    return [*_motions(problem, solution, given, build), *_rows(problem, solution.predictions)]


def _has(problem: Problem) -> dict[str, bool]:
    """Which laws beside the linear ones the model has, or is to find."""
    estimated, fingers = {one.target for one in problem.unknowns}, problem.fingers
    return {
        "softening": any(finger.softening is not None for finger in fingers),
        "stops": any(finger.stops is not None for finger in fingers),
        "dry friction": any(finger.has_dry_friction for finger in fingers),
        "tendon friction": "tendon_friction" in estimated or any(finger.has_tendon_friction for finger in fingers),
        "drag": "quadratic_damping" in estimated or any(finger.damping.quadratic > 0.0 for finger in fingers),
    }


def _law(what: str, problem: Problem) -> str:
    """The law in use, for messages."""
    beside = {"stiffness": ("softening", "stops"), "damping": ("dry friction", "tendon friction", "drag")}[what]
    there = _has(problem)
    has = [name for name in beside if there[name]]
    return f"the law of {what} with {' and '.join(has)}" if has else f"a linear law of {what}"


def _series(problem: Problem, *, moves: bool) -> list[tuple[int, str, NDArray[np.intp]]]:
    """Number of the set, name, and fitted entries (R,) of each reading of a set that moves, or rests."""
    found: dict[tuple[int, str], list[int]] = {}
    for k, (block, part) in enumerate(zip(problem.blocks, problem.parts, strict=True)):
        for row, entry in enumerate(block.entries, part.start):
            if entry.fitted and entry.series and block.moves == moves:
                found.setdefault((k, entry.series), []).append(row)
    return [(k, name, np.array(rows)) for (k, name), rows in found.items()]


def _motions(problem: Problem, solution: Solution, given: Given, build: Build) -> list[str]:
    """Further laws with which the model moves as measured, and without which it does not."""
    moving = _series(problem, moves=True)
    further: list[tuple[Unknown, Array]] = []
    for name in _FURTHER if moving else ():
        # A law that is estimated already, or that this finger cannot have, is not tried.
        with suppress(ContinuumGraspError):
            further.append(_with_law(name, problem, solution, given, build))
    if not further:
        return []
    tried, slopes = zip(*further, strict=True)
    jacobian, residuals = problem.weighted(solution, np.column_stack(slopes))
    step = np.linalg.lstsq(jacobian, -residuals, rcond=None)[0]
    found = infer(
        [*problem.unknowns, *tried],
        step,
        jacobian,
        residuals + jacobian @ step,
        solution.inflation,
        series=problem.series,
    )
    swings = [(problem.measured[own] - problem.measured[own].mean()) / solution.sigma[own] for *_, own in moving]
    least, doubts = _MATTERS * float(np.linalg.norm(np.concatenate(swings))), []
    for k, one in enumerate(tried, len(problem.unknowns)):
        others, own = np.delete(jacobian, k, axis=1), step[k] * jacobian[:, k]
        beyond = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        if abs(step[k]) > surely(found.freedom) * found.deviations[k] and float(np.linalg.norm(beyond)) > least:
            what, more, less = _FURTHER[one.target]
            doubts.append(
                f"{_law(what, problem)} does not fit: {more if step[k] > 0.0 else less} ({one.name} is off by "
                f"{step[k]:.2g} +/- {found.deviations[k]:.2g} {one.unit})"
            )
    return doubts


def _with_law(name: str, problem: Problem, solution: Solution, given: Given, build: Build) -> tuple[Unknown, Array]:
    """A parameter of a further law, and the derivative (m,) of motions by it, where the law has no effect yet."""
    slope, count = np.zeros(len(problem.measured)), len(problem.sought)
    values = problem.by_block(solution.values)
    ranges: dict[int, list[float]] = {}
    for k, _, rows in _series(problem, moves=True):
        per = given[k][1].finger.rod.length if problem.entries[rows[0]].unit == "m" else 1.0
        ranges.setdefault(k, []).append(float(np.ptp(problem.measured[rows])) / per)
    for k, sizes in ranges.items():
        data, scene = given[k]
        added = name == "softening_ratio" and scene.finger.softening is None
        if added:
            # From half of the greatest curvature on, as the range of the readings says; the derivative at a ratio of 1.
            bent = {"curvature": 0.5 * max(sizes) / scene.finger.rod.length, "stiffness_ratio": 0.5}
            scene = scene.changed({"finger.softening": bent})
        (unknown,) = read_unknowns(scene, [name])
        (block,) = build([(data, scene)], [*problem.sought, unknown]).blocks
        at = np.insert(values[k], count, 1.0 if added else unknown.start)
        slope[problem.parts[k]] = block.predict(at)[1][:, count]
    return unknown, slope


def _rows(problem: Problem, predictions: Array) -> list[str]:
    """Readings at rest whose residuals bend with their size, or depend on the direction of loading."""
    found: dict[str, list[str]] = {}
    bows: dict[str, list[tuple[Array, Array, Array]]] = {}
    for _, name, own in _series(problem, moves=False):
        left, moved = problem.measured[own] - predictions[own], predictions[own] - predictions[own[0]]
        span = float(np.ptp(moved))
        if not span > 0.0:
            continue
        reach, side = np.abs(moved) / span, np.sign(moved[np.argmax(np.abs(moved))])
        # In shares of the range, so that sets of one reading are judged together.
        bows.setdefault(name, []).append((reach**2, side * left / span, np.stack([reach**0, reach], axis=1)))
        way = np.sign(np.gradient(moved))
        width = _trend([(way, left, np.ones((len(left), 1)))])
        if width is not None and min(np.sum(way > 0), np.sum(way < 0)) >= _LEAST:
            text = f"rows depend on the direction of loading, by {2.0 * abs(width):.2g} {problem.entries[own[0]].unit}"
            there = _has(problem)
            friction = there["dry friction"] or there["tendon friction"]
            memory = "of another law than the model's" if friction else "which the model does not have"
            found.setdefault(f"{text}: friction with memory, {memory}", []).append(name)
    for name, sets in bows.items():
        bow = _trend(sets)
        if bow is not None:
            law = "it softens where it is bent far" if bow > 0.0 else "it stiffens where it is bent far"
            found.setdefault(f"{_law('stiffness', problem)} is wrong: {law}", []).append(name)
    return [
        f"{text} ({', '.join(names[:3])}{' and others' if len(names) > 3 else ''})" for text, names in found.items()
    ]


def _trend(sets: list[tuple[Array, Array, Array]]) -> float | None:
    """Slope of y over x, the same in all sets (x, y, columns (rows, k) that each set fits for itself).

    None where it is not sure, or does not explain much.
    """
    parts, freedom = [], -1
    for x, y, beside in sets:
        basis, _ = np.linalg.qr(beside)
        parts.append([v - basis @ (basis.T @ v) for v in (x, y)])
        freedom += len(x) - beside.shape[1]
    across, left = (np.concatenate(part) for part in zip(*parts, strict=True))
    if freedom < _LEAST or not float(np.abs(across).max()) > 0.0:
        return None
    slope = float(across @ left / (across @ across))
    rest = left - slope * across
    explained = 1.0 - float(rest @ rest) / max(float(left @ left), 1e-300)
    sure = abs(slope) * math.sqrt(float(across @ across)) > surely(freedom) * math.sqrt(float(rest @ rest) / freedom)
    return slope if sure and explained > _PART else None
