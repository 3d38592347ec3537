"""Every key that takes the path of a file takes it from the file, from inside another one, and from ``--set``."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from continuum_grasp.addons.sweeps import SweepPlan
from continuum_grasp.base import InputError
from continuum_grasp.scene import load

CONFIGS = Path(__file__).parents[2] / "configs"
EASED = """schema_version: 1
extends: ../../fingers/hand_finger.yaml
strain_limit: 0.05
base: {angle: -1.5707963267948966, position: [0.0, -0.055]}
"""
PATH = "near/soft.yaml"
"""Relative to the scenes' folders; there is none of the name beside the grasp or the sweep's scene."""


@pytest.fixture
def configs(tmp_path, monkeypatch):
    """The shipped configurations, with another finger beside those of each kind; the working folder is elsewhere."""
    shutil.copytree(CONFIGS, tmp_path / "configs")
    for kind in ("simulate", "mpc", "mission", "plan", "sweep", "identify"):
        (tmp_path / "configs" / kind / "near").mkdir()
        (tmp_path / "configs" / kind / PATH).write_text(EASED)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "configs"


def fingers(scene):
    """Fingers by the key that named them."""
    found = {}
    for where, part in (("", scene), ("grasp.", getattr(scene, "grasp", None))):
        if getattr(part, "finger", None) is not None:
            found[f"{where}finger"] = part.finger
        found |= {f"{where}fingers.{name}": one for name, one in (getattr(part, "fingers", None) or {}).items()}
    return found


CASES = [
    ("simulate/tendon_step.yaml", "finger"),
    ("mpc/wrap_post.yaml", "finger"),
    ("plan/close_on_mug.yaml", "finger"),
    ("plan/close_on_mug.yaml", "grasp.finger"),
    ("mission/mug.yaml", "grasp.finger"),
    ("identify/tendon_steps.yaml", "finger"),
]


@pytest.mark.parametrize(("file", "key"), CASES)
@pytest.mark.parametrize("form", ["{}", "{{extends: {}}}"])
def test_a_finger_of_any_scene_is_set_to_a_file(configs, file, key, form):
    time_constant = fingers(load(configs / file))[key].tendons.time_constant
    settings = [f"{key}={form.format(PATH)}", f"{key}.tendons.time_constant={time_constant or 'null'}"]
    scene = load(configs / file, settings)
    assert fingers(scene)[key].strain_limit == 0.05
    assert load(configs / file, {key: {"extends": PATH}, f"{key}.tendons.time_constant": time_constant}) == scene
    with pytest.raises(InputError, match="no such finger file") as caught:
        load(configs / file, [f"{key}=../grasp/nowhere.yaml"])
    assert caught.value.key == key


def test_one_of_several_fingers_is_set_to_a_file(configs):
    (configs / "grasp" / "near").mkdir()
    (configs / "grasp" / PATH).write_text(EASED)
    grasp = load(configs / "grasp" / "pinch.yaml")
    name, finger = next(iter(grasp.named_fingers.items()))
    settings = {f"fingers.{name}": PATH, f"fingers.{name}.base": finger.base.model_dump()}
    changed = load(configs / "grasp" / "pinch.yaml", settings)
    assert changed.fingers[name].strain_limit == 0.05


def test_a_grasp_that_stands_in_a_mission_names_its_finger_beside_the_mission(configs):
    file = configs / "mission" / "mug.yaml"
    mission, grasp = file.read_text(), (configs / "grasp" / "mug_robust.yaml").read_text()
    inner = "\n".join(f"  {line}" for line in grasp.splitlines()).replace("../fingers/hand_finger.yaml", PATH)
    assert "grasp: ../grasp/mug_robust.yaml" in mission
    file.write_text(mission.replace("grasp: ../grasp/mug_robust.yaml", f"grasp:\n{inner}"))
    assert load(file).grasp.finger.strain_limit == 0.05


def test_extends_changes_the_file_and_keeps_what_stands_beside_it(configs):
    other = (configs / "fingers" / "nitinol_60cm.yaml").read_text().replace("diameter: 0.002", "diameter: 0.003")
    (configs / "mpc" / "near" / "thick.yaml").write_text(other)
    finger = load(configs / "mpc" / "nitinol_moment.yaml", ["finger.extends=near/thick.yaml"]).finger
    assert (finger.rod.diameter, finger.masses[0].mass) == (0.003, 0.02)


def test_extends_cannot_change_a_file_that_is_read_already(configs):
    """Its keys would all stay, and the new file count for nothing."""
    with pytest.raises(InputError, match=r"grasp\.finger extends no file: expected grasp\.finger=\{extends: FILE"):
        load(configs / "mission" / "mug.yaml", [f"grasp.finger.extends={PATH}"])


@pytest.mark.parametrize("how", ["file", "set", "python"])
def test_a_sweep_names_fingers_beside_itself(configs, how):
    file, settings = configs / "sweep" / "mug_uncertain.yaml", ()
    if how == "file":
        file.write_text(file.read_text().replace("set:\n", f"set:\n  finger: {PATH}\n"))
    else:
        settings = [f"set.finger={PATH}"] if how == "set" else {"set.finger": {"extends": PATH}}
    assert SweepPlan.of(file, settings).variation.base["finger"]["strain_limit"] == 0.05
