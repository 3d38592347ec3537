"""Timing, side by side, of anything that can be called, and the C compiler.

A contestant is a callable that takes a number and does its work that many times. ``race`` first calls each
once for one evaluation (cold), then finds how many evaluations fill a sample, then takes the samples in
rounds: every round times every contestant once, in an order drawn anew, so that what disturbs the machine
disturbs all alike. Ratios are formed within rounds.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import random
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import ProcessPool
from continuum_grasp.core import Compiler

ROOT = Path(__file__).parents[1]
CONFIGS = ROOT / "configs"
Contestant = Callable[[int], Any]

CFLAGS = ("-O3", "-march=native", "-fPIC")


@dataclass
class Timing:
    """Times of one contestant [s]."""

    cold: float
    """First call, one evaluation."""
    samples: list[float] = field(default_factory=list)
    """Per evaluation, one sample per round."""

    @property
    def median(self) -> float:
        """Median time of one evaluation."""
        return quartiles(self.samples)[1]

    def per(self, other: Timing) -> float:
        """How many times as long as another it takes: median of the ratios within rounds."""
        return float(np.median(np.divide(self.samples, other.samples)))


def quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    """First quartile, median, third quartile; NaN of nothing."""
    if not len(values):
        return (float("nan"),) * 3
    low, middle, high = np.percentile(values, [25, 50, 75])
    return float(low), float(middle), float(high)


def race(
    contestants: Mapping[str, Contestant], *, repeats: int = 31, sample_seconds: float = 0.01, seed: int = 0
) -> dict[str, Timing]:
    """Time contestants side by side, in so many rounds of samples of about ``sample_seconds``.

    ``seed`` is of the order within the rounds; ``samples[k]`` of all belong to the same round.
    """
    timings = {name: Timing(_seconds(run, 1)) for name, run in contestants.items()}
    counts = {name: _fill(run, sample_seconds) for name, run in contestants.items()}
    names, order = list(contestants), random.Random(seed)
    for _ in range(repeats):
        order.shuffle(names)
        for name in names:
            timings[name].samples.append(_seconds(contestants[name], counts[name]) / counts[name])
    return timings


def _seconds(run: Contestant, count: int) -> float:
    start = time.perf_counter_ns()
    run(count)
    return (time.perf_counter_ns() - start) * 1e-9


def _fill(run: Contestant, seconds: float) -> int:
    """Evaluations that fill a sample."""
    count = 1
    while (taken := _seconds(run, count)) < 0.5 * seconds and count < 1 << 30:
        count = min(1 << 30, max(2 * count, int(count * min(1e3, 0.7 * seconds / max(taken, 1e-9)))))
    return count


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and threads and processes started from it, on one core, where the system allows it."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def spread(
    work: Callable[[Any], Any], tasks: Sequence[Any], jobs: int
) -> Iterator[tuple[Any, Any, BaseException | None]]:
    """Work off tasks in processes of their own, each of which may die: task, outcome and error as they come."""
    pool = ProcessPool(jobs)
    try:
        for k, future in pool.as_completed(work, tasks):
            error = future.exception()
            yield tasks[k], None if error else future.result(), error
    finally:
        pool.close(True)


# C.


def compiler() -> Compiler:
    """The C compiler that the package itself would use."""
    found = Compiler.find()
    if found is None:
        raise RuntimeError("no C compiler found: the benchmarks need CC, cc, gcc or clang")
    return found


def run(command: Sequence[object], **options: Any) -> str:
    """Run a program, and return what it wrote; RuntimeError with the end of its errors where it fails."""
    line = [str(word) for word in command]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    done = subprocess.run(line, text=True, check=False, **options)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(line)} failed:\n{(done.stderr or done.stdout)[-3000:]}")
    return done.stdout


def generated(function: ca.Function) -> str:
    """CasADi's C of a function; RuntimeError if it could not write it: CasADi only warns, and writes an #error."""
    options = {"casadi_int": "long long int", "with_header": False, "with_mem": False, "static_aux": True}
    generator = ca.CodeGenerator(f"{function.name()}.c", options)
    generator.add(function)
    text = str(generator.dump())
    if "#error" in text:
        raise RuntimeError(f"CasADi generates no code of {function.name()}")
    return text


def compiled(folder: Path, name: str, source: str, flags: Sequence[str]) -> Path:
    """The object file of a C source, compiled apart from all others."""
    file = folder / f"{name}.c"
    file.write_text(source, encoding="utf-8")
    run([compiler().command[0], *flags, "-c", file, "-o", file.with_suffix(".o")])
    return file.with_suffix(".o")


def linked(folder: Path, objects: Sequence[Path], flags: Sequence[str] = ()) -> ctypes.CDLL:
    """The library of some object files, without optimization across them."""
    library = folder / "linked.so"
    run([compiler().command[0], "-shared", "-Wl,-Bsymbolic", *objects, "-o", library, *flags, "-lm"])
    return ctypes.CDLL(str(library))


def work_sizes(function: ca.Function, prefix: str = "SZ") -> dict[str, int]:
    """Words for the sizes of what a generated function works on."""
    return {f"{prefix}_{name.upper()}": getattr(function, f"sz_{name}")() for name in ("arg", "res", "iw", "w")}


def defines(**values: object) -> str:
    """Lines of C that define some words."""
    return "".join(f"#define {name} {value}\n" for name, value in values.items())
