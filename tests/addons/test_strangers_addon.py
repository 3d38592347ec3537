"""An add-on of someone else, built, installed and run as its users do."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from docs.guides import blocks, page_text

ROOT = Path(__file__).parents[2]
ADDON = ROOT / "examples" / "addon"
SCENE = ADDON / "sticky_swing.yaml"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder in which the add-on is installed, beside the package."""
    folder = tmp_path_factory.mktemp("installed")
    line = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--target", folder]
    subprocess.run([*line, str(ADDON)], check=True, capture_output=True, text=True)
    return folder


def test_the_page_on_addons_has_the_files_of_the_example():
    """The page is run from its text by ``tests/docs/test_guides.py``."""
    named = {
        first.removeprefix("# "): rest
        for first, _, rest in (block.text.partition("\n") for block in blocks(page_text("addons")))
        if re.fullmatch(r"# [\w/]+\.(py|toml|yaml)", first) and first != "# try_bench.py"
    }
    files = [file for file in ADDON.rglob("*") if file.suffix in (".py", ".toml", ".yaml")]
    for file in files:
        text = file.read_text(encoding="utf-8").replace("../../configs", "configs")
        text = re.sub("^# yaml-language-server.*\n", "", text)
        assert named.pop(file.relative_to(ADDON).as_posix()) == text
    assert files
    assert named == {}


def run(folder: Path, *words: object, status: int = 0) -> subprocess.CompletedProcess[str]:
    places = os.pathsep.join([str(folder), str(ROOT)])
    line = [sys.executable, *map(str, words)]
    done = subprocess.run(line, env={**os.environ, "PYTHONPATH": places}, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done


@pytest.mark.deep
def test_the_verb_finds_what_the_law_pulls(installed):
    """A finger that rests on a disc sinks in by the pull per stiffness more, 0.5 N of 5 kN/m, along the normal."""
    done = run(installed, "-m", "continuum_grasp", "pull-off", SCENE, "--json")
    tips = json.loads(done.stdout)
    deeper = np.linalg.norm(np.subtract(tips["adhesive"], tips["dry"]))
    assert deeper == pytest.approx(0.5 / 5e3, rel=0.15)


def test_the_verb_is_in_the_help(installed):
    assert "pull-off" in run(installed, "-m", "continuum_grasp", "--help").stdout


def test_without_the_addon_its_law_is_missed(tmp_path):
    done = run(tmp_path, "-m", "continuum_grasp", "simulate", SCENE, "--out", tmp_path / "run", status=2)
    assert "contact_law.law" in done.stderr
    assert "no installed add-on provides the law 'adhesive'" in done.stderr


def test_a_controller_meets_the_plant(installed):
    """Commands reach a plant that is no finger; its tensions follow them."""
    code = """
import math
import numpy as np
import continuum_grasp as cg
from adhesive_pads.plant import SlowBench
from continuum_grasp.closed_loop import run_hardware
controller = cg.Controller("configs/mpc/steady_tip.yaml", deadline=math.inf)
bench = SlowBench(np.array([0.18, 0.0, 1.0, 1.0]))
done = run_hardware(controller, bench, duration=0.2)
print(len(bench.commands) > 5, np.isfinite(bench.commands).all())
"""
    assert run(installed, "-c", code).stdout.split() == ["True", "True"]


def test_an_addon_that_cannot_be_loaded_is_named_and_the_others_work(tmp_path):
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[continuum_grasp.addons]\nbroken = no_such_module:ADDON\n")
    done = run(tmp_path, "-m", "continuum_grasp", "validate", ROOT / "configs/sweep/mug_uncertain.yaml")
    said = "warning: add-on 'broken' (no_such_module:ADDON) cannot be loaded: ModuleNotFoundError"
    assert done.stderr.startswith(said)
