"""Pieces of a grasp problem by themselves: guarded places, cones, unique forces, elements of a taper."""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from grasp_scenes import make_scene

from continuum_grasp import nlp
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem import points, surroundings, values
from continuum_grasp.grasp.problem.equations import equations, expressions
from continuum_grasp.grasp.problem.limits import friction_cone
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.solver_run import solve_clear
from continuum_grasp.grasp.problem.structure import FingerSpec, ProblemSpec
from continuum_grasp.grasp.starts.starts import make_starts
from continuum_grasp.scene.profile import Profile

NONE = np.zeros(1)


def runs(deepest=0.0, moved=0.0, settles_after=math.inf):
    """How often a problem is solved whose fingers are so deep, per what is allowed, and whose new guarded places change
    what is sought; from some round on neither.
    """
    solved = []

    def solve(start, budget):
        solved.append(start)
        forces = nlp.Multipliers(NONE, np.ones(1))
        return nlp.Attempt(nlp.Status.SOLVED, "", NONE, NONE, 1.0, forces, 1, 0.0, 0.0, 0.0)

    def now(value):
        return value if len(solved) < settles_after else 0.0

    problem = SimpleNamespace(functions={"jac_g": lambda x, p: (np.array([now(moved)]), None)})
    start = nlp.Start(NONE, NONE, NONE, NONE, NONE, NONE)
    solve_clear(solve, problem, start, lambda x, p: (now(deepest), p), 1.0, nlp.Budget(), 9)
    return len(solved)


def places_seen(base):
    """Gap that is needed beside the first element of a finger whose base is so far from a palm, per half thickness."""
    setup = make_scene().setups[0]
    half, unit = float(setup.finger.profile.half_thickness(0.0)), SimpleNamespace(length=1.0)
    palm, *_ = surroundings._obstacles(make_scene(), setup, 1, np.array([base * half, 0.0, 0.0]), unit)
    _, needed = palm.gaps(np.array([[1.0, 0.0]]), np.zeros(1, int), np.array([half]), unit)
    return needed[0] / half


@cache
def posed():
    """The problem of a mug, its numbers and unknowns at a start."""
    scene = make_scene()
    start = make_starts(scene, contact_modes(scene)[0], 1)[0]
    problem = expressions(ProblemSpec.of(scene, start.contacts))
    layout = equations(problem.spec).layout
    features = values.contact_features(scene, start.contacts)
    numbers = values.problem_values(layout, scene, start, features)
    x = points.starting_point(layout, scene, start, features)
    return problem, numbers, x


def test_amounts_of_several_components_have_a_derivative_at_zero():
    problem, numbers, x = posed()
    packed = problem.numbers.pack({**numbers, "effort weight": 0.0, "relaxation weights": np.ones(len(RELAXATIONS))}, 0)
    slope = ca.gradient(problem.objective, problem.x.symbol)
    value, slope = ca.Function("f", [problem.x.symbol, problem.numbers.symbol], [problem.objective, slope])(x, packed)
    assert np.isfinite(np.array(slope)).all()
    assert float(value) < 3e-6  # of a unit of the problem


def test_contact_forces_are_unique_and_cost_next_to_nothing():
    problem, numbers, x = posed()
    forces = np.concatenate([np.r_[at] for name, at in problem.x.at.items() if name.startswith("force, ")])
    bend, slope = ca.hessian(problem.objective, problem.x.symbol)
    function = ca.Function("f", [problem.x.symbol, problem.numbers.symbol], [problem.objective, slope, bend])
    value, slope, bend = (np.array(v) for v in function(x, problem.numbers.pack(numbers, 0)))
    assert np.linalg.eigvalsh(bend[np.ix_(forces, forces)]).min() > 0.0
    assert 0.5 * slope[forces, 0] @ x[forces] < 1e-6 * value.item()


def test_places_that_settle_late_are_waited_for_and_those_that_never_do_are_not():
    for sign, again in ((-1.0, False), (1.0, True)):
        assert (runs(deepest=1.0 + sign * 1e-6) > 1) is again
        assert (runs(moved=1e-5 * (1.0 + sign * 1e-6)) > 1) is again
    assert runs(deepest=2.0, settles_after=6) == 6
    assert runs(deepest=2.0) < 12


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
    problem = SimpleNamespace(spec=SimpleNamespace(gravity="out_of_plane"), numbers=numbers.__getitem__)
    force = ca.SX.sym("force", 3)
    cone = friction_cone(problem, friction, *ca.vertsplit(force))
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
