"""One mission on many plants."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from continuum_grasp.errors import ContinuumGraspError, InputError
from continuum_grasp.mpc.mission.assignment import Assignment, assign
from continuum_grasp.mpc.mission.plant import Variation
from continuum_grasp.mpc.mission.result import Verdict
from continuum_grasp.mpc.mission.run import Crew, mission_of
from continuum_grasp.scene.mission import MissionScene, Trials

__all__ = ["Outcome", "run_trials", "save_trials", "variations"]


@dataclass(frozen=True)
class Outcome:
    """One plant, and how the mission went on it; ``error`` says why there is no verdict."""

    variation: Variation
    verdict: Verdict | None
    error: str = ""

    @property
    def succeeded(self) -> bool:
        """Held from lift to lowering, and let go."""
        return self.verdict is not None and self.verdict.succeeded


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
        found.append(Variation(stiffness, damping, mass, friction, (dx, dy)))
    return found


def run_trials(
    scene: MissionScene | str | PathLike[str],
    *,
    jobs: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Outcome]:
    """Carry a mission out on the plants of its ``trials``.

    Parameters
    ----------
    scene : MissionScene or path-like
        The mission, or its YAML file.
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
    """
    mission = mission_of(scene)
    drawn = variations(mission.trials)
    count = min(jobs or os.cpu_count() or 1, len(drawn))
    if count < 1:
        raise InputError(f"expected one process at least, got {jobs}", key="jobs")
    assignment = assign(mission)
    report = progress or (lambda share: None)
    outcomes = []
    for outcome in _outcomes(assignment, drawn, count):
        outcomes.append(outcome)
        report(len(outcomes) / len(drawn))
    return outcomes


def _outcomes(assignment: Assignment, drawn: list[Variation], jobs: int) -> Iterator[Outcome]:
    first = _Worker(assignment)
    if jobs == 1:
        yield from map(first.run, drawn)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, _start, (assignment,)) as pool:
        yield from pool.map(_run, drawn)


class _Worker:
    """Controller and plant in one process."""

    current: _Worker | None = None

    def __init__(self, assignment: Assignment) -> None:
        self._crew = Crew(assignment)

    def run(self, variation: Variation) -> Outcome:
        try:
            return Outcome(variation, self._crew.run(variation).verdict)
        except ContinuumGraspError as error:
            return Outcome(variation, None, str(error))


def _start(assignment: Assignment) -> None:
    _Worker.current = _Worker(assignment)


def _run(variation: Variation) -> Outcome:
    worker = _Worker.current
    if worker is None:
        raise RuntimeError("a worker that was not started")
    return worker.run(variation)


def save_trials(outcomes: list[Outcome], folder: str | Path) -> Path:
    """Write ``trials.csv`` into a folder, one line per plant."""
    from continuum_grasp.results import replacing

    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    rows = []
    for outcome in outcomes:
        own = asdict(outcome.variation)
        x, y = own.pop("shift")
        judged = asdict(outcome.verdict) if outcome.verdict is not None else {}
        rows.append({**own, "shift_x": x, "shift_y": y, **judged, "error": outcome.error.replace("\n", " ")})
    columns = max(rows, key=len).keys() if rows else ()
    lines = [",".join(columns), *(",".join(_cell(row.get(name, "")) for name in columns) for row in rows)]
    with replacing(target / "trials.csv") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return target / "trials.csv"


def _cell(value: object) -> str:
    text = f"{value:.9g}" if isinstance(value, float) else str(value)
    return f'"{text}"' if "," in text else text
