"""Compare a finger with measurements, and estimate parameters of it from them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, cast

import numpy as np

from continuum_grasp.addons.identification.blocks import MeasuredBlock
from continuum_grasp.addons.identification.comparison import Comparison
from continuum_grasp.addons.identification.data import Data, Poses, TipPath
from continuum_grasp.addons.identification.data_files import folder_of
from continuum_grasp.addons.identification.doubts import doubts, doubts_of_elements
from continuum_grasp.addons.identification.fit import Fit, estimates
from continuum_grasp.addons.identification.lost import lost_of
from continuum_grasp.addons.identification.path_block import block_of, of_one_code
from continuum_grasp.addons.identification.plausibility import (
    IMPLAUSIBLE,
    doubts_of_data,
    explain,
    judge,
    questionable,
    too_far,
)
from continuum_grasp.addons.identification.problem import FitProblem, Solution
from continuum_grasp.addons.identification.read import read_data
from continuum_grasp.addons.identification.read_sets import changed_at, plain_scene
from continuum_grasp.addons.identification.scene import Estimate, IdentifyScene
from continuum_grasp.addons.identification.searches import LawTrial, choose_law, may_be_local, restarted
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.base import InputError, NumericalError, SolverError, check_arguments, interruptible
from continuum_grasp.scene import Scene, scene_of
from continuum_grasp.simulation import resolve_fidelity

Measurements = str | PathLike[str] | Data | Sequence[str | PathLike[str] | Data]


@interruptible()
@check_arguments
def identify(
    scene: Scene | str | PathLike[str],
    data: Measurements = (),
    *,
    parameters: Sequence[Estimate | str] | None = None,
    accept_implausible: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Estimate parameters of a scene by least squares through its model.

    Shapes at rest, paths of the tip, and frequencies with decay rates may be given together. Predictions come from the
    finger's model, derivatives from CasADi: by the implicit function theorem for shapes at rest, by the derivative of
    an eigenvalue for vibrations, by the variational equations for paths.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file; ``estimate`` and ``data`` of an `IdentifyScene` name parameters and
        files.
    data : path-like, Poses, TipPath, or a sequence of these
        Measurements: CSV files, folders of them, or arrays; by default the files that the configuration names,
        beside it or in the data folder.
    parameters : sequence of Estimate or str, optional
        Parameters to estimate; by default the scene's ``estimate``.
    accept_implausible : bool
        Whether the estimates may be used although the finger cannot have these measurements.
    progress : callable, optional
        Called with the share done so far, 0 to 1.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        If scene, parameters or data are wrong or do not fit together.
    SolverError
        If the search does not converge, or the model has no shape or motion at the start. Where a slip in the data
        explains that, the status is ``implausible``.

    Examples
    --------
    The bending stiffness M L / bend of a rod from its bends [rad] under moments at its tip [N m]:

    >>> import continuum_grasp as cg
    >>> from continuum_grasp.addons.identification import Poses, Reading
    >>> scene = cg.Scene(
    ...     finger={"rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.005}},
    ...     gravity=(0.0, 0.0),
    ... )
    >>> poses = Poses([Reading("bend", [0.33, 0.67, 1.0])], {"tip_moment": [0.01, 0.02, 0.03]})
    >>> fit = cg.identify(scene, poses, parameters=["bending_stiffness"])
    >>> round(fit["bending_stiffness"], 4)
    0.006
    """
    started = perf_counter()
    report = progress or (lambda share: None)
    laws = tuple[LawTrial, ...]()
    known, beside = scene_of(scene), folder_of(scene)
    if parameters is None and isinstance(known, IdentifyScene) and known.laws:
        names = [law.name for law in known.laws]
        plain = cast(IdentifyScene, resolved(known)[0])
        ways = [posed(variant, data, variant.estimate, beside) for variant in under_laws(plain)]
        tried = dict(zip(names, ways, strict=True))
        chosen, solution, laws = choose_law({name: fit.problem for name, fit in tried.items()}, report)
        task = tried[chosen]
    else:
        sought = getattr(known, "estimate", ()) if parameters is None else parameters
        task = posed(known, data, sought, beside)
        solution = _solved(task.problem, report)
    statistics = {
        "iterations": solution.iterations,
        "evaluations": solution.evaluations,
        "total_s": perf_counter() - started,
        **task.reported,
    }
    return _fit(task, solution, accepted=accept_implausible, laws=laws, statistics=statistics)


def _solved(problem: FitProblem, report: Callable[[float], None]) -> Solution:
    """The parameters; where they are not found, and a slip in the data explains that, the error says so."""
    try:
        return problem.solve(report)
    except (SolverError, NumericalError) as error:
        solution = restarted(problem, None)
        if solution is not None:
            return solution
        causes = explain(problem)
        if not causes:
            raise
        text = f"the parameters were not found; likely cause: {' or '.join(causes)}"
        advice = "correct the data or the scene; or start nearer to the values, where these are right"
        raise SolverError(text, status=IMPLAUSIBLE, advice=advice) from error


def under_laws(scene: IdentifyScene) -> Iterator[IdentifyScene]:
    for k, law in enumerate(scene.laws):
        plain = changed_at(scene.model_copy(update={"laws": ()}), law.set, f"laws[{k}].set")
        yield plain.replaced(estimate=(*scene.estimate, *law.estimate))


@interruptible()
@check_arguments
def compare(
    scene: Scene | str | PathLike[str],
    data: Measurements = (),
    *,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Simulate the measured experiments, and compare: shapes at rest, paths, frequencies, forces of drives.

    It estimates nothing except starts of motions, from their first samples.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file. Where its ``data`` do not say how files are read, their headings do: ``t``, ``x``,
        ``y``, ``angle``, ``at``, ``frequency``, ``mode``, and names of inputs and loads of the model, with units.
    data : path-like, Poses, TipPath, or a sequence of these
        Measurements: tables, folders of them, or arrays; by default the files that the configuration names,
        beside it or in the data folder.
    progress : callable, optional
        Called with the share done so far, 0 to 1.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If scene or data are wrong, or do not fit together.
    SolverError, NumericalError
        If the scene has no equilibrium or motion under the conditions of the data.

    Examples
    --------
    Bends [rad] of a rod under moments at its tip [N m], against M L / (E I):

    >>> import continuum_grasp as cg
    >>> from continuum_grasp.addons.identification import Poses, Reading
    >>> scene = cg.Scene(
    ...     finger={"rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.005}},
    ...     gravity=(0.0, 0.0),
    ... )
    >>> found = cg.compare(scene, Poses([Reading("bend", [0.41, 0.79])], {"tip_moment": [0.01, 0.02]}))
    >>> [round(float(bend), 2) for bend in found.residuals]
    [-0.01, 0.01]
    """
    started = perf_counter()
    task = posed(scene_of(scene), data, None, folder_of(scene), progress)
    problem = task.problem
    start = np.array([unknown.start for unknown in problem.unknowns])
    beyond = too_far(problem, start, np.array([column.sigma or 0.0 for column in problem.described]))
    predictions = problem.predict(start)[0]
    predicted = problem.predicted(start, predictions)
    warned = problem.warnings(start)
    followed = problem.followed
    slips = () if task.lost else doubts_of_data(problem, predictions)
    problem.followed = followed  # slips are tried elsewhere
    return Comparison(
        **predicted,
        scene=task.scene,
        warnings=(
            *task.notes,
            *warned,
            *([f"{beyond}: check units and axes of the data"] if beyond else ()),
            *slips,
        ),
        statistics={"total_s": perf_counter() - started, **task.reported},
    )


class Task(NamedTuple):
    """Task of an estimation: the scene, the problem of all sets of data, and what results report of both.

    ``reported`` states the choice of the fidelity and the unused columns of the files; ``notes`` are warnings about the
    data, ``lost`` the warnings about enough lost readings to explain misfits.
    """

    scene: Scene
    problem: FitProblem
    reported: dict[str, str]
    notes: tuple[str, ...]
    lost: tuple[str, ...]


def posed(
    scene: Scene,
    data: Measurements,
    sought: Sequence[Estimate | str] | None,
    beside: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Task:
    """Read what `identify` is given, in the folder of the scene's file; arguments and errors are its own.

    Nothing is ``sought`` where only predictions are asked for.
    """
    scene, note = resolved(scene)
    unknowns = [] if sought is None else read_unknowns(scene, sought)
    paths, arrays = sources_of(data)
    blocks = list[MeasuredBlock]()
    # those in files come first; the files that the scene names where nothing is given
    pairs = arrays if arrays and not paths else [*read_data(scene, paths, beside=beside), *arrays]
    if not pairs:
        raise InputError("expected measurements, got none", key="data")
    scenes = of_one_code([(resolved(pair.scene or scene)[0], pair) for pair in pairs], unknowns)
    for own, pair in zip(scenes, pairs, strict=True):
        blocks.append(block_of(own, pair, unknowns))
        if progress is not None:
            progress(len(blocks) / len(pairs))
    unread = "; ".join(text for pair in pairs for text in pair.unread)
    reported = {key: text for key, text in (("fidelity", note), ("unread", unread)) if text}
    lost = [each for pair in pairs for each in lost_of(pair)]
    notes = dict.fromkeys([*(text for pair in pairs for text in pair.notes), *(each.text for each in lost)])
    causes = dict.fromkeys(each.text for each in lost if each.explain_misfits)
    return Task(scene, FitProblem(blocks, unknowns), reported, tuple(notes), tuple(causes))


def resolved(scene: Scene) -> tuple[Scene, str]:
    """The scene with a model in place of a tolerance, and what was chosen and why."""
    chosen, note = resolve_fidelity(plain_scene(scene))
    return scene.model_copy(update={"fidelity": chosen.fidelity}), note


def sources_of(data: Measurements) -> tuple[list[Path], list[Data]]:
    """Files and folders of measurements, and those that are given as arrays."""
    sources = data if isinstance(data, Sequence) and not isinstance(data, str) else [data]
    paths = [Path(source) for source in sources if isinstance(source, (str, os.PathLike))]
    return paths, [source for source in sources if isinstance(source, (Poses, TipPath))]


def _credible(problem: FitProblem, solution: Solution) -> tuple[Solution, list[str]]:
    """The solution, and the evidence of its residuals against data and laws; where it has any, the best from other
    starts: a local minimum says nothing about the data.
    """
    for restarts in (True, False):
        evidence = doubts(problem, solution, problem.inferred(solution).inference)
        accused = questionable(problem, solution) or (evidence and may_be_local(problem, solution))
        if not restarts or not accused:
            break
        better = restarted(problem, solution)
        if better is None or better is solution:
            break
        solution = better
    return solution, evidence


def _fit(task: Task, solution: Solution, **further: Any) -> Fit:
    """The result: estimates, and how far they can be trusted."""
    problem = task.problem
    unknowns, shared = problem.unknowns, problem.shared
    solution, evidence = _credible(problem, solution)
    inferred = problem.inferred(solution)
    inference = inferred.inference
    doubted = doubts_of_elements(problem, solution, inferred)
    followed = problem.followed
    verdict = judge(problem, solution, task.lost)
    problem.followed = followed  # slips are tried elsewhere
    return Fit(
        **estimates(unknowns[:shared], solution.values, inference),
        set_names=tuple(f"{unknown.name} [{unknown.unit}]" for unknown in unknowns[shared:]),
        set_values=solution.values[shared:],
        set_deviations=inference.deviations[shared:],
        sigma=solution.sigma,
        **problem.predicted(solution.values, solution.predictions),
        scene=task.scene,
        status=IMPLAUSIBLE if verdict.reason else "converged",
        reason=verdict.reason,
        causes=verdict.causes,
        warnings=(
            *task.notes,
            *inference.warnings,
            *problem.warnings(solution.values),
            *evidence,
            *doubted,
            *verdict.warnings,
        ),
        **further,
    )
