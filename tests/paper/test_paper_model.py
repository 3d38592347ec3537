"""The paper's own models: against the model in 50 digits, against each other, and what their errors do to a motion."""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from benchmarks.paper import VARIANTS, PaperModel, TwoArcs, appendix, paper_errors
from benchmarks.paper.slips import DYNAMIC, AsPrinted
from continuum_grasp.base import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import BasePose, Damping, Finger, ForceLoad, MomentLoad, PointMass, Rod, Tendons
from tests.arc_quadrature import relative
from tests.errata_page import number, table
from tests.rods import NITINOL, rod_scene
from tests.truth import Rod as TruthRod
from tests.truth import TruthFinger, to_numpy

L1, L2 = 0.25, 0.35
ROD = Rod(length=L1 + L2, linear_density=0.02, bending_stiffness=0.047, rotary_inertia=1e-6)
FULL = Finger(
    rod=ROD,
    rest_curvature=0.4,
    damping=Damping(per_arc=1e-4, material=3e-5),
    masses=(PointMass(at=L1, mass=0.01), PointMass(at=L1 + L2, mass=0.02)),
    tendons=Tendons(offset=0.005, max_tension=40.0),
    base=BasePose(angle=-0.6),
)
SETTINGS = {"contacts": (L1,), "gravity": (1.0, -9.81)}
RATE, U, W = (2.0, -3.0), (3.0, 1.0), (0.1, 0.2, -0.3, 0.4)
ACROSS = {"appendix_printed": {"gravity_across": True}}


def paper(variant: str, finger: Finger = FULL, **settings) -> PaperModel:
    return PaperModel(finger, variant, **{**SETTINGS, **ACROSS.get(variant, {}), **settings})


def precise(theta, rate=None, inertia=1e-6) -> TruthRod:
    finger = TruthFinger(
        [L1, L2],
        mass_per_length=0.02,
        rotary_inertia=inertia,
        bending_stiffness=0.047,
        rest_curvature=0.4,
        masses=((L1, 0.01), (L1 + L2, 0.02)),
        gravity=SETTINGS["gravity"],
        base_angle=-0.6,
        material_damping=3e-5,
        element_damping=1e-4,
    )
    return TruthRod(finger, above_rest(theta), rate)


def above_rest(theta) -> list[float]:
    return [theta[0] - 0.4 * L1, theta[1] - 0.4 * L2]


def wanted(theta, inertia=1e-6) -> np.ndarray:
    forces = [(L1, *W[:2]), (L1 + L2, *W[2:])]
    return to_numpy(precise(theta, RATE, inertia).acceleration(forces, (U[0] - U[1]) * 0.005))


def found(model: FingerModel, theta) -> np.ndarray:
    return model.forward_dynamics([*above_rest(theta), *RATE], U, W, model.p_nominal).full()[2:, 0]


@pytest.mark.parametrize(
    ("variant", "theta", "tolerance"),
    [
        ("closed_corrected", (0.9, -1.2), 1e-11),
        ("closed_corrected", (0.4, 0.5), 1e-11),
        ("closed_corrected", (-2.0, 1.7), 1e-11),
        ("appendix_corrected", (0.0, 0.0), 1e-13),
        ("appendix_corrected", (0.1, -0.1), 1e-7),
        ("appendix_corrected", (0.4, -0.5), 5e-5),
    ],
)
def test_corrected_variants_are_the_exact_model(variant, theta, tolerance):
    assert relative(found(paper(variant), theta), wanted(theta)) < tolerance


@pytest.mark.parametrize("variant", ["closed_printed", "appendix_printed", "appendix_unrotated"])
def test_other_variants_are_not(variant):
    assert relative(found(paper(variant), (0.9, 0.8)), wanted((0.9, 0.8))) > 2e-2


def test_straight_finger_shows_what_the_appendix_has_right():
    """All of R vanishes in M at zero angles; as printed, only the rotary inertia is missing there."""
    rates = np.zeros(2)
    for variant, inertia in (("appendix_unrotated", 1e-6), ("appendix_printed", 0)):
        mass = np.array(paper(variant).mass_matrix(above_rest((0, 0)), U, []))
        assert mass == pytest.approx(to_numpy(precise((0, 0), rates, inertia).mass), rel=1e-13)


@pytest.mark.parametrize("variant", VARIANTS)
def test_functions_of_a_variant_belong_together(variant):
    """M qdd + bias + gravity + elastic + damping = actuation + external forces, and the kinetic energy is M's."""
    model, theta = paper(variant), (0.5, -0.8)
    q = above_rest(theta)
    part = {
        "M": model.mass_matrix(q, U, []),
        "b": model.bias(q, RATE, U, []),
        "G": model.gravity(q, U, []),
        "K": model.elastic(q, U, []),
        "D": model.damping(q, RATE, U, []),
    }
    right = model.actuation(q, U, []) + model.external_force(q, U, W, [])
    rest = right - part["b"] - part["G"] - part["K"] - part["D"]
    qdd = np.linalg.solve(part["M"].full(), rest.full()[:, 0])
    assert found(model, theta) == pytest.approx(qdd, rel=1e-9)
    kinetic = float(model.energy([*q, *RATE], U, [])[0])
    assert kinetic == pytest.approx(0.5 * np.array(RATE) @ part["M"].full() @ RATE, rel=1e-12)
    assert model.x_names == FingerModel(FULL, family="arc", elements=2, **SETTINGS).x_names


def test_slips_chosen_all_are_the_printed_closed_forms():
    q = (0.5, -0.8)
    assert found(paper("closed_corrected", slips=DYNAMIC), q).tolist() == found(paper("closed_printed"), q).tolist()
    one = found(paper("closed_corrected", slips=["(36) twice"]), q)
    assert 1e-3 < relative(one, wanted(q)) < 10


def test_variants_are_compiled_like_any_model():
    model = paper("appendix_corrected")
    theta = (0.3, -0.4)
    x = np.array([*above_rest(theta), *RATE])
    assert cg.compile(model).forward_dynamics(x, U, W)[2:] == pytest.approx(found(model, theta), rel=1e-12)


REFUSED = [
    ({"variant": "appendix"}, "unknown variant"),
    ({"variant": "appendix_printed"}, "no gravity across"),
    ({"variant": "appendix_corrected", "gravity_across": True}, "is for appendix_printed"),
    ({"variant": "closed_printed", "slips": ["(25) column"]}, "chosen for closed_corrected"),
    ({"variant": "closed_corrected", "slips": ["(99)"]}, "unknown slip"),
    ({"variant": "closed_corrected", "family": "clothoid"}, "circular arcs"),
    ({"variant": "closed_corrected", "elements": 3}, "two arcs"),
    ({"variant": "closed_corrected", "contacts": (), "elements": (0.3, 0.3)}, "mass_0 is elsewhere"),
    ({"variant": "closed_corrected", "loads": (ForceLoad(at=0.1, force=(1.0, 0.0)),)}, "at 0.1 m"),
    ({"variant": "closed_corrected", "loads": (MomentLoad(at=L1, moment=1.0),)}, "fixed direction"),
]


@pytest.mark.parametrize(("settings", "message"), REFUSED)
def test_what_the_paper_does_not_describe_is_refused(settings, message):
    with pytest.raises(InputError, match=message):
        PaperModel(FULL, **{**SETTINGS, **settings})


def test_unknown_slips_are_refused_where_they_are_asked_for():
    with pytest.raises(KeyError):
        AsPrinted().__contains__("(99)")
    with pytest.raises(InputError, match="not a matter of a factor"):
        AsPrinted().factor("(24) plus")


# What the errors do to the shape at rest and to the frequencies about it.


def test_the_papers_slips_show_in_the_frequencies():
    scene = rod_scene(
        NITINOL, "arc", 2, fidelity={"bending_range": 3.0}, tip_mass=0.02, time={"duration": 0.3, "step": 0.005}
    )
    found = {name: one.frequencies[1] for name, one in paper_errors(scene).items()}
    assert found["closed_corrected"] == pytest.approx(found["two arcs"], rel=1e-6)
    off = {name: abs(found[f"appendix_{name}"] - found["two arcs"]) for name in ("corrected", "printed")}
    assert off["corrected"] < off["printed"]


# The motion of the page: the paper's rod along -X, so that a negative bend is upward.

DENSITY, STIFFNESS = 6450 * math.pi * 0.001**2, 60e9 * math.pi * 0.002**4 / 64
STEPS, STEP = 2400, 2.5e-4
READINGS = ("corrected", "unrotated", "printed")


def released(tip_mass: float) -> Finger:
    return Finger(
        rod=Rod(length=0.6, linear_density=DENSITY, bending_stiffness=STIFFNESS),
        masses=(PointMass(at=0.6, mass=tip_mass),) if tip_mass else (),
        base=BasePose(angle=math.pi / 2),
    )


@cache
def tip_path(tip_mass: float, start: float, reading: str, rod_only: bool) -> np.ndarray:
    """Tip over 0.6 s [m]; ``rod_only``: M and V of the rod by the appendix, all else exact."""
    exact = FingerModel(released(tip_mass), family="arc", elements=2, tip_force=False, bending_range=2.2)
    x = ca.SX.sym("x", 4)
    q, qd = x[:2], x[2:]
    if reading == "exact" or rod_only:
        mass, force = exact.mass_matrix(q, 0, []), -exact.inverse_dynamics(q, qd, [0, 0], 0, [], [])
        if reading != "exact":
            bare = FingerModel(
                released(0.0), family="arc", elements=2, tip_force=False, gravity=(0, 0), bending_range=2.2
            )
            rod = appendix.terms(TwoArcs((0.3, 0.3), DENSITY), q, qd, reading)
            mass = mass - bare.mass_matrix(q, 0, []) + rod.mass
            force = force + bare.bias(q, qd, 0, []) - rod.bias
        rate = ca.Function("rate", [x], [ca.vertcat(qd, ca.solve(mass, force))])
    else:
        variant = f"appendix_{reading}"
        model = PaperModel(released(tip_mass), variant, tip_force=False, **ACROSS.get(variant, {}))
        rate = ca.Function("rate", [x], [model.forward_dynamics(x, 0, [], [])])
    k1 = rate(x)
    k2 = rate(x + STEP / 2 * k1)
    k3 = rate(x + STEP / 2 * k2)
    k4 = rate(x + STEP * k3)
    step = ca.Function("step", [x], [ca.cse(x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4))])
    states = np.array(step.mapaccum(STEPS)([start, start, 0.0, 0.0]))
    return np.array(exact.tip.map(STEPS)(states[:2], 0, []))


@pytest.mark.parametrize("row", table("Effect on a motion"), ids=lambda row: f"{row[0]} {row[1]}")
def test_effect_on_a_motion(row):
    tip_mass = 0.0 if row[0] == "no" else float(row[0].split()[0]) / 1000
    start = float(row[1])
    exact = tip_path(tip_mass, start, "exact", True)
    cells = iter(row[2:])
    for rod_only in (True, False):
        for reading in READINGS:
            error = tip_path(tip_mass, start, reading, rod_only) - exact
            value, half = number(next(cells))
            assert np.sqrt((error**2).sum(axis=0).mean()) / 0.6 == pytest.approx(value, abs=1.05 * half, rel=2e-3)


def test_the_released_rod_goes_up_first_and_keeps_its_energy():
    """The reference itself: bends of the page's sign are upward, and the step is short enough."""
    model = FingerModel(released(0.01), family="arc", elements=2, tip_force=False)
    assert float(model.tip((-0.5, -0.5), 0, [])[1]) > 0
    core = cg.compile(model)
    states = core.rollout([-0.5, -0.5, 0.0, 0.0], steps=STEPS, step=STEP)
    energies = [sum(float(e) for e in model.energy(x, 0, [])) for x in (states[0], states[-1])]
    assert energies[1] == pytest.approx(energies[0], rel=1e-7)
