"""Objects that nothing loads are held against pushes: closed forms, images, sampled directions, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from test_grasp_response import axial_pinch

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.grasp import GraspStatus, certify, optimize_grasp
from tests.commands import ROOT

PINCH = ROOT / "configs/grasp/pinch.yaml"
WEIGHTLESS = {"gravity": [0.0, 0.0, 0.0]}


def pinch(**changes):
    return cg.load(PINCH).changed({**WEIGHTLESS, **changes})


@pytest.fixture(scope="module")
def held():
    return optimize_grasp(pinch())


@pytest.mark.parametrize("friction", [0.2, 0.5, 1.5])
def test_straight_fingers_bear_a_push_in_closed_form(friction):
    """Each takes half of a push F: mu (N - F cos / 2) >= F sin / 2 for all directions, F = 2 mu N / sqrt(1 + mu^2)."""
    press = 0.08
    scene, arrays = axial_pinch(press, friction)
    expected = 2.0 * friction * press / math.hypot(1.0, friction)
    assert certify(scene, arrays).push == pytest.approx(expected, rel=1e-6)
    asked = [scene.changed({"contacts.push": share * expected}) for share in (0.999, 1.1)]
    assert [certify(each, arrays)["push in every direction"].passed for each in asked] == [True, False]


def test_a_greatest_normal_force_bounds_the_push():
    """With much friction, 2 (N_max - N) where that is less than what parts a contact."""
    scene, arrays = axial_pinch(0.08, 50.0)
    limited = scene.changed({"contacts.normal_force_max": 0.1})
    assert certify(limited, arrays).push == pytest.approx(2.0 * (0.1 - 0.08), rel=1e-6)


def test_a_weight_out_of_the_plane_leaves_less_for_pushes():
    press, friction, lift = 0.08, 0.5, 0.03
    scene, arrays = axial_pinch(press, friction, lift, (0.0, 0.0, -9.81))

    def most(angle):
        # Half of the push, along which (mu N)^2 = f^2 + lift^2 first.
        c, s = math.cos(angle), math.sin(angle)
        rows = [s * s - (friction * c) ** 2, 2.0 * friction**2 * press * c, lift**2 - (friction * press) ** 2]
        roots = np.roots(rows) if abs(rows[0]) > 1e-12 else np.array([-rows[2] / rows[1]])
        return 2.0 * min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0.0)

    angles = np.linspace(1e-3, math.pi / 2 - 1e-3, 400)
    first = angles[int(np.argmin([most(angle) for angle in angles]))]
    worst = minimize_scalar(most, bounds=(first - 0.02, first + 0.02), method="bounded", options={"xatol": 1e-9}).fun
    assert certify(scene, arrays).push == pytest.approx(worst, rel=1e-5)


@pytest.mark.deep
def test_a_box_without_weight_is_pressed_and_the_push_is_named(held):
    assert held.solved
    assert held.scene.contacts.push == pytest.approx(held.certificate.push, rel=0.02)
    assert "nothing loads the object" in held.message
    assert "any push up to" in held.message
    for contact in held.contacts:  # half of the push along the line, at least
        assert contact.normal_force > 0.5 * held.certificate.push
    assert sum(c.normal_force * c.normal for c in held.contacts) == pytest.approx([0.0, 0.0], abs=1e-6)


@pytest.mark.deep
def test_the_default_is_a_tenth_of_the_greatest_push(held):
    greatest = optimize_grasp(pinch(objective="greatest_push"))
    assert held.scene.contacts.push == pytest.approx(0.1 * greatest.certificate.push, rel=1e-3)
    over = optimize_grasp(pinch(**{"contacts.push": 1.1 * greatest.certificate.push}), raise_on_failure=False)
    assert over.status is GraspStatus.NOT_SOLVED
    (reason,) = over.reasons
    assert reason.key == "contacts.push"
    assert optimize_grasp(pinch(**{"contacts.push": reason.needed})).solved


@pytest.mark.deep
def test_a_turned_scene_bears_the_same_push(held):
    """The whole scene turned about the origin by 0.7 rad."""
    angle = 0.7
    c, s = math.cos(angle), math.sin(angle)
    changes = {"object.angle": angle}
    for name, finger in held.scene.named_fingers.items():
        x, y = finger.base.position
        changes[f"fingers.{name}.base"] = {
            "position": [c * x - s * y, s * x + c * y],
            "angle": finger.base.angle + angle,
        }
    turned = optimize_grasp(pinch(**changes))
    assert turned.tension == pytest.approx(held.tension, rel=1e-3)
    assert turned.certificate.push == pytest.approx(held.certificate.push, rel=1e-3)


@pytest.mark.deep
def test_one_tip_alone_bears_no_push_and_is_no_grasp():
    fingers = {"left": cg.load(PINCH).fingers["left"]}
    found = optimize_grasp(cg.load(PINCH).changed(WEIGHTLESS).replaced(fingers=fingers), raise_on_failure=False)
    assert found.status is GraspStatus.NOT_SOLVED
    assert "greatest push that any found grasp bears is negligible" in found.message


def test_what_loads_an_object():
    assert pinch().unloaded
    assert cg.load(PINCH).changed({"object.mass": 1e-6}).unloaded
    assert not cg.load(PINCH).changed({"object.mass": 0.01}).unloaded
    assert not pinch(**{"contacts.push": 0.0}).unloaded
    assert not pinch(objective="greatest_disturbance").unloaded
    assert not pinch(robust={"position": 1e-3}).unloaded
    with pytest.raises(InputError, match=r"contacts\.push"):
        pinch(robust={"position": 1e-3}, **{"contacts.push": 0.1})
