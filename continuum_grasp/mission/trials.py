"""One mission on many plants, and how it went on them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from io import StringIO
from os import PathLike
from pathlib import Path

import numpy as np

from continuum_grasp import interrupt
from continuum_grasp.arguments import check_arguments
from continuum_grasp.errors import ContinuumGraspError, InputError, Interrupted
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.mission.assignment import Assignment, assign
from continuum_grasp.mission.plant import Variation
from continuum_grasp.mission.run import MissionRunner
from continuum_grasp.mission.verdict import Verdict
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.mission import MissionScene, Trials
from continuum_grasp.workers import ProcessPool, cores

_SEEDS = 2**31
"""Upper end of the seeds of measurement noise [1]; any whole number does."""


def variations(trials: Trials) -> list[Variation]:
    """The plants that are drawn, the same for the same seed."""
    rng = np.random.default_rng(trials.seed)

    def factor(reach: float) -> float:
        return float(1.0 + reach * rng.uniform(-1.0, 1.0))

    found = []
    # Plant by plant in a fixed order of draws: more plants begin with those of fewer.
    for _ in range(trials.count):
        stiffness, damping = factor(trials.stiffness), factor(trials.damping)
        mass, friction = factor(trials.mass), factor(trials.friction)
        dx, dy = (float(v) for v in trials.position * rng.uniform(-1.0, 1.0, 2))
        found.append(Variation(stiffness, damping, mass, friction, (dx, dy), int(rng.integers(_SEEDS))))
    return found


@interrupt.listening()
@check_arguments
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
    count = min(cores() if jobs is None else jobs, len(drawn))
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
        finished = [done[k] for k in sorted(done)]
        raise Interrupted(f"interrupted after {len(finished)} of {len(drawn)} plants", result=finished) from None
    return [done[k] for k in range(len(drawn))]


def _outcomes(assignment: Assignment, drawn: list[Variation], jobs: int) -> Iterator[tuple[int, Outcome]]:
    """Number and outcome of each plant, in the order in which they end."""
    first = MissionRunner(assignment)  # compiles once what all processes then load
    if jobs == 1:
        yield from ((k, _outcome(first, variation)) for k, variation in enumerate(drawn))
        return
    # Each worker makes its controller and plant once, from compiled code that is in the cache by now.
    pool, finished = ProcessPool(jobs, _start, assignment), False
    try:
        for k, future in pool.as_completed(_run, drawn):
            lost = pool.lost(future)
            yield k, Outcome(drawn[k], None, "its worker process died") if lost else future.result()
        finished = True
    finally:
        pool.close(not finished)


def _outcome(runner: MissionRunner, variation: Variation) -> Outcome:
    try:
        return Outcome(variation, runner.run(variation).verdict)
    except ContinuumGraspError as error:
        return Outcome(variation, None, str(error))


_own: list[MissionRunner] = []
"""Controller and plant of a worker process."""


def _start(assignment: Assignment) -> None:
    _own.append(MissionRunner(assignment))


def _run(variation: Variation) -> Outcome:
    return _outcome(_own[0], variation)


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

    @property
    def text(self) -> str:
        """The plant and what became of the object, in one line."""
        v = self.variation
        shares = {"stiffness": v.stiffness, "damping": v.damping, "mass": v.mass, "friction": v.friction}
        plant = ", ".join(f"{name} {value:.3f}" for name, value in shares.items() if value is not None)
        x, y = (1e3 * value for value in v.shift)
        found = self.error.partition("\n")[0]
        if self.verdict is not None:
            found = f"{self.verdict.word}, sunk {1e3 * self.verdict.sunk:.3g} mm"
        return f"{plant}, shifted by ({x:+.2f}, {y:+.2f}) mm: {found}"


@dataclass(frozen=True)
class Summary:
    """Many plants in numbers; of those that have a verdict, whose attributes they are of."""

    plants: int
    """All of them."""
    held: int
    """Those on which the object was never dropped."""
    succeeded: int
    """Those that also let it go in the end."""
    force_error_median: float
    force_error_worst: float
    estimate_error_worst: float
    sunk_worst: float
    moved_worst: float
    slip_margin_least: float
    fallbacks: int
    """On all plants together."""
    failed: tuple[int, ...]
    """Those that did not succeed, by number."""

    def pairs(self) -> dict[str, str]:
        """Values with their units, by name."""
        return {
            "held": f"{self.held} of {self.plants} plants",
            "held and released": f"{self.succeeded} of {self.plants}",
            "held force": f"{100 * self.force_error_median:.1f} % off its setpoint (median of plants), "
            f"{100 * self.force_error_worst:.1f} % at worst",
            "its estimate": f"{100 * self.estimate_error_worst:.1f} % off at worst",
            "sunk": f"{1e3 * self.sunk_worst:.3g} mm at worst",
            "moved": f"{1e3 * self.moved_worst:.3g} mm at worst",
            "slip margin": f"{self.slip_margin_least:.2f} of the friction cone at least",
            "fallbacks": f"{self.fallbacks}",
        }


def summarize(outcomes: Sequence[Outcome]) -> Summary:
    """Many plants in numbers."""
    judged = [outcome.verdict for outcome in outcomes if outcome.verdict is not None]

    def column(name: str) -> np.ndarray:
        values = np.abs(np.array([getattr(verdict, name) for verdict in judged], dtype=float))
        values = values[~np.isnan(values)]  # a mission that was dropped early has no hold
        return values if values.size else np.array([np.nan])

    return Summary(
        plants=len(outcomes),
        held=sum(verdict.held for verdict in judged),
        succeeded=sum(outcome.succeeded for outcome in outcomes),
        force_error_median=float(np.median(column("force_error"))),
        force_error_worst=float(column("force_error").max()),
        estimate_error_worst=float(column("force_estimate_error").max()),
        sunk_worst=float(column("sunk").max()),
        moved_worst=float(column("moved").max()),
        slip_margin_least=float(column("slip_margin").min()),
        fallbacks=sum(verdict.fallbacks for verdict in judged),
        failed=tuple(k for k, outcome in enumerate(outcomes) if not outcome.succeeded),
    )


def save_trials(outcomes: Sequence[Outcome], folder: str | Path) -> Path:
    """Write ``trials.csv`` into a folder, one line per plant; returns the file."""
    from continuum_grasp.results import begin_run, write_text

    rows: list[dict[str, object]] = []
    for outcome in outcomes:
        own = asdict(outcome.variation)
        x, y = own.pop("shift")
        judged = asdict(outcome.verdict) if outcome.verdict is not None else {}
        row = {**own, "shift_x": x, "shift_y": y, **judged, "error": outcome.error.replace("\n", " ")}
        rows.append({name: f"{value:.9g}" if isinstance(value, float) else value for name, value in row.items()})
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return write_text(text.getvalue(), begin_run(folder, "mpc") / "trials.csv")
