"""What a benchmark found, as JSON and as a Markdown table made from it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.harness import Timing, ratios
from benchmarks.machine import describe

RESULTS = Path(__file__).with_name("results")


@dataclass
class Table:
    """A titled table; numbers as they are, formatted only in Markdown."""

    title: str
    columns: list[str]
    rows: list[list[Any]]
    note: str = ""


@dataclass
class Claim:
    """A limit that a figure has to keep."""

    what: str
    value: float
    relation: str
    """``<=`` or ``>=``."""
    limit: float

    @property
    def met(self) -> bool:
        """Whether the figure keeps the limit; a NaN never does."""
        return self.value <= self.limit if self.relation == "<=" else self.value >= self.limit


@dataclass
class Report:
    """Collects what one benchmark found and writes it."""

    name: str
    seed: int
    tables: list[Table] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    timings: dict[str, dict[str, Any]] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    """What could not be measured, and why."""
    machine: dict[str, Any] = field(default_factory=describe)

    def add_race(
        self,
        title: str,
        timings: Mapping[str, Timing],
        reference: str,
        *,
        extra: Mapping[str, Sequence[Any]] | None = None,
        extra_columns: Sequence[str] = (),
        note: str = "",
    ) -> dict[str, float]:
        """Add times of one race and their ratios to the reference.

        Returns
        -------
        dict of str to float
            Median ratio of each to the reference.
        """
        found = ratios(timings, reference)
        rows = []
        for name, timing in timings.items():
            data = timing.as_json()
            warm = data["warm_s"]
            ns = [1e9 * warm[key] for key in ("median", "first_quartile", "third_quartile")]
            cold = math.nan if timing.cold is None else 1e6 * timing.cold
            more = list((extra or {}).get(name, [""] * len(extra_columns)))
            rows.append([name, *ns, found[name][1], cold, *more, timing.reason or timing.status])
        columns = ["", "median [ns]", "quartile 1 [ns]", "quartile 3 [ns]", f"times {reference}", "cold [us]"]
        self.tables.append(Table(title, [*columns, *extra_columns, "status"], rows, note))
        self.timings[title] = {name: timing.as_json() for name, timing in timings.items()}
        return {name: ratio[1] for name, ratio in found.items()}

    def claim(self, what: str, value: float, relation: str, limit: float) -> None:
        """Record a limit and the figure that has to keep it."""
        if relation not in ("<=", ">="):
            raise ValueError(f"relation must be <= or >=, got {relation!r}")
        self.claims.append(Claim(what, float(value), relation, limit))

    @property
    def status(self) -> str:
        """``all limits met``, or how many are not, and how much was not measured."""
        broken = sum(not claim.met for claim in self.claims)
        text = f"{broken} of {len(self.claims)} limits not met" if broken else "all limits met"
        return text + (f", {len(self.missing)} not measured" if self.missing else "")

    def as_json(self) -> dict[str, Any]:
        """Everything, with plain JSON numbers (NaN as null)."""
        data = {
            "name": self.name,
            "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "status": self.status,
            "seed": self.seed,
            "machine": self.machine,
            "claims": [{**asdict(claim), "met": claim.met} for claim in self.claims],
            "missing": self.missing,
            "tables": [asdict(table) for table in self.tables],
            "timings": self.timings,
        }
        return _plain(data)

    def write(self, folder: Path = RESULTS) -> tuple[Path, Path]:
        """Write ``<name>.json`` and ``<name>.md`` made from it."""
        folder.mkdir(parents=True, exist_ok=True)
        data = self.as_json()
        files = folder / f"{self.name}.json", folder / f"{self.name}.md"
        files[0].write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        files[1].write_text(markdown(data), encoding="utf-8")
        return files

    def finish(self, folder: Path = RESULTS) -> None:
        """Write both files; print where they are, the limits that are not met, and the status."""
        print(*self.write(folder), sep="\n")
        for claim in self.claims:
            if not claim.met:
                print("BROKEN", claim.what, f"{claim.value:.4g} {claim.relation} {claim.limit:g}")
        print(self.status)


def markdown(data: Mapping[str, Any]) -> str:
    """Markdown of what ``Report.as_json`` gave."""
    machine = data["machine"]
    lines = [f"# {data['name']}", "", f"{data['created']}, seed {data['seed']}: {data['status']}.", ""]
    lines += [f"- {key}: {value}" for key, value in machine.items()]
    if data["claims"]:
        rows = [[c["what"], c["value"], f"{c['relation']} {c['limit']:g}", c["met"]] for c in data["claims"]]
        lines += ["", "## Limits", "", *_table(["", "measured", "limit", "met"], rows)]
    if data["missing"]:
        lines += ["", "## Not measured", "", *(f"- {text}" for text in data["missing"])]
    for table in data["tables"]:
        lines += ["", f"## {table['title']}", "", *_table(table["columns"], table["rows"])]
        if table["note"]:
            lines += ["", table["note"]]
    return "\n".join(lines) + "\n"


def _table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[str]:
    kinds = [all(isinstance(row[k], (int, float)) or row[k] is None for row in rows) for k in range(len(columns))]
    rule = ["---:" if number else "---" for number in kinds]
    cells = [list(columns), rule, *[[_cell(value) for value in row] for row in rows]]
    return ["| " + " | ".join(row) + " |" for row in cells]


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "**no**"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value).replace("|", "/").replace("\n", " ")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
