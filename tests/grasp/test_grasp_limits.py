"""Every limit of the certificate, by hand: each check holds at 0.999 of its limit and fails at 1.001."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from continuum_grasp.grasp import Check, certify
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
"""Of the disc against a palm: the greatest force is that of the finger."""
STRAINED = Rod(length=0.18, linear_density=0.034, bending_stiffness=6.11e-3, diameter=1.2e-3)


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

WEIGHTLESS_TOUCH = disc(mass=0.0, press=0.0)
TRACE = 1e-4 * EI / L**2  # a touch without force: residuals count against a trace of what bends the finger
HEAVY = disc(mass=4.0)  # weighs more than the contacts press: 39.24 N
BIG = disc(radius=0.5)  # larger than its finger


def touched_by_stiffer():
    """A box between two fingers that do not press, of which the second is the stiffer one."""
    scene, arrays = cases.pinched_box(press=0.0, mass=0.0)
    return scene.changed({"fingers.b.rod.bending_stiffness": 10 * EI}), arrays


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


def on_longer_line():
    """A box beside the middle of the line that it stands on."""
    scene, arrays = cases.box_on_line()
    return scene.replaced(supports={"table": Line(type="line", start=(-0.05, 0.0), end=(0.07, 0.0))}), arrays


def slid(sign):
    """The disc slides along the finger at a middle contact by what a normal may be off, seen from the distance L."""

    def change(scene, arrays, part):
        x, y = arrays["contact_normals"][0]
        arrays["object.pose"][:2] += sign * part * 1e-6 * (R + 0.18) * np.array([-y, x])
        return scene, arrays

    return change


def touched_beside(part):
    """A tip on the disc of a union just below its box: inside that by a part of the limit."""
    scene, arrays = cases.union_on_palm()
    y = 0.03 - part * 1e-6 * L
    normal = np.array([math.sqrt(0.025**2 - (y - 0.04) ** 2), y - 0.04]) / 0.025
    base = np.array([0.0, 0.04]) + (0.025 + HALF + L) * normal
    angle = math.atan2(normal[0], -normal[1])
    arrays |= cases.finger_arrays(scene, "finger", base=(*base, angle))
    return scene, arrays


CONTACTS = [
    *(("friction cone, finger.tip", disc(), put("contact_forces", 0, (PRESS, *(2.0 * d)), (0, *(PRESS * 1e-6 * d))))
      for d in map(np.array, ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.6, -0.8)))),
    ("friction cone, finger.tip", with_reserve, put("contact_forces", 0, (PRESS, 1.6, 0.0), (0, PRESS * 1e-6, 0))),
    ("friction cone, palm", HEAVY, put("contact_forces", 1, (PRESS, 2.0, 0.0), (0, 39.24e-6, 0))),
    ("friction cone, palm", WEIGHTLESS_TOUCH, put("contact_forces", 1, (0, 0, 0), (0, 1e-6 * TRACE, 0))),
    ("friction cone, finger.tip", disc(friction=2.0),
     put("contact_forces", 0, (PRESS, 2 * PRESS, 0.0), (0, 2e-6 * PRESS, 0))),
    ("friction cone, a.tip", touched_by_stiffer, put("contact_forces", 0, (0, 0, 0), (0, 1e-6 * TRACE, 0))),
    ("normal force, finger.tip", disc(), put("contact_forces", (0, 0), 50.0, 50e-6)),
    ("normal force, palm", disc(), put("contact_forces", (1, 0), 0.0, -1e-6 * PRESS)),
    *(row for k in (0, 1) for row in both("stored contact, finger.tip", disc(), "contact_positions", (0, k), 1e-6 * L)),
    *(row for k in (0, 1) for row in both("stored contact, finger.tip", disc(), "contact_normals", (0, k), 1e-6)),
    *both("stored contact, finger.tip", disc(), "contact_stations", 0, 1e-6 * L),
    *both("stored contact, palm", BIG, "contact_normals", (1, 0), 1e-6),
    *both("contact gap, finger.tip", disc(), "object.pose", 1, 1e-6 * L),
    *both("contact gap, palm", disc(), "object.pose", 1, 2e-6 * L),
    *both("contact gap, palm", BIG, "object.pose", 1, 2e-6 * 0.5),
    *(("contact gap, palm", disc(), palm_at(sign * 2e-6 * L)) for sign in (1.0, -1.0)),
    *both("contact gap, first", lambda: cases.disc_on_pegs(aside=0.0), "object.pose", 1, 2e-6 * L),
    *(("contact normal, finger.middle", cases.wrapped_disc, slid(sign)) for sign in (1.0, -1.0)),
    # Seen from the distance L, the nearest point of a disc that lies aside by d is off by d L / (L + R).
    *both("contact normal, palm", disc(), "contact_positions", (1, 0), 2e-6 * (L + R)),
    # A tip without thickness has the normal that is stored: turned, it meets the disc beside the tip.
    *both("contact normal, finger.tip", disc(half=0.0), "contact_normals", (0, 0), 1e-6 * (L + R) / R),
    *both("stored contact, finger.tip", disc(half=0.0), "contact_normals", (0, 1), 1e-6),  # of length one
    ("contact inside another part, finger.tip", cases.union_on_palm, of_case(touched_beside)),
    *(("within the line, table.1", on_longer_line, put("contact_positions", (1, 0), end, sign * 2e-6 * L))
      for end, sign in ((-0.05, -1.0), (0.07, 1.0))),
]  # fmt: skip

# -- fingers and object -----------------------------------------------------------------------------------------------


def greatest_moment(arrays, name="finger"):
    """Of the contact forces in a finger that wraps a disc [N m]; their couples are those of friction at the skin."""
    lengths, q = arrays[f"{name}.lengths"], arrays[f"{name}.q"]
    s = np.linspace(0.0, lengths.sum(), 4001)
    line = cases.bent(arrays[f"{name}.base"], cases.ends_of("arc", q, lengths, 0.0), lengths, s)[:, :2]
    moment = np.zeros(s.size)
    for place, normal, (n, f, _), at in zip(
        arrays["contact_positions"], arrays["contact_normals"], arrays["contact_forces"], arrays["contact_stations"],
        strict=True,
    ):  # fmt: skip
        if np.isfinite(at):
            arm, force = place - line, n * normal + f * np.array([-normal[1], normal[0]])
            moment += (s <= at + 1e-9) * (arm[:, 0] * force[1] - arm[:, 1] * force[0])
    return np.abs(moment).max()


def of_moment(scene, arrays, part):
    arrays["finger.tensions"][0] += part * 1e-6 * greatest_moment(arrays) / ARM
    return scene, arrays


def standing(density, mass, tension=0.0):
    """An upright finger that touches nothing, under its weight, or bent by a tension."""
    rod = Rod(length=L, linear_density=max(density, 1e-12), bending_stiffness=EI)
    masses = (cases.PointMass(at=L, mass=mass),) if mass else ()
    q = np.full(2, ARM * tension / EI * 0.5 * L)
    values = {"finger": {"q": q, "tensions": (tension, 0.0)}}
    gravity = cases.PLANAR if density else cases.WEIGHTLESS
    return lambda: far(fingers={"finger": cases.make_finger(rod=rod, masses=masses)}, values=values,
                       gravity=gravity, family="arc")  # fmt: skip


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


def short_element(scene, arrays, part):
    arrays["finger.lengths"][:] = L * (2.0 - part) * 1e-9, L * (1.0 - (2.0 - part) * 1e-9)
    return scene, arrays


def stepped(*pieces):
    """A finger whose bending moment falls or rises linearly along it, of pieces (to, stiffness) as deep everywhere."""
    sections = tuple({"to": to, "bending_stiffness": ei, "linear_density": 1e-12, "thickness": 2 * HALF}
                     for to, ei in pieces)  # fmt: skip
    return cases.make_finger(rod=Rod(length=L, sections=sections), strain_limit=0.1)


def strained(rises, *pieces):
    """The moment rises to, or falls from, what bends the first piece by 1 / L."""

    def build():
        at = lambda s: next(ei for to, ei in pieces if s < to or to == L)  # noqa: E731 - on the tip side
        moments = pieces[0][1] / L * (np.array([0.0, 0.5, 1.0]) if rises else np.array([1.0, 0.5, 0.0]))
        q = moments / [at(0.0), at(0.5 * L), at(L)]
        return far(fingers={"finger": stepped(*pieces)}, values={"finger": {"q": q}}, family="clothoid")

    return build


SOFT = 0.25 * EI
"""Where the stiffness jumps to or from a quarter of it the strain is greatest, on the soft side alone."""
JUMPS = [
    (strained(False, (0.3 * L, EI), (L, SOFT)), 0.7 * EI / SOFT / L * HALF),
    (strained(True, (0.7 * L, SOFT), (L, EI)), 0.7 / L * HALF),
]
PULL = 0.01 * PRESS * L / ARM  # tension whose moment is 1 % of what the press had across the finger [N]
WRAPPED = cases.wrapped_disc, lambda: cases.wrapped_disc(mirrored=True)
WRAPPED_AT = float(cases.wrapped_disc()[1]["finger.lengths"][0])
TURN = float(np.abs(cases.wrapped_disc()[1]["finger.q"]).max())
CURVED = float(cases.wrapped_disc()[1]["finger.tip_curvature"])
CORNER = math.hypot(0.03, 0.035)  # of the pinched box, from its center of mass

FINGERS = [
    *(("finger equilibrium, finger", disc(family=family), add("finger.tensions", k, 1e-6 * PULL))
      for family in ("arc", "clothoid", "matched_clothoid") for k in (0, 1)),
    ("finger equilibrium, finger", cases.wrapped_disc, of_moment),
    ("finger equilibrium, finger", standing(0.05, 0.02), add("finger.tensions", 0, 1e-7 * 9.81 * 0.03 * L / ARM)),
    ("finger equilibrium, finger", standing(0.0, 0.0, 5.0), add("finger.tensions", 0, 1e-9 * 5.0)),
    ("finger equilibrium, finger", standing(0.0, 0.0), add("finger.tensions", 0, 1e-11 * EI / L / ARM)),
    *(("tip moment balance, finger", disc(), add("finger.tensions", k, 1e-6 * PULL)) for k in (0, 1)),
    *(row for index in ((30, 0), (60, 0), (30, 1), (30, 2)) for row in
      both("stored backbone, finger", disc(), "finger.backbone", index, 1e-6 * L)),
    *both("stored backbone, finger", disc(), "finger.backbone", (0, 0), 1e-6 * L),
    *both("stored backbone, finger", disc(), "finger.backbone", (30, 3), 1e-6),
    ("stored backbone, finger", disc(), turned_back),
    *(("stored backbone, finger", disc(), other_end(end, sign)) for end, sign in ((0, 1.0), (60, 1.0), (60, -1.0))),
    *both("stored tip curvature, finger", disc(family="arc"), "finger.tip_curvature", (), 1e-6 / L),
    *(row for k, unit in ((0, L), (1, L), (2, 1.0)) for row in
      both("base, finger", disc(), "finger.base", k, 1e-6 * unit)),
    *(("base, finger", lambda: free_base(*cases.squeezed_disc()), put("finger.base", k, end, sign * 1e-6 * unit))
      for k, end, sign, unit in (
          (0, -0.01, -1, L), (0, 0.02, 1, L), (1, 0.04, 1, L), (2, -0.2, -1, 1), (2, 0.1, 1, 1))),
    *(("tendon tension, finger", disc(), put("finger.tensions", k, 60.0, 60e-6)) for k in (0, 1)),
    *(("tendon tension, finger", disc(), put("finger.tensions", k, 0.0, -60e-6)) for k in (0, 1)),
    ("tendon tension, finger",
     changed_finger(disc(), tendons=Tendons(offset=ARM, max_tension=60.0, min_tension=2.0)),
     put("finger.tensions", slice(None), (5.0, 2.0), (0.0, -60e-6))),
    *(("tendon tension, finger", changed_finger(disc(), tendons_used=used),
       put("finger.tensions", k, 0.0, sign * 60e-6))
      for used, k in (("left", 1), ("right", 0)) for sign in (1.0, -1.0)),
    *both("element lengths, finger", disc(), "finger.lengths", 0, 1e-6 * L),
    ("element lengths, finger", disc(), short_element),
    *(("position along the finger, finger.middle", cases.wrapped_disc,
       scene_with("contacts.middle_range", np.array(ends), np.array(slope) * 1e-6 * 0.18))
      for ends, slope in (((WRAPPED_AT, 0.17), (1, 0)), ((0.01, WRAPPED_AT), (0, -1)))),
    *(("bending strain, finger", changed_finger(case, rod=STRAINED),
       scene_with("finger.strain_limit", CURVED * 0.6e-3, -1e-6 * CURVED * 0.6e-3)) for case in WRAPPED),
    *(("bending strain, finger", case, scene_with("fingers.finger.strain_limit", most, -1e-6 * most))
      for case, most in JUMPS),
    *(("bending range, finger", case, scene_with("fidelity.bending_range", TURN, -1e-6 * TURN)) for case in WRAPPED),
]  # fmt: skip

OBJECT = [
    *(row for k, unit in ((0, R), (1, R), (2, 1.0)) for row in
      both("object pose", disc(), "object.pose", k, 1e-6 * unit)),
    *(("object pose", cases.pinched_box, put("object.pose", k, sign * 0.02, sign * 1e-6 * CORNER))
      for k in (0, 1) for sign in (1.0, -1.0)),
    *both("object force balance", disc(), "contact_forces", (0, 1), 1e-6 * PRESS),
    *both("object force balance", disc(), "contact_forces", (1, 0), 1e-6 * PRESS),
    *both("object force balance", HEAVY, "contact_forces", (1, 0), 39.24e-6),
    *both("object moment balance", disc(), "contact_forces", (0, 1), 1e-6 * PRESS),
    *both("object moment balance", cases.pinched_box, "contact_forces", (0, 1), 1e-6 * 6.0 * CORNER / 0.03),
    *both("object force balance", disc(), "contact_forces", (0, 2), 1e-6 * PRESS),
    ("object force balance", disc(),
     put("contact_forces", (slice(None), 2), (3.0, 9.81 * MASS - 3.0), (0, 1e-6 * PRESS))),  # one pushes down
    *both("object force balance", cases.two_fingers_below, "contact_forces", (0, 2), 1e-6 * 1.962),
    *both("object moment balance", disc(), "contact_forces", (0, 2), 1e-6 * PRESS),
    *both("object moment balance", cases.pinched_box, "contact_forces", (0, 2), 1e-6 * 6.0 * CORNER / 0.03),
]  # fmt: skip

# -- clearance --------------------------------------------------------------------------------------------------------

DEEP = 1e-4 * L


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
    return far(supports={"wall": palm}, values={"finger": {"q": (0.5 * turn, 0.5 * turn)}}, family="arc")


def dipping(part):
    """An arc whose base lies in a wall dips below its base and out again: by (1 - cos(s k)) / k at the place s."""
    s = 4 * L / 400
    curve = brentq(lambda k: (1.0 - math.cos(s * k)) / k - part * DEEP, 1e-3, 1e3)
    base = (0.0, -1e-3, -0.5 * math.pi - s * curve)
    finger = cases.make_finger(base[:2], base[2])
    palm = Palm(point=(0.0, 0.0), normal_angle=0.5 * math.pi)
    values = {"finger": {"q": (0.5 * L * curve, 0.0)}}
    return far(supports={"wall": palm}, fingers={"finger": finger}, values=values, family="arc")


def crossed(part):
    """A thin finger that reaches through a line."""
    y = L - part * DEEP
    line = Line(type="line", start=(-0.05, y), end=(0.05, y))
    return far(supports={"wall": line}, fingers={"finger": cases.make_finger(half=0.0)})


def beside_bent(part):
    """A peg beside the middle of an arc about (-1 / k, 0)."""
    curve = 5.0
    turn, reach = 0.5 * L * curve, 1.0 / curve + HALF + 0.01 - part * DEEP
    peg = Point(type="point", position=(reach * math.cos(turn) - 1.0 / curve, reach * math.sin(turn)), radius=0.01)
    return far(supports={"wall": peg}, values={"finger": {"q": (turn, turn)}}, family="arc")


def sunk(body, support):
    """An object that touches a support, sunk into it by what is stored of its pose."""

    def build(part):
        scene, arrays = far(body, supports={"rest": support})
        arrays["object.pose"][1] -= part * DEEP
        return scene, arrays

    return build


def above(y):
    return Circle(shape="circle", diameter=2 * R, mass=0.0, position=(0.5, y + R))


def side_by_side(part):
    """Two parallel fingers, of which the second is the longer one."""
    rod = Rod(length=0.3, linear_density=1e-12, bending_stiffness=EI)
    fingers = {"a": cases.make_finger(), "b": cases.make_finger((2 * HALF, 0.0), rod=rod)}
    return far(fingers=fingers, values={"b": {"base": (2 * HALF - part * 1e-4 * 0.3, 0.0, 0.0)}})


def tapered(first, last, position=(0.0, 0.0), angle=0.0):
    section = {"to": L, "bending_stiffness": EI, "linear_density": 1e-12, "thickness": (2 * first, 2 * last)}
    return cases.make_finger(position, angle, None, rod=Rod(length=L, sections=(section,)))


THIN, THICK = 0.006, 0.02


def beyond_thick_end(kind, tip=True):
    """What a tapered finger meets straight ahead of its thick end, tip or base."""

    def build(part):
        finger = tapered(THIN, THICK) if tip else tapered(THICK, THIN, (0.0, L), math.pi)
        y = L + THICK - part * DEEP
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
SQUARE = Box(shape="box", width=0.06, height=0.06, mass=0.0, angle=math.pi / 4, position=(0.5, 0.03 * 2**0.5))
CLEARANCE = [(check, None, of_case(build)) for check, build in (
    ("penetration into the object, finger", beside_disc),
    ("penetration into the object, finger", beside_corner),
    ("penetration into wall, finger", below(
        lambda part: Palm(point=(1.0, L + HALF - part * DEEP), normal_angle=-0.5 * math.pi))),
    ("penetration into wall, finger", below(  # its end lies between two samples
        lambda part: Line(type="line", start=(HALF - part * DEEP, 0.1 + L / 1600), end=(0.1, 0.1 + L / 1600)))),
    ("penetration into wall, finger", bent_back),
    ("penetration into wall, finger", dipping),
    ("penetration into wall, finger", crossed),
    ("penetration into wall, finger", below(  # between two samples
        lambda part: Point(type="point", position=(HALF + 0.01 - part * DEEP, 0.1 + L / 1600), radius=0.01))),
    ("penetration into wall, finger", beside_bent),
    *(("penetration of the object into rest", sunk(body, support)) for body, support in (
        (above(0.0), Palm(point=(9.0, 0.0), normal_angle=0.5 * math.pi)),
        (above(0.0), REST),
        (SQUARE, REST),  # a corner that pokes through
        (above(0.01), Point(type="point", position=(0.5, 0.0), radius=0.01)),
    )),
    ("overlap of fingers, a, b", side_by_side),
    ("penetration into the object, finger", beyond_thick_end("object")),
    ("penetration into wall, finger", beyond_thick_end("peg")),
    ("penetration into wall, finger", beyond_thick_end("peg", tip=False)),
    ("penetration into wall, finger", beyond_thick_end("line")),
    ("overlap of fingers, a, b", beyond_thick_end("finger")),
)]  # fmt: skip

# -- drives, and postures with other friction states ------------------------------------------------------------------

CABLE = {"axial_stiffness": 1e4, "series_stiffness": 1.0 / 3e-5}
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


def held(*args, **more):
    """The same with postures of fingers that were pulled, released, and released in one cell alone."""

    def build():
        scene, arrays = driven(*args, friction=0.1, **more)()
        count = max(columns.stop for columns in scene.state_columns.values())
        states = np.concatenate([np.ones((1, count)), -np.ones((1, count)), 1.0 - 2.0 * np.eye(count)])
        each = {key: np.stack([value] * len(states)) for key, value in arrays.items() if not key.endswith(".family")}
        each |= {f"{name}.friction_states": states[:, columns] for name, columns in scene.state_columns.items()}
        return scene, arrays | {f"held.{key}": value for key, value in each.items()}

    return build


def pinched_disc(**free):
    """Two fingers alone hold a disc, which may yield."""
    return lambda: cases.pinched_box(
        at=0.0, family="arc", body=lambda values: Circle(shape="circle", diameter=0.06, **values | free)
    )


def free_on_palm():
    """An object whose pose is chosen yields beside a support, too."""
    scene, arrays = cases.squeezed_disc(radius=R, mass=MASS, press=PRESS, family="arc")
    return scene.replaced(object=scene.object.replaced(free=Freedom(angle=(-1.0, 1.0)))), arrays


def slipping(scene, arrays, part):
    """The contacts bear the weight out of the plane at a part of what other friction states may exceed a cone by."""
    return scene.changed({"contacts.friction": (0.5 * 9.81 * MASS - part * 1e-4 * PRESS) / PRESS}), arrays


POSTURE = "held with friction states, 1"
DRIVES = [
    *(("torque, finger", driven(MOTOR), put("finger.tensions", k, MOST, 1e-6 * 0.4 / 0.008)) for k in (0, 1)),
    *(("torque, finger", driven(MOTOR.replaced(**ONE)),
       put("finger.tensions", slice(None), pulls, np.array(way) * 1e-6 * 0.4 / 0.008))
      for pulls, way in (((MOST + 5.0, 5.0), (1, 0)), ((5.0, MOST + 5.0), (0, 1)))),
    *(row for k in (0, 1) for row in
      both("tendons of one pulley, finger", driven(MOTOR.replaced(**ONE)), "finger.tensions", k, 60e-6)),
    *(("friction states within their range", held(), put("held.finger.friction_states", (k, 1), sign, sign * 1e-6))
      for k, sign in ((0, 1.0), (1, -1.0))),
    (POSTURE, held(), slipping),
    *(row for k, unit in ((0, R), (1, R), (2, 1.0)) for row in both(POSTURE, held(), "object.pose", k, 1e-6 * unit)),
    *(row for k, unit in ((0, 0.03), (1, 0.03), (2, 1.0)) for row in
      both(POSTURE, held(case=pinched_disc()), "object.pose", k, 0.1 * unit)),
    *(row for case in (pinched_disc(free=None), free_on_palm) for row in
      both(POSTURE, held(case=case), "object.pose", 2, 0.1)),
    *(row for drive in (None, WINCH, MOTOR) for row in both(POSTURE, held(drive), "finger.tensions", 1, 60e-6)),
    # A servo lets the cable yield by r^2 / k beside the compliance C of 50 um/N.
    *both(POSTURE, held(SERVO), "finger.tensions", 0, 60e-6 / (1.0 + 0.008**2 / 2.0 / 5e-5)),
    *(row for k in (0, 1) for row in both(POSTURE, held(MOTOR.replaced(**ONE)), "finger.tensions", k, 60e-6)),
    # A pulley is where the tendon of the greater tension has it: the other one alone changes what a servo yields.
    *((POSTURE, held(drive.replaced(**ONE)), add("finger.tensions", k, 60e-6 / (change / 5e-5)))
      for drive, change in ((WINCH, 5e-5), (SERVO, 5e-5 + 0.008**2 / 2.0), (SERVO, -(0.008**2) / 2.0))
      for k in (0, 1)),
    *both(POSTURE, held(), "finger.base", 0, 1e-6 * L),
    *both(POSTURE, held(), "held.contact_stations", (0, 0), 1e-6 * L),
]  # fmt: skip


@pytest.mark.parametrize(("check", "case", "change"), [*CONTACTS, *FINGERS, *OBJECT, *CLEARANCE, *DRIVES])
def test_a_check_holds_up_to_its_limit_and_no_further(check, case, change):
    for part, passes in ((0.999, True), (1.001, False)):
        scene, arrays = case() if case else (None, {})
        arrays = {key: np.array(value) for key, value in arrays.items()}
        assert certify(*change(scene, arrays, part))[check].passed is passes, part


# -- stability, model error, bound ------------------------------------------------------------------------------------


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
        certificate = certify(*case(part))
        assert certificate.stability.stable is (part < 1.0)
        # Whatever else of a hand-made grasp fails.
        certificate = replace(certificate, checks=())
        assert certificate.acceptable is (part < 1.0)
        assert not replace(certificate, checks=(Check("other", 1.001, 1.0),)).acceptable
        assert not replace(certificate, grasp=None).acceptable
        grasp = copy(certificate.grasp)
        grasp.scene = grasp.scene.replaced(stability="ignore")
        assert replace(certificate, grasp=grasp).acceptable


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
    press = arrays["contact_forces"][0, 0]
    assert failed["object moment balance"] * press * scene.object.size == pytest.approx(moment, rel=1e-9)
    assert "object moment balance" not in {c.name for c in certify(scene.replaced(upright=True), arrays).failed}
