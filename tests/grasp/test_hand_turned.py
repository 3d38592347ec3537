"""from inside: the S-lemma is compared with sampled directions, and responses with differences of equilibria."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.grasp.hand.weights import worst_friction
from tests.commands import ROOT

TURNED = ROOT / "configs/hand/turned.yaml"


def sphere(count):
    """Directions (count, 3) spread evenly."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, k * np.pi * (1.0 + 5.0**0.5)
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=1)


def needed(force, slope, normal, directions):
    """Friction with which forces under weights along directions are within the cone."""
    forces = force + directions @ slope.T
    press = forces @ normal
    return np.linalg.norm(forces - press[:, None] * normal, axis=1) / press


@pytest.mark.parametrize("seed", range(6))
def test_friction_needed_is_that_of_the_worst_of_many_directions(seed):
    draw = np.random.default_rng(seed)
    normal = draw.normal(size=3)
    normal /= np.linalg.norm(normal)
    force, slope = 2.0 * normal + 0.3 * draw.normal(size=3), 0.25 * draw.normal(size=(3, 3))
    friction, direction = worst_friction(force, slope, normal)
    sampled = needed(force, slope, normal, sphere(20_000)).max()
    assert friction >= sampled * (1.0 - 1e-9)
    assert friction == pytest.approx(sampled, rel=2e-3)
    assert needed(force, slope, normal, direction[None])[0] == pytest.approx(friction, rel=1e-5)


def test_friction_in_closed_form_and_of_contacts_that_open():
    normal = np.array([0.0, 0.0, 1.0])
    # (d_x, d_y) / (4 + d_z): greatest where the line from (0, -4) touches the circle.
    friction, direction = worst_friction(4.0 * normal, np.eye(3), normal)
    assert friction == pytest.approx(1.0 / np.sqrt(15.0), rel=1e-9)
    assert direction[2] == pytest.approx(-0.25, abs=1e-6)
    friction, direction = worst_friction(0.9 * normal, np.eye(3), normal)
    assert friction == np.inf
    assert direction == pytest.approx(-normal)
    assert worst_friction(2.0 * normal, np.zeros((3, 3)), normal)[0] == pytest.approx(0.0, abs=1e-6)


def test_a_table_and_wrong_keys_are_refused():
    with pytest.raises(InputError, match=r"gravity\.any: a table does not turn"):
        cg.load(TURNED, ["table={point: [0, 0, -0.2]}"])
    for value in ("{any: 0}", "{all: 9.81}", "{any: 9.81, x: 1}"):
        with pytest.raises(InputError, match="gravity"):
            cg.load(TURNED, [f"gravity={value}"])


@pytest.fixture(scope="module")
def turned():
    return optimize_grasp(cg.load(TURNED))


@pytest.mark.deep
def test_a_hand_that_turns_holds_every_direction(turned):
    assert turned.solved
    certificate = turned.certificate
    assert certificate.acceptable
    assert "in every direction" in turned.message
    response, hand = certificate.response, certificate.hand
    for k, contact in enumerate(hand.pressing):
        slope = 9.81 * response.forces_by_gravity[k]
        share = needed(contact.load, slope, contact.normal, sphere(4000)).max() / contact.held_friction
        assert share < 1.0
    # Forces of all contacts bear the weight of the object, and none without it.
    assert response.forces_by_gravity.sum(axis=0) == pytest.approx(0.05 * np.eye(3), abs=1e-12)
    assert np.sum([contact.load for contact in hand.pressing], axis=0) == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.deep
def test_too_heavy_to_turn_says_where_and_how_much_friction():
    found = optimize_grasp(cg.load(TURNED, ["contacts.friction=0.6"]), raise_on_failure=False)
    assert found.status.name == "INFEASIBLE"
    assert "in every direction" in found.message
    (reason,) = found.reasons
    assert reason.name == "friction"
    assert optimize_grasp(cg.load(TURNED, [f"contacts.friction={reason.needed * 1.1}"])).solved
