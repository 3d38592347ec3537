"""The certificate, on grasps made by hand: it passes what holds and names what was tampered with."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp import certify
from continuum_grasp.scene import Ellipse, Polygon, Superellipse, Union
from tests import certificate_cases as cases
from tests.test_imports import PACKAGE, imports, inside


def held(shape):
    """A pinch of another shape, 60 mm wide where the fingers touch it, without a moment arm."""
    return lambda: cases.pinched_box(at=0.0, turn=0.4, body=lambda values: shape(values))


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
    "wrapped disc": cases.wrapped_disc,
    "wrapped disc, lying": lambda: cases.wrapped_disc(cases.PLANAR, mass=0.2),
    "wrapped disc, mirrored": lambda: cases.wrapped_disc(mirrored=True),
    "wrapped with two middle contacts": lambda: cases.wrapped_disc(middles=2, friction=1.0),
    "wrapped with three middle contacts": lambda: cases.wrapped_disc(middles=3, friction=1.0),
    "wrapped by one tendon": lambda: cases.wrapped_disc(used="left"),
}
SQUARE = ((1, 0), (0, 1), (-1, 0), (0, -1))


@pytest.mark.parametrize("case", HELD.values(), ids=HELD)
def test_what_holds_passes(case):
    scene, arrays = case()
    certificate = certify(scene, arrays)
    assert certificate.passed, certificate.failed
    assert len({check.name for check in certificate.checks}) == len(certificate.checks)
    assert certificate.overlap == 0.0


def tampered(arrays, name, index, change):
    arrays = {key: np.array(value) for key, value in arrays.items()}
    arrays[name][index] += change
    return arrays


@pytest.fixture(scope="module")
def wrapped():
    return cases.wrapped_disc()


TAMPERED = [
    ("wrapped disc", "contact_stations", 1, np.nan, "stored contact, finger.tip"),
    ("wrapped disc", "contact_parts", 1, 1, "missing or misshapen arrays"),
    ("wrapped disc", "contact_parts", 1, -1, "missing or misshapen arrays"),
    ("wrapped disc", "object.pose", 1, np.inf, "non-finite numbers"),
    ("wrapped disc", "finger.curvature_shapes", (0, 0, 0), 0.01, "stored backbone, finger"),
    ("wrapped disc", "finger.q", 1, 0.5, "penetration into the object, finger"),
    ("two fingers below a disc", "left.tip_curvature", (), 1e-3, "tip moment balance, left"),
    ("two fingers below a disc", "contact_forces", (1, 1), 60.0, "friction cone, right.tip"),
    ("pinched between corners", "contact_normals", (0, 1), 1e-5, "stored contact, a.tip"),
    ("disc in a groove", "contact_positions", (1, 0), 1e-4, "contact normal, groove.left"),
    ("disc in a groove", "object.pose", 1, -1e-3, "penetration of the object into groove.left"),
    ("disc on pegs", "contact_positions", (1, 0), 1e-5, "stored contact, first"),
    ("union on a palm", "contact_parts", 0, 1, "contact gap, finger.tip"),
    ("wrapped with two middle contacts", "contact_forces", (1, 0), 0.01, "finger equilibrium, finger"),
    ("wrapped with two middle contacts", "finger.q", 1, 0.01, "contact gap, finger.middle_2"),
]


@pytest.mark.parametrize(("case", "name", "index", "change", "check"), TAMPERED)
def test_a_tampered_grasp_is_seen(case, name, index, change, check):
    scene, arrays = HELD[case]()
    certificate = certify(scene, tampered(arrays, name, index, change))
    assert not certificate[check].passed
    assert not certificate.passed


@pytest.mark.parametrize("half", [0.0, 0.999e-3 * cases.LENGTH, 1.001e-3 * cases.LENGTH, 0.006])
def test_the_normal_of_a_tip_of_any_thickness_is_checked(half):
    scene, arrays = cases.squeezed_disc(half=half)
    assert certify(scene, arrays).passed
    certificate = certify(scene, tampered(arrays, "contact_normals", (0, 0), 1e-4))
    assert not certificate.passed
    # Of a tip that is thinner than a thousandth of the length its center does not tell the normal.
    blunt = half > 1e-3 * cases.LENGTH
    assert certificate["stored contact, finger.tip"].passed is not blunt
    assert certificate["contact normal, finger.tip"].passed is blunt


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
    certificate = certify(scene, tampered(arrays, "object.pose", 1, -1.5e-6 * cases.LENGTH))
    assert certificate["contact gap, palm"].passed
    assert certificate["contact inside another part, palm"].passed


@pytest.mark.parametrize(
    ("names", "wrong"),
    [
        (["finger.middle", "finger.tip", "finger.tip"], 1),
        (["finger.middle", "finger.tip", "wall"], 1),
        (["finger.middle", "finger.middle_1", "palm"], 2),
        (["palm", "finger.tip", "palm.1"], 2),
        (["finger.middle", "finger.tip", "palm.2"], 1),
    ],
)
def test_contacts_must_be_those_of_the_scene(wrapped, names, wrong):
    scene, arrays = wrapped
    certificate = certify(scene, arrays | {"contact_names": np.array(names)})
    assert certificate["contacts match the scene"].value == wrong
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
    assert not certificate.stability.stable
    assert not certificate.model_error.found
    assert np.isnan([certificate.friction_margin, certificate.overlap]).all()


def test_another_family_does_not_pass(wrapped):
    scene, arrays = wrapped
    assert not certify(scene, arrays | {"finger.family": "clothoid"}).passed


def test_a_heavier_object_fails_in_the_balance_of_its_weight(wrapped):
    scene, arrays = wrapped
    heavier = scene.model_copy(update={"object": scene.object.model_copy(update={"mass": 0.31})})
    assert [check.name for check in certify(heavier, arrays).failed] == ["object force balance"]


def test_friction_margins():
    scene, arrays = cases.squeezed_disc(mass=0.2, press=4.0, friction=0.5)
    certificate = certify(scene, arrays)
    assert certificate.friction_margins == pytest.approx({"finger.tip": 0.5095, "palm": 0.5095}, abs=1e-12)
    arrays["contact_forces"][0, 1] = 1.0  # besides 0.981 N of lift
    margins = certify(scene, arrays).friction_margins
    assert margins["finger.tip"] == pytest.approx(1.0 - (1.0 + 0.981**2) ** 0.5 / 2.0, abs=1e-12)
    slides = scene.changed({"supports.palm.friction": 0.0})
    assert set(certify(slides, arrays).friction_margins) == {"finger.tip"}
    arrays["contact_forces"][1, 0] = 0.0
    assert certify(scene, arrays).friction_margin == 0.0


@pytest.mark.parametrize("stiffness", [0.01, 1.0, 100.0])
def test_balances_are_relative_to_the_forces_on_the_object_however_stiff_fingers_are(monkeypatch, stiffness):
    """1e-5 of a contact force, or a moment of 1e-4 of what it would have across the finger, is too much."""
    monkeypatch.setattr(cases, "STIFFNESS", stiffness)
    scene, arrays = cases.squeezed_disc(press=4.0)
    assert certify(scene, arrays).passed
    off = certify(scene, tampered(arrays, "contact_forces", (0, 0), 4e-5))
    assert [check.name for check in off.failed] == ["object force balance"]
    off = certify(scene, tampered(arrays, "finger.tensions", 0, 1e-4 * 4.0 * cases.LENGTH / cases.OFFSET))
    assert {check.name for check in off.failed} == {"finger equilibrium, finger", "tip moment balance, finger"}


def test_a_bent_stiff_finger_bears_what_its_contact_gives():
    """A pinch by fingers of 100 N m2, found by the optimizer; 1e-6 of a tension is 1e-3 of the contact's moment."""
    scene = cg.load("configs/grasp/pinch.yaml")
    stiff = {f"fingers.{name}.rod.bending_stiffness": 100.0 for name in ("left", "right")}
    strong = {f"fingers.{name}.tendons.max_tension": 1e5 for name in ("left", "right")}
    scene = scene.changed(stiff | strong | {"stability": "ignore"})
    grasp = cg.optimize_grasp(scene)
    assert grasp.certificate.passed
    less = grasp.arrays["left.tensions"] * (1.0 - 1e-6)
    failed = {check.name for check in certify(scene, {**grasp.arrays, "left.tensions": less}).failed}
    assert failed == {"finger equilibrium, left", "tip moment balance, left"}


# -- use -----------------------------------------------------------------------------------------------------


def test_certificate_travels_between_processes(wrapped):
    certificate = pickle.loads(pickle.dumps(certify(*wrapped)))
    assert certificate.passed
    assert certificate.stability.stable
    assert certificate["object pose"].value == 0.0


def test_certificate_shares_nothing_with_the_optimizer():
    """It reaches itself, the exact rod, exact distances of bodies, the scene and numpy, and nothing else; the exact rod
    may have scipy.
    """
    pending, seen = ["continuum_grasp.grasp.certificate.certificate"], set()
    while pending:
        module = pending.pop()
        seen.add(module)
        for name, *_ in imports(PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py")):
            assert not name.startswith("casadi")
            assert not name.startswith("scipy") or ".rod." in module, module
            if name.startswith(("continuum_grasp.grasp.", "continuum_grasp.rod.")):
                pending += {name} - seen
            elif name.startswith("continuum_grasp."):
                known = {"grasp", "rod", "scene", "base"}
                assert inside(name) in known, f"{module}: {name}"
    own = (
        "certificate chain check drives friction held model_error out_of_plane recomputed rolling shape space stability"
    )
    # The push that a grasp bears is judged by exact rods and numpy, which no search uses.
    of_push = "push response bent_finger contact_set"
    # The optimizer has expressions of `model.surfaces`, and tables.
    of_bodies = "surfaces body outline_body plane_boundary"
    assert {name.rpartition(".")[2] for name in seen if ".grasp." in name} == {
        *own.split(),
        *of_push.split(),
        *of_bodies.split(),
    }
    assert {inside(name) for name in seen} == {"grasp", "rod"}
