"""What a design may say, and what is said of what it may not."""

from __future__ import annotations

import json

import pytest

import continuum_grasp as cg
from continuum_grasp.addons.design import DesignResult
from continuum_grasp.base import InputError
from tests.commands import run

WHOLE = """\
schema_version: 1
scene: {scene}
variables:
  finger.tendons.offset: {{min: 3 mm, max: 6 mm, name: e}}
minimize: tension + 1e4 * e
solver: {{starts: 1}}
"""


@pytest.fixture
def file(tmp_path):
    """A design of one variable."""
    scene = cg.load("configs/design/mug_finger.yaml").file.parent.resolve() / "../grasp/mug_arcs.yaml"
    path = tmp_path / "design.yaml"
    path.write_text(WHOLE.format(scene=scene), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("offset: {min: 3 mm, max: 6 mm", "ofset: {min: 0.003, max: 0.006", 4, "unknown key; did you mean 'offset'"),
        ("max: 6 mm", "max: 2 mm", 4, "min = 0.003 is not below max = 0.002"),
        ("max: 6 mm", "max: 4 mm", 4, "the scene has 0.005, not within 0.003 and 0.004: give start"),
        ("max: 6 mm", "max: 6 kg", 4, "expected a number"),
        ("tension +", "tensoin +", 5, "unknown name 'tensoin' in 'tensoin + 1e4 * e'; did you mean 'tension'?"),
        ("* e", "* ", 5, "is not a valid formula"),
        ("+ 1e4 * e", "+ abs(e)", 5, "'abs(e)' is not allowed in"),
        ("+ 1e4 * e", "if e else 1", 5, "is not allowed in"),
        ("tension + 1e4 * e", "'2'", 5, "contains nothing that a design can change"),
        ("{starts", "{strats", 6, "unknown key; did you mean 'starts'?"),
        ("minimize", "limits: {payload: {}}\nminimize", 5, "give min, max, or both"),
        ("minimize", "tolerances: {finger.tendons.offset: {amount: 1 mm, share: 0.1}}\nminimize", 5, "exactly one of"),
        ("minimize", "tolerances: {object.shape: {share: 0.1}}\nminimize", 5, "no number there, but 'circle'"),
        ("minimize", "cases: {heavy: {object.mas: 1.0}}\nminimize", 5, "unknown key; did you mean 'mass'?"),
        ("minimize", "cases: {a/../b: {object.mass: 0.3}}\nminimize", 5, "'a/../b' cannot name a folder: use"),
        ("minimize", "follow: {object.mass: {key: object.diameter}}\nminimize", 5, "which is not varied"),
        ("name: e", "name: payload", 4, "'payload' is already defined in expressions"),
    ],
)
def test_errors_have_line_and_reason(file, old, new, line, message):
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        cg.load(file)
    assert message in str(caught.value)
    assert caught.value.line == line


def test_a_design_that_is_none():
    with pytest.raises(InputError, match="expected a design"):
        cg.optimize_design("configs/grasp/mug_arcs.yaml")


def test_the_command_writes_a_run_that_is_read_back(file, tmp_path):
    ran = run("design", file, "--out", tmp_path / "run", "--json")
    assert ran.exit_code == 0, ran.output
    said = json.loads(ran.stdout)
    arrays = DesignResult.read(tmp_path / "run").arrays
    assert said["set"]["finger.tendons.offset"] == pytest.approx(float(arrays["optimum"][0]))
    assert arrays["tried"].shape == (arrays["costs"].size, 1)
    assert {one.name for one in (tmp_path / "run").iterdir()} >= {"design.png", "result.yaml", "grasp_scene"}
