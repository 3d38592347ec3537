"""from inside: the S-lemma against sampled directions, the slope of an eigenvalue and displaced places of a search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.grasp.hand.certificate import certify_hand
from continuum_grasp.grasp.hand.parts import Aims
from continuum_grasp.grasp.hand.problem import hand_problem
from continuum_grasp.grasp.hand.recomputed import RecomputedHand
from continuum_grasp.grasp.hand.search import HandSearch
from continuum_grasp.grasp.hand.stability import hand_stability
from continuum_grasp.grasp.hand.steady import LINKS, eigenvalue_slope
from continuum_grasp.grasp.hand.weights import worst_friction
from continuum_grasp.nlp import Budget
from tests import hand_cases as cases
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
    assert found.status.name == "NOT_SOLVED"  # one grasp was turned; another may do
    assert "in every direction" in found.message
    (reason,) = found.reasons
    assert reason.name == "friction"
    assert optimize_grasp(cg.load(TURNED, [f"contacts.friction={reason.needed * 1.1}"])).solved


# -- the search next to a grasp ---------------------------------------------------------------------------------------


def first_grasp(name, changes=()):
    """The search of a shipped hand, and its first grasp."""
    scene = cg.load(ROOT / f"configs/hand/{name}.yaml", changes)
    search = HandSearch(scene, Budget.of(scene.solver, None))
    return search, next(t for t in search.run() if t.attempt.converged and certify_hand(scene, t.arrays).passed)


@pytest.fixture(scope="module")
def leaning():
    """The egg's, whose fingers are displaced."""
    return first_grasp("egg")


@pytest.mark.deep
def test_the_slope_of_the_least_eigenvalue_is_that_of_differences(leaning):
    search, tried = leaning

    def value(x):
        return hand_stability(RecomputedHand(search.scene, search.arrays_at(tried, x)), LINKS).eigenvalue

    slope, x = eigenvalue_slope(search, tried), tried.attempt.x
    assert np.linalg.norm(slope) > 0.1
    draw = np.random.default_rng(3)
    stored = [
        place
        for name, place in tried.problem.x.at.items()
        if not name.startswith("relaxed ") and not name.endswith(("turns", ".shifts"))
    ]
    for _ in range(4):
        along = np.zeros(x.size)
        for place in stored:
            along[place] = draw.normal(size=place.stop - place.start)
        along /= np.linalg.norm(along)
        difference = (value(x + 1e-5 * along) - value(x - 1e-5 * along)) / 2e-5
        assert slope @ along == pytest.approx(difference, rel=1e-3, abs=1e-4)


def test_a_grasp_next_to_another_is_as_much_more_stable_as_was_asked():
    search, tried = first_grasp("can")
    slope, before = eigenvalue_slope(search, tried), hand_stability(RecomputedHand(search.scene, tried.arrays), LINKS)
    problem = hand_problem(replace(tried.problem.spec, aims=Aims(steadied=True)))
    found = search.next_to(tried, problem, problem.steadying(slope, float(slope @ tried.attempt.x) + 1e-3))
    assert found.attempt.converged
    assert certify_hand(search.scene, found.arrays).passed
    after = hand_stability(RecomputedHand(search.scene, found.arrays), LINKS)
    assert after.eigenvalue - before.eigenvalue == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize(
    ("name", "changes"), [pytest.param("egg", (), marks=pytest.mark.deep), ("cones", ["fidelity.elements=4"])]
)
def test_places_that_stay_clear_are_on_the_displaced_backbone(name, changes):
    """By the certificate's own quadrature; the search interpolates by cubics from element to element."""
    search, tried = first_grasp(name, changes)
    hand = RecomputedHand(search.scene, tried.arrays)
    unit = search.units.length
    guarded = tried.problem.guarded(tried.attempt.x, tried.numbers)
    assert max(np.abs(finger.deflections).max() for finger in hand.fingers) > 1e-4
    for finger, (places, halves) in zip(hand.fingers, guarded, strict=True):
        places, halves = unit * places, unit * halves
        a, b = finger.points[:-1], finger.points[1:]
        share = ((places[:, None] - a) * (b - a)).sum(axis=2) / ((b - a) ** 2).sum(axis=1)
        nearest = a + np.clip(share, 0.0, 1.0)[..., None] * (b - a)
        away = np.linalg.norm(places[:, None] - nearest, axis=2)
        assert away.min(axis=1).max() < 1e-4 * finger.length
        panel = away.argmin(axis=1)
        within = np.take_along_axis(np.clip(share, 0.0, 1.0), panel[:, None], axis=1)[:, 0]
        thick = finger.plane.thickness
        assert halves == pytest.approx(thick[panel] + within * (thick[panel + 1] - thick[panel]), rel=1e-3)


# -- by hand: three straight fingers press a ball between their ends ---------------------------------------------------


def pressed(press, density=1e-12, **changes):
    """The scene, while the weight takes every direction, and its arrays, which have no weight."""
    scene, arrays = cases.three_straight(press, density=density)
    return scene.changed({"object.mass": 0.05, "gravity": {"any": 1.0}, **changes}), arrays


@pytest.mark.parametrize("density", [1e-12, 0.1])
def test_weight_of_object_and_fingers_moves_a_ball_aside(density):
    """Cantilevers of stiffness 3 E I / L^3 in their planes and 3 E I_l / L^3 across; 3/8 of their own weight q L bears
    on their ends. Three of them a third of a turn apart are as stiff in all directions across them.
    """
    stiffness = 1.5 * 3.0 * (cases.STIFFNESS + cases.LATERAL) / cases.LENGTH**3
    moved = (0.05 + 3.0 * 0.375 * density * cases.LENGTH) / stiffness
    response = certify_hand(*pressed(0.001, density)).response
    assert np.diag(response.pose_by_gravity)[:2] == pytest.approx([moved, moved], rel=0.02)
    assert abs(response.pose_by_gravity[2, 2]) < 1e-3 * moved
    assert certify_hand(*pressed(0.001, density)).turned_motion[0] == pytest.approx(moved, rel=0.02)


@pytest.mark.parametrize(("key", "name"), [("shift_max", "displacement"), ("turn_max", "turn")])
def test_motion_in_every_direction_has_a_limit(key, name):
    scene, arrays = pressed(0.2)
    shift, turn = certify_hand(scene, arrays).turned_motion
    for share, passes in ((1.001, True), (0.999, False)):
        limited = scene.changed({"gravity": {"any": 1.0, key: share * (shift if key == "shift_max" else turn)}})
        (check,) = (c for c in certify_hand(limited, arrays).checks if c.name.startswith(f"{name} of the object"))
        assert check.passed is passes


@pytest.mark.deep
def test_a_hand_that_yields_too_far_is_not_held_and_a_stiffer_one_is():
    limit = "gravity={any: 9.81, shift_max: 1 mm, turn_max: 1 deg}"
    found = optimize_grasp(cg.load(TURNED, [limit]), raise_on_failure=False)
    assert found.status.name == "NOT_SOLVED"
    assert "1 mm and 1 degrees is allowed" in found.message
    assert "times as stiff" in found.advice
    stiff = ["hand.finger.rod.bending_stiffness=0.018", "hand.finger.tendons.max_tension=150"]
    held = optimize_grasp(cg.load(TURNED, [limit, *stiff]))
    assert held.certificate.turned_motion[0] < 1e-3


@pytest.mark.parametrize("key", ["contacts.friction", "contacts.normal_force_max"])
def test_limits_hold_in_every_direction_up_to_what_is_needed(key):
    scene, arrays = pressed(0.2)
    needs = certify_hand(scene, arrays).turned
    reserve = 1.0 - scene.contacts.reserve
    most = {
        "contacts.friction": max(c.friction for c in needs) / reserve,
        "contacts.normal_force_max": max(c.greatest for c in needs),
    }
    word = {"contacts.friction": "friction cone", "contacts.normal_force_max": "normal force"}[key]
    for share, passes in ((1.001, True), (0.999, False)):
        checks = certify_hand(scene.changed({key: share * most[key]}), arrays).checks
        turned = [
            check.passed for check in checks if check.name.startswith(word) and check.name.endswith("any direction")
        ]
        assert len(turned) == 3
        assert all(turned) is passes
