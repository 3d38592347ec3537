"""Evidence against normal, independent residuals, on which intervals rest, and against the laws of the model.

Outliers, residuals that are correlated or scatter otherwise than stated, sets that differ, and hold-outs that are
missed are found by tests of their own; of the elements, twice as many are tried. For what a wrong law of
material or damping leaves, or a slip in the data, one Gauss-Newton step is taken towards a model with further
parameters (a score test; C. R. Rao, 1948), so that all samples count by their noise: quadratic damping of motions, a
stiffness that depends on the bend, a friction with memory by which shapes at rest depend on the direction of loading,
rows that are late, an origin that is elsewhere. The surest one is named, and others of its kind, law or data, are
tested beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.data import KIND_OF, Data
from continuum_grasp.addons.identification.inference import FALSE_ALARMS, Inference, correlated, surely
from continuum_grasp.addons.identification.numbers import MeasuredColumn
from continuum_grasp.addons.identification.path_block import of_one_code
from continuum_grasp.addons.identification.problem import FitProblem, Inferred, Solution
from continuum_grasp.addons.identification.unknowns import Unknown, read_unknowns
from continuum_grasp.base import Array, ContinuumGraspError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import refined

Further = tuple[Unknown, Array]

_LEAST = 4
"""Least rows of each way of loading [1]."""
_FEW = 60
"""Residuals from which the median tells outliers [1]: of fewer its own scatter asks for 5 to 15 deviations."""
_MATTERS = 1e-3
"""Least change of predictions that is named, per scatter of the readings about their means [1]: a tenth of what models
of real fingers are off, and ten times what two integrators differ by."""
_MOST = 12
"""Elements beyond which a model is not refined to see its error: twice as many take far longer than the search."""
_WIDTH = "width"
"""Target of half the width of a loop of one reading."""
_LATE, _BEFORE, _ORIGIN = "late", "before", "origin"
"""Targets of times by which rows of motions are late, in samples; of readings of another row; of what positions are
off along an axis [m]."""
_SHORTENING = "shortening"
"""Target of the squared radius of gyration by which tensions shorten a finger, per square of a typical one [1]."""
_SLIPS = (_LATE, _BEFORE, _ORIGIN)


def doubts(problem: FitProblem, solution: Solution, inference: Inference, *, laws: bool = True) -> list[str]:
    """Evidence against normal, independent residuals, on which intervals rest, and against ``laws`` of the model."""
    weighted = (solution.predictions - problem.measured) / solution.sigma
    leverage = problem.leverage(solution.jacobian, solution.sigma)
    return [
        *(_outliers(problem, weighted, inference.freedom, leverage) if inference.freedom >= 5 else ()),
        *_stated(problem, weighted, leverage),
        *_correlated(problem, weighted),
        *_sets(problem, weighted),
        *_missed(problem, solution, inference),
        *(doubts_of_laws(problem, solution) if laws else ()),
    ]


def _missed(problem: FitProblem, solution: Solution, inference: Inference) -> list[str]:
    """Hold-outs that are missed by more than noise and uncertain parameters allow, even where all errors are one."""
    messages = []
    missed = solution.predictions - problem.measured
    lost = np.isinf(inference.deviations)
    if problem.fitted.all() or inference.freedom <= 0.0:
        return []
    covariance = inference.correlation * np.outer(inference.deviations, inference.deviations)
    # what a hold-out has of its own was sought in it; a parameter that no row shows may be anything
    slopes = solution.jacobian.copy()
    unknown = lost & (np.arange(lost.size) < problem.shared)
    blind = np.asarray(slopes[:, unknown].any(axis=1))
    slopes[:, lost] = 0.0
    covariance[lost] = 0.0
    covariance[:, lost] = 0.0
    variance = solution.sigma**2 + np.einsum("mi,ij,mj->m", slopes, covariance, slopes)
    # Of groups whose scatter is known: from what was fitted of them, or as it is stated.
    known = {}
    for group, members in problem.groups.items():
        is_stated = any(problem.described[k].sigma for k in np.flatnonzero(members))
        if is_stated or (members & problem.fitted).any():
            known[group] = members
    groups = []
    for of, rows in zip(problem.sets, problem.slices, strict=True):
        held_out = ~problem.fitted[rows] & ~blind[rows]
        for group, members in known.items():
            part = np.flatnonzero(members[rows] & held_out) + rows.start
            if part.size:
                groups.append((of.name, group, part))
    for name, group, part in groups:
        by, off = (float(np.sqrt(np.mean(v[part] ** 2))) for v in (missed / np.sqrt(variance), missed))
        if by > surely(inference.freedom, len(groups)) and off > _MATTERS * float(np.std(problem.measured[part])):
            unit = problem.described[part[0]].unit
            messages.append(
                f"{name}: {group} that were held out are missed by {off:.2g} {unit} r.m.s., {by:.2g} times what noise "
                "and intervals allow: the model does not predict what it was not fitted to; the intervals hold for "
                "what was fitted alone"
            )
    return messages


def _outliers(problem: FitProblem, weighted: Array, freedom: float, leverage: Array | float = 0.0) -> list[str]:
    """Fitted entries far from what the rest says, by their studentized residuals: a parameter follows few numbers."""
    sizes = np.abs(weighted[problem.fitted])
    # 1e-6: least variance that a residual has of its noise [1]; what is met whatever it is, tells nothing
    left = 1.0 - np.asarray(leverage)
    weighted = np.where(left > 1e-6, weighted / np.sqrt(np.maximum(left, 1e-6)), 0.0)
    if sizes.size < _FEW:  # each against the others, of which one may be far off
        limit = surely(freedom - 1.0, chances=sizes.size)
        scale = np.sqrt((sizes @ sizes - weighted**2).clip(0.0) / (freedom - 1.0))
    else:
        # 0.37: degrees of freedom of the median of absolute residuals per residual: its efficiency for normal noise (P.
        # J. Rousseeuw, C. Croux, 1993, doi:10.1080/01621459.1993.10476408).
        limit = surely(0.37 * sizes.size, chances=sizes.size)
        scale = np.full(len(weighted), 1.4826 * np.median(sizes))  # which outliers do not raise
    far = np.flatnonzero(problem.fitted & (np.abs(weighted) > limit * scale.clip(1e-300)))
    if not far.size:
        return []
    worst = problem.labels[int(far[np.argmax(np.abs(weighted[far]))])]
    return [f"{far.size} of {int(problem.fitted.sum())} residuals beyond {limit:.2g} deviations, worst: {worst}"]


def _stated(problem: FitProblem, weighted: Array, leverage: Array) -> list[str]:
    """Groups whose residuals surely scatter otherwise than stated: weights are then wrong."""
    messages = []
    known = np.array([of.sigma is not None for of in problem.described]) & problem.fitted
    for group, members in problem.groups.items():
        used = members & known
        freedom = max(float(np.sum(1.0 - leverage[used])), 1e-9)
        ratio = math.sqrt(max(float(np.sum(weighted[used] ** 2)), 1e-300) / freedom)
        # 2.0: factor up to which deviations are stated by round numbers, and intervals are off by less; the logarithm
        # of a scatter has the variance 1 / (2 freedom)
        if abs(math.log(ratio)) > max(math.log(2.0), surely(chances=len(problem.groups)) / math.sqrt(2.0 * freedom)):
            why = "the model misses something, or there is more noise" if ratio > 1.0 else "there is less noise"
            messages.append(
                f"{group}: residuals scatter by {ratio:.2g} times the stated deviation: {why}; weights of unlike "
                "quantities, and intervals, are wrong where sigma is"
            )
    return messages


def _sets(problem: FitProblem, weighted: Array) -> list[str]:
    """Groups whose sets differ by more than their own scatter: repeats of one set are then not independent."""
    from scipy.stats import f_oneway

    messages = []
    which = np.repeat(np.arange(len(problem.sets)), [of.values.size for of in problem.sets])
    # instants of a path are no repeats; `_correlated` judges them
    still = np.array([not of.moves for of in problem.sets])[which]
    for group, numbers in problem.groups.items():
        members = problem.fitted & still & numbers
        sets = [weighted[members & (which == k)] for k in np.unique(which[members])]
        sets = [rows for rows in sets if rows.size > 2]
        if len(sets) < 2:
            continue
        ratio, probability = f_oneway(*sets)
        if probability < FALSE_ALARMS:
            messages.append(
                f"{group}: the sets differ by more than their repeats do (ratio of variances {ratio:.0f}): "
                "repeats are not independent, and the intervals are too narrow; trust the hold-out error"
            )
    return messages


def _correlated(problem: FitProblem, weighted: Array) -> list[str]:
    """Sets whose residuals follow one another alike: then they are the model's error rather than noise."""
    messages = []
    sets = sum(of.ordered for of in problem.sets)
    for of, rows in zip(problem.sets, problem.slices, strict=True):
        residuals = weighted[rows].reshape(of.values.shape)[of.fitted]
        # 30: rows from which the correlation is tested; its deviation, 1 / sqrt(rows), holds for long series
        if not of.ordered or len(residuals) < 30:
            continue
        last, sure = correlated(residuals)
        if sure > surely(chances=sets * int(math.log2(len(residuals) / 2))):
            span = f"over {last} instants" if of.moves else f"over {last} rows"
            messages.append(
                f"residuals of {of.name} are correlated in time ({span}, {sure:.0f} deviations): the model misses "
                "an effect; the intervals count it as noise, but estimates may be off by more; more elements show "
                "whether it is the family's own error"
            )
    return messages


def doubts_of_elements(problem: FitProblem, solution: Solution, inferred: Inferred) -> list[str]:
    """Parameters that a model with twice the elements would move by more than their deviations, all that are
    ``inferred``; none where such a model is not feasible.
    """
    finer = np.zeros(len(problem.measured))
    for block, rows, mix in problem.parts:
        model = FingerModel(block.scene)
        # the start that was estimated is in coordinates of the coarser one
        if len(model.lengths) > _MOST or block.own:
            return []
        try:
            again = block.again(problem.sought, scene=refined(block.scene, model), by=())
            finer[rows] = again.predict(mix @ solution.values)[0]
        except ContinuumGraspError:  # a finer model can be too stiff for the way a path is followed
            return []
    change = ((solution.predictions - finer) / solution.sigma)[problem.fitted]
    # a Gauss-Newton step of the finer model, by the coarse one's Jacobian: the error of that is of higher order
    moved = np.linalg.lstsq(inferred.jacobian[: len(change)], change, rcond=None)[0]
    rows_of = zip(inferred.unknowns, moved, np.abs(moved) / inferred.inference.deviations.clip(1e-300), strict=True)
    parts = [f"{unknown.name} by {by:.2g} ({share:.1f} deviations)" for unknown, by, share in rows_of if share > 1.0]
    why = "the intervals leave the model's own error out; take more elements"
    return [f"twice the elements would move {', '.join(parts)}: {why}"] if parts else []


def doubts_of_laws(problem: FitProblem, solution: Solution) -> list[str]:
    """Evidence of the residuals against the laws of stiffness, damping and memory that the model has."""
    further: list[Further] = []
    for name in ("quadratic_damping", "softening_ratio"):
        # A law that is estimated already, or that this finger cannot have, is not tried.
        with suppress(ContinuumGraspError):
            further += _of_law(name, problem, solution)
    with suppress(ContinuumGraspError):
        further += _shortening(problem, solution)
    further += _widths(problem, solution.predictions)
    further += _slips(problem, solution.predictions)
    readings = [rows for *_, rows in _shapes(problem)]
    about = [(problem.measured[rows] - problem.measured[rows].mean()) / solution.sigma[rows] for rows in readings]
    least = _MATTERS * float(np.linalg.norm(np.concatenate([*about, [0.0]])))
    named = list[Further]()
    doubts = list[str]()
    chances = len(further)  # all make one verdict together
    while further:
        judged = [_judged(problem, solution, [*named, candidate], least, chances) for candidate in further]
        k = max(range(len(further)), key=lambda k: judged[k][0])
        share, step, deviation = judged[k]
        if share <= 1.0:
            break
        chosen = further[k]
        doubts.append(_words(problem, chosen[0], step, deviation))
        named.append(chosen)
        # Where data are wrong, laws cannot be judged, and either leaves residuals of the other kind.
        kind = _kind(chosen)
        further = [candidate for candidate in further if candidate is not chosen and _kind(candidate) == kind]
    return doubts


def _kind(further: Further) -> str:
    return further[0].target if further[0].target in _SLIPS else "law"


def _judged(
    problem: FitProblem, solution: Solution, further: Sequence[Further], least: float, chances: int
) -> tuple[float, float, float]:
    """Judgment of the last parameter: step per what noise makes of it, 0 where it matters less than ``least``; step;
    deviation.
    """
    (*_, unknown), values, jacobian, inference = problem.inferred(solution, *further)
    step = float(values[-1])
    deviation = float(inference.deviations[-1])
    others = jacobian[:, :-1]
    effect = step * jacobian[:, -1]
    beyond = effect - others @ np.linalg.lstsq(others, effect, rcond=None)[0]
    if unknown.target == _SHORTENING and step < 0.0:  # nothing lengthens under tension
        return 0.0, 0.0, 0.0
    if unknown.target == _BEFORE and round(step) != 1:  # there is no row between two
        return 0.0, 0.0, 0.0
    sure = float(surely(inference.freedom, chances) * deviation)
    matters = math.isfinite(sure) and float(np.linalg.norm(beyond)) > least
    return abs(step) / max(sure, 1e-300) if matters else 0.0, step, deviation


_LAWS = {
    "softening_ratio": (
        "stiffness",
        ("softening", "stops"),
        "it stiffens where it is bent far",
        "it softens where it is bent far, which dry friction does, too, that sticks before it slips",
    ),
    "quadratic_damping": (
        "damping",
        ("dry friction", "tendon friction", "drag"),
        "large swings lose more of it, as the drag of the air makes them",
        "small swings lose more of it, as dry friction makes them, of the bending or in the tendons",
    ),
}
"""Laws that are tried, by the number of each: their subject, laws beside the linear one that the model may have, and
the fault if the number comes out greater, and less."""


def _words(problem: FitProblem, further: Unknown, step: float, deviation: float) -> str:
    if further.target in _SLIPS:
        cause = "their times or conditions differ from the scene's"
        if further.target == _ORIGIN:
            cause = "their origin differs from the scene's, or finger.base.position is elsewhere"
            if any(block.scene.finger.gyration_radius and any(block.scene.gravity) for block in problem.blocks):
                cause += ", or its weight lengthens a soft finger, which the model leaves out"
        return f"{further.name} by {step:.3g} +/- {deviation:.2g} {further.unit}: {cause}"
    estimated = {unknown.target for unknown in problem.unknowns}
    fingers = [block.scene.finger for block in problem.blocks]
    there = {
        "softening": any(finger.softening is not None for finger in fingers),
        "stops": any(finger.stops is not None for finger in fingers),
        "dry friction": any(finger.damping.dry_friction for finger in fingers),
        "tendon friction": "tendon_friction" in estimated or any(finger.has_tendon_friction for finger in fingers),
        "drag": "quadratic_damping" in estimated or any(finger.damping.quadratic > 0.0 for finger in fingers),
    }
    if further.target == _WIDTH:
        friction = there["dry friction"] or there["tendon friction"]
        memory = "of another law than the model's" if friction else "which the model does not have"
        width = f"by {2.0 * abs(step):.2g} {further.unit}"
        return f"rows depend on the direction of loading, {width}: friction with memory, {memory} ({further.name})"
    if further.target == _SHORTENING:
        radius = further.typical * math.sqrt(max(step, 0.0))
        sure = 0.5 * radius * deviation / max(step, 1e-300)
        return (
            "the finger shortens with the sum of its tensions, as soft ones do: set finger.gyration_radius, "
            f"{radius:.2g} +/- {sure:.1g} m by the residuals, or estimate it"
        )
    what, beside, greater, less = _LAWS[further.target]
    has = [name for name in beside if there[name]]
    law = f"the law of {what} with {' and '.join(has)}" if has else f"a linear law of {what}"
    off = f"{further.name} is off by {step:.2g} +/- {deviation:.2g} {further.unit}"
    return f"{law} does not fit: {less if step < 0.0 else greater} ({off})"


def _shapes(problem: FitProblem) -> list[tuple[int, MeasuredColumn, NDArray[np.intp]]]:
    """Number of the set, and fitted numbers (R,), of each reading of the shape."""
    columns = [(k, of, rows[problem.fitted[rows]]) for k, of, rows in problem.by_column if of.quantity in KIND_OF]
    return [(k, of, rows) for k, of, rows in columns if rows.size]


def _shortening(problem: FitProblem, solution: Solution) -> list[Further]:
    """Change (m,) of the shapes of fingers on tendons whose tensions shorten them like a section such as theirs."""
    slope = np.zeros(len(problem.measured))
    radius = 0.0
    for k in dict.fromkeys(k for k, *_ in _shapes(problem)):
        block, part, mix = problem.parts[k]
        finger = block.scene.finger
        if not finger.tendons or finger.gyration_radius is not None:
            continue
        # 0.5: radius of gyration per half the thickness of a round section
        size = finger.half_thickness or max(tendon.greatest_offset for tendon in finger.tendon_list)
        radius = radius or 0.5 * size
        shorter = block.scene.changed({"finger.gyration_radius": radius})
        moved = block.again(problem.sought, scene=shorter, by=()).predict(mix @ solution.values)[0]
        slope[part] = moved - solution.predictions[part]
    return [(Unknown("shortening", "1", _SHORTENING, typical=radius), slope)] if slope.any() else []


def _widths(problem: FitProblem, predictions: Array) -> list[Further]:
    """Half the width of a loop of each reading that was loaded and unloaded at rest."""
    widths = []
    for k, column, rows in _shapes(problem):
        if problem.sets[k].moves or len(rows) < 2 * _LEAST:
            continue
        way = np.sign(np.gradient(predictions[rows]))
        slope = np.zeros(len(predictions))
        if min(np.sum(way > 0), np.sum(way < 0)) >= _LEAST:
            slope[rows] = way
            size = float(np.ptp(predictions[rows]))
            widths.append((Unknown(column.name, column.unit, _WIDTH, typical=size), slope))
    return widths


def _slips(problem: FitProblem, predictions: Array) -> list[Further]:
    """By how many samples rows of motions are late; whether readings belong to the row before or behind; offsets of
    the positions of all sets along the axes.
    """
    motions, before, behind = np.zeros((3, len(predictions)))
    for block, part, _ in problem.parts:
        t = block.measured.at
        rows = predictions[part].reshape(block.measured.values.shape)
        moves = block.measured.moves
        if moves and not (block.free and block.own):  # which begins at its first row, wherever that is in time
            motions[part] = -(np.gradient(rows, t, axis=0) * np.gradient(t)[:, None]).ravel()
        elif not moves:
            before[part] = (np.vstack([rows[:1], rows[:-1]]) - rows).ravel()
            behind[part] = (np.vstack([rows[1:], rows[-1:]]) - rows).ravel()
    along = [np.array([float(column.quantity == axis) for column in problem.described]) for axis in "xy"]
    slips = [
        (Unknown("rows of motions are late", "samples", _LATE), motions),
        (Unknown("readings belong to the row before their conditions,", "rows", _BEFORE), before),
        (Unknown("readings belong to the row behind their conditions,", "rows", _BEFORE), behind),
        *((Unknown(f"positions are off along {k}", "m", _ORIGIN), of) for k, of in zip("xy", along, strict=True)),
    ]
    return [(unknown, slope) for unknown, slope in slips if slope.any()]


def _of_law(name: str, problem: FitProblem, solution: Solution) -> list[Further]:
    """A parameter of a law, and the derivative (m,) of shapes by it, where the law has no effect yet."""
    slope = np.zeros(len(problem.measured))
    count = len(problem.sought)
    unknown = list[Unknown]()
    ranges = dict[int, list[float]]()
    for k, column, rows in _shapes(problem):
        if problem.sets[k].moves or name == "softening_ratio":
            per = problem.blocks[k].scene.finger.rod.length if column.unit == "m" else 1.0
            ranges.setdefault(k, []).append(float(np.ptp(problem.measured[rows])) / per)
    pairs = list[tuple[Scene, Data]]()
    starts = list[float]()
    for k, sizes in ranges.items():
        scene = problem.blocks[k].scene
        added = name == "softening_ratio" and scene.finger.softening is None
        if added:
            # From half of the greatest curvature on, as the range of the readings says; the derivative at a ratio of 1.
            bent = {"curvature": 0.5 * max(sizes) / scene.finger.rod.length, "stiffness_ratio": 0.5}
            scene = scene.changed({"finger.softening": bent})
        unknown = read_unknowns(scene, [name])
        pairs.append((scene, problem.blocks[k].data))
        starts.append(1.0 if added else unknown[0].start)
    sought = [*problem.sought, *unknown]
    for k, start, scene in zip(ranges, starts, of_one_code(pairs, sought) if pairs else (), strict=True):
        block, part, mix = problem.parts[k]
        at = np.insert(mix @ solution.values, count, start)
        slope[part] = block.again(sought, scene=scene, by=[count]).predict(at)[1][:, 0]
    return [(candidate, slope) for candidate in unknown]
