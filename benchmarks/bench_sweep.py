"""What a sweep costs beside solving, and what a second worker is worth.

Run ``python -m benchmarks.bench_sweep`` in the root of the repository. A thousand scenes of the mug against the palm,
drawn at random, are solved one after the other by one call per scene in a fresh process (nothing is saved; what solving
costs), by a sweep with one worker and by a sweep with two (all runs saved), in turn, several rounds. Ratios are formed
within rounds. The processor's time is given beside the clock's: it says what a sweep costs also while others use the
machine. ``--waiting`` puts a wait of 25 ms in the optimizer's place.
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Report, Table

ROOT = Path(__file__).parents[1]
ROUNDS = 3
FEW = 20
WAIT = 0.025


def config(scenes: int, seed: int) -> dict[str, Any]:
    """Discs of different size, weight and friction held against a palm."""
    return {
        "scene": str(ROOT / "configs" / "grasp" / "mug.yaml"),
        "set": {"solver.effort": "quick"},
        "sample": {
            "count": scenes,
            "seed": seed,
            "keys": {
                "object.diameter": {"uniform": [0.075, 0.09]},
                "contacts.friction": {"uniform": [0.5, 0.8]},
                "object.mass": {"uniform": [0.1, 0.3]},
            },
        },
        "follow": {"object.position[0]": {"key": "object.diameter", "times": 0.5}},
    }


def waiting(scene: Any, result: Any = None) -> Any:
    """A result that is there already, after a wait."""
    time.sleep(WAIT)
    return result


def evaluate(wait: bool) -> Any:
    """The optimizer, or what waits in its place and gives back one true result."""
    from continuum_grasp import optimize_grasp
    from continuum_grasp.sweeps.worker import solve

    if not wait:
        return solve
    found = optimize_grasp(ROOT / "configs" / "grasp" / "mug.yaml")
    return functools.partial(waiting, result=found)


def plainly(scenes: int, seed: int, wait: bool, pipe: Any) -> None:
    """All scenes in a loop, as a user would without a sweep."""
    from continuum_grasp.scene.grasp import GraspScene
    from continuum_grasp.sweeps.plan import plan_of
    from continuum_grasp.sweeps.worker import Job, scene_data

    plan, run = plan_of(config(scenes, seed)), evaluate(wait)
    job = Job(plan.variation.base, plan.keys, plan.paths, (), "none", run)
    values = [GraspScene.model_validate(scene_data(job.base, job.paths, point)) for point in plan]
    run(values[0])
    began, used = time.perf_counter(), time.process_time()
    taken = []
    for scene in values:
        start = time.perf_counter()
        run(scene)
        taken.append(time.perf_counter() - start)
    pipe.send((time.perf_counter() - began, time.process_time() - used, taken))


def processor_seconds() -> float:
    """Processor time of this process and of those it has waited for [s]."""
    own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


def alone(scenes: int, seed: int, wait: bool) -> tuple[float, float, list[float]]:
    """Times of the loop by the clock and of the processor, and of every scene [s], in a process of its own."""
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    process = context.Process(target=plainly, args=(scenes, seed, wait, writer))
    process.start()
    found: tuple[float, float, list[float]] = reader.recv()
    process.join()
    return found


def swept(scenes: int, seed: int, wait: bool, workers: int) -> dict[str, float]:
    """Times of a sweep [s]: whole, from the first row on, and within evaluations."""
    from continuum_grasp import sweep

    first: list[tuple[float, int]] = []
    began = time.perf_counter()

    def note(progress: Any) -> None:
        if progress.done and not first:
            first.append((time.perf_counter(), progress.done))

    used = processor_seconds()
    with tempfile.TemporaryDirectory() as folder:
        given = config(scenes, seed)
        table = sweep(given, folder=folder, workers=workers, evaluate=evaluate(wait), progress=note)
        end = time.perf_counter()
        size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
    steady = (end - first[0][0]) * scenes / (scenes - first[0][1])
    return {
        "whole": end - began,
        "steady": steady,
        "processor": processor_seconds() - used,
        "evaluation": float(np.nansum(table["seconds"])),
        "solved": float(table.solved.mean()),
        "kilobytes": size / scenes / 1024,
    }


def main() -> None:
    """Measure and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--waiting", action="store_true", help="a wait in the optimizer's place")
    arguments = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    what = (arguments.scenes, arguments.seed, arguments.waiting)
    rows, overheads, gains = [], [], []
    for _ in range(arguments.rounds):
        loop, used, taken = alone(*what)
        few = swept(FEW, *what[1:], 1)
        one, two = swept(*what, 1), swept(*what, 2)
        more = (one["processor"] - few["processor"]) / (arguments.scenes - FEW) - used / arguments.scenes
        overheads.append(one["steady"] / loop - 1.0)
        gains.append(one["steady"] / two["steady"])
        rows.append(
            [
                1e3 * float(np.median(taken)),
                1e3 * loop / arguments.scenes,
                1e3 * one["steady"] / arguments.scenes,
                1e3 * two["steady"] / arguments.scenes,
                overheads[-1],
                1e3 * more,
                1e3 * used / arguments.scenes,
                one["steady"] / one["evaluation"] - 1.0,
                gains[-1],
                one["whole"] - one["steady"],
                one["solved"],
                one["kilobytes"],
            ]
        )
    columns = [
        "median solve [ms]",
        "loop [ms/scene]",
        "1 worker [ms/scene]",
        "2 workers [ms/scene]",
        "overhead over the loop",
        "overhead of the processor [ms/scene]",
        "solving, of the processor [ms/scene]",
        "overhead over its own solving",
        "gain of 2 workers",
        "start [s]",
        "solved",
        "on disk [kB/scene]",
    ]
    report = Report("sweep_waiting" if arguments.waiting else "sweep", arguments.seed)
    note = "Times from the first row on, scaled to all scenes; starting workers and building, before that, is beside."
    report.tables.append(Table(f"{arguments.scenes} scenes, round by round", columns, rows, note))
    report.claim("overhead per scene over solving, median of the rounds", float(np.median(overheads)), "<=", 0.10)
    report.claim("two workers against one, median of the rounds", float(np.median(gains)), ">=", 1.8)
    for file in report.write():
        print(file)
    print(report.status)


if __name__ == "__main__":
    main()
