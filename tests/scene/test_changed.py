"""``changed`` of scenes: the same scene, or the same error, as the file with ``--set``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.mission import MissionController
from continuum_grasp.addons.sweeps import SweepPlan
from continuum_grasp.base import InputError

CONFIGS = Path(__file__).parents[2] / "configs"
FILES = sorted(CONFIGS.glob("*/*.yaml"))
CHANGES = {
    "simulate/hanging.yaml": {"finger.masses": [{"at": 0.3, "mass": 0.01}], "finger.masses[0].mass": 0.02},
    "simulate/tendon_step.yaml": {"time.duration": 0.5, "fidelity.elements": 3},
    "grasp/mug.yaml": {"object.mass": 0.4, "contacts.middle": "auto", "objective": {"least_tension": 2.0}},
    "grasp/wrap.yaml": {"object.mass": 0.2, "gravity": [0.0, 0.0, -3.7]},
    "mpc/tip_arc.yaml": {"controller.horizon.stages": 12, "estimator.delay": 0.0, "plant.damping": 1.2},
    "mission/mug.yaml": {"grasp.object.mass": 0.3, "grasp.finger.rod.length": 0.21, "phases.hold": 0.5},
    "plan/tip_to_point.yaml": {"goal.tip": [0.05, 0.17], "solver.starts": 2, "bounds.speed": 12.0},
    "sweep/finger_design.yaml": {"name": "other", "set": {"object.mass": 0.2}},
    "fingers/nitinol_60cm.yaml": {"rod.length": 0.7, "damping.material": 1e-4},
}
WRONG = {
    "simulate/hanging.yaml": {"finger.mases[0].mass": 0.1},
    "grasp/mug.yaml": {"object.mas": 0.4},
    "mission/mug.yaml": {"grasp.object.mass": -1.0},
    "plan/tip_to_point.yaml": {"goal.tip[2]": 1.0},
    "mpc/tip_arc.yaml": {"controller.horizon": "long"},
    "sweep/finger_design.yaml": {"vary": {"object.mass": {"count": 1}}},
    "fingers/nitinol_60cm.yaml": {"rod.diameter.value": 0.1},
}


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_a_scene_without_changes_is_the_same(file):
    scene = cg.load(file)
    same = scene.changed({})
    assert same == scene
    assert same.model_fields_set == scene.model_fields_set


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_scene_is_that_of_the_changed_file(name):
    assert cg.load(CONFIGS / name).changed(CHANGES[name]) == cg.load(CONFIGS / name, CHANGES[name])


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said_as_for_files(name):
    with pytest.raises(InputError) as of_file:
        cg.load(CONFIGS / name, WRONG[name])
    with pytest.raises(InputError) as of_scene:
        cg.load(CONFIGS / name).changed(WRONG[name])
    assert (of_scene.value.key, of_scene.value.message) == (of_file.value.key, of_file.value.message)
    assert of_scene.value.key.startswith(next(iter(WRONG[name])).partition("[")[0].partition(".")[0])


@pytest.mark.parametrize("changes", [5, None, "a=1", {5: 1}, {"a..b": 1}, {"": 1}, ["name"]])
def test_changes_are_checked_themselves(changes):
    with pytest.raises(InputError):
        cg.load(CONFIGS / "simulate/hanging.yaml").changed(changes)


def test_scenes_made_in_python_change_too():
    rod = cg.Rod(length=0.6, diameter=0.002, density=6450.0, youngs_modulus=60e9)
    scene = cg.Scene(finger=cg.Finger(rod=rod, masses=[{"at": 0.6, "mass": 0.01}]), gravity=np.array([0.0, -9.81]))
    tendons = cg.Tendons(offset=0.01, max_tension=20.0)
    new = scene.changed({"finger.masses[0].mass": 0.02, "finger.tendons": tendons, "gravity[1]": 0.0})
    masses = (cg.PointMass(at=0.6, mass=0.02),)
    assert new == cg.Scene(finger=cg.Finger(rod=rod, masses=masses, tendons=tendons), gravity=(0.0, 0.0))
    assert scene.finger.masses[0].mass == 0.01
    assert new.finger.changed({"masses": []}).masses == ()
    loaded = scene.replaced(loads=(cg.ForceLoad(at=0.1, force=(0.0, 0.01)), cg.MomentLoad(at=0.2, moment=0.01)))
    assert loaded.changed({"loads[1].moment": 0.02}).loads == (loaded.loads[0], cg.MomentLoad(at=0.2, moment=0.02))


def test_a_default_above_what_changes_keeps_its_rest():
    """The missions' controller looks 20 stages ahead by default, other controllers do not."""
    default = MissionController()
    changed = default.changed({"horizon.stage": 0.03, "elements[1]": 3})
    assert changed.horizon.stages == default.horizon.stages
    assert (changed.horizon.stage, changed.elements) == (0.03, (default.elements[0], 3))


def test_a_changed_sweep_finds_its_files():
    sweep = cg.load(CONFIGS / "sweep/finger_design.yaml")
    plan = SweepPlan.of(sweep.changed({"set": {"object.mass": 0.123}}))
    assert plan.variation.base["object"]["mass"] == 0.123
    assert plan.keys == SweepPlan.of(sweep).keys == SweepPlan.of(CONFIGS / "sweep/finger_design.yaml").keys


def test_values_are_frozen():
    scene = cg.load(CONFIGS / "simulate/hanging.yaml")
    with pytest.raises(InputError, match=r"Scene: name: values are frozen: changed\("):
        scene.name = "other"
    with pytest.raises(InputError, match="frozen"):
        del scene.finger.rod
