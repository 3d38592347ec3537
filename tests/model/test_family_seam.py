"""A curvature family of the tests' own, one file and one line of the table, in everything that takes a family."""

from __future__ import annotations

import math

import numpy as np
import pytest
from export_cases import STRICT, TENDONS, compile_programs, run
from grasp_scenes import make_scene

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.export import export_c
from continuum_grasp.scene import FAMILIES, Damping, Fidelity, Finger, Rod, Scene, load
from tests.control_cases import TARGET, rod_scene
from tests.finger_cases import LENGTHS, LOADS, Case, State, errors, worst
from tests.quadratic_family import ENTRY, NAME

FINGER = Finger(
    rod=Rod(length=0.6, linear_density=0.0203, bending_stiffness=0.0471, rotary_inertia=1e-8),
    damping=Damping(material=2e-4),
)


@pytest.fixture(scope="module", autouse=True)
def _registered():
    FAMILIES[NAME] = ENTRY
    yield
    del FAMILIES[NAME]


def hanging(elements: int, accuracy: float | None = 1e-13, **changes) -> Scene:
    """The rod, bent by a moment at its tip, under its weight."""
    given = {
        "finger": FINGER,
        "gravity": (0.0, -9.81),
        "fidelity": Fidelity(family=NAME, elements=elements, accuracy=accuracy),
        "actuation": {"tip_moment": 0.1},
    }
    return Scene(**{**given, **changes})


def test_a_scene_may_name_it_only_while_it_is_in_the_table():
    assert hanging(1).fidelity.family == NAME
    del FAMILIES[NAME]
    try:
        with pytest.raises(ValueError, match="'arc', 'clothoid' or 'matched_clothoid'"):
            hanging(1)
    finally:
        FAMILIES[NAME] = ENTRY


@pytest.mark.parametrize("elements", [1, 2])
def test_dynamics_against_quadrature_with_50_digits(elements):
    case = Case(loads=LOADS, contacts=LENGTHS[elements][:-1])
    model = case.model(NAME, elements, bending_range=2.1, accuracy=1e-13)
    random = np.random.default_rng(elements)
    at = State(
        random.uniform(-1.0, 1.0, model.n) * model.structure.coordinate_limits(),
        random.uniform(-10.0, 10.0, model.n),
        random.uniform(-0.2, 0.2, model.nu),
        random.uniform(-1.0, 1.0, model.nw),
    )
    found = errors(case, model, at)
    assert worst(found)[1] < 1e-13, found


def test_equilibrium_of_a_moment_alone_is_an_arc_and_modes_are_those_of_the_beam():
    free = hanging(2, gravity=(0.0, 0.0))
    kappa = 0.1 / 0.0471
    found = cg.equilibrium(free)
    np.testing.assert_allclose(found.q, kappa, rtol=1e-10)
    tip = [(math.cos(kappa * 0.6) - 1.0) / kappa, math.sin(kappa * 0.6) / kappa]
    np.testing.assert_allclose(found.tip, tip, rtol=1e-10)
    slender = FINGER.model_copy(update={"rod": FINGER.rod.model_copy(update={"rotary_inertia": 0.0})})
    straight = hanging(2, finger=slender, gravity=(0.0, 0.0), actuation=None)
    beam = np.array([1.8751040687, 4.6940911330]) ** 2 / (2.0 * math.pi) * math.sqrt(0.0471 / (0.0203 * 0.6**4))
    first, second = cg.modes(straight).frequencies_hz[:2]
    assert first == pytest.approx(beam[0], rel=1e-5)
    assert second == pytest.approx(beam[1], rel=2e-3)


def test_shape_converges_with_the_order_that_it_states():
    tips = [cg.equilibrium(hanging(count)).tip for count in (1, 2, 4)]
    coarse, fine = (np.linalg.norm(tip - tips[-1]) for tip in tips[:2])
    assert math.log2(coarse / fine) == pytest.approx(6.0, abs=1.0)


@pytest.mark.deep
def test_simulation_without_damping_conserves_energy_and_draws(tmp_path):
    undamped = FINGER.model_copy(update={"damping": Damping()})
    timing = {"duration": 0.1, "step": 0.01, "method": "reference"}
    motion = cg.simulate(hanging(1, finger=undamped, actuation=None, initial={"q": (2.0, 1.0, 0.0)}, time=timing))
    total = motion.kinetic + motion.potential
    np.testing.assert_allclose(total, total[0], atol=1e-8 * motion.kinetic.max())
    assert len(motion.save_pictures(tmp_path)) > 0


def test_a_tolerance_chooses_it_and_is_satisfied():
    chosen = cg.choose_fidelity(hanging(1, fidelity=Fidelity(family=NAME, tolerance=1e-3)))
    assert chosen.best.choice.family == NAME
    assert chosen.best.shape <= 1e-3


@pytest.mark.deep
def test_a_controller_reaches_the_target(tmp_path):
    scene = rod_scene(
        finger=FINGER,
        gravity=(0.0, 0.0),
        fidelity=Fidelity(family=NAME, elements=1, accuracy=1e-3, bending_range=2.0),
        controller={
            "period": 0.02,
            "horizon": {"stages": 5, "stage": 0.02},
            "cost": {"tip": {"running": 2e3, "terminal": 20.0}, "effort": 0.01},
            "bounds": {"curvature": 4.0},
            "input": {"moment_max": 0.3},
        },
        reference={"tip": TARGET},
        estimator=None,
        duration=0.6,
        plant={"fidelity": {"family": NAME, "elements": 1, "accuracy": 1e-3}},
    )
    loop = cg.run_closed_loop(scene)
    assert np.linalg.norm(loop.tip[-1] - np.array(TARGET)) < 0.1 * np.linalg.norm(loop.tip[0] - np.array(TARGET))
    assert len(loop.save_pictures(tmp_path)) > 0


def test_the_c_package_passes_its_own_vectors(tmp_path):
    scene = load(TENDONS, {"fidelity.family": NAME, "fidelity.elements": 1, "fidelity.accuracy": 1e-3})
    export_c(scene, tmp_path / "package", substeps=4)
    (program,) = compile_programs("gcc", tmp_path / "package", tmp_path, "main", *STRICT, "-O1")
    assert " 0 of " in run(program)


@pytest.fixture(scope="module")
def grasp():
    return cg.optimize_grasp(make_scene(NAME))


def test_a_grasp_is_certified_and_near_to_that_of_many_clothoids(grasp):
    assert grasp.certificate.passed
    other = cg.optimize_grasp(make_scene("matched_clothoid", elements=8))
    tension = [sum(finger.tensions.sum() for finger in found.fingers.values()) for found in (grasp, other)]
    assert tension[0] == pytest.approx(tension[1], rel=1e-2)
    assert grasp.quality.epsilon_l1 == pytest.approx(other.quality.epsilon_l1, rel=0.05)


def test_what_it_cannot_do_is_said():
    with pytest.raises(InputError, match="one turn"):
        cg.FingerModel(FINGER, family=NAME, bending_range=7.0).mass_matrix  # noqa: B018
