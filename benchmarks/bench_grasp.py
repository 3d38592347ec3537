"""How often the grasp optimizer finds the grasp that there is, and says why there is none.

Run ``python -m benchmarks.bench_grasp`` in the root of the repository. Random scenes whose answers are known from
solvers that share nothing with the package (``benchmarks.grasp_oracle``): one finger, pinches of two fingers, and
scenes made infeasible by one tightened limit. Every grasp that the package calls verified is checked once more with
the oracle's own equations.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.causes import tightened
from benchmarks.grasp_oracle.check import LIMITS, residuals
from benchmarks.grasp_oracle.scenes import one_finger, two_fingers
from benchmarks.grasp_oracle.truth import answers
from benchmarks.report import RESULTS, Report, Table
from continuum_grasp.grasp import GraspResult, Status, certify, optimize_grasp
from continuum_grasp.scene.grasp import GraspScene

LITTLE = 1e-4
"""Part of the greatest tensions that is added to both before they are compared."""
CLOSE = 5e-3
"""Part of the oracle's tension by which a grasp may be worse."""
NUMBERS = 1e-2
"""Part by which a number of a reason may differ."""
MARGIN = 1e-3
"""By what part more than a number that the oracle did not find is granted to see whether it is enough."""
REASONS = {"bend": "bending range", "clearance": "clearance at the supports"}
"""Causes whose reasons go by another name."""


@dataclass
class Outcome:
    """What the optimizer made of one scene."""

    seed: int
    what: str
    status: str
    good: bool
    note: str = ""
    seconds: dict[str, float] = field(default_factory=dict)
    worst: dict[str, float] = field(default_factory=dict)
    tension: float = math.nan
    better: bool = False
    right: bool = False
    first: bool = False
    number: bool = False

    @property
    def false(self) -> bool:
        """Whether a grasp was called verified that does not hold."""
        return any(self.worst[name] > limit for name, limit in LIMITS.items() if name in self.worst)


def run(scene: GraspScene) -> tuple[GraspResult | None, dict[str, float], str]:
    """The result, its times, and what went wrong."""
    began = time.perf_counter()
    try:
        result = optimize_grasp(scene, raise_on_failure=False)
    except Exception as error:  # whatever it is, it is an outcome
        return None, {}, f"{type(error).__name__}: {error}".splitlines()[0][:120]
    seconds = {k: float(v) for k, v in result.statistics.items() if k.endswith("_seconds")}
    seconds["all_seconds"] = time.perf_counter() - began
    if result.arrays:
        began = time.perf_counter()
        certify(result.scene, result.arrays)
        seconds["certificate_seconds"] = time.perf_counter() - began
    return result, seconds, ""


def held(kind: str, row: dict[str, Any]) -> Outcome:
    """A scene that has a grasp."""
    scene = one_finger(row["seed"]) if kind == "one" else two_fingers(row["seed"])
    result, seconds, problem = run(scene)
    setup = scene.setups[0]
    what = f"{scene.object.shape}, {setup.family}, {scene.gravity.mode}"
    what += "" if kind == "two" else f", {'middle' if setup.middles[0] == 'on' else 'tip'}"
    if result is None or not result.solved:
        status = "error" if result is None else str(result.status)
        return Outcome(row["seed"], what, status, False, problem or (result.message if result else ""), seconds)
    worst = residuals(scene, result.arrays)
    unit = LITTLE * sum(f.tendons.max_tension for f in scene.named_fingers.values() if f.tendons is not None)
    share = (result.tension + unit) / (row["tension"] + unit)  # the least may be none at all
    out = Outcome(row["seed"], what, str(result.status), False, "", seconds, worst, result.tension)
    enough = share <= 1.0 + CLOSE if kind == "one" else True
    out.good = enough and not out.false
    out.better = share < 1.0 - CLOSE
    out.note = f"{result.tension:.5g} N, oracle {row['tension']:.5g} N ({100 * (share - 1):+.2f} %)"
    return out


def none(row: dict[str, Any]) -> Outcome:
    """A scene that has none."""
    result, seconds, problem = run(tightened(row))
    what = row["cause"]
    if result is None:
        return Outcome(row["seed"], what, "error", False, problem, seconds)
    out = Outcome(row["seed"], what, str(result.status), result.status is Status.INFEASIBLE, "", seconds)
    if result.solved:
        out.worst = residuals(result.scene, result.arrays)
        out.note = f"{result.tension:.5g} N: " + ("does not hold" if out.false else "holds, so the oracle missed it")
        return out
    name = REASONS.get(what, what)
    for k, reason in enumerate(result.reasons):
        if reason.name == name:
            number = abs(reason.needed - reason.limit) if what == "reach" else reason.needed
            out.right, out.first = True, k == 0
            out.number = abs(number / row["needed"] - 1.0) <= NUMBERS or _milder(row, number)
            out.note = f"{number:.5g}, oracle {row['needed']:.5g}"
    if not out.right:
        out.note = "; ".join(f"{r.name} {r.needed:.4g}" for r in result.reasons) or result.message
    return out


def _milder(row: dict[str, Any], number: float) -> bool:
    """Whether a number asks for less than the oracle knows to be needed, and a checked grasp shows it is enough."""
    sign = -1.0 if row["cause"] == "mass" else 1.0
    if row["cause"] in ("reach", "clearance") or sign * (number - row["needed"]) > 0.0:
        return False
    scene = tightened({**row, "limit": number * (1.0 + sign * MARGIN)})
    result, _, _ = run(scene)
    if result is None or not result.solved:
        return False
    worst = residuals(scene, result.arrays)
    return all(worst[name] <= limit for name, limit in LIMITS.items())


def share(outcomes: list[Outcome], name: str) -> float:
    """Per cent of the outcomes with a property."""
    return 100.0 * sum(bool(getattr(o, name)) for o in outcomes) / max(len(outcomes), 1)


def times(outcomes: list[Outcome]) -> list[list[Any]]:
    """Milliseconds: median, 95th percentile, most."""
    rows = []
    timed = ("build", "start", "solver", "certificate", "after_build", "all")
    for name in (n if n == "after_build" else f"{n}_seconds" for n in timed):
        values = [
            1e3
            * (o.seconds["total_seconds"] - o.seconds["build_seconds"] if name == "after_build" else o.seconds[name])
            for o in outcomes
            if o.seconds and (name == "after_build" or name in o.seconds)
        ]
        if values:
            rows.append([name.replace("_seconds", ""), *(float(v) for v in np.percentile(values, [50, 95, 100]))])
    return rows


def add_held(report: Report, kind: str, outcomes: list[Outcome]) -> None:
    """Claims and tables of scenes that have a grasp."""
    words, least = ("one finger", 99.5) if kind == "one" else ("two fingers", 98.0)
    report.claim(f"{words}: solved of {len(outcomes)}, per cent", share(outcomes, "good"), ">=", least)
    if kind == "one":
        solving = [1e3 * o.seconds["solver_seconds"] for o in outcomes if o.seconds]
        report.claim("one finger: solver, median [ms]", float(np.median(solving)), "<=", 25.0)
        report.claim("one finger: solver, 95th percentile [ms]", float(np.percentile(solving, 95)), "<=", 100.0)
        checking = [1e3 * o.seconds["certificate_seconds"] for o in outcomes if "certificate_seconds" in o.seconds]
        report.claim("one finger: certificate, median [ms]", float(np.median(checking)), "<=", 30.0)
    report.claim(f"{words}: false certificates", sum(o.false for o in outcomes), "<=", 0)
    columns = ["", "median [ms]", "95 % [ms]", "most [ms]"]
    note = "after_build: everything but the build, checks included; all: as a caller waits."
    report.tables.append(Table(f"Times, {words}", columns, times(outcomes), note))
    rows = [
        [name, max((o.worst[name] for o in outcomes if o.worst), default=math.nan), LIMITS[name]] for name in LIMITS
    ]
    report.tables.append(Table(f"Worst residuals, {words}", ["", "worst", "limit"], rows))
    better = sum(o.better for o in outcomes)
    bad = [[o.seed, o.what, o.status, o.note] for o in outcomes if not o.good]
    note = f"{better} grasps take more than {100 * CLOSE:g} % less tension than the oracle found; all were checked."
    report.tables.append(Table(f"Not solved, or worse, {words}", ["seed", "scene", "status", ""], bad, note))


def add_none(report: Report, outcomes: list[Outcome]) -> None:
    """Claims and tables of scenes that have none."""
    report.claim("infeasible: false certificates", sum(o.false for o in outcomes), "<=", 0)
    report.claim(f"infeasible: reported of {len(outcomes)}, per cent", share(outcomes, "good"), ">=", 100.0)
    report.claim("infeasible: right reason, per cent", share(outcomes, "right"), ">=", 97.0)
    named = [o for o in outcomes if o.right]
    report.claim("infeasible: numbers within 1 %, per cent of those", share(named, "number"), ">=", 100.0)
    rows = []
    for cause in sorted({o.what for o in outcomes}):
        some = [o for o in outcomes if o.what == cause]
        rows.append([cause, len(some), *(share(some, name) for name in ("good", "right", "first", "number"))])
    columns = ["cause", "scenes", "infeasible %", "named %", "named first %", "number %"]
    report.tables.append(Table("Why not", columns, rows))
    bad = [[o.seed, o.what, o.status, o.note] for o in outcomes if not (o.good and o.right and o.number)]
    report.tables.append(Table("Other words or numbers", ["number", "cause", "status", ""], bad))
    columns = ["", "median [ms]", "95 % [ms]", "most [ms]"]
    report.tables.append(Table("Times, infeasible", columns, times(outcomes)))


def main() -> None:
    """Run the kinds asked for and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", nargs="*", choices=["one", "two", "none"], default=["one", "two", "none"])
    parser.add_argument("--count", type=int, default=1000, help="most scenes of a kind")
    parser.add_argument("--first", type=int, default=0, help="answers to pass over")
    parser.add_argument("--name", default="grasp", help="name of the report")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where to write it")
    parser.add_argument("--verbose", action="store_true")
    arguments = parser.parse_args()
    report = Report(arguments.name, 0)
    for kind in arguments.kind:
        outcomes = []
        for row in answers(kind)[arguments.first :][: arguments.count]:
            outcomes.append(none(row) if kind == "none" else held(kind, row))
            if arguments.verbose:
                last = outcomes[-1]
                flags = "" if last.good and not last.false else "  <<<"
                print(kind, last.seed, last.what, last.status, last.note, flags, flush=True)
        if not outcomes:
            report.missing.append(f"{kind}: no answers; python -m benchmarks.grasp_oracle.truth {kind} makes them")
        elif kind == "none":
            add_none(report, outcomes)
        else:
            add_held(report, kind, outcomes)
    for file in report.write(arguments.folder):
        print(file)
    print(report.status)


if __name__ == "__main__":
    main()
