"""Results of grasps of rods, from inside: `optimize_grasp` does not lead to them yet.

Truth are differences of grasps of changed scenes, the certificate of rods, and what has been written.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.base import InputError, Interrupted, SolverError
from continuum_grasp.grasp import GraspStatus, HandResult
from continuum_grasp.grasp.page import page
from continuum_grasp.grasp.rods.optimize import optimize_grasp
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.sensitivity import sensitivities_of
from continuum_grasp.grasp.rods.verdict import VerdictDoubt, verdict_of
from continuum_grasp.nlp import Budget
from continuum_grasp.plotting import plot_grasp

MUG = "configs/grasp/mug.yaml"


@cache
def result_of(name):
    return optimize_grasp(cg.load(f"configs/{name}.yaml"))


# -- numbers -------------------------------------------------------------------------------------------------------


def test_a_result_has_the_forces_that_balance_the_object():
    """Force and moment about the center of mass, from positions, normals and forces as they are stored."""
    result = result_of("grasp/mug")
    body, total = result.scene.object, np.zeros(6)
    total[:3] = body.mass * np.array(result.scene.gravity)
    center = np.array([*body.position, 0.0])
    for contact in result.contacts:
        on_object = -np.array([*contact.force, -contact.lift])
        total[:3] += on_object
        total[3:] += np.cross(np.array([*contact.position, 0.0]) - center, on_object)
    assert np.abs(total).max() < 1e-6
    assert result.tension == pytest.approx(42.709, abs=0.01)
    assert min(contact.friction_margin for contact in result.contacts) == pytest.approx(0.2, abs=1e-6)


def test_backbones_touch_the_object_at_their_contacts():
    result = result_of("grasp/mug")
    s, x, y, _ = result.fingers["finger"].backbone.T
    half = result.scene.setups[0].finger.thickness_radius
    for contact in result.contacts[:2]:
        center = np.array([np.interp(contact.station, s, x), np.interp(contact.station, s, y)])
        assert np.linalg.norm(center - contact.position - half * contact.normal) < 1e-5


@pytest.mark.parametrize("name", ["mug", "pinch"])
def test_sensitivities_are_differences_of_tensions(name):
    scene = cg.load(f"configs/grasp/{name}.yaml").replaced(stability="ignore")
    search = RodSearch(scene, Budget())
    search.run(1)
    best, step = search.best, 1e-4
    known = {each.name: each.derivative for each in sensitivities_of(scene, best)}

    def tension(changes):
        return search.solved(best.start.changed(scene.changed(changes)), beside=best).tension

    def slope(change, value):
        each = [tension(change(value + sign * step)) for sign in (1.0, -1.0)]
        return (each[0] - each[1]) / (2.0 * step)

    def bases(shift):
        places = ((setup.where, setup.finger.base.position) for setup in scene.setups)
        return {f"{where}.base.position": (x, y - 1e-2 * shift) for where, (x, y) in places}

    assert known["mass of the object"] == pytest.approx(
        slope(lambda m: {"object.mass": m}, scene.object.mass), rel=1e-3
    )
    assert 1e-2 * known["object along y"] == pytest.approx(slope(bases, 0.0), rel=1e-3, abs=1e-5)
    supports = [f"supports.{name}.friction" for name in scene.supports or {}]
    unchanged = dict.fromkeys(supports, scene.contacts.friction)
    by_friction = slope(lambda mu: {**unchanged, "contacts.friction": mu}, scene.contacts.friction)
    assert known["friction between fingers and object"] == pytest.approx(by_friction, rel=1e-3)


# -- verdicts ------------------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_a_scene_whose_limits_are_in_the_way_says_by_how_much():
    scene = cg.load(MUG).changed({"finger.tendons.max_tension": 40.0})
    with pytest.raises(SolverError) as raised:
        optimize_grasp(scene)
    assert raised.value.advice
    result = raised.value.result
    assert result.status is GraspStatus.NOT_SOLVED
    assert result.answer == "first_repair"
    tension = next(reason for reason in result.reasons if reason.name == "tension")
    # The least tension of the bending tendon is 41.71 N.
    assert 41.70 < tension.needed < 43.0
    assert tension.text in result.table()
    assert optimize_grasp(scene.changed({"finger.tendons.max_tension": tension.needed})).solved


def test_a_load_that_no_forces_balance_is_infeasible():
    scene = cg.load(MUG).changed({"contacts.friction": 0.0, "supports.palm.friction": 0.0})
    with pytest.raises(SolverError, match=VerdictDoubt.NO_BALANCE.value) as raised:
        optimize_grasp(scene)
    assert raised.value.result.status is GraspStatus.INFEASIBLE
    assert not raised.value.result.solved


def test_iterations_that_are_used_up_leave_a_doubt():
    scene = cg.load(MUG)
    full = RodSearch(scene, Budget(left=10_000))
    full.run(1)
    search = RodSearch(scene, Budget(left=10_000 - full.budget.left + 2))
    search.run()
    verdict = verdict_of(search)
    assert verdict.status is GraspStatus.FEASIBLE
    assert VerdictDoubt.CUT in verdict.doubts


def test_a_clock_that_ends_before_a_grasp_is_an_emergency():
    scene = cg.load(MUG, ["solver.time_limit=1e-3"])
    result = optimize_grasp(scene, raise_on_failure=False)
    assert result.status is GraspStatus.STOPPED
    assert "time_limit" in result.advice


def test_ctrl_c_after_a_grasp_gives_that_grasp():
    def press(text):
        raise KeyboardInterrupt

    result = optimize_grasp(cg.load(MUG), progress=press)
    assert result.status is GraspStatus.FEASIBLE
    assert result.statistics["interrupted"]
    assert VerdictDoubt.INTERRUPTED.value in result.message
    assert any("interrupted" in warning for warning in result.warnings)


def test_ctrl_c_before_a_grasp_is_an_error():
    def press(text):
        raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="before a grasp was found"):
        optimize_grasp(cg.load(MUG).changed({"finger.tendons.max_tension": 40.0}), progress=press)


def test_a_weight_in_every_direction_is_refused():
    with pytest.raises(InputError, match="gravity"):
        optimize_grasp(cg.load("configs/hand/turned.yaml"))


# -- files, texts and pictures -------------------------------------------------------------------------------------


def test_elements_that_do_not_stand_for_the_rod_are_named(tmp_path):
    result = optimize_grasp(cg.load(MUG, ["fidelity.elements=2"]))
    assert any("2 elements of finger do not stand" in warning for warning in result.warnings)
    assert result.read(result.save(tmp_path / "run")).meta["element_errors"]["finger"]["elements"] == 2


@pytest.mark.deep
def test_a_hand_is_read_and_certified_as_it_was_saved(tmp_path):
    result = result_of("hand/can")
    again = HandResult.of_run(result.save(tmp_path / "run"))
    assert again.certificate.passed
    assert again.tension == pytest.approx(result.tension, rel=1e-12)
    own = {check.name for check in result.certificate.checks}
    assert own <= {check.name for check in again.certificate.checks}
    assert f"Certificate: {again.certificate.headline()}" in again.table()
    assert "finger_1.tip" in again.show().text


def test_a_page_and_a_picture_show_the_certificate_and_the_elements(tmp_path):
    result = result_of("grasp/mug")
    text = page(result)
    assert "moment left at the tip" in text
    assert "Elements that stand for the rods" in text
    assert "UNSTABLE" not in plot_grasp(result).get_title(loc="left")
    run = result.read(result.save(tmp_path / "run"))
    assert np.array_equal(run.arrays["finger.base_moment"], result.arrays["finger.base_moment"])
    assert run.meta["certificate"]["passed"]


# -- what goes on from a grasp -------------------------------------------------------------------------------------


@pytest.mark.deep
def test_a_mission_is_assigned_from_a_grasp():
    mission = cg.load("configs/mission/mug.yaml")
    grasp = optimize_grasp(mission.grasp.replaced(objective="least_tension"))
    (task,) = assign(mission, grasp)
    assert task.forces["finger.1"] == pytest.approx(grasp.contact("finger.middle").normal_force)
    assert np.abs(task.tensions - grasp.tensions["finger"]).max() == 0.0
    # Angles of sections at ends of elements are those of the rod.
    angles = np.unwrap(grasp.fingers["finger"].backbone[:, 3])
    assert task.posture.sum() == pytest.approx(angles[-1] - angles[0], abs=1e-9)
