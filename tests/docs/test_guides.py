"""The guides run as they stand: every command in its order, in a folder of its own, prints what the page says."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import continuum_grasp as cg
from continuum_grasp.scene import json_schema
from docs.guides import ROOT, Run, blocks, page_text, pictures, run
from docs.own_finger_data import FOLDER, TRUTH
from tests.scene_keys import keys_below

BUILD = ("first_finger", "identified_fingers", "compare", "design_a_finger")
GRASP = ("grasp_an_object", "grasp_with_errors", "close_the_fingers", "carry_out_a_grasp")
CONTROL = ("close_a_loop", "estimate_unknowns", "run_your_own_loop", "commission", "controller_in_c", "embedded")
PATHS = (*BUILD, *GRASP, *CONTROL)
PAGES = (*PATHS, "simulate", "recipes", "chains", "fmu", "learning", "operators", "results", "command_line", "addons")
BOARD = ("cmake", "make", "arm-none-eabi-gcc", "qemu-system-arm")
"""Programs that the page on a board runs."""
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")


def apart(line):
    """Words of a line with its numbers taken out, and the numbers as texts."""
    return " ".join(_NUMBER.sub("#", line).split()), _NUMBER.findall(line)


def agrees(said, printed):
    """Whether a number of a page is the one that is printed, within 1 % or two units of its last digit."""
    mantissa, _, exponent = said.replace(",", "").partition("e")
    digits = len(mantissa.partition(".")[2])
    last = 10.0 ** (int(exponent or 0) - digits)
    value, found = float(said.replace(",", "")), float(printed.replace(",", ""))
    return abs(found - value) <= max(0.01 * abs(value), 2.0 * last)


def quotes(line, printed):
    """Whether a printed line is the one that a page quotes; … stands for any word."""
    words, numbers = line.split(), printed.split()
    if "…" in words and len(words) == len(numbers):
        pairs = [(w, p) for w, p in zip(words, numbers, strict=True) if w != "…"]
        line, printed = " ".join(w for w, _ in pairs), " ".join(p for _, p in pairs)
    (text, said), (other, found) = apart(line), apart(printed)
    return text == other and len(said) == len(found) and all(map(agrees, said, found))


def missing(lines, output):
    """Quoted lines that an output does not have in this order."""
    rest = iter(output.splitlines())
    return [line for line in lines if not any(quotes(line, printed) for printed in rest)]


def test_quoted_numbers_must_agree():
    assert missing(["tip at (0.11, -2e-3) m"], "status\ntip at  (0.1101, -0.002001) m") == []
    assert missing(["| 2 | 1,006 | … |"], "| 2 | 1,006 | 415 |") == []
    assert missing(["tip at (0.11, 0.13) m"], "tip at (0.11, 0.16) m") != []
    assert missing(["second", "first"], "first\nsecond") == ["first"]


def test_a_page_that_does_not_fit_is_noticed(tmp_path):
    for text in ("```sh\ncontinuum-grasp validate none.yaml\n```\n", "```yaml\nname: x\n```\n", "```c\n```\n"):
        with pytest.raises((RuntimeError, ValueError)):
            Run(tmp_path).page(text)


@pytest.mark.parametrize("page", PAGES)
def test_pages_have_their_pictures(page):
    for name in pictures(page_text(page)):
        assert (ROOT / "docs/pictures" / name).is_file()


def verdicts(page):
    """Statuses that a page quotes below its commands ``grasp``, by the folders of the runs."""
    found = {}
    folder = None
    for block in blocks(page_text(page)):
        command = re.match(r"continuum-grasp grasp \S*?(\w+)\.yaml(?:.* --out runs/grasp/(\w+))?", block.text)
        if block.kind == "text" and folder is not None:
            found[folder] = block.text.partition(":")[0]
        folder = None if command is None else command[2] or command[1]
    return found


@pytest.mark.parametrize("page", GRASP)
def test_pictures_of_grasps_have_the_verdict_of_the_text(page):
    """Pictures carry the status of the run that drew them."""
    said = verdicts(page)
    for name in pictures(page_text(page)):
        verb, folder, *_ = Path(name).stem.split("-")
        if verb == "grasp":
            assert Image.open(ROOT / "docs/pictures" / name).info["Description"] == said[folder]


@pytest.mark.parametrize("page", PATHS)
def test_pages_of_a_path_are_short_examples_from_an_empty_folder(page):
    text = page_text(page)
    assert len(text.split()) <= 1_500
    assert "continuum-grasp new" in next(block.text for block in blocks(text) if block.kind == "sh")
    assert "](README.md#activate)" in text.partition("```")[0]  # a shell knows the command once .venv is active
    assert pictures(text)


ROWS = re.compile(r"^\| ((?:`[\w.]+`(?:, )?)+) \|", re.MULTILINE)


def test_the_keys_on_the_page_of_simulate_are_those_of_the_schema():
    schema, checked = json_schema("simulate"), 0
    for table in re.split(r"\n\n", page_text("simulate")):
        head = re.match(r"\| key(?: of `([\w.]+)`)? \| +\|", table)
        if head is not None:
            known = keys_below(schema, (head[1] or "").split(".") if head[1] else ())
            named = {key for row in ROWS.findall(table) for key in re.findall(r"[\w.]+", row)}
            assert named <= known, f"{head[1]}: {sorted(named - known)}"
            checked += len(named)
    assert checked > 30


@pytest.mark.deep
@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    for package in ("pandas", "xarray", "mujoco", "fmpy", "jax", "gymnasium"):
        if re.search(rf"import {package}|to_{package}\(", page_text(page)):
            pytest.importorskip(package)
    if page == "embedded" and not all(map(shutil.which, BOARD)):
        pytest.skip(f"needs {', '.join(BOARD)}")
    done = run(page, tmp_path)
    assert len(done.quoted) == sum(block.kind == "text" for block in blocks(page_text(page))) > 0
    wrong = [(f"{page}.md:{one.line}", missing(one.lines, one.output), one.output) for one in done.quoted]
    assert [one for one in wrong if one[1]] == []
    for name, source in pictures(page_text(page)).items():
        assert (done.folder / source).is_file(), name


@pytest.mark.deep
def test_identify_recovers_the_simulated_finger():
    fit = cg.identify(FOLDER / "own_finger.yaml", [*FOLDER.glob("own_finger*.csv")])
    start = cg.load(FOLDER / "own_finger.yaml").finger
    assert abs(start.rod.stiffness / TRUTH["bending_stiffness"] - 1.0) > 0.05  # there is something to be found
    for name, (low, high) in zip(fit.names, fit.intervals, strict=True):
        assert low < TRUTH[name] < high
        assert high - low < 0.2 * TRUTH[name]


def test_the_page_names_the_true_values():
    page = " ".join(page_text("first_finger").split())
    said = re.search(r"E I = (\S+) N m², damping (\S+) N m² s and a clamp that is turned by (\S+) rad", page)
    assert said is not None
    assert [float(value) for value in said.groups()] == list(TRUTH.values())
    for file in FOLDER.glob("own_finger*.csv"):  # so that no reader takes them for measured
        assert file.read_text(encoding="utf-8").startswith("# Simulated, not measured")


@pytest.mark.deep
def test_sample_measurements_are_those_of_their_script(tmp_path):
    files = sorted(FOLDER.glob("own_finger*.csv"))
    code = f"import pathlib, docs.own_finger_data as d; d.FOLDER = pathlib.Path({str(tmp_path)!r}); d.main()"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    for file in files:
        committed, again = (
            np.genfromtxt(path / file.name, delimiter=",", skip_header=3) for path in (FOLDER, tmp_path)
        )
        # Printed to a tenth: another machine may round the last digit otherwise.
        assert np.abs(committed - again).max() <= 0.11
