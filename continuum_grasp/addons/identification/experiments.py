"""Experiments that show unknowns of a finger and its drives, and how well they show them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.blocks import MeasuredBlock, PosesBlock
from continuum_grasp.addons.identification.data import Reading, TipPath
from continuum_grasp.addons.identification.data_files import sets_of
from continuum_grasp.addons.identification.experiment_plan import POSES, SET, ExperimentPlan
from continuum_grasp.addons.identification.fit import applied
from continuum_grasp.addons.identification.fitting import Measurements, posed, resolved, sources_of
from continuum_grasp.addons.identification.inference import allotted, infer, information
from continuum_grasp.addons.identification.path_block import PathBlock
from continuum_grasp.addons.identification.problem import FitProblem, Progress, SetInProblem, Solution
from continuum_grasp.addons.identification.read import choices_of
from continuum_grasp.addons.identification.read_sets import plain_scene
from continuum_grasp.addons.identification.scene import (
    Column,
    DataSet,
    IdentifyScene,
    RowsEqual,
    StaticPoses,
    TipTrajectory,
)
from continuum_grasp.addons.identification.segments import CommandDesign, Excited, patterns_of
from continuum_grasp.addons.identification.unknowns import Unknown, prior, read_unknowns
from continuum_grasp.base import Array, InputError, check_arguments, interruptible
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Trajectory

_ABOUT, _TRIED = 0.2, 4
"""Change of the unknowns at which poses are tried as well, per typical size, and at how many such values [1]."""


@interruptible()
@check_arguments
def design_experiments(
    scene: IdentifyScene, data: Measurements = (), *, progress: Callable[[float], None] | None = None
) -> ExperimentPlan:
    """Design poses and commands from which the unknowns of a scene can be estimated.

    Poses are chosen among the ``choices`` of the conditions of each set of shapes at rest that has ``propose``. Where
    the scene has an ``excitation``, and drives, a motion is added: slow loops with an inner loop, steps and sweeps to
    each side, and of both tendons together, as far as ``reach`` of the limits allows; its first data of ``kind:
    trajectory`` name the logged quantities. Fisher's information of all readings gives the standard deviations of the
    unknowns before any measurement; the poses minimize the sum of the variances, relative to typical sizes.

    Parameters
    ----------
    scene : IdentifyScene
    data : path-like, Poses, TipPath, or a sequence of these
        Measurements so far: they are fitted first, and give the values at which the rest is designed, and standard
        deviations of readings that are not stated.
    progress : callable, optional
        Called with the share of this fit done so far, 0 to 1.

    Returns
    -------
    ExperimentPlan

    Raises
    ------
    InputError
        If there is nothing to design, or the deviation of a reading is not known.
    SolverError, NumericalError
        If the finger has no motion under the commands, or the measurements cannot be fitted.

    Examples
    --------
    Which weights show a stiffness and the angle of the clamp, of three weights that there are?

    >>> from continuum_grasp.addons.identification import IdentifyScene, design_experiments
    >>> scene = IdentifyScene(
    ...     finger={"rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.005}},
    ...     gravity=(0.0, 0.0),
    ...     loads=[{"kind": "force", "at": 0.2, "force": (0.0, 0.0)}],
    ...     fidelity={"family": "clothoid", "elements": 1},
    ...     estimate=[{"name": "bending_stiffness"}, {"name": "clamp_angle"}],
    ...     data=[
    ...         {
    ...             "kind": "static",
    ...             "propose": 2,
    ...             "conditions": [{"name": "load_1_x", "column": "F", "choices": [0.0, 0.05, 0.1]}],  # N
    ...             "measured": [{"quantity": "x", "column": "x", "sigma": 1e-3}],  # m
    ...         }
    ...     ],
    ... )
    >>> plan = design_experiments(scene)
    >>> plan.pose_headings, plan.pose_rows
    (('set', 'F', 'x'), (('data[0]', '0', ''), ('data[0]', '0.1', '')))
    """
    resolved_scene, _ = resolved(scene)
    scene = cast(IdentifyScene, resolved_scene)
    proposed, logged = _designed(scene)
    plain = plain_scene(scene)
    sought = read_unknowns(scene, scene.estimate)
    measured, sets = _measured(scene, data, progress or (lambda share: None))
    tables = [choices_of(data_set, plain, f"data[{k}]") for k, data_set in proposed]
    blocks: list[MeasuredBlock] = [PosesBlock(poses.scene or scene, poses, sought) for *_, poses in tables]
    motion = None
    along = dict[str, Array]()
    if logged:
        at_known = plain
        if measured:
            problem = measured[0]
            values = measured[1].values[: measured[0].shared]
            at_known = applied(
                plain, [(of.target, of.factor, of.added) for of in problem.unknowns[: values.size]], values
            )
        motion = CommandDesign(at_known, patterns_of(plain), scene.excitation).excited()
        blocks.append(_logged(motion.rehearsal, *logged[0], sought))
    known = _Known(measured, blocks, sought)
    offered = list[dict[str, str]]()
    each = list[Array]()
    cautious = list[Array]()
    budgets = list[tuple[NDArray[np.intp], int]]()
    for (k, data_set), (headings, cells, poses), part in zip(proposed, tables, known.parts, strict=False):
        rows, jacobians = known.possible(part, f"data[{k}]")
        budgets.append((len(each) + np.arange(len(rows)), data_set.propose or 1))
        blank = {column: "" for of in data_set.measured for column in (of.column, of.minus) if column is not None}
        offered += [{SET: poses.name, **dict(zip(headings, cells[row], strict=True)), **blank} for row in rows]
        each += list(jacobians[0])
        # by the values at which it shows least: a shape that is about to buckle is most sensitive, to what is assumed
        # as well
        least = np.argmin(np.linalg.norm(jacobians * known.sizes, axis=(2, 3)), axis=0)
        cautious += list(jacobians[least, np.arange(least.size)])
    if motion:
        along = motion.by_segment(known.logged(motion.rehearsal.t.size - 1, f"data[{logged[0][0]}]"))
    there = information(np.vstack([known.rows, *along.values()]), known.sizes)
    shared = known.problem.shared
    counts = allotted(np.array([information(rows, known.sizes) for rows in cautious]), there, shared, budgets)
    made = np.repeat(np.arange(counts.size), counts).tolist()
    columns = tuple(dict.fromkeys(heading for k in made for heading in offered[k]))
    filled = [_read_back(of, poses.name) for (_, of), (*_, poses) in zip(proposed, tables, strict=True)]
    pairs = zip(known.problem.unknowns, known.values.tolist(), strict=True)
    return plan_of(
        [unknown._replace(start=value) for unknown, value in pairs],
        motion,
        along,
        plain,
        known.rows,
        each,
        made,
        pose_headings=columns,
        pose_rows=tuple(tuple(offered[k].get(heading, "") for heading in columns) for k in made),
        configuration=scene.model_copy(update={"data": (*sets, *filled, *(data_set for _, data_set in logged))}),
    )


def _designed(scene: IdentifyScene) -> tuple[list[tuple[int, StaticPoses]], list[tuple[int, TipTrajectory]]]:
    """Sets whose rows are proposed, and the set to log, with their numbers."""
    sets = list(enumerate(scene.data))
    proposed = [(k, of) for k, of in sets if isinstance(of, StaticPoses) and of.propose]
    moving = [(k, of) for k, of in sets if isinstance(of, TipTrajectory)]
    logged = moving[:1] if "excitation" in scene.model_fields_set else []
    if not (proposed or logged):
        raise InputError(
            "there is nothing to design: give propose in a static set, with choices for its conditions, or "
            "excitation and a set of kind: trajectory",
            key="data",
        )
    both: list[tuple[int, StaticPoses | TipTrajectory]] = [*proposed, *logged]
    for k, of in both:
        if any(isinstance(place, Column) for reading in of.measured for place in (reading.at, reading.offset)):
            raise InputError("without measurements, give positions as numbers, not as columns", key=f"data[{k}]")
    return proposed, logged


def _measured(
    scene: IdentifyScene, data: Measurements, report: Progress
) -> tuple[tuple[FitProblem, Solution] | None, tuple[DataSet, ...]]:
    """The fit to the measurements so far, None where there are none; and the sets that files of them have."""
    paths, arrays = sources_of(data)
    if not (paths or arrays):
        return None, ()
    sets: tuple[DataSet, ...] = ()
    measured = scene
    if paths:
        sets = sets_of(scene, paths)
        measured = scene.model_copy(update={"data": sets})
    problem = posed(measured, data, scene.estimate).problem
    return (problem, problem.solve(report)), sets


def _logged(motion: Trajectory, k: int, data_set: TipTrajectory, sought: Sequence[Unknown]) -> PathBlock:
    """The set that will be logged along a motion."""
    none = np.zeros(motion.t.size - 1)
    readings = [
        Reading(m.quantity, none, m.place, m.sigma, m.since, m.of, cast(float, m.offset)) for m in data_set.measured
    ]
    path = TipPath(motion.t[1:], readings, name=data_set.name or f"data[{k}]", plane=data_set.plane)
    return PathBlock(motion.scene, path, sought)


class _Known:
    """Knowledge before the design of sets; ``parts`` belong to a problem that includes the measurements so far.

    ``values`` (n,) belong to all unknowns, ``sizes`` typical ones, ``rows`` (rows, n) are the derivatives of everything
    known already, per standard deviation.
    """

    def __init__(
        self, measured: tuple[FitProblem, Solution] | None, blocks: Sequence[MeasuredBlock], sought: Sequence[Unknown]
    ) -> None:
        self.problem = FitProblem([*(measured[0].blocks if measured else ()), *blocks], sought)
        self.parts = self.problem.parts[-len(blocks) :]
        self._scales = dict[str, float]()
        self.values = np.array([of.start for of in self.problem.unknowns])
        self.sizes = np.array([of.typical for of in self.problem.unknowns])
        rows: Array = np.zeros((0, self.sizes.size))
        if measured:
            problem, solution = measured
            self.values[: solution.values.size] = solution.values
            rows = (solution.jacobian / solution.sigma[:, None])[problem.fitted]
            rows = np.pad(rows, ((0, 0), (0, self.sizes.size - solution.values.size)))
            pairs = zip(problem.described, solution.sigma.tolist(), strict=True)
            self._scales = {column.group: sigma for column, sigma in pairs}
        self.rows = np.vstack([rows, prior(self.problem.unknowns, self.values)[1]])

    def possible(self, part: SetInProblem, key: str) -> tuple[NDArray[np.intp], Array]:
        """Rows (K,) of a set that are possible, and derivatives (values, K, readings, n) of their readings.

        These are at the values that are known and some about them.
        """
        unknowns = self.problem.sought
        at = part.mix @ self.values
        about = _ABOUT * np.array([min(unknown.sigma, unknown.typical) for unknown in unknowns])
        free = np.array([(unknown.lower, unknown.upper) for unknown in unknowns]).T
        turns = np.random.default_rng(0).choice([-1.0, 1.0], size=(_TRIED, at.size)) if at.size > 1 else [[-1.0], [1.0]]
        tried = [at, *(np.clip(at + about * turn, *free) for turn in turns)]
        rows, slopes = cast(PosesBlock, part.block).possible(tried)
        if not rows.size:
            raise InputError("no choice of the conditions has an equilibrium within the bending range", key=key)
        return rows, self._whitened(part, slopes, key)

    def logged(self, samples: int, key: str) -> Array:
        """Derivatives (T, readings, n) of what will be logged, which is the last set."""
        block, _, mix = part = self.parts[-1]
        slopes = block.predict(mix @ self.values)[1]
        return self._whitened(part, slopes.reshape(samples, -1, slopes.shape[1]), key)

    def _whitened(self, part: SetInProblem, slopes: Array, key: str) -> Array:
        """Derivatives (..., readings, n) by all unknowns, per deviation, from those by the unknowns of a set."""
        sigma = []
        for k, column in enumerate(part.block.measured.columns):
            deviation = self._scales.get(column.group) if column.sigma is None else column.sigma
            if deviation is None:
                why = "predicted deviations need the deviation of every reading: state it"
                hint = "" if self._scales else ", or give data whose scatter shows it (--data)"
                raise InputError(f"{why}{hint}", key=f"{key}.measured[{k}].sigma")
            sigma.append(deviation)
        return np.asarray(slopes / np.array(sigma)[:, None] @ part.mix)


def plan_of(
    unknowns: Sequence[Unknown],
    motion: Excited | None,
    along: dict[str, Array],
    scene: Scene,
    known: Array | None = None,
    offered: Sequence[Array] = (),
    made: Iterable[int] = (),
    **further: Any,
) -> ExperimentPlan:
    """Plan of a motion, and of the experiments that are ``made`` of those that are ``offered``.

    Readings ``along`` its segments, offered, and ``known`` already, are derivatives (readings, n) by all unknowns,
    per standard deviation; unknowns of single sets do not count. ``further`` fields are added, or replace the same.
    """
    chosen = {f"pose {k}": offered[index] for k, index in enumerate(made, 1)} | along
    free = [unknown._replace(lower=-np.inf, upper=np.inf) for unknown in unknowns]
    values = np.array([unknown.start for unknown in free])
    known = np.zeros((0, len(free))) if known is None else known
    before, after, every = (
        infer(free, values, np.vstack([known, *rows]), None)
        for rows in ([], chosen.values(), [*offered, *along.values()])
    )
    shared = sum(unknown.per != "set" for unknown in free)
    warnings = [warning.replace("the data", "these experiments") for warning in after.warnings]
    unseen = [
        unknown.name for unknown, deviation in zip(free[:shared], every.deviations, strict=False) if np.isinf(deviation)
    ]
    if unseen:
        warnings.append(
            f"no possible experiment shows {', '.join(unseen)}: measure other quantities, offer other choices, or "
            "leave it out of estimate"
        )
    each = np.stack([np.sum(rows**2, axis=0) for rows in chosen.values()], axis=1)[:shared]
    statistics: dict[str, Any] = {"offered": len(offered), "readings": sum(map(len, chosen.values()))}
    fields: dict[str, Any] = {"scene": scene}
    if motion is not None:
        rehearsal, statistics["scale"] = motion.rehearsal, motion.scale
        labels = tuple(finger_input.label for finger_input in rehearsal.scene.finger.inputs)
        fields = {"scene": rehearsal.scene, "rehearsal": rehearsal, "segments": motion.segments, "t": rehearsal.t}
        fields |= {"commands": rehearsal.u[:, : len(labels)], "command_names": labels}
        warnings += rehearsal.warnings
    return ExperimentPlan(
        names=tuple(unknown.name for unknown in free[:shared]),
        units=tuple(unknown.unit for unknown in free[:shared]),
        values=values[:shared],
        before=before.deviations[:shared],
        deviations=after.deviations[:shared],
        shares=each / np.maximum(each.sum(axis=1, keepdims=True), 1e-300),
        experiment_names=tuple(chosen),
        status="not shown" if unseen else "designed",
        warnings=tuple(warnings),
        statistics=statistics,
        **fields | further,
    )


def _read_back(data_set: StaticPoses, name: str) -> StaticPoses:
    """The set that reads the table of poses, a row each."""
    chosen = (*data_set.where, RowsEqual(column=SET, equals=(name,)))
    read = {"file": POSES, "name": f"{name}, proposed", "where": chosen}
    return data_set.model_copy(update=read | {"use": "fit", "holdout_rows": (), "pose": None})
