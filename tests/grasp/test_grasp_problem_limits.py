"""The numbers by which a grasp problem is posed and solved; from inside: rows and points on either side of each.

The numbers by which a grasp problem is posed and solved: each decides otherwise on either side of it, or keeps a
promise that fails without it.
"""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from grasp_scenes import make_scene

from continuum_grasp import nlp
from continuum_grasp.grasp.finger_map import places_of
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem import disturbance, limits, points, solver_run, surroundings, values
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.solver_run import GraspSolverRun, allowed_depth, solve_clear
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.starts.rough import rough_starts

NONE = np.zeros(1)


def runs(deepest=0.0, moved=0.0, objective=1.0, settles_after=math.inf):
    """How often a problem is solved whose fingers are so deep, per what is allowed, and whose new guarded places change
    what is sought; from some round on neither.
    """
    solved = []

    def solve(start, budget):
        solved.append(start)
        forces = nlp.Multipliers(NONE, np.ones(1))
        return nlp.Attempt(nlp.SolverStatus.SOLVED, "", NONE, NONE, objective, forces, 1, 0.0, 0.0, 0.0)

    def now(value):
        return value if len(solved) < settles_after else 0.0

    problem = SimpleNamespace(functions={"jac_g": lambda x, p: (np.array([now(moved)]), None)})
    start = nlp.Start(NONE, NONE, NONE, NONE, NONE, NONE)
    look = lambda x, p: (now(deepest), p)  # noqa: E731
    solve_clear(solve, problem, start, look, 1.0, nlp.Budget(), 9)
    return len(solved)


def in_order(apart):
    """Whether two middle contacts so far from each other, per length, may be."""
    rows = {}
    problem = SimpleNamespace(
        rows=SimpleNamespace(require=lambda name, expression, *_, **__: rows.update({name: expression})),
        slack=dict.fromkeys(("tension", "bending range"), 0.0),
    )
    finger = SimpleNamespace(
        spec=SimpleNamespace(name="f", drive=None, strained=False, touching=(True, True)),
        number=lambda name, size=1: ca.DM.zeros(size), pulls=ca.DM.zeros(2), curvatures=lambda: [ca.DM.zeros(2, 3)] * 3,
        joints=[ca.DM(0.3), ca.DM(0.3 + apart)],
    )  # fmt: skip
    limits.keep_limits(problem, finger)
    return float(rows["order of the middle contacts, f"]) >= 0.0


def asked(*names, options_at=0, off=0.0):
    """What a solver run from a start asks for that relaxes these limits: numbers and bounds by name, and iterations;
    and the violations that it lists of a point that is off by so much.
    """
    scene, problem, _, x, _ = posed()
    run, low, seen = of_mug(), problem.rows.bounds()[0], {}

    def stopped(solve, nlp_problem, start, look, depth, budget, most):
        seen.update(
            {name: start.p[at] for name, at in run.problem.numbers.at.items()}
            | {name: start.high[at] for name, at in run.problem.x.at.items()}
            | {"iterations": most, "options": start.option_set}
        )
        g = np.clip(0.0, *problem.rows.bounds())
        g[np.flatnonzero(low == 0.0)[0]] -= off
        return nlp.Attempt(nlp.SolverStatus.FAILED, "", x, g, 0.0, None, 0, 0.0, 0.0, 0.0), start.p

    relaxed = [(one, 0.0) for one in RELAXATIONS if one.name in names]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solver_run, "solve_clear", stopped)
        start = first_start(scene)
        seen["violations"] = run.run(scene, start, nlp.Budget(), options_at=options_at, relaxed=relaxed).violations
    return seen


@cache
def of_mug():
    return GraspSolverRun(posed()[1].spec)


def runs_along(both):
    """Whether a contact rolls on as the curvatures of its surfaces ask, whose sum is this per size of the object."""
    number = SimpleNamespace(numbers=lambda name: ca.SX(0.05))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(disturbance, "_curvatures", lambda *_: (ca.SX(both / 0.05), ca.SX(0.0)))
        step = float(disturbance._rolled(number, None, ca.SX(1.0), ca.SX(0.0))[1])
    return math.isclose(step, 0.05 / both, rel_tol=1e-9)


LIMITS = [
    ("sum of curvatures that fit", 0.02, lambda x: not runs_along(x)),
    ("violation that is listed", 1e-7, lambda x: not asked(off=x)["violations"]),
    ("change of what is sought by new places", 1e-5, lambda x: runs(moved=x) == 1),
    ("the same of a great objective", 1e-5 * 300.0, lambda x: runs(moved=x, objective=-300.0) == 1),
    ("depth between the places", 1.0, lambda x: runs(deepest=x) == 1),
    ("distance of two middle contacts", 0.02, lambda x: not in_order(x)),
]


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_a_problem_is_otherwise_on_either_side_of_a_limit(limit, decides):
    assert decides((1.0 - 1e-6) * limit)
    assert not decides((1.0 + 1e-6) * limit)


@cache
def posed(objective="least_tension"):
    """The problem of a mug, its numbers and unknowns at a start, and the bounds of these."""
    scene = make_scene(objective=objective)
    start = first_start(scene)
    problem = GraspProblem(ProblemSpec.of(scene, start.contacts))
    features = values.contact_features(scene, start.contacts)
    numbers = values.problem_values(problem, scene, start, features)
    x = points.starting_point(problem, scene, start, features)
    return scene, problem, numbers, x, values.problem_bounds(problem, scene, features)


def relaxed(*names):
    """Most of a mass that may be taken away, and what is sought beside, where limits are relaxed."""
    seen = asked(*names)
    return seen["relaxed mass"].tolist(), seen["effort weight"].tolist()


def weighed_change():
    """What it costs beside the reserve of the cones to change one tension by its most."""
    scene, problem, numbers, _, _ = posed()
    robust, start = GraspProblem(problem.spec.in_error(yielding=False)), first_start(scene)
    values_there = values.problem_values(robust, scene, start, values.contact_features(scene, start.contacts))
    packed, x = robust.numbers.pack({**numbers, **values_there}, 0.0), np.zeros(robust.x.size)
    x[robust.x.at["finger.pulls"]] = values_there["finger.pull_held"]
    taken = x.copy()
    taken[robust.x.at["finger.pulls"].start] += values_there["finger.pull_max"]
    sums = values_there["finger.tension weight"] * values_there["finger.pull_max"]
    return float(robust.nlp.values(taken, packed)[0] - robust.nlp.values(x, packed)[0]) - sums


def points_of_backbones():
    return posed()[1].fingers[0].part.finger.shared.line.size_out(0)


COUNTS = [
    ("iterations and options of the boldest runs", (40, "refined"), 0),
    ("of bold ones", (60, "refined_monotone"), 1),
    ("of rough ones", (200, "default"), 2),
]


@pytest.mark.parametrize(("most", "options_at"), [row[1:] for row in COUNTS], ids=[row[0] for row in COUNTS])
def test_solver_runs_are_cut(most, options_at):
    seen = asked(options_at=options_at)
    assert (seen["iterations"], seen["options"]) == most


PROMISES = [
    ("places that settle late are waited for", lambda: runs(deepest=2.0, settles_after=6), 6),
    ("those that never settle are not", lambda: runs(deepest=2.0), 8),
    ("a mass alone may vanish", lambda: relaxed("mass"), ([1.0], [1e-4])),
    ("beside another limit it is left in part", lambda: relaxed("mass", "tension"), ([0.8], [1e-4])),
    ("without a relaxed limit all effort counts", lambda: relaxed(), ([0.0], [1.0])),
    ("tensions change by little for the reserve", weighed_change, pytest.approx(1e-2)),
    ("stored backbones are for pictures", points_of_backbones, (4, 201)),
]


@pytest.mark.parametrize(("made", "promised"), [row[1:] for row in PROMISES], ids=[row[0] for row in PROMISES])
def test_a_problem_is_posed_as_promised(made, promised):
    assert made() == promised


def test_a_finger_that_may_be_inside_may_point_anywhere():
    """By a five-hundredth of the length, where that is relaxed."""
    _, problem, numbers, x, _ = posed()
    (block,) = (b for b in problem.rows.blocks if b.name.startswith("contact direction"))
    inside = x.copy()
    inside[problem.x.at["relaxed clearance at the object"]] = 2e-3
    packed = problem.numbers.pack(numbers, 0)
    more = problem.nlp.values(inside, packed)[1] - problem.nlp.values(x, packed)[1]
    assert float(np.array(more)[block.rows].item()) >= 1.0


def test_contacts_press_where_slipping_is_an_aim():
    scene, problem, _, _, (low, _) = posed("greatest_friction_margin")
    force = values.Units.of(scene).force
    for name, at in problem.x.at.items():
        if name.startswith("force, "):
            assert 5e-4 < low[at][0] * force / max(scene.weight, force) < 5e-3


def test_active_places_are_no_reason_to_solve_again():
    """They are as deep as the tolerance; the certificate allows 1e-4 of the length, also between stations."""
    scene = make_scene()
    assert 1.001 < allowed_depth(scene) / scene.solver.penetration_tolerance < 1.5
    stations = make_scene(contacts=scene.contacts.model_copy(update={"stations": 4}), elements=8)
    assert 5.0 * scene.solver.penetration_tolerance < allowed_depth(stations) < 0.2 * 1e-4


def test_tensions_count_little_beside_another_aim():
    """All of them at their greatest, as a part of the weight: unique, and less than the search resolves (1e-3)."""
    scene = make_scene(objective="least_normal_force")
    greatest = sum(setup.tendons.max_tension for setup in scene.setups)
    assert 1e-6 < values.tension_weight(scene) * greatest < 5e-5


def test_lines_that_are_looked_at_are_arcs_to_a_part_in_ten_million():
    """Of four turns, at places between which the shape is integrated and beside them."""
    line = surroundings._Line(np.array([0.0, 0.4, 1.0]), np.array([0.0, 1.0]), np.array([25.0, 25.0]), None, None)
    fractions = np.tile(np.linspace(0.0, 1.0, 8), (2, 1))
    exact = (np.exp(25j * line.places(fractions)) - 1.0) / 25.0
    assert np.abs(line.points(fractions) - exact).max() < 1e-7


def test_two_places_of_an_element_are_in_different_dips():
    at = np.arange(surroundings.FINE + 1) / surroundings.FINE
    dips = -np.minimum((at - 0.3) ** 2, (at - 0.62) ** 2 + 0.01)[None]
    found = surroundings._deepest(np.tile(dips, (1, 1)), 2)
    assert found[0] == pytest.approx([0.3, 0.62], abs=5e-3)


def first_start(scene):
    """A start of the scene's first set of contacts that nearly touches, whether forces balance or not."""
    mode = contact_modes(scene)[0]
    return rough_starts(scene, mode, *places_of(scene, mode)[0], 1)[0]
