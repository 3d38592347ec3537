"""One mission on many plants."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from os import PathLike
from typing import Any

import numpy as np

from continuum_grasp import interrupt
from continuum_grasp.errors import ContinuumGraspError, InputError, Interrupted
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.interrupt import ignored_by_children
from continuum_grasp.mission.assignment import Assignment, assign
from continuum_grasp.mission.outcomes import Outcome
from continuum_grasp.mission.plant import Variation
from continuum_grasp.mission.run import Crew, mission_of
from continuum_grasp.scene.mission import MissionScene, Trials

__all__ = ["run_trials", "variations"]

_SEEDS = 2**31


def variations(trials: Trials) -> list[Variation]:
    """The plants that are drawn, the same for the same seed."""
    rng = np.random.default_rng(trials.seed)

    def factor(reach: float) -> float:
        return float(1.0 + reach * rng.uniform(-1.0, 1.0))

    found = []
    for _ in range(trials.count):
        stiffness, damping = factor(trials.stiffness), factor(trials.damping)
        mass, friction = factor(trials.mass), factor(trials.friction)
        dx, dy = (float(v) for v in trials.position * rng.uniform(-1.0, 1.0, 2))
        found.append(Variation(stiffness, damping, mass, friction, (dx, dy), int(rng.integers(_SEEDS))))
    return found


@interrupt.listening()
def run_trials(
    scene: MissionScene | str | PathLike[str],
    *,
    grasp: GraspResult | None = None,
    jobs: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Outcome]:
    """Carry a mission out on the plants of its ``trials``.

    Parameters
    ----------
    scene : MissionScene or path-like
        The mission, or its YAML file.
    grasp : GraspResult, optional
        The grasp, where it has been found already.
    jobs : int, optional
        Processes; one per core where not given.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    list of Outcome
        In the order of ``variations``.

    Raises
    ------
    SolverError
        If there is no verified grasp.
    InputError
        If the mission does not make sense.
    Interrupted
        On Ctrl-C; ``result`` is the list of those that were done.
    """
    mission = mission_of(scene)
    drawn = variations(mission.trials)
    count = min(os.cpu_count() or 1 if jobs is None else jobs, len(drawn))
    if count < 1:
        raise InputError(f"expected one process at least, got {jobs}", key="jobs")
    assignment = assign(mission, grasp)
    report = progress or (lambda share: None)
    done: dict[int, Outcome] = {}
    try:
        for k, outcome in _outcomes(assignment, drawn, count):
            done[k] = outcome
            report(len(done) / len(drawn))
    except KeyboardInterrupt:
        kept = [done[k] for k in sorted(done)]
        raise Interrupted(f"interrupted after {len(kept)} of {len(drawn)} plants", result=kept) from None
    return [done[k] for k in range(len(drawn))]


def _outcomes(assignment: Assignment, drawn: list[Variation], jobs: int) -> Iterator[tuple[int, Outcome]]:
    """Each plant's number and outcome, as they come."""
    first = _Worker(assignment)
    if jobs == 1:
        yield from ((k, first.run(variation)) for k, variation in enumerate(drawn))
        return
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    with ProcessPoolExecutor(jobs, context, _start, (assignment, stop)) as pool:
        with ignored_by_children():
            asked = {pool.submit(_run, variation): k for k, variation in enumerate(drawn)}
        try:
            for future in as_completed(asked):
                yield asked[future], future.result()
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


class _Worker:
    """Controller and plant in one process; ``stop`` is set when nothing more is wanted."""

    current: _Worker | None = None

    def __init__(self, assignment: Assignment, stop: Any = None) -> None:
        self._crew, self._stop = Crew(assignment), stop

    def run(self, variation: Variation) -> Outcome:
        try:
            return Outcome(variation, self._crew.run(variation, self._watch).verdict)
        except ContinuumGraspError as error:
            return Outcome(variation, None, str(error))

    def _watch(self, share: float) -> None:
        if self._stop is not None and self._stop.is_set():
            raise KeyboardInterrupt


def _start(assignment: Assignment, stop: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _Worker.current = _Worker(assignment, stop)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run(variation: Variation) -> Outcome:
    worker = _Worker.current
    if worker is None:
        raise RuntimeError("a worker that was not started")
    return worker.run(variation)
