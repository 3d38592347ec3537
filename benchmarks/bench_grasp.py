"""How often the grasp optimizer finds the grasp that there is, and says why there is none.

Random scenes whose answers are known from solvers that share nothing with the package (``benchmarks.grasp_oracle``):
one finger, the same with scenes that are retained for a last look (fresh), tips of two and of three fingers, and scenes
made infeasible by one or by two limits.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.check import LIMITS
from benchmarks.grasp_oracle.truth import answers
from benchmarks.grasp_outcomes import CLOSE, Outcome, outcome
from benchmarks.harness import spread
from benchmarks.report import REMARK, RESULTS, Report, arguments
from continuum_grasp.base import ProcessPool

ONE = 1000
"""Answers of one finger that are looked at while the optimizer is worked on; those beyond are fresh."""
KINDS = {
    "one": ("grasp", "one finger", 99.7),
    "fresh": ("grasp_fresh", "one finger, fresh scenes", 99.7),
    "two": ("grasp_two", "two fingers", 99.0),
    "three": ("grasp_three", "three fingers", 97.0),
    "none": ("grasp_infeasible", "infeasible", 98.0),
    "both": ("grasp_infeasible_twice", "infeasible by two limits", 98.0),
}
"""Name of the report, words, and per cent that are to be solved, or whose reason is to be right."""
EFFORTS = ("quick", "normal", "thorough")


def known(kind: str) -> list[dict[str, Any]]:
    """The answers of a kind."""
    rows = answers("one" if kind == "fresh" else kind)
    return {"one": rows[:ONE], "fresh": rows[ONE:]}.get(kind, rows)


def share(outcomes: list[Outcome], name: str) -> float:
    """Per cent of the outcomes with a property."""
    return 100.0 * sum(bool(getattr(o, name)) for o in outcomes) / max(len(outcomes), 1)


def milliseconds(outcomes: list[Outcome], name: str) -> list[float]:
    """Times of one kind, where they were taken."""
    return [1e3 * o.seconds[f"{name}_seconds"] for o in outcomes if f"{name}_seconds" in o.seconds]


def percentile(values: list[float], percent: float) -> float:
    """NaN of none."""
    return float(np.percentile(values, percent)) if values else math.nan


def add_times(report: Report, words: str, outcomes: list[Outcome]) -> None:
    """Median, 95th percentile and most of the times, and how those after the build are distributed."""
    rows = []
    for name in ("build", "start", "solver", "after_build", "all"):
        values = milliseconds(outcomes, name)
        rows.append([name, *(percentile(values, p) for p in (50, 95, 100))])
    steps = [float(o.iterations) for o in outcomes if o.seconds]
    rows.append(["iterations [1]", *(percentile(steps, p) for p in (50, 95, 100))])
    note = "Processor time. after_build: everything but the build, checks included; all: as a caller waits."
    columns = ["", "median [ms]", "95 % [ms]", "most [ms]"]
    report.table(f"Times, {words}", columns, rows, note)


def add_held(report: Report, kind: str, outcomes: list[Outcome], words: str) -> None:
    """Claims and tables of scenes that have a grasp."""
    least = KINDS[kind][2]
    report.claim(f"{words}: solved of {len(outcomes)}, per cent", share(outcomes, "good"), ">=", least)
    report.claim(f"{words}: called infeasible", sum(o.refused for o in outcomes), "<=", 0)
    report.claim(f"{words}: false certificates", sum(o.false for o in outcomes), "<=", 0)
    if kind == "one":
        after = milliseconds(outcomes, "after_build")
        report.claim(f"{words}: after the build, median [ms]", percentile(after, 50), "<=", 20.0)
        report.claim(f"{words}: after the build, 95th percentile [ms]", percentile(after, 95), "<=", 80.0)
    add_times(report, words, outcomes)
    rows = [
        [name, max((o.worst[name] for o in outcomes if o.worst), default=math.nan), LIMITS[name]] for name in LIMITS
    ]
    report.table(f"Worst residuals, {words}", ["", "worst", "limit"], rows)
    bad = [[o.seed, o.what, o.status, o.note] for o in outcomes if not o.good]
    title, limit = "Not solved, or worse", f"{100 * CLOSE:g} %"
    note = (
        f"Worse: by more than {limit} of tension than the oracle's grasp. Within it: {share(outcomes, 'close'):.4g} %."
    )
    if kind in ("two", "three"):
        note += " Oracles of several fingers need not know the best."
    report.table(f"{title}, {words}", ["seed", "scene", "status", ""], bad, note)
    bad = [[o.seed, o.what, o.status, o.note] for o in outcomes if o.better]
    note = f"By more than {limit}; all were checked."
    report.table(f"Better than the oracle, {words}", ["seed", "scene", "status", ""], bad, note)


def add_none(report: Report, kind: str, outcomes: list[Outcome], words: str) -> None:
    """Claims and tables of scenes that have none."""
    report.claim(f"{words}: false certificates", sum(o.false for o in outcomes), "<=", 0)
    report.claim(f"{words}: reported of {len(outcomes)}, per cent", share(outcomes, "good"), ">=", 100.0)
    report.claim(f"{words}: right reason, per cent", share(outcomes, "right"), ">=", KINDS[kind][2])
    named = [o for o in outcomes if o.right]
    report.claim(f"{words}: numbers within 1 %, per cent of those", share(named, "number"), ">=", 100.0)
    rows = []
    for cause in sorted({o.what for o in outcomes}):
        some = [o for o in outcomes if o.what == cause]
        rows.append([cause, len(some), *(share(some, name) for name in ("good", "right", "first", "number"))])
    columns = ["cause", "scenes", "infeasible %", "named %", "named first %", "number %"]
    report.table(f"Why not, {words}", columns, rows)
    bad = [[o.seed, o.what, o.status, o.note] for o in outcomes if not (o.good and o.right and o.number)]
    report.table(f"Other words or numbers, {words}", ["number", "cause", "status", ""], bad)
    add_times(report, words, outcomes)


def add_efforts(report: Report, found: dict[str, list[Outcome]]) -> None:
    """Success rates and times by effort."""
    rows = []
    for effort, some in found.items():
        after = milliseconds(some, "after_build")
        rates = [share(some, name) for name in ("good", "close", "refused")]
        rows.append([effort, len(some), *rates, *(percentile(after, p) for p in (50, 95, 100))])
    columns = ["effort", "scenes", "solved %", "within 0.5 % %", "called infeasible %"]
    columns += ["median [ms]", "95 % [ms]", "most [ms]"]
    report.table("Efforts of the search", columns, rows, "Times after the build, processor time.")


def judged(kind: str, rows: list[dict[str, Any]], effort: str, jobs: int) -> list[Outcome]:
    """The outcomes of the scenes of some answers, in their order."""
    found: dict[int, Outcome] = {}
    for row, last, error in spread(partial(outcome, kind, effort=effort), rows, jobs):
        if error is not None:
            raise error
        found[row["seed"]] = last
        flags = "" if last.good and not last.false else "  <<<"
        print(kind, last.seed, last.what, last.status, last.note, flags, flush=True)
    return [found[row["seed"]] for row in rows]


def main() -> None:
    """Run the kinds asked for and write the reports."""
    asked = arguments(
        __doc__,
        kind=(tuple(KINDS), ""),
        count=(ONE, "most scenes of a kind"),
        seeds=([int], "these seeds alone"),
        efforts=([str], "other efforts too, of one finger", EFFORTS),
        jobs=(ProcessPool.cores(), "processes"),
        folder=(RESULTS, "where to write the reports"),
        remark=REMARK,
    )
    for kind in asked.kind:
        name, words, _ = KINDS[kind]
        report = Report(name, folder=asked.folder, remark=asked.remark)
        rows = [row for row in known(kind)[: asked.count] if not asked.seeds or row["seed"] in asked.seeds]
        outcomes = judged(kind, rows, "", asked.jobs)
        if not outcomes:
            report.missing.append(f"{kind}: no answers; python -m benchmarks.grasp_oracle.truth {kind} makes them")
        elif kind in ("none", "both"):
            add_none(report, kind, outcomes, words)
        else:
            add_held(report, kind, outcomes, words)
            efforts = [e for e in asked.efforts if e != "normal" and kind == "one"]
            by = {e: judged(kind, rows, e, asked.jobs) for e in efforts} | {"normal": outcomes}
            if efforts:
                add_efforts(report, {e: by[e] for e in EFFORTS if e in by})
        report.finish()


if __name__ == "__main__":
    main()
