"""Whether residuals have the structure that a wrong law of the material or of the damping leaves.

Linear laws scale: a bend grows like its load, whichever way that was reached, and swings of any size lose the same
share in the same time. What the data do beyond the model, linear or not, is compared with the size of the motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.identification.problem import Problem

Array = NDArray[np.float64]

_SURE = 4.0
"""Student's t from which a trend is reported [1]: noise exceeds it in 0.4 % of trends through ten points."""
_MOVES = 0.3
"""Of the greatest range of the readings along a path, that below which one is left out [1]."""
_LEAST = 4
"""Least degrees of freedom beside a trend, and least rows of each way [1]."""
_OF_PARABOLA = 3
"""Rows through which a parabola goes exactly [1]."""
_PART = 0.25
"""Of the residuals' squares, the share that a trend must explain to be reported [1]: systematic, and not just seen."""
_MATTERS = 0.1
"""Least change of the logarithm of the share lost per swing, or of its duration, between small and large ones [1]."""
_SMALLEST = 0.04
"""Of the first swing, the size below which swings are left out [1]: there the noise makes them."""


def doubts_of_laws(problem: Problem, predictions: Array) -> list[str]:
    """What the residuals say against the laws of stiffness, damping and memory that the model has."""
    return [*_swings(problem, predictions), *_rows(problem, predictions)]


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


def _stiffness_law(problem: Problem) -> str:
    return _law("stiffness", problem, ("softening", "stops"))


def _damping_law(problem: Problem) -> str:
    return _law("damping", problem, ("dry friction", "tendon friction", "drag"))


def _law(what: str, problem: Problem, beside: tuple[str, ...]) -> str:
    """The law in use, for messages."""
    there = _has(problem)
    has = [name for name in beside if there[name]]
    return f"the law of {what} with {' and '.join(has)}" if has else f"a linear law of {what}"


class _Series(NamedTuple):
    name: str
    unit: str
    measured: Array
    predicted: Array
    at: Array


def _series(problem: Problem, predictions: Array, paths: bool) -> Iterator[_Series]:
    """Readings of the fitted sets that move, or that rest, one by one."""
    for block, part in zip(problem.blocks, problem.parts, strict=True):
        if block.moves != paths:
            continue
        found = []
        for name in dict.fromkeys(entry.series for entry in block.entries):
            chosen = np.array([entry.series == name and entry.fitted for entry in block.entries], dtype=bool)
            if name and chosen.any():
                entries = [entry for entry, there in zip(block.entries, chosen, strict=True) if there]
                measured, predicted = (values[part][chosen] for values in (problem.measured, predictions))
                at = np.array([one.at for one in entries])
                found.append(_Series(name, entries[0].unit, measured, predicted, at))
        # Along a path, what hardly moves has more noise than swings.
        least = max((_MOVES * float(np.ptp(one.measured)) for one in found), default=0.0) if paths else 0.0
        yield from (one for one in found if float(np.ptp(one.measured)) >= least)


class _Swings(NamedTuple):
    """Swings from one extreme to the next: sizes of all, and of each but the last what it loses and how long it is."""

    size: Array
    lost: Array
    """Logarithm of a swing over the next."""
    duration: Array


def _swings_of(values: Array, at: Array) -> _Swings | None:
    turns = np.flatnonzero(np.diff(np.sign(np.diff(values))) != 0) + 1
    if len(turns) < 3:
        return None
    found = [int(turns[0])]
    least = _SMALLEST * float(np.ptp(values))
    for k in turns[1:]:
        # A turn back by less than the least swing belongs to the noise: the more extreme of the two stays.
        if abs(values[k] - values[found[-1]]) >= least:
            found.append(int(k))
        elif len(found) > 1 and (values[k] - values[found[-1]]) * (values[found[-1]] - values[found[-2]]) > 0.0:
            found[-1] = int(k)
    size = np.abs(np.diff(values[found]))
    if len(size) < 2:
        return None
    return _Swings(size[:-1], np.log(size[:-1] / size[1:]), np.diff(at[found])[:-1])


def _swings(problem: Problem, predictions: Array) -> list[str]:
    """Paths on which small swings lose another share, or take another time, than the model's do beside large ones."""
    sizes, lost, duration, found = [], [], [], []
    for one in _series(problem, predictions, paths=True):
        measured, predicted = (_swings_of(values, one.at) for values in (one.measured, one.predicted))
        if measured is None or predicted is None or one.unit != "m":
            continue
        # A model that is damped too much ends earlier; its last swing stands for those that would follow.
        like = np.minimum(np.arange(len(measured.size)), len(predicted.size) - 1)
        sizes += list(np.log(measured.size))
        lost += list(measured.lost - predicted.lost[like])
        duration += list(np.log(measured.duration / predicted.duration[like]))
    if not sizes:
        return []
    span = f"from swings of {1e3 * math.exp(max(sizes)):.2g} mm to {1e3 * math.exp(min(sizes)):.2g} mm"
    change = _change(sizes, lost)
    if change is not None:
        law = "dry friction does, of the bending or in the tendons" if change > 0.0 else "the drag of the air does"
        found.append(
            f"{_damping_law(problem)} is wrong: {span}, what a swing leaves to the next falls by a factor of "
            f"{math.exp(change):.2g} more than the model says, which {law}"
        )
    change = _change(sizes, duration)
    if change is not None:
        law = (
            "stiffer in small bends than in large ones, as dry friction makes it that sticks before it slips"
            if change < 0.0
            else "softer in small bends than in large ones"
        )
        found.append(
            f"{_stiffness_law(problem)} and {_damping_law(problem)} are wrong together: {span}, the "
            f"time of a swing changes by a factor of {math.exp(change):.2g} more than the model says, so the finger is "
            f"{law}"
        )
    return found


def _change(sizes: list[float], excess: list[float]) -> float | None:
    """How a logarithm changes from the largest swings to the smallest, where it does so surely and by much."""
    slope = _trend([(np.array(sizes), np.array(excess), np.ones((len(sizes), 1)))])
    change = None if slope is None else -slope * float(np.ptp(sizes))
    return change if change is not None and abs(change) >= _MATTERS else None


def _rows(problem: Problem, predictions: Array) -> list[str]:
    """Readings at rest whose residuals bend with their size, or depend on the direction of loading."""
    found: dict[str, list[str]] = {}
    bows: dict[str, list[tuple[Array, Array, Array]]] = {}
    for one in _series(problem, predictions, paths=False):
        left, moved = one.measured - one.predicted, one.predicted - one.predicted[0]
        span = float(np.ptp(moved))
        if len(left) <= _OF_PARABOLA or not span > 0.0:
            continue
        reach, side = np.abs(moved) / span, np.sign(moved[np.argmax(np.abs(moved))])
        # In shares of the range, so that sets of one reading are judged together.
        bows.setdefault(one.name, []).append((reach**2, side * left / span, np.stack([reach**0, reach], axis=1)))
        way = np.sign(np.gradient(one.predicted))
        width = _trend([(way, left, np.ones((len(left), 1)))])
        if width is not None and min(np.sum(way > 0), np.sum(way < 0)) >= _LEAST:
            text = f"rows depend on the direction of loading, by {2.0 * abs(width):.2g} {one.unit}"
            there = _has(problem)
            friction = there["dry friction"] or there["tendon friction"]
            memory = "of another law than the model's" if friction else "which the model does not have"
            found.setdefault(f"{text}: friction with memory, {memory}", []).append(one.name)
    for name, sets in bows.items():
        bow = _trend(sets)
        if bow is not None:
            law = "it softens where it is bent far" if bow > 0.0 else "it stiffens where it is bent far"
            found.setdefault(f"{_stiffness_law(problem)} is wrong: {law}", []).append(name)
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
    sure = abs(slope) > _SURE * math.sqrt(float(rest @ rest) / freedom / float(across @ across))
    return slope if sure and explained > _PART else None
