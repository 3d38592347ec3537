"""What must stay as it is while the code is rearranged: a record of results, and two records beside each other.

In the root of the repository: ``python -m benchmarks.behavior record FILE.json.gz``; ``--items 'grasp/*' 'plan/*'``
does parts of it and adds them to the file. ``python -m benchmarks.behavior compare BEFORE AFTER`` prints a Markdown
table and ends with 1 if something differs. Wall times are left out; ratios of times are shown, and fail nothing.
Compare only records of one kind of processor: the C is compiled for the machine it runs on.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import itertools
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import yaml

import continuum_grasp as cg
from benchmarks import bench_dynamics, bench_grasp
from benchmarks.grasp_outcomes import outcome
from benchmarks.machine import describe
from benchmarks.report import Report

ROOT = Path(__file__).resolve().parents[1]
DIGITS = 12
"""Significant digits that are stored."""
NEGLIGIBLE = 1e-12
"""Differences below it are rounding, in SI units: residuals of what is zero."""
RATIOS = 0.15
"""Part by which ratios of times may move unmentioned."""
SAMPLES = 16
"""Entries of an array that are stored beside its sums."""
DROPPED = re.compile(
    r"__meta__|created|seed|versions?|platform|folder|files|table|config|compiled|late|check_?sum|"
    r"(.*_)?seconds|made_s|total_s|integration_s|.*times|real.time.factor|.*\[[nu]s\].*"
)
"""Keys of where, when and how fast."""
VERBS = {"control": ("control", "mpc"), "mission": ("mission", "control", "mpc")}
"""Names that a verb and the folder of its configurations may have; others are called as here."""
DATA = {
    "belendez_strip": "belendez2003_cantilever/tip_drop.csv",
    "foam_rod": "pool_noodle_static/poses.csv",
    "strip_ring_down": "beam_free_vibration",
    "tendon_steps": "tdcr_tendon_steps/steps.csv",
}
"""Measured data of the identifications; those of ``nitinol_releases`` are simulated here."""
FUNCTIONS = (
    *("forward_dynamics", "inverse_dynamics", "mass_matrix", "bias", "gravity", "elastic", "damping", "actuation"),
    *("external_force", "position", "orientation", "jacobian", "jacobian_rate", "tip", "joints", "energy"),
    *("bending", "range_use", "statics", "linearization"),
)

Values = dict[str, Any]
"""What an item holds: numbers, words and arrays in short, by name."""


def sha(data: str | bytes) -> str:
    """Sixteen digits of SHA-256."""
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()[:16]


def digest(values: Any) -> Values:
    """An array in short: what tells whether another is equal, and by how much it is not."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        words = [str(word) for word in array.ravel()]
        return {"shape": array.shape, "sha": sha(" ".join(words)), "words": dict(Counter(words).most_common(8))}
    entries = array.ravel().astype(float)
    rounded = np.array([float(f"{v:.{DIGITS}g}") + 0.0 for v in entries])  # + 0.0: no negative zero
    finite = np.where(np.isfinite(entries), entries, 0.0)
    peak = float(np.abs(finite).max(initial=0.0))
    part = finite / (peak or 1.0)
    sums = [part.sum(), part @ np.cos(np.arange(part.size)), np.linalg.norm(part)]  # no entry can change without them
    chosen = part[:: max(part.size // SAMPLES, 1)]
    shape = [*array.shape, f"{np.isfinite(entries).sum()} finite"]
    return {"shape": shape, "sha": sha(rounded.tobytes()), "peak": peak, "probes": [float(v) for v in (*sums, *chosen)]}


def flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Numbers and words within JSON or YAML, by path; no prose, no hashes, nothing of where and when."""
    if isinstance(value, dict):
        if {"columns", "rows"} <= value.keys():
            value = {"rows": [dict(zip(value["columns"], row, strict=True)) for row in value["rows"]]}
        for key, item in value.items():
            if not DROPPED.fullmatch(str(key)):
                yield from flat(item, f"{path}.{key}")
    elif isinstance(value, list):
        numbers = value and all(isinstance(v, (int, float)) for v in np.array(value, dtype=object).ravel())
        if numbers and (len(value) > 3 or isinstance(value[0], list)):
            yield path, digest(value)
        else:
            yield f"{path}[]", len(value)
            for k, item in enumerate(value):
                yield from flat(item, f"{path}[{k}]")
    elif isinstance(value, float):
        yield path, float(f"{value:.{DIGITS}g}") if math.isfinite(value) else str(value)
    elif not isinstance(value, str) or not re.search(r"\s|/|^(0x)?[0-9a-f]{8,}u?$", value):
        yield path, value


def of_file(file: Path) -> Iterator[tuple[str, Any]]:
    """What a file of a run holds; of C the tokens without comments, texts and hashes, and numbers of test vectors."""
    name, text = file.name, file.read_text(encoding="utf-8", errors="replace")
    if name == "result.npz":
        with np.load(file, allow_pickle=False) as arrays:
            yield from ((f"npz.{key}", digest(arrays[key])) for key in arrays.files if not DROPPED.fullmatch(key))
    elif name in ("result.yaml", "meta.json"):
        yield from flat(json.loads(text) if name == "meta.json" else yaml.safe_load(text), file.stem)
    elif name.endswith(".jsonl"):
        for k, line in enumerate(text.splitlines()):
            yield from flat({key: v for key, v in json.loads(line).items() if key != "check"}, f"table[{k}]")
    elif file.suffix in (".c", ".h"):
        bare = re.sub(r"/\*.*?\*/|//[^\n]*", "", text, flags=re.S)
        words = re.sub(r"0x[0-9a-f]{8}u\b", "HASH", re.sub(r'"[^"\n]*"', '""', bare)).split()
        yield f"source.{name}", f"{sha(' '.join(words))}, {len(words)} words"
        if name == "vectors.h":
            for array, body in re.findall(r"const \w+ (\w+)\[\] = \{(.*?)\};", bare, re.S):
                cells = re.findall(r"[-+]?(?:0x)?[0-9][\w.]*(?:(?<=p)[-+]\d+)?", body)
                numbers = [float.fromhex(c) if "p" in c else float(int(c.rstrip("ul"), 0)) for c in cells]
                yield f"vectors.{array}", digest(numbers)


def command(name: str, folder: Path, arguments: list[str | Path]) -> Values:
    """What one call from the command line prints and writes."""
    out = folder / name.replace("/", "_")
    if name == "identify/nitinol_releases":
        simulate_releases(folder)
    line = [sys.executable, "-m", "continuum_grasp", *map(str, arguments), "--json", "--out", str(out)]
    settings = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.run(line, cwd=ROOT, env=settings, capture_output=True, text=True, check=False)
    values: Values = {"exit": ran.returncode}
    if ran.stdout.startswith("{"):
        values |= flat(json.loads(ran.stdout), "json")
    else:
        print(ran.stderr[-500:], file=sys.stderr)
    for file in sorted(out.rglob("*")):
        within = file.relative_to(out).parent
        if file.is_file() and "examples" not in within.parts:
            values |= {f"{within}:{name}": value for name, value in of_file(file)}
    return values


def simulate_releases(folder: Path) -> None:
    """Write the paths of the tip in the shipped releases, as measurements."""
    for scene in sorted((ROOT / "configs/simulate").glob("nitinol_release_*.yaml")):
        found = cg.simulate(cg.load(scene))
        rows = [f"{t:.9g},{x:.9g},{y:.9g}\n" for t, (x, y) in zip(found.t[::10], found.tip[::10], strict=True)]
        (folder / f"{scene.stem.removeprefix('nitinol_')}.csv").write_text("t [s],x [m],y [m]\n" + "".join(rows))


def commands(folder: Path) -> Iterator[tuple[str, list[str | Path]]]:
    """Every shipped configuration with the verb that takes it, by a name that does not change with the verb's."""
    line = [sys.executable, "-m", "continuum_grasp", "--help"]
    known = re.findall(r"^\W+(\w+) ", subprocess.run(line, capture_output=True, text=True, check=True).stdout, re.M)
    data = Path(os.environ.get("CONTINUUM_GRASP_DATA", ROOT.parent / "shared/data"))
    for kind in ("grasp", "simulate", "identify", "plan", "control", "mission", "sweep"):
        verb = next(name for name in VERBS.get(kind, (kind,)) if name in known)
        place = next(name for name in VERBS.get(kind, (kind,)) if (ROOT / "configs" / name).is_dir())
        for config in sorted((ROOT / "configs" / place).glob("*.yaml")):
            job: list[str | Path] = [verb, config, "--no-pictures"]
            job += ["--workers", "1", "--keep", "none"] if kind == "sweep" else []
            if kind == "identify":
                job += ["--data", data / DATA[config.stem] if config.stem in DATA else folder]
            yield f"{kind}/{config.stem}", job
            if kind == "mission":
                yield f"mission/{config.stem} trials", [*job, "--trials", "3", "--jobs", "1"]
            if kind == "simulate":
                yield f"modes/{config.stem}", ["modes", config]
    for finger in sorted((ROOT / "configs/fingers").glob("*.yaml")):
        scene = folder / f"{finger.stem}.yaml"
        scene.write_text(f"schema_version: 1\nfinger: {finger}\ngravity: [0.0, -9.81]\n")
        yield f"modes/{finger.stem}", ["modes", scene]
        yield f"accuracy/{finger.stem}", ["accuracy", scene, "--elements", "4"]
    for name in ("plant", "controller"):
        yield f"package/{name}", ["export", ROOT / f"examples/c_project/{name}.yaml", "--to", "c", "--prefix", name]


def makeups() -> dict[str, tuple[cg.Finger, Values]]:
    """Fingers and keywords of their models that between them have all that a model may have."""
    finger, bare = bench_dynamics.finger(), bench_dynamics.finger(tip_mass=0.0, damping=0.0, tendons=False)
    lag = cg.Finger(rod=finger.rod, tendons=cg.Tendons(offset=0.005, max_tension=40.0, time_constant=0.02))
    bent = cg.Finger(
        rod=finger.rod,
        rest_curvature=cg.PiecewiseCurvature(breaks=(0.25,), values=(0.9, -1.4)),
        damping=cg.Damping(material=0.01),
        base=cg.BasePose(position=(0.3, -0.2), angle=-0.7),
    )
    loads = [cg.ForceLoad(at=0.33, force=(0.0, 0.0)), cg.ForceLoad(at=0.6, force=(0.0, 0.0), follows=True)]
    run_time = ("bending_stiffness", "linear_density", "tip_mass", "gravity", "base_angle")
    return {
        "bare": (bare, {"gravity": (0.0, 0.0)}),
        "weight, mass, tendons": (finger, {}),
        "forces at contact and tip": (finger, {"contacts": (0.3,), "tip_force": True}),
        "parameters at run time": (finger, {"parameters": run_time}),
        "loads": (bare, {"loads": [*loads, cg.MomentLoad(at=0.22, moment=0.0)]}),
        "lag of the tendons": (lag, {}),
        "rest curvature, material damping": (bent, {"tip_force": True}),
        "small range": (finger, {"bending_range": 0.3}),
        "input rates": (finger, {"input_rates": True}),
    }


def instructions(family: str) -> Values:
    """Instructions of all functions with 1 to 8 elements."""
    models = {n: cg.FingerModel(bench_dynamics.finger(), family=family, elements=n) for n in range(1, 9)}
    return {f"{f}.{n}": getattr(model, f).n_instructions() for n, model in models.items() for f in FUNCTIONS}


def sources(family: str) -> Values:
    """The C of the forward dynamics of models of all make-ups, as CasADi writes it."""
    values = {}
    for (name, (finger, options)), n in itertools.product(makeups().items(), (2, 4, 6)):
        if name != "input rates" or family == "matched_clothoid":  # no other family has them
            generator = ca.CodeGenerator("generated.c")
            generator.add(cg.FingerModel(finger, family=family, elements=n, **options).forward_dynamics)
            text = generator.dump()
            values[f"{name}, {n} elements"] = f"{sha(text)}, {len(text)} bytes"
    return values


def random_grasps(kind: str, first: int) -> Values:
    """A hundred random scenes of ``bench_grasp``: how many are solved, and every status and tension."""
    found = [outcome(kind, row) for row in bench_grasp.known(kind)[first : first + 100]]
    values = {name: sum(getattr(o, name) for o in found) for name in ("good", "better", "false", "right", "number")}
    values |= {f"{o.seed}.status": o.status for o in found}
    return values | {f"{o.seed}.tension": float(f"{o.tension:.{DIGITS}g}") for o in found if math.isfinite(o.tension)}


def dynamics_ratios() -> Values:
    """Ratios of the times of ``bench_dynamics``."""
    report, rng = Report("dynamics", 0), np.random.default_rng(0)
    bench_dynamics.against_the_paper(report, rng)
    bench_dynamics.batch(report, rng)
    bench_dynamics.growth(report, rng, 8)
    return dict(of_tables(report.as_json()["tables"]))


def control_race() -> Values:
    """Ratios of the times of the control race, closed-loop costs, and how many steps were solved."""
    with tempfile.TemporaryDirectory() as place:
        line = [sys.executable, "-m", "benchmarks.bench_mpc", "--only", "race", "--name", "race", "--folder", place]
        subprocess.run(line, cwd=ROOT, check=True, stdout=sys.stderr)
        return dict(of_tables(json.loads((Path(place) / "race.json").read_text())["tables"]))


def of_tables(tables: list[dict[str, Any]]) -> Iterator[tuple[str, Any]]:
    """Quartiles of times as multiples of the first time of a table; counts and costs as they are."""
    for table in tables:
        timed = [k for k, name in enumerate(table["columns"]) if re.match(r"median|quartile|one at|in a batch", name)]
        for row in table["rows"] if timed else ():
            name = f"{table['title']}, {row[0]} {row[1] if table['columns'][1] == 'elements' else ''}"
            for k, column in enumerate(table["columns"]):
                if k in timed:
                    yield f"ratio: {name}, {column}", row[k] / table["rows"][0][timed[0]]
                elif column in ("instructions", "closed-loop cost", "solved"):
                    yield f"{name}, {column}", row[k]


def items(folder: Path) -> Iterator[tuple[str, Callable[[], Values]]]:
    """Names of all that is recorded, with what makes their values."""
    for family in bench_dynamics.FAMILIES:
        yield f"instructions/{family}", partial(instructions, family)
        yield f"forward_dynamics/{family}", partial(sources, family)
    for name, arguments in commands(folder):
        yield name, partial(command, name, folder, arguments)
    for kind, count in (("one", 1000), ("two", 100), ("none", 100)):
        for first in range(0, count, 100):
            yield f"random grasps/{kind} {first}", partial(random_grasps, kind, first)
    yield "ratios/dynamics", dynamics_ratios
    yield "ratios/control", control_race


def difference(a: Any, b: Any) -> float:
    """By what part two values differ; infinite where they cannot be compared."""
    if a == b:
        return 0.0
    if isinstance(a, dict) and isinstance(b, dict) and "probes" in a and "probes" in b and a["shape"] == b["shape"]:
        scale = max(a["peak"], b["peak"]) or 1.0
        pairs = zip([a["peak"] / scale, *a["probes"]], [b["peak"] / scale, *b["probes"]], strict=True)
        most = max(abs(u - v) for u, v in pairs)
    elif all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in (a, b)):
        scale = max(abs(a), abs(b))
        most = abs(a - b) / scale
    else:
        return math.inf
    return most if most * scale > NEGLIGIBLE else min(most, NEGLIGIBLE)


def compared(a: Values, b: Values, tolerance: float) -> tuple[bool, str, list[str]]:
    """Whether an item stayed, the verdict, and what differs, the worst first."""
    moved = {key: difference(a[key], b[key]) for key in a.keys() & b.keys()}
    timed = {key for key in moved if key.startswith("ratio: ")}
    worst = sorted(moved, key=lambda key: (-moved[key], key))
    worst = [key for key in worst if moved[key] > (RATIOS if key in timed else tolerance)]
    lines = [f"{key}: {short(a[key])} -> {short(b[key])} ({moved[key]:.2g})" for key in worst]
    lines += [f"{key}: only before, {short(a[key])}" for key in a if key not in b]
    failed = len(lines) - len(timed.intersection(worst))
    lines += [f"{key}: only after, {short(b[key])}" for key in b if key not in a]
    if failed:
        return False, f"**{failed} of {len(a)} differ**", lines
    largest = max((moved[key] for key in moved if key not in timed), default=0.0)
    ratios = f", {len(timed.intersection(worst))} ratios moved by more than {RATIOS:.0%}" if timed else ""
    return True, (f"same to {largest:.1g}" if largest else "same") + ratios, lines


def short(value: Any) -> str:
    """A value in a line."""
    if isinstance(value, dict):
        return f"peak {value['peak']:.6g}" if "peak" in value else str(value["words"])[:60]
    return str(value)


def summary(values: Values) -> str:
    """An item in the table: how it ended, how much it holds, and a hash of it."""
    ends = [str(values[key]) for key in ("json.status", "good") if key in values]
    return ", ".join([*ends, f"{len(values)} values", sha(json.dumps(values, sort_keys=True))[:6]])


def read(file: Path) -> dict[str, Any]:
    """A record; empty where there is none yet."""
    return json.loads(gzip.decompress(file.read_bytes())) if file.exists() else {"items": {}, "seconds": {}}


def record(arguments: argparse.Namespace) -> bool:
    """Add items to the file, each as soon as it is there."""
    with tempfile.TemporaryDirectory() as place:
        for name, make in items(Path(place)):
            known = arguments.missing and name in read(arguments.file)["items"]
            if not known and any(fnmatch(name, some) for some in arguments.items):
                began = time.perf_counter()
                values, whole = make(), read(arguments.file)
                whole["items"][name], whole["seconds"][name] = values, round(time.perf_counter() - began, 1)
                whole["machine"] = describe()
                arguments.file.write_bytes(gzip.compress(json.dumps(whole).encode(), mtime=0))
                print(f"{name}: {summary(values)}, {whole['seconds'][name]:.0f} s", flush=True)
    return True


def compare(arguments: argparse.Namespace) -> bool:
    """Print the table, then what differs; whether all stayed."""
    before, after = (read(file)["items"] for file in (arguments.before, arguments.after))
    for rename in arguments.renamed:
        before = json.loads(json.dumps(before).replace(*rename.split("=")))
    print("| item | before | after | verdict |\n| --- | --- | --- | --- |")
    everything, notes = True, []
    for name in sorted(before.keys() | after.keys()):
        if name not in before or name not in after:
            everything = everything and name in after
            print(f"| {name} | | | only {'before' if name in before else 'after'} |")
            continue
        stayed, verdict, lines = compared(before[name], after[name], arguments.tolerance)
        everything = everything and stayed
        print(f"| {name} | {summary(before[name])} | {summary(after[name])} | {verdict} |")
        more = [f"and {len(lines) - arguments.most} more"] if len(lines) > arguments.most else []
        notes += ["", f"## {name}", "", *(f"- {line}" for line in [*lines[: arguments.most], *more])] if lines else []
    print("\n".join(notes))
    return everything


def main() -> None:
    """Record or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(required=True)
    one = verbs.add_parser("record")
    one.add_argument("file", type=Path)
    one.add_argument("--items", nargs="+", default=["*"], help="patterns of names")
    one.add_argument("--missing", action="store_true", help="only what the file lacks")
    one.set_defaults(run=record)
    two = verbs.add_parser("compare")
    two.add_argument("before", type=Path)
    two.add_argument("after", type=Path)
    two.add_argument("--renamed", action="append", default=[], metavar="OLD=NEW", help="names and words of BEFORE")
    two.add_argument("--tolerance", type=float, default=1e-9, help="relative difference that counts as rounding")
    two.add_argument("--most", type=int, default=10, help="lines of detail of an item")
    two.set_defaults(run=compare)
    arguments = parser.parse_args()
    sys.exit(not arguments.run(arguments))


if __name__ == "__main__":
    main()
