"""Solvers of nonlinear problems against each other on the shipped plans and grasps.

Each scene is solved by every solver from the same starts; plans also by IPOPT with the Hessian that the other solver
needs, so that nothing but the solver differs.
"""

from __future__ import annotations

import time
from typing import Any

from benchmarks.harness import CONFIGS
from benchmarks.report import begun
from continuum_grasp.addons.planning import plan
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.nlp import NLP, Attempt, Budget, Solver, Start
from continuum_grasp.scene import load

PLANS = ("tip_to_point", "past_a_post")
GRASPS = ("mug", "pinch", "wrap", "mug_arcs", "mug_robust", "box_edge", "table_peg", "preshaped")
GAUSS_NEWTON = "solver.hessian=gauss_newton"
KINDS = {
    "plan": {
        "ipopt, exact Hessian": [],
        "ipopt, Gauss-Newton": [GAUSS_NEWTON],
        "sqp, Gauss-Newton": ["solver.method=sqp", GAUSS_NEWTON],
    },
    "grasp": {"ipopt, exact Hessian": [], "sqp, BFGS": ["solver.method=sqp"]},
}
"""Overrides of the scene, by the label of its row."""
CAP = 2000
"""Iterations of all starts together, so that a solver that does not converge ends too."""
COLUMNS = ["scene", "solver", "status", "objective", "starts", "converged", "iterations (best)", "iterations"]
COLUMNS += ["solver [s of CPU]", "total [s of CPU]"]
NOTE = (
    "The objective is that of the best start that converged, in units of the problem for grasps; solver is the time of "
    "all its runs, models and derivatives built before; total includes building, starts and verification, but a grasp "
    "problem is built for the first solver alone. One run each; time of the processor."
)


def of_plan(scene: Any) -> list[Any]:
    """The row of a plan."""
    found = plan(scene, raise_on_failure=False)
    starts = [text.split() for text in found.statistics["starts"]]
    done = sum("Solve_Succeeded" in words for words in starts)
    iterations = sum(int(words[words.index("iterations,") - 1]) for words in starts)
    return [str(found.status), found.objective, len(starts), done, found.iterations, iterations]


def of_grasp(scene: Any) -> list[Any]:
    """The row of a grasp."""
    found = optimize_grasp(scene, raise_on_failure=False)
    tried, statistics = found.statistics["attempts"], found.statistics
    done = [a["objective"] for a in tried if a["outcome"] == "Solve_Succeeded" and a["greatest_violation"] == 0.0]
    iterations, best = sum(a["iterations"] for a in tried), min(done, default=None)
    return [str(found.status), best, len(tried), len(done), statistics["iterations"], iterations]


def timed() -> list[float]:
    """Have all solver runs add their time [s of CPU] to the entry that is returned."""
    spent, whole = [0.0], Solver.solve

    def solve(self: Solver, problem: NLP, start: Start, until: Budget) -> Attempt:
        self.prepare(problem)
        began = time.process_time()
        try:
            return whole(self, problem, start, until)
        finally:
            spent[0] += time.process_time() - began

    Solver.solve = solve  # type: ignore[method-assign]
    return spent


def main() -> None:
    """Solve every scene by every solver and write the report."""
    asked, report = begun(__doc__, "solvers", only=("", "scenes with this in their name"))
    spent = timed()
    for kind, names, row_of in (("plan", PLANS, of_plan), ("grasp", GRASPS, of_grasp)):
        table = report.table(f"Shipped scenes: {kind}", COLUMNS, note=NOTE)
        for name in [name for name in names if asked.only in f"{kind}/{name}"]:
            for label, overrides in KINDS[kind].items():
                scene = load(CONFIGS / kind / f"{name}.yaml", [*overrides, f"solver.max_total_iterations={CAP}"])
                began, spent[0] = time.process_time(), 0.0
                found = row_of(scene)
                table.add(name, label, *found, spent[0], time.process_time() - began)
    if asked.only:
        report.missing.append(f"all scenes without {asked.only!r}")
    report.finish()


if __name__ == "__main__":
    main()
