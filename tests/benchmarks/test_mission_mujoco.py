"""The plant of ``benchmarks.mission_mujoco``: pads where the mission has contacts, and, with MuJoCo, a mug at rest."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest

from benchmarks.mission_mujoco import scene_of_plant, with_pads
from continuum_grasp.addons.chains import export_mjcf
from continuum_grasp.addons.mission import PlantVariation, assign_mission
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from tests.mission_cases import MUG


@pytest.fixture(scope="module")
def plant():
    """Assignment, scene of a heavier and shifted mug, and the text of its chain."""
    mission = load(MUG)
    (of,) = assign_mission(mission, grasp=optimize_grasp(mission.grasp)).assignments
    scene = scene_of_plant(of, PlantVariation(mass=1.1, friction=0.9, shift=(1e-3, 0.0)))
    return of, scene, with_pads(export_mjcf(scene, hinges=12).text, scene)


@pytest.mark.deep
def test_pads_are_where_the_mission_has_contacts(plant):
    of, scene, text = plant
    root = ET.fromstring(text)
    parents = {child: parent for parent in root.iter() for child in parent}
    for name, at in (("middle", of.control.contacts[0]), ("tip", 0.18)):
        body, along = root.find(f".//body[@name='pad_{name}']"), 0.0
        joint, geom = body.find("joint"), body.find("geom")
        assert (float(joint.get("stiffness")), geom.get("friction").split()[0]) == (2000.0, "0.45")
        while body.get("name") != "base":
            along, body = along + float(body.get("pos").split()[1]), parents[body]
        assert along == pytest.approx(at)
    assert scene.object.mass == pytest.approx(0.33)
    geoms = root.find("worldbody").iter("geom")
    touching = [geom for geom in geoms if (geom.get("contype"), geom.get("conaffinity")) != ("0", "0")]
    assert len(touching) == 4  # two pads of the finger, the palm's, the mug
    joints = [joint.get("name") for joint in root.find(".//body[@name='object']").findall("joint")]
    assert joints == ["object_x", "object_y", "object_angle", "object_z"]


@pytest.mark.deep
def test_a_block_lies_with_its_corners_where_its_outline_has_them():
    """Its flat faces and rounds, seen from four sides, against the support function of the rounded box."""
    mission = load(MUG.with_name("turn_block.yaml"))
    (of,) = assign_mission(mission, grasp=optimize_grasp(mission.grasp)).assignments
    scene = scene_of_plant(of, PlantVariation(friction=1.1))
    assert scene.table.friction == pytest.approx(1.1 * mission.table_friction)
    root = ET.fromstring(with_pads(export_mjcf(scene, hinges=12).text, scene))
    assert [body.get("name") for body in root.iter("body") if "pad" in body.get("name")] == ["pad_tip", "pad_palm"]
    geoms = root.find(".//body[@name='object']").findall("geom")
    body, angle = scene.object, scene.object.angle
    for direction in np.linspace(0.0, 2.0 * np.pi, 9):
        n, reach = np.array([np.cos(direction), np.sin(direction)]), []
        for geom in geoms:
            at, size = (np.array(geom.get(key).split(), dtype=float) for key in ("pos", "size"))
            c, s = np.cos(angle), np.sin(angle)
            spread = size[0] if geom.get("type") == "cylinder" else np.abs(n @ [[c, -s], [s, c]]) @ size[:2]
            reach.append(at[:2] @ n + spread)
        assert max(reach) == pytest.approx(max(part.support(direction - angle) for part in body.parts), abs=1e-9)
