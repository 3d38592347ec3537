"""The sweep itself: submits scenes, takes rows, writes them, and resumes after an interruption."""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from continuum_grasp.addons.sweeps.folder import (
    PLAN,
    TABLE,
    TableFile,
    held_folder,
    rows_of,
    store_plan,
    write_run_file,
)
from continuum_grasp.addons.sweeps.plan import SweepPlan, SweepPoint
from continuum_grasp.addons.sweeps.pools import ExecutorPool, WorkerPool, dask_pool
from continuum_grasp.addons.sweeps.scene import GRASPS, Sweep
from continuum_grasp.addons.sweeps.table import SweepTable, sweep_table, write_csv
from continuum_grasp.addons.sweeps.worker import Job, Keep, SceneOutcome, row_of_crash, run_chunk, solve
from continuum_grasp.base import (
    CheckedArgument,
    ContinuumGraspError,
    InputError,
    Interrupted,
    ProcessPool,
    SolverError,
    check_arguments,
    interruptible,
)
from continuum_grasp.results import begin_run
from continuum_grasp.scene import Consumer, Overrides

_ANYWHERE = Consumer("sweep at a scheduler", {"executor": "is given beside scheduler: give one of them, not both"})


@interruptible()
@check_arguments
def sweep(
    config: Sweep | str | os.PathLike[str] | Mapping[str, Any],
    *,
    folder: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    keep: Keep = "all",
    evaluate: Callable[[Any], Any] | None = None,
    progress: Callable[[float, str], None] | None = None,
    overrides: Overrides = (),
) -> SweepTable:
    """Find the grasps of many scenes: a grid or random draws of any keys of one scene.

    Every scene gives one row of the table ``table.jsonl`` in the folder, also where there is no grasp, where the scene
    is invalid, and where its worker died. A sweep that was stopped, in whatever way, resumes
    when it is called again with the same configuration and folder.

    Parameters
    ----------
    config : Sweep, path-like or mapping
        A sweep, its YAML file, or the same as a mapping; paths in a mapping are relative to the working directory.
    folder : path-like, optional
        Folder of the table and the runs; by default ``runs/sweep/`` and the name of the file.
    workers : int, optional
        Processes on this machine; by default all cores. With an executor: how many of its workers to count on.
    executor : concurrent.futures.Executor, optional
        Executor that replaces processes on this machine; it is not shut down.
    scheduler : str, optional
        Address of a Dask scheduler, such as ``tcp://127.0.0.1:8786``, instead of an executor.
    keep : {"all", "failed", "none"}, optional
        Runs whose files to keep, in ``runs/``.
    evaluate : callable, optional
        From a scene to its result, such as a `GraspResult`, importable by name; by default `optimize_grasp`.
    progress : callable, optional
        Called with the finished share, 0 to 1, and a text that counts the finished rows by status.
    overrides : iterable of str, or mapping, optional
        Changes to the configuration, as in `load`.

    Returns
    -------
    SweepTable
        All rows, in the order of the scenes.

    Raises
    ------
    InputError
        The configuration is wrong; the folder holds another sweep, or one that is running; no scheduler answers.
    SolverError
        The workers are gone, or failed.
    Interrupted
        Ctrl-C; the table has all finished rows.

    Examples
    --------
    >>> import tempfile
    >>> import continuum_grasp as cg
    >>> masses = {"object.mass": {"values": [0.1, 0.2]}}  # kg
    >>> config = {"scene": "configs/grasp/mug_arcs.yaml", "vary": masses}
    >>> table = cg.sweep(config, folder=tempfile.mkdtemp(), workers=1, keep="none")
    >>> table["status"].tolist()
    ['optimal', 'optimal']
    """
    _ANYWHERE.check(None, of={"executor": executor is not None and scheduler is not None})
    count = None if workers is None else CheckedArgument("workers", workers).whole(1, 4096)
    plan = SweepPlan.of(config, overrides)
    if plan.variation.kind not in GRASPS:
        raise InputError(
            "expected a grasp: a sweep finds grasps; draws of a closed loop are for continuum_grasp.addons.learning",
            key="scene",
        )
    target = _folder(config, folder)
    with held_folder(target):
        # The plan comes before any row: a table is never without the plan that it is of.
        notes = store_plan(target, plan)
        of_plan = plan.variation.kind, plan.variation.base, plan.keys, plan.paths, plan.sweep.record
        job = Job(*of_plan, keep, evaluate or solve)
        run = _SweepRun(plan, job, target, progress)
        if run.done < len(plan):
            begin_run(target, "sweep", retained=(PLAN,))
            with _pool(executor, scheduler, count) as pool:
                run.go(pool)
        write_csv(target)
    return replace(sweep_table(target), statistics={**run.statistics, "notes": notes})


class _SweepRun:
    def __init__(self, plan: SweepPlan, job: Job, folder: Path, progress: Callable[[float, str], None] | None) -> None:
        self.plan = plan
        self.job = job
        self.folder = folder
        self.listener = progress
        self.there = bytearray(len(plan))
        self.counts: Counter[str] = Counter()
        self.file = TableFile(folder / TABLE)
        for row in rows_of(folder, len(plan)):
            self.there[row["index"]] = 1
            self.counts[row["status"]] += 1
        self.done = self.before = sum(self.there)
        self.flying: dict[Future[list[SceneOutcome]], list[SweepPoint]] = {}
        self.again: deque[SweepPoint] = deque()
        self.tries: Counter[int] = Counter()
        self.fresh = (index for index in range(len(plan)) if not self.there[index])
        self.each: float | None = None
        self.busy = 0.0
        self.began = self.reported = time.monotonic()

    def go(self, pool: WorkerPool) -> None:
        """Work until every scene has its row.

        Raises a SolverError where the workers are gone or cannot do the work, and Interrupted on Ctrl-C.
        """
        finished = False
        try:
            while self._fill(pool):
                # At most a second, so that progress is reported also while nothing ends.
                back = wait(self.flying, timeout=1.0, return_when=FIRST_COMPLETED).done
                outcomes = [outcome for future in back for outcome in self._taken(pool, future)]
                self._fill(pool)  # idle workers get work before anything is written
                self._write(outcomes)
                self._report()
            finished = True
        except KeyboardInterrupt:
            left = f"interrupted: {self.done} of {len(self.plan)} scenes are in {self.folder / TABLE}"
            raise Interrupted(f"{left}; run the same command to resume") from None
        finally:
            pool.close(not finished)
            self.file.close()
            self._report(last=True)

    @property
    def statistics(self) -> dict[str, Any]:
        """Times of this call."""
        seconds = time.monotonic() - self.began
        return {"new": self.done - self.before, "seconds": seconds, "evaluation_seconds": self.busy}

    def _fill(self, pool: WorkerPool) -> bool:
        """Submit chunks while workers are free; whether any is pending."""
        while len(self.flying) < pool.most:
            points = self._next(pool.workers)
            if not points:
                break
            self.flying[pool.submit(run_chunk, self.job, points)] = points
        return bool(self.flying)

    def _next(self, workers: int) -> list[SweepPoint]:
        """The next chunk: suspects one by one, then about half a second of scenes, fewer towards the end."""
        if self.again:
            return [self.again.popleft()]
        size = 1
        if self.each is not None:
            # A third of a worker's share of what is left: chunks shrink, so that all workers end together.
            left = len(self.plan) - self.done
            # 0.5: work per submitted chunk [s]: long against handing it over, short against the end of a sweep
            # 64: scenes per chunk: these are tried again one by one where their worker dies
            size = int(min(0.5 / max(self.each, 1e-4), left / (3 * workers), 64))
        return [self.plan.point(index) for index in islice(self.fresh, max(1, size))]

    def _taken(self, pool: WorkerPool, future: Future[list[SceneOutcome]]) -> list[SceneOutcome]:
        points = self.flying.pop(future)
        try:
            outcomes = future.result()
        except ContinuumGraspError:  # a column that grasps do not have: no row can have it
            raise
        except CancelledError as error:
            raise self._stopped("the scheduler is gone") from error
        except Exception as error:
            if not pool.lost(future):
                raise self._stopped(f"a worker failed: {type(error).__name__}: {error}") from error
            return self._suspected(points)
        seconds = sum(outcome.seconds for outcome in outcomes)
        mean = seconds / len(outcomes)  # neighbors cost alike, so that the last chunks foretell the next one
        self.each = mean if self.each is None else 0.5 * (self.each + mean)
        self.busy += seconds
        return outcomes

    def _suspected(self, points: Sequence[SweepPoint]) -> list[SceneOutcome]:
        """Scenes that were with a worker when it died: each is tried again alone, and given up if that kills it too."""
        given_up = []
        for point in points:
            self.tries[point.index] += 1
            # 2: times that a scene may end its worker: once with others, and once alone
            if self.tries[point.index] < 2:
                self.again.append(point)
            else:
                given_up.append(row_of_crash(self.job, point, "its worker process died, also with this scene alone"))
        return given_up

    def _write(self, outcomes: Sequence[SceneOutcome]) -> None:
        lines = []
        for outcome in outcomes:
            if self.there[outcome.index]:  # a cluster may compute a scene twice
                continue
            if outcome.run:  # before the row: a scene with a row is never computed again
                write_run_file(self.folder, outcome.index, outcome.run)
            lines.append(outcome.line)
            self.there[outcome.index] = 1
            self.counts[outcome.status] += 1
            self.done += 1
        self.file.append(b"".join(lines))

    def _report(self, last: bool = False) -> None:
        now = time.monotonic()
        # 0.2: least time between two reports of progress [s]
        if self.listener is not None and (last or now - self.reported > 0.2):
            kinds = ", ".join(f"{count} {status}" for status, count in sorted(self.counts.items()))
            text = f"{self.done} of {len(self.plan)}" + (f" ({kinds})" if kinds else "")
            self.listener(self.done / len(self.plan), text)
            self.reported = now

    def _stopped(self, what: str) -> SolverError:
        return SolverError(
            what,
            status="stopped",
            advice=f"{self.done} of {len(self.plan)} scenes are in {self.folder}; run the same command to resume.",
        )


def _folder(config: Sweep | str | os.PathLike[str] | Mapping[str, Any], folder: str | os.PathLike[str] | None) -> Path:
    if folder is None:
        if not isinstance(config, str | os.PathLike):
            raise InputError("a sweep without a file needs a folder", key="folder")
        return Path("runs") / "sweep" / Path(config).stem
    if Path(folder).exists() and not Path(folder).is_dir():
        raise InputError("expected a folder, got a file", file=os.fspath(folder))
    return Path(folder)


def _pool(executor: Executor | None, scheduler: str | None, count: int | None) -> AbstractContextManager[WorkerPool]:
    if scheduler is not None:
        return dask_pool(scheduler)
    if executor is None:
        return nullcontext(ProcessPool(count or ProcessPool.cores()))
    # Executors of the standard library have their number under this name.
    known = count or getattr(executor, "_max_workers", None) or ProcessPool.cores()
    return nullcontext(ExecutorPool(executor, lambda: known))
