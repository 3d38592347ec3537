"""QPs of the real-time iteration against an active-set solver, and random states in great number.

Run ``python -m benchmarks.rti_oracle`` in the root of the repository (10 min). Random stages of the tests (penalties
over five orders, absent bounds, states up to ten times the bounds) are linearized at random plans; each problem is
solved by the C and by qpOASES, which has the slacks of the rows as variables. ``--problems`` and ``--states`` say how
many; ``--precision float`` does the same in single precision.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from benchmarks.real_time_iteration import STATUS, RealTimeIteration
from benchmarks.report import Report, arguments
from continuum_grasp.errors import SolverError
from tests.rti_cases import SIZES, change_of_plan, disturb, qp_of, random_stages

SETS = 36
"""Random problems, over which the numbers are spread."""
HARD = {"linear": 1e4, "quadratic": 1e6}
"""Penalties of rows that are to be satisfied wherever they can be, which every third problem has."""


def problem(k: int, precision: str) -> RealTimeIteration:
    """Random stages of one of the sizes."""
    size = SIZES[k % len(SIZES)]
    hard = {name: np.full(size[3] + size[4], penalty) for name, penalty in HARD.items()} if k % 3 == 2 else {}
    return RealTimeIteration(random_stages(k, size, **hard), precision=precision, lanes=False)


def compared(rti: RealTimeIteration, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Differences from qpOASES in the answer and in the cost, relative, where that has an answer."""
    found: dict[str, Any] = {"z": [], "cost": [], "status": Counter(), "oracle": 0, "rounds": []}
    for _ in range(count):
        x0 = disturb(rti, rng)
        q = qp_of(rti, x0)
        report = rti.feedback(x0)
        found["status"][report.status] += 1
        found["rounds"].append(report.iterations)
        try:
            expected = q.solve()
        except RuntimeError:
            found["oracle"] += 1
            continue
        z, best = change_of_plan(rti), q.cost(expected)
        found["z"].append(np.abs(z - expected).max() / np.abs(expected).max())
        found["cost"].append((q.cost(z) - best) / max(1.0, abs(best)))
    return found


def statuses(rti: RealTimeIteration, count: int, rng: np.random.Generator) -> Counter[str]:
    """Of states from a millionth to a million times the bounds."""
    reported: Counter[str] = Counter()
    for k in range(count):
        x0 = disturb(rti, rng) * 10 ** rng.uniform(-6, 6) ** (k % 2)
        try:
            reported[STATUS[rti.feedback(x0).status]] += 1
        except SolverError as error:
            reported[error.status] += 1
            reported["none"] += 1
    return reported


def main() -> None:
    options = arguments(__doc__, problems=10_000, states=200_000, precision=("double", "", ("double", "float")), seed=0)
    report = Report("rti_oracle" if options.precision == "double" else "rti_oracle_float", options.seed)
    rows, reported, worst = [], Counter(), 0.0
    for k in range(SETS):
        rti, rng = problem(k, options.precision), np.random.default_rng((options.seed, k))
        found = compared(rti, -(-options.problems // SETS), rng)
        reported += statuses(rti, -(-options.states // SETS), rng)
        z, cost = np.array(found["z"]), np.array(found["cost"])
        unsolved = found["status"][1]
        size = " ".join(map(str, SIZES[k % len(SIZES)]))
        quantiles = [float(v) for v in (*np.quantile(z, [0.5, 0.999]), z.max(), cost.max(), cost.min())]
        rounds = [float(v) for v in np.quantile(found["rounds"], [0.5, 1.0])]
        rows.append([k, size, len(z), *quantiles, *rounds, unsolved, found["oracle"]])
        worst = max(worst, float(z.max()))
        print(rows[-1], flush=True)
    columns = ["set", "N nx nu ns others", "problems", "median", "99.9 %", "worst", "cost above", "cost below"]
    columns += ["rounds", "most rounds", "not solved", "no answer of qpOASES"]
    note = "Largest difference of the answer over its largest entry; cost over the larger of 1 and itself."
    report.table("Against qpOASES", columns, rows, note)
    report.table("Random states", ["status", "states"], [list(item) for item in reported.items()])
    limit = 1e-6 if options.precision == "double" else 1e-3
    report.claim("worst difference from qpOASES", worst, "<=", limit)
    report.claim("states without a plan", reported["none"], "<=", 0.0)
    report.finish()


if __name__ == "__main__":
    main()
