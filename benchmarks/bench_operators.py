"""Operators of JAX and PyTorch: values and derivatives of dynamics and rollouts in batches, against CasADi's ``map``.

Run ``python -m benchmarks.bench_operators`` in the root of the repository; see README.md beside this file.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.bench_dynamics import finger
from benchmarks.harness import race, ratios
from benchmarks.machine import one_core
from benchmarks.report import Report, Table
from continuum_grasp.model import FingerModel
from continuum_grasp.operators.derivatives import held_step

BATCHES = (1, 64, 4096)
STEPS, STEP = 16, 1e-4
"""Of a rollout: number, and length [s]."""
REFERENCE = "CasADi map"
Work = Callable[[], Any]


def model() -> FingerModel:
    """Two arcs with a tip mass, weight, damping and tendons; stiffness and damping are arguments."""
    return FingerModel(finger(), elements=2, family="arc", parameters=["bending_stiffness", "material_damping"])


def rows(made: FingerModel, count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Random states, inputs and forces, and nominal parameters."""
    x = rng.uniform(-0.5, 0.5, (count, made.nx))
    u, w = rng.uniform(0.0, 5.0, (count, made.nu)), rng.uniform(-0.2, 0.2, (count, made.nw))
    return [x, u, w, np.tile(made.p_nominal, (count, 1))]


def of_casadi(made: FingerModel, given: list[np.ndarray]) -> dict[str, Work]:
    """The same by CasADi alone, as its users would: ``mapaccum``, ``map`` and ``reverse``, on its virtual machine."""
    count = len(given[0])
    symbols = [ca.MX.sym(name, size.shape[1]) for name, size in zip("xuwp", given, strict=True)]
    step = ca.Function("step", symbols, [held_step(made, "rk4")(*symbols, STEP)])
    columns = [ca.DM(value.T) for value in given]
    repeated = [columns[0], *(ca.DM(np.repeat(value, STEPS, axis=0).T) for value in given[1:])]
    found = {}
    for name, function, inputs in (
        ("dynamics", made.forward_dynamics.map(count), columns),
        ("rollout", step.mapaccum(STEPS).map(count), repeated),
    ):
        back = function.reverse(1)
        outputs = function.call(inputs)
        seeds = [ca.DM.ones(*out.shape) for out in outputs]
        found[f"{name}, forward"] = lambda f=function, i=inputs: f.call(i)
        found[f"{name}, forward and back"] = lambda f=function, b=back, i=inputs, s=seeds: b.call([*i, *f.call(i), *s])
    return found


def of_torch(made: FingerModel, given: list[np.ndarray]) -> dict[str, Work]:
    """By PyTorch tensors of float64."""
    import torch

    from continuum_grasp.operators import TorchOperators

    operators = TorchOperators(made)
    tensors = [torch.tensor(value, requires_grad=True) for value in given]
    x, u, w, p = tensors

    def rollout() -> Any:
        return operators.rollout(x, STEPS, STEP, u=u[:, None], w=w[:, None], p=p)

    def forward(work: Work) -> Any:
        with torch.no_grad():
            return work()

    works = {"dynamics": lambda: operators.forward_dynamics(x, u, w, p), "rollout": rollout}
    found: dict[str, Work] = {}
    for name, work in works.items():
        found[f"{name}, forward"] = lambda work=work: forward(work)
        found[f"{name}, forward and back"] = lambda work=work: torch.autograd.grad(work().sum(), tensors)
    return found


def of_jax(made: FingerModel, given: list[np.ndarray]) -> dict[str, Work]:
    """By JAX arrays of float64, within ``jit``."""
    import jax

    from continuum_grasp.operators import JaxOperators

    jax.config.update("jax_enable_x64", True)
    operators = JaxOperators(made)
    arrays = [jax.numpy.array(value) for value in given]

    def rollout(x: Any, u: Any, w: Any, p: Any) -> Any:
        return operators.rollout(x, STEPS, STEP, u=u[:, None], w=w[:, None], p=p)

    found: dict[str, Work] = {}
    for name, work in {"dynamics": operators.forward_dynamics, "rollout": rollout}.items():
        value = jax.jit(work)
        gradient = jax.jit(jax.value_and_grad(lambda *given, work=work: work(*given).sum(), argnums=(0, 1, 2, 3)))
        found[f"{name}, forward"] = lambda value=value: jax.block_until_ready(value(*arrays))
        found[f"{name}, forward and back"] = lambda gradient=gradient: jax.block_until_ready(gradient(*arrays))
    return found


def main() -> None:
    """Race all and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--batches", type=int, nargs="+", default=BATCHES)
    parser.add_argument("--repeats", type=int, default=11)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    report, rng, made = Report("operators", arguments.seed), np.random.default_rng(arguments.seed), model()
    by = {REFERENCE: of_casadi, "PyTorch": of_torch, "JAX, jit": of_jax}
    table = []
    for count in arguments.batches:
        given = rows(made, count, rng)
        works: dict[str, dict[str, Work]] = {}
        for name, build in by.items():
            try:
                works[name] = build(made, given)
            except ImportError as error:
                report.missing.append(f"{name}: {error}")
        for task in works[REFERENCE]:
            contestants = {name: _times(work[task]) for name, work in works.items()}
            with one_core():
                timings = race(contestants, repeats=arguments.repeats, seed=report.seed)
            found = ratios(timings, REFERENCE)
            for name, timing in timings.items():
                per_row = 1e6 * timing.median / count
                table.append([task, count, name, 1e6 * timing.median, per_row, found[name][1], timing.status])
                if count == max(BATCHES) and name != REFERENCE:
                    report.claim(
                        f"{task}, {count} rows: {name} takes so many times CasADi's map", found[name][1], "<=", 1.0
                    )
    columns = ["task", "rows", "", "median [us]", "per row [us]", "times CasADi's map", "status"]
    note = (
        f"Two arcs, everything in, double precision, one core. A rollout has {STEPS} steps of rk4; back: cotangents of "
        "states, inputs, forces and parameters. CasADi runs on its virtual machine, on arrays that are its own already."
    )
    report.tables.append(Table("Values and derivatives in batches", columns, table, note))
    for file in report.write():
        print(file)
    print(report.status)


def _times(work: Work) -> Callable[[int], None]:
    def run(count: int) -> None:
        for _ in range(count):
            work()

    return run


if __name__ == "__main__":
    main()
