"""The solver of any problem beside others, on a cart-pole and on a finger of two rigid links.

Run ``python -m benchmarks.bench_rti`` in the root of the repository. Closed loops in C by the package's real-time
iterations, acados (see ``mpc_acados``) and CasADi's generated ``sqpmethod``, in turns on one core; the same problems
solved to convergence by IPOPT, fatrop, ``sqpmethod`` and do-mpc; and the QPs of the loop by HPIPM, whose sources
``CONTINUUM_GRASP_HPIPM`` names (see ``mpc_hpipm``). What is not there is listed as not measured.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from benchmarks import rti_problems
from benchmarks.bench_mpc import measured, phases, us
from benchmarks.harness import quartiles
from benchmarks.machine import one_core
from benchmarks.mpc_acados import acados_loops
from benchmarks.mpc_cases import Case
from benchmarks.mpc_dompc import dompc
from benchmarks.mpc_hpipm import hpipm, qps_of
from benchmarks.mpc_loop import FLAGS, LoopRun
from benchmarks.mpc_nlp import Nlp
from benchmarks.mpc_ours import rti_loop
from benchmarks.mpc_peers import converged, sqp_loop
from benchmarks.report import RESULTS, Report, Table

PARTS = ("loops", "converged", "qps")
OURS = ("this package, scalar", "this package, lanes")
FORMS = ("own", "custom_jacobian", "jac_fg")
_QUIET: dict[str, Any] = {"print_time": False, "error_on_fail": False, "calc_lam_p": False}
SOLVERS: dict[str, dict[str, Any]] = {
    "fatrop": {"structure_detection": "auto", "fatrop.print_level": 0, "fatrop.tol": 1e-9},
    "sqpmethod": {
        "qpsol": "qrqp",
        "qpsol_options": {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False},
        "max_iter": 50,
        **{f"print_{what}": False for what in ("header", "iteration", "status")},
    },
}
"""CasADi's solvers to convergence, with their options."""
LABELS = {"fatrop": "fatrop, exact Hessian", "sqpmethod": "sqpmethod + qrqp, Gauss-Newton"}


def add_loops(report: Report, case: Case, arguments: argparse.Namespace) -> None:
    """One iteration per step in C."""
    loops = {f"sqpmethod + qrqp, {form}": sqp_loop(case, form) for form in FORMS}
    loops |= acados_loops(case, report.missing)
    loops |= {OURS[0]: rti_loop(case, lanes=False), OURS[1]: rti_loop(case)}
    checked = {label: loop(keep=True) for label, loop in loops.items()}
    runs = measured(loops, arguments.rounds, report.seed)
    rows = []
    for label in loops:
        found, run = us(runs[label]), checked[label]
        times = [*quartiles(found), float(np.median(us(runs[label], 99.0))), float(np.median(us(runs[label], 100.0)))]
        times += [float(np.median(found / us(runs[OURS[1]]))), *phases(runs[label])]
        rows.append([label, *times, f"{int(run.good.sum())}/{case.steps}", *_costs(case, run, case.steps)])
    columns = ["", "quartile 1 [us]", "median", "quartile 3", "99 %", "worst", f"times {OURS[1]}"]
    columns += ["prepare", "feedback", "solved", *COSTS]
    report.tables.append(Table(f"{case.name}: one iteration per step", columns, rows, _note(case)))


def add_converged(report: Report, case: Case, arguments: argparse.Namespace) -> None:
    """Every problem solved, from the shifted solution before."""
    steps = min(case.steps, arguments.slow_steps)
    least = rti_loop(case)(keep=True)
    rows = [_row("this package, one iteration, C", least, case, steps)]
    rows.append(_row("IPOPT, Gauss-Newton", converged(case, soft=False, steps=steps), case, steps))
    for plugin in SOLVERS:
        rows.append(_row(LABELS[plugin], to_convergence(case, plugin, steps), case, steps))
    try:
        run, versions = dompc(case, steps)
        rows.append(_row(f"do-mpc {versions.get('do-mpc', '')}", run, case, steps))
    except RuntimeError as error:
        report.missing.append(f"{case.name}: {error}")
    columns = ["", "median [us]", "99 %", "solved", *COSTS]
    note = (
        f"The first {steps} steps; costs differ where solvers swing another way. Called from Python, processor time; "
        "multiple shooting with hard rows; do-mpc by its defaults (collocation)."
    )
    report.tables.append(Table(f"{case.name}: to convergence", columns, rows, note))


def _row(label: str, run: LoopRun, case: Case, steps: int) -> list[Any]:
    seconds = 1e6 * run.step_seconds[:steps]
    good = f"{int(run.good[:steps].sum())}/{steps}"
    return [label, float(np.median(seconds)), float(np.percentile(seconds, 99.0)), good, *_costs(case, run, steps)]


COSTS = ("closed-loop cost", "worst excess of a row, share")


def _costs(case: Case, run: LoopRun, steps: int) -> tuple[float, float]:
    """Cost without the penalties of rows, which are hard here, and by how much the plant leaves them."""
    x, u, none = run.x[: steps + 1], run.u[:steps], np.zeros(case.stages.nc)
    plain = replace(case, stages=replace(case.stages, linear=none, quadratic=none))
    return plain.cost(x, u), case.excess(x, u)


def to_convergence(case: Case, plugin: str, steps: int) -> LoopRun:
    """The closed loop with every problem solved by one of ``SOLVERS``."""
    stages, nlp = case.stages, Nlp(case.stages, soft=False)
    options: dict[str, Any] = {**_QUIET, **SOLVERS[plugin]}
    if plugin == "sqpmethod":  # fatrop's interface takes no Hessian of ours: it has the exact one
        options["hess_lag"] = nlp.hess_lag()
    problem, bounds = nlp.problem, {key: value.copy() for key, value in nlp.bounds.items()}
    fixes = plugin == "fatrop"
    if fixes:
        problem, bounds = _by_nodes(nlp, bounds)
        options["equality"] = (bounds["lbg"] == bounds["ubg"]).tolist()
    solver = ca.nlpsol("peer", plugin, problem, options)
    plant = case.plant()
    x, u = np.zeros((steps + 1, stages.nx)), np.zeros((steps, stages.nu))
    seconds, good, x[0] = np.zeros((steps, 2)), np.zeros(steps, bool), case.x0
    planned = np.tile(case.x0, (stages.stages + 1, 1)), np.tile(case.u0, (stages.stages, 1))
    duals: dict[str, Any] = {}
    with one_core():
        for k in range(steps):
            planned[0][0] = x[k]
            p = nlp.parameters(case.p, case.references[k])
            if not fixes:
                bounds["lbx"][: stages.nx] = bounds["ubx"][: stages.nx] = x[k]
            given = {**bounds, "p": np.r_[p, x[k]] if fixes else p, "x0": nlp.guess(*planned, case.p)}
            began = time.thread_time()
            found = solver(**given, **duals)
            seconds[k, 1] = time.thread_time() - began
            good[k] = solver.stats()["success"]
            duals = {"lam_x0": found["lam_x"], "lam_g0": found["lam_g"]} if good[k] else {}
            px, pu = nlp.plan(np.array(found["x"]).ravel())
            u[k] = np.clip(pu[0], stages.u_min, stages.u_max)
            x[k + 1] = np.array(plant(x[k], u[k], case.plant_p[k])).ravel()
            planned = np.vstack([px[1:], px[-1:]]), np.vstack([pu[1:], pu[-1:]])
    return LoopRun(x, u, seconds, float(seconds[0, 1]), good)


def _by_nodes(nlp: Nlp, bounds: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The problem as fatrop detects it: gap of a stage, then rows of its node; the first state by an equation."""
    s, start = nlp.stages, ca.MX.sym("start", nlp.stages.nx)
    count = nlp.problem["g"].numel()
    per = count // s.stages - s.nx
    gaps = [list(range(k * (s.nx + per), k * (s.nx + per) + s.nx)) for k in range(s.stages)]
    rows = [list(range(gap[-1] + 1, gap[-1] + 1 + per)) for gap in gaps]
    # Those of the state alone are of the next node.
    own = rows if s.ns == 0 else [[], *rows[:-1]]
    order = [*gaps[0], *own[0], *(i for k in range(1, s.stages) for i in (*gaps[k], *own[k]))]
    order += rows[-1] if s.ns else []
    at = s.nx
    # Gaps as fatrop takes them: the next state less what the stage leads to.
    signs = np.where(np.isin(order, np.ravel(gaps)), -1.0, 1.0)
    g = ca.DM(signs) * nlp.problem["g"][order]
    problem = {**nlp.problem, "p": ca.vertcat(nlp.p, start), "g": ca.vertcat(g[:at], nlp.w[:at] - start, g[at:])}
    found = {key: np.insert(bounds[key][order], at, np.zeros(s.nx)) for key in ("lbg", "ubg")}
    return problem, {"lbx": bounds["lbx"], "ubx": bounds["ubx"], **found}


def add_qps(report: Report, case: Case, arguments: argparse.Namespace) -> None:
    """The QPs of the package's loop, by HPIPM."""
    loop = rti_loop(case)
    run = loop(keep=True)
    qps = qps_of(case, run)
    timed = 1e6 * np.median([loop().seconds for _ in range(arguments.rounds)], axis=0)
    phase = {"this package, feedback": timed[:, 1], "this package, whole step (linearization too)": timed.sum(axis=1)}
    rows = [
        [label, *_spread(values), math.nan, f"{int(run.good.sum())}/{case.steps}", 0.0]
        for label, values in phase.items()
    ]
    for mode, warm, tolerance in (("speed", False, 1e-8), ("speed", True, 1e-8), ("balance", False, 1e-12)):
        try:
            answers = [hpipm(qps, mode, warm=warm, tolerance=tolerance) for _ in range(arguments.rounds)]
        except RuntimeError as error:
            report.missing.append(f"{case.name}: {error}")
            break
        found = answers[0]
        seconds = 1e6 * np.median([one.seconds for one in answers], axis=0)
        good = f"{int(found.good.sum())}/{case.steps}"
        label = f"HPIPM, {mode}, {'warm' if warm else 'cold'}, {tolerance:g}"
        apart = float(found.apart[found.good].max()) if found.good.any() else math.nan
        rows.append([label, *_spread(seconds), float(np.median(found.iterations)), good, apart])
    columns = ["", "median [us]", "99 %", "worst", "iterations", "solved", "apart from ours, per range of an input"]
    note = (
        "HPIPM: its solution alone, to the tolerance named, without setting the QP; first state eliminated, rows as "
        "general soft constraints; warm: from the solution of the QP before. Feedback: from the state to the new "
        "plan; the factorization without bounds is in the preparation, hence the second row."
    )
    report.tables.append(Table(f"{case.name}: the same QPs", columns, rows, note))


def _spread(values: Any) -> list[float]:
    return [float(v) for v in np.percentile(values, [50.0, 99.0, 100.0])]


def _note(case: Case) -> str:
    s = case.stages
    return f"{case.what}; N = {s.stages}, {s.substeps} RK4 steps each, {s.nx} states, {s.nu} input(s), {s.nc} row(s)."


def main() -> None:
    """Run the parts asked for and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    parser.add_argument("--cases", nargs="*", choices=rti_problems.NAMES, default=list(rti_problems.NAMES))
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--slow-steps", type=int, default=150, help="of solvers to convergence")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where to write it")
    arguments = parser.parse_args()
    report = Report("rti", arguments.seed)
    report.machine["flags"] = " ".join(FLAGS)
    parts = {"loops": add_loops, "converged": add_converged, "qps": add_qps}
    for name in arguments.cases:
        case = rti_problems.case(name, arguments.steps)
        for part in arguments.only:
            parts[part](report, case, arguments)
            print(name, part, "done", flush=True)
    for file in report.write(arguments.folder):
        print(file)


if __name__ == "__main__":
    main()
