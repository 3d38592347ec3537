"""Whether the series of the model are better summed with shorter chains of dependent operations.

Run ``python -m benchmarks.bench_series`` in the root of the repository (1 min; gcc-arm-none-eabi for the last column).
Horner's rule is one chain; Estrin's scheme adds pairs, pairs of pairs and so on, with the powers x^2, x^4; two chains
are Horner's rule for even and odd powers apart. All have the same coefficients, so the same bounds of the truncation
error. Each sums every series of the forward dynamics: the Stumpff functions of arcs, for which the model takes two
chains, sines and cosines between the nodes of clothoids, for which it takes one.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np

from benchmarks.bench_dynamics import finger, random_arguments
from benchmarks.c_loop import CLoop
from benchmarks.machine import one_core
from benchmarks.report import Report, Table
from continuum_grasp.export.fields import REALS
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.model import FingerModel

MODELS = (*(("arc", n) for n in (1, 2, 4, 8)), *(("clothoid", n) for n in (1, 2, 4)), ("matched_clothoid", 2))
_SERIES = import_module("continuum_grasp.model.stumpff")  # the package has a function of this name
_FIRST, _SAMPLE = 2_000, 5e-3
"""Evaluations to find out how many take a sample's time [s]."""
_BOARD = ("arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-std=c99", "-O2")
_STRICT = ("-fno-schedule-insns", "-ffp-contract=off", "-fno-math-errno", "-c", "-x", "c", "-")


def estrin(x: Any, k: int, degree: int) -> Any:
    """c_k(x) by Estrin's scheme."""
    terms, power = _SERIES.coefficients(k, degree), x
    while len(terms) > 1:
        pairs = [terms[i : i + 2] for i in range(0, len(terms), 2)]
        terms = [pair[0] + pair[1] * power if len(pair) == 2 else pair[0] for pair in pairs]
        power = power * power
    return terms[0]


SUMS: dict[str, Callable[[Any, int, int], Any]] = {
    "Horner": _SERIES._one_chain,
    "Estrin": estrin,
    "two chains": _SERIES._two_chains,
}


def depth(function: ca.Function) -> int:
    """Longest chain of operations of which each waits for the one before."""
    at: dict[int, int] = {}
    for k in range(function.n_instructions()):
        given = [at[place] for place in function.instruction_input(k) if place in at]
        leaf = function.instruction_id(k) in (ca.OP_INPUT, ca.OP_CONST)
        if function.instruction_id(k) != ca.OP_OUTPUT:
            at[function.instruction_output(k)[0]] = 0 if leaf else 1 + max(given)
    return max(at.values())


def on_a_board(function: ca.Function) -> int | None:
    """Instructions of the strict C on a Cortex-M4F in float, all of which are executed; None without its compiler."""
    if shutil.which(_BOARD[0]) is None:
        return None
    kernel = Kernel("f", function, "")
    source = f"typedef float p_real;\n{kernel.c_source('p', REALS['float'])}"
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "f.o"
        subprocess.run([*_BOARD, *_STRICT, "-o", str(built)], input=source, text=True, check=True)
        listed = subprocess.run(["arm-none-eabi-objdump", "-d", built], capture_output=True, text=True, check=True)
    return sum(line.count(":\t") for line in listed.stdout.splitlines())


def processor_times(contestants: dict[Any, CLoop], rounds: int, rng: np.random.Generator) -> dict[Any, np.ndarray]:
    """Seconds of processor time per evaluation and round; a machine that others use too distorts wall time more."""
    keys = list(contestants)
    counts, found = {}, {key: np.zeros(rounds) for key in keys}
    for key in keys:
        start = time.thread_time()
        contestants[key](_FIRST)
        counts[key] = max(1, int(_SAMPLE * _FIRST / max(time.thread_time() - start, 1e-9)))
    for k in range(rounds):
        for j in rng.permutation(len(keys)):
            start = time.thread_time()
            contestants[keys[j]](counts[keys[j]])
            found[keys[j]][k] = (time.thread_time() - start) / counts[keys[j]]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=61, help="interleaved, per model")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    report, rng, rows = Report("series", asked.seed), np.random.default_rng(asked.seed), []
    for family, count in MODELS:
        functions: dict[str, ca.Function] = {}
        given: list[np.ndarray] = []
        for name, series in SUMS.items():
            with patch.multiple(_SERIES, _one_chain=series, _two_chains=series):
                model = FingerModel(finger(), elements=count, family=family)
                functions[name] = model.forward_dynamics
            given = given or random_arguments(model, rng)
        contestants = {(n, w): CLoop(f, given, dependent=w) for n, f in functions.items() for w in (True, False)}
        with one_core():
            times = processor_times(contestants, asked.rounds, rng)
        for name, function in functions.items():
            row: list[Any] = [family, count, name, depth(function)]
            for waits in (True, False):
                own = times[name, waits]
                row += [1e9 * float(np.median(own)), float(np.median(own / times["Horner", waits]))]
            rows.append([*row, on_a_board(function)])
            print(rows[-1], flush=True)
    columns = ["family", "elements", "sum", "longest chain", "waiting [ns]", "ratio", "independent [ns]", "ratio"]
    note = "Waiting: an evaluation needs the one before, as in a simulation. Ratios: to Horner's rule, medians."
    report.tables.append(Table("Forward dynamics", [*columns, "Cortex-M4F [instructions]"], rows, note))
    for file in report.write():
        print(file)
    print(report.status)


if __name__ == "__main__":
    main()
