"""Gallery of all shipped examples: ``python -m docs.gallery`` in the root of the repository.

It runs every example that is new or has changed by its command, one at a time, stores its status in ``gallery.json``
and its picture in ``pictures/gallery``, and writes ``gallery.md``; an interrupted run resumes. ``--again NAME`` repeats
some, ``--times`` measures how long all of them take on this machine, ``--page`` writes the
page alone. Measured data of the examples of ``identify`` are taken from the folder that ``CONTINUUM_GRASP_DATA`` names.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image, ImageSequence

import continuum_grasp as cg
from continuum_grasp.addons.identification import data_folder
from continuum_grasp.examples import Example, examples
from continuum_grasp.results import Run, write_text
from docs.examples import scripts

ROOT = Path(__file__).absolute().parents[1]
RECORD, PAGE, PICTURES = (ROOT / "docs" / name for name in ("gallery.json", "gallery.md", "pictures"))
WIDTH, MOST_BYTES = 560, 40_000
"""Of a picture [pixels, bytes]."""
COLUMNS = 3
DATA = "DATA"
"""What stands on the page for the folder of measured data."""


@dataclass(frozen=True)
class Kind:
    """A part of the page."""

    title: str
    text: str
    picture: str
    """Main picture, by a pattern of its name."""
    cropped: float = 0.0
    """What is cut off at the right [inch]: the numbers beside the drawing of a grasp, too small to read here."""
    shown: float | None = None
    """Width [inch] beyond which it is cut: the view in space of a hand, without the planes of its fingers."""


KINDS = {
    "simulate": Kind("Motions", "A finger moves in time, alone or [in contact](contact.md).", "snapshots.png"),
    "grasp": Kind(
        "Grasps",
        "[Fingers hold an object](grasps.md), or the answer is why they cannot.",
        "grasp.png",
        3.2,
    ),
    "hand": Kind(
        "Hands in space", "[Planar fingers around a palm hold a solid object](hands.md).", "hand.png", shown=4.4
    ),
    "mpc": Kind(
        "Control", "[A controller](control.md) against [a plant that differs from its model](mpc.md).", "path.png"
    ),
    "mission": Kind("Missions", "[Grasp, lift, hold and release](missions.md) under control.", "timeline.png"),
    "plan": Kind("Plans", "[A whole motion](plans.md) in least time or with least effort.", "path.png"),
    "identify": Kind(
        "Identification",
        "[Parameters from measurements](real_rods.md). The measurements are published by others and not "
        f"shipped; each configuration names their source, and `{DATA}` stands for the folder that has them. Those of "
        "`nitinol_releases` are simulated by this page's script, on a rod that is 8 % softer than assumed.",
        "series.png",
    ),
    "design": Kind("Designs", "[Numbers of a finger chosen by gradient](design_by_gradient.md).", "design.png"),
    "sweep": Kind("Sweeps", "[One scene many times](sweeps.md).", "map_*.png"),
}
TELLING = {"identify/foam_rod": "shapes.png", "identify/own_finger": "shapes.png"}
TELLING |= {"identify/trunk_releases": "shapes.png"}
TELLING |= {"mpc/saturation": "inputs.png", "mpc/pulse": "tracking.png", "mpc/steady_tip": "tracking.png"}
"""Pictures that show what an example is for better than the main one of its kind."""


@dataclass(frozen=True)
class Film:
    """An animation of an example, made smaller."""

    file: str
    """In docs/pictures."""
    width: int = 480
    every: int = 2
    """Of how many frames one stays."""
    slower: float = 1.0


FILMS = {
    "mission/mug": Film("mission.gif", 640),
    "simulate/nitinol_release_020g": Film("release.gif", every=1, slower=2.0),
    "mpc/tip_arc": Film("tip_arc.gif"),
    "simulate/spirob": Film("gallery/simulate_spirob.gif", every=1),
    "simulate/swing_against_disc": Film("gallery/simulate_swing_against_disc.gif", every=1, slower=2.0),
    "mpc/keep_out": Film("gallery/mpc_keep_out.gif"),
    "plan/past_a_post": Film("gallery/plan_past_a_post.gif", every=1, slower=4.0),
}
"""Moving pictures, in place of the others."""
_REST_MS = 700
"""A moving picture rests at its end, as `animate` has it."""


def shown() -> list[Example]:
    """What the gallery shows: all examples that a verb computes; fingers alone can only be validated."""
    return [one for one in examples().values() if one.kind in KINDS]


# -- running -----------------------------------------------------------------------------------------------------------


def run(one: Example, out: Path, data: Path | None, *options: str, cache: Path | None = None) -> tuple[int, str, float]:
    """Run an example by its command in a process of its own: exit status, standard output, seconds."""
    words = [*command(one, data)[1:], "--out", str(out), *options]
    environment = {k: v for k, v in os.environ.items() if k != "CONTINUUM_GRASP_QUICK_COMPILE" or cache is None}
    environment |= {"MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
    if cache is not None:
        environment["CONTINUUM_GRASP_CACHE"] = str(cache)
    start = time.perf_counter()
    # no interruption ends half-way: the records are written after each example
    done = subprocess.run(
        [sys.executable, "-m", "continuum_grasp", *words],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    return done.returncode, done.stdout, time.perf_counter() - start


def command(one: Example, data: Path | None) -> list[str]:
    """The words of the command, with the folders of data that are not shipped."""
    words = ["continuum-grasp", *one.arguments]
    return [*words, "--data", str(data)] if one.missing and data else words


def data_of(one: Example, work: Path) -> Path | None:
    """Folder of the data that an example needs and that are not shipped; SystemExit where they are not there."""
    if not one.missing:
        return None
    if one.name == "identify/nitinol_releases":
        return simulated_releases(one, work)
    folder = data_folder()
    for path in sorted(folder.rglob("*.csv")) if folder else ():
        if path.match(one.missing[0]):
            return path.parent
    sys.exit(f"{one.name}: no data {', '.join(one.missing)}; set CONTINUUM_GRASP_DATA to their folder")


def simulated_releases(one: Example, work: Path) -> Path:
    """Paths of the tip as a camera would measure them (50 Hz, 1 mm of noise), of a rod 8 % softer than assumed."""
    rng = np.random.default_rng(0)
    changes = ["finger.rod.youngs_modulus=55e9", "finger.damping.material=1.3e-4", "time.step=0.02"]
    work.mkdir(parents=True, exist_ok=True)
    for name in one.missing:
        motion = cg.simulate(cg.load(ROOT / f"configs/simulate/nitinol_{Path(name).stem}.yaml", changes))
        rows = np.column_stack([motion.t, motion.tip + 1e-3 * rng.standard_normal(motion.tip.shape)])[1:]
        with (work / name).open("w", newline="") as file:
            csv.writer(file).writerows([("t [s]", "x [m]", "y [m]"), *rows.round(6).tolist()])
    return work


def status_of(one: Example, folder: Path, code: int, said: str) -> str:
    """What came out, in the words of the run."""
    wanted = {"sweep": "status", "mission": "object"}.get(one.kind)
    lines = [re.split(r"  +", line.strip(), maxsplit=1) for line in said.splitlines()]
    found = [line[1] for line in lines if len(line) == 2 and line[0] == wanted]
    if found:
        return found[0]
    meta = json.loads((folder / "meta.json").read_text(encoding="utf-8"))
    message = meta.get("message", "")
    return f"{meta['status']}: {message}" if code else str(meta["status"])


def made_with(one: Example) -> str:
    """Changes where the content of an example changes, not where it is only written otherwise."""
    files = [file for file in one.files if file.suffix == ".yaml"]
    return Run.digest([cg.load(ROOT / file) for file in files])[:16]


# -- pictures ----------------------------------------------------------------------------------------------------------


def save_thumbnail(source: Path, target: Path, kind: Kind) -> None:
    """Write a picture in ``WIDTH``, without loss where that is small enough."""
    picture = Image.open(source).convert("RGB")
    right = picture.width - round(150 * kind.cropped) if kind.shown is None else blank_column(picture, kind.shown)
    picture = picture.crop((0, 0, right, picture.height))
    picture = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS)
    for options in ({"lossless": True}, *({"quality": quality} for quality in range(90, 20, -5))):
        buffer = io.BytesIO()
        picture.save(buffer, "WEBP", method=6, **options)
        if buffer.tell() <= MOST_BYTES:
            target.write_bytes(buffer.getvalue())
            return
    raise ValueError(f"{target.name} does not fit into {MOST_BYTES} bytes")


def blank_column(picture: Image.Image, beyond: float) -> int:
    """Column after a width [inch] in the first blank strip that is wider than what is between letters."""
    first = round(150 * beyond)
    blank = np.asarray(picture.convert("L"))[:, first:].min(axis=0) > 250  # of 255
    wide = np.lib.stride_tricks.sliding_window_view(blank, 4).all(axis=1)
    return first + int(wide.argmax()) + 2


def save_film(source: Path, film: Film) -> None:
    """Write an animation with fewer and smaller frames."""
    with Image.open(source) as animation:
        # the palette that is there has every color of the thin lines; a new one would have those of the areas
        palette = animation.copy()
        frames = [(frame.convert("RGB"), frame.info["duration"]) for frame in ImageSequence.Iterator(animation)]
    size = film.width, round(frames[0][0].height * film.width / frames[0][0].width)
    small, times = [], []
    for k in range(0, len(frames), film.every):
        # the last frame of each group: the motion ends where it ended
        small.append(frames[min(k + film.every, len(frames)) - 1][0].resize(size, Image.Resampling.LANCZOS))
        times.append(round(film.slower * sum(shown_ms for _, shown_ms in frames[k : k + film.every])))
    times[-1] = round(times[0]) + _REST_MS
    done = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in small]
    target = PICTURES / film.file
    done[0].save(target, "GIF", save_all=True, append_images=done[1:], duration=times, loop=0, optimize=True)


# -- record and page ---------------------------------------------------------------------------------------------------


def read_record() -> dict[str, Any]:
    """What earlier runs found."""
    return json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {"scenes": {}, "times": []}


def write_record(record: dict[str, Any]) -> None:
    """Store it, and write the page."""
    for part in (record["scenes"], *(times["seconds"] for times in record["times"])):
        for name in set(part) - {one.name for one in shown()}:
            del part[name]
    write_text(json.dumps(record, indent=1, sort_keys=True, ensure_ascii=False) + "\n", RECORD)
    write_text(page(record), PAGE)


def update(record: dict[str, Any], again: Iterable[str]) -> None:
    """Run what is new or has changed, and what is to be run again."""
    (PICTURES / "gallery").mkdir(parents=True, exist_ok=True)
    for one in shown():
        made, known = made_with(one), record["scenes"].get(one.name, {})
        if known.get("digest") == made and (PICTURES / known["picture"]).exists() and one.name not in again:
            continue
        with TemporaryDirectory() as work:
            folder, film = Path(work) / "run", FILMS.get(one.name)
            options = ["--animate", "gif"] if film else []
            data = data_of(one, Path(work) / "releases")
            code, said, seconds = run(one, folder, data, *options)
            print(f"{one.name:32s} exit status {code}, {seconds:.1f} s", flush=True)
            pictures = sorted(folder.glob(TELLING.get(one.name, KINDS[one.kind].picture)))
            if not pictures:
                sys.exit(f"{one.name}: no picture; the command printed\n{said}")
            if film:
                save_film(folder / "animation.gif", film)
            picture = film.file if film else f"gallery/{one.name.replace('/', '_')}.webp"
            if not film:
                save_thumbnail(pictures[0], PICTURES / picture, KINDS[one.kind])
            entry = {"digest": made, "picture": picture, "status": status_of(one, folder, code, said)}
            if data:
                entry["data"] = data.name
        record["scenes"][one.name] = entry
        write_record(record)


def measure(record: dict[str, Any], wanted: Iterable[str]) -> None:
    """Time every example, from start to end of its process, with an empty cache and, where it fills that, once more."""
    from benchmarks.report import describe

    machine, same = describe(), ("cpu", "cores", "compiler")
    times: dict[str, Any] = {"seconds": {}}
    for known in record["times"]:
        if all(known["machine"][key] == machine[key] for key in same):
            times = known
    times |= {"machine": machine, "date": date.today().isoformat()}
    record["times"] = [times, *(known for known in record["times"] if known is not times)]
    for one in [one for one in shown() if not wanted or one.name in wanted]:
        with TemporaryDirectory() as work:
            cache, data = Path(work) / "cache", data_of(one, Path(work) / "releases")
            seconds = [run(one, Path(work) / "first", data, cache=cache)[2]]
            # what neither compiles nor chooses a model does the same work every time
            if any(path.is_file() for path in cache.rglob("*")):
                seconds.append(run(one, Path(work) / "second", data, cache=cache)[2])
        print(f"{one.name:32s}", *(f"{value:.1f} s" for value in seconds), flush=True)
        for known in record["times"]:
            known["seconds"].pop(one.name, None)
        times["seconds"][one.name] = [round(value, 2) for value in seconds]
        record["times"].sort(key=lambda known: -len(known["seconds"]))
        write_record(record)


def page(record: dict[str, Any]) -> str:
    """The page of a record."""
    scenes, machines = record["scenes"], [times for times in record["times"] if times["seconds"]]
    times = {name: (k, seconds) for k, one in enumerate(machines) for name, seconds in one["seconds"].items()}
    parts = [
        "# Gallery",
        "Every configuration that is shipped, run by its command. A picture is the main one that the command draws, a "
        "moving one comes with `--animate gif`; all are in the run folder. "
        "`continuum-grasp new DIR --example grasp/mug` copies one with all that it needs. "
        "[Short scripts](#examples-in-python) come last.",
        _times_text(machines),
    ]
    for kind, part in KINDS.items():
        mine = [one for one in shown() if one.kind == kind and one.name in scenes]
        if not mine:
            continue
        rows = [_row(one, scenes[one.name], times.get(one.name)) for one in mine]
        parts += [f"## {part.title}", part.text, _pictures(mine, scenes)]
        parts.append(
            "\n".join(["| scene | what, and how | status | first run | again |", "|---|---|---|---|---|", *rows])
        )
    parts += ["## Examples in Python", "[Short scripts](examples.md), each with a known answer.", _scripts()]
    parts.append(
        "Written by `python -m docs.gallery`; times by `python -m docs.gallery --times`, one command at a time."
    )
    return "\n\n".join(parts) + "\n"


def _times_text(machines: list[dict[str, Any]]) -> str:
    if not machines:
        return "Times are not measured yet."
    where = [
        f"{'' if k == 0 else f'those with {_mark(k)} '}on {m['machine']['cpu']} with {m['machine']['cores']} cores, "
        f"{m['machine']['compiler']}, {m['date']}"
        for k, m in enumerate(machines)
    ]
    return (
        "Times are those of the whole command, from the start of its process to its end, pictures included, "
        f"{'; '.join(where)}. The first run compiles the C code that later ones take from the cache; where there is "
        "one time only, nothing is compiled."
    )


def _mark(machine: int) -> str:
    """What stands behind times of another machine than the first."""
    return "*" * machine


def _pictures(mine: list[Example], scenes: dict[str, Any]) -> str:
    cells = []
    for one in mine:
        place = f"pictures/{scenes[one.name]['picture']}"
        cells.append(f"[![{_cell(one.summary)}]({place})]({place})<br>{one.path.stem.replace('_', ' ')}")
    return _grid(cells)


def _scripts() -> str:
    """Pictures of the examples in Python, with links to their code."""
    cells = []
    for script in scripts():
        words = script.stem[5:].replace("_", " ")
        cells.append(f"[![{words}](pictures/examples/{script.stem}.webp)](../examples/{script.name})<br>{words}")
    return _grid(cells)


def _grid(cells: list[str]) -> str:
    """Table of pictures, ``COLUMNS`` in a row."""
    cells = cells + [" "] * (-len(cells) % COLUMNS)
    lines = [" | ".join(cells[k : k + COLUMNS]) for k in range(0, len(cells), COLUMNS)]
    # the head of a table would set its row apart
    return "\n".join(["| " * COLUMNS + "|", "|:---:" * COLUMNS + "|", *(f"| {line} |" for line in lines)])


def _row(one: Example, scene: dict[str, Any], measured: tuple[int, list[float]] | None) -> str:
    link = f"[{one.path.stem}](../{one.files[0].as_posix()})"
    data = Path(DATA) / scene["data"] if "data" in scene else None
    words = " ".join(command(one, data))
    machine, seconds = measured or (0, [])
    first, again = ([f"{value:.1f} s{_cell(_mark(machine))}" for value in seconds] + ["", ""])[:2]
    return f"| {link} | {_cell(one.summary)}<br>`{words}` | {_cell(scene['status'])} | {first} | {again} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("[", "\\[").replace("]", "\\]").replace("*", "\\*")


def main() -> None:
    """Do what the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--again", nargs="*", default=[], metavar="NAME", help="examples to run although nothing changed"
    )
    parser.add_argument("--times", nargs="*", metavar="NAME", help="measure the times of all examples, or of some")
    parser.add_argument("--page", action="store_true", help="write the page from the stored record, and nothing else")
    asked = parser.parse_args()
    record = read_record()
    if asked.page:
        write_record(record)
    elif asked.times is not None:
        measure(record, asked.times)
    else:
        update(record, asked.again)
        write_record(record)


if __name__ == "__main__":
    main()
