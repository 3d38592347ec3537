"""The grasp: solved and certified; independent solution, closed forms, tampering and hopeless scenes."""

from __future__ import annotations

import ast
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from grasp_oracle import forces, least_tension_arcs, least_tension_clothoids
from grasp_scenes import CONFIGS, PLANAR, UPRIGHT, WEIGHTLESS, make_scene, plant_of
from pydantic import ValidationError
from scipy.optimize import brentq

import continuum_grasp.grasp as grasp_room
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.grasp import Status, certify, optimize_grasp
from continuum_grasp.grasp.dense_rod import DenseRod
from continuum_grasp.grasp.problem import GraspProblem
from continuum_grasp.grasp.seeds import make_seeds
from continuum_grasp.grasp.stability import contact_stability
from continuum_grasp.results import read_run
from continuum_grasp.scene.finger import BasePose, Finger, PointMass, Rod, Tendons
from continuum_grasp.scene.grasp import (
    Circle,
    GraspContacts,
    GraspScene,
    GraspSolver,
    Palm,
)
from continuum_grasp.scene.load import load


@pytest.fixture(scope="module")
def mug():
    return optimize_grasp(CONFIGS / "mug.yaml")


# -- solved, certified, and equal to an independent solution -------------------------------------------------


@pytest.mark.parametrize("name", sorted(p.stem for p in CONFIGS.glob("*.yaml")))
def test_shipped_scenes_are_held(name):
    result = optimize_grasp(CONFIGS / f"{name}.yaml")
    assert result.status is Status.OPTIMAL
    assert result.certificate.passed, result.certificate.failed
    assert result.certificate.stability.stable
    assert result.certificate["finger equilibrium"].value < 1e-9
    assert result.certificate["object force balance"].value < 1e-9


@pytest.mark.parametrize("gravity", [PLANAR, UPRIGHT], ids=lambda g: g.mode)
@pytest.mark.parametrize("base_y", [-0.052, -0.055, -0.060])
def test_arcs_against_linear_programming(gravity, base_y):
    scene = make_scene("arc", gravity, base_y)
    net, curvatures, middle = least_tension_arcs(plant_of(scene))
    result = optimize_grasp(scene)
    assert result.tensions[0] - result.tensions[1] == pytest.approx(net, rel=5e-3)
    assert result.middle_position == pytest.approx(middle, abs=1e-4 * scene.finger.rod.length)
    assert result.q == pytest.approx(np.multiply(curvatures, result.lengths), abs=2e-3)


@pytest.mark.parametrize(
    ("gravity", "base_y"), [(PLANAR, -0.048), (PLANAR, -0.055), (UPRIGHT, -0.055), (UPRIGHT, -0.060)]
)
def test_matched_clothoids_against_linear_programming(gravity, base_y):
    scene = make_scene("matched_clothoid", gravity, base_y)
    net, _, middle = least_tension_clothoids(plant_of(scene), count=60, tolerance=1e-6)
    result = optimize_grasp(scene)
    assert result.tensions[0] - result.tensions[1] == pytest.approx(net, rel=5e-3)
    assert result.middle_position == pytest.approx(middle, abs=5e-3 * scene.finger.rod.length)


def test_two_arcs_can_only_wrap():
    """An arc tangent to a circle that meets it again lies on it; the first arc follows from the base
    alone.
    """
    scene = make_scene("arc", PLANAR)
    rho, d, y = 0.046, 0.055, 0.040  # object seen from the base: d to the left, y ahead
    radius = (d**2 + y**2 - rho**2) / (2 * (d - rho))
    theta = math.atan2(y, radius - d)
    result = optimize_grasp(scene)
    assert result.q[0] == pytest.approx(theta, abs=1e-4)
    assert result.lengths[0] == pytest.approx(radius * theta, abs=2e-5)
    assert result.q[1] == pytest.approx(result.lengths[1] / rho, abs=1e-3)


def test_grasp_without_weight_needs_only_the_bend():
    """Without weight the forces vanish up to what bending the finger to the touching shape takes."""
    scene = make_scene("arc", WEIGHTLESS)
    result = optimize_grasp(scene)
    net, *_ = least_tension_arcs(plant_of(scene))
    assert result.tensions[0] - 1.0 == pytest.approx(net, rel=5e-3)


@pytest.mark.parametrize("mass", [0.0, 0.3])
def test_a_touch_without_force_needs_only_the_bend(mass):
    """Tip off, no weight: one circular arc that touches the mug, F e = E I / radius, and forces of rounding size."""
    contacts = GraspContacts(friction=0.5, normal_force_max=30.0, tip="off")
    result = optimize_grasp(make_scene("arc", WEIGHTLESS, mass=mass, contacts=contacts))
    rho, d, y = 0.046, 0.055, 0.040  # object seen from the base: d to the left, y ahead
    radius = (d**2 + y**2 - rho**2) / (2 * (d - rho))
    assert result.tensions[0] - 1.0 == pytest.approx(6.11e-3 / radius / 0.005, rel=1e-4)
    assert result.certificate.passed


def test_mirrored_scene_gives_the_mirrored_grasp(mug):
    """Mirrored at the x axis, with the base on the other side, tendon 2 pulls instead of tendon 1."""
    scene = mug.scene
    base = scene.finger.base.model_copy(update={"position": (0.0, 0.055)})
    result = optimize_grasp(scene.model_copy(update={"finger": scene.finger.model_copy(update={"base": base})}))
    assert result.tensions[::-1] == pytest.approx(mug.tensions, rel=1e-6)
    assert result.q == pytest.approx(-mug.q, rel=1e-5)
    assert result.contact("tip").position * [1, -1] == pytest.approx(mug.contact("tip").position, abs=1e-6)


@pytest.mark.parametrize("family", ["arc", "clothoid"])
def test_rubbing_tendons_are_certified_too(family):
    free = optimize_grasp(make_scene(family, UPRIGHT))
    rubbing = optimize_grasp(make_scene(family, UPRIGHT, tendon_friction=0.05))
    assert rubbing.certificate.passed
    assert rubbing.tensions[0] > free.tensions[0]


def test_masses_along_the_finger_stay_where_they_are():
    masses = (PointMass(at=0.05, mass=0.01), PointMass(at=0.12, mass=0.02))
    result = optimize_grasp(make_scene("matched_clothoid", PLANAR, -0.048, finger={"masses": masses}))
    assert result.certificate.passed


@pytest.mark.parametrize("off", ["middle", "tip"])
def test_problem_is_square_enough_with_one_contact_off(off):
    """One finger contact alone: whatever comes out is certified or said not to be."""
    contacts = GraspContacts(friction=0.9, normal_force_max=30.0, **{off: "off"})
    scene = make_scene("matched_clothoid", WEIGHTLESS, contacts=contacts, solver=GraspSolver(seeds=2))
    result = optimize_grasp(scene, raise_on_failure=False)
    assert result.solved == bool(result.certificate is not None and result.certificate.passed)
    assert off not in result.arrays["contact_names"]


def test_same_seed_same_result():
    scene = make_scene("arc", UPRIGHT, solver=GraspSolver(seeds=7, random_seed=5))
    first, second = optimize_grasp(scene), optimize_grasp(scene)
    assert all(np.array_equal(first.arrays[k], second.arrays[k]) for k in first.arrays)
    assert len(make_seeds(scene)) == 7


# -- the certificate -----------------------------------------------------------------------------------------

TAMPERED = [
    ("contact_forces", (0, 0), 1e-3, "object force balance"),
    ("contact_forces", (0, 0), 1e-3, "finger equilibrium"),
    ("contact_forces", (1, 1), 1e-3, "object moment balance"),
    ("contact_forces", (1, 1), 1e-3, "tip moment balance"),
    ("contact_forces", (1, 1), 1e-1, "friction cone, tip"),
    ("contact_forces", (2, 0), -10.0, "normal force, palm"),
    ("contact_forces", (2, 2), 1e-3, "object lift balance"),
    ("contact_forces", (2, 2), 1e-3, "object tilt balance"),
    ("contact_positions", (1, 0), 1e-5, "stored contact, tip"),
    ("contact_normals", (0, 0), 1e-4, "stored contact, middle"),
    ("q", 0, 0.05, "finger equilibrium"),
    ("q", 0, 0.01, "contact gap, middle"),
    ("q", 1, 0.01, "contact gap, tip"),
    ("q", 0, 0.01, "contact tangency, middle"),
    ("q", 1, 8.0, "penetration into the object"),
    ("q", 1, -80.0, "penetration into the palm"),
    ("q", 1, 200.0, "bending range"),
    ("q", 1, 0.1, "stored backbone"),
    ("lengths", 0, 1e-5, "element lengths"),
    ("lengths", 0, 1e-5, "contact gap, tip"),
    ("lengths", 0, 0.1, "middle contact position"),
    ("tip_curvature", (), 0.01, "tip moment balance"),
    ("tensions", 0, 0.01, "finger equilibrium"),
    ("tensions", 0, 30.0, "tendon tension"),
    ("backbone", (50, 1), 1e-4, "stored backbone"),
    ("tensions", 1, np.nan, "numbers that are not finite"),
]


@pytest.mark.parametrize(("name", "index", "change", "check"), TAMPERED)
def test_certificate_sees_a_tampered_result(mug, name, index, change, check):
    arrays = {k: np.array(v) for k, v in mug.arrays.items()}
    arrays[name][index] += change
    certificate = certify(mug.scene, arrays)
    assert not certificate[check].passed
    assert not certificate.passed


def test_certificate_fails_on_nan(mug):
    arrays = {k: np.array(v) for k, v in mug.arrays.items()}
    arrays["contact_forces"][0, 1] = np.nan
    assert not certify(mug.scene, arrays).passed


def test_certificate_of_another_scene_fails(mug):
    heavier = mug.scene.model_copy(update={"object": mug.scene.object.model_copy(update={"mass": 0.31})})
    assert [c.name for c in certify(heavier, mug.arrays).failed] == ["object lift balance"]


def test_strain_is_checked(mug):
    """The hand finger as a wire of 1.2 mm: its greatest curvature is the tip's."""
    rod = Rod(length=0.18, diameter=1.2e-3, density=6450.0, youngs_modulus=60e9)
    greatest = float(mug.arrays["tip_curvature"]) * 0.6e-3
    finger = mug.scene.finger.model_copy(update={"rod": rod, "strain_limit": 0.99 * greatest})
    certificate = certify(mug.scene.model_copy(update={"finger": finger}), mug.arrays)
    assert certificate["bending strain"].value == pytest.approx(0.01 / 0.99, rel=1e-6)
    assert not certificate["bending strain"].passed


def test_certificate_shares_nothing_with_the_optimiser():
    room = Path(grasp_room.__file__).parent
    pending, seen = ["certificate"], set()
    while pending:
        module = pending.pop()
        seen.add(module)
        for node in ast.walk(ast.parse((room / f"{module}.py").read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert not name.startswith(("casadi", "continuum_grasp.model", "continuum_grasp.core", "scipy"))
                if name.startswith("continuum_grasp.grasp.") and (inner := name.rpartition(".")[2]) not in seen:
                    pending.append(inner)
    assert seen == {"certificate", "dense_rod", "model_error", "recomputed", "stability"}


def test_dense_rod_against_a_circle():
    finger = Finger(rod=Rod(length=0.3, linear_density=1.0, bending_stiffness=1.0), base=BasePose(position=(0.1, 0.2)))
    rod = DenseRod(finger, np.array([0.1, 0.2]))
    points = rod.edge_points(np.full((2, 2), 5.0))
    s = rod.edges
    exact = np.array([0.1, 0.2]) + np.stack([np.cos(5 * s) - 1, np.sin(5 * s)], axis=1) / 5
    assert np.abs(points - exact).max() < 1e-15
    mean = np.array([0.1 * 0.3 + (np.sin(1.5) / 5 - 0.3) / 5, 0.2 * 0.3 + (1 - np.cos(1.5)) / 25])
    assert rod.mean_point(np.full((2, 2), 5.0)) == pytest.approx(mean, abs=1e-15)


@pytest.mark.parametrize("radius", [0.02, 0.5, 1e6])
def test_stability_of_a_column_under_a_disc(radius):
    """A straight thin finger presses a disc against a flat palm opposite, both contacts rolling.

    The disc acts at the tip as a spring of stiffness -P / (4 R); a clamped column with it buckles at E I z^2
    / L^2, tan z = z (1 + 4 R / L). R to infinity: the clamped free column, z = pi / 2.
    """
    length, stiffness = 0.2, 0.01
    finger = Finger(
        rod=Rod(length=length, linear_density=0.01, bending_stiffness=stiffness),
        tendons=Tendons(offset=0.005, max_tension=10.0),
    )
    scene = GraspScene(
        schema_version=1,
        finger=finger,
        object=Circle(shape="circle", diameter=2 * radius, mass=0.0, position=(0.0, length + radius)),
        palm=Palm(point=(0.0, length + 2 * radius), normal_angle=-math.pi / 2),
        contacts=GraspContacts(friction=0.5, normal_force_max=10.0, middle="off"),
        gravity=WEIGHTLESS,
    )
    z = brentq(lambda z: math.sin(z) - z * (1 + 4 * radius / length) * math.cos(z), 0.1, math.pi / 2)
    critical = stiffness * (z / length) ** 2
    rod = DenseRod(finger, np.array([length / 2, length / 2]))
    up, ends = np.array([0.0, 1.0]), np.zeros((2, 2))
    for load_, stable in ((0.995 * critical, True), (1.005 * critical, False)):
        found = contact_stability(scene, rod, ends, {"tip": (-up, -load_ * up), "palm": (up, load_ * up)})
        assert found.stable is stable


# -- no grasp ------------------------------------------------------------------------------------------------


def test_weak_tendon_is_named_with_the_tension_needed():
    needed = optimize_grasp(make_scene("arc", UPRIGHT)).tensions[0]
    with pytest.raises(SolverError) as caught:
        optimize_grasp(make_scene("arc", UPRIGHT, max_tension=0.8 * needed))
    result = caught.value.result
    assert result.status is Status.INFEASIBLE
    assert caught.value.violated
    reason = next(r for r in result.reasons if r.name == "tension")
    assert reason.key == "finger.tendons.max_tension"
    assert reason.needed == pytest.approx(needed, rel=1e-3)


@pytest.mark.parametrize(("gravity", "most"), [(PLANAR, 33.0), (UPRIGHT, 60.0)], ids=["planar", "out_of_plane"])
def test_low_friction_is_named_with_the_coefficient_needed(gravity, most):
    plant = plant_of(make_scene("arc", gravity, max_tension=most))
    _, curvatures, middle = least_tension_arcs(plant)
    low, high = 0.0, 3.0
    for _ in range(20):
        half = 0.5 * (low + high)
        held = forces(dataclasses.replace(plant, friction=half), curvatures, middle, "arc") is not None
        low, high = (low, half) if held else (half, high)
    result = optimize_grasp(make_scene("arc", gravity, max_tension=most, friction=0.6 * high), raise_on_failure=False)
    assert result.status is Status.INFEASIBLE
    reason = next(r for r in result.reasons if r.name == "friction")
    assert reason.needed == pytest.approx(high, rel=5e-3)
    for share, held in ((1.01, True), (0.98, False)):
        scene = make_scene("arc", gravity, max_tension=most, friction=share * high)
        assert optimize_grasp(scene, raise_on_failure=False).solved is held


def test_heavy_object_is_named_with_the_mass_that_can_be_held():
    result = optimize_grasp(make_scene("arc", UPRIGHT, mass=1.2), raise_on_failure=False)
    assert result.status is Status.INFEASIBLE
    reason = next(r for r in result.reasons if r.name == "mass")
    assert "object.mass" in result.table()
    for share, held in ((0.99, True), (1.01, False)):
        assert (
            optimize_grasp(make_scene("arc", UPRIGHT, mass=share * reason.needed), raise_on_failure=False).solved
            is held
        )


def test_reasons_of_clothoids_against_linear_programming():
    """Too heavy for its tendon: the tension that the independent solution needs is the one that is named."""
    scene = make_scene("matched_clothoid", UPRIGHT, mass=0.7)
    net, *_ = least_tension_clothoids(plant_of(scene, tension_max=1e3, normal_max=1e3), count=60, tolerance=1e-6)
    result = optimize_grasp(scene, raise_on_failure=False)
    assert result.status is Status.INFEASIBLE
    reason = next(r for r in result.reasons if r.name == "tension")
    assert reason.needed - 1.0 == pytest.approx(net, rel=5e-3)


def test_out_of_reach_is_exact_and_needs_no_solver():
    far = Circle(shape="circle", diameter=0.08, mass=0.3, position=(0.5, 0.0))
    result = optimize_grasp(make_scene(object=far, palm=None), raise_on_failure=False)
    assert result.status is Status.INFEASIBLE
    assert [r.name for r in result.reasons] == ["reach"]
    assert result.statistics["solver_seconds"] == 0


@pytest.mark.parametrize("solver", [GraspSolver(max_iterations=3), GraspSolver(time_limit=1e-6)])
def test_an_interrupted_search_is_not_called_infeasible(solver):
    result = optimize_grasp(make_scene("matched_clothoid", UPRIGHT, solver=solver), raise_on_failure=False)
    assert result.status is Status.NOT_SOLVED
    assert result.advice
    with pytest.raises(SolverError, match="not_solved"):
        optimize_grasp(make_scene("matched_clothoid", UPRIGHT, solver=solver))


# -- use -----------------------------------------------------------------------------------------------------


def test_saved_result_can_be_verified_again(mug, tmp_path):
    run = read_run(mug.save(tmp_path / "run"))
    assert run.meta["status"] == "optimal"
    assert certify(GraspScene.model_validate(run.meta["config"]), run.arrays).passed


def test_table_tells_the_figures(mug):
    text = mug.table()
    assert f"{mug.tensions[0]:.3f} N" in text
    assert "all checks passed" in text
    assert all(contact.name in text for contact in mug.contacts)


def test_picture(mug, tmp_path):
    ax = mug.plot()
    assert ax.get_xlabel() == "x [mm]"
    assert len(ax.patches) >= 6
    mug.plot(tmp_path / "mug.png")
    assert (tmp_path / "mug.png").stat().st_size > 10_000


def test_constraints_know_where_they_come_from():
    problem = GraspProblem(make_scene("arc", UPRIGHT))
    assert all(block.name and block.key and block.unit and block.scale > 0 for block in problem.parts.blocks)
    assert len({block.name for block in problem.parts.blocks}) == len(problem.parts.blocks)


@pytest.mark.parametrize(
    "change",
    [
        {"gravity": {"mode": "sideways"}},
        {"gravity": None},
        {"contacts": {"friction": 0.5, "normal_force_max": 10.0, "middle": "off", "tip": "off"}},
        {"contacts": {"friction": 0.5}},
        {"object": {"shape": "circle", "diameter": 0.08, "mass": 0.3, "position": (0.02, 0.0)}},
        {"object": {"shape": "circle", "diameter": 0.08, "mass": 0.3, "position": (0.04, -0.05)}},
        {"fidelity": {"elements": 1}},
        {"fidelity": {"tolerance": 0.005}},
        {"fidelity": {"frequencies": 2}},
        {"fidelity": {"elements": (0.09, 0.09)}},
        {"contacts": {"friction": 0.5, "normal_force_max": 10.0, "middle_after": 2}},
        {"solver": {"penetration_tolerance": 0.0}},
        {"unknown": 1},
    ],
)
def test_senseless_scenes_are_refused(change):
    data = make_scene().model_dump()
    data.update(change)
    if change.get("gravity", 1) is None:
        del data["gravity"]
    with pytest.raises(ValidationError):
        GraspScene.model_validate(data)


def test_a_file_of_another_kind_is_refused():
    with pytest.raises(InputError, match="grasp scene"):
        optimize_grasp(Path(__file__).parents[1] / "configs" / "fingers" / "hand_finger.yaml")
    assert isinstance(load(CONFIGS / "mug.yaml"), GraspScene)
