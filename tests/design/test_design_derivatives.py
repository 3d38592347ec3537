"""Derivatives through optimal grasps, from inside: the tangent of a problem made here.

Derivatives through optimal grasps: against differences of grasps that are solved anew, and closed forms.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import root

import continuum_grasp as cg
from continuum_grasp.addons.design import Design
from continuum_grasp.addons.design.evaluation import DesignProblem, Expression
from continuum_grasp.addons.design.space import design_space_of
from continuum_grasp.grasp import Stencil
from continuum_grasp.nlp import NLP, Multipliers, SolutionSlopes
from continuum_grasp.scene import ConfigurationData
from tests.marks import few

MUG = "configs/grasp/mug.yaml"
ARCS = "configs/grasp/mug_arcs.yaml"


def problem_of(**keys):
    return DesignProblem(design_space_of(ConfigurationData.of(Design(**keys), "Design")))


def start_of(problem):
    return np.array([one.way.coordinate(one.nominal) for one in problem.space.coordinates])


def differences(problem, at, k, text, step=1e-3):
    """Of fourth order, from grasps that are solved anew at every design."""
    found = []
    for h in (step, 0.5 * step):
        ends = []
        for sign in (-1.0, 1.0):
            there = at.copy()
            there[k] += sign * h
            ends.append(Expression(text).value(problem.evaluate(there).cases[0].quantities))
        found.append((ends[1] - ends[0]) / (2.0 * h))
    return (4.0 * found[1] - found[0]) / 3.0


LENGTH = 0.18
WIRE = {"length": LENGTH, "youngs_modulus": 60e9, "density": 6450.0}
INCLINED = [{"offset": [side * 0.006, side * 0.0045], "min_tension": 1.0, "max_tension": 60.0} for side in (1.0, -1.0)]
CASES = {
    "arcs": (
        ARCS,
        {},
        {
            "finger.tendons.offset": {"min": 0.003, "max": 0.006},
            "finger.rod.bending_stiffness": {"min": 3e-3, "max": 12e-3, "spacing": "log"},
            "finger.base.position[1]": {"min": -0.07, "max": -0.045},
        },
        {},
        ("tension", "normal_force_max"),
    ),
    "clear of the mug": (
        MUG,
        {"contacts.reserve": 0.0},
        {
            "finger.base.angle": {"min": -1.7, "max": -1.4},
            "finger.base.position[1]": {"min": -0.065, "max": -0.045},
        },
        {},
        ("tension", "tension_max"),
    ),
    "payload": (ARCS, {}, {"finger.rod.bending_stiffness": {"min": 3e-3, "max": 12e-3}}, {}, ("payload",)),
    "least slip": (
        ARCS,
        {"objective": "greatest_friction_margin"},
        {
            "finger.base.position[1]": {"min": -0.066, "max": -0.048},
            "contacts.friction": {"min": 0.4, "max": 0.6},
        },
        {},
        ("friction_margin",),
    ),
    "spiral": (
        "configs/grasp/spirob_cup.yaml",
        {},
        {"finger.rod.spirob.tip_thickness": {"min": 0.015, "max": 0.022}},
        {},
        ("tension",),
    ),
    "bent at rest": (
        "configs/grasp/preshaped.yaml",
        {"friction_states": "pulled", "stability": "ignore"},
        {"finger.rest_curvature": {"min": 0.0, "max": 12.0}},
        {},
        ("tension",),
    ),
    "size of the object": (
        ARCS,
        {},
        {"object.diameter": {"min": 0.075, "max": 0.085}},
        {"object.position[0]": {"key": "object.diameter", "times": 0.5}},
        ("tension",),
    ),
    "place of the middle contact": (
        MUG,
        {"contacts.middle_range": [0.03, 0.084]},  # it would be at 86 mm
        {"contacts.middle_range[1]": {"min": 0.0825, "max": 0.0855}},
        {},
        ("tension",),
    ),
    "taper of finger and tendons": (
        MUG,
        {
            "finger.rod": {**WIRE, "sections": [{"to": LENGTH, "diameter": [0.0013, 0.0011]}]},
            "finger.half_thickness": 0.006,
            "finger.tendons": INCLINED,
            "fidelity.elements": 2,
        },
        {
            "finger.rod.sections[0].diameter[1]": {"min": 0.0009, "max": 0.0013},
            "finger.tendons[0].offset[1]": {"min": 0.003, "max": 0.006},
        },
        {"finger.tendons[1].offset[1]": {"key": "finger.tendons[0].offset[1]", "times": -1.0}},
        ("tension", "finger_mass"),
    ),
    "material and diameter": (
        MUG,
        {"finger.rod": {**WIRE, "diameter": 0.0012}, "fidelity.elements": 2},
        {
            "finger.rod.youngs_modulus": {"min": 40e9, "max": 80e9},
            "finger.rod.diameter": {"min": 0.001, "max": 0.0014},
            "finger.half_thickness": {"min": 0.005, "max": 0.007},
            "finger.base.position[0]": {"min": -0.003, "max": 0.003},
        },
        {},
        ("tension", "finger_mass"),
    ),
    "sections": (
        MUG,
        {
            "finger.rod": {
                **WIRE,
                "sections": [{"to": 0.07, "diameter": 0.00125}, {"to": LENGTH, "diameter": 0.00115}],
            },
            "finger.half_thickness": 0.006,
        },
        {
            "finger.rod.sections[0].to": {"min": 0.05, "max": 0.09},
            "finger.rod.sections[1].diameter": {"min": 0.001, "max": 0.0013},
        },
        {},
        ("tension", "normal_force_max", "payload"),
    ),
    "bent at rest by pieces": (
        MUG,
        {"finger.rest_curvature": {"breaks": [0.07], "values": [1.0, 5.0]}},
        {
            "finger.rest_curvature.breaks[0]": {"min": 0.05, "max": 0.09},
            "finger.rest_curvature.values[1]": {"min": 2.0, "max": 8.0},
        },
        {},
        ("tension",),
    ),
}


@pytest.mark.deep
@pytest.mark.parametrize("name", few(CASES, 5))
def test_derivatives_are_those_of_grasps_solved_anew(name):
    scene, changes, variables, follow, names = CASES[name]
    problem = problem_of(scene=scene, set=changes, variables=variables, follow=follow, minimize=" + ".join(names))
    at = start_of(problem)
    here = problem.evaluate(at, search=True)
    for k in range(at.size):
        for text in names:
            expected = differences(problem, at, k, text)
            assert here.cases[0].slopes[text][k] == pytest.approx(expected, rel=1e-4, abs=1e-8), (k, text)


@pytest.mark.parametrize(("over", "count"), few([("mean", 1), ("worst", 3)], 0))
def test_costs_of_many_objects_in_error_are_differentiated(over, count):
    """Ten objects, with the worst error of the base and of friction: the slope of the one cost that counts."""
    given = cg.load("configs/design/ten_objects.yaml")
    tolerances = {"finger.base.position[1]": {"amount": 5e-4}, "contacts.friction": {"share": 0.05}}
    problem = problem_of(
        scene=ARCS,
        variables={key: one.model_dump() for key, one in given.variables.items()},
        cases=given.cases,
        minimize="sqrt(tension) + 100 * finger_mass",
        over=over,
        tolerances=tolerances,
    )
    problem.scenarios = [(-1.0, -1.0)]
    at = start_of(problem)
    slope = problem.evaluate(at, search=True).worst.slope
    for k in range(count):
        values = []
        for h in (-1e-3, -5e-4, 5e-4, 1e-3):
            values.append(problem.evaluate(at + h * np.eye(at.size)[k]).cost)
        expected = (values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / 6e-3
        assert slope[k] == pytest.approx(expected, rel=1e-5)


def test_the_tension_per_offset_is_known_in_closed_form():
    """The moment (T1 - T2) e of a grasp does not depend on e, and T2 is at its least: d(T1 + T2)/de = -(T1 - T2)/e."""
    problem = problem_of(
        scene=ARCS, variables={"finger.tendons.offset": {"min": 0.004, "max": 0.006}}, minimize="tension"
    )
    here = problem.evaluate(start_of(problem), search=True).cases[0]
    left = here.quantities["tension_max"]
    right = here.quantities["tension"] - left
    assert right == pytest.approx(1.0, abs=1e-6)  # min_tension
    assert here.slopes["tension"][0] / 0.002 == pytest.approx(-(left - right) / 0.005, rel=1e-7)


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        ("configs/grasp/mug_motor.yaml", "friction_states: a design follows one posture"),
        ("configs/grasp/mug_uncertain.yaml", "robust: a design follows one posture"),
    ],
)
def test_grasps_that_must_hold_for_many_postures_are_refused(scene, expected):
    variables = {"finger.tendons.offset": {"min": 0.004, "max": 0.006}}
    with pytest.raises(cg.InputError, match=expected):
        problem_of(scene=scene, variables=variables, minimize="tension")


@pytest.mark.deep
def test_the_payload_is_where_grasps_end():
    problem = problem_of(
        scene=ARCS, variables={"finger.tendons.offset": {"min": 0.004, "max": 0.006}}, minimize="-payload"
    )
    payload = -problem.evaluate(start_of(problem), search=True).cost
    scene = cg.load(ARCS)
    assert cg.optimize_grasp(scene.changed({"object.mass": 0.999 * payload})).solved
    assert not cg.optimize_grasp(scene.changed({"object.mass": 1.002 * payload}), raise_on_failure=False).solved


def test_the_structure_may_change_at_the_start():
    """A rest curvature of zero is not among the numbers of the problem."""
    problem = problem_of(scene=ARCS, variables={"finger.rest_curvature": {"min": -2.0, "max": 8.0}}, minimize="tension")
    here = problem.evaluate(start_of(problem), search=True)
    assert here.coordinates[0] == pytest.approx(0.2, abs=1e-4)
    expected = differences(problem, here.coordinates, 0, "tension")
    assert here.cases[0].slopes["tension"][0] == pytest.approx(expected, rel=1e-5)


def test_tolerated_errors_are_differentiated_too():
    variables = {"finger.tendons.offset": {"min": 0.004, "max": 0.006}}
    tolerances = {"contacts.friction": {"share": 0.1}, "finger.tendons.offset": {"amount": 2e-4}}
    problem = problem_of(scene=ARCS, variables=variables, tolerances=tolerances, minimize="tension")
    at = start_of(problem)
    slopes = problem.evaluate(at, search=True).cases[0].slopes["tension"]
    # The same number as variable and as error: 0.2 mm of a range of 2 mm.
    assert slopes[2] == pytest.approx(0.1 * slopes[0], rel=1e-6)
    ends = [cg.optimize_grasp(cg.load(ARCS).changed({"contacts.friction": 0.5 + h})).tension for h in (-1e-3, 1e-3)]
    assert slopes[1] == pytest.approx(0.05 * (ends[1] - ends[0]) / 2e-3, rel=1e-4)


def test_unknowns_follow_the_bounds_and_rows_that_hold_them():
    """Least of x Q x / 2 - a x with rows s (C x + w |x|^2 / 2) - d, all of them moving along t: Newton's method with
    what is active as equations. Unknowns are at an upper, at a lower and between equal bounds, free, and beyond a limit
    that is relaxed; rows are equal, at most and at least zero, and not active.
    """
    rng, n, rows, first = np.random.default_rng(4), 7, 4, slice(3)  # what is active stands first
    root_q, C, w = rng.normal(size=(n, n)), rng.normal(size=(rows, n)), rng.normal(size=rows)
    Q = root_q @ root_q.T + 3.0 * np.eye(n)
    x, forces, bound_forces = rng.normal(size=n), np.array([0.7, 1.3, -0.4, 0.0]), np.array([0.9, -0.6, 0.5, *4 * [0]])
    inner = C @ x + 0.5 * w * (x @ x)
    a = Q @ x + C.T @ forces + (w @ forces) * x + bound_forces
    moved = rng.normal(size=n), rng.normal(size=rows), rng.normal(size=3)

    def numbers(t):
        return np.concatenate([a + t * moved[0], inner + [0.0, 0.0, 0.0, 1.0] + t * moved[1], [1.0 + 0.8 * t]])

    def bounds(t):
        low, high = x - 1.0, x + 1.0
        high[[0, 2]] = x[[0, 2]] + t * moved[2][[0, 2]]
        low[[1, 2]] = x[[1, 2]] + t * moved[2][[1, 2]]
        high[6] = x[6] - 0.5
        return low, high

    def conditions(z, t):
        at, row, bound = np.split(z, [n, n + 3])
        scale = 1.0 + 0.8 * t
        pushed = np.concatenate([bound, np.zeros(n - 3)]) - numbers(t)[:n]
        gradient = Q @ at + scale * (C[first].T @ row + (w[first] @ row) * at) + pushed
        value = scale * (C @ at + 0.5 * w * (at @ at)) - numbers(t)[n:-1]
        return np.concatenate([gradient, value[first], (at - x)[first] - t * moved[2]])

    here = np.concatenate([x, forces[first], bound_forces[first]])
    ends = [root(conditions, here, args=(t,), tol=1e-13).x[:n] for t in (1e-4, -1e-4)]
    X, p = ca.MX.sym("x", n), ca.MX.sym("p", n + rows + 1)
    g = p[-1] * (ca.mtimes(C, X) + 0.5 * ca.sumsqr(X) * w) - p[n:-1]
    problem = NLP("made up", X, 0.5 * ca.bilin(Q, X, X) - ca.dot(p[:n], X), g, p)
    row_bounds = np.array([0.0, -np.inf, 0.0, -np.inf]), np.array([0.0, 0.0, np.inf, 0.0])
    value = np.array(problem.functions["jac_g"](x, numbers(0.0))[0]).ravel()
    attempt = SimpleNamespace(x=x, g=value, multipliers=Multipliers(bound_forces, forces))

    def start(t):
        low, high = bounds(t)
        lower, upper = row_bounds
        return SimpleNamespace(low=low, high=high, lower=lower, upper=upper, p=numbers(t))

    near = Stencil.of(start)
    found = SolutionSlopes(problem, start(0.0), attempt).unknowns(near.difference, near.scenes)
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / 2e-4, rtol=1e-5)


def test_expressions_have_exact_derivatives():
    text, at = "sqrt(a) * exp(-b) + log(a) / b**2 - 3", {"a": 1.7, "b": 0.9}
    expression, step = Expression(text), 1e-20
    a, b = (complex(at["a"], step), complex(at["b"], step))
    by_a = (np.sqrt(a) * np.exp(-at["b"]) + np.log(a) / at["b"] ** 2).imag / step
    by_b = (np.sqrt(at["a"]) * np.exp(-b) + np.log(at["a"]) / b**2).imag / step
    found = expression.gradient(at, {"a": np.array([1.0, 0.0]), "b": np.array([0.0, 1.0])})
    assert found == pytest.approx([by_a, by_b], rel=1e-14)
