"""The certificate's rod in space against closed forms and other integrations; from inside: no door leads to the rod."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipk, ellipkinc

from continuum_grasp.grasp.judge.space_rod import RodLoad, SideStiffness, SpaceRod
from continuum_grasp.scene import PointMass, Rod, Tendons
from tests import certificate_cases as cases

LENGTH, STIFFNESS, OFFSET = cases.LENGTH, cases.STIFFNESS, cases.OFFSET
UPRIGHT = np.zeros(3), np.eye(3)
FREE = np.zeros(3)
FORCE = STIFFNESS / LENGTH**2


def rod_of(loads=(), tensions=(0.0, 0.0), gravity=FREE, section=None, base=UPRIGHT, guess=FREE, finger=None, **more):
    finger = cases.make_finger() if finger is None else finger
    scene, _ = cases.apart(finger, family="clothoid")
    section = SideStiffness() if section is None else section
    rod = SpaceRod(scene.setups[0], base, np.array(tensions), list(loads), np.array(gravity), section, **more)
    rod.solve(np.array(guess))
    unit = scene.setups[0].stiffness / LENGTH
    assert np.abs(rod.missing).max() < 100.0 * more.get("tolerance", 1e-10) * unit
    return rod


def tip(rod):
    return rod.at(np.array([rod.length])).points[0]


def graded():
    parts = {"bending_stiffness": (STIFFNESS, 0.3 * STIFFNESS), "linear_density": (0.05, 0.02)}
    return cases.make_finger(
        rod=Rod(length=LENGTH, sections=({"to": 0.08, **parts}, {"to": LENGTH, **parts})),
        rest_curvature=3.0,
        masses=(PointMass(at=0.13, mass=0.01), PointMass(at=LENGTH, mass=0.004)),
    )


@pytest.mark.parametrize("tension", [0.5, -7.0, 20.0])
def test_a_tendon_bends_a_rod_to_a_circle(tension):
    curvature = tension * OFFSET / STIFFNESS
    rod = rod_of(tensions=(max(tension, 0.0), max(-tension, 0.0)))
    s = np.linspace(0.0, LENGTH, 23)
    angle = curvature * s
    circle = np.column_stack([np.cos(angle) - 1.0, np.sin(angle), 0.0 * s]) / curvature
    assert rod.at(s).points == pytest.approx(circle, abs=1e-9 * LENGTH)
    assert rod.curvature(s) == pytest.approx(curvature, rel=1e-9)


@pytest.mark.parametrize("push", [0.3, 2.0, 8.0])
def test_a_force_across_the_tip_makes_an_elastica(push):
    """Angle at the tip by elliptic integrals: K. Bisshopp, D. Drucker, "Large deflection of cantilever beams", 1945."""

    def length(angle):
        modulus = 0.5 * (1.0 + math.sin(angle))
        start = math.asin(math.sqrt(0.5 / modulus))
        return ellipk(modulus) - ellipkinc(start, modulus)

    angle = brentq(lambda a: length(a) - math.sqrt(push), 1e-9, 0.5 * math.pi - 1e-9)
    base = 0.9 * math.sqrt(2.0 * STIFFNESS * push * FORCE * math.sin(angle))
    rod = rod_of([RodLoad(LENGTH, np.array([-push * FORCE, 0.0, 0.0]))], guess=(0.0, 0.0, base))
    end = rod.at(np.array([LENGTH])).axes[0, :, 1]
    assert math.atan2(-end[0], end[1]) == pytest.approx(angle, abs=1e-8)
    # Energy integral: B k^2 / 2 at the base is the force times how far the tip points along it.
    assert 0.5 * STIFFNESS * rod.curvature(np.zeros(1))[0] ** 2 == pytest.approx(push * FORCE * math.sin(angle))


@pytest.mark.parametrize("weight", [1.0, 6.0])
def test_a_heavy_rod_sags_as_collocation_has_it(weight):
    density = weight * FORCE / (9.81 * LENGTH)
    finger = cases.make_finger(rod=Rod(length=LENGTH, linear_density=density, bending_stiffness=STIFFNESS))

    # Gravity along -x, the finger along y: it bends towards gravity by the angle y.
    def bent(s, y):
        return np.array([y[1], -weight * (1.0 - s) * np.cos(y[0]), np.sin(y[0]), np.cos(y[0])])

    def ends(a, b):
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0.0, 1.0, 201)
    found = solve_bvp(bent, ends, s, np.array([0.1 * s, 0.1 + 0.0 * s, 0.0 * s, s]), tol=1e-9, max_nodes=100_000)
    assert found.success
    rod = rod_of(finger=finger, gravity=(-9.81, 0.0, 0.0))
    points = rod.at(LENGTH * s).points
    wanted = LENGTH * np.column_stack([-found.sol(s)[2], found.sol(s)[3], 0.0 * s])
    assert points == pytest.approx(wanted, abs=1e-7 * LENGTH)


@pytest.mark.parametrize("ratio", [0.4, 16.0])
def test_bending_to_the_side_is_bending_in_the_plane_of_another_rod(ratio):
    force = 2.0 * ratio * FORCE
    side = rod_of([RodLoad(LENGTH, np.array([0.0, 0.0, force]))], section=SideStiffness(ratio, 0.7))
    stiff = cases.make_finger(rod=Rod(length=LENGTH, linear_density=1e-12, bending_stiffness=ratio * STIFFNESS))
    plane = rod_of([RodLoad(LENGTH, np.array([force, 0.0, 0.0]))], finger=stiff)
    s = np.linspace(0.0, LENGTH, 17)
    assert side.at(s).points[:, [2, 1, 0]] == pytest.approx(plane.at(s).points, abs=1e-9 * LENGTH)


def test_a_couple_along_the_rod_twists_it():
    couple, torsion = 0.3 * STIFFNESS / LENGTH, 0.6
    rod = rod_of([RodLoad(LENGTH, FREE, lambda _: np.array([0.0, couple, 0.0]))], section=SideStiffness(2.0, torsion))
    turn = couple * LENGTH / (torsion * STIFFNESS)
    across = rod.at(np.array([LENGTH])).axes[0, :, 0]
    assert across == pytest.approx([math.cos(turn), 0.0, -math.sin(turn)], abs=1e-9)


def test_a_round_rod_bends_alike_in_every_plane():
    """Where both bending stiffnesses are equal, the plane of the tendons does not matter to a rod without them."""
    force = np.array([1.5, -0.4, 0.0]) * FORCE
    load = [RodLoad(LENGTH, force)]
    plane = rod_of(load)
    for angle in (0.3, 1.2, 2.9):
        c, s = math.cos(angle), math.sin(angle)
        about = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        rod = rod_of(load, section=SideStiffness(1.0, 0.7), base=(np.zeros(3), about))
        places = np.linspace(0.0, LENGTH, 9)
        assert rod.at(places).points == pytest.approx(plane.at(places).points, abs=1e-9 * LENGTH)


WRENCH = [
    RodLoad(0.4 * LENGTH, np.array([1.2, 0.5, -0.8]) * FORCE, lambda r: np.array([0.0, 0.2, 0.1]) * FORCE * LENGTH),
    RodLoad(LENGTH, np.array([-0.7, -0.9, 1.1]) * FORCE, lambda r: 3.0 * FORCE * np.cross([1.0, 0.2, 0.3], r)),
]
BENT = SideStiffness(3.0, 0.8)


def test_a_general_shape_by_turning_vectors():
    """Another integration of the same shape: rotation matrices by Rodrigues' formula, moments from statics."""
    finger, gravity = graded(), np.array([2.0, -9.0, 3.0])
    rod = rod_of(WRENCH, (4.0, 1.0), gravity, BENT, finger=finger)
    profile, count = finger.profile, 800
    edges = np.linspace(0.0, LENGTH, count + 1)
    middles, step = 0.5 * (edges[1:] + edges[:-1]), LENGTH / count
    places = rod.at(middles)

    # Statics of the whole part beyond each middle, on the shape itself.
    loads = [(load.at, load.force, load.couple) for load in WRENCH]
    loads += [(mass.at, mass.mass * gravity, None) for mass in finger.masses]
    densities = profile.linear_density(middles).tolist()
    loads += [(s, density * step * gravity, None) for s, density in zip(middles, densities, strict=True)]
    places_of = rod.at(np.array([at for at, _, _ in loads])).points
    for k in range(0, count, 91):
        moment = np.zeros(3)
        for (at, force, couple), place in zip(loads, places_of, strict=True):
            if at > middles[k]:
                moment += np.cross(place - places.points[k], force)
                moment += couple(place) if couple is not None else 0.0
        d1, t, d3 = places.axes[k].T
        stiffness = float(profile.bending_stiffness(middles[k]))
        around = rod.at(middles[k] + np.array([-1e-5, 1e-5])).axes
        rate = places.axes[k].T @ (around[1] - around[0]) / 2e-5
        bends = np.array([rate[2, 1], rate[0, 2], rate[1, 0]])
        pulled = 3.0 * OFFSET
        wanted = [
            moment @ d1 / (3.0 * stiffness),
            moment @ t / (0.8 * stiffness),
            3.0 + (moment @ d3 + pulled) / stiffness,
        ]
        assert bends == pytest.approx(wanted, abs=2e-3)
    tangents = places.axes[:, :, 1]
    assert tip(rod) == pytest.approx(step * tangents.sum(axis=0), abs=1e-5 * LENGTH)


def test_a_uniform_rod_keeps_kirchhoffs_integrals():
    """Moment along the force, and energy per length: constant along a uniform rod under forces at its end."""
    rod = rod_of(WRENCH[1:], section=BENT)
    places = rod.at(np.linspace(0.0, LENGTH, 33))
    force, moments = WRENCH[1].force, places.moment
    bent = np.einsum("nji,nj->ni", places.axes, moments) ** 2 / (np.array([3.0, 0.8, 1.0]) * STIFFNESS)
    energy = 0.5 * bent.sum(axis=1) + places.axes[:, :, 1] @ force
    assert np.ptp(moments @ force) < 1e-8 * FORCE**2 * LENGTH
    assert np.ptp(energy) < 1e-8 * FORCE


def test_turning_base_and_loads_turns_the_shape():
    turn = np.linalg.qr(np.array([[0.3, 1.0, -0.2], [0.9, 0.1, 0.5], [0.2, -0.4, 1.1]]))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([0.3, -0.1, 0.2])
    gravity, finger = np.array([1.0, -9.0, 2.0]), graded()
    own = [RodLoad(load.at, load.force, load.couple) for load in WRENCH]
    other = [
        RodLoad(load.at, turn @ load.force, lambda r, load=load: turn @ load.couple(turn.T @ (r - shift)))
        for load in WRENCH
    ]
    rod = rod_of(own, (3.0, 0.0), gravity, BENT, finger=finger)
    image = rod_of(other, (3.0, 0.0), turn @ gravity, BENT, (shift, turn), finger=finger)
    s = np.linspace(0.0, LENGTH, 11)
    assert image.at(s).points == pytest.approx(rod.at(s).points @ turn.T + shift, abs=1e-9 * LENGTH)


def test_the_tolerance_bounds_the_error():
    finest = rod_of(WRENCH, section=BENT, tolerance=1e-12)
    for tolerance in (1e-6, 1e-8, 1e-10):
        off = np.linalg.norm(tip(rod_of(WRENCH, section=BENT, tolerance=tolerance)) - tip(finest))
        assert off < 100.0 * tolerance * LENGTH


def test_the_moment_in_the_base_chooses_among_equilibria():
    """A column that is pressed beyond buckling is straight or bent to either side."""
    load = [RodLoad(LENGTH, np.array([0.0, -1.5 * math.pi**2 / 4.0 * FORCE, 0.0]))]
    ends = [tip(rod_of(load, guess=(0.0, 0.0, side * 2.5 * STIFFNESS / LENGTH)))[0] for side in (-1.0, 0.0, 1.0)]
    assert ends[1] == pytest.approx(0.0, abs=1e-9)
    assert ends[0] == pytest.approx(-ends[2], rel=1e-6)
    assert abs(ends[0]) > 0.3 * LENGTH


# -- friction ------------------------------------------------------------------------------------------------------


def test_tendon_friction_winds_a_free_finger_less_and_less():
    """The capstan equation of a free finger: theta' = T e exp(-mu theta) / B, so theta = ln(1 + mu T e s / B) / mu."""
    friction, tension = 0.3, 12.0
    tendons = Tendons(offset=OFFSET, max_tension=60.0, friction=friction, presliding=1e-8)
    s = np.linspace(0.0, LENGTH, 9)
    angle = np.log(1.0 + friction * tension * OFFSET / STIFFNESS * s) / friction
    for side in (1.0, -1.0):
        rod = rod_of(
            tensions=(tension, 0.0) if side > 0.0 else (0.0, tension),
            guess=FREE,
            finger=cases.make_finger(tendons=tendons),
        )
        along = rod.at(s).axes[:, :, 1]
        # The other tendon slides the other way, with the same loss of tension.
        assert np.unwrap(np.arctan2(-side * along[:, 0], along[:, 1])) == pytest.approx(angle, abs=1e-6)


def test_dry_friction_in_bending_slides_at_its_moment():
    branches = ({"stiffness": 0.5 * STIFFNESS, "moment": 0.01}, {"stiffness": 0.2 * STIFFNESS, "moment": 0.03})
    finger = cases.make_finger(damping={"dry_friction": branches})
    for tension in (1.0, 12.0, -12.0, 40.0):
        moment = abs(tension) * OFFSET

        def resisted(bent, moment=moment):
            held = sum(min(branch["stiffness"] * bent, branch["moment"]) for branch in branches)
            return STIFFNESS * bent + held - moment

        bent = brentq(resisted, 0.0, 1e3)
        rod = rod_of(tensions=(max(tension, 0.0), max(-tension, 0.0)), finger=finger)
        assert rod.curvature(np.array([0.0, 0.1])) == pytest.approx(math.copysign(bent, tension), rel=1e-9)
