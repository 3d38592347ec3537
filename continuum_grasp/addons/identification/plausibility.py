"""Whether a finger can have the measurements at all, and which slip of units, signs or columns explains them.

A search always finds parameters. Measurements beyond the finger's length, or that the best parameters miss by far, are
of another frame, unit or finger than the scene says: the fit is refused, and the usual slips are tried one by one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from continuum_grasp.addons.identification.blocks import MeasuredBlock
from continuum_grasp.addons.identification.data import KIND_OF, OF_MODES, Data, TipPath
from continuum_grasp.addons.identification.problem import FitProblem, Solution
from continuum_grasp.addons.identification.slips import PossibleMistake, late, slips_of, undone
from continuum_grasp.addons.identification.unknowns import ADDED, Unknown, read_unknowns
from continuum_grasp.base import Array, ContinuumGraspError
from continuum_grasp.scene import Scene

IMPLAUSIBLE = "implausible"
"""Status of a fit whose measurements this finger cannot have."""
PART = 0.05
"""Misfit, r.m.s., and distance beyond the reach, per size of the finger [1], from which data are refused where their
noise is not stated: measured rods and robots are met to 0.02, and noise of 0.02 does not reach it in 12 numbers."""
_BEYOND = 5.0
"""Misfit in stated standard deviations [1], which normal noise does not reach."""
_STATED = 0.2
"""Least misfit that is refused where the noise is stated, per that where it is not [1]: models of real fingers
are off by a hundredth of their length however well a camera sees."""
_UNEXPLAINED = 0.5
"""Misfit per scatter of the measurements about their means [1] from which slips are tried although it is small: a clamp
angle that is sought meets swapped columns of x and y to 4 % of the length."""
_BETTER = 3.0
"""Misfit without a slip per that with it [1] from which the slip is named as the cause, and greatest misfit per the
least of all slips [1] up to which others are named as well."""
_NOTHING = 0.01
"""Misfit per plausible misfit [1] below which no slip explains the data better than another."""
_FAR = 10.0
"""Factor of an estimate on the scene's value, up or down, from which slips are tried although the fit is good [1]: what
scales load and stiffness alike leaves no misfit, and materials of one kind differ by less."""
_SCALES = ("bending_stiffness", "linear_density")
"""Unknowns that scale with units of the loads or times."""
_MEASURED = {*KIND_OF, *OF_MODES}
"""Columns on whose values no prediction depends."""
_BASE = ("base_x", "base_y")
"""Unknowns of a base that is elsewhere."""


class Misfit(NamedTuple):
    """Distance of the model from the fitted measurements of one kind in one set."""

    set: str
    kind: str
    unit: str
    rms: float
    limit: float
    """Misfit from which the data are refused; infinite for decay rates, which scatter by a factor of five between the
    postures of one rod."""
    scatter: float
    """Scatter of the measurements about their means, r.m.s.; infinite where they are too few."""
    stated: float = 0.0
    """Greatest standard deviation that is stated."""

    @property
    def is_unexplained(self) -> bool:
        """Whether slips are to be tried."""
        return self.rms > min(self.limit, max(_UNEXPLAINED * self.scatter, _STATED * self.limit))


class Plausibility(NamedTuple):
    """Why measurements are refused, empty where they are not; what explains them; and what only warns."""

    reason: str
    causes: tuple[str, ...]
    warnings: tuple[str, ...]


def questionable(problem: FitProblem, solution: Solution) -> bool:
    """Whether a fit misses the data, or is so far from the scene, that slips are tried."""
    return any(misfit.is_unexplained for misfit in misfits(problem, solution.predictions)) or bool(
        _far(problem, solution)
    )


def _far(problem: FitProblem, solution: Solution) -> list[tuple[Unknown, float]]:
    """Unknowns that scale with loads and come out as a multiple of the scene's value, and that multiple."""
    pairs = [(u, float(value / u.typical)) for u, value in zip(problem.unknowns, solution.values, strict=True)]
    return [(u, times) for u, times in pairs if u.target in _SCALES and not 1.0 / _FAR <= times <= _FAR]


def judge(problem: FitProblem, solution: Solution, lost: Sequence[str] = ()) -> Plausibility:
    """Judge whether the finger can produce the measurements; ``lost`` readings explain misfits."""
    left = misfits(problem, solution.predictions)
    reason = too_far(problem, solution.values, solution.sigma)
    unexplained = [misfit for misfit in left if misfit.is_unexplained]
    causes = tuple(lost)
    if not lost and (reason or unexplained):
        causes = explain(problem, left)
    worst = max(left, key=lambda misfit: misfit.rms / misfit.limit)
    if worst.rms > worst.limit or (causes and not lost and not reason):
        plausible = "which a slip in the data explains"
        if worst.rms > worst.limit:
            plausible = f"at most {worst.limit:.2g} {worst.unit} is plausible"
        missed = f"{worst.kind} of {worst.set}: the model is off by {worst.rms:.3g} {worst.unit} r.m.s., {plausible}"
        reason = f"{reason}; {missed}" if reason else missed
    if reason:
        return Plausibility(reason, causes, ())
    warnings = [
        f"{misfit.kind} of {misfit.set}: the model is off by {misfit.rms:.2g} {misfit.unit} r.m.s. where the "
        f"measurements scatter by {misfit.scatter:.2g}: check units, signs and conditions of the data"
        for misfit in unexplained
        if misfit.rms > misfit.scatter
    ]
    for unknown, times in _far(problem, solution):
        slips = " or ".join(lost or explain(problem)) or "none of the usual ones explains it"
        warnings.append(
            f"{unknown.name} comes out as {times:.3g} times the scene's; slips that may be behind it: {slips}"
        )
    return Plausibility("", (), tuple(warnings))


def doubts_of_data(problem: FitProblem, predictions: Array) -> tuple[str, ...]:
    """Slips that explain what a scene as it is misses, where it misses more than is plausible."""
    left = misfits(problem, predictions)
    worst = max(left, key=lambda misfit: misfit.rms / misfit.limit, default=None)
    if worst is None or not any(misfit.is_unexplained for misfit in left):
        return ()
    causes = explain(problem, left)
    missed = f"{worst.kind} of {worst.set}: the model is off by {worst.rms:.3g} {worst.unit} r.m.s."
    return (f"{missed}; likely cause: {' or '.join(causes)}",) if causes else ()


def misfits(problem: FitProblem, predictions: Array) -> list[Misfit]:
    """Misfits of what was fitted, by set and kind."""
    all_misfits = []
    for (block, part, _), of in zip(problem.parts, problem.sets, strict=True):
        missed = (predictions - problem.measured)[part].reshape(of.values.shape)[of.fitted]
        kinds = [KIND_OF.get(column.quantity, column.quantity) for column in of.columns]
        for kind in dict.fromkeys(kinds) if len(missed) else ():
            members = [j for j, other in enumerate(kinds) if other == kind]
            values = of.values[of.fitted][:, members]
            columns = [of.columns[j] for j in members]
            scatter = float(np.std(values - values.mean(axis=0))) if len(values) > 2 else math.inf
            limit = _limit(kind, values, block.scene.finger.rod.length)
            stated = max(column.sigma or 0.0 for column in columns)
            if stated and math.isfinite(limit):
                limit = max(_BEYOND * stated, _STATED * limit)
            with np.errstate(over="ignore"):  # of a slip that makes it worse by far
                rms = float(np.sqrt(np.mean(missed[:, members] ** 2)))
            all_misfits.append(Misfit(of.name, kind, columns[0].unit, rms, limit, scatter, stated))
    return all_misfits


def _limit(kind: str, measured: Array, length: float) -> float:
    """Misfit from which measurements without a stated deviation are refused."""
    size = float(np.sqrt(np.mean(measured**2)))
    sizes = {
        "positions": PART * length,
        # 2.0: bend of an arc whose tip is moved by the finger's length, L bend / 2, for small ones [rad]
        "angles": PART * max(2.0, float(np.ptp(measured))),
        "frequency": PART * size,
        "decay_rate": math.inf,
    }
    # of drives: a model that is off by as much as it is to explain; friction and lags are large parts of these
    return sizes.get(kind, size)


def too_far(problem: FitProblem, values: Array, sigma: Array) -> str:
    """Measurements beyond the reach of the finger: farther from the base than the finger is long up to there."""
    message = ""
    farthest = 0.0
    for (block, part, mix), of in zip(problem.parts, problem.sets, strict=True):
        finger = block.scene.finger
        noise = sigma[part].reshape(of.values.shape)
        sought = {unknown.target: float(value) for unknown, value in zip(problem.sought, mix @ values, strict=False)}
        base = [at + sought.get(f"base_position_{k}", 0.0) for k, at in zip("xy", finger.base.position, strict=True)]
        offsets = np.broadcast_to(of.offsets, of.values.shape)
        markers: dict[Any, list[int]] = {}
        for j, column in enumerate(of.columns):
            if column.quantity in ("x", "y"):
                markers.setdefault((column.place, *offsets[:, j]), []).append(j)
        for (place, *_), here in markers.items():
            away = of.values[:, here] - [base["xy".index(of.columns[j].quantity)] for j in here]
            distance = np.linalg.norm(away, axis=1)
            reach = place + float(np.abs(offsets[:, here]).max())
            beyond = distance - reach
            beyond -= np.maximum(PART * finger.rod.length, _BEYOND * noise[:, here].max(axis=1))
            if beyond.max() > farthest:
                row = int(np.argmax(beyond))
                farthest = float(beyond.max())
                label = problem.labels[part.start + row * len(of.columns) + here[0]]
                message = (
                    f"{of.name}: {label} is {distance[row]:.3g} m from the base, where the finger is {reach:g} m long"
                )
    return message


def explain(problem: FitProblem, left: Sequence[Misfit] = ()) -> tuple[str, ...]:
    """Slips that explain the measurements, by trying them: those that are best at the start values are fitted anew.

    There are no misfits ``left`` where no parameters were found.
    """
    before = _total(left) if left else math.inf
    tried: dict[str, tuple[float, FitProblem]] = {}
    everywhere = {block.name for block in problem.blocks}
    missed = {misfit.set for misfit in left if misfit.is_unexplained}
    measured = [(block.data, block.scene) for block in problem.blocks]
    for slip, sets in product([*slips_of(measured), *_late(problem)], (everywhere, missed)):
        pairs = [undone(slip, *pair) if pair[0].name in sets else None for pair in measured]
        concerned = [block.name for block, pair in zip(problem.blocks, pairs, strict=True) if pair]
        words = slip.words + (f" in {', '.join(concerned)}" if len(concerned) < len(measured) else "")
        if not concerned or words in tried:
            continue
        problem.begin()
        try:
            blocks = [
                block if pair is None else _undone(block, slip, *pair, problem.sought)
                for block, pair in zip(problem.blocks, pairs, strict=True)
            ]
            trial = FitProblem(blocks, problem.sought)
            total = _total(misfits(trial, trial.predict(np.array([unknown.start for unknown in trial.unknowns]))[0]))
        except ContinuumGraspError:
            continue
        tried[words] = total, trial
    # 4: slips with the least misfits at the start values whose parameters are sought anew: a search takes up to a
    # minute
    ranked = sorted(tried.items(), key=lambda attempt: np.nan_to_num(attempt[1][0], nan=math.inf))[:4]
    explained: list[tuple[float, str]] = []
    for words, (total, trial) in ranked:
        if total <= max(_BETTER * ranked[0][1][0], _NOTHING):
            explained += _refitted(words, trial, before)
    if not explained and any(column.quantity in ("x", "y") for column in problem.described):
        known = {unknown.name for unknown in problem.sought}
        with suppress(ContinuumGraspError):
            more = read_unknowns(problem.blocks[0].scene, [name for name in ADDED if name not in known])
            sought = [*problem.sought, *more]
            elsewhere = FitProblem([block.again(sought) for block in problem.blocks], sought)
            explained = _refitted("the base is elsewhere", elsewhere, before)
    least = min((total for total, _ in explained), default=0.0)
    return tuple(text for total, text in explained if total <= max(_BETTER * least, _NOTHING))


def _late(problem: FitProblem) -> list[PossibleMistake]:
    """Slip of motions whose rows are late, as far as predictions at the start values show it."""
    problem.begin()
    motions = []
    with suppress(ContinuumGraspError):
        predictions = problem.predict(np.array([unknown.start for unknown in problem.unknowns]))[0]
        for block, part, _ in problem.parts:
            of = block.measured
            if of.moves and not block.own:  # which begins at its first row, wherever that is in time
                motions.append((of.at, of.values, predictions[part].reshape(of.values.shape)))
    slip = late(motions)
    return [] if slip is None else [slip]


def _refitted(words: str, trial: FitProblem, before: float) -> list[tuple[float, str]]:
    """Misfit without a slip, and what to say of it; nothing where it does not explain the measurements."""
    trial.begin()
    try:
        values = np.array([unknown.start for unknown in trial.unknowns])
        predictions = trial.predict(values)[0]
        if trial.sought:
            values, predictions, *_ = trial.solve(lambda share: None)
    except ContinuumGraspError:
        return []
    left = misfits(trial, predictions)
    # values of nearly zero are met by any stiff finger
    missed = [m for m in left if m.limit < math.inf and m.rms > min(m.limit, _UNEXPLAINED * m.scatter)]
    if missed or _total(left) * _BETTER >= before:
        return []
    pairs = zip(trial.unknowns, values, strict=True)
    shifts = ", ".join(f"{u.name} {value:.3g} {u.unit}" for u, value in pairs if u.name in _BASE)
    by = f" ({shifts} off)" if shifts else ""
    worst = max(left, key=lambda misfit: misfit.rms / misfit.limit)
    return [(_total(left), f"{words}{by}: undone, the model is off by {worst.rms:.3g} {worst.unit} r.m.s.")]


def _undone(
    block: MeasuredBlock, slip: PossibleMistake, data: Data, scene: Scene, sought: Sequence[Unknown]
) -> MeasuredBlock:
    """The block without a slip; its model is the block's where predictions do not depend on the change."""
    factors = {name: factor for name, (to, factor) in slip.columns.items() if name == to}
    if not factors or factors.keys() - _MEASURED or (isinstance(data, TipPath) and data.start != "scene"):
        return block.again(sought, data=data, scene=scene)
    changed = copy(block)
    of = block.measured
    changed.measured = replace(of, values=of.values * [factors.get(column.quantity, 1.0) for column in of.columns])
    return changed


def _total(left: Sequence[Misfit]) -> float:
    """Misfit of all kinds and sets, per plausible misfit."""
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean([(misfit.rms / misfit.limit) ** 2 for misfit in left])))
