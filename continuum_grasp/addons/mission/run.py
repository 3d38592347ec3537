"""A mission carried out: grasp, controller and plant from approach to release, on one plant or on many."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from os import PathLike

import numpy as np

from continuum_grasp.addons.mission.assignment import Assignment, present
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.lift import LiftCheck
from continuum_grasp.addons.mission.on_pads import reserved
from continuum_grasp.addons.mission.outcomes import Outcome, TrialsResult
from continuum_grasp.addons.mission.plant import MissionPlant, PlantVariation, Timetable, mission_plant_model
from continuum_grasp.addons.mission.precheck import admit, admitted, exceeded_by_trials
from continuum_grasp.addons.mission.result import MissionRun
from continuum_grasp.addons.mission.scene import MissionScene, Trials
from continuum_grasp.base import (
    ContinuumGraspError,
    InputError,
    Interrupted,
    ProcessPool,
    check_arguments,
    interruptible,
)
from continuum_grasp.closed_loop import FingerLoop, SharedModel
from continuum_grasp.control import Controller
from continuum_grasp.grasp import GraspResult
from continuum_grasp.scene import scene_of
from continuum_grasp.simulation import ContactHistory

Progress = Callable[[float], None]


@interruptible()
@check_arguments
def run_mission(
    scene: MissionScene | str | PathLike[str],
    *,
    grasp: GraspResult | None = None,
    variation: PlantVariation | None = None,
    progress: Progress | None = None,
    times: bool = False,
) -> MissionRun:
    """Optimize a grasp, and carry it out in closed loop.

    Parameters
    ----------
    scene : MissionScene or path-like
        The mission, or its YAML file.
    grasp : GraspResult, optional
        The grasp, if you have it already.
    variation : Variation, optional
        Differences of the plant from the mission's own.
    progress : callable, optional
        Called with the share done so far, 0 to 1.
    times : bool
        Whether to optimize the controllers' code and measure the times of their steps, as in ``run_closed_loop``.

    Returns
    -------
    MissionRun

    Raises
    ------
    SolverError
        If there is no verified grasp, or its contacts bear too little on the mission's compliant pads.
    InputError
        If the mission is inconsistent.
    NumericalError
        If the plant's motion does not stay finite; ``result`` is the mission until then.
    Interrupted
        On Ctrl-C; ``result`` is the mission until then.

    Examples
    --------
    The controller of a mission takes some seconds to compile where it is not in the cache:

    >>> import continuum_grasp as cg
    >>> run = cg.run_mission("configs/mission/mug.yaml")  # doctest: +SKIP
    >>> run.verdict.held  # doctest: +SKIP
    True
    """
    assignments = admitted(scene_of(scene, MissionScene), grasp, variation)
    return MissionRunner(assignments, math.inf if times else 1).run(variation, progress)


class MissionRunner:
    """Controllers and plant of a mission, made once for any number of runs; ``runs`` of them are expected."""

    def __init__(self, assignments: Sequence[Assignment], runs: float = 1) -> None:
        self.assignments = tuple(assignments)
        mission = assignments[0].mission
        # Without a deadline of its own a mission never drops a command for being late.
        deadline = mission.controller.deadline or math.inf
        steps = runs * Timetable(assignments[0]).duration / assignments[0].control.controller.step
        self._controllers = [Controller(each.control, deadline=deadline, steps=steps) for each in assignments]
        self._models = [mission_plant_model(assignment) for assignment in assignments]
        self._shared = SharedModel(self._models) if len(assignments) > 1 else None

    def run(self, variation: PlantVariation | None = None, progress: Progress | None = None) -> MissionRun:
        """Carry the mission out on one plant; errors are as in ``run_mission``."""
        asked = variation or PlantVariation()
        loops = []
        check = LiftCheck(self.assignments)
        for k, (assignment, control, model) in enumerate(
            zip(self.assignments, self._controllers, self._models, strict=True)
        ):
            plant = MissionPlant(assignment, check.timetable, control.prediction, asked, model)
            plan = check.schedule(k, control.stages)
            loops.append(FingerLoop(assignment.control, control, plant, plan.rows, plan))
        # All last equally long.
        runs, error = FingerLoop.run_together(loops, plan.duration, progress, joint=self._shared)
        # Ctrl-C at the very end: the verdict is whole, and comes with the exception.
        with Interrupted.after("the mission") as late:
            by_finger = zip(self.assignments, runs, strict=True)
            contacts = ContactHistory.joined({of.name: present(run.contacts) for of, run in by_finger})
            scenes = tuple(model.scene for model in self._models)
            found = (check.refused, check.slipped, check.doubted)
            judged = MissionRun(self.assignments, check.timetable, asked, tuple(runs), contacts, scenes, *found)
            _ = judged.verdict, judged.exceeded
        error = error or late()
        if error is not None:
            error.result = judged
            raise error
        return judged


def variations(trials: Trials) -> list[PlantVariation]:
    """The plants that are drawn, the same for the same seed."""
    rng = np.random.default_rng(trials.seed)
    of_tendons = np.random.default_rng((trials.seed, 1))  # a stream of its own: the others are what they are without it

    def factor(reach: float) -> float:
        return float(1.0 + reach * rng.uniform(-1.0, 1.0))

    plants = []
    # Plant by plant in a fixed order of draws: more plants begin with those of fewer.
    for _ in range(trials.count):
        stiffness, damping = factor(trials.stiffness), factor(trials.damping)
        mass, friction = factor(trials.mass), factor(trials.friction)
        dx, dy = (float(v) for v in trials.position * rng.uniform(-1.0, 1.0, 2))
        tendon_friction = float(1.0 + trials.tendon_friction * of_tendons.uniform(-1.0, 1.0))
        plants.append(
            PlantVariation(
                stiffness,
                damping,
                mass,
                friction,
                (dx, dy),
                int(rng.integers(2**31)),
                tendon_friction,
                trials.friction_fall,
            )
        )
    return plants


@interruptible()
@check_arguments
def run_trials(
    scene: MissionScene | str | PathLike[str],
    *,
    grasp: GraspResult | None = None,
    jobs: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> TrialsResult:
    """Carry a mission out on the plants of its ``trials``.

    Parameters
    ----------
    scene : MissionScene or path-like
        The mission, or its YAML file.
    grasp : GraspResult, optional
        The grasp, if you have it already.
    jobs : int, optional
        Processes; by default one per core.
    progress : callable, optional
        Called with the share done so far, 0 to 1.

    Returns
    -------
    TrialsResult
        A sequence of `Outcome`, in the order of ``variations``; ``summary`` has them in numbers.

    Raises
    ------
    SolverError
        If there is no verified grasp, or its contacts bear too little on the mission's compliant pads.
    InputError
        If the mission is inconsistent.
    Interrupted
        On Ctrl-C; ``result`` has the plants done so far.

    Examples
    --------
    Each trial takes some seconds, the first one what its controller takes to compile:

    >>> import continuum_grasp as cg
    >>> outcomes = cg.run_trials("configs/mission/mug.yaml", jobs=2)  # doctest: +SKIP
    >>> sum(outcome.succeeded for outcome in outcomes)  # doctest: +SKIP
    100
    """
    mission = scene_of(scene, MissionScene)
    drawn = variations(mission.trials)
    count = min(ProcessPool.cores() if jobs is None else jobs, len(drawn))
    if count < 1:
        raise InputError(f"expected at least one process, got {jobs}", key="jobs")
    assignments = assign(mission, grasp)
    known = exceeded_by_trials(assignments, drawn)
    admit(assignments, known)
    known += reserved(assignments[0])
    report = progress or (lambda share: None)
    done: dict[int, Outcome] = {}
    try:
        for k, outcome in _outcomes(assignments, drawn, count):
            done[k] = outcome
            report(len(done) / len(drawn))
    except KeyboardInterrupt:
        finished = TrialsResult(mission, tuple(done[k] for k in sorted(done)), "interrupted", known)
        raise Interrupted(f"interrupted after {len(finished)} of {len(drawn)} plants", result=finished) from None
    return TrialsResult(mission, tuple(done[k] for k in range(len(drawn))), warnings=known)


def _outcomes(
    assignments: Sequence[Assignment], drawn: list[PlantVariation], jobs: int
) -> Iterator[tuple[int, Outcome]]:
    """Number and outcome of each plant, in the order in which they end."""
    first = MissionRunner(assignments, len(drawn))  # compiles once what all processes then load
    if jobs == 1:
        yield from ((k, _outcome(first, variation)) for k, variation in enumerate(drawn))
        return
    # Each worker makes its controllers and plant once, from compiled code that is in the cache by now.
    pool = ProcessPool(jobs, _start, assignments, len(drawn))
    finished = False
    try:
        for k, future in pool.as_completed(_run, drawn):
            lost = pool.lost(future)
            yield k, Outcome(drawn[k], None, "its worker process died") if lost else future.result()
        finished = True
    finally:
        pool.close(not finished)


def _outcome(runner: MissionRunner, variation: PlantVariation) -> Outcome:
    try:
        return Outcome(variation, runner.run(variation).verdict)
    except ContinuumGraspError as error:
        return Outcome(variation, None, str(error))


_own: list[MissionRunner] = []
"""Controllers and plant of a worker process."""


def _start(assignments: Sequence[Assignment], runs: int) -> None:
    _own.append(MissionRunner(assignments, runs))


def _run(variation: PlantVariation) -> Outcome:
    return _outcome(_own[0], variation)
