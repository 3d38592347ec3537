"""Seconds by which ``continuum_grasp/core/code.py`` chooses between interpreted and compiled code.

    python -m benchmarks.bench_code

Per model: CPU seconds of writing and compiling its steps, per line, and nanoseconds of an instruction of each kind of
code. Compilers are child processes, so all times are of this process and its children.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

import continuum_grasp as cg
from continuum_grasp.core import CodeKind, Compiler, step_function
from continuum_grasp.core.code import Size
from continuum_grasp.core.rollouts import Rollouts
from continuum_grasp.core.source import rollout_source
from continuum_grasp.simulation.initial import initial_state

SCENES = {
    "configs/simulate/hold_mug.yaml": "rodas",
    "configs/simulate/spirob_units.yaml": "extrapolated_euler",
    "configs/simulate/tendon_step.yaml": "rk4",
}
STEPS = 500


def cpu(work: Callable[[], object]) -> tuple[float, object]:
    """CPU seconds of some work with its child processes, and its result."""

    def now() -> float:
        times = os.times()
        return times.user + times.system + times.children_user + times.children_system

    began = now()
    result = work()
    return now() - began, result


class Loaded:
    """A compiled library in the place of ``Code``."""

    def __init__(self, library: ctypes.CDLL | None) -> None:
        self._library = library

    def library(self, calls: float) -> ctypes.CDLL | None:
        return self._library


def measure(path: str, method: str) -> None:
    scene = cg.load(path)
    model = cg.FingerModel(scene) if scene.object is None else cg.System(scene)
    step = step_function(model, method)
    size, compiler = Size.of(step), Compiler.find()
    writing, source = cpu(lambda: rollout_source(step))
    lines = str(source).count("\n")
    print(f"{path}: {size.instructions:.0f} instructions, {size.operations:.0f} operations, {lines} lines")
    print(f"  writing        {1e6 * writing / lines:8.2f} us/line")
    start = np.zeros((1, model.nx)) if scene.object is None else initial_state(scene, model)[None]
    signals = np.zeros(model.nu), np.zeros(model.nw)
    for kind in CodeKind:
        library = None
        if kind is not CodeKind.INTERPRETED:
            with tempfile.TemporaryDirectory() as folder:
                code, built = Path(folder) / "code.c", Path(folder) / "code.so"
                code.write_text(str(source))
                quick = kind is CodeKind.QUICK
                compiling, _ = cpu(partial(compiler.build, code, built, quick=quick))
                library = ctypes.CDLL(str(built))
            print(f"  {kind:14} {1e3 * compiling / lines:8.3f} ms/line of compiling")
        run = Rollouts.__new__(Rollouts)
        run._step, run._single, run._chains, run.code = step, True, {}, Loaded(library)
        arguments = (start, STEPS, 1, 1e-6, *signals, np.array(model.p_nominal, dtype=float))
        run(*arguments)
        began = process_time()
        run(*arguments)
        spent = (process_time() - began) / STEPS
        print(f"  {kind:14} {1e9 * spent / size.instructions:8.2f} ns/instruction")


if __name__ == "__main__":
    for path, method in SCENES.items():
        measure(path, method)
