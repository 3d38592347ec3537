"""Wrench spaces, the indices and the linear problems below them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from continuum_grasp.grasp import Quality
from continuum_grasp.results import plain
from continuum_grasp.scene import Circle
from tests import certificate_cases as cases

THIRDS = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)


DISC = Circle(shape="circle", diameter=0.08, mass=0.3, position=(0.0, 0.0))


def space_of(angles, friction):
    """The wrenches of contacts on the disc, seen from its center at these angles [rad]."""
    scene = cases.make_scene(cases.make_finger((0.5, 0.5)), DISC, {"friction": friction})
    normals = [(math.cos(angle), math.sin(angle)) for angle in angles]
    contacts = [(f"finger.middle_{k}", 0.04 * np.array(n), n, (1, 0, 0), cases.NONE, 0) for k, n in enumerate(normals)]
    return Quality(scene, {"object.pose": np.zeros(3), **cases.contact_arrays(contacts)})


# -- linear and conic problems -------------------------------------------------------------------------------------


# -- wrench space --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.05, 0.3, 0.5, 1.0, 1.6])
def test_two_antipodal_contacts_on_a_disc(friction):
    space = space_of((0.3, 0.3 + math.pi), friction)
    assert space.epsilon_l1 == pytest.approx(friction / math.sqrt(2 + friction**2), abs=1e-12)


@pytest.mark.parametrize("friction", [0.05, 0.5, 0.8, 1.0, 1.3])
def test_three_contacts_at_120_degrees(friction):
    """The hull is an antiprism: its lids at the moment mu, its sides at a distance that the cone's angle gives."""
    space = space_of(THIRDS, friction)
    side = 1.0 / math.sqrt(1.0 + 2.0 * math.tan(math.pi / 3 - math.atan(friction)) ** 2)
    assert space.epsilon_l1 == pytest.approx(min(friction, side), abs=1e-12)


# -- all indices in one place --------------------------------------------------------------------------------------


def bent_pinch():
    """Two bent fingers that hold a disc from both sides."""
    fingers = {"a": cases.make_finger((-0.15, -0.1), -0.4), "b": cases.make_finger((0.15, -0.1), 0.4)}
    scene = cases.make_scene(fingers, DISC, family="clothoid")
    values = {
        "a": {"q": (4.0, 3.0, 2.0), "tensions": (3.0, 0.0)},
        "b": {"q": (-4.0, -3.0, -2.0), "tensions": (0.0, 6.0)},
    }
    contacts = [
        ("a.tip", (-0.04, 0.0), cases.LEFT, (2.0, 0.5, 0.0), cases.LENGTH, 0),
        ("b.tip", (0.04, 0.0), cases.RIGHT, (3.0, -0.5, 0.0), cases.LENGTH, 0),
    ]
    return scene, cases.stored(scene, values, contacts)


def test_quality_gathers_the_indices():
    quality = Quality(*bent_pinch())
    assert quality.friction_margin == pytest.approx(1.0 - 0.5 / (0.5 * 2.0))
    assert quality.friction_margins["b.tip"] == pytest.approx(1.0 - 0.5 / (0.5 * 3.0))
    assert quality.tension_margin == pytest.approx(1.0 - 6.0 / 60.0)
    assert quality.normal_force_spread == pytest.approx(1.0 / 3.0)
    assert quality.torque_scale == pytest.approx(0.04)
    assert quality.epsilon_l1 == pytest.approx(0.5 / math.sqrt(2.25))
    names = [row[0] for row in quality.rows()]
    assert names[0] == "disturbance_margin"
    assert len(set(names)) == len(names) == 5
    assert all(getattr(quality, name) == value for name, value, _ in quality.rows())
    data = json.loads(json.dumps(plain(quality.data()), allow_nan=False))
    assert data["epsilon_l1"] == quality.epsilon_l1
    assert len(data["resistance"]["factors"]) == 6
    assert quality.resistance_polygon.shape == (36, 2)
