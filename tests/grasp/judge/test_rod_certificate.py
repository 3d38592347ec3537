"""The certificate of grasps of rods passes sound grasps and measures changes; from inside: no door leads to it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import held_cases
import numpy as np
import pytest
from held_cases import contact_of, held_hand, held_plane, with_contact
from scipy.integrate import solve_bvp

import continuum_grasp as cg
from benchmarks.grasp_images import mirrored, moved
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.judge.check import Requirement
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.nlp import Budget, blocks
from continuum_grasp.scene import Tendons
from tests import certificate_cases as cases
from tests import hand_cases
from tests.marks import few
from tests.test_imports import PACKAGE, imports

CONFIGS = Path(cg.__file__).parents[1] / "configs" / "grasp"
CLOSED = {
    "disc against a palm": cases.squeezed_disc,
    "finger without thickness": lambda: cases.squeezed_disc(half=0.0),
    "two fingers below a disc": cases.two_fingers_below,
    "pinched box": cases.pinched_box,
    "pinched box, turned": lambda: cases.pinched_box(turn=0.7),
    "disc in a groove": cases.disc_in_groove,
    "box on a line": cases.box_on_line,
    "disc on pegs": cases.disc_on_pegs,
    "disc on points": lambda: cases.disc_on_pegs(peg=0.0),
    "union on a palm": cases.union_on_palm,
}


def shares(certificate):
    """Greatest share of its limit per property."""
    found = {}
    for check in certificate.checks:
        found[check.requirement] = max(found.get(check.requirement, -np.inf), check.share)
    return found


def failed(certificate):
    return {check.requirement for check in certificate.failed}


@pytest.mark.parametrize("case", CLOSED.values(), ids=CLOSED)
def test_grasps_in_closed_form_pass(case):
    scene, arrays = case()
    certificate = certify_held(scene, held_plane(scene, arrays))
    assert certificate.passed
    # Straight fingers are exact: what is left is rounding.
    assert certificate.worst.share < 1e-3


def test_the_record_of_a_shape_is_not_trusted():
    """The arcs of a wrapped finger are no shape of a rod under these loads."""
    scene, arrays = cases.wrapped_disc()
    certificate = certify_held(scene, held_plane(scene, arrays))
    assert {Requirement.GAP, Requirement.TANGENT} <= failed(certificate)


# -- changes by known amounts --------------------------------------------------------------------------------------


def pinched():
    scene, arrays = cases.pinched_box(press=6.0, mass=0.3)
    return scene, held_plane(scene, arrays)


def test_a_gap_is_measured_as_it_is():
    scene, held = pinched()
    shift = 3e-5
    certificate = certify_held(scene, replace(held, position=held.position + np.array([shift, 0.0, 0.0])))
    assert certificate.of(Requirement.GAP, "a.tip").value == pytest.approx(shift, rel=1e-6)
    assert certificate.of(Requirement.GAP, "b.tip").value == pytest.approx(shift, rel=1e-6)
    assert certificate.of(Requirement.DEPTH, "b").value == pytest.approx(shift, rel=1e-6)
    assert certificate.of(Requirement.DEPTH, "a").value == pytest.approx(-shift, rel=1e-6)
    assert {Requirement.GAP, Requirement.DEPTH} <= failed(certificate)


def test_a_force_that_nothing_balances_is_measured():
    scene, held = pinched()
    more = np.array([0.0, 0.0, 0.02])
    certificate = certify_held(scene, with_contact(held, "a.tip", force=contact_of(held, "a.tip").force + more))
    assert certificate.of(Requirement.FORCE).value == pytest.approx(0.02, rel=1e-9)
    # At the left side, 30 mm from the center of mass.
    assert certificate.of(Requirement.MOMENT).value == pytest.approx(0.02 * 0.03, rel=1e-6)


def test_a_cone_is_measured_from_its_side():
    scene, held = pinched()
    own = certify_held(scene, held).of(Requirement.FRICTION, "a.tip").value
    lift = 0.5 * 9.81 * 0.3
    assert own == pytest.approx(lift - 0.4 * 6.0)
    least = lift / 6.0
    for share, holds in ((1.001, True), (0.999, False)):
        contacts = scene.contacts.model_copy(update={"friction": share * least})
        certificate = certify_held(scene.replaced(contacts=contacts), held)
        assert (Requirement.FRICTION not in failed(certificate)) is holds


def test_a_tension_bends_the_finger_off_the_object():
    """Of a cantilever a couple T e at the tip moves it by T e L^2 / 2 E I, along a face that it still touches."""
    scene, held = pinched()
    tension = 1e-3
    fingers = (replace(held.fingers[0], tensions=np.array([tension, 0.0])), *held.fingers[1:])
    certificate = certify_held(scene, replace(held, fingers=fingers))
    moved_by = tension * cases.OFFSET * cases.LENGTH**2 / (2.0 * cases.STIFFNESS)
    point = certificate.rods[0].at(np.array([cases.LENGTH])).points[0]
    straight = held.fingers[0].position + cases.LENGTH * held.fingers[0].axes[:, 1]
    # The force that presses it, 2.4 times what buckles such a rod, bends it further, to the other side.
    x = math.sqrt(6.0 * cases.LENGTH**2 / cases.STIFFNESS)
    buckled = 2.0 * (1.0 - math.cos(x)) / (x * x * math.cos(x))
    assert np.linalg.norm(point - straight) == pytest.approx(abs(buckled) * moved_by, rel=1e-2)


def limits():
    """Changes of a record, and the property that each violates alone."""
    scene, held = pinched()
    a = held.fingers[0]
    yield scene, replace(held, fingers=(replace(a, tensions=np.array([61.0, 61.0])), *held.fingers[1:])), "TENSION"
    yield scene, with_contact(held, "a.tip", place=cases.LENGTH * (1.0 - 1e-5)), "PLACE"
    less = scene.contacts.model_copy(update={"normal_force_max": 0.999 * 6.0})
    yield scene.replaced(contacts=less), held, "PRESSING"
    moved_out = replace(held, position=held.position + np.array([0.0, 0.04, 0.0]))
    yield scene, moved_out, "POSE"
    aside = replace(a, position=a.position + np.array([0.0, 1e-4, 0.0]))
    yield scene, replace(held, fingers=(aside, held.fingers[1])), "BASE"


@pytest.mark.parametrize(
    ("scene", "held", "name"), list(limits()), ids=lambda value: value if isinstance(value, str) else ""
)
def test_limits_of_the_scene(scene, held, name):
    certificate = certify_held(scene, held)
    assert Requirement[name] in failed(certificate)


def test_a_moment_in_the_base_is_not_trusted():
    scene, held = pinched()
    moment = 1e-4
    fingers = (replace(held.fingers[0], moment=np.array([0.0, 0.0, moment])), held.fingers[1])
    certificate = certify_held(scene, replace(held, fingers=fingers))
    # The finger is bent by a moment M in its base and pressed by P: M cos(L sqrt(P / B)) is left at its end.
    left = moment * math.cos(cases.LENGTH * math.sqrt(6.0 / cases.STIFFNESS))
    assert certificate.of(Requirement.SHAPE, "a").value == pytest.approx(abs(left), rel=1e-4)
    assert Requirement.SHAPE in failed(certificate)


def test_what_is_not_certified_does_not_pass():
    finger = cases.make_finger(tendons=Tendons(offset=cases.OFFSET, max_tension=60.0, friction=0.1))
    for states, passes in (("pulled", True), ("any", False)):
        scene, arrays = cases.apart(finger, family="clothoid", friction_states=states)
        certificate = certify_held(scene, held_plane(scene, arrays))
        assert (Requirement.LAWS not in failed(certificate)) is passes


@pytest.mark.parametrize(("share", "passes"), [(1.001, True), (0.999, False)])
def test_a_motor_reaches_its_tension(share, passes):
    """A motor of radius r and dry friction c reaches a tension T with the torque T r + c."""
    tension, radius, dry = 7.0, 0.008, 0.01
    drive = {
        "kind": "motor",
        "winch_radius": radius,
        "inertia": 1e-6,
        "coulomb_friction": dry,
        "torque_max": share * (tension * radius + dry),
        "position_gain": 2.0,
    }
    stiff = {"axial_stiffness": 1e4, "series_stiffness": 1e4}
    tendons = Tendons(offset=cases.OFFSET, max_tension=60.0, drive=drive, **stiff)
    scene, arrays = cases.apart(
        cases.make_finger(tendons=tendons), {"finger": {"tensions": (tension, 0.0)}}, family="clothoid"
    )
    certificate = certify_held(scene, held_plane(scene, arrays))
    assert certificate.of(Requirement.TORQUE, "finger").passed is passes


def test_numbers_that_are_none_never_pass():
    scene, held = pinched()
    nan = float("nan")
    for wrong in (
        replace(held, position=np.array([nan, 0.0, 0.0])),
        with_contact(held, "a.tip", force=np.array([nan, 0.0, 0.0])),
        with_contact(held, "a.tip", place=nan),
        replace(held, fingers=(replace(held.fingers[0], tensions=np.array([nan, 0.0])), held.fingers[1])),
        with_contact(held, "b.tip", force=np.array([math.inf, 0.0, 0.0])),
    ):
        assert not certify_held(scene, wrong).passed
    # Numbers that are finite, and lead to none that are.
    huge = with_contact(held, "a.tip", force=np.array([1e200, 1e200, 0.0]))
    assert not certify_held(scene, huge).passed


def test_contacts_match_the_scene():
    scene, held = pinched()
    a = held.fingers[0]
    stranger = replace(a.contacts[0], name="a.other")
    for contacts in ((), (*a.contacts, *a.contacts), (*a.contacts, stranger)):
        certificate = certify_held(scene, replace(held, fingers=(replace(a, contacts=contacts), held.fingers[1])))
        assert failed(certificate) == {Requirement.CONTACTS}


def test_a_finger_in_another_is_measured():
    """Two straight fingers, one across the other: as deep as both half thicknesses, and less where they are beside."""
    for angle, deep in ((0.0, cases.HALF + cases.HALF), (math.pi / 2, 2.0 * cases.HALF - 0.01)):
        base = (0.1, 0.1, math.pi / 2) if not angle else (-0.01, 0.05, 0.0)
        fingers = {"a": cases.make_finger(), "b": cases.make_finger(base[:2], base[2])}
        scene, arrays = cases.apart(fingers, contacts=[("a.tip", (0, 0), cases.UP, (0, 0, 0), cases.LENGTH, 0)])
        certificate = certify_held(scene, held_plane(scene, arrays))
        assert certificate.of(Requirement.CROSSED, "a, b").value == pytest.approx(deep, rel=1e-9)


def test_a_finger_in_itself_is_measured():
    """A tendon bends a finger to a circle that closes: its end is in its begin."""
    tension = 2.0 * math.pi * cases.STIFFNESS / cases.LENGTH / cases.OFFSET
    scene, arrays = cases.apart(values={"finger": {"tensions": (tension, 0.0)}})
    certificate = certify_held(scene, held_plane(scene, arrays))
    assert certificate.of(Requirement.CURLED, "finger").value == pytest.approx(2.0 * cases.HALF, rel=1e-6)


# -- hands ---------------------------------------------------------------------------------------------------------


def test_a_hand_sees_what_a_beam_of_first_order_leaves_out():
    """Two fingers bear a box by bending to the side. Beams of first order keep the distance of their ends; rods keep
    their length, and the ends come nearer to their bases by half the integral of the slope squared.
    """
    scene, arrays = hand_cases.squeezed_box(press=1e-6, mass=0.05)
    force, length, half = 0.5 * 9.81 * 0.05, hand_cases.LENGTH, hand_cases.HALF
    s = np.linspace(0.0, length, 2001)
    slope = force / hand_cases.LATERAL * ((length + half) * s - 0.5 * s * s)
    nearer = 0.5 * np.trapezoid(slope**2, s)
    certificate = certify_held(scene, held_hand(scene, arrays))
    for name in ("left.tip", "right.tip"):
        assert certificate.of(Requirement.GAP, name).value == pytest.approx(nearer, rel=2e-3)


def round_fingers(twist, press=0.8, mass=0.04, slope=0.1, lean=-1.0):
    """Three round rods hold a ball by friction; each is an elastica in the plane through the hand's axis, however the
    plane of its tendons is turned about it. The ball is as large as its contacts leave it.
    """
    length, stiffness, half = hand_cases.LENGTH, hand_cases.STIFFNESS, hand_cases.HALF
    normal, force = np.array([math.cos(slope), math.sin(slope)]), np.array([press, -9.81 * mass / 3.0])
    couple = -half * (normal[0] * force[1] - normal[1] * force[0])

    # Angle from the direction down outward, its slope, and the place, outward and up.
    def bent(s, y):
        turning = -(np.sin(y[0]) * force[1] + np.cos(y[0]) * force[0]) / stiffness
        return np.array([y[1], turning, np.sin(y[0]), -np.cos(y[0])])

    def ends(a, b):
        return np.array([a[0] - lean, b[1] - couple / stiffness, a[2] - 0.12, a[3]])

    s = np.linspace(0.0, length, 101)
    found = solve_bvp(
        bent, ends, s, np.array([lean + 8.0 * s, 8.0 + 0.0 * s, 0.12 - 0.6 * s, -0.8 * s]), tol=1e-10, max_nodes=100_000
    )
    assert found.success
    tip = found.sol(length)[2:]
    reach = tip[0] / normal[0]
    bases, touches = {}, []
    for k in range(3):
        out = np.array([math.cos(math.tau * k / 3), math.sin(math.tau * k / 3), 0.0])
        side = np.array([-out[1], out[0], 0.0])
        along = math.sin(lean) * out - math.cos(lean) * np.array([0.0, 0.0, 1.0])
        inward = np.cross(along, side)
        bases[f"finger_{k + 1}"] = (0.12 * out, along, math.cos(twist) * inward + math.sin(twist) * side)
        own = [part[0] * out + [0.0, 0.0, part[1]] for part in (tip - half * normal, normal, force)]
        touches.append((f"finger_{k + 1}.tip", *own, length, 0.0))
    height = float(tip[1] - reach * normal[1])
    ball = {"shape": "sphere", "diameter": 2.0 * (reach - half), "mass": mass, "position": (0.0, 0.0, height)}
    scene = hand_cases.make_scene(bases, ball, section={"shape": "round"}, gravity=(0.0, 0.0, -9.81))
    return scene, hand_cases.stored(scene, touches)


@pytest.mark.parametrize("twist", [0.0, 0.6, 2.0])
def test_three_round_fingers_hold_a_ball_in_space(twist):
    scene, arrays = round_fingers(twist)
    held = held_hand(scene, arrays)
    certificate = certify_held(scene, held)
    assert certificate.passed, certificate.worst
    assert certificate.of(Requirement.GAP, "finger_2.tip").value < 1e-9
    # Far beyond beams of first order.
    ends = certificate.rods[0].at(np.array([0.0, hand_cases.LENGTH])).axes[:, :, 1]
    assert math.acos(ends[0] @ ends[1]) > 0.5
    # With the moments in their bases recorded, shapes stay while the ball moves.
    moments = [rod.at(np.zeros(1)).moment[0] for rod in certificate.rods]
    fingers = tuple(replace(f, moment=m) for f, m in zip(held.fingers, moments, strict=True))
    lower = replace(held, position=held.position - np.array([0.0, 0.0, 1e-5]), fingers=fingers)
    gap = certify_held(scene, lower).of(Requirement.GAP, "finger_2.tip").value
    assert gap == pytest.approx(1e-5 * math.sin(0.1), rel=1e-2)


def test_a_moment_about_a_normal_counts_in_balance_and_cone():
    """Both ends bear half the moment of a center of mass beside the line through them."""
    scene, arrays = hand_cases.twisted_box(mass=1e-4)
    held = held_hand(scene, arrays)
    certificate = certify_held(scene, held)
    assert certificate.passed
    moment = 0.5 * 1e-3 * 9.81 * 1e-4
    without = certify_held(scene, with_contact(held, "left.tip", moment=0.0))
    assert without.of(Requirement.MOMENT).value == pytest.approx(moment, rel=1e-3)
    most = 1e-3 * 2.0
    over = certify_held(scene, with_contact(held, "left.tip", moment=1.01 * most))
    assert over.of(Requirement.FRICTION, "left.tip").value == pytest.approx(0.01 * 0.5 * 2.0, rel=1e-2)


def test_a_table_carries_a_body():
    solid = {"shape": "box", "extents": (0.04, 0.05, 0.06), "edge_radius": 0.004, "position": (0.0, 0.0, 0.03)}
    points = [(x, y, 0.0) for x in (-0.016, 0.016) for y in (-0.021, 0.021)]
    scene, arrays = hand_cases.resting(solid, points)
    held = held_hand(scene, arrays)
    certificate = certify_held(scene, held)
    assert certificate.passed
    lifted = with_contact(held, "table_1", position=np.array([-0.016, -0.021, 1e-5]))
    assert certify_held(scene, lifted).of(Requirement.GAP, "table_1").value == pytest.approx(1e-5)


# -- what the problem finds ----------------------------------------------------------------------------------------


def found(name):
    scene = cg.load(CONFIGS / f"{name}.yaml")
    search = RodSearch(scene, Budget())
    search.run()
    assert search.best is not None
    return scene, held_rods(search.best)


COARSE = pytest.mark.xfail(reason="the table of distances is coarse at teeth", strict=True)
SHIPPED = [
    *("groove", "pinch", "box_edge", "table_peg", "mug", "wrap", "mug_hanging", "spirob_cup", "egg"),
    pytest.param("gear", marks=COARSE),
]


@pytest.mark.parametrize("name", few(SHIPPED, 1))
def test_shipped_grasps_pass(name):
    scene, held = found(name)
    certificate = certify_held(scene, held)
    assert certificate.passed, certificate.worst
    # What the integration leaves is far below the limits.
    rough = shares(certify_held(scene, held, tolerance=1e-8))
    for wanted in (Requirement.GAP, Requirement.TANGENT, Requirement.MOMENT, Requirement.SHAPE):
        if wanted in rough:
            assert abs(rough[wanted] - shares(certificate)[wanted]) < 0.05


@pytest.mark.deep
def test_images_have_the_same_findings():
    scene, held = found("pinch")
    own = shares(certify_held(scene, held))
    data = {"supports": {}, **scene.model_dump(exclude_unset=True)}
    data["object"] = {"angle": 0.0, **data["object"]}
    turn, shift = 0.7, np.array([0.31, -0.17, 0.0])
    c, s = math.cos(turn), math.sin(turn)
    about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for image, record in (
        (moved(data), held_cases.turned(held, about, shift)),
        (mirrored(data), held_cases.mirrored(held)),
    ):
        other = shares(certify_held(type(scene)(**image), record))
        assert other.keys() == own.keys()
        for wanted, share in own.items():
            assert other[wanted] == pytest.approx(share, abs=2e-3), wanted


WRONG = {
    "moment along the rod": (
        "pinch",
        "stage",
        lambda own: lambda c, g, q, f, m, s, h: own(c, g, q, [-f[0], f[1]], m, s, h),
    ),
    "tendons": ("pinch", "stage", lambda own: lambda c, g, q, f, m, s, h: own(c, g, q, f, 1.001 * m, s, h)),
    "weight along the finger": ("pinch", "integral", lambda own: lambda c, a, b: -own(c, a, b)),
    "arm of contacts": (
        "box_edge",
        "_on_object",
        lambda own: lambda force, arm, unit: own(force, (arm[0], -arm[1]), unit),
    ),
}


@pytest.fixture
def anew():
    """Problems of this test are made anew, and no other has them."""
    cached = [kinds.stage_kind, kinds.contact_kind, kinds.support_kind, kinds.free_tip_kind]

    def forget():
        blocks._problems.clear()
        for kind in cached:
            kind.cache_clear()

    forget()
    yield
    forget()


@pytest.mark.deep
@pytest.mark.parametrize(("name", "line", "broken"), WRONG.values(), ids=WRONG)
def test_a_wrong_line_of_the_problem_is_noticed(name, line, broken, monkeypatch, anew):
    monkeypatch.setattr(kinds, line, broken(getattr(kinds, line)))
    scene, held = found(name)
    certificate = certify_held(scene, held)
    assert not certificate.passed
    assert certificate.worst.share > 10.0


def test_the_certificate_shares_nothing_with_the_problem():
    for file in (PACKAGE / "grasp" / "judge").glob("*.py"):
        for module, _, _ in imports(file):
            assert ".grasp.rods" not in module
            assert ".nlp" not in module
            assert "casadi" not in module
