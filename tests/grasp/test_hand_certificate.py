"""from inside: hands are certified from arrays made by hand, as no search gives them. Each check holds at 0.999 of its
limit and fails at 1.001; displacements out of the plane are closed forms.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.hand.body import BodySurface
from continuum_grasp.grasp.hand.certificate import certify_hand
from continuum_grasp.grasp.hand.surfaces import PlacedSolid
from tests import hand_cases as cases
from tests.hand_cases import EXTENTS, HALF, LENGTH, OFFSET, STIFFNESS

Z = np.array([0.0, 0.0, 1.0])
PRESS, MASS = 2.0, 0.05
FORCE = 0.5 * 9.81 * MASS
SCALE = math.hypot(PRESS, FORCE)
"""Greatest force in the grasp of a box."""
SIZE = float(np.linalg.norm(0.5 * EXTENTS - 0.004)) + 0.004


def test_a_grasp_in_closed_form_passes():
    certificate = certify_hand(*cases.squeezed_box(PRESS, MASS))
    assert certificate.passed, certificate
    left, right = certificate.contacts
    for contact, sign in ((left, -1.0), (right, 1.0)):
        assert contact.normal_force == pytest.approx(PRESS, rel=1e-12)
        assert contact.friction_force == pytest.approx(FORCE, rel=1e-12)
        assert contact.margin == pytest.approx(1.0 - FORCE / (0.5 * PRESS), rel=1e-9)
        assert contact.deflection == pytest.approx(sign * cases.sag(FORCE, PRESS) / LENGTH, rel=1e-9)
    assert str(len(certificate.checks)) in certificate.headline()


def test_torsional_friction_bears_moments_about_normals_within_the_cone():
    """The cone is |friction|^2 + (moment mu / gamma)^2 <= (mu N)^2 with gamma the torsional friction."""
    arm = 1e-3 / 0.5
    certificate = certify_hand(*cases.twisted_box())
    assert certificate.passed, certificate
    moment = 0.5 * 1e-3 * 9.81 * MASS
    for contact in certificate.contacts:
        assert contact.margin == pytest.approx(1.0 - math.hypot(FORCE, moment / arm) / (0.5 * PRESS), rel=1e-9)
    scene, arrays = cases.twisted_box()
    for missing in (
        arrays | {"contact_moments": np.zeros(2)},
        arrays | {"contact_moments": arrays["contact_moments"] * [1, -1]},
    ):
        assert [check.name for check in certify_hand(scene, missing).failed] == ["object moment balance"]
    without = {name: value for name, value in arrays.items() if name != "contact_moments"}
    assert [check.name for check in certify_hand(scene, without).failed] == ["missing or misshapen arrays"]
    # As much off the line as the cone bears, to 1e-6 of the greatest force.
    most = math.sqrt((0.5 * PRESS) ** 2 - FORCE**2) * arm
    for part, passes in ((0.999, True), (1.001, False)):
        offset = part * most / (0.5 * 9.81 * MASS)
        assert certify_hand(*cases.twisted_box(offset))["friction cone, left.tip"].passed is passes


# -- displacement out of the plane ------------------------------------------------------------------------------------

RATIO = 4.0
TORSION = 4 * RATIO**2 / (1 + RATIO**2) / (2 * 1.35) * STIFFNESS
FORCED = 0.1


def arc(turn):
    """Displacement of the end of an arc by a force on it across its plane (S. Timoshenko, Strength of Materials)."""
    r = LENGTH / turn
    bends = 0.5 * turn - 0.25 * math.sin(2 * turn)
    twists = 1.5 * turn - 2.0 * math.sin(turn) + 0.25 * math.sin(2 * turn)
    return FORCED * r**3 * (bends / cases.LATERAL + twists / TORSION)


@pytest.mark.parametrize("turn", [1e-3, 0.5, 1.8, 3.6, -1.8])
def test_an_arc_yields_to_a_force_across_its_plane(turn):
    scene, arrays = cases.one_finger(FORCED * Z, Z, turn / LENGTH)
    (contact,) = certify_hand(scene, arrays).contacts
    assert contact.deflection * LENGTH == pytest.approx(arc(turn), rel=1e-7)


def test_a_straight_finger_yields_to_a_force_at_its_end_or_ahead_of_it():
    for normal, length in ((Z, 0.0), ((1, 0, 0), 0.0), ((0, -1, 0), HALF), ((0, 1, 0), -HALF)):
        scene, arrays = cases.one_finger(FORCED * Z, normal)
        (contact,) = certify_hand(scene, arrays).contacts
        expected = FORCED * (LENGTH**3 / 3 + length * LENGTH**2 / 2) / cases.LATERAL
        assert contact.deflection * LENGTH == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("ends", [(14e-3, 8e-3), (6e-3, 12e-3)])
def test_a_cone_yields_to_a_force_to_the_side_ahead_of_its_end(ends):
    """E I = pi E d^4 / 64 with d linear along it: w = F int (L - s)(L - s + h) / E I ds, with h half the end."""
    modulus = 5e6
    rod = {"length": LENGTH, "youngs_modulus": modulus, "density": 1e-3, "sections": [{"to": LENGTH, "diameter": ends}]}
    tendons = [{"offset": side * 2e-3, "max_tension": 60.0} for side in (1.0, -1.0)]
    plain, arrays = cases.one_finger(FORCED * Z, (0, -1, 0))
    finger = {"rod": rod, "half_thickness": None, "section": {"shape": "round"}, "tendons": tendons}
    scene = plain.changed({f"hand.finger.{key}": value for key, value in finger.items()})
    (contact,) = certify_hand(scene, arrays).contacts
    s, weights = np.polynomial.legendre.leggauss(40)
    ahead = 0.5 * LENGTH * (1.0 - s)
    stiffness = math.pi / 64.0 * modulus * np.interp(LENGTH - ahead, [0.0, LENGTH], ends) ** 4
    expected = FORCED * (ahead * (ahead + 0.5 * ends[1]) / stiffness) @ weights * 0.5 * LENGTH
    assert contact.deflection * LENGTH == pytest.approx(expected, rel=1e-7)


def test_a_force_along_the_finger_does_not_bend_what_is_beyond_it():
    at = 0.04
    scene, arrays = cases.one_finger(FORCED * Z, Z, station=at)
    certificate = certify_hand(scene, arrays)
    (contact,), (finger,) = certificate.contacts, certificate.hand.fingers
    assert contact.deflection * LENGTH == pytest.approx(FORCED * at**3 / 3 / cases.LATERAL, rel=1e-9)
    tip = FORCED * at**2 * (3 * LENGTH - at) / 6 / cases.LATERAL
    assert finger.deflections[-1] == pytest.approx(tip, rel=1e-9)
    assert finger.slopes[-1] == pytest.approx(FORCED * at**2 / 2 / cases.LATERAL, rel=1e-9)


def exact_tip(turn, load):
    """Displacement out of the plane of the end of an arc by an exact Kirchhoff rod in space: shooting for the moment at
    the base. Tendons hold it in its plane as an arc while the force to the side is zero.
    """
    stiffness = np.array([TORSION, cases.LATERAL, STIFFNESS])  # of t, across and z
    curvature = turn / LENGTH
    whole = np.array([*load, 0.0])

    def frame(angle):
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[-s, -c, 0.0], [c, -s, 0.0], [0.0, 0.0, 1.0]])  # columns t, across, z

    steps = 100
    h = LENGTH / steps

    def flat(s):  # position of the arc
        if not curvature:
            return np.array([0.0, s, 0.0])
        return np.array([math.cos(curvature * s) - 1.0, math.sin(curvature * s), 0.0]) / curvature

    def at_rest(s):  # curvature about z with which the arc is in balance under the load in its plane
        return curvature - np.cross(flat(LENGTH) - flat(s), whole)[2] / STIFFNESS

    def rate(s, state, force):
        axes, moment = state[3:12].reshape(3, 3), state[12:]
        strain = axes.T @ moment / stiffness + [0.0, 0.0, at_rest(s)]
        spin = np.array([[0, -strain[2], strain[1]], [strain[2], 0, -strain[0]], [-strain[1], strain[0], 0]])
        return np.concatenate([axes[:, 0], (axes @ spin).ravel(), -np.cross(axes[:, 0], force)])

    def march(moment, force):
        state = np.concatenate([np.zeros(3), frame(0.0).ravel(), moment])
        for k in range(steps):  # Runge and Kutta
            s = k * h
            a = rate(s, state, force)
            b = rate(s + h / 2, state + h / 2 * a, force)
            c = rate(s + h / 2, state + h / 2 * b, force)
            state = state + h / 6 * (a + 2 * b + 2 * c + rate(s + h, state + h * c, force))
        return state

    def missed(moment, side):
        return march(moment, np.array([*load, side]))[12:]

    def displaced(side):
        moment = np.cross(flat(LENGTH), np.array([*load, side]))
        for _ in range(4):
            off = missed(moment, side)
            slopes = np.array([(missed(moment + d, side) - off) / 1e-7 for d in 1e-7 * np.eye(3)]).T
            moment = moment - np.linalg.solve(slopes, off)
        return march(moment, np.array([*load, side]))[2]

    return (displaced(1e-4) - displaced(-1e-4)) / 2e-4


@pytest.mark.deep
@pytest.mark.parametrize("turn", [0.0, 0.8, 2.5])
@pytest.mark.parametrize("load", [(0.3, 0.0), (0.0, -0.5), (-0.4, 0.6), (0.3, 0.9)])
def test_forces_in_the_plane_act_on_the_displaced_finger_as_on_an_exact_rod(turn, load):
    shifts = []
    for side in (1e-3, -1e-3):
        (contact,) = certify_hand(*cases.one_finger(np.array([*load, side]), Z, turn / LENGTH)).contacts
        shifts.append(contact.deflection * LENGTH)
    # The couple of the force in the plane is in both.
    assert (shifts[0] - shifts[1]) / 2e-3 == pytest.approx(exact_tip(turn, load), rel=1e-6)


def test_an_own_weight_across_the_plane_bends_a_finger():
    scene, arrays = cases.one_finger(0 * Z, Z, gravity=(0.0, 0.0, -9.81), density=0.02)
    (contact,) = certify_hand(scene, arrays).contacts
    assert contact.deflection * LENGTH == pytest.approx(-0.02 * 9.81 * LENGTH**4 / 8 / cases.LATERAL, rel=1e-9)


# -- limits -----------------------------------------------------------------------------------------------------------


def add(name, index, amount):
    """A part of a limit added to a stored number of the box's grasp."""

    def build(part):
        scene, arrays = cases.squeezed_box(PRESS, MASS)
        arrays[f"contact_{name}"][index] += part * amount
        return scene, arrays

    return build


def put(finger, tension):
    def build(part):
        scene, arrays = cases.squeezed_box(PRESS, MASS)
        arrays[f"{finger}.tensions"][0] = tension(part)
        return scene, arrays

    return build


def body(**changes):
    """The box with other values, by the part."""
    return lambda part: cases.squeezed_box(PRESS, MASS, {key: value(part) for key, value in changes.items()})


def contacts(**changes):
    return lambda part: cases.squeezed_box(PRESS, MASS, **{key: value(part) for key, value in changes.items()})


def heavier(part):
    """As heavy as displaces the fingers by 3 % of their length."""
    return cases.squeezed_box(9.0, part * 0.03 * LENGTH / cases.sag(0.5 * 9.81, 9.0))


def pulling(part):
    return cases.squeezed_box(-part * 1e-6 * 9.81 * MASS, MASS)


def beside(sine, kind):
    """A straight finger beside a box with a face at x = 0, and leaning away from it."""

    def build(part):
        lean = part * sine
        along = np.array([lean, math.sqrt(1 - lean**2), 0.0])
        at = LENGTH if kind == "tip" else 0.5 * LENGTH
        base = np.array([HALF, 0.0, 0.0]) - at * along
        switch = {"middle": "off", "tip": "off", kind: "on"}
        box = {
            "shape": "box",
            "extents": (0.02, 0.02, 0.02),
            "edge_radius": 0.001,
            "mass": 0.0,
            "position": (-0.01, 0, 0),
        }
        scene = cases.make_scene({"finger": (base, along, (-1, 0, 0))}, box, switch)
        touch = [(f"finger.{kind}", (0, 0, 0), (1, 0, 0), (0, 0, 0), at, 0.0)]
        return scene, cases.stored(scene, touch)

    return build


def sunk(part):
    """A straight finger beside a box, with no contact."""
    base = (HALF - part * 1e-4 * LENGTH, -0.06, 0.0)
    box = {"shape": "box", "extents": (0.02, 0.02, 0.02), "edge_radius": 0.001, "mass": 0.0, "position": (-0.01, 0, 0)}
    scene = cases.make_scene({"finger": (base, (0, 1, 0), (-1, 0, 0))}, box, {"tip": "auto"})
    return scene, cases.stored(scene, [])


def sagged(part):
    """A finger that a force to the side pushes down upon a box under its end."""
    w = FORCED * LENGTH**3 / 3 / cases.LATERAL
    top = -HALF - w + part * 1e-4 * LENGTH
    bases = {"finger": ((0, 0, 0), (0, 1, 0), (-1, 0, 0))}
    box = {"shape": "box", "extents": (0.02, 1e-3, 0.02), "edge_radius": 5e-4, "mass": 0.0}
    scene = cases.make_scene(bases, {**box, "position": (0, LENGTH, top - 0.01)}, {"tip": "auto"})
    return scene, cases.stored(scene, [("finger.tip", (0, 0, 0), Z, -FORCED * Z, LENGTH, -w)])


def two(second, direction):
    """Two straight fingers that touch nothing else."""
    bases = {"a": ((0, 0, 0), (0, 1, 0), (-1, 0, 0))}

    def build(part):
        bases["b"] = (np.array(second) - part * 1e-4 * LENGTH * Z, direction, (0, 0, 1))
        scene = cases.make_scene(bases, {**cases.AWAY, "position": (-0.05, 0.05, -0.05)}, {"tip": "auto"})
        return scene, cases.stored(scene, [])

    return build


def middle_at(part):
    """A contact along the finger beyond where it may be."""
    scene, arrays = beside(0.0, "middle")(part)
    high = 0.5 * LENGTH - part * 1e-6 * LENGTH
    return scene.changed({"contacts.middle_range": (0.01, high)}), arrays


def bent(part):
    curve = (1.0 + part * 1e-6) * 2.0 / LENGTH
    scene, arrays = cases.one_finger((0, 0, 0), Z, curve)
    return scene.changed({"fidelity.bending_range": 1.0}), arrays


BALL = {"shape": "sphere", "diameter": 0.05, "position": (0.0, 0.0, 0.1)}


def on_table(name="forces", amount=(0.0, 0.0, 0.0), sunk=0.0, **more):
    """A ball on a table; an array of its contact off by a part of an amount, or the table by a height."""

    def build(part):
        scene, arrays = cases.resting(BALL, [(0.0, 0.0, 0.0)], MASS, **more)
        arrays[f"contact_{name}"][0] += part * np.array(amount)
        table = scene.table.replaced(point=(0.0, 0.0, part * sunk))
        return scene.model_copy(update={"table": table}), arrays  # not checked anew

    return build


def beside_pole(part):
    """The stored place of a ball is beside its pole."""
    scene, arrays = on_table()(part)
    turn = math.acos(1.0 - part * 2e-6)
    arrays["contact_positions"][0] = 0.025 * np.array([math.sin(turn), 0.0, 1.0 - math.cos(turn)])
    return scene, arrays


def over_rim(part):
    """A cylinder lies against a palm by its upper end; one stored place is beside the disc."""
    tube = {"shape": "cylinder", "diameter": 0.05, "height": 0.08, "edge_radius": 0.003, "position": (0.0, 0.0, -0.1)}
    body = {**tube, "mass": 0.0, "against": "palm"}
    bases = {"finger": ((0.1, 0, 0), (0, 0, -1), (-1, 0, 0))}
    scene = cases.make_scene(bases, body, {"tip": "auto"}, palm={"radius": 0.01})
    at = (0.01 + part * 2e-6 * scene.object.size, 0.0, 0.0)
    return scene, cases.stored(scene, [("palm_1", at, (0, 0, 1), (0, 0, 0), 0.0, 0.0)])


def over_table(part):
    """A straight finger that comes down to the table with its tip."""
    drop, base = 0.02, np.array([0.1, -0.06, HALF + 0.02 - part * 1e-4 * LENGTH])
    along = (0, math.sqrt(1.0 - (drop / LENGTH) ** 2), -drop / LENGTH)
    return cases.resting(BALL, [(0.0, 0.0, 0.0)], MASS, base=(base, along, (1, 0, 0)))


WIDER = np.array([2e-6 * LENGTH, 0.0, 0.0])
"""By which both gaps are off as far as they may be [m]."""
ARM = 1e-6 * SCALE * SIZE / (2 * FORCE)
"""Center of mass beside the middle, by which the weight has the moment that the balance may be off [m]."""
LIMITS = [
    ("finger equilibrium, left", put("left", lambda part: part * 1e-6 * 0.01 * PRESS * LENGTH / OFFSET)),
    ("tip moment balance, left", put("left", lambda part: part * 1e-6 * 0.01 * PRESS * LENGTH / OFFSET)),
    ("tendon tension, left", put("left", lambda part: 60.0 * (1 + part * 1e-6))),
    ("bending range, finger", bent),
    ("position along the finger, finger.middle", middle_at),
    *(("object force balance", body(mass=lambda part, sign=sign: MASS + sign * part * 1e-6 * SCALE / 9.81))
      for sign in (1, -1)),
    *(("object force balance", add("forces", (0, k), sign * 1e-6 * SCALE)) for k in (0, 1) for sign in (1, -1)),
    *(("object moment balance",
       body(center_of_mass=lambda part, k=k, sign=sign: tuple(sign * part * ARM * np.eye(3)[k])))
      for k in (0, 1) for sign in (1, -1)),
    ("friction cone, left.tip", contacts(friction=lambda part: (FORCE - part * 1e-6 * SCALE) / PRESS)),
    ("friction cone, right.tip", contacts(friction=lambda part: (FORCE - part * 1e-6 * SCALE) / PRESS / 0.8,
                                          reserve=lambda part: 0.2)),
    ("normal force, left.tip", contacts(normal_force_max=lambda part: PRESS / (1 + part * 1e-6))),
    ("normal force, right.tip", pulling),
    *(("stored contact, right.tip", add(key, (1, k), sign * amount)) for k in range(3) for sign in (1, -1)
      for key, amount in (("positions", 1e-6 * LENGTH), ("normals", 1e-6))),
    *(("stored contact, right.tip", add("stations", 1, sign * 1e-6 * LENGTH)) for sign in (1, -1)),
    *(("contact gap, left.tip", body(extents=lambda part, sign=sign: tuple(EXTENTS + sign * part * WIDER)))
      for sign in (1, -1)),
    *(("shift to the side, left.tip", add("deflections", 0, sign * 1e-6 * LENGTH)) for sign in (1, -1)),
    ("lateral deflection, left.tip", heavier),
    ("lateral deflection, right.tip", heavier),
    ("contact direction, finger.tip", beside(1e-3 + 1e-6, "tip")),
    ("contact tangency, finger.middle", beside(1e-6, "middle")),
    ("contact tangency, finger.middle", beside(-1e-6, "middle")),
    ("friction cone, table_1", on_table("forces", (0.5 * 9.81 * MASS, 0.0, 0.0))),
    ("normal force, table_1",
     on_table(amount=(0.0, 0.0, -9.81 * MASS * 1e-6), contacts={"normal_force_max": 9.81 * MASS})),
    *(("stored contact, table_1", on_table(key, amount)) for key, amount in
      (("positions", (0, 0, 0.025e-6)), ("normals", (0, 1e-6, 0)), ("stations", 0.025e-6), ("deflections", 0.025e-6))),
    ("contact gap, table_1", beside_pole),
    ("contact gap, table_1", on_table(sunk=-2e-6 * 0.025)),
    ("penetration into the table", on_table(sunk=2e-6 * 0.025)),
    ("contact gap, palm_1", over_rim),
    ("penetration into the table, finger", over_table),
    ("penetration into the object, finger", sunk),
    ("penetration into the object, finger", sagged),
    ("overlap of fingers, a, b", two((0, 0.05, 2 * HALF), (0, 1, 0))),
    ("overlap of fingers, a, b", two((-0.05, 0.0601, 2 * HALF), (1, 0, 0))),
    ("overlap of fingers, a, b", two((0, LENGTH, 2 * HALF), (0, 1, 0))),
]  # fmt: skip


@pytest.mark.parametrize(("check", "case"), LIMITS)
def test_a_check_holds_up_to_its_limit_and_no_further(check, case):
    for part, passes in ((0.999, True), (1.001, False)):
        assert certify_hand(*case(part))[check].passed is passes, part


@pytest.mark.parametrize(("touch", "names"), [("off", ["table_1"]), ("on", ["table_1", "table_1"])])
def test_contacts_with_supports_are_those_of_the_scene(touch, names):
    scene, arrays = cases.resting(
        BALL, [(0.0, 0.0, 0.0)] * len(names), MASS, table={"point": (0, 0, 0), "touch": touch}
    )
    arrays["contact_names"] = np.array(names, dtype=str)
    assert not certify_hand(scene, arrays)["contacts match the scene"].passed


def test_a_finger_that_passes_through_itself_is_seen():
    for turn, passes in ((3.0, True), (7.5, False)):
        scene, arrays = cases.one_finger((0, 0, 0), Z, turn / LENGTH)
        assert certify_hand(scene, arrays)["passes through itself, finger"].passed is passes


@pytest.mark.parametrize("names", [["left.tip"], ["left.tip", "left.tip"], ["left.tip", "right.middle"]])
def test_contacts_that_the_scene_does_not_have_are_seen(names):
    scene, arrays = cases.squeezed_box(PRESS, MASS)
    arrays = {key: value[: len(names)] if key.startswith("contact_") else value for key, value in arrays.items()}
    failed = {check.name for check in certify_hand(scene, {**arrays, "contact_names": np.array(names)}).failed}
    assert "contacts match the scene" in failed


def test_what_is_missing_misshapen_or_not_finite_is_no_grasp():
    scene, arrays = cases.squeezed_box(PRESS, MASS)
    for key, value in arrays.items():
        lacking = certify_hand(scene, {name: one for name, one in arrays.items() if name != key})
        assert lacking.hand is None
        assert not lacking.acceptable
        if value is not None and np.asarray(value).dtype.kind == "f":
            assert not certify_hand(scene, {**arrays, key: np.asarray(value) * np.nan}).passed
            assert not certify_hand(scene, {**arrays, key: np.append(np.ravel(value), 0.0)}).passed


# -- surfaces ---------------------------------------------------------------------------------------------------------

TURNED = {"position": (0.01, -0.02, 0.03), "rotation": (0.3, -0.5, 0.9), "mass": 0.1}
BOX = {"shape": "box", "extents": (0.04, 0.05, 0.06), "edge_radius": 0.004}
TUBE = {"shape": "cylinder", "diameter": 0.05, "height": 0.08, "edge_radius": 0.003}
EGG = {"shape": "ellipsoid", "extents": (0.04, 0.06, 0.1)}


def unit(*vector):
    return np.array(vector) / np.linalg.norm(vector)


def egg(direction):
    """Point of an ellipsoid and its normal, by the parameter of its sphere."""
    half = np.array([0.02, 0.03, 0.05])
    return half * direction, unit(*(direction / half))


PLACES = [
    ({"shape": "sphere", "diameter": 0.06}, 0.03 * unit(1, 2, -3), unit(1, 2, -3)),
    *((EGG, *egg(unit(*v))) for v in ((1, 2, -3), (0, 0, 1), (1, 0, 0), (-1, 1, 0.01), (0, -1e-9, 1))),
    (BOX, np.array([0.02, 0.01, -0.02]), np.array([1.0, 0, 0])),
    (BOX, np.array([-0.01, 0.02, -0.03]), np.array([0, 0, -1.0])),
    (BOX, np.array([0.016, -0.021, 0.01]) + 0.004 * unit(1, -2, 0), unit(1, -2, 0)),
    (BOX, np.array([0.016, -0.021, 0.026]) + 0.004 * unit(1, -2, 3), unit(1, -2, 3)),
    (TUBE, np.array([*(0.025 * unit(-3, 4)), 0.02]), unit(-3, 4, 0)),
    (TUBE, np.array([0.01, 0.005, -0.04]), np.array([0, 0, -1.0])),
    (TUBE, np.array([0.022 * 0.6, 0.022 * 0.8, 0.037]) + 0.003 * unit(0.6, 0.8, 2), unit(0.6, 0.8, 2)),
]


@pytest.mark.parametrize(("shape", "place", "normal"), PLACES)
def test_points_off_a_surface_find_the_place_they_left(shape, place, normal):
    scene = cases.make_scene({"finger": ((0, 0, 0.1), (0, 0, -1), (1, 0, 0))}, {**shape, **TURNED})
    body, surface = scene.object, PlacedSolid(scene)
    position = np.array(TURNED["position"])
    for away in (0.05, 1e-4, 0.0, -1e-3):
        near = surface.nearest(position + body.axes @ (place + away * normal))
        assert near.distance == pytest.approx([away], abs=1e-15 + 1e-12 * abs(away))
        np.testing.assert_allclose(near.point[0], position + body.axes @ place, atol=1e-12)
        np.testing.assert_allclose(near.normal[0], body.axes @ normal, atol=1e-9)


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, -2, 0.5)])
@pytest.mark.parametrize("solid", [BALL, BOX, TUBE, EGG])
def test_the_height_over_a_plane_is_that_of_the_support_function(solid, normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    scene = cases.make_scene({"finger": ((0, 0, 0.1), (0, 0, -1), (1, 0, 0))}, {**solid, **TURNED})
    body, local = scene.object, normal @ scene.object.axes
    across = math.hypot(local[0], local[1])
    reach = {
        "sphere": lambda: 0.025,
        "box": lambda: np.abs(local) @ (0.5 * np.array(body.extents) - 0.004) + 0.004,
        "cylinder": lambda: 0.022 * across + 0.037 * abs(local[2]) + 0.003,
        "ellipsoid": lambda: float(np.linalg.norm(0.5 * np.array(body.extents) * local)),
    }[body.shape]()
    point = np.array([0.1, 0.2, -0.1])
    expected = normal @ (np.array(body.position) - point) - reach
    assert PlacedSolid(scene).height(point, normal) == pytest.approx(expected, abs=1e-9)


# -- shapes without closed forms ---------------------------------------------------------------------------------------

STAR = [[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [0.0, 0.0], [-0.03, 0.03]]
SWEPT = {
    "cone": {"shape": "cone", "diameter_below": 0.06, "diameter_above": 0.02, "height": 0.05, "edge_radius": 0.002},
    "ring": {"shape": "revolve", "profile": {"shape": "circle", "diameter": 0.02, "position": (0.03, 0.0)}},
    "waist": {},
    "notch": {
        "shape": "extrude",
        "outline": {"shape": "polygon", "vertices": STAR},
        "height": 0.05,
        "edge_radius": 0.003,
    },
    "flattened": {"shape": "superquadric", "extents": (0.05, 0.06, 0.07), "exponents": (3.0, 8.0)},
    "boxy": {"shape": "superquadric", "extents": (0.05, 0.06, 0.07), "exponents": (12.0, 12.0)},
    "knob": {"shape": "mesh", "file": "configs/hand/knob.stl", "scale": 1e-3},
}
"""Objects whose distances the search and the certificate compute by different programs."""


def swept(name):
    shape = SWEPT[name]
    if name == "waist":  # drawings become polygons with the file of a scene
        shape = {"shape": "revolve", "profile": cg.load("configs/hand/bottle.yaml").object.profile}
    return cases.make_scene({"finger": ((0, 0, 0.1), (0, 0, -1), (1, 0, 0))}, {**shape, **TURNED})


def around(scene, count=200):
    points = np.random.default_rng(1).normal(size=(count, 3))
    points *= (0.035 + 0.02 * np.linspace(0.0, 1.0, count) ** 2)[:, None] / np.linalg.norm(points, axis=1)[:, None]
    return np.array(scene.object.position) + points


@pytest.mark.parametrize("name", SWEPT)
def test_search_and_certificate_agree_on_distances_and_normals(name):
    scene = swept(name)
    points = around(scene, 80)
    mine, other = BodySurface(scene).near(points), PlacedSolid(scene).nearest(points)
    outside = mine.distance > 1e-3
    assert np.abs(mine.distance - other.distance)[outside].max() < 1e-12
    assert np.abs(mine.normal - other.normal)[outside].max() < 1e-7
    scanned, _ = BodySurface(scene).distance(points)
    reached = outside & (mine.distance < 0.01)  # farther away, scans of meshes take few samples
    assert np.abs(scanned - mine.distance)[reached].max() < 1e-4 * scene.object.size


@pytest.mark.parametrize("name", SWEPT)
def test_distances_are_those_from_points_of_the_surface(name):
    scene = swept(name)
    corners, triangles = BodySurface(scene).triangles()
    places = corners[triangles]
    # Six points on each triangle: of these, the nearest is half an edge away at most.
    shares = np.array([[i, j, 2 - i - j] for i in range(3) for j in range(3 - i)]) / 2.0
    cloud = np.einsum("sk,tkx->tsx", shares, places).reshape(-1, 3)
    points = around(scene, 15)
    brute = np.array([np.linalg.norm(cloud - point, axis=1).min() for point in points])
    found = BodySurface(scene).near(points).distance
    outside = found > 2e-3
    edge = np.linalg.norm(np.diff(places, axis=1), axis=2).max()
    assert (brute - found)[outside].min() > -1e-4
    assert (brute - found)[outside].max() < edge**2 / 4.0 / 2e-3


@pytest.mark.parametrize("name", SWEPT)
def test_derivatives_of_distances_are_differences(name):
    scene = swept(name)
    surface, points, step = BodySurface(scene), around(scene, 60), 1e-6
    near = surface.near(points)
    slope = np.stack([
        (surface.near(points + step * axis).distance - surface.near(points - step * axis).distance) / (2 * step)
        for axis in np.eye(3)
    ], axis=1)  # fmt: skip
    turning = np.stack([
        (surface.near(points + step * axis).normal - surface.near(points - step * axis).normal) / (2 * step)
        for axis in np.eye(3)
    ], axis=2)  # fmt: skip
    outside = near.distance > 2e-3
    gradient = near.normal if near.slope is None else near.slope
    assert np.median(np.abs(gradient - slope)[outside].max(axis=1)) < 1e-7
    off = np.abs(near.bending - turning)[outside].max(axis=(1, 2))
    # Of a mesh the derivative is made symmetric; at seams of lines and arcs curvatures jump.
    assert np.percentile(off, 80) < (1e-4 if near.slope is None else 1.0)
