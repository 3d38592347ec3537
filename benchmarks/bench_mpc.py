"""Real-time iterations beside other solvers of the same receding-horizon problems.

Run ``python -m benchmarks.bench_mpc`` in the root of the repository; parts of it by ``--only``. Closed loops in C on
one core, timed by the processor time of their thread in rounds in which the solvers take turns; do-mpc and IPOPT from
Python. Costs of the closed loops are compared with those of converged solutions.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import mpc_cases
from benchmarks.harness import quartiles
from benchmarks.machine import one_core
from benchmarks.mpc_acados import acados_loops
from benchmarks.mpc_cases import Case
from benchmarks.mpc_dompc import dompc
from benchmarks.mpc_loop import FLAGS, CLoop, LoopRun
from benchmarks.mpc_ours import rti_loop
from benchmarks.mpc_peers import FORMS, converged, sqp_loop
from benchmarks.mpc_world import World
from benchmarks.real_time_iteration import RealTimeIteration
from benchmarks.report import RESULTS, Report, Table
from continuum_grasp.control.controller import Controller

Array = NDArray[np.float64]

PARTS = ("race", "dompc", "cost", "horizon", "states", "constraints", "python")
OURS = ("ours, scalar", "ours, lanes", "ours, lanes, float")
PEER = "sqpmethod + qrqp, custom_jacobian"
"""The reference of ratios: the fastest form that CasADi's users are shown."""
WORTH = 0.9
"""Share of solved steps below which a solver is run once only."""
ONCE_OR_TWICE = ("one iteration, double", "two iterations, double")
"""Loops whose cost is compared with that of a converged one."""
HORIZONS = (10, 20, 30, 50, 100)
CONTROLLED = ("nitinol_moment", "tip_circle")
"""Shipped scenes whose controllers are called from Python."""
SIZES = {"arc": (2, 3, 4, 6, 8), "clothoid": (1, 2, 3), "matched_clothoid": (2, 3, 4)}
"""Elements of each family; clothoids have one unknown more than elements."""


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


def add_race(report: Report, arguments: argparse.Namespace) -> None:
    """Headline: the same problems by CasADi's generated SQP and by ours."""
    for name in arguments.cases:
        case = mpc_cases.case(name, seed=report.seed)
        loops = {f"sqpmethod + qrqp, {form}": sqp_loop(case, form) for form in FORMS}
        loops |= acados_loops(case, report.missing) | our_loops(case)
        checked = {label: loop(keep=True) for label, loop in loops.items()}
        timed = {label: loop for label, loop in loops.items() if checked[label].good.mean() >= WORTH}
        runs = {label: [run] for label, run in checked.items()} | measured(timed, arguments.rounds, report.seed)
        rows = []
        for label, loop in loops.items():
            low, middle, high = quartiles(us(runs[label]))
            p99, retained = float(np.median(us(runs[label], 99.0))), checked[label]
            cold = float(np.median([1e6 * run.cold for run in runs[label]]))
            solved = f"{int(retained.good.sum())}/{case.steps}"
            cost = case.cost(retained.x, retained.u)
            timing = [middle, low, high, p99, p99 / middle, *phases(runs[label]), cold]
            rows.append([label, *timing, ratio(runs, label, OURS[1]), solved, cost, loop.code_bytes / 1024.0])
        columns = ["", "median [us]", "quartile 1", "quartile 3", "p99 [us]", "p99 / median", "prepare", "feedback"]
        columns += ["cold [us]", f"times {OURS[1]}", "solved", "closed-loop cost", "code [KiB]"]
        note = (
            f"{case.what}; N = {case.stages.stages}, {case.stages.substeps} step(s) per stage ({_method(case)}), "
            f"{case.stages.nx} states, {case.stages.nu} input(s), {case.stages.nc} row(s). A reading of the clock "
            f"takes {1e9 * loops[OURS[0]].timer_cost():.0f} ns and is in every time. Quartiles are of the rounds' "
            f"medians. {'; '.join(f'{form}: {text}' for form, text in FORMS.items())}."
        )
        report.tables.append(Table(f"Closed loop: {name}", columns, rows, note))
        if name == "arcs":
            report.claim("arcs: sqpmethod + qrqp / ours, scalar", ratio(runs, PEER, OURS[0]), ">=", 7.0)
            report.claim("arcs: sqpmethod + qrqp / ours, lanes", ratio(runs, PEER, OURS[1]), ">=", 15.0)
            for label in OURS[:2]:
                spread = float(np.median(us(runs[label], 99.0) / us(runs[label])))
                report.claim(f"arcs: p99 / median, {label}", spread, "<=", 3.0)
        for label in OURS[:2]:
            share = float(checked[label].good.mean())
            report.claim(f"{name}: share of steps solved, {label}", share, ">=", 1.0)


def _method(case: Case) -> str:
    return str(getattr(case.stages, "method", "rk4"))


def add_dompc(report: Report, arguments: argparse.Namespace) -> None:
    """do-mpc as it comes, and IPOPT on the very problem."""
    for name in ("arcs", "lag"):
        if name not in arguments.cases:
            continue
        case = mpc_cases.case(name, seed=report.seed, steps=arguments.slow_steps)
        ours = {OURS[0]: rti_loop(case, lanes=False), OURS[1]: rti_loop(case)}
        runs: dict[str, list[LoopRun]] = {"do-mpc": []}
        versions: dict[str, str] = {}
        for turn in range(arguments.slow_rounds):
            try:
                run, versions = dompc(case)
                runs["do-mpc"].append(run)
            except RuntimeError as error:
                report.missing.append(str(error))
                break
            for label, found in measured(ours, 5, report.seed + turn).items():
                middle = sorted(found, key=lambda run: float(np.median(run.step_seconds)))[2]
                runs.setdefault(label, []).append(middle)
        for label, options in (("IPOPT, Gauss-Newton", {}), ("IPOPT, Gauss-Newton, compiled", {"compiled": True})):
            runs[label] = [converged(case, soft=False, **options)]
        rows = []
        for label, found in runs.items():
            if found:
                middle, p99 = float(np.median(us(found))), float(np.median(us(found, 99.0)))
                solved = f"{int(found[-1].good.sum())}/{case.steps}"
                rows.append([label, middle, p99, solved, case.cost(found[-1].x, found[-1].u)])
        note = (
            f"{case.what}. do-mpc {versions.get('do-mpc', '')} with its defaults (collocation of degree 2, IPOPT) and "
            "hard bounds; IPOPT: this problem by multiple shooting, warm. Processor time of calls from Python."
        )
        report.tables.append(
            Table(f"To convergence: {name}", ["", "median [us]", "p99 [us]", "solved", "closed-loop cost"], rows, note)
        )
        if name == "arcs" and runs["do-mpc"]:
            for label in OURS[:2]:
                times = float(np.median(us(runs["do-mpc"]) / us(runs[label])))
                report.claim(f"arcs: do-mpc / {label}", times, ">=", 400.0)


def add_cost(report: Report, arguments: argparse.Namespace) -> None:
    """What one iteration per step costs in the closed loop."""
    rows = []
    for name in arguments.cases:
        case = mpc_cases.case(name, seed=report.seed, steps=arguments.cost_steps)
        truth = converged(case)
        least = case.cost(truth.x, truth.u)
        runs = {
            "IPOPT, Gauss-Newton": truth,
            "IPOPT, exact Hessian": converged(case, exact=True, steps=arguments.exact_steps),
            ONCE_OR_TWICE[0]: rti_loop(case)(keep=True),
            "one iteration, float": rti_loop(case, real="float")(keep=True),
            ONCE_OR_TWICE[1]: rti_loop(case, iterations=2)(keep=True),
            "three iterations, double": rti_loop(case, iterations=3)(keep=True),
        }
        for label, run in runs.items():
            count = len(run.u)
            reference = least if count == case.steps else case.cost(truth.x[: count + 1], truth.u[:count])
            cost = case.cost(run.x, run.u)
            more = 100.0 * (cost / reference - 1.0)
            solved = f"{int(run.good.sum())}/{count}"
            rows.append([name, label, cost, f"{more:+.4f}", case.excess(run.x, run.u), solved])
            if label in ONCE_OR_TWICE and (name, label) != ("jumps", ONCE_OR_TWICE[0]):
                report.claim(f"{name}, {label}: closed-loop cost beyond converged [%]", more, "<=", 0.1)
    note = (
        "Violations at their penalty included. jumps: a setpoint that jumps farther than one linearization reaches; of "
        "one iteration per step stated with no limit (controller.sqp_iterations: 2 is the second one)."
    )
    columns = ["problem", "solver", "closed-loop cost", "more than converged [%]", "worst excess of a row", "solved"]
    report.tables.append(Table("Closed-loop cost", columns, rows, note))


def growth(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Exponent of a power law, by least squares of the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def add_horizon(report: Report, arguments: argparse.Namespace) -> None:
    """Time against the number of stages."""
    rows, medians = [], {label: [] for label in (PEER, *OURS[:2])}
    for horizon in HORIZONS:
        case = mpc_cases.case("arcs", seed=report.seed, horizon=horizon)
        loops = {PEER: sqp_loop(case, "custom_jacobian")} | dict(list(our_loops(case).items())[:2])
        runs = measured(loops, arguments.rounds, report.seed)
        row: list[Any] = [horizon]
        for label in medians:
            medians[label].append(float(np.median(us(runs[label]))))
            row += [medians[label][-1], float(np.median(us(runs[label], 99.0)))]
        rows.append([*row, *phases(runs[OURS[1]]), ratio(runs, PEER, OURS[1])])
    exponents = {label: growth(HORIZONS, found) for label, found in medians.items()}
    columns = ["stages", *(f"{label} {what} [us]" for label in medians for what in ("median", "p99"))]
    columns += ["prepare", "feedback", "ratio"]
    said = ", ".join(f"{label}: N^{exponent:.2f}" for label, exponent in exponents.items())
    report.tables.append(Table("Horizon (arcs)", columns, rows, f"Growth of the median: {said}."))
    for label in OURS[:2]:
        report.claim(f"growth with the horizon, {label}: exponent", exponents[label], "<=", 1.1)


def add_states(report: Report, arguments: argparse.Namespace) -> None:
    """Time against the number of unknowns, by family."""
    rows = []
    for family, counts in SIZES.items():
        for elements in counts:
            unknowns = elements + (family == "clothoid")
            case = mpc_cases.arcs(
                family=family,
                elements=elements,
                substeps=None,
                steps=200,
                seed=report.seed,
                largest=0.6,
                speed=40.0,
            )
            began = time.perf_counter()
            loop = rti_loop(case)
            built, retained = time.perf_counter() - began, loop(keep=True)
            runs = measured({"ours": loop}, arguments.rounds, report.seed)["ours"]
            stages, middle = case.stages, float(np.median(us(runs)))
            row = [
                family,
                unknowns,
                stages.nx,
                f"{_method(case)} x {stages.substeps}",
                stages.step.expand().n_instructions(),
            ]
            rows.append(
                [*row, middle, float(np.median(us(runs, 99.0))), *phases(runs), int(retained.good.sum()), built]
            )
            print(rows[-1], flush=True)
    columns = ["family", "unknowns", "states", "steps per stage", "instructions", "median [us]", "p99 [us]", "prepare"]
    columns += ["feedback", "solved of 200", "compiled in [s]"]
    note = "Ours, lanes, N = 30; steps per stage by the model's stiffness."
    report.tables.append(Table("Unknowns", columns, rows, note))


def add_constraints(report: Report, arguments: argparse.Namespace) -> None:
    """Time against what is bounded."""
    rows = []
    makers: dict[str, Callable[[], Case]] = {
        f"arcs, {bounds}": lambda bounds=bounds: mpc_cases.arcs(bounds=bounds, seed=report.seed)
        for bounds in ("none", "box", "zones")
    }
    makers |= {
        f"tendons, {'box and zone' if zone else 'box'}": lambda zone=zone: mpc_cases.tendons(zone=zone)
        for zone in (False, True)
    }
    for name, maker in makers.items():
        case = maker()
        loop = rti_loop(case)
        retained = loop(keep=True)
        runs = measured({"ours": loop}, arguments.rounds, report.seed)["ours"]
        middle, p99 = float(np.median(us(runs))), float(np.median(us(runs, 99.0)))
        solved = f"{int(retained.good.sum())}/{case.steps}"
        row = [name, case.stages.nc, middle, p99, p99 / middle, *phases(runs)]
        rows.append([*row, case.excess(retained.x, retained.u), solved])
    columns = ["problem", "rows", "median [us]", "p99 [us]", "p99 / median", "prepare", "feedback"]
    note = (
        "Ours, lanes, N = 30. none: input limits alone; zones: four sections of every element stay out of a half-plane."
    )
    report.tables.append(Table("Constraints", [*columns, "worst excess", "solved"], rows, note))


def add_python(report: Report, arguments: argparse.Namespace) -> None:
    """What a step from Python takes beyond its phases in C."""
    rows = []
    for name in CONTROLLED:
        controller = Controller(mpc_cases.CONFIGS / "mpc" / f"{name}.yaml", deadline=math.inf)
        plant, stages = World(controller), controller.stages
        u, took = np.clip(np.zeros(stages.nu), stages.u_min, stages.u_max), []
        with one_core():
            for _ in range(arguments.python_steps):
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
    for name in ("arcs", "tendons"):
        case = mpc_cases.case(name, seed=report.seed)
        solver, loop = RealTimeIteration(case.stages), rti_loop(case)
        found = loop(keep=True)
        solver.reset(case.x0, case.u0)
        times = []
        with one_core():
            for k in range(arguments.python_steps):
                at = k % case.steps
                began = time.perf_counter_ns()
                solver.step(found.x[at], case.references[at], case.p)
                solver.shift()
                times.append(1e-3 * (time.perf_counter_ns() - began))
        rows.append(
            [name, "RealTimeIteration.step, .shift", *(float(v) for v in np.percentile(times, [25, 50, 75, 99]))]
        )
        in_c = us(measured({"": loop}, 5, report.seed)[""])
        rows.append([name, "the same in C", *quartiles(in_c), math.nan])
        report.claim(
            f"{name}: RealTimeIteration from Python beyond C [us]", np.median(times) - np.median(in_c), "<=", 15
        )
    note = (
        "Wall time. Phases by C's own clock; beyond: arguments, setpoints of the scene, statistics. The library that "
        "Python calls is compiled with the flags of the package, not with those of this benchmark."
    )
    columns = ["", "", "quartile 1 [us]", "median [us]", "quartile 3 [us]", "p99 [us]"]
    report.tables.append(Table("From Python", columns, rows, note))


def main() -> None:
    """Run the parts asked for and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    parser.add_argument("--cases", nargs="*", choices=mpc_cases.NAMES, default=list(mpc_cases.NAMES))
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--slow-rounds", type=int, default=3, help="of do-mpc")
    parser.add_argument("--slow-steps", type=int, default=400, help="of do-mpc and IPOPT")
    parser.add_argument("--cost-steps", type=int, default=400, help="of the converged loops")
    parser.add_argument("--exact-steps", type=int, default=60, help="of those with an exact Hessian")
    parser.add_argument("--python-steps", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--name", default="mpc", help="name of the report")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where to write it")
    arguments = parser.parse_args()
    report = Report(arguments.name, arguments.seed)
    report.machine["flags"] = " ".join(FLAGS)
    parts = {
        "race": add_race,
        "dompc": add_dompc,
        "cost": add_cost,
        "horizon": add_horizon,
        "states": add_states,
        "constraints": add_constraints,
        "python": add_python,
    }
    for part in arguments.only:
        parts[part](report, arguments)
        print(part, "done", time.strftime("%H:%M:%S"), flush=True)
    report.machine["load_average_after"] = list(os.getloadavg())
    for file in report.write(arguments.folder):
        print(file)
    for claim in report.claims:
        print("met   " if claim.met else "BROKEN", claim.what, f"{claim.value:.4g} {claim.relation} {claim.limit:g}")
    print(report.status)


if __name__ == "__main__":
    main()
