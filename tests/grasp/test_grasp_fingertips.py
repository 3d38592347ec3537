"""Several fingers, most of which hold with their tips alone: starts in balance, by statics of this file's own, and the
grasps that they lead to, by closed forms, an oracle, and many random starts.
"""

from __future__ import annotations

import math

import pytest
from grasp_scenes import finger_to, held_by_tips, loose

from benchmarks.grasp_oracle import scenes
from continuum_grasp.grasp import GraspStatus, optimize_grasp
from tests.marks import few

pytestmark = pytest.mark.filterwarnings("ignore:tendons.offset")
G, LENGTH, HALF, OFFSET, RADIUS, MASS, FRICTION = 9.81, 0.2, 0.006, 0.005, 0.04, 0.3, 0.5


def finger(place, lean, stiffness=0.4, length=LENGTH, radius=RADIUS, **more):
    """A straight finger whose tip touches the disc where its normal has the angle ``place``; at a ``lean`` of zero it
    points at the disc's center, at a quarter of a turn it lies beside the disc.
    """
    tip = (radius + HALF) * math.cos(place), (radius + HALF) * math.sin(place)
    return finger_to(tip, place + math.pi - lean, length, stiffness=stiffness, **more)


def scene_of(fingers, gravity, **more):
    """Of which the forces alone decide."""
    return held_by_tips(fingers, gravity, **{"stability": "ignore", "overlap": "allow", **more})


OUT = [0.0, 0.0, -G]
PALM = {"palm": {"type": "palm", "point": (0.0, -RADIUS), "normal_angle": 0.5 * math.pi}}


@pytest.mark.parametrize("degrees", [0.0, *few([-90.0, -45.0, 60.0], 1)])
def test_soft_fingers_and_a_palm(degrees):
    """Contacts at 120 degrees bear m g / 3 each by friction alone: N = m g / (3 mu), which no grasp is below. A finger
    that leans by b bears N sin b across itself; its tip stays where it is, so a constant moment M bends it against the
    moment that grows from the tip: M L^2 / 2 = N sin b L^3 / 3, T e = 2 N L sin b / 3.
    """
    lean = math.radians(degrees)
    fingers = [finger(math.radians(30.0), lean), finger(math.radians(150.0), -lean)]
    result = optimize_grasp(scene_of(fingers, OUT, supports=PALM, objective="least_normal_force"))
    expected = MASS * G / (3.0 * FRICTION)
    assert result.status is GraspStatus.OPTIMAL
    assert [c.normal_force for c in result.contacts] == pytest.approx([expected] * 3, rel=1e-3)
    assert result.lower_bound == pytest.approx(expected, rel=2e-4)
    assert "above" in result.bound_words
    pull = 2.0 * expected * abs(math.sin(lean)) * LENGTH / (3.0 * OFFSET)
    for held in result.fingers.values():
        assert held.tensions.sum() == pytest.approx(pull, rel=3e-3, abs=0.1)


SIZES = [
    (0.4, 0.35, 0.03, 45.0, 0.0, "arc", 2),
    (0.4, 0.20, 0.05, 45.0, 0.0, "clothoid", 4),
    (1.0, 0.20, 0.05, 45.0, 0.0, "clothoid", 4),
    (0.4, 0.35, 0.03, 45.0, 0.02, "matched_clothoid", 2),
    (0.4, 0.35, 0.05, 0.0, 0.02, "arc", 2),
    (1.0, 0.35, 0.05, 0.0, 0.02, "arc", 2),
    (0.4, 0.10, 0.03, 30.0, 0.0, "clothoid", 4),
    (0.4, 0.20, 0.04, 30.0, 0.02, "arc", 2),
    (0.4, 0.20, 0.03, 20.0, 0.0, "matched_clothoid", 4),
    (0.4, 0.35, 0.05, 60.0, 0.0, "matched_clothoid", 2),  # out of reach by rounding, 6e-17 m
    (0.4, 0.10, 0.05, 30.0, 0.0, "matched_clothoid", 4),
]
"""E I [N m2], length and radius of the disc [m], where the tips touch [degrees], how far bases may move [m], model."""


@pytest.mark.parametrize(("stiffness", "length", "radius", "degrees", "free", "family", "elements"), few(SIZES, 1))
def test_straight_fingers_of_all_sizes_and_a_palm(stiffness, length, radius, degrees, free, family, elements):
    """Fingers that point at the disc end at it, each at one place alone, where l = m g / (2 + 2 sin a) each and
    2 l sin a at the palm do not tip it: N = max(1, 2 sin a) l / mu, however soft they are. Bases that may move reach
    30 degrees, where it is m g / (3 mu).
    """
    fingers = [finger(math.radians(a), 0.0, stiffness, length, radius) for a in (degrees, 180.0 - degrees)]
    fingers = [loose(one, free) for one in fingers] if free else fingers
    palm = {"palm": {"type": "palm", "point": (0.0, -radius), "normal_angle": 0.5 * math.pi}}
    model = {"family": family, "elements": elements}
    more = {
        "body": {"shape": "circle", "diameter": 2 * radius},
        "supports": palm,
        "fidelity": model,
        "objective": "least_normal_force",
    }
    result = optimize_grasp(scene_of(fingers, OUT, **more))
    rise = math.sin(math.radians(30.0 if free else degrees))
    assert result.status is GraspStatus.OPTIMAL
    expected = max(1.0, 2.0 * rise) * MASS * G / (2.0 * FRICTION * (1.0 + rise))
    assert max(c.normal_force for c in result.contacts) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("seed", "tension"), few([(155, 32.06), (495, 27.19), (58, 61.59), (328, 14.49)], 2))
def test_pinches_that_were_called_infeasible(seed, tension):
    """Random scenes of the benchmark whose oracle, sequential quadratic programming from tables of its own, has a grasp
    with so much tension [N]. Neither asks whether they are stable.
    """
    result = optimize_grasp(scenes.scene_of("two", seed))
    assert result.tension <= 1.005 * tension


@pytest.mark.deep
def test_fingers_may_wrap_from_either_side():
    """A multi-start of random postures, and of random changes of the best, found 181.2 N, with fingers that pass the
    object on their right; with both on their left the least is 231.7 N.
    """
    own = {
        "rod": {"length": 0.2398, "linear_density": 0.007, "bending_stiffness": 0.02559},
        "half_thickness": 0.007383,
        "tendons": {"offset": 0.005824, "max_tension": 240.0},
    }
    fingers = [
        {**own, "base": {"position": (-0.07857, 0.08783), "angle": -1.52}, "rest_curvature": -1.546},
        {**own, "base": {"position": (0.07857, -0.08449), "angle": 1.597}},
    ]
    body = {"shape": "ellipse", "width": 0.1332, "height": 0.1295, "mass": 0.01782}
    contacts = {"friction": 0.5409, "normal_force_max": 78.72, "middle": "on"}
    fidelity = {"family": "matched_clothoid", "elements": 4, "bending_range": 6.283}
    scene = held_by_tips(fingers, OUT, body, contacts, fidelity=fidelity, stability="ignore")
    result = optimize_grasp(scene)
    assert result.tension <= 1.005 * 181.2
    assert result.status is GraspStatus.FEASIBLE
    # Exact rods hold with 174.3 N.
    assert result.exploration.exact_less < 0.97 * result.tension
