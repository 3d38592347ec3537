"""The second-order test of grasps against exact columns whose ends sway and roll with the object."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from continuum_grasp.grasp import certify
from continuum_grasp.scene import Circle, Palm, Point, PointMass, Polygon, Rod
from tests import certificate_cases as cases

L, EI = cases.LENGTH, cases.STIFFNESS
SMALL = 1e-4


def column(load):
    """Stiffness of a clamped column's end under a load along it: its shift x and its turn phi towards -x [SI]."""
    z = L * math.sqrt(load / EI)
    c = 2 - 2 * math.cos(z) - z * math.sin(z)
    own, over = z * (math.sin(z) - z * math.cos(z)) / c, z * (z - math.sin(z)) / c
    cross = (own + over) * EI / L**2
    return np.array([[(2 * (own + over) - z**2) * EI / L**3, cross], [cross, own * EI / L]])


def critical(energy, size):
    """Least load [N] at which the Hessian of an energy of ``size`` small coordinates is singular."""

    def determinant(load):
        e = np.eye(size)
        matrix = [
            [(energy(load, a + b) - energy(load, a - b) - energy(load, b - a) + energy(load, -a - b)) / 4 for b in e]
            for a in e
        ]
        return np.linalg.eigvalsh(matrix)[0]

    loads = np.linspace(0.05, 40.0, 400) * EI / L**2
    k = next(k for k in range(1, loads.size) if determinant(loads[k]) < 0.0)
    return brentq(determinant, loads[k - 1], loads[k])


def stable_at(case, load):
    certificate = certify(*case(load))
    assert certificate.passed, certificate.failed
    return certificate.stable


def assert_critical(case, load):
    assert stable_at(case, 0.995 * load)
    assert not stable_at(case, 1.005 * load)


def pressing(body, top, half, load, ends=(0.0,), support=None):
    """A straight finger that presses an object without weight against a palm, or another support, opposite, which
    bears it at places aside of its line.
    """
    support = support or Palm(point=(0.0, top), normal_angle=-math.pi / 2)
    scene = cases.make_scene(cases.make_finger(half=half), body, supports={"top": support})
    names = ["top"] if len(ends) == 1 else [f"top.{k}" for k in range(1, len(ends) + 1)]
    contacts = [
        ("finger.tip", (0, L + half), cases.DOWN, (load, 0, 0), L, 0),
        *(
            (name, (x, top), cases.UP, (load / len(ends), 0, 0), cases.NONE, 0)
            for name, x in zip(names, ends, strict=True)
        ),
    ]
    return scene, cases.stored(scene, {"finger": {}}, contacts)


def under_disc(radius, half, load, peg=None):
    """It presses a disc against a palm or a peg opposite."""
    top = L + half + 2 * radius
    support = None if peg is None else Point(type="point", position=(0.0, top + peg), radius=peg)
    body = Circle(shape="circle", diameter=2 * radius, mass=0.0, position=(0.0, L + half + radius))
    return pressing(body, top, half, load, support=support)


TOP = 0.04


def under_polygon(corners, half, load, **body):
    """It presses a polygon with a flat top against a palm opposite."""
    ends = sorted(x for x, y in corners if y == TOP)
    body = Polygon(shape="polygon", vertices=corners, mass=0.0, position=(0.0, L + half), **body)
    return pressing(body, L + half + TOP, half, load, ends)


@pytest.mark.parametrize("half", [0.0, 0.006, 0.03])
@pytest.mark.parametrize("radius", [0.02, 0.5, 1e4])
@pytest.mark.parametrize("peg", [None, 0.0, 0.01])
def test_a_column_under_a_disc(radius, half, peg):
    """A straight finger presses a disc against a palm or a peg opposite, everything rolling.

    The tip's shift u and turn phi turn the disc by psi = (u - h phi) / (2 R). On the peg it climbs by (R psi)^2 /
    (2 (R + r)), the tip on the disc by (R psi + h phi)^2 / (2 (R + h)): so much work of the load is won. With h = 0
    and a palm the disc is a spring of stiffness -P / (4 R), and the column buckles where tan z = z (1 + 4 R / L).
    """

    def energy(load, x):
        u, phi = x
        psi = (u - half * phi) / (2 * radius)
        climbed = (radius * psi + half * phi) ** 2 / (2 * (radius + half))
        if peg is not None:
            climbed += (radius * psi) ** 2 / (2 * (radius + peg))
        return 0.5 * x @ column(load) @ x - load * climbed

    load = critical(energy, 2)
    if half == 0.0 and peg is None:
        z = brentq(lambda z: math.sin(z) - z * (1 + 4 * radius / L) * math.cos(z), 0.1, math.pi / 2)
        assert load == pytest.approx(EI * (z / L) ** 2, rel=1e-6)
    assert_critical(lambda load: under_disc(radius, half, load, peg), load)


@pytest.mark.parametrize(
    ("shape", "half"), [("face", 0.0), ("face", 0.006), ("face", 0.02), ("corner", 0.006), ("corner", 0.02)]
)
def test_a_column_under_a_fixed_object(shape, half):
    """The tip rolls on a flat face, or about a sharp corner, of an object that two supports keep from moving.

    Its shift is h phi; on the corner it climbs by h phi^2 / 2. Without thickness: clamped and pinned, z = 4.4934.
    """
    face = ((-0.05, 0.0), (0.05, 0.0), (0.05, TOP), (-0.05, TOP))
    corner = ((0.0, 0.0), (0.05, TOP), (-0.05, TOP))

    def energy(load, x):
        place = np.array([half * x[0], x[0]])
        return 0.5 * place @ column(load) @ place - load * (0.5 * half * x[0] ** 2 if shape == "corner" else 0.0)

    load = critical(energy, 1)
    if half == 0.0:
        assert load == pytest.approx(EI * (4.493409 / L) ** 2, rel=1e-5)
    assert_critical(lambda load: under_polygon(face if shape == "face" else corner, half, load), load)


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_two_fingers_below_a_disc_without_thickness(family):
    """Their tips are pins on the disc. It cannot turn, since both tips stay at their height, but sways with both:
    two clamped, free columns under half the weight each.
    """
    critical_mass = 2 * math.pi**2 * EI / (4 * L**2) / 9.81
    for share, stable in ((0.995, True), (1.005, False)):
        scene, arrays = cases.two_fingers_below(mass=share * critical_mass, half=0.0, family=family)
        assert np.abs([arrays["left.tensions"], arrays["right.tensions"]]).max() == 0.0
        certificate = certify(scene, arrays)
        assert certificate.passed
        assert certificate.stable is stable


@pytest.mark.parametrize("half", [0.003, 0.02])
def test_two_rolling_fingers_below_a_disc(half):
    """The same with round tips, by the exact motion of a disc that rolls on two circles.

    The normals turn by (R psi + h phi) / (R + h); both tips stay at their height, so that R psi = -h (phi1 + phi2) /
    2, and the couples of the tendons balance those of the friction.
    """
    radius, aside = 0.05, 0.03
    slope = math.asin(aside / (radius + half))

    def energy(load, x):
        shift, phi1, phi2 = SMALL * x
        spin = -0.5 * half * (phi1 + phi2)
        angles = [-math.pi / 2 - slope + (spin + half * phi1) / (radius + half)]
        angles.append(-math.pi / 2 + slope + (spin + half * phi2) / (radius + half))
        total = 2 * load * (-(radius + half) * math.sin(angles[0]))
        friction = load * math.sin(slope)
        for phi, angle, side in zip((phi1, phi2), angles, (-1, 1), strict=True):
            place = np.array([shift + (radius + half) * math.cos(angle) - side * aside, phi])
            total += 0.5 * place @ column(load) @ place + side * half * friction * phi
        return total / SMALL**2

    for way in np.eye(3):  # stationary where the fingers are straight
        assert energy(1.0, way) == pytest.approx(energy(1.0, -way), abs=2e-4 * EI / L)
    mass = 2 * critical(energy, 3) / 9.81
    for share, stable in ((0.99, True), (1.01, False)):
        certificate = certify(*cases.two_fingers_below(mass=share * mass, radius=radius, aside=aside, half=half))
        assert certificate.passed
        assert certificate.stable is stable


@pytest.mark.parametrize(("share", "stable"), [(0.98, True), (1.02, False)])
@pytest.mark.parametrize("at", [None, 0.7 * L, L])
def test_an_upright_finger_under_its_own_weight(at, share, stable):
    """It falls over where q L^3 = 7.8373 E I, or a weight at a where it is pi^2 E I / (4 a^2); the object stays where
    it is, between two palms.
    """
    density, masses = 1e-12, ()
    if at is None:
        density = share * 7.8373 * EI / L**3 / 9.81
    else:
        masses = (PointMass(at=at, mass=share * math.pi**2 * EI / (4 * at**2) / 9.81),)
    rod = Rod(length=L, linear_density=density, bending_stiffness=EI)
    finger = cases.make_finger(rod=rod, masses=masses)
    found = certify(*cases.beside_box(finger, gravity=cases.PLANAR))
    assert found.stable is stable


def test_a_contact_that_does_not_press_holds_nothing():
    scene, arrays = cases.squeezed_disc(mass=0.0, press=0.2)
    assert certify(scene, arrays).stable
    arrays["contact_forces"][:, 0] = 0.0
    found = certify(scene, arrays)
    assert not found.stable
    assert found.push == 0.0
