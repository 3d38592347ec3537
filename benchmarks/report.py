"""What a benchmark is asked for, on what it runs, and what it found, as JSON and as a Markdown table made from it."""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.harness import CFLAGS, compiler, run
from continuum_grasp import __version__
from continuum_grasp.results import provenance

RESULTS = Path(__file__).with_name("results")
REMARK = (str, "on this run, such as what ran beside it")
"""The option of that name."""


def arguments(doc: str | None, **options: Any) -> argparse.Namespace:
    """What the command line asks for.

    Parameters
    ----------
    doc : str
        Of the benchmark.
    **options
        By name: a default, or a tuple of it, of what it is, and of choices. ``...`` has to be given, without dashes;
        ``False`` is a switch, a type stands for none of that type, a tuple for some of its entries, a list for any
        values, or for some of the choices.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, option in options.items():
        default, words, *choices = option if isinstance(option, tuple) else (option, "")
        kind: dict[str, Any] = {"default": default, "type": type(default)}
        if default is False:
            kind = {"action": "store_true"}
        elif isinstance(default, type):
            kind = {"type": default}
        elif isinstance(default, tuple):
            kind = {"default": default, "nargs": "*", "choices": default}
        elif isinstance(default, list):
            (entry,) = {value if isinstance(value, type) else type(value) for value in default}
            kind = {"default": [] if entry in default else default, "nargs": "*", "type": entry}
        if default is ...:
            kind = {}
        if choices:
            kind["choices"] = list(*choices)
        parser.add_argument(name if default is ... else f"--{name.replace('_', '-')}", help=words, **kind)
    return parser.parse_args()


def begun(
    doc: str | None, name: str | Callable[[argparse.Namespace], str], **options: Any
) -> tuple[argparse.Namespace, Report]:
    """What the command line asks for, as ``arguments`` reads it, and the report that is to be filled.

    Its name may depend on what is asked for; ``--name`` and ``--folder``, which every benchmark has, say otherwise.
    ``--remark`` is shown beside the machine.
    """
    own = {"name": (str, "of the report"), "folder": (RESULTS, "where the report goes"), "remark": REMARK}
    asked = arguments(doc, **options, **own)
    usual = name if isinstance(name, str) else name(asked)
    return asked, Report(asked.name or usual, getattr(asked, "seed", 0), asked.folder, remark=asked.remark)


def describe() -> dict[str, Any]:
    """Command, processor, cores, governor, load before the run, versions, compiler and its flags."""
    about = provenance()
    return {
        "command": _command(),
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "governor": _read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor") or "not readable",
        "load_average": _load(),
        "system": " ".join(about["platform"][key] for key in ("system", "release", "architecture")),
        **about["versions"],
        "continuum_grasp": __version__,  # of the sources that run, which an older installation does not know
        "compiler": _compiler_version(),
        "flags": " ".join(CFLAGS),
    }


@dataclass
class Table:
    """A titled table; numbers as they are, formatted only in Markdown."""

    title: str
    columns: list[str]
    rows: list[list[Any]] = field(default_factory=list)
    note: str = ""

    def add(self, *cells: Any) -> None:
        """Add a row, and print it."""
        self.rows.append(list(cells))
        print(*(f"{cell:.4g}" if isinstance(cell, float) else cell for cell in cells), sep=" | ", flush=True)


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
    seed: int = 0
    folder: Path = RESULTS
    tables: list[Table] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    """What could not be measured, and why."""
    machine: dict[str, Any] = field(default_factory=describe)
    remark: str | None = None

    def table(self, title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]] = (), note: str = "") -> Table:
        """Add a table, to which rows may be added."""
        self.tables.append(Table(title, list(columns), [list(row) for row in rows], note))
        return self.tables[-1]

    def claim(self, what: str, value: float, relation: str, limit: float) -> None:
        """Record a limit and the figure that has to keep it."""
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
            "created": provenance()["created"],
            "status": self.status,
            "seed": self.seed,
            "machine": self.machine,
            "claims": [{**asdict(claim), "met": claim.met} for claim in self.claims],
            "missing": self.missing,
            "tables": [asdict(table) for table in self.tables],
        }
        return plain(data)

    def finish(self) -> None:
        """Write ``<name>.json``, and ``<name>.md`` made from it; print where, the limits not met, and the status."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.machine["load_average_after"] = _load()
        if self.remark:
            self.machine["remark"] = self.remark
        data, file = self.as_json(), self.folder / self.name
        for suffix, text in ((".json", json.dumps(data, indent=1, allow_nan=False) + "\n"), (".md", markdown(data))):
            file.with_name(file.name + suffix).write_text(text, encoding="utf-8")
            print(f"{file}{suffix}")
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


def plain(value: Any) -> Any:
    """Numbers of numpy as those of Python, of which those that are not finite are none."""
    if isinstance(value, Mapping):
        return {str(key): plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _command() -> str:
    """What was called, without where the report goes and what is remarked on the run."""
    module = getattr(sys.modules["__main__"], "__spec__", None)
    words = iter(sys.argv[1:])
    asked = [word for word in words if word not in ("--folder", "--remark") or not next(words, "")]
    return shlex.join(["python", "-m", module.name if module else Path(sys.argv[0]).stem, *asked])


def _load() -> list[float] | None:
    return [round(load, 2) for load in os.getloadavg()] if hasattr(os, "getloadavg") else None


def _cpu_model() -> str:
    for line in _read("/proc/cpuinfo").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def _compiler_version() -> str:
    try:
        return run([compiler().command[0], "--version"]).splitlines()[0]
    except (RuntimeError, OSError) as error:
        return f"none ({error})"
