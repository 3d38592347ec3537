"""Stages of rods in space, by closed forms and SciPy; from inside: no door offers the equations in space."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from continuum_grasp.grasp.rods.spatial import SPACE, columns
from continuum_grasp.model import Section
from tests.rod_stages import LENGTH, PAIR, Stages, finger, stage_of


def in_space(of, state, force, pulls, gravity, sides, steps=40):
    """State (10 and those of the tendons) at the tip of a rod in space, from the base in so many stages."""
    section = Section.of(of, rounding=0.0)
    stage = stage_of(section.form, SPACE)
    for a, b in pairwise(np.linspace(0.0, 1.0, steps + 1)):
        given = state, force, pulls, a, b, gravity, sides, section.pulled, section.numbers(0)
        state = np.array(stage(*given)).ravel()
    return state


def test_a_rod_in_space_that_stays_in_its_plane_is_the_rod_of_the_plane():
    of = finger(
        tendons={**PAIR, "friction": 0.2}, softening={"curvature": 6.0, "stiffness_ratio": 0.4}, rest_curvature=3.0
    )
    rod = Stages(of, 40, gravity=(3.0, -9.81))
    states = rod.at_rest((25.0, 2.0), (-0.3, 0.2))
    total = np.array([-0.3, 0.2]) / rod.section.force + np.array(rod.gravity) * rod.section.mass
    pulls = [tension / pull.unit for tension, pull in zip((25.0, 2.0), rod.section.pulls, strict=True)]
    start = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, states[0, 3], *states[0, 4:]]
    tip = in_space(of, start, [*total, 0.0], pulls, [*rod.gravity, 0.0], [0.7, 0.4])
    x, y, angle, moment, *sliding = states[-1]
    turned = [np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)]
    assert tip == pytest.approx([x, y, 0.0, *turned, 0.0, 0.0, moment, *sliding], abs=1e-9)


def test_moments_about_its_other_axes_bend_it_to_the_side_and_twist_it():
    """A circle in the other plane, and a straight rod that turns about itself."""
    side, twist, moment, none = 0.7, 0.4, 0.6, [0.0, 0.0, 0.0]
    bent = in_space(finger(), [*none, 1.0, *none, moment, 0.0, 0.0], none, [0.0, 0.0], none, [side, twist])
    angle = moment / side
    assert bent[:3] == pytest.approx([0.0, np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle], abs=1e-9)
    turned = in_space(finger(), [*none, 1.0, *none, 0.0, moment, 0.0], none, [0.0, 0.0], none, [side, twist])
    assert turned[:3] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    half = 0.5 * moment / twist
    assert turned[3:7] == pytest.approx([np.cos(half), 0.0, np.sin(half), 0.0], abs=1e-9)


def test_a_rod_in_space_is_that_of_scipy_by_rotation_matrices():
    side, twist = 0.7, 0.4
    force, gravity = np.array([0.4, -0.6, 0.5]), np.array([2.0, -9.0, 4.0])
    of = finger(rest_curvature=4.0)
    section = Stages(of).section
    density = section.mass
    pulled = 0.8

    def rate(s, q):
        axes, moment = q[3:12].reshape(3, 3), q[12:]
        e, t, z = axes.T
        a, b, c = e @ moment / side, t @ moment / twist, 4.0 * LENGTH + z @ moment + pulled
        skew = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
        return np.concatenate([t, (axes @ skew).ravel(), np.cross(force - gravity * density * s, t)])

    moment = np.array([0.5, -0.3, 0.9])
    start = np.concatenate([np.zeros(3), np.eye(3).ravel(), moment])
    exact = solve_ivp(rate, (0.0, 1.0), start, rtol=1e-11, atol=1e-12).y[:, -1]
    tip = in_space(of, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, *moment], force, [pulled, 0.0], gravity, [side, twist])
    assert tip[:3] == pytest.approx(exact[:3], abs=1e-8)
    assert np.transpose(columns(tip[3:7])) == pytest.approx(exact[3:12].reshape(3, 3), abs=1e-8)
    assert tip[7:10] == pytest.approx(exact[12:], abs=1e-8)
