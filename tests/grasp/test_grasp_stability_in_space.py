"""The second-order test of planar grasps in space: loads at which straight fingers lean or twist out of the plane."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv

import continuum_grasp as cg
from continuum_grasp.grasp import certify
from continuum_grasp.scene import Circle, Palm, PointMass, Rod, Tendons
from tests import certificate_cases as cases

pytestmark = pytest.mark.xfail(reason="motions of planar grasps out of their plane are not judged", strict=False)
L, EI = cases.LENGTH, cases.STIFFNESS
G = 9.81
PRANDTL = 2.0 * brentq(lambda x: jv(-0.25, x), 1.0, 3.0)
"""Of a cantilever under a dead force across its end: P L^2 = 4.013 sqrt(E I_l G J) (L. Prandtl, 1899)."""


def ellipse(ratio):
    """Section of width per thickness, and its E I_l and G J [N m2]."""
    section = {"shape": "ellipse", "thickness": 1e-3, "width": ratio * 1e-3, "poissons_ratio": 0.3}
    return section, ratio**2 * EI, 4.0 * ratio**2 / (1.0 + ratio**2) / 2.6 * EI


def thin(half, **values):
    """A finger whose ends are nearly points."""
    return cases.make_finger(half=half, tendons=Tendons(offset=min(half, cases.OFFSET), max_tension=60.0), **values)


def in_space(scene, arrays):
    return certify(scene, arrays).stability.in_space


def alone(section, gravity, angle=0.0, **changes):
    """A straight finger beside a box that two palms hold."""
    finger = cases.make_finger(section=section, angle=angle, **changes)
    return in_space(*cases.beside_box(finger, gravity=gravity))


# -- one finger -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.5, 1.0, 4.0])
@pytest.mark.parametrize("along_normal", [False, True])
def test_a_weight_at_the_end_twists_a_finger_away(ratio, along_normal):
    """Prandtl's load, of a weight in the plane and, with the roles of both stiffnesses exchanged, along its normal."""
    section, lateral, torsion = ellipse(ratio)
    bends = EI if along_normal else lateral
    load = PRANDTL * math.sqrt(bends * torsion) / L**2
    gravity = (0.0, 0.0, -G) if along_normal else (0.0, -G, 0.0)
    for share in (0.99, 1.01):
        masses = (PointMass(at=L, mass=share * load / G),)
        found = alone(section, gravity, angle=0.5 * math.pi, masses=masses)
        assert (found.eigenvalue > 0.0) is (share < 1.0)
    assert found.motion == "finger leans out of the plane"


@pytest.mark.parametrize("ratio", [0.5, 0.9])
def test_a_finger_under_its_own_weight_leans_where_that_is_weaker(ratio):
    """Q L^3 = 7.837 E I_l (A. G. Greenhill, 1881), below which it is stable in the plane."""
    section, lateral, _ = ellipse(ratio)
    for share in (0.99, 1.01):
        rod = Rod(length=L, linear_density=share * 7.8373 * lateral / L**3 / G, bending_stiffness=EI)
        found = certify(*cases.beside_box(cases.make_finger(section=section, rod=rod), gravity=cases.PLANAR)).stability
        assert found.in_plane
        assert (found.in_space.eigenvalue > 0.0) is (share < 1.0)


def test_a_stepped_column_leans_where_its_lower_and_upper_part_say():
    """tan(k1 l1) tan(k2 l2) = k2 / k1 with k^2 = P / (E I_l) of both parts, from displacement and slope between."""
    ratio, lower, upper = 0.5, EI, 0.3 * EI
    section, *_ = ellipse(ratio)

    def gap(load):
        one, two = (math.sqrt(load / (ratio**2 * stiffness)) for stiffness in (lower, upper))
        return math.tan(one * 0.6 * L) * math.tan(two * 0.4 * L) - two / one

    load = brentq(gap, 1e-3 * EI / L**2, 0.9 * ratio**2 * upper * (0.5 * math.pi / (0.4 * L)) ** 2)
    parts = [(0.6 * L, lower), (L, upper)]
    steps = [{"to": to, "bending_stiffness": stiffness, "linear_density": 1e-12} for to, stiffness in parts]
    rod = Rod(length=L, sections=steps)
    for share in (0.99, 1.01):
        found = alone(section, cases.PLANAR, rod=rod, masses=(PointMass(at=L, mass=share * load / G),))
        assert (found.eigenvalue > 0.0) is (share < 1.0)


# -- fingers that press on a disc -------------------------------------------------------------------------------------

THREE = (0.0, math.tau / 3, 2.0 * math.tau / 3)


def around(section, presses, places=THREE, start=0.0, mirrored=False, radius=0.03, half=1e-6, **more):
    """Straight fingers that point to the center of a disc, with normal forces, or with (normal, friction, lift)."""
    fingers, contacts, values = {}, [], {}
    for k, (place, press) in enumerate(zip(places, presses, strict=True)):
        at = start + place if not mirrored else start - place
        out, name = np.array([math.cos(at), math.sin(at)]), f"finger_{k + 1}"
        base = (radius + half + L) * out
        fingers[name], values[name] = (
            thin(half, position=base, angle=math.remainder(at + 0.5 * math.pi, math.tau), section=section),
            {},
        )
        n, friction, lift = press if isinstance(press, tuple) else (press, 0.0, 0.0)
        contacts.append((f"{name}.tip", radius * out, out, (n, -friction if mirrored else friction, lift), L, 0))
    body = Circle(shape="circle", diameter=2 * radius, mass=more.pop("mass", 0.0), position=(0.0, 0.0))
    scene = cases.make_scene(fingers, body, **more)
    return scene, cases.stored(scene, values, contacts)


def tilting(stiffness, radius):
    """Press of each of some fingers all around at which they tilt the disc: a beam-column under N yields to the side by
    (tan(z) / z - 1) L / N per force, z^2 = N L^2 / (E I_l), and the force does N r per turn: k r^2 = N r.
    """
    z = brentq(lambda z: math.tan(z) - z * (1.0 + radius / L), 1e-3, 0.5 * math.pi - 1e-9)
    return z**2 * stiffness / L**2


def test_short_of_buckling_that_is_stiffness_to_the_side_times_radius():
    """The rule sum(k r^2 - N r) > 0 of fingertips that press on a disc."""
    assert tilting(EI, 1e-4) == pytest.approx(3.0 * EI / L**3 * 1e-4, rel=1e-3)


@pytest.mark.parametrize("ratio", [0.5, 2.0])
@pytest.mark.parametrize("count", [3, 4])
@pytest.mark.parametrize("radius", [0.005, 0.03])
def test_tips_that_press_too_hard_tilt_a_disc(ratio, count, radius):
    section, lateral, _ = ellipse(ratio)
    places = [math.tau * k / count for k in range(count)]
    load = tilting(lateral, radius)
    for share in (0.98, 1.02):
        scene, arrays = around(section, [share * load] * count, places, radius=radius)
        found = certify(scene, arrays).stability
        assert (found.in_space.eigenvalue > 0.0) is (share < 1.0)
        # Within the plane the same rule holds, with the stiffness there.
        assert found.in_plane is (share * load < tilting(EI, radius))
        assert found.stable is (found.in_plane and found.in_space.stable)
    assert found.in_space.motion.startswith("tilts out of the plane")


def test_the_object_turns_about_the_line_between_two_tips():
    """Which nothing resists."""
    section, *_ = ellipse(4.0)
    for degrees in (0, 37, 179.8):
        found = in_space(*around(section, [0.02, 0.02], (0.0, math.pi), start=math.radians(degrees)))
        assert found.eigenvalue == pytest.approx(0.0, abs=1e-9)
        assert not found.stable
        assert f"line at {round(degrees) % 180} degrees" in found.motion


def eigenvalues(**how):
    """Of three fingers aside, with friction and forces out of the plane."""
    section, *_ = ellipse(1.5)
    presses = [(0.3, 0.05, 0.1), (0.25, -0.02, 0.05), (0.35, 0.0, -0.03)]
    values = {"gravity": cases.INTO_PLANE, "mass": 0.01, "radius": 0.02, "half": 0.004}
    return in_space(*around(section, presses, (0.3, 2.2, 4.4), **values, **how)).eigenvalue


def test_neither_a_turn_about_the_normal_nor_a_mirror_changes_it():
    value = eigenvalues()
    assert abs(value) > 0.1
    for how in ({"start": 0.7}, {"mirrored": True}, {"start": -2.1, "mirrored": True}):
        assert eigenvalues(**how) == pytest.approx(value, rel=1e-9)


def test_what_is_upright_does_not_tilt():
    section, *_ = ellipse(4.0)
    two = {"places": (0.0, math.pi), "gravity": cases.INTO_PLANE, "mass": 1e-3, "radius": 0.03}
    presses = [(0.05, 0.0, 0.5e-3 * G)] * 2
    free, upright = (in_space(*around(section, presses, upright=upright, **two)) for upright in (False, True))
    assert free.eigenvalue == pytest.approx(0.0, abs=1e-6)
    assert upright.stable


def test_what_carries_no_weight_may_be_upright_where_fingers_have_sections():
    two = {"places": (0.0, math.pi), "radius": 0.03}
    assert in_space(*around(ellipse(4.0)[0], [0.05] * 2, upright=True, **two)).stable
    with pytest.raises(ValueError, match="upright: has no effect"):
        around(None, [0.05] * 2, upright=True, **two)


@pytest.mark.parametrize("ratio", [1.0, 4.0])
def test_the_weight_that_friction_carries_bends_the_fingers(ratio):
    section, lateral, _ = ellipse(ratio)
    weight = 1e-4
    two = {"places": (0.0, math.pi), "gravity": cases.INTO_PLANE, "mass": weight / G, "upright": True}
    found = in_space(*around(section, [(1e-3, 0.0, 0.5 * weight)] * 2, **two))
    assert found.sinks == pytest.approx(0.5 * weight * L**3 / (3.0 * lateral), rel=0.01)
    assert in_space(*around(section, [1e-3] * 3)).sinks == 0.0


# -- supports ---------------------------------------------------------------------------------------------------------


def on_a_palm(section, friction, press=0.02):
    """A finger that presses a disc against a palm opposite."""
    radius = 0.03
    body = Circle(shape="circle", diameter=2 * radius, mass=0.0, position=(0.0, L + radius))
    palm = Palm(point=(0.3, L + 2 * radius), normal_angle=-0.5 * math.pi, friction=friction)
    scene = cases.make_scene(thin(1e-6, section=section), body, supports={"palm": palm})
    contacts = [
        ("finger.tip", (0.0, L), cases.DOWN, (press, 0.0, 0.0), L, 0),
        ("palm", (0.0, L + 2 * radius), cases.UP, (press, 0.0, 0.0), cases.NONE, 0),
    ]
    return in_space(scene, cases.stored(scene, {"finger": {}}, contacts))


def test_a_support_keeps_a_prism_from_tilting():
    """With friction the finger alone leans, as a column whose end is hinged; without, the object turns on the palm."""
    section, lateral, _ = ellipse(0.5)
    for share in (0.99, 1.01):
        load = share * brentq(lambda z: math.tan(z) - z, 4.0, 4.6) ** 2 * lateral / L**2
        assert (on_a_palm(section, 0.5, load).eigenvalue > 0.0) is (share < 1.0)
    assert on_a_palm(section, 0.0).eigenvalue == pytest.approx(0.0, abs=1e-9)


# -- verdicts ---------------------------------------------------------------------------------------------------------


ROUND = {f"fingers.{name}.section": {"shape": "round"} for name in ("left", "right")}


@pytest.mark.xfail(reason="rods of planar scenes with a section are not judged out of the plane", strict=False)
def test_a_grasp_that_is_required_to_be_stable_is_so_in_space():
    scene = cg.load("configs/grasp/pinch.yaml")
    space = cg.optimize_grasp(scene.changed(ROUND), raise_on_failure=False)
    assert space.status == "unstable"
    assert "in space unstable" in space.message
    assert "tilts out of the plane" in space.message
    assert "wider section" in space.advice
    found = space.certificate
    assert found.passed
    assert not found.acceptable
    assert not found.data()["stability"]["stable"]
    assert found.data()["stability"]["in_space"]["motion"] == found.stability.in_space.motion
    assert space.pairs()["second-order test"].startswith("stable in the plane only: tilts")
    assert "stability in space: unstable" in space.table()
    for changes in ({}, {"fingers.left.section": {"shape": "round"}}):
        plane = certify(scene.changed(changes), space.arrays)
        assert plane.acceptable
        assert plane.stability.in_space is None
        assert plane.stability.eigenvalue == found.stability.eigenvalue
        assert "motion in the plane only: give all fingers a section" in plane.stability.assumptions


@pytest.mark.xfail(reason="rods of planar scenes with a section are not judged out of the plane", strict=False)
def test_a_grasp_that_need_not_be_stable_says_that_it_is_not():
    scene = cg.load("configs/grasp/pinch.yaml").changed({**ROUND, "stability": "ignore"})
    found = cg.optimize_grasp(scene)
    assert found.status == "optimal"
    assert "Unstable: a small push opens this grasp." in found.message
    assert any("not stable in space" in warning for warning in found.warnings)
