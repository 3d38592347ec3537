"""The certificate, on grasps made by hand: it passes what holds and names what was tampered with."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp import certify
from continuum_grasp.scene import Circle, Ellipse, Polygon, Rod, Superellipse, Union
from tests import certificate_cases as cases
from tests.grasp_elastica import Hand, designed, stored


def held(shape):
    """A pinch of another shape, 60 mm wide where the fingers touch it, without a moment arm."""
    return lambda: cases.pinched_box(at=0.0, turn=0.4, body=lambda values: shape(values))


def bent_fingers():
    """Two bent fingers on a disc, as an independent program integrates their elastica."""
    hand = Hand(weight=(0.0, -1.0))
    design = (hand, 2.8, 2.0)
    normals = designed(*design, (0.0, 0.0), (0.0, 0.0), friction=0.2).normals
    angles = normals + 0.5 * math.pi + [-0.5, 0.5]
    state = designed(*design, angles, (3.0, -3.0), friction=0.2)
    pairs = {
        name: cases.make_finger(
            tuple(base[:2]),
            base[2],
            rod=Rod(length=hand.length, linear_density=1e-12, bending_stiffness=hand.stiffness),
        )
        for name, base in zip("ab", state.bases, strict=True)
    }
    body = Circle(shape="circle", diameter=2.0 * hand.radius, mass=1.0 / 9.81, position=(0.0, 0.0))
    scene = cases.make_scene(pairs, body, {"friction": 1.0}, cases.PLANAR, "clothoid", elements=60)
    arrays = stored(hand, state, "ab")
    for k, name in enumerate("ab"):
        s = np.linspace(0.0, hand.length, 61)
        line = np.column_stack([s, *(np.interp(s, state.s, state.shapes[k, j]) for j in range(3))])
        arrays[f"{name}.backbone"] = line
        arrays[f"{name}.base_moment"] = cases.base_moment(scene, arrays, name)
    return scene, arrays


HELD = {
    "disc against a palm": cases.squeezed_disc,
    "disc against a palm, arcs": lambda: cases.squeezed_disc(family="arc"),
    "disc and a finger without thickness": lambda: cases.squeezed_disc(half=0.0),
    "two fingers below a disc": cases.two_fingers_below,
    "pinched box": cases.pinched_box,
    "pinched box, turned": lambda: cases.pinched_box(turn=0.7),
    "pinched ellipse": held(lambda v: Ellipse(shape="ellipse", width=0.06, height=0.03, **v)),
    "pinched superellipse": held(
        lambda v: Superellipse(shape="superellipse", width=0.06, height=0.08, exponent=4, **v)
    ),
    "pinched between corners": held(
        lambda v: Polygon(shape="polygon", vertices=((-0.03, 0.0), (0.0, -0.04), (0.03, 0.0), (0.0, 0.04)), **v)
    ),
    "pinched between round corners": held(
        lambda v: Polygon(
            shape="polygon",
            vertices=tuple((x * (0.03 + 0.01 * (2**0.5 - 1)), y * (0.03 + 0.01 * (2**0.5 - 1))) for x, y in SQUARE),
            corner_radius=0.01,
            **v,
        )
    ),
    "disc in a groove": cases.disc_in_groove,
    "box on a line": cases.box_on_line,
    "disc on pegs": cases.disc_on_pegs,
    "disc on points": lambda: cases.disc_on_pegs(peg=0.0),
    "union on a palm": cases.union_on_palm,
    "disc between bent fingers": bent_fingers,
}
SQUARE = ((1, 0), (0, 1), (-1, 0), (0, -1))


@pytest.mark.parametrize("case", HELD.values(), ids=HELD)
def test_what_holds_passes(case):
    scene, arrays = case()
    certificate = certify(scene, arrays)
    assert certificate.passed, certificate.failed
    assert len({check.name for check in certificate.checks}) == len(certificate.checks)


def tampered(arrays, name, index, change):
    arrays = {key: np.array(value) for key, value in arrays.items()}
    arrays[name][index] += change
    return arrays


@pytest.fixture(scope="module")
def wrapped():
    """A finger that is wrapped around a mug, as it is found."""
    found = cg.optimize_grasp("configs/grasp/mug.yaml")
    return found.scene, found.arrays


TAMPERED = [
    ("mug", "contact_stations", 1, np.nan, "non-finite numbers"),
    ("mug", "contact_stations", 0, 1e-4, "object moment balance"),
    ("mug", "contact_parts", 1, 1, "missing or misshapen arrays"),
    ("mug", "contact_parts", 1, -1, "missing or misshapen arrays"),
    ("mug", "object.pose", 1, np.inf, "non-finite numbers"),
    ("mug", "object.pose", 0, 1e-5, "object pose"),
    ("mug", "finger.q", 1, np.nan, "non-finite numbers"),
    ("mug", "finger.lengths", 0, 1e-5, "stored numbers, finger"),
    ("mug", "finger.backbone", (100, 1), 1e-6, "stored numbers, finger"),
    ("mug", "finger.base_moment", 2, 1e-5, "finger equilibrium, finger"),
    ("mug", "finger.tensions", 0, 1e-3, "finger equilibrium, finger"),
    ("mug", "finger.tensions", 1, 1e3, "tendon tension, finger"),
    ("mug", "contact_forces", (1, 0), 1e-3, "object force balance"),
    ("two fingers below a disc", "contact_forces", (1, 1), 60.0, "friction cone, right.tip"),
    ("pinched between corners", "contact_normals", (0, 1), 1e-5, "stored numbers, a.tip"),
    ("disc in a groove", "contact_positions", (1, 0), 1e-4, "contact gap, groove.left"),
    ("disc in a groove", "object.pose", 1, -1e-3, "penetration of the object into a support, groove.left"),
    ("disc on pegs", "contact_positions", (1, 0), 1e-5, "contact gap, first"),
    ("union on a palm", "contact_parts", 0, 1, "stored numbers, finger.tip"),
    ("disc between bent fingers", "a.backbone", (30, 2), 1e-6, "stored numbers, a"),
    ("disc between bent fingers", "contact_positions", (0, 1), 1e-6, "stored numbers, a.tip"),
]


@pytest.mark.parametrize(("case", "name", "index", "change", "check"), TAMPERED)
def test_a_tampered_grasp_is_seen(wrapped, case, name, index, change, check):
    scene, arrays = wrapped if case == "mug" else HELD[case]()
    certificate = certify(scene, tampered(arrays, name, index, change))
    assert not certificate[check].passed
    assert not certificate.passed


@pytest.mark.parametrize("half", [0.0, 0.999e-3 * cases.LENGTH, 1.001e-3 * cases.LENGTH, 0.006])
def test_the_normal_of_a_tip_of_any_thickness_is_checked(half):
    scene, arrays = cases.squeezed_disc(half=half)
    assert certify(scene, arrays).passed
    certificate = certify(scene, tampered(arrays, "contact_normals", (0, 0), 1e-4))
    assert not certificate["stored numbers, finger.tip"].passed


def test_no_contact_is_buried_in_the_part_that_it_touches():
    """A round foot that is a little within its palm, as objects on supports may be."""
    members = (
        {"shape": "circle", "diameter": 0.05, "position": (0.0, 0.025)},
        {"shape": "box", "width": 0.03, "height": 0.03, "position": (0.0, 0.05)},
    )
    body = Union(shape="union", members=members, mass=0.0, position=(0.0, 0.0), center_of_mass=(0.0, 0.03))
    palm = cases.Palm(point=(0.0, 0.0), normal_angle=0.5 * np.pi)
    reaction = ("palm", (0.0, 0.0), cases.DOWN, (5.0, 0.0, 0.0), cases.NONE, 0)
    scene, arrays = cases.pressed_down(body, {"palm": palm}, [reaction], top=0.065, part=1)
    certificate = certify(scene, tampered(arrays, "object.pose", 1, -1.5e-6 * body.size))
    assert certificate["contact gap, palm"].passed
    assert certificate["stored numbers, palm"].passed


@pytest.mark.parametrize(
    "names",
    [
        ["finger.middle", "finger.tip", "finger.tip"],
        ["finger.middle", "finger.tip", "wall"],
        ["finger.middle", "finger.middle_1", "palm"],
        ["palm", "finger.tip", "palm.1"],
    ],
)
def test_contacts_must_be_those_of_the_scene(wrapped, names):
    scene, arrays = wrapped
    certificate = certify(scene, arrays | {"contact_names": np.array(names)})
    assert certificate["contacts match the scene"].value >= 1.0
    assert not certificate.passed


def test_contacts_that_are_off_must_not_be_there(wrapped):
    scene, arrays = wrapped
    palm = scene.supports["palm"]
    for switch, passes in (("on", True), ("off", False)):
        changed = scene.model_copy(update={"supports": {"palm": palm.model_copy(update={"touch": switch})}})
        assert certify(changed, arrays).passed is passes
    contacts = scene.contacts.model_copy(update={"middle": "off"})
    assert not certify(scene.model_copy(update={"contacts": contacts}), arrays).passed


def test_of_numbers_that_are_no_grasp_nothing_is_known(wrapped):
    scene, arrays = wrapped
    certificate = certify(scene, arrays | {"finger.q": "words"})
    assert not certificate["missing or misshapen arrays"].passed
    assert not certificate.stable
    assert certificate.push == 0.0
    assert np.isnan(certificate.friction_margin)
    assert "missing or misshapen arrays" in repr(certificate)


def test_another_family_does_not_pass(wrapped):
    scene, arrays = wrapped
    assert not certify(scene, arrays | {"finger.family": "arc"}).passed


def test_a_heavier_object_fails_in_the_balance_of_its_weight(wrapped):
    scene, arrays = wrapped
    heavier = scene.model_copy(update={"object": scene.object.model_copy(update={"mass": 0.31})})
    assert [check.name for check in certify(heavier, arrays).failed] == ["object force balance"]


def test_friction_margins():
    scene, arrays = cases.squeezed_disc(mass=0.2, press=4.0, friction=0.5)
    certificate = certify(scene, arrays)
    assert certificate.friction_margins == pytest.approx({"finger.tip": 0.5095, "palm": 0.5095}, abs=1e-12)
    slides = scene.changed({"supports.palm.friction": 0.0})
    assert set(certify(slides, arrays).friction_margins) == {"finger.tip"}
    arrays["contact_forces"][1, 0] = 0.0
    assert certify(scene, arrays).friction_margin == 0.0
    leaning = math.tan(math.asin(0.03 / (0.05 + cases.HALF)))
    margins = certify(*cases.two_fingers_below(aside=0.03, radius=0.05)).friction_margins
    assert margins == pytest.approx(dict.fromkeys(("left.tip", "right.tip"), 1.0 - leaning / 1.2), abs=1e-9)


@pytest.mark.parametrize("stiffness", [0.01, 1.0, 100.0])
def test_balances_are_relative_to_the_forces_on_the_object_however_stiff_fingers_are(monkeypatch, stiffness):
    """1e-5 of a contact force, or a moment in the base of 1e-4 of what it would have across the finger, is too much."""
    monkeypatch.setattr(cases, "STIFFNESS", stiffness)
    scene, arrays = cases.squeezed_disc(press=4.0)
    assert certify(scene, arrays).passed
    off = certify(scene, tampered(arrays, "contact_forces", (0, 0), 4e-5))
    assert [check.name for check in off.failed] == ["object force balance"]
    off = certify(scene, tampered(arrays, "finger.base_moment", 2, 1e-4 * 4.0 * cases.LENGTH))
    assert "finger equilibrium, finger" in {check.name for check in off.failed}


# -- use -----------------------------------------------------------------------------------------------------


def test_certificate_travels_between_processes(wrapped):
    certificate = certify(*wrapped)
    push = certificate.push
    again = pickle.loads(pickle.dumps(certificate))
    assert again.passed
    assert again.stable
    assert again.push == push
    assert again["object pose"].value == 0.0
    assert 0.0 < again.friction_margins["finger.tip"] < 1.0


def test_certificate_is_shown_in_a_few_lines(wrapped):
    certificate = certify(*wrapped)
    assert f"{len(certificate.checks)} of {len(certificate.checks)} checks passed" in repr(certificate)
    assert "stable" in repr(certificate)
    data = certificate.data()
    assert data["passed"]
    assert data["push"] == certificate.push
    assert {check["name"] for check in data["checks"]} == {check.name for check in certificate.checks}
