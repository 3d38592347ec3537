"""Estimate parameters of a finger from measurements."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp import interrupt
from continuum_grasp.errors import ContinuumGraspError, InputError
from continuum_grasp.identification.blocks import Block, PosesBlock, VibrationBlock
from continuum_grasp.identification.data import Data, Frequencies, Poses, TipPath
from continuum_grasp.identification.fit import Fit
from continuum_grasp.identification.inference import infer, model_error_warnings, refined
from continuum_grasp.identification.path_block import PathBlock
from continuum_grasp.identification.problem import Problem, Solution
from continuum_grasp.identification.read import read_data
from continuum_grasp.identification.unknowns import Unknown, read_unknowns
from continuum_grasp.scene.identify import Estimate, IdentifyScene
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.simulate import Scene

Array = NDArray[np.float64]
Measurements = str | PathLike[str] | Data | Sequence[str | PathLike[str] | Data]

_SIGNIFICANT = 2.5
"""Correlation of successive residuals, in standard deviations of that of noise [1], from which it is reported: noise
exceeds it in 0.6 % of paths."""
_SERIES = 30
"""Instants of a path from which the correlation is tested; its deviation, 1 / sqrt(instants), holds for long series."""
_APART = 8.0
"""Variance between sets of a group per variance within [1] from which it is reported: Fisher's ratio, which
two independent sets of six repeats exceed in 2 % of cases."""
_LITTLE = 0.6
"""Misfit per range of what was measured [1] from which it is reported: the best constant has 0.29 where measurements
are spread evenly, and 0.5 where half of them are at either end."""


@interrupt.listening()
def identify(
    scene: Scene | str | PathLike[str],
    data: Measurements,
    *,
    parameters: Sequence[Estimate | str] | None = None,
    loss: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Estimate parameters of a scene by least squares through its model.

    Shapes at rest, paths of the tip, and frequencies with decay rates may be given together. Predictions come from the
    finger's model, derivatives from CasADi: by the implicit function theorem for shapes at rest, by the derivative of
    an eigenvalue for vibrations, by the variational equations for paths.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file; ``estimate`` and ``data`` of an `IdentifyScene` are what to
        estimate and how to read files.
    data : path-like, Poses, TipPath, Frequencies, or a sequence of these
        Measurements: CSV files, folders of them, or arrays.
    parameters : sequence of Estimate or str, optional
        What to estimate; the scene's ``estimate`` where not given.
    loss : {"squares", "huber"}, optional
        The scene's, or squares, where not given.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        If scene, parameters or data are wrong or do not fit together.
    SolverError
        If the search does not converge, or the model has no shape or motion at the start.

    Examples
    --------
    The bending stiffness M L / bend of a rod from its bends [rad] under moments at its tip [N m]:

    >>> import continuum_grasp as cg
    >>> from continuum_grasp.identification import Poses, Reading
    >>> scene = cg.Scene(
    ...     schema_version=1,
    ...     finger={"rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.005}},
    ...     gravity=(0.0, 0.0),
    ... )
    >>> poses = Poses([Reading("bend", [0.33, 0.67, 1.0])], {"tip_moment": [0.01, 0.02, 0.03]})
    >>> fit = cg.identify(scene, poses, parameters=["bending_stiffness"])
    >>> round(fit["bending_stiffness"], 4)
    0.006
    """
    started = perf_counter()
    scene, note = _resolved(scene_of(scene))
    chosen = parameters if parameters is not None else getattr(scene, "estimate", ())
    used_loss = loss if loss is not None else getattr(scene, "loss", "squares")
    if used_loss not in ("squares", "huber"):
        raise InputError(f"expected squares or huber, got {used_loss!r}", key="loss")
    unknowns = read_unknowns(scene, chosen)
    given = [(one, _resolved(one.scene or scene)[0]) for one in _measurements(scene, data)]
    problem = Problem([_block(own, one, unknowns) for one, own in given], unknowns, used_loss)
    solution = problem.solve(progress or (lambda share: None))
    statistics = {
        "iterations": solution.iterations,
        "evaluations": solution.evaluations,
        "total_s": perf_counter() - started,
        **({"fidelity": note} if note else {}),
    }
    return _fit(scene, problem, solution, _finer(given, unknowns, solution.values), statistics)


def _finer(given: Sequence[tuple[Data, Scene]], unknowns: Sequence[Unknown], values: Array) -> Array | None:
    """Predictions (m,) of models with twice the elements; None where one of them is not feasible."""
    found = []
    for one, scene in given:
        fine = refined(scene)
        if fine is None:
            return None
        try:
            found.append(_block(fine, one, unknowns).predict(values)[0])
        except ContinuumGraspError:  # a finer model can be too stiff for the way a path is followed
            return None
    return np.concatenate(found)


def _resolved(scene: Scene) -> tuple[Scene, str]:
    """The scene with a model in place of a tolerance, and what was chosen and why."""
    if scene.fidelity.tolerance is None:
        return scene, ""
    from continuum_grasp.accuracy.choose import resolve_fidelity

    plain = Scene(**{name: getattr(scene, name) for name in Scene.model_fields})
    resolved, note = resolve_fidelity(plain)
    return scene.model_copy(update={"fidelity": resolved.fidelity}), note


def _measurements(scene: Scene, data: Measurements) -> list[Data]:
    """What is given, and what is in the files among it, which come first."""
    kinds, places = (Poses, TipPath, Frequencies), (str, os.PathLike)
    given = list(data) if isinstance(data, Sequence) and not isinstance(data, (*kinds, *places)) else [data]
    found: list[Data] = []
    paths = [Path(one) for one in given if isinstance(one, places)]
    if paths:
        if not isinstance(scene, IdentifyScene):
            raise InputError("files are read as the data of an identify configuration say; give arrays for a scene")
        found += read_data(scene, paths)
    for one in given:
        if isinstance(one, kinds):
            found.append(one)
        elif not isinstance(one, places):
            raise InputError(f"expected Poses, TipPath, Frequencies or a path, got {one!r:.60}", key="data")
    if not found:
        raise InputError("expected measurements, got none", key="data")
    return found


def _block(scene: Scene, data: Data, unknowns: Sequence[Unknown]) -> Block:
    if isinstance(data, Poses):
        return PosesBlock(scene, data, unknowns)
    if isinstance(data, Frequencies):
        return VibrationBlock(scene, data, unknowns)
    return PathBlock(scene, data, unknowns)


def _fit(scene: Scene, problem: Problem, solution: Solution, finer: Array | None, statistics: Mapping[str, Any]) -> Fit:
    fitted, sigma, unknowns = problem.fitted, solution.sigma, problem.unknowns
    weighted = (solution.predictions - problem.measured) / sigma
    jacobian = (solution.jacobian / sigma[:, None])[fitted]
    found = infer(unknowns, solution.values, jacobian, weighted[fitted], solution.inflation)
    doubted: tuple[str, ...] = ()
    if finer is not None:
        coarse, fine = ((part / sigma)[fitted] for part in (solution.predictions, finer))
        doubted = model_error_warnings(unknowns, found.deviations, jacobian, coarse, fine)
    shapes = [f"{block.name}: {one}" for block in problem.blocks for one in block.warnings(solution.values)]
    return Fit(
        names=tuple(one.name for one in unknowns),
        units=tuple(one.unit for one in unknowns),
        values=solution.values,
        deviations=found.deviations,
        intervals=found.intervals,
        correlation=found.correlation,
        singular_values=found.singular_values,
        freedom=found.freedom,
        entries=tuple(problem.entries),
        predictions=solution.predictions,
        sigma=sigma,
        blocks=tuple((block.name, len(block.entries)) for block in problem.blocks),
        targets=tuple((one.target, one.factor, one.added) for one in unknowns),
        scene=scene,
        warnings=(
            *found.warnings,
            *shapes,
            *_outliers(problem, weighted, found.freedom),
            *_series(problem, weighted),
            *_sets(problem, weighted),
            *_misfits(problem, solution.predictions),
            *doubted,
        ),
        statistics=statistics,
    )


def _outliers(problem: Problem, weighted: Array, freedom: int) -> list[str]:
    """Fitted entries far from what the rest says."""
    if freedom < 5:
        return []
    sizes = np.abs(weighted[problem.fitted])
    scale = 1.4826 * float(np.median(sizes))  # which outliers do not raise
    limit = max(4.0, 1.5 + math.sqrt(2.0 * math.log(sizes.size)))  # that normal noise rarely reaches
    far = np.flatnonzero(problem.fitted & (np.abs(weighted) > limit * max(scale, 1e-300)))
    if not far.size:
        return []
    first = problem.entries[int(far[np.argmax(np.abs(weighted[far]))])]
    return [f"{far.size} of {int(problem.fitted.sum())} residuals beyond {limit:.2g} deviations, worst: {first.label}"]


def _misfits(problem: Problem, predictions: Array) -> list[str]:
    """Groups of which the model explains little: wrong units, signs or conditions do that."""
    found = []
    for group, entries in problem.groups.items():
        members = problem.fitted & entries
        values = problem.measured[members]
        if values.size <= 2:  # which say nothing of a spread
            continue
        left, spread = float(np.sqrt(np.mean((predictions[members] - values) ** 2))), float(np.ptp(values))
        if spread > 0.0 and left > _LITTLE * spread:
            found.append(
                f"{group}: the model is off by {left:.2g} r.m.s. where the measurements spread over {spread:.2g}: "
                "check units, signs and conditions of the data"
            )
    return found


def _sets(problem: Problem, weighted: Array) -> list[str]:
    """Groups whose sets differ by more than their own scatter: repeats of one set are then not independent."""
    found = []
    which = np.repeat(np.arange(len(problem.blocks)), [len(block.entries) for block in problem.blocks])
    # instants of a path are no repeats; `_series` judges them
    still = np.array([not block.horizons for block in problem.blocks])[which]
    for group, entries in problem.groups.items():
        members = problem.fitted & still & entries
        sets = [weighted[members & (which == k)] for k in np.unique(which[members])]
        sets = [one for one in sets if one.size > 2]
        if len(sets) < 2:
            continue
        # one-way analysis of variance: Fisher's ratio
        count = sum(one.size for one in sets)
        mean = sum(float(one.sum()) for one in sets) / count
        between = sum(one.size * (one.mean() - mean) ** 2 for one in sets) / (len(sets) - 1)
        within = sum(float(np.sum((one - one.mean()) ** 2)) for one in sets) / (count - len(sets))
        if between > _APART * within:
            found.append(
                f"{group}: the sets differ by more than their repeats do (ratio of variances {between / within:.0f}): "
                "repeats are not independent, and the intervals are too narrow; trust the hold-out error"
            )
    return found


def _series(problem: Problem, weighted: Array) -> list[str]:
    """Paths whose residuals hang together: then they are the model's error rather than noise."""
    found, at = [], 0
    for block in problem.blocks:
        own = weighted[at : at + len(block.entries)]
        at += len(block.entries)
        count = sum(entry.at == block.entries[0].at for entry in block.entries)
        if not block.horizons or own.size < _SERIES * count:
            continue
        before, after = own[:-count] - own.mean(), own[count:] - own.mean()
        # of each coordinate with itself one instant later
        share = float(before @ after) / max(float(before @ before), 1e-300)
        if share > _SIGNIFICANT / np.sqrt(own.size):
            found.append(
                f"residuals of {block.name} hang together in time (correlation {share:.2f} from one instant to the "
                "next): the model misses something, and the intervals are too narrow; more elements show whether it is "
                "the family's own error"
            )
    return found
