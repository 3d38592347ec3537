"""Real-time iterations beside other solvers of the same receding-horizon problems.

Run ``python -m benchmarks.bench_mpc`` in the root of the repository; parts of it by ``--only``, problems by ``--cases``
(``cart_pole`` and ``two_links`` are no continuum fingers). Closed loops in C on one core, timed by the processor time
of their thread in rounds in which the solvers take turns: the package's, acados (see ``mpc.peers``) and CasADi's
generated ``sqpmethod``; the same problems solved to convergence by IPOPT and do-mpc, from Python. What is not there is
listed as not measured. ``--only oracle`` instead solves random QPs (penalties over five orders, absent bounds, states
up to ten times the bounds, random plans) by the C and by qpOASES, which has the slacks of the rows as variables.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.harness import CONFIGS, one_core, quartiles
from benchmarks.mpc import cases as mpc_cases
from benchmarks.mpc.cases import Case
from benchmarks.mpc.loop import FLAGS, CLoop, LoopRun, rti_loop
from benchmarks.mpc.peers import FORMS, acados_loops, acados_words, converged, dompc, sqp_loop
from benchmarks.mpc.world import World
from benchmarks.real_time_iteration import RealTimeIteration
from benchmarks.report import Report, begun
from continuum_grasp.base import Array
from continuum_grasp.control import Controller
from tests.rti_cases import SIZES, change_of_plan, disturb, qp_of, random_stages

OURS = ("ours, scalar", "ours, lanes", "ours, lanes, float")
PEER = "sqpmethod + qrqp, custom_jacobian"
"""The reference of ratios: the fastest form that CasADi's users are shown."""
WORTH = 0.9
"""Share of solved steps below which a solver is run once only."""
COSTS = ("closed-loop cost", "worst excess of a row, share")
CONTROLLED = ("nitinol_moment", "steady_tip")
"""Shipped scenes whose controllers are called from Python."""
SETS = 36
"""Random problems of the comparison with qpOASES, over which the QPs are spread."""
HARD = {"linear": 1e4, "quadratic": 1e6}
"""Penalties of rows that are to be satisfied wherever they can be, which every third of these problems has."""


def measured(loops: Mapping[str, CLoop], rounds: int, seed: int) -> dict[str, list[LoopRun]]:
    """Closed loops of all, in rounds in an order drawn anew; the first of each, which is not counted, is warm-up."""
    order, found = random.Random(seed), {name: [] for name in loops}
    for loop in loops.values():
        loop()
    for _ in range(rounds):
        names = list(loops)
        order.shuffle(names)
        for name in names:
            found[name].append(loops[name]())
    return found


def us(runs: Sequence[LoopRun], percent: float = 50.0) -> Array:
    """A percentile of the time of steps in each round [us]."""
    return 1e6 * np.array([np.percentile(run.step_seconds, percent) for run in runs])


def phases(runs: Sequence[LoopRun]) -> list[float]:
    """Medians of preparation and feedback [us]."""
    return [float(v) for v in 1e6 * np.median([np.median(run.seconds, axis=0) for run in runs], axis=0)]


def ratio(runs: Mapping[str, Sequence[LoopRun]], of: str, to: str) -> float:
    """Median over rounds of the ratio of median times."""
    pair = [us(runs[name]) for name in (of, to)]
    return float(np.median(pair[0] / pair[1])) if len(pair[0]) == len(pair[1]) else math.nan


def our_loops(case: Case) -> dict[str, CLoop]:
    """The package's solver as it is timed."""
    return {
        OURS[0]: rti_loop(case, lanes=False),
        OURS[1]: rti_loop(case),
        OURS[2]: rti_loop(case, real="float"),
    }


def add_race(report: Report, asked: argparse.Namespace) -> None:
    """Headline: one iteration per step in C, by others and by ours."""
    for name in asked.cases:
        case = mpc_cases.case(name, seed=report.seed)
        loops = {f"sqpmethod + qrqp, {form}": sqp_loop(case, form) for form in FORMS}
        loops |= acados_loops(case, report.missing) | our_loops(case)
        checked = {label: loop(keep=True) for label, loop in loops.items()}
        timed = {label: loop for label, loop in loops.items() if checked[label].good.mean() >= WORTH}
        runs = {label: [run] for label, run in checked.items()} | measured(timed, asked.rounds, report.seed)
        rows = []
        for label in loops:
            low, middle, high = quartiles(us(runs[label]))
            p99, retained = float(np.median(us(runs[label], 99.0))), checked[label]
            cold = float(np.median([1e6 * run.cold for run in runs[label]]))
            solved = f"{int(retained.good.sum())}/{case.steps}"
            costs = case.cost(retained.x, retained.u), case.excess(retained.x, retained.u)
            timing = [middle, low, high, p99, p99 / middle, *phases(runs[label]), cold]
            ratios = [ratio(runs, label, own) for own in OURS[:2]]
            rows.append([label, *timing, *ratios, solved, *costs])
        columns = ["", "median [us]", "quartile 1", "quartile 3", "p99 [us]", "p99 / median", "prepare", "feedback"]
        columns += ["cold [us]", *(f"times {own}" for own in OURS[:2]), "solved", *COSTS]
        note = (
            f"{case.what}; N = {case.stages.stages}, {case.stages.substeps} step(s) per stage ({case.stages.method}), "
            f"{case.stages.nx} states, {case.stages.nu} input(s), {case.stages.nc} row(s). A reading of the clock "
            f"takes {1e9 * loops[OURS[0]].timer_cost():.0f} ns and is in every time. Quartiles are of the rounds' "
            f"medians. {'; '.join(f'{form}: {text}' for form, text in FORMS.items())}.{acados_words()}"
        )
        report.table(f"Closed loop: {name}", columns, rows, note)
        if name == "arcs":
            report.claim("arcs: sqpmethod + qrqp / ours, scalar", ratio(runs, PEER, OURS[0]), ">=", 7.0)
            report.claim("arcs: sqpmethod + qrqp / ours, lanes", ratio(runs, PEER, OURS[1]), ">=", 15.0)
            for label in OURS[:2]:
                spread = float(np.median(us(runs[label], 99.0) / us(runs[label])))
                report.claim(f"arcs: p99 / median, {label}", spread, "<=", 3.0)
        for label in OURS[:2]:
            share = float(checked[label].good.mean())
            report.claim(f"{name}: share of steps solved, {label}", share, ">=", 1.0)


def add_converged(report: Report, asked: argparse.Namespace) -> None:
    """Every problem solved: IPOPT from the shifted solution before, and do-mpc as it comes."""
    for name in asked.cases:
        case = mpc_cases.case(name, seed=report.seed, steps=asked.slow_steps)
        runs = {OURS[0]: rti_loop(case, lanes=False)(), OURS[1]: rti_loop(case)()}
        runs["IPOPT, Gauss-Newton"] = converged(case, soft=False)
        try:
            run, versions = dompc(case)
            runs[f"do-mpc {versions.get('do-mpc', '')}"] = run
        except RuntimeError as error:
            report.missing.append(f"{name}: {str(error).splitlines()[-1]}")
        # Without the penalties of rows, which are hard here.
        none = np.zeros(case.stages.nc)
        plain = replace(case, stages=replace(case.stages, linear=none, quadratic=none))
        rows = []
        for label, run in runs.items():
            solved = f"{int(run.good.sum())}/{case.steps}"
            costs = plain.cost(run.x, run.u), case.excess(run.x, run.u)
            rows.append([label, float(us([run])[0]), float(us([run], 99.0)[0]), solved, *costs])
        note = (
            f"{case.what}. Ours: one iteration, C. Others from Python, processor time, multiple shooting with hard "
            "rows; do-mpc by its defaults (collocation of degree 2). Costs differ where solvers swing another way."
        )
        columns = ["", "median [us]", "99 %", "solved", *COSTS]
        report.table(f"{name}: to convergence", columns, rows, note)
        if name == "arcs" and len(runs) == 4:
            report.claim("arcs: do-mpc / ours, scalar", rows[3][1] / rows[0][1], ">=", 400.0)


def add_python(report: Report, asked: argparse.Namespace) -> None:
    """What a step from Python takes beyond its phases in C."""
    rows = []
    for name in CONTROLLED:
        controller = Controller(CONFIGS / "mpc" / f"{name}.yaml", deadline=math.inf)
        plant, stages = World(controller), controller.stages
        u, took = np.clip(np.zeros(stages.nu), stages.u_min, stages.u_max), []
        with one_core():
            for _ in range(asked.python_steps):
                measurement = plant.step(u, stages.p_nominal)
                began = time.perf_counter_ns()
                command = controller.step(measurement)
                elapsed = 1e-3 * (time.perf_counter_ns() - began)
                u, phases_ = command.u, 1e6 * np.array(command.time)
                took.append([elapsed, *phases_, elapsed - phases_.sum()])
        steps = np.array(took)
        for k, label in enumerate(("Controller.step", "estimate", "prepare", "feedback", "beyond those")):
            rows.append([name, label, *(float(v) for v in np.percentile(steps[:, k], [25, 50, 75, 99]))])
        beyond = float(np.median(steps[:, -1]))
        report.claim(f"{name}: Controller.step beyond its phases in C [us]", beyond, "<=", 15.0)
    note = (
        "Wall time. Phases by C's own clock; beyond: arguments, setpoints of the scene, statistics. The library is "
        "compiled with the flags of the package, not with those of this benchmark."
    )
    columns = ["", "", "quartile 1 [us]", "median [us]", "quartile 3 [us]", "p99 [us]"]
    report.table("From Python", columns, rows, note)


def add_oracle(report: Report, asked: argparse.Namespace) -> None:
    """Answers to random QPs against those of an active-set solver."""
    columns = ["set", "N nx nu ns others", "problems", "median", "99.9 %", "worst", "cost above", "cost below"]
    columns += ["rounds", "most rounds", "not solved", "no answer of qpOASES"]
    note = "Largest difference of the answer over its largest entry; cost over the larger of 1 and itself."
    table, limit = report.table("Against qpOASES", columns, note=note), 1e-6 if asked.precision == "double" else 1e-3
    sets = min(SETS, asked.problems)
    for k in range(sets):
        size, rng = SIZES[k % len(SIZES)], np.random.default_rng((report.seed, k))
        hard = {name: np.full(size[3] + size[4], penalty) for name, penalty in HARD.items()} if k % 3 == 2 else {}
        rti = RealTimeIteration(random_stages(k, size, **hard), precision=asked.precision, lanes=False)
        off, above, rounds, unsolved, unanswered = [], [], [], 0, 0
        for _ in range(-(-asked.problems // sets)):
            x0 = disturb(rti, rng)
            q = qp_of(rti, x0)
            found = rti.feedback(x0)
            unsolved += found.status == 1
            rounds.append(found.iterations)
            try:
                expected = q.solve()
            except RuntimeError:
                unanswered += 1
                continue
            z, least = change_of_plan(rti), q.cost(expected)
            off.append(np.abs(z - expected).max() / np.abs(expected).max())
            above.append((q.cost(z) - least) / max(1.0, abs(least)))
        numbers = *np.quantile(off, [0.5, 0.999, 1.0]), max(above), min(above), *np.quantile(rounds, [0.5, 1.0])
        table.add(k, " ".join(map(str, size)), len(off), *map(float, numbers), unsolved, unanswered)
    report.claim("worst difference from qpOASES", max(row[5] for row in table.rows), "<=", limit)


PARTS = {"race": add_race, "converged": add_converged, "python": add_python, "oracle": add_oracle}


def main() -> None:
    """Run the parts asked for and write the report."""
    asked, report = begun(
        __doc__,
        "mpc",
        only=(["race", "converged", "python"], "", PARTS),
        cases=(mpc_cases.NAMES, ""),
        rounds=15,
        slow_steps=(150, "of do-mpc and IPOPT"),
        python_steps=5000,
        problems=(10_000, "QPs for qpOASES"),
        precision=("double", "of the C beside qpOASES", ("double", "float")),
        seed=0,
    )
    report.machine["flags"] = " ".join(FLAGS)
    for part in asked.only:
        PARTS[part](report, asked)
        print(part, "done", time.strftime("%H:%M:%S"), flush=True)
    report.finish()


if __name__ == "__main__":
    main()
