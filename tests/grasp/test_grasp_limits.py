"""Every limit of the certificate, by hand: each check holds at 0.999 of its limit and fails at 1.001."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq

import continuum_grasp as cg
from continuum_grasp.grasp import certify
from continuum_grasp.scene import (
    Box,
    Circle,
    Ellipse,
    Freedom,
    LengthDrive,
    Line,
    MotorDrive,
    Palm,
    Point,
    Rod,
    Tendons,
)
from tests import certificate_cases as cases

L, HALF, EI, ARM = cases.LENGTH, cases.HALF, cases.STIFFNESS, cases.OFFSET
R, PRESS, MASS = 0.04, 4.0, 0.2
"""Of the disc against a palm."""
SCALE = math.hypot(PRESS, 0.5 * 9.81 * MASS)
"""Greatest force on the disc: normal force and lift [N]."""
EXACT, FOLLOWED, CROSSING = 1e-6, 1e-5, 1e-4
"""Limits of what is stated, of what follows from shapes, and of fingers in each other [1]."""


def disc(**more):
    return lambda: cases.squeezed_disc(**{"radius": R, "press": PRESS, "mass": MASS, **more})


def far(body=None, supports=None, fingers=None, values=None, **more):
    return cases.apart(fingers, values, body, supports=supports or {}, **more)


def add(name, index, amount):
    """A change of one stored number, by a part of its limit."""

    def change(scene, arrays, part):
        arrays[name][index] += part * amount
        return scene, arrays

    return change


def put(name, index, value, amount):
    """The same from another value on, of one number or of several."""

    def change(scene, arrays, part):
        arrays[name][index] = np.array(value) + part * np.array(amount)
        return scene, arrays

    return change


def scene_with(key, value, amount):
    """A change of the scene."""
    return lambda scene, arrays, part: (scene.changed({key: value + part * amount}), arrays)


def both(check, case, name, index, amount):
    """Rows of a quantity that is bounded both ways."""
    return [(check, case, add(name, index, sign * amount)) for sign in (1.0, -1.0)]


def of_case(build):
    """A row's case that depends on the part of its limit."""
    return lambda scene, arrays, part: build(part)


# -- contacts ---------------------------------------------------------------------------------------------------------

HEAVY = disc(mass=4.0)  # weighs more than the contacts press: 39.24 N
BIG = disc(radius=0.5)  # larger than its finger
FULL = math.hypot(PRESS, 2.0)  # a contact that uses its whole cone [N]


def with_reserve():
    """A fifth of the cones stays free: 1.6 N of the 2 N that the friction at the tip would bear."""
    scene, arrays = disc()()
    return scene.changed({"contacts.reserve": 0.2}), arrays


def palm_at(amount):
    """The palm alone is moved: the object stays where it is."""

    def change(scene, arrays, part):
        palm = Palm(point=(0.0, L + HALF + 2 * R + part * amount), normal_angle=-math.pi / 2)
        return scene.model_copy(update={"supports": {"palm": palm}}), arrays

    return change


CONTACTS = [
    # Lift does not bend a finger in the plane.
    *(("friction cone, finger.tip", disc(), put("contact_forces", 0, (PRESS, 0.0, side * 2.0),
                                                (0, 0, side * FOLLOWED * FULL))) for side in (1.0, -1.0)),
    ("friction cone, finger.tip", with_reserve,
     put("contact_forces", 0, (PRESS, 0.0, 1.6), (0, 0, FOLLOWED * math.hypot(PRESS, 1.6)))),
    *(("friction cone, palm", disc(), put("contact_forces", 1, (PRESS, *(2.0 * d)), (0, *(FOLLOWED * FULL * d))))
      for d in map(np.array, ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.6, -0.8)))),
    ("friction cone, palm", HEAVY, put("contact_forces", 1, (PRESS, 2.0, 0.0), (0, 39.24 * FOLLOWED, 0))),
    ("normal force, finger.tip", disc(), put("contact_forces", (0, 0), 50.0, 50.0 * EXACT)),
    ("normal force, palm", disc(), put("contact_forces", (1, 0), 0.0, -EXACT * SCALE)),
    *(row for k in (0, 1) for row in
      both("stored numbers, finger.tip", disc(), "contact_positions", (0, k), EXACT * R)),
    *both("stored numbers, palm", BIG, "contact_normals", (1, 0), EXACT),
    *both("contact gap, finger.tip", disc(), "object.pose", 1, FOLLOWED * L),
    *both("contact gap, palm", disc(), "object.pose", 1, 2.0 * EXACT * R),
    *both("contact gap, palm", BIG, "object.pose", 1, 2.0 * EXACT * 0.5),
    *(("contact gap, palm", disc(), palm_at(sign * 2.0 * EXACT * R)) for sign in (1.0, -1.0)),
    *both("contact gap, first", lambda: cases.disc_on_pegs(aside=0.0), "object.pose", 1, 2.0 * EXACT * 0.03),
]  # fmt: skip

# -- fingers and object -----------------------------------------------------------------------------------------------


def pulled(tension, **finger):
    """A finger that touches nothing, bent by a tension to an arc."""
    return lambda: far(fingers={"finger": cases.make_finger(**finger)}, values={"finger": {"tensions": (tension, 0.0)}})


def free_base(scene, arrays):
    free = Freedom(x=(-0.01, 0.02), y=(-0.03, 0.04), angle=(-0.2, 0.1))
    return scene.replaced(finger=scene.finger.replaced(base_free=free)), arrays


def changed_finger(case, **changes):
    def build():
        scene, arrays = case()
        return scene.replaced(finger=scene.finger.replaced(**changes)), arrays

    return build


def turned_back(scene, arrays, part):
    """A stored backbone that goes back by a part of the limit, at places that are right."""
    line = arrays["finger.backbone"]
    line[31, [0, 2]] = line[30, [0, 2]] - part * 1e-6 * L
    return scene, arrays


def other_end(end, sign):
    """A stored backbone that begins or ends elsewhere, with places that are right."""

    def change(scene, arrays, part):
        arrays["finger.backbone"][end, [0, 2]] += sign * part * 1e-6 * L
        return scene, arrays

    return change


@cache
def mug():
    """A finger that is wrapped around a mug, as it is found."""
    found = cg.optimize_grasp("configs/grasp/mug.yaml")
    return found.scene, found.arrays


def in_range(side):
    """The middle contact beside the end of its range."""

    def change(scene, arrays, part):
        at = float(arrays["contact_stations"][0])
        off = side * part * EXACT * scene.finger.rod.length
        ends = [at + off, 0.17] if side > 0.0 else [0.01, at + off]
        return scene.changed({"contacts.middle_range": ends}), arrays

    return change


def stepped(*pieces):
    """A finger of pieces (to, stiffness) as deep everywhere."""
    sections = tuple({"to": to, "bending_stiffness": ei, "linear_density": 1e-12, "thickness": 2 * HALF}
                     for to, ei in pieces)  # fmt: skip
    return {"rod": Rod(length=L, sections=sections), "strain_limit": 0.9, "half": None}


SOFT = 0.25 * EI
"""Where the stiffness jumps to or from a quarter of it the strain is greatest, on the soft side alone."""
STRAINS = [
    (
        pulled(3.0, rod=Rod(length=L, linear_density=1e-12, bending_stiffness=EI, diameter=1.2e-3)),
        0.6e-3 * 3.0 * ARM / EI,
    ),
    (pulled(3.0, **stepped((0.3 * L, EI), (L, SOFT))), HALF * 3.0 * ARM / SOFT),
    (pulled(3.0, **stepped((0.7 * L, SOFT), (L, EI))), HALF * 3.0 * ARM / SOFT),
]
CORNER = math.hypot(0.03, 0.035)  # of the pinched box, from its center of mass
PHASE = L * math.sqrt(PRESS / EI)
LEFT_OF_MOMENT = abs(math.cos(PHASE) + HALF / (R + HALF) * (1.0 - math.cos(PHASE)))
"""Part of a moment in the base that is left at the tip of a finger that is pressed along, and rolls on the disc."""

FINGERS = [
    *both("finger equilibrium, finger", disc(), "finger.base_moment", 2, FOLLOWED * SCALE * L / LEFT_OF_MOMENT),
    # Where nothing presses, a hundredth of E I / L^2 counts.
    *both("finger equilibrium, finger", pulled(0.0), "finger.base_moment", 2, FOLLOWED * 1e-2 * EI / L),
    *(row for index in ((30, 0), (60, 0), (0, 0), (30, 1), (30, 2)) for row in
      both("stored numbers, finger", disc(), "finger.backbone", index, EXACT * L)),
    *both("stored numbers, finger", disc(), "finger.backbone", (30, 3), EXACT),
    ("stored numbers, finger", disc(), turned_back),
    *(("stored numbers, finger", disc(), other_end(end, sign)) for end, sign in ((0, 1.0), (60, 1.0), (60, -1.0))),
    *both("stored numbers, finger", disc(), "finger.lengths", 0, EXACT * L),
    *(row for k, unit in ((0, L), (1, L), (2, 1.0)) for row in
      both("base, finger", disc(), "finger.base", k, EXACT * unit)),
    *(("base, finger", lambda: free_base(*cases.squeezed_disc()), put("finger.base", k, end, sign * EXACT * unit))
      for k, end, sign, unit in (
          (0, -0.01, -1, L), (0, 0.02, 1, L), (1, 0.04, 1, L), (2, -0.2, -1, 1), (2, 0.1, 1, 1))),
    *(("tendon tension, finger", disc(), put("finger.tensions", k, 60.0, 60.0 * EXACT)) for k in (0, 1)),
    *(("tendon tension, finger", disc(), put("finger.tensions", k, 0.0, -60.0 * EXACT)) for k in (0, 1)),
    ("tendon tension, finger",
     changed_finger(disc(), tendons=Tendons(offset=ARM, max_tension=60.0, min_tension=2.0)),
     put("finger.tensions", slice(None), (5.0, 2.0), (0.0, -60.0 * EXACT))),
    *(("tendon tension, finger", changed_finger(disc(), tendons_used=used),
       put("finger.tensions", k, 0.0, sign * 60.0 * EXACT))
      for used, k in (("left", 1), ("right", 0)) for sign in (1.0, -1.0)),
    *(("position along the finger, finger.middle", mug, in_range(side)) for side in (1.0, -1.0)),
    *(("bending strain, finger", case, scene_with("fingers.finger.strain_limit", most, -EXACT * most))
      for case, most in STRAINS),
]  # fmt: skip

OBJECT = [
    *(row for k, unit in ((0, R), (1, R), (2, 1.0)) for row in
      both("object pose", disc(), "object.pose", k, EXACT * unit)),
    *(("object pose", cases.pinched_box, put("object.pose", k, sign * 0.02, sign * EXACT * CORNER))
      for k in (0, 1) for sign in (1.0, -1.0)),
    *(row for index in ((0, 1), (1, 0), (0, 2)) for row in
      both("object force balance", disc(), "contact_forces", index, EXACT * SCALE)),
    *both("object force balance", HEAVY, "contact_forces", (1, 0), 39.24 * EXACT),
    # The palm is as far from the center of mass as the object is large.
    *(row for k in (1, 2) for row in
      both("object moment balance", disc(), "contact_forces", (1, k), FOLLOWED * SCALE)),
]  # fmt: skip

# -- clearance --------------------------------------------------------------------------------------------------------

DEEP = FOLLOWED * L


def beside_disc(part):
    return far(Circle(shape="circle", diameter=2 * R, mass=0.0, position=(HALF + R - part * DEEP, 0.1)))


def beside_corner(part):
    """A square's corner between two samples of the backbone, which are 1 / 400 of the length apart."""
    x = HALF + 0.03 * 2**0.5 - part * DEEP
    return far(Box(shape="box", width=0.06, height=0.06, mass=0.0, position=(x, 0.1 + L / 1600), angle=math.pi / 4))


def below(support):
    """A straight finger whose tip comes near a support."""
    return lambda part: far(supports={"wall": support(part)})


def bent_back(part):
    """An arc that comes out of a wall and whose tip comes back to it: its height is sin(k L) / k."""
    turn = brentq(lambda turn: math.sin(turn) * L / turn - HALF + part * DEEP, 2.5, math.pi)
    palm = Palm(point=(0.0, 0.0), normal_angle=0.5 * math.pi)
    return far(supports={"wall": palm}, values={"finger": {"tensions": (turn / L * EI / ARM, 0.0)}})


def dipping(part):
    """An arc whose base lies in a wall dips below its base and out again: by (1 - cos(s k)) / k at the place s."""
    s = 4 * L / 400
    curve = brentq(lambda k: (1.0 - math.cos(s * k)) / k - part * DEEP, 1e-3, 1e3)
    base = (0.0, -1e-3, -0.5 * math.pi - s * curve)
    finger = cases.make_finger(base[:2], base[2])
    palm = Palm(point=(0.0, 0.0), normal_angle=0.5 * math.pi)
    values = {"finger": {"tensions": (curve * EI / ARM, 0.0)}}
    return far(supports={"wall": palm}, fingers={"finger": finger}, values=values)


def beside_bent(part):
    """A peg beside the middle of an arc about (-1 / k, 0)."""
    curve = 5.0
    turn, reach = 0.5 * L * curve, 1.0 / curve + HALF + 0.01 - part * DEEP
    peg = Point(type="point", position=(reach * math.cos(turn) - 1.0 / curve, reach * math.sin(turn)), radius=0.01)
    return far(supports={"wall": peg}, values={"finger": {"tensions": (curve * EI / ARM, 0.0)}})


def sunk(body, support):
    """An object that touches a support, sunk into it by what is stored of its pose."""

    def build(part):
        scene, arrays = far(body, supports={"rest": support})
        arrays["object.pose"][1] -= part * 2.0 * EXACT * R
        return scene, arrays

    return build


def above(y):
    return Circle(shape="circle", diameter=2 * R, mass=0.0, position=(0.5, y + R))


def side_by_side(part):
    """Two parallel fingers, of which the second is the longer one."""
    rod = Rod(length=0.3, linear_density=1e-12, bending_stiffness=EI)
    fingers = {"a": cases.make_finger(), "b": cases.make_finger((2 * HALF, 0.0), rod=rod)}
    return far(fingers=fingers, values={"b": {"base": (2 * HALF - part * CROSSING * L, 0.0, 0.0)}})


def tapered(first, last, position=(0.0, 0.0), angle=0.0):
    section = {"to": L, "bending_stiffness": EI, "linear_density": 1e-12, "thickness": (2 * first, 2 * last)}
    return cases.make_finger(position, angle, None, rod=Rod(length=L, sections=(section,)))


THIN, THICK = 0.006, 0.02


def beyond_thick_end(kind):
    """What a tapered finger meets straight ahead of its thick tip."""

    def build(part):
        finger = tapered(THIN, THICK)
        y = L + THICK - part * (CROSSING * L if kind == "finger" else DEEP)
        if kind == "finger":
            return far(fingers={"a": finger, "b": tapered(THIN, THICK, (0.0, y + L + THICK), math.pi)})
        if kind == "object":
            disc = Circle(shape="circle", diameter=2 * R, mass=0.0, position=(0.0, y + R))
            return far(disc, fingers={"finger": finger})
        peg = Point(type="point", position=(0.0, y + 0.01), radius=0.01)
        line = Line(type="line", start=(0.05, y), end=(-0.05, y))
        return far(supports={"wall": peg if kind == "peg" else line}, fingers={"finger": finger})

    return build


REST = Line(type="line", start=(0.45, 0.0), end=(0.55, 0.0))
INTO = "penetration into a support, finger, wall"
CLEARANCE = [(check, None, of_case(build)) for check, build in (
    ("penetration into the object, finger", beside_disc),
    ("penetration into the object, finger", beside_corner),
    (INTO, below(lambda part: Palm(point=(1.0, L + HALF - part * DEEP), normal_angle=-0.5 * math.pi))),
    (INTO, below(  # its end lies between two samples
        lambda part: Line(type="line", start=(HALF - part * DEEP, 0.1 + L / 1600), end=(0.1, 0.1 + L / 1600)))),
    (INTO, bent_back),
    (INTO, dipping),
    (INTO, below(  # between two samples
        lambda part: Point(type="point", position=(HALF + 0.01 - part * DEEP, 0.1 + L / 1600), radius=0.01))),
    (INTO, beside_bent),
    *(("penetration of the object into a support, rest", sunk(body, support)) for body, support in (
        (above(0.0), Palm(point=(9.0, 0.0), normal_angle=0.5 * math.pi)),
        (above(0.0), REST),
        (above(0.01), Point(type="point", position=(0.5, 0.0), radius=0.01)),
    )),
    ("overlap of fingers, a, b", side_by_side),
    ("penetration into the object, finger", beyond_thick_end("object")),
    (INTO, beyond_thick_end("peg")),
    (INTO, beyond_thick_end("line")),
    ("overlap of fingers, a, b", beyond_thick_end("finger")),
)]  # fmt: skip

# -- drives -----------------------------------------------------------------------------------------------------------

CABLE = {"axial_stiffness": 1e4, "series_stiffness": 1.0 / 3e-5}
COMPLIANCE = 3e-5 + L / 1e4  # [m/N]
WINCH = LengthDrive(kind="length", time_constant=0.02)
MOTOR = MotorDrive(kind="motor", winch_radius=0.008, inertia=2e-6, coulomb_friction=2e-3, torque_max=0.4)
SERVO = MOTOR.replaced(position_gain=2.0)
ONE = {"arrangement": "one_pulley", "pretension": 40.0}
MOST = (0.4 - 2e-3) / 0.008  # tension that the motor pulls up against its friction [N]


def driven(drive=None, tensions=(40.0, 40.0), friction=0.0, case=None, **finger):
    """A straight finger that both tendons pull alike; it is the same whatever the friction states are."""

    def build():
        scene, arrays = case() if case else cases.squeezed_disc(radius=R, mass=MASS, press=PRESS, family="arc")
        tendons = Tendons(offset=ARM, max_tension=60.0, friction=friction, drive=drive, **(CABLE if drive else {}))
        fingers = {name: f.replaced(tendons=tendons, **finger) for name, f in scene.named_fingers.items()}
        arrays |= {f"{name}.tensions": np.array(tensions) for name in fingers}
        return scene.with_fingers(fingers), arrays

    return build


DRIVES = [
    *(("torque, finger", driven(MOTOR), put("finger.tensions", k, MOST, 0.4 * EXACT / 0.008)) for k in (0, 1)),
    *(("torque, finger", driven(MOTOR.replaced(**ONE)),
       put("finger.tensions", slice(None), pulls, np.array(way) * 0.4 * EXACT / 0.008))
      for pulls, way in (((MOST + 5.0, 5.0), (1, 0)), ((5.0, MOST + 5.0), (0, 1)))),
    # The path along the finger is what the one tendon gives and the other takes.
    *(row for k in (0, 1) for row in
      both("tendons of one pulley, finger", driven(MOTOR.replaced(**ONE)), "finger.tensions", k,
           FOLLOWED * L / COMPLIANCE)),
]  # fmt: skip


@pytest.mark.parametrize(("check", "case", "change"), [*CONTACTS, *FINGERS, *OBJECT, *CLEARANCE, *DRIVES])
def test_a_check_holds_up_to_its_limit_and_no_further(check, case, change):
    for part, passes in ((0.999, True), (1.001, False)):
        scene, arrays = case() if case else (None, {})
        arrays = {key: np.array(value) for key, value in arrays.items()}
        assert certify(*change(scene, arrays, part))[check].passed is passes, part


# -- stability, and what is not asked for ------------------------------------------------------------------------------


def resting(support, body, com, **more):
    """An object whose center of mass is that high above where it touches a support, both unable to yield."""

    def build(part):
        values = {"mass": MASS, "position": (9.0, 0.5 * body["height"])}
        values["center_of_mass"] = (0.0, part * com - 0.5 * body["height"])
        scene, arrays = far(Ellipse(shape="ellipse", **body, **values), {"rest": support}, gravity=cases.PLANAR)
        arrays |= cases.contact_arrays([("rest", (9.0, 0.0), cases.DOWN, (9.81 * MASS, 0, 0), cases.NONE, 0)])
        return scene, arrays

    return build


def steadied(part):
    """A disc with a high center of mass does not roll past a tip beside it, if that presses."""
    scene, arrays = far(
        Circle(shape="circle", diameter=2 * R, mass=MASS, position=(0.0, 0.0), center_of_mass=(0.0, 0.01)),
        {"rest": Palm(point=(0.0, -R), normal_angle=0.5 * math.pi)},
        {"finger": cases.make_finger((R + HALF + L, 0.0), 0.5 * math.pi)},
        gravity=cases.PLANAR,
    )
    weight = 9.81 * MASS
    press = (2.0 - part) * 1e-6 * weight
    contacts = [
        ("rest", (0, -R), cases.DOWN, (weight, 0, 0), cases.NONE, 0),
        ("finger.tip", (R, 0), cases.RIGHT, (press, 0, 0), L, 0),
    ]
    return scene, arrays | cases.contact_arrays(contacts)


ROUND = {"width": 0.08, "height": 0.06}
BOTTOM = 0.04**2 / 0.03  # radius of curvature there [m]
PEG = 0.02


@pytest.mark.parametrize(
    "case",
    [
        # What rolls on a plane is stable with its center of mass below the center of curvature, on a peg below
        # rho r / (rho + r).
        resting(Palm(point=(9.0, 0.0), normal_angle=0.5 * math.pi), ROUND, BOTTOM),
        resting(Point(type="point", position=(9.0, -PEG), radius=PEG), ROUND, BOTTOM * PEG / (BOTTOM + PEG)),
        steadied,
    ],
)
def test_a_grasp_is_stable_up_to_the_limit(case):
    for part in (0.999, 1.001):
        assert certify(*case(part)).stable is (part < 1.0)


@pytest.mark.parametrize(
    ("case", "changes", "check"),
    [
        (cases.two_fingers_below, {"overlap": "allow"}, "overlap of fingers, left, right"),
        (driven(MOTOR), {"finger.tendons": {"offset": ARM, "max_tension": 60.0}}, "torque, finger"),
    ],
)
def test_what_a_scene_does_not_ask_for_is_not_checked(case, changes, check):
    scene, arrays = case()
    assert check in {one.name for one in certify(scene, arrays).checks}
    assert check not in {one.name for one in certify(scene.changed(changes), arrays).checks}


def test_an_upright_object_may_lean_on_what_bears_its_moment():
    """Lift of one contact alone tilts a disc between two by m g R; forces balance."""
    scene, arrays = cases.squeezed_disc()
    arrays["contact_forces"][:, 2] = arrays["contact_forces"][:, 2].sum(), 0.0
    failed = {check.name: check.value for check in certify(scene, arrays).failed}
    moment = scene.object.mass * 9.81 * 0.5 * scene.object.diameter
    assert failed["object moment balance"] == pytest.approx(moment, rel=1e-9)
    assert "object moment balance" not in {c.name for c in certify(scene.replaced(upright=True), arrays).failed}
