"""Grasps by fingers that change along their length, against uniform fingers, geometry and the exact rod."""

import numpy as np
import pytest

from continuum_grasp.errors import InputError
from continuum_grasp.grasp import certify, optimize_grasp
from continuum_grasp.grasp.fine import FIRST, with_elements
from continuum_grasp.grasp.problem.graded_curves import GradedSpec
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.grasp.skin import skin
from continuum_grasp.scene.load import load
from continuum_grasp.scene.profile import Curve

LENGTH, STIFFNESS, DENSITY = 0.18, 6.11e-3, 0.034
PINCH, MUG = "configs/grasp/pinch.yaml", "configs/grasp/mug.yaml"


def section(to, stiffness, density=DENSITY, **more):
    return {"to": to, "bending_stiffness": stiffness, "linear_density": density, **more}


def mug(sections, offsets=((0.005, 0.005), (-0.005, -0.005)), **changes):
    """The mug against the palm, held by a finger of sections."""
    tendons = [{"offset": offset, "min_tension": 1.0, "max_tension": 60.0} for offset in offsets]
    finger = {"finger.rod": {"length": LENGTH, "sections": sections}, "finger.strain_limit": None}
    return load(MUG).changed({**finger, "finger.tendons": tendons, **changes})


STEP = [section(0.4 * LENGTH, 1.3 * STIFFNESS), section(LENGTH, 0.8 * STIFFNESS)]
TAPER = [section(LENGTH, (1.5 * STIFFNESS, 0.7 * STIFFNESS), (DENSITY, 0.5 * DENSITY), thickness=(0.015, 0.009))]
TAPERED_MUG = {"finger.half_thickness": None}
TAPERED_TENDONS = ((0.006, 0.0045), (-0.006, -0.0045))


@pytest.fixture(scope="module")
def tapered():
    return optimize_grasp(mug(TAPER, TAPERED_TENDONS, **TAPERED_MUG))


@pytest.mark.deep
def test_equal_sections_give_the_uniform_fingers_grasp():
    """Sections that differ by less than rounding matters take the graded statics, cut at both jumps."""
    uniform = load(PINCH).changed({"fidelity.accuracy": 1e-10, "fidelity.elements": 2})
    changes = {}
    for name, finger in uniform.named_fingers.items():
        rod = finger.rod
        parts = [
            section(at * rod.length, scale * rod.stiffness, rod.mass_per_length)
            for at, scale in ((0.3, 1.0), (0.7, 1.0 + 1e-12), (1.0, 1.0))
        ]
        changes[f"fingers.{name}.rod"] = {"length": rod.length, "sections": parts}
        changes[f"fingers.{name}.strain_limit"] = None
        changes[f"fingers.{name}.half_thickness"] = finger.thickness_radius
    graded = uniform.changed(changes)
    assert all(GradedSpec.of(setup, True).edges["statics"] == 2 for setup in graded.setups)
    one, other = optimize_grasp(uniform), optimize_grasp(graded)
    assert other.certificate.passed
    for key in ("contact_positions", "contact_forces", "left.tensions", "left.q", "left.backbone", "right.tensions"):
        np.testing.assert_allclose(
            other.arrays[key], one.arrays[key], rtol=1e-9, atol=1e-9 * np.abs(one.arrays[key]).max()
        )


@pytest.mark.deep
@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(lambda: mug(STEP), id="stepped"),
        pytest.param(
            lambda: mug(
                [section(LENGTH, STIFFNESS)], **{"finger.rest_curvature": {"breaks": [0.07], "values": [-2.0, 6.0]}}
            ),
            id="bent at rest",
        ),
    ],
)
def test_the_exact_rod_confirms_the_grasp_ever_better_with_more_elements(scene):
    found = []
    for elements in (4, 8):
        grasp = optimize_grasp(scene().changed({"fidelity.elements": elements}))
        assert grasp.certificate.passed
        found.append(grasp.certificate.model_error)
    assert found[0].small
    assert found[1].found
    # Of fourth order: some sixteenth of the displacement with half the elements' length.
    assert found[1].greatest < found[0].greatest / 8.0


def test_a_tapered_finger_touches_where_its_own_thickness_ends(tapered):
    """The union of discs of the thickness along the backbone touches the circle, and reaches nowhere into it."""
    assert tapered.certificate.passed
    line, cup = tapered.arrays["finger.backbone"], tapered.scene.object
    half = 0.5 * np.interp(line[:, 0], [0.0, LENGTH], [0.015, 0.009])
    gap = np.hypot(*(line[:, 1:3] - cup.position).T) - 0.5 * cup.diameter - half
    assert gap.min() > -2e-6 * LENGTH
    for name, station in zip(tapered.arrays["contact_names"], tapered.arrays["contact_stations"], strict=True):
        if not name.startswith("finger."):
            continue
        near = np.abs(line[:, 0] - station) < 2.5e-2 * LENGTH
        # A polynomial through the places about the contact: least there where it is tangent, else the end's value.
        *_, a, b, c = np.polyfit(line[near, 0] - station, gap[near], 4)
        assert c == pytest.approx(0.0, abs=1e-6 * LENGTH)
        if name.endswith("middle"):
            assert b == pytest.approx(0.0, abs=1e-5)
            assert a > 0.0


def test_the_exact_rod_confirms_a_tapered_finger(tapered):
    assert tapered.certificate.model_error.small
    assert tapered.certificate.stability.stable


def test_a_wrong_thickness_fails_the_certificate(tapered):
    thicker = [{**TAPER[0], "thickness": (0.015, 0.0091)}]
    scene = mug(thicker, TAPERED_TENDONS, **TAPERED_MUG)
    failed = [check.name for check in certify(scene, tapered.arrays).failed]
    assert "contact gap, finger.tip" in failed


def test_another_stiffness_or_tendon_fails_the_certificate(tapered):
    stiffer = [section(LENGTH, (1.5 * STIFFNESS, 0.72 * STIFFNESS), (DENSITY, 0.5 * DENSITY), thickness=(0.015, 0.009))]
    inclined = ((0.006, 0.0044), (-0.006, -0.0044))
    for scene in (mug(stiffer, TAPERED_TENDONS, **TAPERED_MUG), mug(TAPER, inclined, **TAPERED_MUG)):
        assert not certify(scene, tapered.arrays)["finger equilibrium, finger"].passed


@pytest.mark.deep
def test_the_exact_rod_confirms_fingers_whose_tendons_end_inside():
    scene = load(PINCH)
    changes = {}
    for name, finger in scene.named_fingers.items():
        own, to = finger.tendons, 0.75 * finger.rod.length
        limits = {"min_tension": own.min_tension, "max_tension": own.max_tension}
        ending = [{"offset": side * own.offset, "to": to, **limits} for side in (1.0, -1.0)]
        changes[f"fingers.{name}.tendons"] = ending
    grasp = optimize_grasp(scene.changed(changes))
    assert grasp.certificate.passed
    # The moment of the tendons is known: the jump at their end costs nothing.
    assert grasp.certificate.model_error.greatest < 1e-4 * scene.setups[0].finger.rod.length


def test_strain_is_limited_by_the_depth_at_each_place(tapered):
    shape, at = FingerShape(tapered.scene.setups[0], tapered.arrays), np.linspace(0.0, LENGTH, 1001)
    depth = 0.5 * np.interp(at, [0.0, LENGTH], [0.015, 0.009])
    greatest = float(np.abs(shape.curvature(at) * depth).max())

    def limited(share):
        return mug(TAPER, TAPERED_TENDONS, **{**TAPERED_MUG, "finger.strain_limit": share * greatest})

    again = optimize_grasp(limited(1.0 + 1e-3))
    assert again.certificate["bending strain, finger"].value == pytest.approx(1.0 / 1.001 - 1.0, rel=1e-3)
    assert not certify(limited(1.0 - 1e-3), tapered.arrays)["bending strain, finger"].passed


@pytest.mark.deep
def test_a_taper_is_found_with_the_elements_of_a_first_grasp():
    """With two per segment it is called infeasible: friction would be too low."""
    scene = load("configs/grasp/spirob_cup.yaml").changed({"solver.effort": "quick"})
    assert optimize_grasp(with_elements(scene, FIRST), raise_on_failure=False).solved


def test_skin_is_rounded_at_corners_alone():
    stepped = Curve((0.0, 0.5, 1.0), ((0.05,), (0.05, -0.1)))
    rounded, at = skin(stepped), np.linspace(0.0, 1.0, 1001)
    off = np.abs(rounded(at) - stepped(at))
    assert off[np.abs(at - 0.5) > 0.0101].max() < 1e-15
    assert off.max() == pytest.approx(0.1 * 0.01 / 4.0, rel=1e-6)
    slopes = np.diff(rounded(np.linspace(0.48, 0.52, 4001))) / 1e-5
    assert np.abs(np.diff(slopes)).max() < 1e-3  # no jump of the slope is left


JUMP = {
    "length": LENGTH,
    "sections": [section(0.1, STIFFNESS, thickness=0.03), section(LENGTH, STIFFNESS, thickness=0.01)],
}
MANY = {"length": LENGTH, "sections": [section(LENGTH * (k + 1) / 17, STIFFNESS * (1 + 0.01 * k)) for k in range(17)]}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"finger.rod": JUMP, "finger.half_thickness": None}, "smaller jumps"),
        ({"finger.rod": MANY}, "17 parts"),
        ({"fidelity.family": "arc"}, "fidelity.family"),
        ({"finger.tendons": [{"offset": 0.005, "max_tension": 60.0}]}, "tendons"),
        ({"finger.stops": {"curvature": 60.0, "stiffness_ratio": 50.0}}, "stops"),
        ({"finger.tip_body": {"mass": 0.01}}, "tip_body"),
    ],
)
def test_what_grasps_cannot_do_is_refused_by_name(changes, said):
    with pytest.raises(InputError, match=said):
        optimize_grasp(mug(STEP, **changes))
