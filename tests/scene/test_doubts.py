"""Doubts: implausible magnitudes are named with file and line, or are errors where the user wants that."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from continuum_grasp import load
from continuum_grasp.base import InputError
from continuum_grasp.scene import Rod, doubts_refused

ROOT = Path(__file__).parents[2]
GRASP = (ROOT / "configs/grasp/mug.yaml").read_text(encoding="utf-8")
# key, value, unit: slips of a user, each beyond what anything built has
SLIPS = [
    ("simulate/close_on_mug", "object.mass", "150", "kg"),  # grams: 12 kg of osmium have the size of the mug
    ("simulate/close_on_mug", "contact_law.friction", "50", "is more than dry surfaces"),  # percent
    ("simulate/close_on_mug", "gravity", "[0.0, 9.81]", "points up"),
    ("simulate/hanging", "time", "{duration: 1.0e9, step: 1.0e3}", "more than eleven days"),
    ("simulate/hanging", "finger.base.position", "[412.0, 233.0]", "pixels"),
    ("simulate/hanging", "gravity", "[0.0, -9810.0]", "mm/s2"),
    ("grasp/mug", "object.mass", "300", "kg"),
    ("grasp/mug", "contacts.friction", "50", "percent"),
    ("grasp/mug", "object.angle", "30.0", "degrees"),
    ("grasp/mug", "contacts.normal_force_max", "30000", "millinewtons"),
    ("grasp/mug", "finger.tendons.max_tension", "50000", "millinewtons"),
    ("hand/ball", "object.rotation", "[30.0, 0.0, 0.0]", "degrees"),
    ("hand/ball", "object.mass", "80", "kg"),
    ("mpc/steady_tip", "duration", "1.0e9", "s is more"),
    ("mpc/steady_tip", "finger.rod.length", "180.0", "millimeters"),
    ("mpc/steady_tip", "gravity", "[0.0, 9.81]", "minus sign"),
]


def doubts(file, changes=()):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(file, changes)
    return [str(one.message) for one in caught]


@pytest.mark.parametrize(("name", "key", "value", "words"), SLIPS)
def test_implausible_magnitudes_are_doubted(name, key, value, words):
    before = doubts(ROOT / f"configs/{name}.yaml")
    try:
        found = doubts(ROOT / f"configs/{name}.yaml", [f"{key}={value}"])
    except InputError as error:  # a scene that cannot be for another reason too
        pytest.skip(str(error))
    (one,) = [text for text in found if text not in before]
    first = key.partition(".")[0]
    assert re.search(rf"{re.escape(key)}\S* =? ?", one) or first in one
    assert words in one


def test_a_doubt_names_file_and_line(tmp_path):
    file = tmp_path / "scene.yaml"
    text = (ROOT / "configs/simulate/hanging.yaml").read_text(encoding="utf-8")
    (line,) = [k for k, row in enumerate(text.splitlines(), 1) if row.startswith("gravity:")]
    text = re.sub(r"^gravity: .*$", "gravity: [0.0, 9.81]", text, flags=re.MULTILINE)
    file.write_text(
        text.replace("extends: ../", f"extends: {ROOT}/configs/").replace("finger: ../", f"finger: {ROOT}/configs/")
    )
    (one,) = doubts(file)
    assert one.startswith(f"{file}:{line}:10: gravity = [0.0, 9.81] m/s2 points up")


def test_values_in_python_name_the_line_of_the_user():
    with pytest.warns(UserWarning, match=r"Rod.length = 180 m is no length of a finger") as caught:
        Rod(length=180.0, linear_density=0.02, bending_stiffness=0.01)
    assert caught[0].filename == __file__


def test_doubts_may_be_refused_all_at_once():
    with pytest.raises(InputError, match=r"(?s)friction = 50.*object\.mass = 150"), doubts_refused():
        load(ROOT / "configs/simulate/close_on_mug.yaml", ["object.mass=150", "contact_law.friction=50"])


@pytest.mark.parametrize("verb", ["validate", "grasp"])
def test_strict_commands_refuse_a_scene_with_doubts(verb, tmp_path):
    line = [sys.executable, "-m", "continuum_grasp", verb, "configs/grasp/mug.yaml", "--strict"]
    where = [] if verb == "validate" else ["--out", str(tmp_path / "run")]
    done = subprocess.run(
        [*line, "--set", "contacts.friction=50", *where], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "contacts.friction = 50" in done.stderr


def test_shipped_scenes_raise_no_doubts_about_magnitudes():
    for file in sorted(ROOT.glob("configs/*/*.yaml")):
        assert [text for text in doubts(file) if " = " in text] == [], file


def test_values_of_a_search_raise_no_doubts():
    """A search tries masses that no user has stated; a user who changes the mass is warned."""
    scene = load(ROOT / "configs/hand/ball.yaml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        heavy = scene.replaced(object=scene.object.replaced(mass=90.0))
    assert heavy.object.mass == 90.0
    with pytest.warns(UserWarning, match="is it in grams"):
        scene.changed({"object.mass": 90.0})
