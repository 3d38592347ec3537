"""Hands that bear pushes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.grasp import GraspStatus, optimize_grasp
from tests.commands import ROOT

HAND = ROOT / "configs/hand"


def ball(**changes):
    return cg.load(HAND / "ball.yaml").changed(changes)


@pytest.mark.deep
@pytest.mark.parametrize("turn", [0.0, 0.9])
def test_a_ball_without_weight_is_pressed_from_all_sides(turn):
    place = [0.002 * math.cos(turn) - 0.003 * math.sin(turn), 0.002 * math.sin(turn) + 0.003 * math.cos(turn), -0.09]
    found = optimize_grasp(ball(gravity=[0.0, 0.0, 0.0], **{"hand.ring.start": turn, "object.position": place}))
    push = found.certificate.push
    assert found.tension == pytest.approx(6.968, rel=1e-3)
    assert push == pytest.approx(0.01947, rel=1e-2)
    assert found.scene.contacts.push <= push * 1.0001
    assert "nothing loads the object" in found.message
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
