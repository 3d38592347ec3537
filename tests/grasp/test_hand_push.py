"""from inside: certificates of hands made by hand. Hands that bear pushes: sampled directions and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.grasp import GraspStatus, optimize_grasp
from continuum_grasp.grasp.hand.certificate import certify_hand
from tests import hand_cases as cases
from tests.commands import ROOT

HAND = ROOT / "configs/hand"


def ball(**changes):
    return cg.load(HAND / "ball.yaml").changed(changes)


def sphere(count):
    """Directions (count, 3) spread evenly."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, k * np.pi * (1.0 + 5.0**0.5)
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=1)


@pytest.mark.deep
@pytest.mark.parametrize("turn", [0.0, 0.9])
def test_a_ball_without_weight_is_pressed_from_all_sides(turn):
    """The push is the least over directions of the promise along each, which is found as roots."""
    place = [0.002 * math.cos(turn) - 0.003 * math.sin(turn), 0.002 * math.sin(turn) + 0.003 * math.cos(turn), -0.09]
    found = optimize_grasp(ball(gravity=[0.0, 0.0, 0.0], **{"hand.ring.start": turn, "object.position": place}))
    push = found.certificate.push
    assert found.tension == pytest.approx(6.968, rel=1e-3)
    assert push == pytest.approx(0.01947, rel=1e-2)
    assert found.scene.contacts.push <= push * 1.0001
    assert "nothing loads the object" in found.message
    sampled = min(found.certificate.promised([*d, 0.0, 0.0, 0.0]) for d in sphere(2000))
    assert push <= sampled * (1.0 + 1e-9)
    assert push == pytest.approx(sampled, rel=5e-3)
    total = -sum(contact.force for contact in found.contacts)
    assert total == pytest.approx(np.zeros(3), abs=1e-8)
    assert min(contact.normal_force for contact in found.contacts) > push


@pytest.mark.deep
def test_a_push_beside_the_weight_is_borne_or_the_greatest_is_named():
    found = optimize_grasp(ball(**{"contacts.push": 0.05}))
    assert found.certificate.push >= 0.05 * 0.98
    too_much = optimize_grasp(ball(**{"contacts.push": 5.0}), raise_on_failure=False)
    assert too_much.status is GraspStatus.NOT_SOLVED
    assert "less than contacts.push, " in too_much.message


def test_a_push_is_refused_where_the_weight_takes_every_direction():
    with pytest.raises(InputError, match=r"contacts\.push"):
        cg.load(HAND / "turned.yaml").changed({"contacts.push": 0.1})


@pytest.mark.parametrize(("press", "friction"), [(1.0, 0.5), (3.0, 0.3)])
def test_promises_end_where_a_contact_parts(press, friction):
    """Two straight fingers press along their axes: half of a push each, 2 N along these, 2 mu N across."""
    scene, arrays = cases.squeezed_box(press, mass=0.0, friction=friction)
    promise = certify_hand(scene, arrays).promise
    assert promise["force x"] == pytest.approx(2.0 * press, rel=1e-6)
    assert promise["force z"] == pytest.approx(2.0 * friction * press, rel=1e-6)
