"""Populations of random grasp scenes, what a search of any source tree makes of them, and such searches compared.

    python -m benchmarks.grasp_populations run --population one two --elements 8 --out a.json
    python -m benchmarks.grasp_populations run --population one two --elements 8 --out b.json --source ../other
    python -m benchmarks.grasp_populations compare a.json b.json --name grasp_populations
    python -m benchmarks.grasp_populations draw --population one --count 3 --folder scenes

Scene k of a population depends on the seed and on k alone. A scene is solved by one warm process, which is started
anew where a scene ends it; times are processor time of the search, without reading the scene. By default the process
forgets the structures of problems before each scene (``--cache fresh``), so that each is built within its time.
Interrupted, ``run`` goes on with what its file lacks. Images of the scenes have the same grasps (``--image``).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.grasp_images import STRONGER, _body, _taper, mirrored, moved, scaled
from benchmarks.grasp_oracle.scenes import G, _finger, _scene
from benchmarks.report import REMARK, Report, Table, describe, markdown, plain

Data = dict[str, Any]

EQUAL, UNDERCUT, LITTLE = 2e-3, 1e-2, 1e-4
"""Relative difference of equal tensions; that by which one undercuts another; part of the greatest that is none."""
TRUSTED = 1e-2
"""Displacement of the exact rods under the forces found, per finger length, beyond which a grasp is no evidence."""
WALL = 30.0
"""Seconds on the clock per second of processor time after which a process is taken to hang."""
CORNERS = 384
"""Corners of polygons that stand for discs: they deviate by 3e-5 of the radius."""
HELD = ("optimal", "feasible")


@dataclass(frozen=True)
class Population:
    """What scenes of a population have in common."""

    fingers: int
    middle: str
    """Switch of the contacts between base and tip; those of the tips are on."""
    bodies: tuple[str, ...]
    """Kinds of objects: ``convex`` (discs, ellipses, boxes, polygons, stadiums), ``outline``, ``union``."""
    supports: tuple[str, ...]
    """Kinds of supports, of which each scene has one."""
    tapered: bool = False


_PALMS, _NONE, _ANY = (*["palm"] * 4, *["table"] * 3, "none"), ("none",), ("convex", "outline", "union")
POPULATIONS = {
    "one": Population(1, "on", ("convex",), _PALMS),
    "one_tip": Population(1, "off", ("convex",), ("palm", "table")),
    "one_outline": Population(1, "on", ("outline",), ("palm", "table")),
    "one_union": Population(1, "on", ("union",), ("palm", "table")),
    "one_tapered": Population(1, "on", _ANY, ("palm", "table"), tapered=True),
    "two": Population(2, "off", ("convex",), _NONE),
    "two_middle": Population(2, "on", ("convex",), _NONE),
    "two_outline": Population(2, "off", ("outline", "union"), _NONE),
    "three": Population(3, "off", ("convex",), ("none", "none", "palm")),
    "three_middle": Population(3, "on", ("convex",), _NONE),
}


# -- scenes ------------------------------------------------------------------------------------------------------------


def document(population: str, k: int, seed: int = 0, elements: int | None = None) -> Data:
    """Draw scene k of a population as a plain YAML document.

    The fingers' tendons, thickness and weight, the mass, friction and gravity are those of the oracle's scenes; sizes
    and reaches are such that many scenes have a grasp and many have none. Fingers have ``elements`` clothoids, or the
    default.
    """
    kind = POPULATIONS[population]
    random = np.random.default_rng([62, seed, list(POPULATIONS).index(population), k])
    length = 10 ** random.uniform(-1.0, -0.4)
    size = length * random.uniform(0.1, 0.3)
    support = str(random.choice(kind.supports))
    body, reach, extent = _body(random, size, str(random.choice(kind.bodies)))
    extent = max(extent, size) if kind.fingers == 3 or "vertices" in body else extent
    fingers = {}
    for name, (turn, side, away) in _places(random, kind, length, size, reach, support).items():
        finger = _finger(random, length, size, sign=-side)
        if kind.fingers > 1:  # nor bend less than the tips need
            finger.pop("strain_limit", None)
        half = finger["half_thickness"]
        if away is None:  # out of the palm
            away = reach - half * random.uniform(1.0, 1.5) - random.choice([0.0, 0.8 * random.random()]) * reach
        near = half * random.uniform(1.05, 1.5) + length * random.uniform(0.0, 0.1 if kind.middle == "on" else 0.25)
        finger["base"] = _base(-away, side * (extent + near), turn, random.uniform(-0.4, 0.4))
        fingers[name] = finger
    # What two tips hold may tilt about the line between them.
    touched = "all" if kind.middle == "on" or support != "none" else "no middle"
    body |= {"position": (0.0, 0.0)} | ({} if support == "none" else {"against": support})
    data = _scene(random, fingers, body, size, _supports(support, reach, length), touched, "matched_clothoid")
    if kind.tapered:
        for finger in fingers.values():
            _taper(random, finger)
    data["contacts"]["middle"] = kind.middle
    if kind.fingers > 1:  # else most scenes that have no grasp are too heavy, or too slippery
        data["contacts"]["friction"] = random.uniform(0.5, 1.2)
    data["object"]["mass"] *= 0.6 if kind.fingers == 1 else 0.15
    if support == "table":
        data |= {"gravity": (-G, 0.0, 0.0), "upright": False}
    data["fidelity"] = {"family": "matched_clothoid"} | ({} if elements is None else {"elements": elements})
    # A stable grasp is rare between several tips.
    data["stability"] = str(random.choice(["require", *["ignore"] * (1 if kind.fingers == 1 else 3)]))
    data["overlap"] = str(random.choice(["forbid", "allow"]))
    name = f"{population} {seed}.{k}, {support}"
    return {"schema_version": 1, "name": name} | _rounded(data | {"objective": "least_tension"})


def _places(
    random: np.random.Generator, kind: Population, length: float, size: float, reach: float, support: str
) -> dict[str, tuple[float, float, float | None]]:
    """Where each finger comes from, seen from the object [rad], on which side it passes, and how far behind the object
    its base is [m]; None: in the palm.
    """
    low, high = (0.2, 0.5) if kind.middle == "on" else (0.55, 0.85)
    away = [length * random.uniform(low, high) for _ in range(kind.fingers)]
    if kind.fingers == 1:
        return {"finger": (0.0, -1.0, None if support != "none" else away[0])}
    if kind.fingers == 2:
        return {"upper": (0.0, 1.0, away[0]), "lower": (0.0, -1.0, away[1])}
    names, hand = ("first", "second", "third"), random.choice([-1.0, 1.0])
    if support == "none":
        turns = [k * math.tau / 3.0 + random.uniform(-0.2, 0.2) for k in range(3)]
        return {name: (turn, hand, a) for name, turn, a in zip(names, turns, away, strict=True)}
    return {"first": (0.0, 1.0, None), "second": (0.0, -1.0, None), "third": (math.pi, hand, away[2])}


def _base(x: float, y: float, turn: float, lean: float) -> Data:
    """The base of a finger that points along ``turn`` and leans, its place seen along ``turn``."""
    c, s = math.cos(turn), math.sin(turn)
    # A finger points along the y axis of its base.
    angle = math.remainder(turn + lean - 0.5 * math.pi, math.tau)
    return {"position": (c * x - s * y, s * x + c * y), "angle": angle}


def _supports(support: str, reach: float, length: float) -> Data:
    """What the object, which is at the origin, touches at -x."""
    if support == "palm":
        return {"palm": {"type": "palm", "point": (-reach, 0.0), "normal_angle": 0.0}}
    if support == "table":  # what it supports is on a line's left
        return {"table": {"type": "line", "start": (-reach, 2.0 * length), "end": (-reach, -2.0 * length)}}
    return {}


def _rounded(value: Any) -> Any:
    """Plain values with 12 digits: mathematical libraries of machines differ in the sixteenth."""
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(each) for each in value]
    value = value.item() if isinstance(value, np.generic) else value
    return float(f"{value:.12g}") if isinstance(value, float) else value


def _facets(data: Data) -> Data:
    """The scene whose disc is a polygon of the same area, turned by the golden angle; other objects are unchanged."""
    body = dict(data["object"])
    if body["shape"] != "circle":
        return data
    radius = 0.5 * body.pop("diameter") * math.sqrt(math.tau / CORNERS / math.sin(math.tau / CORNERS))
    turns = 2.399963 + np.arange(CORNERS) * math.tau / CORNERS
    corners = np.column_stack([radius * np.cos(turns), radius * np.sin(turns)]).tolist()
    return data | {"object": body | {"shape": "polygon", "vertices": corners}}


IMAGES: dict[str, tuple[Callable[[Data], Data], float]] = {
    "own": (dict, 1.0),
    "mirror": (mirrored, 1.0),
    "turn": (moved, 1.0),
    "scale": (scaled, STRONGER),
    "facets": (_facets, 1.0),
}
"""Images of a scene, and their units of force [N]."""


def image_of(data: Data, image: str) -> Data:
    """The image of a scene, as a plain document; ``name`` and version stay."""
    head = {key: data[key] for key in ("schema_version", "name")}
    return head | _rounded(IMAGES[image][0]({key: value for key, value in data.items() if key not in head}))


# -- searches ----------------------------------------------------------------------------------------------------------


class Worker:
    """The process that solves; started anew where a scene ends it."""

    def __init__(self, source: Path, cache: str, warm: list[Data]) -> None:
        self.source, self.fresh, self._warm = source, cache == "fresh", warm
        self._folder = tempfile.mkdtemp()  # of compiled kernels
        self._process: subprocess.Popen[str] | None = None
        self.hello: Data = {}

    def solve(self, data: Data, limit: float) -> Data:
        """The outcome of a document, ``error`` or ``limit`` among the words of its status."""
        row = self._ask(self._started(), data, limit)
        if row is not None:
            return row
        code = self.close()
        if code == -signal.SIGPROF:
            return {"status": "limit", "cpu": limit, "message": f"ended after {limit:g} s of processor time"}
        return {"status": "error", "message": f"the process ended with {code}" if code else "the process hung"}

    def close(self) -> int | None:
        """End the process; its exit code, None where it hung."""
        process, self._process = self._process, None
        if process is None:
            return 0
        assert process.stdin is not None
        process.stdin.close()
        try:
            return process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return None

    def remove(self) -> None:
        """End the process and remove what it compiled."""
        self.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _started(self) -> subprocess.Popen[str]:
        if self._process is None:
            own = {"CONTINUUM_GRASP_CACHE": self._folder}
            command = [sys.executable, "-P", str(Path(__file__).with_name("grasp_worker.py"))]
            env = {**os.environ, "PYTHONPATH": str(self.source), **own}
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(command, env=env, stdin=pipe, stdout=pipe, text=True, cwd=self.source)
            self.hello = self._line(600.0) or {}
            if self.hello.get("source") != str(self.source):
                raise SystemExit(f"{self.source} is no source tree of the package: {self.hello or 'it does not start'}")
            for data in self._warm:  # imports, kernels
                self._ask(self._process, data, 600.0)
        return self._process

    def _ask(self, process: subprocess.Popen[str], data: Data, limit: float) -> Data | None:
        assert process.stdin is not None
        try:
            print(json.dumps({"document": data, "fresh": self.fresh, "limit": limit}), file=process.stdin, flush=True)
        except BrokenPipeError:
            return None
        return self._line(WALL * limit)

    def _line(self, seconds: float) -> Data | None:
        """The next line of the process; None where it ended or hangs."""
        assert self._process is not None
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], seconds)
        text = self._process.stdout.readline() if ready else ""
        return json.loads(text) if text.endswith("\n") else None


def _run(asked: argparse.Namespace) -> None:
    """Solve what the file lacks, and write it after every scene."""
    source = asked.source.resolve()
    setting = {key: getattr(asked, key) for key in ("seed", "elements", "effort", "image", "cache", "limit")}
    setting["commit"] = _commit(source)
    data: Data = {"setting": setting, "machine": describe(), "rows": []}
    if asked.out.exists():
        data = json.loads(asked.out.read_text(encoding="utf-8"))
        if data["setting"] != setting:
            raise SystemExit(f"{asked.out} has other settings: {data['setting']}")
    done = {(row["population"], row["k"]) for row in data["rows"]}
    worker = Worker(source, asked.cache, [document("one", 10**6, 0, 4)])
    try:
        for name in asked.population:
            for k in range(asked.first, asked.first + asked.count):
                if (name, k) not in done:
                    data["rows"].append(_row(worker, asked, name, k))
                    _write(asked.out, data | {"version": worker.hello["version"]})
    finally:
        worker.remove()
    print(asked.out)
    for table in summary({asked.out.stem: data}):
        _print(table)


def _row(worker: Worker, asked: argparse.Namespace, name: str, k: int) -> Data:
    """What becomes of one scene; tensions in the scene's own unit of force."""
    began = time.monotonic()
    own = document(name, k, asked.seed, asked.elements) | {"solver": {"effort": asked.effort}}
    body, unit = own["object"], IMAGES[asked.image][1]
    tendons = [
        t for f in own["fingers"].values() for t in ([f["tendons"]] if isinstance(f["tendons"], dict) else f["tendons"])
    ]
    row: Data = {"population": name, "k": k, "shape": body["shape"], "support": "".join(own["supports"]) or "none"}
    row |= {"most": sum(t["max_tension"] for t in tendons)}
    row |= worker.solve(image_of(own, asked.image), asked.limit)
    for key in ("total", "greatest"):
        if row.get(key) is not None:
            row[key] /= unit
    shown = "" if row.get("total") is None else f" {row['total']:.5g} N"
    wall = time.monotonic() - began
    print(f"{name} {k}: {row['status']}{shown}, {row.get('cpu') or math.nan:.2f} s of {wall:.1f} s", flush=True)
    return row


def _write(file: Path, data: Data) -> None:
    """Write a record as a whole, so that an interruption leaves the one before."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(json.dumps(plain(data), indent=1) + "\n", encoding="utf-8")
    part.replace(file)


def _commit(source: Path) -> str:
    """The commit of a source tree, ``+`` where its package differs from it."""
    git = ["git", "-C", str(source)]
    head = subprocess.run([*git, "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=False)
    changes = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", "continuum_grasp"], check=False)
    return (head.stdout.strip() or "none") + ("+" if changes.returncode else "")


# -- comparison --------------------------------------------------------------------------------------------------------


def holds(row: Data) -> bool:
    """Whether a row has a verified grasp that holds as the scene asks."""
    return row["status"] in HELD and bool(row.get("passed"))


def trusted(row: Data) -> bool:
    """Whether it is evidence that there is such a grasp: the exact rods under its forces are where its fingers are."""
    return holds(row) and row.get("deviation") is not None and row["deviation"] <= TRUSTED


def against(a: Data, b: Data) -> str:
    """How two outcomes of a scene compare."""
    if not holds(a) or not holds(b):
        return "A alone" if holds(a) else "B alone" if holds(b) else "none"
    little = LITTLE * a["most"]
    low, high = sorted([a["total"] + little, b["total"] + little])
    return "equal" if high <= (1.0 + EQUAL) * low else "A lower" if a["total"] < b["total"] else "B lower"


PAIR = ("equal", "A lower", "B lower", "A alone", "B alone", "none")
OWN = (
    *("held", "optimal", "optimal undercut", "held of those that any holds", "infeasible", "infeasible that any holds"),
    *("unstable", "not solved", "error, limit", "exact rods off"),
)


def _grouped(files: dict[str, Data]) -> dict[str, dict[int, dict[str, Data]]]:
    """Rows by population, scene and file."""
    found: dict[str, dict[int, dict[str, Data]]] = {}
    for label, data in files.items():
        for row in data["rows"]:
            found.setdefault(row["population"], {}).setdefault(row["k"], {})[label] = row
    return {name: found[name] for name in POPULATIONS if name in found}


def judged(scenes: dict[int, dict[str, Data]], label: str) -> dict[str, list[str]]:
    """Scenes of each word of ``OWN`` in one file, measured by the trusted grasps of all."""
    found: dict[str, list[str]] = {word: [] for word in OWN}
    for k, rows in sorted(scenes.items()):
        if label not in rows:
            continue
        row, status = rows[label], rows[label]["status"]
        least = min((each["total"] for each in rows.values() if trusted(each)), default=math.inf)
        little = LITTLE * row["most"]
        words = [status.replace("_", " ")] if status in ("infeasible", "unstable", "not_solved") else []
        words += ["error, limit"] if status in ("error", "limit", "stopped") else []
        if holds(row):
            words += ["held"] + (["exact rods off"] if not trusted(row) else [])
        if status == "optimal":
            undercut = row["total"] + little > (1.0 + UNDERCUT) * (least + little)
            words += ["optimal"] + (["optimal undercut"] if undercut else [])
        if math.isfinite(least):
            words += ["held of those that any holds"] if holds(row) else []
            words += ["infeasible that any holds"] if status == "infeasible" else []
        for word in words:
            by = f" {row['total']:.4g} for {least:.4g}" if word == "optimal undercut" else ""
            found[word].append(f"{k}{by}")
    return found


def summary(files: dict[str, Data], names: bool = False) -> Iterator[Table]:
    """What each file found, and its times."""
    groups = _grouped(files)
    words = OWN
    table = Table("Outcomes", ["population", "file", "scenes", *words])
    times = Table("Processor time of the search [s]", ["population", "file", *_TIMES])
    lists = Table("Scenes", ["population", "file", "outcome", "scenes"])
    for name, scenes in groups.items():
        for label in files:
            mine = [each for each in scenes.values() if label in each]
            rows, any_holds = [each[label] for each in mine], sum(any(map(trusted, each.values())) for each in mine)
            if not rows:
                continue
            found = judged(scenes, label)
            counts: list[Any] = [len(found[word]) for word in words]
            counts[3] = f"{counts[3]} of {any_holds}"
            table.rows.append([name, label, len(rows), *counts])
            times.rows.append([name, label, *_spent(rows)])
            lists.rows += [[name, label, word, ", ".join(found[word])] for word in words[2:] if found[word]]
    yield table
    yield times
    if names:
        yield lists


_TIMES = (
    "held, median",
    "95 %",
    "infeasible, median",
    "95 %",
    "all, median",
    "95 %",
    "build, median",
    "compilers, sum",
)


def _spent(rows: list[Data]) -> list[float | None]:
    """Medians and 95 % of processor time."""
    found: list[float | None] = []
    for some in (
        [row["cpu"] for row in rows if holds(row)],
        [row["cpu"] for row in rows if row["status"] == "infeasible"],
        [row["cpu"] for row in rows if row.get("cpu") is not None],
    ):
        found += np.percentile(some, (50, 95)).tolist() if some else [None, None]
    built = [row["build"] for row in rows if row.get("build") is not None]
    return [*found, float(np.median(built)) if built else None, float(sum(row.get("compilers") or 0.0 for row in rows))]


def pairs(files: dict[str, Data], names: bool = False) -> Iterator[Table]:
    """The first file, A, beside each of the others, B, in the scenes that both have."""
    first, *others = files
    groups = _grouped(files)
    for other in others:
        table = Table(f"A: {first}, B: {other}", ["population", "scenes", *PAIR])
        lists = Table(f"Scenes: A: {first}, B: {other}", ["population", "outcome", "scenes"])
        for name, scenes in groups.items():
            both = {k: (rows[first], rows[other]) for k, rows in scenes.items() if first in rows and other in rows}
            found: dict[str, list[str]] = {word: [] for word in PAIR}
            for k, (a, b) in sorted(both.items()):
                tensions = [f"{row['total']:.4g}" if holds(row) else row["status"] for row in (a, b)]
                found[against(a, b)].append(f"{k} ({', '.join(tensions)})")
            table.rows.append([name, len(both), *(len(found[word]) for word in PAIR)])
            lists.rows += [[name, word, "; ".join(found[word])] for word in PAIR[1:-1] if found[word]]
        yield table
        if names:
            yield lists


def _compare(asked: argparse.Namespace) -> None:
    files = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in asked.files}
    if len(files) < len(asked.files):
        raise SystemExit("files need different names")
    settings = [[label, *data["setting"].values()] for label, data in files.items()]
    columns = ["file", *next(iter(files.values()))["setting"]]
    tables = [Table("Files", columns, settings), *pairs(files, asked.names), *summary(files, asked.names)]
    for table in tables:
        _print(table)
    if asked.name:
        Report(asked.name, tables=tables, remark=asked.remark).finish()


def _print(table: Table) -> None:
    """Print a table as Markdown."""
    data = {"name": "", "created": "", "seed": "", "status": "", "machine": {}, "claims": [], "missing": []}
    shown = [{"title": table.title, "columns": table.columns, "rows": table.rows, "note": table.note}]
    print(markdown(data | {"tables": shown}).partition("## ")[2])


def _draw(asked: argparse.Namespace) -> None:
    """Write scenes as YAML files."""
    asked.folder.mkdir(parents=True, exist_ok=True)
    for name in asked.population:
        for k in range(asked.first, asked.first + asked.count):
            file = asked.folder / f"{name}_{asked.seed}_{k}.yaml"
            data = image_of(document(name, k, asked.seed, asked.elements), asked.image)
            file.write_text(yaml.safe_dump(data, sort_keys=False, default_flow_style=None), encoding="utf-8")
            print(file)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(required=True)
    run, compare, draw = (verbs.add_parser(name) for name in ("run", "compare", "draw"))
    for verb, what in ((run, _run), (compare, _compare), (draw, _draw)):
        verb.set_defaults(what=what)
    for verb in (run, draw):
        verb.add_argument("--population", nargs="+", choices=POPULATIONS, default=list(POPULATIONS))
        verb.add_argument("--count", type=int, default=100, help="scenes of each population")
        verb.add_argument("--first", type=int, default=0, help="the first of them")
        verb.add_argument("--seed", type=int, default=0)
        verb.add_argument("--elements", type=int, help="clothoids per finger; by default those of the source tree")
        verb.add_argument("--image", choices=IMAGES, default="own")
    run.add_argument("--effort", choices=("quick", "normal", "thorough"), default="normal")
    run.add_argument("--source", type=Path, default=Path(__file__).parents[1], help="source tree that is measured")
    run.add_argument("--limit", type=float, default=60.0, help="processor time of one scene [s]")
    run.add_argument(
        "--cache",
        choices=("fresh", "process"),
        default="fresh",
        help="structures of problems: forgotten before each scene, or those of this process",
    )
    run.add_argument("--out", type=Path, required=True)
    draw.add_argument("--folder", type=Path, required=True)
    compare.add_argument("files", nargs="+", type=Path, help="of run; the first is A")
    compare.add_argument("--names", action="store_true", help="list the scenes behind the counts")
    compare.add_argument("--name", help="of a report that is stored")
    compare.add_argument("--remark", help=REMARK[1])
    asked = parser.parse_args()
    asked.what(asked)


if __name__ == "__main__":
    main()
