"""``continuum-grasp mpc``: files, tables, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from continuum_grasp.results import read_run
from tests.commands import ROOT, run

STEADY = str(ROOT / "configs/mpc/steady_tip.yaml")
SMALL = {
    "schema_version": 1,
    "name": "small",
    "finger": str(ROOT / "configs/fingers/hand_finger.yaml"),
    "gravity": [0.0, 0.0],
    "fidelity": {"family": "arc", "elements": 2},
    "controller": {
        "horizon": {"stages": 10, "stage": 0.01},
        "cost": {"tip": {"running": 2e4, "terminal": 2e3}, "effort": 1e-3, "input_rate": 5e-5},
        "input": {"rate_max": 600.0},
        "bounds": {"keep_out": {"wall": {"type": "half_plane", "point": [-0.1, 0.0], "normal_angle": 0.0}}},
    },
    "reference": {"tip": [-0.0441, 0.1726]},
    "estimator": {
        "measured": {"tip": 3e-4, "tension": 0.1},
        "disturbances": {"tip_moment": 0.01},
        "acceleration_std": 1.0,
    },
    "plant": {"fidelity": {"family": "clothoid", "elements": 3}, "stiffness": 1.1},
    "duration": 0.2,
}
PICTURES = {"path", "inputs", "tracking", "error", "bounds", "disturbances"}
"""Not ``times``: tests compile quickly, and the times of such a controller do not count."""


COSTLY_FIXTURES = ("done",)


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("mpc") / "small.yaml"
    path.write_text(yaml.safe_dump(SMALL))
    return path


@pytest.fixture(scope="module")
def done(config):
    folder = config.parent / "run"
    result = run("mpc", config, "--out", folder, "--json", "--animate", "gif")
    assert result.exit_code == 0, result.output
    return folder, json.loads(result.stdout)


@pytest.mark.deep
def test_files_are_those_that_are_listed(done):
    folder, found = done
    made = {path.stem for path in map(Path, found["files"]) if path.is_file()}
    assert made == {*PICTURES, "animation", "report", "log"}
    assert {"result.npz", "meta.json", "report.txt"} <= {path.name for path in folder.iterdir()}
    assert found["folder"] == str(folder)


@pytest.mark.deep
def test_numbers_are_those_of_the_arrays(done):
    folder, found = done
    stored, metrics = read_run(folder), found["metrics"]
    arrays = stored.arrays
    distance = np.linalg.norm(arrays["tip"] - SMALL["reference"]["tip"], axis=1)
    assert metrics["tracking"][0]["rms"] == pytest.approx(np.sqrt(np.mean(distance**2)))
    assert metrics["tracking"][0]["max"] == pytest.approx(distance.max())
    assert arrays["t"] == pytest.approx(0.01 * np.arange(21))
    names = [name.split(" ")[0] for name in stored.meta["names"]["bounds"]]
    wall = arrays["bounds"][names.index("wall")]
    assert wall == pytest.approx(0.006 - (arrays["tip"][:, 0] + 0.1))
    assert sum(metrics["statuses"].values()) == len(arrays["u"]) == 20
    assert stored.meta["metrics"] == metrics
    assert stored.meta["config"]["name"] == "small"


def test_a_table_is_printed(config, tmp_path):
    result = run("mpc", config, "--out", tmp_path, "--no-pictures", "--set", "duration=0.05", "--seed", "3")
    assert result.exit_code == 0, result.output
    for word in ("tracking error", "r.m.s.", "wall", "exceeded", "closed-loop cost", "solved"):
        assert word in result.output
    # Tests compile quickly: such a controller has no times.
    assert "controller quickly compiled, plant quickly compiled" in result.output
    assert "feedback" not in result.output
    assert read_run(tmp_path).meta["seed"] == 3
    assert not list(tmp_path.glob("*.png"))


def test_an_option_that_is_gone_says_what_to_write(config):
    result = run("mpc", config, "--compare")
    assert result.exit_code == 2
    assert "controller.sqp_iterations=20" in result.stderr


@pytest.mark.parametrize(("outcome", "code"), [("finished", 0), ("missed", 1), ("tripped", 1)])
def test_a_loop_that_does_not_finish_at_its_setpoint_has_failed(outcome, code, config, tmp_path, monkeypatch):
    from continuum_grasp.closed_loop import ControlRun

    monkeypatch.setattr(ControlRun, "outcome", outcome)
    result = run("mpc", config, "--out", tmp_path, "--no-pictures", "--set", "duration=0.05")
    assert result.exit_code == code


@pytest.mark.parametrize(
    ("goal", "code", "status"),
    [
        (["reference.tip=[0.1,-0.13]"], 1, "goal_missed"),
        (["reference.tip={times: [0, 0.2], values: [[0, 0.18], [0.1, -0.13]]}"], 0, "optimal"),
    ],
)
def test_a_plan_that_ends_far_from_a_setpoint_which_stood_is_no_optimum(goal, code, status, tmp_path):
    changes = ["objective=tracking", "duration=0.6", "intervals=12", "goal={}", "check={finer: null, tolerance: 1 %}"]
    changes += ["cost={tip: 2e4, effort: 1e-3, input_rate: 5e-4}", *goal]
    config = ROOT / "configs/plan/tip_to_point.yaml"
    sets = [word for change in changes for word in ("--set", change)]
    result = run("plan", config, *sets, "--out", tmp_path, "--no-pictures")
    assert result.exit_code == code
    assert read_run(tmp_path).meta["status"] == status
    assert ("mm off a setpoint that stood" in result.output) is (code == 1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("none.yaml",), "none.yaml"),
        ((STEADY, "--animate", "avi"), "expected gif or mp4"),
        ((STEADY, "--trials", "3"), "--trials: works only for missions"),
        ((STEADY, "--set", "plant.stiffness=-1"), "plant.stiffness"),
        ((str(ROOT / "configs/simulate/hanging.yaml"),), "expected a closed loop"),
    ],
)
def test_bad_input_exits_with_2(arguments, said, tmp_path):
    result = run("mpc", *arguments, "--out", tmp_path)
    assert result.exit_code == 2
    assert said in result.output


def test_an_interrupted_run_is_saved(config, tmp_path, monkeypatch):
    from continuum_grasp.closed_loop import Plant

    advance = Plant.advance

    def stopped(self, u):
        if self.t > 0.045:
            raise KeyboardInterrupt
        return advance(self, u)

    monkeypatch.setattr(Plant, "advance", stopped)
    result = run("mpc", config, "--out", tmp_path)
    assert result.exit_code == 130
    assert "interrupted after t = 0.05 s" in result.output
    stored = read_run(tmp_path)
    assert (stored.meta["status"], len(stored.arrays["u"])) == ("stopped", 5)
