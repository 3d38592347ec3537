"""Hard cases: what the program makes of each, against a truth that it did not produce.

Statics are measured against the exact elastica and closed forms, motions against SciPy's integration under error
control, swings by their energy. A case ends in a right answer, a warning or a refusal that says why; anything else is
WRONG.
"""

from __future__ import annotations

from collections import Counter
from time import perf_counter

from benchmarks.hard_cases import RIGHT, WRONG, judge
from benchmarks.hard_cases.motion import motion_attempts
from benchmarks.hard_cases.statics import static_attempts
from benchmarks.report import begun

COLUMNS = ["case", "family", "method", "error", "limit", "steps", "time [s]", "verdict"]
NOTE = """\
Errors are those of the tip per length unless the case says otherwise: of the coordinates per greatest one (nearly
straight), of the deflection (pushed by 1e-9), of the energy per energy of the swing. Methods: auto, rk4, rodas and
reference are those of time.method. Times are of one run, with what had to be compiled and, where it was the first to
need it, the truth.""".replace("\n", " ")


def main() -> None:
    """Make every attempt and write the report."""
    asked, report = begun(__doc__, "hard_cases", only=("", "attempts with this in case, family and method"))
    summary, counts, surprising = report.table("Verdicts", ["verdict", "attempts"]), Counter[str](), 0
    for title, attempts in (("At rest", static_attempts()), ("In motion", motion_attempts())):
        table = report.table(title, COLUMNS, note=NOTE)
        for attempt in [attempt for attempt in attempts if asked.only in attempt.name]:
            began = perf_counter()
            error, steps, verdict = judge(attempt)
            named, kind = (attempt.case, attempt.family, attempt.method), verdict.partition(":")[0]
            table.add(*named, error, attempt.limit, steps, perf_counter() - began, verdict)
            counts[kind] += 1
            surprising += kind not in attempt.expected
    for kind in sorted(counts, key=lambda k: (k != RIGHT, k)):
        summary.add(kind, counts[kind])
    report.claim("wrong answers", counts[WRONG], "<=", 0)
    report.claim("verdicts other than expected", surprising, "<=", 0)
    if asked.only:
        report.missing.append(f"all attempts without {asked.only!r}")
    report.finish()


if __name__ == "__main__":
    main()
