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

FALSE_ALARMS = 2e-3
"""Probability with which noise alone makes a single verdict [1]: the four of them then make one in 1 % of data sets."""
_CLEAR = 10.0
"""Swing per standard deviation of the noise [1], below which a swing is left out: its logarithm is off by 0.1."""
_ROUNDING = 1e-9
"""Least variance of a logarithm per that of the others, and least variance [1], of paths without noise."""
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


class _Extremes(NamedTuple):
    """Extremes (K,) of a path: value and instant, and the variances of both by the noise."""

    value: Array
    at: Array
    value_var: Array
    at_var: Array
    freedom: int
    """Degrees of freedom of that noise."""

    def compared(self, values: Array, variances: Array, sizes: bool) -> tuple[Array, Array]:
        """Logarithms of what separates successive extremes, per the next where wanted, and their covariance."""
        gap = np.diff(values)
        moved = (np.eye(len(values))[1:] - np.eye(len(values))[:-1]) / gap[:, None]
        found = np.log(np.abs(gap))
        if sizes:
            found, moved = found[:-1] - found[1:], moved[:-1] - moved[1:]
        else:
            found, moved = found[:-1], moved[:-1]
        return found, (moved * variances) @ moved.T


def _extremes(values: Array, at: Array, least: float) -> _Extremes | None:
    """Extremes between which a path swings by ``least`` or more, each that of a sine through what is about it.

    The greatest of noisy samples would be too great, by as much for small swings as for large ones.
    """
    turns, way, ends = [], 0.0, {1.0: 0, -1.0: 0}
    for k, value in enumerate(values):
        for side in (1.0, -1.0):
            if way != -side and side * (value - values[ends[side]]) > 0.0:
                ends[side] = k
            if way != -side and side * (values[ends[side]] - value) >= least:
                if ends[side] > 0:
                    turns.append(ends[side])
                way, ends[-side] = -side, k
    if len(turns) < 3:
        return None
    rows, scatter, freedom = [], 0.0, 0
    middle = 0.5 * (at[turns[:-1]] + at[turns[1:]])
    edges = np.concatenate([[2.0 * at[turns[0]] - middle[0]], middle, [2.0 * at[turns[-1]] - middle[-1]]])
    for k, before, after in zip(turns, edges[:-1], edges[1:], strict=True):
        near = np.flatnonzero((at >= before) & (at <= after))
        near = np.arange(max(0, min(near[0], k - 2)), min(len(at), max(near[-1], k + 2) + 1))
        pulsation = math.pi / (after - before)
        phase = pulsation * (at[near] - at[k])
        basis = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1)
        weights, inverse = np.linalg.lstsq(basis, values[near], rcond=None)[0], np.linalg.inv(basis.T @ basis)
        size, turned = float(np.hypot(*weights[1:])), float(np.arctan2(weights[2], weights[1]))
        if abs(turned) > 0.5 * math.pi:  # a minimum
            size, turned = -size, float(np.arctan2(-weights[2], -weights[1]))
        scatter += float(np.sum((basis @ weights - values[near]) ** 2))
        freedom += len(near) - 3
        row = np.array([1.0, math.cos(turned), math.sin(turned)])
        slope = np.array([0.0, -math.sin(turned), math.cos(turned)]) / (size * pulsation)
        rows.append((weights[0] + size, at[k] + turned / pulsation, row @ inverse @ row, slope @ inverse @ slope))
    value, instant, value_var, at_var = np.array(rows).T
    variance = scatter / freedom
    return _Extremes(value, instant, variance * value_var, variance * at_var, freedom)


def _swings(problem: Problem, predictions: Array) -> list[str]:
    """Paths on which small swings lose another share, or take another time, than the model's do beside large ones."""
    sizes: list[float] = []
    found: list[str] = []
    freedom = 0
    trends: dict[bool, list[tuple[Array, Array, Array]]] = {True: [], False: []}
    for one in _series(problem, predictions, paths=True):
        if one.unit != "m":
            continue
        least = max(_SMALLEST * float(np.ptp(one.measured)), _CLEAR * _noise(one))
        # found by half of it: one that noise hides would merge its neighbors, and pass for one of thrice their time
        measured, predicted = (_extremes(values, one.at, 0.5 * least) for values in (one.measured, one.predicted))
        if measured is None or predicted is None:
            continue
        every = np.abs(np.diff(measured.value))
        clear = np.minimum(every[:-1], every[1:]) >= least
        if not clear.any():
            continue
        size = np.log(every[:-1])[clear]
        # A model that is damped too much ends earlier; its last swing stands for those that would follow.
        like = np.minimum(np.flatnonzero(clear), len(predicted.value) - 3)
        sizes, freedom = [*sizes, *size], freedom + measured.freedom
        for of_sizes in (True, False):
            logarithms = [
                own.compared(own.value if of_sizes else own.at, own.value_var if of_sizes else own.at_var, of_sizes)
                for own in (measured, predicted)
            ]
            excess, covariance = (
                logarithms[0][0][clear] - logarithms[1][0][like],
                logarithms[0][1][np.ix_(clear, clear)],
            )
            floor = _ROUNDING * max(float(np.trace(covariance)) / len(size), _ROUNDING)
            white = np.linalg.inv(np.linalg.cholesky(covariance + floor * np.eye(len(size))))
            trends[of_sizes].append((white @ size, white @ excess, white.sum(axis=1, keepdims=True)))
    if not sizes:
        return []
    span = f"from swings of {1e3 * math.exp(max(sizes)):.2g} mm to {1e3 * math.exp(min(sizes)):.2g} mm"
    change = _change(trends[True], float(np.ptp(sizes)), freedom)
    if change is not None:
        law = "dry friction does, of the bending or in the tendons" if change > 0.0 else "the drag of the air does"
        found.append(
            f"{_damping_law(problem)} is wrong: {span}, what a swing leaves to the next falls by a factor of "
            f"{math.exp(change):.2g} more than the model says, which {law}"
        )
    change = _change(trends[False], float(np.ptp(sizes)), freedom)
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


def _noise(one: _Series) -> float:
    """Standard deviation of the noise, or a little more: both the model's error and a coarse sampling add to it."""
    left = one.measured - one.predicted
    # third differences take a parabola off, and make 20 variances of one
    rough = float(np.mean(np.diff(one.measured, 3) ** 2)) / 20.0 if len(left) > _OF_PARABOLA else math.inf
    return math.sqrt(min(float(np.mean(left**2)), rough))


def _change(sets: list[tuple[Array, Array, Array]], span: float, freedom: int) -> float | None:
    """How a logarithm changes from the largest swings to the smallest, where it does so surely and by much."""
    x, y, beside = (np.concatenate(parts) for parts in zip(*sets, strict=True))
    slope = _trend([(x, y, beside)], freedom)
    change = None if slope is None else -slope * span
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


def _trend(sets: list[tuple[Array, Array, Array]], noise: int = 0) -> float | None:
    """Slope of y over x, the same in all sets (x, y, columns (rows, k) that each set fits for itself).

    None where it is not sure, or does not explain much. With ``noise``, the deviations of y are known to be one, from
    so many degrees of freedom; what scatters more counts by its scatter.
    """
    parts, freedom = [], -1
    for x, y, beside in sets:
        basis, _ = np.linalg.qr(beside)
        parts.append([v - basis @ (basis.T @ v) for v in (x, y)])
        freedom += len(x) - beside.shape[1]
    if freedom < (1 if noise else _LEAST):
        return None
    across, left = (np.concatenate(part) for part in zip(*parts, strict=True))
    if not float(np.abs(across).max()) > 0.0:
        return None
    slope = float(across @ left / (across @ across))
    rest = left - slope * across
    explained = 1.0 - float(rest @ rest) / max(float(left @ left), 1e-300)
    variance = max(float(rest @ rest) / freedom, 1.0 if noise else 0.0)
    sure = abs(slope) * math.sqrt(float(across @ across)) > surely(noise or freedom) * math.sqrt(variance)
    return slope if sure and explained > _PART else None


def surely(freedom: float, chances: int = 1) -> float:
    """Student's t that noise exceeds, to either side, in one of so many chances with the probability of a verdict."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 1.0 - 0.5 * FALSE_ALARMS / chances))
