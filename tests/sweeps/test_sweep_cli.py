"""``continuum-grasp sweep`` with the true optimizer: what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from continuum_grasp import optimize_grasp, sweep_table
from continuum_grasp.results import read_run
from continuum_grasp.scene import load
from tests.commands import run
from tests.sweep_cases import MUG

TEXT = f"""schema_version: 1
scene: {MUG}
set: {{solver.effort: quick}}
vary:
  object.mass: {{values: [0.2, 0.3]}}
  finger.base.position: {{values: [[0.0, -0.055], [0.04, 0.0]]}}
record: [quality.epsilon_l1, certificate.push]
maps: [{{x: object.mass, y: finger.base.position, color: tension_max}}]
pareto: [{{x: tension_max, y: object.mass, y_best: greatest}}]
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A small sweep: its configuration, folder, and what was printed as JSON."""
    folder = tmp_path_factory.mktemp("sweep")
    config = folder / "small.yaml"
    config.write_text(TEXT, encoding="utf-8")
    found = run("sweep", config, "--out", folder / "out", "--workers", 1, "--json")
    assert found.exit_code == 0, found.output
    return config, folder / "out", json.loads(found.stdout)


@pytest.mark.deep
def test_rows_are_what_the_optimizer_finds(swept):
    _, folder, _ = swept
    table = sweep_table(folder)
    assert list(table["status"]) == ["optimal", "invalid"] * 2
    for index, mass in ((0, 0.2), (2, 0.3)):
        result = optimize_grasp(load(MUG, {"object.mass": mass, "solver.effort": "quick"}))
        np.testing.assert_allclose(table["tension_max"][index], result.fingers["finger"].tensions.max(), rtol=1e-9)
        assert table["normal_force_max"][index] == pytest.approx(max(c.normal_force for c in result.contacts))
        assert table["quality.epsilon_l1"][index] == pytest.approx(result.quality.epsilon_l1, rel=1e-6)
        push = result.certificate.push
        assert table["certificate.push"][index] == pytest.approx(push, rel=1e-6)
        stored = read_run(table.run_folder(index))
        np.testing.assert_allclose(stored.arrays["contact_forces"], result.arrays["contact_forces"], rtol=1e-9)
        assert stored.meta["status"] == "optimal"
        assert stored.meta["config"]["object"]["mass"] == mass


def test_the_same_as_json(swept):
    _, folder, said = swept
    assert said["scenes"] == said["rows"] == 4
    assert said["status"] == {"optimal": 2, "invalid": 2}
    assert said["failures"] == {"invalid": 2}
    assert [Path(file).name for file in said["files"]] == [
        "map_1_tension_max.png",
        "pareto_1_tension_max_object_mass.png",
    ]
    assert all(Path(file).exists() for file in [*said["files"], said["table"], folder / "table.csv"])
    assert said["statistics"]["new"] == 4


def test_again_there_is_nothing_left_to_do(swept):
    config, folder, _ = swept
    found = run("sweep", config, "--out", folder, "--no-pictures")
    assert found.exit_code == 0
    assert "4 of 4" in found.stdout
    assert "2 optimal, 2 invalid" in found.stdout
    assert run("sweep", config, "--out", folder, "--quiet", "--no-pictures").output == ""


def test_other_pictures_of_the_same_table(swept, tmp_path):
    _, folder, _ = swept
    other = tmp_path / "other.yaml"
    other.write_text(TEXT.replace("color: tension_max", "color: friction_margin"), encoding="utf-8")
    found = run("sweep", other, "--out", folder, "--plot-only")
    assert found.exit_code == 0
    assert (folder / "map_1_friction_margin.png").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--keep", "some"), "'--keep': expected all, failed or none"),
        (("--quiet", "--json"), "--quiet cannot be combined"),
        (("--set", "vary={object.mas: {values: [1]}}"), "unknown key; did you mean 'mass'?"),
        (("--set", "set={solver.effort: thorough}"), "another plan: scene.solver.effort: quick there, thorough here"),
        (("--scheduler", "here"), "no Dask scheduler answers"),
        (("--workers", "0"), "invalid value"),
    ],
)
def test_bad_input(arguments, words, swept):
    config, folder, _ = swept
    if arguments[0] == "--scheduler":
        pytest.importorskip("distributed")
        folder = folder / "another"
    found = run("sweep", config, "--out", folder, *arguments)
    assert found.exit_code == 2
    assert words in found.stderr


def test_a_sweep_without_any_grasp_warns(tmp_path):
    config = tmp_path / "none.yaml"
    config.write_text(
        f"schema_version: 1\nscene: {MUG}\nvary: {{finger.base.position: {{values: [[0.04, 0.0]]}}}}\n",
        encoding="utf-8",
    )
    found = run("sweep", config, "--out", tmp_path / "out", "--workers", 1)
    assert found.exit_code == 0
    assert "warning: no scene has a grasp; first row: " in found.stderr
    assert "inside the object" in found.stderr
