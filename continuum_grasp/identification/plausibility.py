"""Whether measurements can be those of the finger at all, and which slip of units, signs or columns explains them.

A search always finds parameters. Measurements beyond the finger's length, or that the best parameters miss by far, are
of another frame, unit or finger than the scene says: the fit is refused, and the usual slips are tried one by one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import ContinuumGraspError
from continuum_grasp.identification.blocks import Block
from continuum_grasp.identification.data import KIND_OF, Data, Frequencies, TipPath
from continuum_grasp.identification.problem import Problem
from continuum_grasp.identification.slips import readings_of, slips_of, try_undo
from continuum_grasp.identification.unknowns import Unknown, read_unknowns
from continuum_grasp.scene.simulate import Scene

Array = NDArray[np.float64]
Given = Sequence[tuple[Data, Scene]]
Build = Callable[[Given, Sequence[Unknown]], Problem]

IMPLAUSIBLE = "implausible"
"""Status of a fit whose measurements cannot be those of the finger."""
_PART = 0.05
"""Misfit, r.m.s., and distance beyond the reach, per size of the finger [1], from which data are refused where their
noise is not stated: measured rods and robots are met to 0.02, and noise of 0.02 does not reach it in 12 numbers."""
_BEYOND = 5.0
"""The same in stated standard deviations [1], which normal noise does not reach."""
_STATED = 0.2
"""Least misfit that is refused where the noise is stated, per that where it is not [1]: models of real fingers
are off by a hundredth of their length however well a camera sees."""
_UNEXPLAINED = 0.5
"""Misfit per scatter of the measurements about their means [1] from which slips are tried although it is small."""
_BETTER = 3.0
"""Misfit without a slip per that with it [1] from which the slip is named as the cause."""
_ALIKE = 1.5
"""Misfit per least one [1] up to which another slip explains the data as well."""
_NOTHING = 0.01
"""Misfit with a slip per that without it [1] below which no slip explains the data better than another."""
_REFITTED = 4
"""Slips with the least misfits at the start values whose parameters are sought anew: a search takes up to a minute."""
_OF_BASE = ("base_angle", "base_x", "base_y")
"""Targets of unknowns that say where the base is."""
_BEND = 2.0
"""Bend of an arc whose tip is moved by the finger's length, L bend / 2, for small ones [rad]."""


class Misfit(NamedTuple):
    """How far the model is from the fitted measurements of one kind in one set."""

    set: str
    kind: str
    unit: str
    rms: float
    limit: float
    """Misfit from which the data are refused; infinite for decay rates, which scatter by a factor of five between the
    postures of one rod."""
    scatter: float
    """Of the measurements about their means, r.m.s."""

    @property
    def what(self) -> str:
        """Set and kind, for messages."""
        return f"{self.kind} of {self.set}"

    @property
    def doubtful(self) -> bool:
        """Whether slips are to be tried."""
        return self.rms > min(self.limit, max(_UNEXPLAINED * self.scatter, _STATED * self.limit))


class Verdict(NamedTuple):
    """Why measurements are refused, empty where they are not; what explains them; and what is doubtful only."""

    reason: str
    causes: tuple[str, ...]
    warnings: tuple[str, ...]


def judge(problem: Problem, predictions: Array, sigma: Array, given: Given, build: Build) -> Verdict:
    """Judge a fit by its predictions (m,) and the standard deviations (m,) of what was measured."""
    left = misfits(problem, predictions)
    far = _too_far(problem, sigma, given)
    above = [one for one in left if one.rms > one.limit]
    doubtful = [one for one in left if one.doubtful]
    if not (far or doubtful):
        return Verdict("", (), ())
    worst = max(above or doubtful or left, key=lambda one: one.rms / one.limit)
    causes = explain(problem, given, build, left)
    texts = [far] if far else []
    if above or (causes and not far):
        texts.append(
            f"{worst.what}: the model is off by {worst.rms:.3g} {worst.unit} r.m.s., "
            + (f"at most {worst.limit:.2g} {worst.unit} is plausible" if above else "which a slip in the data explains")
        )
    warnings = (
        ()
        if texts
        else tuple(
            f"{one.what}: the model is off by {one.rms:.2g} {one.unit} r.m.s. where the measurements scatter by "
            f"{one.scatter:.2g}: check units, signs and conditions of the data"
            for one in doubtful
            if one.rms > one.scatter
        )
    )
    return Verdict("; ".join(texts), causes, warnings)


def misfits(problem: Problem, predictions: Array) -> list[Misfit]:
    """Misfits of the fitted entries, by set and kind."""
    found = []
    for block, part in zip(problem.blocks, problem.parts, strict=True):
        kinds = np.array([KIND_OF.get(entry.quantity, entry.quantity) for entry in block.entries])
        series = np.array([entry.series for entry in block.entries])
        for kind in dict.fromkeys(kinds.tolist()):
            chosen = (kinds == kind) & problem.fitted[part]
            if not chosen.any() or block.finger is None:
                continue
            measured, missed = problem.measured[part][chosen], (predictions - problem.measured)[part][chosen]
            entries = [entry for entry, there in zip(block.entries, chosen, strict=True) if there]
            means = {name: measured[series[chosen] == name].mean() for name in dict.fromkeys(series[chosen].tolist())}
            about = measured - np.array([means[entry.series] for entry in entries])
            size, share = _size(kind, measured, block.finger.rod.length)
            limit = share * size
            stated = [entry.sigma for entry in entries if entry.sigma is not None]
            if stated and math.isfinite(limit):
                limit = max(_BEYOND * max(stated), _STATED * limit)
            rms = problem.spread(missed, float(missed.size))
            scatter = float(np.sqrt(np.mean(about**2))) if about.size > 2 * len(means) else math.inf
            found.append(Misfit(block.name, kind, entries[0].unit, rms, limit, scatter))
    return found


def _size(kind: str, measured: Array, length: float) -> tuple[float, float]:
    """Size of what is measured, and the share of it that a misfit may have."""
    if kind == "positions":
        return length, _PART
    if kind == "angles":
        return max(_BEND, float(np.ptp(measured))), _PART
    size = float(np.sqrt(np.mean(measured**2)))
    if kind == "frequency":
        return size, _PART
    # of drives: a model that is off by as much as it is to explain; friction and lags are large parts of these
    return size, math.inf if kind == "decay rate" else 1.0


def _too_far(problem: Problem, sigma: Array, given: Given) -> str:
    """What lies beyond the reach of the finger: farther from the base than the finger is long up to there."""
    found, count, total = "", 0, 0
    most = 0.0
    for (data, scene), block, part in zip(given, problem.blocks, problem.parts, strict=True):
        if isinstance(data, Frequencies):
            continue
        readings = readings_of(data)
        rows = np.stack([np.asarray(one.values, dtype=float) for one in readings], axis=1)
        noise = sigma[part].reshape(rows.shape)
        base, length = scene.finger.base.position, scene.finger.rod.length
        for place in dict.fromkeys(one.at for one in readings if one.quantity in ("x", "y")):
            here = [k for k, one in enumerate(readings) if one.quantity in ("x", "y") and one.at == place]
            away = rows[:, here] - np.array([base["xy".index(readings[k].quantity)] for k in here])
            distance = np.linalg.norm(away, axis=1)
            reach = length if place is None else place
            over = distance - reach - np.maximum(_PART * length, _BEYOND * noise[:, here].max(axis=1))
            total, count = total + over.size, count + int(np.sum(over > 0.0))
            if over.max() > most:
                most, row = float(over.max()), int(np.argmax(over))
                found = (
                    f"{block.name}: {block.entries[row * len(readings) + here[0]].label} is {distance[row]:.3g} m from "
                    f"the base, where the finger is {reach:g} m long"
                )
    # a robust loss expects outliers, and is misled only if most of the readings are
    return found if count > (0.5 * total if problem.robust else 0.0) else ""


def explain(problem: Problem, given: Given, build: Build, left: Sequence[Misfit] = ()) -> tuple[str, ...]:
    """Slips that explain the measurements, by trying them: those that are best at the start values are fitted anew.

    Without misfits ``left`` of a fit, as where there is none, every slip that leads to a plausible one is named.
    """
    unknowns, before, tried = problem.unknowns[: problem.shared], _total(left) if left else math.inf, {}
    for slip in slips_of(given):
        for sets in ({data.name for data, _ in given}, {one.set for one in left if one.doubtful}):
            changed = [try_undo(slip, *one) if one[0].name in sets else None for one in given]
            concerned = tuple(data.name for (data, _), one in zip(given, changed, strict=True) if one is not None)
            if not concerned or (slip.words, concerned) in tried:
                continue
            new = [one or old for one, old in zip(changed, given, strict=True)]
            try:
                blocks = [
                    block if one is None else _again(block, old, one) or build([one], unknowns).blocks[0]
                    for block, old, one in zip(problem.blocks, given, changed, strict=True)
                ]
                trial = problem.of(blocks, unknowns)
                values = np.array([one.start for one in trial.unknowns])
                total = float(np.nan_to_num(_total(misfits(trial, trial.predict(values)[0])), nan=math.inf))
            except ContinuumGraspError:
                total = math.inf
            tried[slip.words, concerned] = total, new
    worst = max(left, key=lambda one: one.rms / one.limit, default=None)
    ranked = sorted(tried.items(), key=lambda one: one[1][0])[:_REFITTED]
    trials = [
        (slip, concerned, partial(build, new, unknowns))
        for (slip, concerned), (total, new) in ranked
        if total <= max(_BETTER * ranked[0][1][0], _NOTHING * before)
    ]
    found = [one for one in (_refitted(*trial, before, worst, len(given)) for trial in trials) if one is not None]
    if not found and any(entry.quantity in ("x", "y") for entry in problem.entries):
        elsewhere = partial(_elsewhere, given, unknowns, build)
        moved = _refitted("the base is elsewhere", (), elsewhere, before, worst, len(given))
        found = [] if moved is None else [moved]
    least = min((total for total, _ in found), default=0.0)
    return tuple(text for total, text in found if total <= max(_ALIKE * least, _NOTHING * before))


def _refitted(
    slip: str, concerned: tuple[str, ...], build: Callable[[], Problem], before: float, worst: Misfit | None, sets: int
) -> tuple[float, str] | None:
    """Misfit without a slip, and what to say of it; None where it does not explain the measurements."""
    try:
        trial = build()
        solution = trial.solve(lambda share: None)
    except ContinuumGraspError:
        return None
    after = misfits(trial, solution.predictions)
    total = _total(after)
    if not (total * _BETTER < before and all(one.rms <= one.limit for one in after)):
        return None
    same = next((one for one in after if worst and one.what == worst.what), after[0])
    where = f" in {', '.join(concerned)}" if 0 < len(concerned) < sets else ""
    of_base = zip(trial.unknowns, solution.values, strict=True)
    by = ", ".join(f"{one.name} {value:.3g} {one.unit}" for one, value in of_base if one.target in _OF_BASE)
    at = f" ({by} off)" if not concerned else ""
    return total, f"{slip}{where}{at}: undone, the model is off by {same.rms:.3g} {same.unit} r.m.s."


def _elsewhere(given: Given, unknowns: Sequence[Unknown], build: Build) -> Problem:
    """The problem with the place of the base, and its angle, sought as well."""
    scene, sought = given[0][1], list(unknowns)
    if not any(one.target == "base_angle" for one in sought):
        sought += read_unknowns(scene, ["clamp_angle"])
    length = scene.finger.rod.length
    shift = [Unknown(name, "m", name, 1.0, True, 0.0, -math.inf, math.inf, length) for name in ("base_x", "base_y")]
    problem = build(given, sought)
    return problem.of([_Shifted(block, len(sought)) for block in problem.blocks], [*sought, *shift])


class _Shifted(Block):
    """A block whose positions are shifted by two further unknowns, behind the first ``count``."""

    def __init__(self, block: Block, count: int) -> None:
        self.__dict__.update(block.__dict__)
        self._block, self._count = block, count
        self.moves, self.kinked, self.ordered, self.free = block.moves, block.kinked, block.ordered, block.free
        self._along = np.array([[entry.quantity == axis for axis in "xy"] for entry in block.entries], dtype=float)

    def predict(self, values: Array) -> tuple[Array, Array]:
        own = slice(self._count, self._count + 2)
        y, slopes = self._block.predict(np.delete(values, own))
        return y + self._along @ values[own], np.insert(slopes, [self._count] * 2, self._along, axis=1)


def _again(block: Block, old: tuple[Data, Scene], new: tuple[Data, Scene]) -> Block | None:
    """The block with other measured values, where nothing else has changed that its predictions depend on."""
    (before, scene), (data, other) = old, new
    if scene is not other or (isinstance(before, TipPath) and before.start != "scene"):
        return None
    if any(getattr(before, key, None) is not getattr(data, key, None) for key in ("t", "mode", "conditions")):
        return None
    if [(one.what, one.since) for one in readings_of(before)] != [(one.what, one.since) for one in readings_of(data)]:
        return None
    if isinstance(data, Frequencies):
        columns = [values for values in (data.frequency, data.decay_rate) if values is not None]
    else:
        columns = [one.values for one in readings_of(data)]
    found = copy(block)
    values = np.stack([np.asarray(column, dtype=float) for column in columns], axis=1).ravel()
    found.entries = [replace(entry, value=float(v)) for entry, v in zip(block.entries, values, strict=True)]
    return found


def _total(left: Sequence[Misfit]) -> float:
    """Misfit of all kinds and sets, per what is plausible."""
    return float(np.sqrt(np.mean([(one.rms / one.limit) ** 2 for one in left])))
