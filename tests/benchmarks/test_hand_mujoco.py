"""from inside: results are made from arrays; stiffness and rounded edges of ``benchmarks.hand_mujoco``, and a ball."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.hand_mujoco import CONFIGS, HandPlant
from continuum_grasp.grasp import GraspStatus, optimize_grasp
from continuum_grasp.grasp.hand.result import HandResult
from continuum_grasp.scene import load
from tests import hand_cases as cases
from tests.hand_cases import HALF, LENGTH

pytest.importorskip("mujoco")


def plant_of(scene, arrays):
    return HandPlant(HandResult(scene, GraspStatus.FEASIBLE, "", arrays))


def test_a_force_to_the_side_shifts_the_tip_of_the_chain_as_that_of_a_cantilever():
    scene, arrays = cases.one_finger((0.0, 0.0, 0.2), (0.0, -1.0, 0.0))
    arrays["contact_positions"] = np.array([[0.0, LENGTH + HALF, 0.0]])
    arrays["contact_deflections"] = np.array([cases.sag(0.2)])
    scene = scene.changed({"object.mass": 0.1})
    assert plant_of(scene, arrays).aside == pytest.approx(0.0, abs=2e-3 * cases.sag(0.2))


def test_a_box_with_rounded_edges_is_touched_on_its_faces():
    deep = 1e-5
    extents = cases.EXTENTS + np.array([2.0 * deep, 0.0, 0.0])
    plant = plant_of(*cases.squeezed_box(press=0.3, mass=0.01, body={"extents": tuple(extents)}))
    found = sorted(contact.pos.tolist() for contact in plant.data.contact)
    half = 0.5 * cases.EXTENTS[0]
    assert np.array(found) == pytest.approx(np.array([[-half, 0.0, 0.0], [half, 0.0, 0.0]]), abs=2e-5)
    gaps = [contact.dist - contact.includemargin for contact in plant.data.contact]
    assert gaps == pytest.approx([-deep] * 2, abs=0.2 * deep)


@pytest.mark.deep
def test_a_ball_stays_held_by_the_planned_forces():
    held = HandPlant(optimize_grasp(load(CONFIGS / "ball.yaml"))).run(0.3)
    assert held.moved < 1e-3
    assert held.found == pytest.approx(held.planned, rel=0.05)
