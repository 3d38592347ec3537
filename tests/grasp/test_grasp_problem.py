"""The pieces of the grasp problem; from inside: its rows, points and elements, which only the solver sees.

The pieces of the grasp problem: distances, surfaces, sensitivities, disturbances, elements by tolerance, modes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from grasp_scenes import CONFIGS, make_scene
from numpy.testing import assert_allclose
from scipy.integrate import simpson

from continuum_grasp.grasp import Quality, Resistance, optimize_grasp
from continuum_grasp.grasp.modes import contact_modes, with_elements
from continuum_grasp.grasp.problem import points, surroundings, values
from continuum_grasp.grasp.problem.parts import friction_cone
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.solver_run import OPTION_SETS, GraspSolverRun
from continuum_grasp.grasp.problem.structure import FingerSpec, ProblemSpec
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.model import CurvesSpec, FingerModel, TouchingCircle, backbone_of, surface_of
from continuum_grasp.model.surfaces.offset_polygon import pieces_of
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import (
    Circle,
    Disturbances,
    Fidelity,
    Finger,
    FingerContacts,
    Freedom,
    GraspContacts,
    MomentLoad,
    ObjectiveWeights,
    OffsetPolygon,
    Palm,
    PointMass,
    Profile,
    Rod,
    SuperellipsePart,
    Tendons,
    load,
)
from tests.grasp.test_grasp_problem_limits import first_start, posed

SHARP = OffsetPolygon(((-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (-0.05, 0.03)))
PARTS = {
    "disc": OffsetPolygon(((0.01, 0.02),), 0.04),
    "box": SHARP,
    "rounded": OffsetPolygon(SHARP.vertices, 0.01),
    "slot": OffsetPolygon(((-0.03, 0.0), (0.03, 0.01)), 0.015),
    "ellipse": SuperellipsePart(semi_axes=(0.05, 0.03), center=(0.01, 0.0), angle=0.4),
    "superellipse": SuperellipsePart(semi_axes=(0.05, 0.03), exponent=3.3, center=(0.0, 0.01), angle=-0.7),
}


# -- surfaces and distances ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PARTS)
def test_circles_stand_for_the_surface_near_a_place_to_the_third_order(name):
    part, surface = PARTS[name], surface_of(PARTS[name])
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.12, 0.12, (300, 2))
    points = points[surface.nearest_places(part, points)[1] > 2e-3]
    angles = rng.uniform(-math.pi, math.pi, len(points))
    circles, distances = surface.circles(part, points, 0.2)
    point, near = ca.SX.sym("point", 2), ca.SX.sym("near", TouchingCircle.SIZE)
    function = ca.Function("d", [point, near], [TouchingCircle(near).distance(point)])
    assert_allclose(np.array(function(points.T / 0.2, circles)).ravel(), distances, atol=3e-9)
    errors = []
    for step in (2e-3, 1e-3):
        moved = points + step * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        found = np.array(function(moved.T / 0.2, circles)).ravel() * 0.2
        errors.append(np.abs(found - surface.nearest_places(part, moved)[1]))
    if name in ("ellipse", "superellipse"):
        # Where the nearest place stays: the median of the ratios is that of the third power.
        assert np.median(errors[0] / errors[1]) > 7.0
    else:
        # Exact, but where the nearest feature is another one.
        assert np.quantile(errors[0], 0.85) < 1e-9


@pytest.mark.parametrize("name", PARTS)
def test_places_on_features_are_on_the_surface_with_its_normal(name):
    part, smooth = PARTS[name], name in ("ellipse", "superellipse")
    for index in range(1 if smooth else len(pieces_of(part))):
        feature = surface_of(part).feature(part, index, 0.01)
        place = ca.SX.sym("place", surface_of(part).place_count)
        surface = surface_of(part).point(place, ca.SX(feature.numbers))
        function = ca.Function("f", [place], [surface.point, surface.normal, surface.on_surface])
        t = 0.3 + index
        low, high = feature.lower[0], feature.upper[0]
        at = _on_superellipse(t, part.exponent) if smooth else (low + 0.4 * (high - low) if math.isfinite(low) else t,)
        point, normal, off = (np.array(v).ravel() for v in function(at))
        assert np.abs(off).max(initial=0.0) < 1e-8
        away = point + 0.01 * normal
        direction, distance, _ = surface_of(part).nearest_places(part, away[None])
        assert distance[0] == pytest.approx(0.01, abs=1e-8)
        assert_allclose([math.cos(direction[0]), math.sin(direction[0])], normal, atol=1e-5)
        angle = math.atan2(normal[1], normal[0])
        again = surface_of(part).place(part, feature, (point[0], point[1]), angle)
        assert_allclose(again, at, atol=1e-9)
        assert surface_of(part).near(part, (point[0], point[1]), angle, 0.01) == feature


def _on_superellipse(t, power):
    c, s = math.cos(t), math.sin(t)
    size = (abs(c) ** power + abs(s) ** power) ** (-1.0 / power)
    return c * size, s * size


LOADED = {
    "element_lengths": [0.2, 0.45, 0.35],
    "gravity": [0.3, -2.0],
    "rest_curvature": [0.4],
    "tendon_friction": [0.1],
    "tip_mass": [0.2],
}


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_places_and_equilibrium_are_those_of_the_model(family):
    """The running sums of the grasp against the recursions of the model, which share no integral with them."""
    # A matched tip carries no tendon friction.
    loaded = {key: value for key, value in LOADED.items() if family != "matched_clothoid" or key != "tendon_friction"}
    finger = Finger(
        rod=Rod(length=1.0, linear_density=1.0, bending_stiffness=1.0),
        masses=(PointMass(at=1.0, mass=0.2),),
        tendons=Tendons(offset=0.1, max_tension=9.0, friction=0.1 if "tendon_friction" in loaded else 0.0),
    )
    model = FingerModel(
        finger,
        family=family,
        elements=3,
        gravity=(0, 0),
        contacts=(1 / 3, 2 / 3),
        loads=(MomentLoad(at=1 / 3, moment=0.0), MomentLoad(at=2 / 3, moment=0.0), MomentLoad(at=1.0, moment=0.0)),
        tip_force=True,
        parameters=tuple(loaded),
        accuracy=1e-13,
    )
    q, u, p = np.array([0.5, -0.4, 0.9, 0.3][: model.n]), [3.0, 1.0, 0.2], np.concatenate(list(loaded.values()))
    w, lengths = np.array([0.5, -1.0, 0.2, 0.8, -0.7, 0.1, 0.3, -0.2]), LOADED["element_lengths"]
    starts, backbone = np.cumsum([0.0, *lengths]), backbone_of(model, CurvesSpec(()))
    r, angles = (np.array(v) for v in backbone.joints(q, u, p))
    for k in range(3):
        assert_allclose(r[:, k], np.array(model.position(q, u, starts[k + 1], p)).ravel(), atol=1e-12)
        assert float(angles[k, 0]) == pytest.approx(float(model.orientation(q, u, starts[k + 1], p)), abs=1e-12)
    fractions = np.array([[0.1, 0.5, 0.9], [0.7, 0.2, 0.4]])
    places = np.array(backbone.places(2)(q, u, fractions, p))
    for j, s in enumerate(starts[k] + fractions[j, k] * lengths[k] for k in range(3) for j in range(2)):
        point, angle = (np.array(v).ravel() for v in backbone.section(q, u, s, p))
        assert_allclose(point, np.array(model.position(q, u, s, p)).ravel(), atol=1e-12)
        assert angle == pytest.approx(float(model.orientation(q, u, s, p)), abs=1e-12)
        assert_allclose(places[:, j], point, atol=1e-12)
    zero = np.zeros(model.n)
    pulled = [np.append(np.zeros(len(model.friction_names)), 1.0)] if model.friction_names else []
    still = np.array(model.inverse_dynamics(q, zero, zero, u, w, p, *pulled)).ravel()
    # A mass within an element bears like its Jacobian.
    carried = np.array(model.jacobian(q, u, 0.55, p)).T @ LOADED["gravity"] * 0.7
    missing = np.array(backbone.missing(1)(q, u, w, [0.7, 0.55], *(pulled or [[]]), p)).ravel()
    assert_allclose(missing, still - carried, atol=1e-11)


def test_sections_of_a_finger_that_bends_to_its_limit():
    """Within an element whose curvature goes from one limit to the other, as in a result: integrals of the tangent."""
    finger = Finger(
        rod=Rod(length=1.0, linear_density=1.0, bending_stiffness=1.0), tendons=Tendons(offset=0.1, max_tension=9.0)
    )
    model = FingerModel(finger, family="clothoid", elements=2, gravity=(0, 0), bending_range=2 * math.pi, accuracy=1e-7)
    q, u = np.array([-7.5, 11.1, -4.0 * math.pi])[: model.n], np.zeros(model.nu)
    section = backbone_of(model, CurvesSpec(())).section
    for s in (0.2, 0.5, 0.64, 0.81, 1.0):
        at = np.linspace(0.0, s, 2001)
        angles = np.array([float(model.orientation(q, u, one, model.p_nominal)) for one in at])
        way = simpson([-np.sin(angles), np.cos(angles)], x=at)
        point, angle = (np.array(v).ravel() for v in section(q, u, s, model.p_nominal))
        assert angle == pytest.approx(angles[-1], abs=1e-12)
        assert_allclose(point, way, atol=1e-8)


# -- what follows from a solution --------------------------------------------------------------------------------


def test_sensitivities_against_solving_again():
    scene = make_scene(elements=2)
    result = optimize_grasp(scene)
    found = {s.name: s.derivative for s in result.sensitivity}
    step = 1e-4
    for name, low, high in (
        ("friction between fingers and object", _finger_friction(scene, -step), _finger_friction(scene, step)),
        ("mass of the object", make_scene(mass=0.3 - step), make_scene(mass=0.3 + step)),
        ("object along y", make_scene(base_y=-0.055 + step), make_scene(base_y=-0.055 - step)),
    ):
        numeric = (optimize_grasp(high).tension - optimize_grasp(low).tension) / (2 * step)
        assert found[name] == pytest.approx(numeric, rel=5e-3), name


def _finger_friction(scene, change):
    contacts = FingerContacts(friction=scene.contacts.friction + change)
    return scene.model_copy(update={"finger": scene.finger.model_copy(update={"contacts": contacts})})


# -- what follows from a solution --------------------------------------------------------------------------------


@pytest.mark.parametrize("tendons", ["retensioned", "locked"])
def test_resisted_disturbance_against_the_fine_rod(tendons):
    """The problem's few elements against the fine rod of the quality indices, which shares no code with them."""
    scene = make_scene(
        elements=4,
        max_tension=200.0 if tendons == "locked" else 60.0,
        upright=True,
        objective=ObjectiveWeights(greatest_disturbance=1.0, least_tension=0.01),
        disturbances=Disturbances(wrenches=((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)), tendons=tendons),
    )
    result = optimize_grasp(scene)
    search = GraspSearch(scene, Budget.of(scene.solver))
    search.run()
    best = search.best
    factor = float(best.attempt.x[best.solver.problem.x.at["resisted disturbance"]][0])
    fine = Resistance.of(Quality(scene, result.arrays).response, displacement_limit=math.inf)
    assert factor > 0.5
    assert fine.least == pytest.approx(factor, rel=0.05)


@pytest.mark.deep
def test_elements_by_tolerance_are_the_fewest_that_keep_it():
    coarse = optimize_grasp(make_scene(fidelity=Fidelity(tolerance=0.1)))
    fine = optimize_grasp(make_scene(fidelity=Fidelity(tolerance=0.02)))
    assert coarse.fine.size <= 0.1
    assert fine.fine.size <= 0.02
    few, many = (r.fingers["finger"].lengths.size for r in (coarse, fine))
    assert few < many
    assert "tolerance 2.00% satisfied" in fine.statistics["fidelity"]
    reference = optimize_grasp(with_elements(make_scene(), 8)).tension
    assert fine.tension == pytest.approx(reference, rel=0.03)


# -- contacts that are tried ----------------------------------------------------------------------------------------


def test_modes_are_what_the_switches_leave():
    scene = make_scene(contacts=GraspContacts(friction=0.5, normal_force_max=30.0, middle="auto", tip="auto"))
    assert contact_modes(scene) == [
        frozenset({"finger.middle", "finger.tip", "palm"}),
        frozenset({"finger.middle", "palm"}),
        frozenset({"finger.tip", "palm"}),
    ]
    away = make_scene(supports={"palm": Palm(point=(-0.01, 0.0), normal_angle=0.0)})
    assert contact_modes(away) == [frozenset({"finger.middle", "finger.tip"})]
    free = make_scene(
        object=Circle(shape="circle", diameter=0.08, mass=0.3, position=(0.04, 0.0), free=Freedom(y=(-0.01, 0.01)))
    )
    assert [("palm" in mode) for mode in contact_modes(free)] == [True, False]


@pytest.mark.deep
def test_the_best_of_the_modes_is_the_answer():
    """What `auto` finds is no worse than each choice made by hand."""

    def tension(middle, tip):
        contacts = GraspContacts(friction=0.5, normal_force_max=30.0, middle=middle, tip=tip)
        result = optimize_grasp(make_scene(contacts=contacts, upright=True), raise_on_failure=False)
        return result.tension if result.solved else math.inf

    chosen = tension("auto", "auto")
    assert chosen <= min(tension("on", "on"), tension("on", "off"), tension("off", "on")) * (1 + 1e-6)
    assert math.isfinite(chosen)


def test_more_starts_lead_to_the_same_grasp_of_a_box():
    """Contacts on faces and corners: three times as many starts, and nothing better."""
    scene = load(CONFIGS / "box_edge.yaml", {"objective": "least_tension"})
    one = optimize_grasp(scene)
    more = scene.solver.model_copy(update={"effort": "thorough"})
    two = optimize_grasp(scene.model_copy(update={"solver": more}))
    assert two.tension == pytest.approx(one.tension, rel=1e-4)


# -- solver runs ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options_at", range(len(OPTION_SETS)))
def test_every_option_set_leads_back_from_next_to_a_grasp(options_at):
    scene = make_scene("arc")
    search = GraspSearch(scene, Budget.of(scene.solver))
    search.run()
    best = search.best
    start = GraspStart.of(scene, best.arrays)
    x0 = best.attempt.x * (1.0 + 1e-3 * np.random.default_rng(0).standard_normal(best.attempt.x.size))
    budget = Budget(left=500)
    again = best.solver.run(scene, start, budget, options_at=options_at, features=best.attempt.features, x0=x0)
    assert again.optimal
    assert again.objective == pytest.approx(best.attempt.objective, rel=1e-5)
    assert budget.left >= 500 - 2 * OPTION_SETS[options_at][1]


@pytest.mark.deep
def test_an_object_that_slides_along_its_support_alone_is_no_dependent_equation():
    """Free along the palm, the egg cannot leave it: equations for its contact would be one too many."""
    result = optimize_grasp(load(CONFIGS / "egg.yaml"))
    assert result.status == "feasible"
    assert result.statistics["interrupted"] is False


def test_the_tip_does_not_come_from_within():
    """Of the bar in the groove the tip touches with its side: the finger there is along the surface, and no deeper."""
    result = optimize_grasp(load(CONFIGS / "groove.yaml"))
    tip = next(contact for contact in result.contacts if contact.name == "finger.tip")
    along = np.array([-math.sin(angle := result.arrays["finger.backbone"][-1, 3]), math.cos(angle)])
    assert along @ np.asarray(tip.normal) <= 2e-3
    depth = next(check for check in result.certificate.checks if check.name.startswith("penetration into the object"))
    assert depth.value < 3e-6


def test_fingers_that_are_alike_share_their_derivatives():
    """Of three parts of a wrap by two fingers, those of the fingers are the same."""
    scene = load(CONFIGS / "pinch.yaml")
    start = GraspStart.of(scene, dict(optimize_grasp(scene).arrays))
    problem = GraspSolverRun.of(scene, start.contacts).problem
    first, second = (placed.part for placed in problem.fingers)
    assert first is second
    assert [placed.names[0] for placed in problem.fingers] == [finger.name for finger in problem.spec.fingers]


@pytest.mark.parametrize(
    ("name", "aim"),
    [("pinch", "greatest_disturbance"), ("mug_hanging", "least_tension"), ("wrap", "least_normal_force")],
)
def test_derivatives_of_a_sum_of_parts_are_those_of_its_values(name, aim):
    scene = load(CONFIGS / f"{name}.yaml").changed({"objective": aim, "fidelity.elements": 4})
    start = first_start(scene)
    problem = GraspProblem(ProblemSpec.of(scene, start.contacts))
    features = values.contact_features(scene, start.contacts)
    p = problem.numbers.pack(values.problem_values(problem, scene, start, features), 0.3)
    rng = np.random.default_rng(2)
    x = points.starting_point(problem, scene, start, features) + 0.03 * rng.uniform(0.5, 1.0, problem.x.size)
    force, along, h = rng.normal(size=problem.rows.count), rng.normal(size=x.size), 1e-6

    def slope(x):
        gradient, jacobian = (np.array(problem.nlp.functions[key](x, p)[1]) for key in ("grad_f", "jac_g"))
        return gradient.ravel() + jacobian.T @ force

    def lagrangian(x):
        f, g = problem.nlp.values(x, p)
        return float(f) + float(np.array(g).ravel() @ force)

    numeric = (lagrangian(x + h * along) - lagrangian(x - h * along)) / (2.0 * h)
    assert slope(x) @ along == pytest.approx(numeric, rel=1e-6)
    upper = np.array(problem.nlp.functions["hess_lag"](x, p, 1.0, force))
    bent, difference = (upper + np.triu(upper, 1).T) @ along, (slope(x + h * along) - slope(x - h * along)) / (2.0 * h)
    assert_allclose(bent, difference, atol=1e-6 * float(np.abs(difference).max()))


@pytest.mark.parametrize("free", [False, True])
def test_names_of_supports_and_fingers_are_no_names_of_numbers(free):
    """The problem numbers its obstacles itself: no support or finger has their numbers by having their names."""
    wall = {"type": "palm", "point": (0.0, 0.01), "normal_angle": 0.0}
    near, far = ({"type": "point", "position": at, "radius": 0.01} for at in ((0.04, 0.05), (0.3, 0.2)))
    body = make_scene().object.model_copy(update={"free": Freedom(y=(-0.004, 0.004)) if free else None})
    problems = []
    for names in (("finger", "palm", "near", "far"), ("part_0", "plane_0", "peg_1", "peg_0")):
        finger, *others = names
        supports = dict(zip(others, (wall, near, far), strict=True))
        scene = make_scene(supports=supports, object=body)
        scene = scene.changed({"finger": None, "fingers": {finger: scene.finger}})
        start = first_start(scene)
        problem = GraspProblem(ProblemSpec.of(scene, start.contacts))
        features = values.contact_features(scene, start.contacts)
        problems.append(problem.numbers.pack(values.problem_values(problem, scene, start, features), 0.3))
    assert_allclose(*problems, rtol=0.0, atol=0.0)


def test_the_balance_of_the_object_is_that_of_stored_forces():
    """Of an object whose center of mass is off its middle, with a tenth of its mass taken away."""
    body = make_scene().object.model_copy(update={"center_of_mass": (0.006, -0.004)})
    scene = make_scene(object=body)
    start = first_start(scene)
    problem = GraspProblem(ProblemSpec.of(scene, start.contacts))
    features = values.contact_features(scene, start.contacts)
    p = problem.numbers.pack(values.problem_values(problem, scene, start, features), 0.3)
    x = points.starting_point(problem, scene, start, features)
    x[problem.x.at["relaxed mass"]] = 0.1
    for contact in problem.spec.contacts:
        x[problem.x.at[f"force, {contact.name}"]] = np.random.default_rng(4).uniform(0.2, 1.0, problem.spec.dimensions)
    stored, unit = points.stored_arrays(problem, scene, start, x, p), values.Units.of(scene)
    flat = np.zeros((len(stored["contact_names"]), 3))
    arms, normals, loads = flat.copy(), flat.copy(), stored["contact_forces"]
    turned = np.array([[np.cos(body.angle), -np.sin(body.angle)], [np.sin(body.angle), np.cos(body.angle)]])
    arms[:, :2] = stored["contact_positions"] - (np.array(body.position) + turned @ body.com)
    normals[:, :2] = stored["contact_normals"]
    across = np.cross([0.0, 0.0, 1.0], normals)
    world = loads[:, :1] * normals + loads[:, 1:2] * across - loads[:, 2:] * [0.0, 0.0, 1.0]
    wrench = [0.9 * body.mass * np.array(scene.gravity) - world.sum(axis=0), -np.cross(arms, world).sum(axis=0)]
    wrench = np.concatenate([wrench[0] / unit.force, wrench[1] / (unit.force * body.size)])
    g = np.array(problem.nlp.values(x, p)[1]).ravel()
    rows = [b.rows.ravel() for b in problem.rows.blocks if b.name.startswith("object ") and "balance" in b.name]
    assert np.abs(wrench[list(problem.spec.balances)]).min() > 1e-3
    assert_allclose(g[np.concatenate(rows)], wrench[list(problem.spec.balances)], atol=1e-12)


def test_a_bound_on_a_sum_of_unknowns_counts_what_parts_share_once():
    scene = load(CONFIGS / "mug_hanging.yaml").changed({"fidelity.elements": 2})
    start = first_start(scene)
    problem = GraspProblem(replace(ProblemSpec.of(scene, start.contacts), steadied=True))
    rng = np.random.default_rng(3)
    slope, x = rng.normal(size=(2, problem.x.size))
    p = problem.numbers.pack(problem.steadying(slope, 0.7), 0.0)
    (block,) = (block for block in problem.rows.blocks if block.name == "stability")
    assert float(problem.nlp.values(x, p)[1][int(block.rows[0, 0])]) == pytest.approx(slope @ x - 0.7, abs=1e-12)


def test_fingers_that_crossed_once_keep_apart_from_then_on():
    scene = load(CONFIGS / "pinch.yaml")
    search = GraspSearch(scene, Budget())
    crossed = [SimpleNamespace(crossed=frozenset({pair})) for pair in (("upper", "upper"), ("upper", "lower"))]
    assert [search.keep_clear(each) for each in (*crossed, crossed[0])] == [True, True, False]
    assert search.apart == {("upper", "upper"), ("upper", "lower")}


# -- guarded places, cones, unique forces, elements of a taper -------------------------------------------------------


def places_seen(base):
    """Gap that is needed beside the first element of a finger whose base is so far from a palm, per half thickness."""
    setup = make_scene().setups[0]
    half, unit = float(setup.finger.profile.half_thickness(0.0)), SimpleNamespace(length=1.0)
    palm, *_ = surroundings._obstacles(make_scene(), setup, 1, np.array([base * half, 0.0, 0.0]), unit)
    _, needed = palm.gaps(np.array([[1.0, 0.0]]), np.zeros(1, int), np.array([half]), unit)
    return needed[0] / half


def test_amounts_of_several_components_have_a_derivative_at_zero():
    _, problem, numbers, x, _ = posed()
    packed = problem.numbers.pack({**numbers, "effort weight": 0.0, "relaxation weights": np.ones(len(RELAXATIONS))}, 0)
    value, slope = problem.nlp.functions["grad_f"](x, packed)
    assert np.isfinite(np.array(slope)).all()
    assert float(value) < 3e-6  # of a unit of the problem


def test_contact_forces_are_unique_and_cost_next_to_nothing():
    _, problem, numbers, x, _ = posed()
    forces = np.concatenate([np.r_[at] for name, at in problem.x.at.items() if name.startswith("force, ")])
    packed = problem.numbers.pack(numbers, 0)
    value, slope = (np.array(v) for v in problem.nlp.functions["grad_f"](x, packed))
    bend = np.zeros((x.size, x.size))
    for placed in problem.parts:
        bent = placed.part.read(ca.hessian(placed.part.objective, placed.part.x.symbol)[0])
        bend[np.ix_(placed.unknowns, placed.unknowns)] += placed.values(bent, x, packed)[0]
    assert np.linalg.eigvalsh(bend[np.ix_(forces, forces)]).min() > 0.0
    assert 0.5 * slope[forces, 0] @ x[forces] < 1e-6 * value.item()


def test_a_base_that_touches_a_support_to_rounding_is_outside():
    assert places_seen(1.0 - 1e-10) == 1.0
    assert places_seen(1.0 - 1e-8) == 0.0


def test_scenes_whose_bending_ranges_are_alike_share_a_solver():
    def spec(turn):
        scene = make_scene().changed({"fidelity.bending_range": turn})
        return FingerSpec.of(scene.setups[0], frozenset({"finger.tip"}), False)

    for turn in np.linspace(0.5, 6.28, 30):
        assert turn <= spec(turn).bending_range <= max(1.0, 2.1 * turn)
    assert len({spec(turn) for turn in np.linspace(0.5, 6.28, 30)}) <= 5


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_rounded_cone_costs_nothing_and_has_derivatives_where_nothing_presses(share):
    numbers, friction = {"cone rounding": values.APEX, "cone share": 1.0}, 0.5
    force = ca.SX.sym("force", 3)
    cone = friction_cone(numbers.__getitem__, friction, force)
    at = ca.Function("cone", [force], [cone, ca.gradient(cone, force), ca.hessian(cone, force)[0]])
    exact = share / friction
    assert float(at([exact, 0.0, share])[0]) < 0.0  # all inside the true cone
    assert float(at([exact * (1.0 + 1e-6), 0.0, share])[0]) > 0.0
    assert all(np.isfinite(np.array(part)).all() for part in at([0.0, 0.0, 0.0]))
    # Contacts without force start inside, by little.
    assert 0.0 < float(at([points.PRESSED, 0.0, 0.0])[0]) < 0.02
    # The kink is rounded where steps of a thousandth of the weight see it.
    assert np.abs(np.array(at([0.0, 0.0, 0.0])[2])).max() < 2e4


def test_places_of_greatest_depth_are_found_between_those_of_a_grid():
    """Also where the depth is far from a parabola: it falls by different powers on both sides."""
    rng = np.random.default_rng(0)
    peaks = np.sort(rng.uniform(0.05, 0.95, (40, 1)))

    def depth(fractions):
        off = fractions - peaks
        return np.where(off > 0.0, -(np.abs(off) ** 1.5), -40.0 * off**2)

    even = np.tile(np.arange(surroundings.FINE + 1) / surroundings.FINE, (40, 1))
    found = surroundings._refined(depth, surroundings._deepest(depth(even), 1), np.zeros((40, 1)))
    assert np.abs(found - peaks).max() < 1e-4
    aside = peaks + rng.uniform(-0.95, 0.95, peaks.shape) / surroundings.FINE
    assert np.abs(surroundings._refined(depth, aside, np.zeros((40, 1))) - peaks).max() < 1e-4


def test_elements_of_a_taper_are_equal_parts_of_bending_waves():
    """Of a stiffness that falls exponentially, in closed form."""
    setup = make_scene(elements=6).setups[0]
    rate, length = math.log(30.0), setup.finger.rod.length
    profile = SimpleNamespace(
        length=length,
        linear_density=lambda s: np.ones_like(s),
        bending_stiffness=lambda s: np.exp(-rate * s / length),
    )
    profile.waves = lambda s: Profile.waves(profile, s)
    tapered = SimpleNamespace(finger=SimpleNamespace(profile=profile), before=(3,), elements=6, graded=True)
    places = values.node_places(tapered, [0.4 * length]) / length

    def waves(s):
        return np.exp(0.25 * rate * s)

    for part in (places[:4], places[3:]):
        assert np.diff(waves(part)) == pytest.approx(np.ptp(waves(part)) / 3, rel=2e-4)
