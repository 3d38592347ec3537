"""Grasps by fingers that change along their length; from inside: curves and friction as they enter the problem.

Grasps by fingers that change along their length, against uniform fingers, geometry and the exact rod.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from continuum_grasp.grasp.changes import FIRST

from continuum_grasp.base import InputError
from continuum_grasp.grasp import certify, optimize_grasp
from continuum_grasp.grasp.certificate.friction import friction_of, state_cells
from continuum_grasp.grasp.modes import with_elements
from continuum_grasp.grasp.problem.blocks import Columns
from continuum_grasp.grasp.problem.curves import curve_numbers, curves_of
from continuum_grasp.grasp.problem.structure import FingerSpec
from continuum_grasp.grasp.problem.unit_finger import PRESLIDING, UnitFinger
from continuum_grasp.grasp.shape import FingerShape, skin
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Curve, load
from tests import certificate_cases as cases
from tests.grasp.test_grasp_limits import held
from tests.marks import few

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


DRY = {
    "dry_friction": [{"stiffness": 2e-3, "moment": 8e-3}, {"stiffness": 1e-3, "moment": 2e-3}],
    "friction_cells": 2,
}
FREE_TIP = {"fidelity.family": "clothoid"}


@pytest.mark.deep
@pytest.mark.parametrize(
    "friction",
    [{}, FREE_TIP | {"tendons.friction": 0.05}, FREE_TIP | {"tendons.friction": 0.02, "damping": DRY}],
    ids=["none", "of tendons", "of tendons and in bending"],
)
def test_equal_sections_give_the_uniform_fingers_grasp(friction):
    """Sections that differ by less than rounding matters take the graded statics, cut at both jumps."""
    scene = load(PINCH)
    own = {key: value for key, value in friction.items() if key in FREE_TIP}
    for name in scene.named_fingers:
        own |= {f"fingers.{name}.{key}": value for key, value in friction.items() if key not in FREE_TIP}
    uniform = scene.changed({"fidelity.accuracy": 1e-10, "fidelity.elements": 2, "friction_states": "pulled", **own})
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
    assert all(curves_of(setup, True).edges["statics"] == 2 for setup in graded.setups)
    one, other = optimize_grasp(uniform), optimize_grasp(graded)
    assert other.certificate.passed
    for key in ("contact_positions", "contact_forces", "left.tensions", "left.q", "left.backbone", "right.tensions"):
        np.testing.assert_allclose(
            other.arrays[key], one.arrays[key], rtol=1e-9, atol=1e-9 * np.abs(one.arrays[key]).max()
        )


NOTCHED = [section(0.4 * LENGTH, STIFFNESS, thickness=0.015), section(LENGTH, 0.1 * STIFFNESS, thickness=0.012)]
"""Its stiffness jumps inside an element and inside a friction cell."""


def sticky(cells, sections=TAPER):
    """Setup of a finger with friction of both kinds, and its offset at the base."""
    offset = 0.006 * np.cos(np.arctan2(0.0015, LENGTH))  # of tendons that are inclined
    more = {"friction": 0.3, "friction_cells": cells, "presliding": offset * PRESLIDING, "max_tension": 60.0}
    tendons = [{"offset": own, **more} for own in TAPERED_TENDONS]
    own = {"finger.tendons": tendons, "finger.damping": DRY, "finger.masses": MASSES}
    return mug(sections, **TAPERED_MUG, **FREE_TIP, **own).setups[0], offset


MASSES = [{"at": 0.45 * LENGTH, "mass": 0.004}, {"at": LENGTH, "mass": 0.002}]
GRAVITY = (-3.0, 9.0)
LENGTHS = LENGTH * np.array([0.2, 0.3, 0.22, 0.28])


def moving(setup, gravity):
    """The model of motion of the same finger."""
    return FingerModel(
        setup.finger,
        family="clothoid",
        elements=tuple(LENGTHS.tolist()),
        gravity=gravity,
        accuracy=1e-10,
        tip_force=True,
    )


def history_of(cells, moved, rng):
    """States of both kinds of friction, or those of pulling."""
    return [*(1.0 - moved) * rng.uniform(-1.0, 1.0, 4 * cells + 16), moved]


@pytest.mark.parametrize(("cells", "sections"), few([(1, TAPER), (2, NOTCHED), (3, TAPER)], 2))
def test_forces_are_those_of_the_model_of_motion(cells, sections):
    """Generalized forces at rest in random shapes, of random states of friction, and of those of pulling, with the
    weight of a taper and of masses within and at the tip.
    """
    (setup, offset), rng = sticky(cells, sections), np.random.default_rng(cells)
    finger, stiffness, nodes = setup.finger, setup.stiffness, np.cumsum([0.0, *LENGTHS])
    spec = replace(FingerSpec.of(setup, frozenset(), True), elements=4, accuracy=1e-10, bending_range=2.0)
    resting = UnitFinger(spec, Columns(), Columns(), ca.SX.zeros(3))
    (channel,) = finger.channels
    branches = [number for each in DRY["dry_friction"] for number in (each["stiffness"], each["moment"] * LENGTH)]
    own = finger.rod.mass_per_length * LENGTH
    c, s = np.cos(finger.base.angle), np.sin(finger.base.angle)
    weight = np.array([[c, s], [-s, c]]) @ GRAVITY * own * LENGTH**2 / stiffness
    p = [
        *(*LENGTHS / LENGTH, *curve_numbers(setup, True), *finger.profile.bending_stiffness(nodes) / stiffness),
        *(*channel.shape(nodes), *weight, 0.3, MASSES[1]["mass"] / own, *np.array(branches) / stiffness),
    ]
    missing, statics = resting.backbone.missing(1), moving(setup, GRAVITY).statics
    inner, loads = [MASSES[0]["mass"] / own, 0.45], np.zeros(resting.shared.model.nw)
    for moved, bent in ((0.0, 8.0), (1.0, 8.0), (1.0, 4e-3)):  # at last within the presliding
        q, pulls, history = bent * rng.normal(size=5), rng.uniform(1.0, 30.0, 2), history_of(cells, moved, rng)
        u = resting.input(ca.DM(pulls * offset * LENGTH / stiffness), 0.0)
        found = stiffness * np.array(missing(q * LENGTH, u, loads, inner, history, p)).ravel()
        true = np.array(statics(q, pulls, [0.0, 0.0], [], history)[0]).ravel()
        assert found == pytest.approx(true, abs=1e-12 * np.abs(true).max())


@pytest.mark.parametrize("sections", [TAPER, NOTCHED], ids=["taper", "notched"])
@pytest.mark.parametrize("cells", [2, 3])
def test_the_certificates_friction_does_the_work_of_the_model_of_motion(cells, sections):
    """Its moments do work on the curvature of each coordinate: generalized forces; states of pulling are equal."""
    (setup, _), rng = sticky(cells, sections), np.random.default_rng(cells)
    model = moving(setup, (0.0, 0.0))
    shapes = np.zeros((4, 2, 5))
    shapes[range(4), 0, range(4)] = shapes[range(4), 1, range(1, 5)] = 1.0
    nodes, weights = np.polynomial.legendre.leggauss(20)
    for moved, bent in ((0.0, 8.0), (1.0, 8.0), (1.0, 4e-3)):  # at last within the presliding
        q, pulls, history = bent * rng.normal(size=5), rng.uniform(1.0, 30.0, 2), history_of(cells, moved, rng)
        stored = {"lengths": LENGTHS, "q": q, "tip_curvature": 0.0, "curvature_shapes": shapes, "tensions": pulls}
        shape = FingerShape(setup, {f"finger.{key}": value for key, value in stored.items()})
        tendons, dry = friction_of(setup, shape, None if moved else np.array(history[:-1]))
        edges = np.unique(np.concatenate([tendons.edges, dry.edges, setup.finger.profile.breaks]))
        half, middle = 0.5 * np.diff(edges)[:, None], 0.5 * (edges[1:] + edges[:-1])[:, None]
        s, w = (middle + half * nodes).ravel(), (half * weights).ravel()
        found = shape.elastic(s, np.eye(5)) @ (w * (tendons.moment(s, pulls) - dry.moment(s)))
        missing = np.array(model.statics(q, pulls, [0.0, 0.0], [], history)[0]).ravel()
        true = np.array(model.elastic(q, pulls, [])).ravel() - missing
        assert found == pytest.approx(true, abs=1e-9 * np.abs(true).max())


MOTOR = {"kind": "motor", "arrangement": "one_pulley", "winch_radius": 0.008, "inertia": 2e-6, "torque_max": 1.0}


@pytest.mark.deep
@pytest.mark.parametrize(
    "drive", [None, {"kind": "length", "time_constant": 0.02}, MOTOR | {"pretension": 2.0, "position_gain": 2.0}]
)
def test_a_tapered_finger_with_friction_of_both_kinds_is_held_and_certified(drive):
    """Whatever its friction becomes, by tendons at changing distances."""
    wound = {} if drive is None else {"drive": drive, "axial_stiffness": 1e4, "series_stiffness": 33e3}
    more = {"friction": 0.02, "friction_cells": 2, "max_tension": 60.0, **wound}
    tendons = [{"offset": offset, **more} for offset in TAPERED_TENDONS]
    scene = mug(TAPER, **TAPERED_MUG, **FREE_TIP, **{"finger.tendons": tendons, "finger.damping": DRY})
    grasp = optimize_grasp(scene)
    assert grasp.certificate.passed
    margins = grasp.robustness.robust.margins
    assert np.nanmin(margins) > 0.2
    # On a drive of lengths the solver gives up on one draw.
    assert np.isnan(margins).sum() <= (drive is not None and drive["kind"] == "length")
    assert grasp.certificate.model_error.greatest < 2e-3 * LENGTH


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


@pytest.mark.parametrize(
    ("changes", "offsets", "check"),
    [
        ({"thickness": (0.015, 0.0091)}, TAPERED_TENDONS, "contact gap, finger.tip"),
        ({"bending_stiffness": (1.5 * STIFFNESS, 0.72 * STIFFNESS)}, TAPERED_TENDONS, "finger equilibrium, finger"),
        ({}, ((0.006, 0.0044), (-0.006, -0.0044)), "finger equilibrium, finger"),
    ],
)
def test_another_taper_or_tendon_fails_the_certificate(tapered, changes, offsets, check):
    assert tapered.certificate.model_error.small
    assert tapered.certificate.stability.stable
    assert not certify(mug([{**TAPER[0], **changes}], offsets, **TAPERED_MUG), tapered.arrays)[check].passed


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
    # Elements lie as contacts do in the start, which shifts the strain by some millionths.
    assert again.certificate["bending strain, finger"].value == pytest.approx(1.0 / 1.001 - 1.0, rel=5e-3)
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


def test_dry_friction_of_one_cell_turns_together():
    scene = held(case=cases.pinched_box)()[0]
    branches = [{"stiffness": 1.0, "moment": 1e-12}, {"stiffness": 2.0, "moment": 1e-12}]
    scene = scene.changed({f"fingers.{name}.damping.dry_friction": branches for name in ("a", "b")})
    cells = [np.flatnonzero(cell).tolist() for cell in state_cells(scene)]
    tendons, count = scene.setups[0].tendon_friction_states, scene.setups[0].friction_states
    assert cells[: tendons + 1] == [*([k] for k in range(tendons)), [tendons, tendons + 1]]
    assert cells[-1] == [2 * count - 2, 2 * count - 1]
    assert sorted(column for cell in cells for column in cell) == [*range(2 * count)]
