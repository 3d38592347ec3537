"""Numbers of reasons by linear programming at a posture, against a line of algebra or forces found another way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from certificate_cases import HALF, OFFSET, UPRIGHT, pinched_box, squeezed_disc, two_fingers_below, wrapped_disc
from grasp_scenes import CONFIGS, make_scene

from continuum_grasp.grasp import Status, certify, optimize_grasp
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.reasons.confirm import PostureStatics, least_amount
from continuum_grasp.grasp.values import Reason
from continuum_grasp.scene.load import load

G = 9.81


def having(scene, **contacts):
    """The scene with other friction or normal force limit."""
    return scene.model_copy(update={"contacts": scene.contacts.model_copy(update=contacts)})


def weaker(scene, limit):
    """The scene with less tension."""
    change = {"max_tension": limit}

    def of(finger):
        return finger.model_copy(update={"tendons": finger.tendons.model_copy(update=change)})

    if scene.finger is not None:
        return scene.model_copy(update={"finger": of(scene.finger)})
    return scene.model_copy(update={"fingers": {name: of(finger) for name, finger in scene.fingers.items()}})


def confirm(name, scene, arrays, amount):
    """What a limit would have to be at a posture, in its unit; None where no LP applies."""
    found = least_amount(name, scene, arrays, amount)
    return None if found is None else next(r for r in RELAXATIONS if r.name == name).value(scene, found.amount)


def holds(name, scene, arrays, amount):
    """Whether the forces of the LP are a grasp that the certificate confirms."""
    found = least_amount(name, scene, arrays, amount)
    relaxation = next(r for r in RELAXATIONS if r.name == name)
    forces = ("equilibrium", "balance", "cone", "force", "tension", "lift")
    checks = certify(relaxation.relaxed(scene, found.amount), found.arrays).checks
    failed = [c.name for c in checks if not c.passed and any(word in c.name for word in forces)]
    assert not failed
    return True


# -- a straight finger squeezes a disc against a palm, its weight across: 2 mu N >= m g, any N up to its limit --------


@pytest.mark.parametrize("family", ["clothoid", "matched_clothoid"])
def test_least_friction_of_a_squeeze(family):
    scene, arrays = squeezed_disc(mass=0.2, press=4.0, family=family)
    scene = having(scene, friction=0.05, normal_force_max=7.0)
    needed = 0.2 * G / (2 * 7.0)
    assert confirm("friction", scene, arrays, needed - 0.05) == pytest.approx(needed, rel=1e-5)
    assert confirm("friction", scene, arrays, 2.0) == pytest.approx(needed, rel=1e-5)  # better than what was found
    assert holds("friction", scene, arrays, needed - 0.05)


def test_greatest_mass_of_a_squeeze():
    scene, arrays = squeezed_disc(mass=2.0, press=4.0)
    scene = having(scene, friction=0.3, normal_force_max=7.0)
    assert confirm("mass", scene, arrays, 0.9) == pytest.approx(2 * 0.3 * 7.0 / G, rel=1e-5)
    assert holds("mass", scene, arrays, 0.9)


def test_least_normal_force_of_a_squeeze():
    scene, arrays = squeezed_disc(mass=0.2, press=4.0)
    scene = having(scene, friction=0.1, normal_force_max=3.0)
    assert confirm("normal force", scene, arrays, 30.0) == pytest.approx(0.2 * G / (2 * 0.1), rel=1e-5)
    assert holds("normal force", scene, arrays, 30.0)


def test_too_little_of_one_limit_where_another_is_short_is_no_number():
    """Neither friction nor normal force alone: the palm and the finger have nothing to push with."""
    scene, arrays = squeezed_disc(mass=0.2)
    scene = having(scene, friction=0.0, normal_force_max=7.0)
    assert confirm("normal force", scene, arrays, 30.0) is None
    assert confirm("tension", scene, arrays, 30.0) is None


def test_moment_that_tilts():
    """Two contacts on a line that the center of mass is beside: whatever their shares, the weight tilts by W d."""
    scene, arrays = pinched_box(mass=0.3, at=0.01)
    body = scene.object.model_copy(update={"center_of_mass": (0.002, 0.014)})
    scene = scene.model_copy(update={"object": body})
    needed = 0.3 * G * 0.004
    assert confirm("tilt balance", scene, arrays, 1.0) == pytest.approx(needed, rel=1e-4)
    assert confirm("friction", scene, arrays, 1.0) is None


# -- tensions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", ["clothoid", "matched_clothoid"])
def test_tension_against_the_couple_of_friction(family):
    """Upright fingers below a disc bear m g / 2 each, and the tendon the couple of the friction force."""
    mass, radius, aside = 0.2, 0.05, 0.03
    scene, arrays = two_fingers_below(mass, radius, aside, family=family)
    needed = HALF * 0.5 * mass * G * aside / (radius + HALF) / OFFSET
    short = weaker(scene, 0.5 * needed)
    assert confirm("tension", short, arrays, needed) == pytest.approx(needed, rel=1e-4)
    assert holds("tension", short, arrays, needed)
    slope = math.asin(aside / (radius + HALF))
    slippery = having(scene, friction=0.2)
    assert confirm("friction", slippery, arrays, 1.0) == pytest.approx(math.tan(slope), rel=1e-4)


@pytest.mark.parametrize("mirrored", [False, True])
def test_tension_of_a_wrapped_disc(mirrored):
    """The other problem's cones are polygons with 96 sides within the true ones."""
    scene, arrays = wrapped_disc(mirrored=mirrored)
    needed = float(arrays["finger.tensions"].max())
    short = weaker(scene, 0.6 * needed)
    assert needed * (1.0 - 1e-3) <= confirm("tension", short, arrays, needed) <= needed * (1.0 + 1e-6)
    assert holds("tension", short, arrays, needed)


@pytest.mark.parametrize(("off", "share"), [(3e-7, pytest.approx(0.1, rel=1e-4)), (2e-6, None)])
def test_postures_are_taken_to_be_as_exact_as_grasps_are(off, share):
    """Curvatures that err to and fro by this part, of a finger with more equations than forces."""
    held = optimize_grasp(make_scene(elements=8))
    most, bends = float(held.arrays["finger.tensions"].max()), held.arrays["finger.q"]
    bent = held.arrays | {"finger.q": bends * (1.0 + off * np.resize([1.0, -1.0], bends.shape))}
    found = least_amount("tension", weaker(held.scene, 0.9 * most), bent, 0.1 * most)
    assert (found and found.amount / most) == share


def test_coefficients_are_found_to_a_millionth(monkeypatch):
    """By halves: each tenth of that takes three problems more."""
    solved = []
    least = PostureStatics.least
    monkeypatch.setattr(PostureStatics, "least", lambda *known, **more: solved.append(1) or least(*known, **more))
    scene, arrays = squeezed_disc(mass=0.2, press=4.0)
    confirm("friction", having(scene, friction=0.05, normal_force_max=7.0), arrays, 2.0)
    assert abs(len(solved) - 2 - math.log2(2.0 / (1e-6 * 0.2 * G / 14.0))) < 1.5


def test_statics_are_those_of_the_stored_forces():
    """What a hand-made grasp stores fulfills every row; where it is disturbed, no longer."""
    scene, arrays = wrapped_disc(gravity=UPRIGHT)
    statics = PostureStatics(scene, arrays)
    off = statics.rows @ statics.own + statics.weight - statics.right
    assert np.abs(off).max() < 1e-6
    bent = arrays | {"finger.q": arrays["finger.q"] * 1.01}
    moved = PostureStatics(scene, bent)
    assert np.abs(moved.rows @ moved.own + moved.weight - moved.right).max() > 1e-4


@pytest.mark.parametrize("name", ["strain", "bending range", "clearance at the supports", "clearance at the object"])
def test_limits_of_the_shape_are_not_for_linear_problems(name):
    scene, arrays = squeezed_disc()
    assert confirm(name, scene, arrays, 0.1) is None


# -- whole diagnoses -------------------------------------------------------------------------------------------


def reasons_of(config) -> tuple[dict[str, Reason], object]:
    result = optimize_grasp(load(CONFIGS / config), raise_on_failure=False)
    assert result.status is Status.INFEASIBLE
    return {reason.name: reason for reason in result.reasons}, result


@pytest.mark.deep
def test_slippery_bottle_names_the_coefficient_twice():
    """Two fingers may press 3 N each: weight / (2 * 3 N)."""
    reasons, result = reasons_of("slippery_bottle.yaml")
    needed = 0.2 * G / 6.0
    assert reasons["friction"].needed == pytest.approx(needed, rel=1e-4)
    assert reasons["friction"].confirmed == pytest.approx(needed, rel=1e-4)
    assert f"{needed:.4g} by linear programming" in reasons["friction"].text
    assert "by linear programming" in result.table()


@pytest.mark.deep
def test_heavy_bottle_names_the_mass_twice():
    reasons, _ = reasons_of("heavy_bottle.yaml")
    reported = [reason for reason in reasons.values() if reason.confirmed is not None]
    assert reported
    for reason in reported:
        assert reason.confirmed == pytest.approx(reason.needed, rel=1e-3)
