"""Plans: two transcriptions, optimality, limits; from inside: the fine motion of a plan, and how its problem is split.

Plans: two transcriptions against each other, optimality, limits, failures, files.
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import time
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from plan_cases import small, two_arcs
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.planning import MotionPlan, PlanScene, PlanStatus, plan, search
from continuum_grasp.addons.planning.fine import excess_over_intervals, simulated
from continuum_grasp.addons.planning.guess import Path
from continuum_grasp.addons.planning.motion import PlannedMotion
from continuum_grasp.addons.planning.search import PlanSearch
from continuum_grasp.addons.planning.solve import _result
from continuum_grasp.base import InputError, Interrupted, SolverError
from continuum_grasp.nlp import Solver, SolverStatus
from tests.declared import assert_declared
from tests.marks import few
from tests.rods import ROOT, after

HAND = cg.Finger.model_validate(
    {
        "rod": {"length": 0.18, "linear_density": 0.034, "bending_stiffness": 6e-3, "diameter": 0.0012},
        "damping": {"material": 3e-5},
        "tendons": {"offset": 0.005, "min_tension": 1.0, "max_tension": 60.0, "time_constant": 0.02},
    }
)
KINDS = {
    "least_effort": {},
    "least_input_rate": {"objective": "least_input_rate"},
    "least_time": {"objective": "least_time", "duration": {"least": 0.05, "most": 0.2}},
    "linear": {"input": {"moment_max": 0.3, "form": "linear", "rate_max": 20.0}},
    "rate": {"input": {"moment_max": 0.3, "rate_max": 4.0}},
    "tracking": {
        "objective": "tracking",
        "cost": {"tip": {"running": 1e4, "terminal": 10.0}, "effort": 1.0, "input_rate": 1e-4},
        "reference": {"tip": {"center": (0.0, 0.25), "radius": 0.03, "frequency": 2.0}},
        "goal": {"end": "moving"},
    },
    "soft": {"bounds": {"speed": 10.0, "penalty": {"linear": 0.01, "quadratic": 0.1}}},
    "weighted": {"goal": {"tip": {"value": (-0.1, 0.25), "weight": 1e3}, "end": "held"}},
}
"""Plans of all make-ups."""


def tendons(**changes) -> PlanScene:
    """A plan of a finger with tendons and a lag."""
    keys = {"finger": HAND, "input": {}, "bounds": {}, "duration": 0.3, "intervals": 30}
    return small(**(keys | changes))


# -- the solver's problem ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", few(KINDS, 4))
def test_derivatives_are_those_of_automatic_differentiation(kind):
    zone = {"keep_out": {"post": {"type": "disc", "center": (-0.05, 0.28), "radius": 0.01}}}
    bounds = KINDS[kind].get("bounds", {}) | zone
    scene = two_arcs(**(KINDS[kind] | {"intervals": 4, "bounds": bounds}))
    assembly = PlanSearch(scene).problem.assembly
    nlp, lam = assembly.nlp, ca.MX.sym("lam", assembly.count)
    lagrangian = 0.7 * nlp.f + ca.dot(lam, nlp.g)
    slopes = [ca.gradient(nlp.f, nlp.x), ca.jacobian(nlp.g, nlp.x), ca.triu(ca.hessian(lagrangian, nlp.x)[0])]
    truth = ca.Function("truth", [nlp.x, lam], slopes)
    rng = np.random.default_rng(0)
    w, force = rng.uniform(0.1, 0.9, assembly.size), rng.normal(size=assembly.count)
    own = nlp.functions
    found = [own["grad_f"](w, [])[1], own["jac_g"](w, [])[1], own["hess_lag"](w, [], 0.7, force)]
    for value, expected in zip(found, truth(w, force), strict=True):
        expected = np.array(expected)
        assert np.array(value) == pytest.approx(expected, rel=1e-9, abs=1e-9 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("kind", KINDS)
def test_conditions_of_optimality_hold(kind):
    """Karush, Kuhn and Tucker, with gradients of CasADi rather than the assembled ones."""
    search = PlanSearch(two_arcs(**KINDS[kind]))
    search.run()
    assembly, best = search.problem.assembly, search.best
    assert best.converged
    nlp, bounds = assembly.nlp, assembly.start_within(*assembly.limits, best.x)
    slopes = ca.Function("s", [nlp.x], [ca.gradient(nlp.f, nlp.x), ca.jacobian(nlp.g, nlp.x)])
    gradient, jacobian = (np.array(v) for v in slopes(best.x))
    free = bounds.low < bounds.high
    lam_x, lam_g = best.multipliers.bounds, best.multipliers.constraints
    stationary = gradient.ravel() + jacobian.T @ lam_g + lam_x
    assert np.abs(stationary[free]).max() < 1e-5 * max(1.0, np.abs(gradient).max())
    for value, low, high, lam in (
        (best.x[free], bounds.low[free], bounds.high[free], lam_x[free]),
        (best.g, bounds.lower, bounds.upper, lam_g),
    ):
        assert np.all(value >= low - 1e-7)
        assert np.all(value <= high + 1e-7)
        open_up, open_down = np.minimum(high - value, 1e3), np.minimum(value - low, 1e3)
        assert np.abs(np.maximum(lam, 0.0) * open_up).max() < 1e-5
        assert np.abs(np.minimum(lam, 0.0) * open_down).max() < 1e-5


@pytest.mark.parametrize("kind", few([k for k in KINDS if k != "soft"], 4))
def test_shooting_and_collocation_agree(kind):
    """Two transcriptions, and two optimizers: what single shooting leaves of the optimum is 1e-5 of the objective."""
    of_methods = {"single_shooting": {"substeps": 20}, "collocation": {"degree": 4}}
    shot, collocated = (
        plan(two_arcs(**(KINDS[kind] | {"intervals": 50, "method": m, "solver": {**own, "tolerance": 1e-10}})))
        for m, own in of_methods.items()
    )
    assert collocated.objective == pytest.approx(shot.objective, rel=1e-3)
    assert collocated.tip == pytest.approx(shot.tip, abs=1e-3)


@pytest.mark.deep
@pytest.mark.parametrize("kind", few(["tracking", "weighted", "least_effort", "linear"], 2))
def test_gauss_newton_finds_the_same_plan(kind):
    exact, rough = (plan(two_arcs(**(KINDS[kind] | {"solver": {"hessian": h}}))) for h in ("exact", "gauss_newton"))
    assert rough.objective == pytest.approx(exact.objective, rel=1e-6)
    assert rough.x == pytest.approx(exact.x, abs=1e-3 * np.abs(exact.x).max())


@pytest.mark.parametrize(
    ("kind", "changes"),
    [("weighted", {}), ("soft", {}), ("least_time", {"smoothing": 0.1}), ("linear", {"duration": 0.02})],
)
def test_the_objective_is_what_was_asked_and_no_weight_beside_it(kind, changes):
    """Of motions without a plan too, which are sought for their distance from the goal."""
    found = plan(two_arcs(**(KINDS[kind] | changes)), raise_on_failure=False)
    assert found.solved is (kind != "linear")
    u, h = found.u[:, 0], found.t[1]
    effort = h * np.sum(u[:-1] ** 2)
    if kind == "linear":
        effort = h / 3 * np.sum(u[1:] ** 2 + u[1:] * u[:-1] + u[:-1] ** 2)
    expected = found.t[-1] if kind == "least_time" else effort
    assert found.objective == pytest.approx(expected, rel=1e-9)


# -- what a plan keeps -------------------------------------------------------------------------------------------------


BESIDE = {
    "object": {"shape": "circle", "diameter": 0.06, "mass": 0.1, "position": (0.13, 0.24)},
    "contact_law": {"stiffness": 500.0, "friction": 0.0},
}
"""An object that the finger does not touch."""


@pytest.mark.parametrize(("intervals", "beside"), [(5, {}), (6, {}), (6, BESIDE)])
def test_bounds_that_a_plan_leaves_between_their_places_hold_at_more(monkeypatch, intervals, beside):
    """Where the grid may not be finer, such a plan is no optimum. With an object they hold at the nodes alone first."""
    scene = small(bounds={"curvature": None, "speed": 7.0}, intervals=intervals, **beside)
    held = plan(scene)
    monkeypatch.setattr(search, "MOST_ELEMENTS", 1)
    left = plan(scene)
    assert (held.status, left.status) == ("optimal", "feasible")
    assert "between the nodes bending_rate_1 is left" in left.message
    for found, low, high in ((held, 0.0, 1e-3), (left, 1e-2, 0.3 if beside else 3e-2)):
        motion = PlannedMotion(scene)
        states = simulated(scene, motion.prediction, Path(found.x, found.u, found.duration), found.x[0], 101)
        assert low <= excess_over_intervals(motion, states, 101).max() < high
    assert held.objective > 1.01 * left.objective


@pytest.mark.deep
def test_the_shipped_detour_keeps_off_the_post():
    """At 101 places per interval: cheap plans rush through a zone between the places where they are bounded."""
    found = plan("configs/plan/past_a_post.yaml")
    motion = PlannedMotion(found.scene)
    states = simulated(found.scene, motion.prediction, Path(found.x, found.u, found.duration), found.x[0], 101)
    assert found.status == "optimal"
    assert excess_over_intervals(motion, states, 101)[:, motion.bounded.hard].max() < 1.1e-3


def test_least_time_of_held_inputs_reports_by_how_much_they_lead_the_drive():
    """Against the plan whose inputs do not jump: held inputs gain an interval at most."""
    asked = {
        "objective": "least_time",
        "duration": {"least": 0.02, "most": 0.3},
        "goal": {"bending": (0.5,), "end": "held"},
    }
    held, ramps = (
        plan(small(**asked, input={"moment_max": 0.3, "rate_max": 1.0, "form": form})) for form in ("hold", "linear")
    )
    interval = held.duration / held.scene.intervals
    assert 0.5 * interval < ramps.duration - held.duration < 1.05 * interval
    assert "up to one interval longer" in held.message
    (warning,) = held.warnings
    assert (
        f"at the end): a drive that keeps input.rate_max = 1 N m/s needs up to one interval ({1e3 * interval:.3g} ms)"
        in warning
    )
    assert "input.form: linear" in warning
    assert (ramps.message, ramps.warnings) == ("solved", ())


def test_multiplier_is_the_gain_from_a_wider_bound():
    """By a plan with a bound that is a little wider."""
    one, other = (
        plan(small(bounds={"curvature": None, "speed": v}, solver={"tolerance": 1e-10})) for v in (7.0, 7.001)
    )
    force = np.abs(one.constraints["speed"].multipliers).sum()  # of rows that are shares of 7 rad/s
    gain = (one.objective - other.objective) / (0.001 / 7.0)
    assert gain == pytest.approx(force, rel=0.02)


@pytest.mark.deep
def test_simulation_of_the_inputs_is_the_plan():
    """The package's simulator, with error control, on the scene that a user would write."""
    form = {"form": "linear", "rate_max": 400.0}
    scene = tendons(input=form, goal={"bending": (0.9,)}, intervals=15, solver={"degree": 5})
    found = plan(scene)
    tensions = tuple(cg.Samples(times=tuple(found.t), values=tuple(c), interpolation="linear") for c in found.u.T)
    played = cg.Scene(
        finger=HAND,
        gravity=scene.gravity,
        fidelity=scene.fidelity,
        actuation=cg.Actuation(tensions=tensions),
        initial=cg.Initial(pose="rest"),
        time=cg.Timing(duration=scene.duration, step=scene.duration / 1500, method="reference"),
    )
    moved = cg.simulate(played)
    assert moved.tip[::100] == pytest.approx(found.tip, abs=2e-6)
    assert found.deviation.tip < 1e-6


LAGGING = {"input": {"moment_max": 0.3, "time_constant": 0.01}, "fidelity": {"family": "matched_clothoid"}}
REPEATED = {
    "held moment": lambda: small(input={"moment_max": 0.3, "initial": (0.05,)}, solver={"degree": 5}),
    "linear moment": lambda: two_arcs(**KINDS["linear"], solver={"degree": 5}),
    "moment that lags": lambda: small(**LAGGING, goal={"tip": (-0.08, 0.28)}, solver={"degree": 5}),
    "tensions that lag": lambda: tendons(goal={"bending": (0.9,)}, loads=[{"at": 0.18, "force": (0.05, 0.0)}]),
}


@pytest.mark.parametrize("kind", REPEATED)
def test_a_plan_is_simulated_under_its_own_inputs(kind):
    """Collocation, with its own functions of the motion, against the simulator on the model of the plan's scene."""
    found = plan(REPEATED[kind]())
    model, moved = cg.FingerModel(found.scene), cg.simulate(found)
    assert model.x_names[: 2 * model.n] == found.x_names[: 2 * model.n]
    assert (model.family, model.lengths) == (moved.model.family, found.system.finger_model.lengths)
    assert moved.t == pytest.approx(found.t)
    assert np.ptp(found.tip[:, 0]) > 0.02
    assert moved.tip == pytest.approx(found.tip, abs=2e-4 * found.length)
    assert not [text for text in moved.warnings if "steps" in text]


def test_what_is_not_simulated_says_so():
    grasped = PlanScene.model_construct(**{**dict(small()), "grasp": object()})
    with pytest.raises(InputError, match="grasp: says where base and object are only when it is optimized"):
        cg.FingerModel(grasped)
    with pytest.raises(InputError, match="expected a Scene or a MotionResult or a path, got PlanScene"):
        cg.simulate(small())


def test_a_plan_of_few_intervals_follows_the_motion_between_its_nodes():
    """Polynomials of degree 2 over ten intervals are a millimeter off; the optimum is that of degree 7."""
    asked = {"intervals": 10, "goal": {"bending": (0.8, 0.5)}, "check": {"tolerance": 1e-4}}
    found, exact = (plan(two_arcs(**asked, solver={"degree": degree})) for degree in (2, 7))
    model, x = found.prediction, found.x[0]
    for k, u in enumerate(found.u[:-1]):
        x = after(0.015, lambda x, u=u: model.dynamics(x, u, []), x)
        assert np.array(model.tip(x, u, [])).ravel() == pytest.approx(found.tip[k + 1], abs=3e-5)
    assert found.status is PlanStatus.OPTIMAL
    assert found.u.shape == exact.u.shape == (11, 1)
    assert "20 elements" in found.statistics["starts"][1]
    assert len(exact.statistics["starts"]) == 1
    assert found.objective == pytest.approx(exact.objective, rel=2e-2)


def test_the_path_of_the_tip_is_that_of_the_motion_between_the_nodes_too():
    """Straight lines between nine nodes are a centimeter off."""
    found = plan(small(intervals=8, goal={"bending": (1.2,)}, solver={"degree": 5}))
    model, h = found.prediction, found.t[1] / 8
    x, true = found.x[0], [found.tip[0]]
    for u in np.repeat(found.u[:-1], 8, axis=0):
        x = after(h, lambda x, u=u: model.dynamics(x, u, []), x)
        true.append(np.array(model.tip(x, u, [])).ravel())
    assert found.tip_path[::8] == pytest.approx(found.tip, abs=1e-12)
    assert found.tip_path == pytest.approx(np.array(true), abs=3e-4)
    lines = np.stack([np.interp(np.linspace(0, 8, 65), np.arange(9), column) for column in found.tip.T], axis=1)
    assert np.abs(lines - true).max() > 1e-2


def test_held_inputs_give_the_plan_in_an_independent_integrator():
    found = plan(two_arcs(solver={"degree": 5}))
    model = found.prediction
    x = [found.x[0]]
    for k, u in enumerate(found.u[:-1]):
        x.append(after(found.t[k + 1] - found.t[k], lambda x, u=u: model.dynamics(x, u, []), x[-1]))
    assert np.array(x)[:, :2] == pytest.approx(found.x[:, :2], abs=1e-5)


def test_known_loads_bend_the_plan():
    """The moment that holds the straight finger under a tip force, by virtual work."""
    push = cg.ForceLoad(at=0.3, force=(-0.01, 0.0))
    found = plan(small(goal={"bending": (0.0,), "end": "held"}, loads=(push,), duration=0.3))
    # Virtual work of the straight arc: the tip moves by L/2 per bend to the left.
    assert found.u[-1, 0] == pytest.approx(-0.01 * 0.3 / 2, rel=1e-6)


# -- failures ----------------------------------------------------------------------------------------------------------


@pytest.mark.deep
@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({"goal": {"tip": (-0.01, 0.29)}}, ["goal out of reach", "nearest tip reached", "goal tip: violated by"]),
        (
            {"goal": {"bending": (1.2, 1.0)}, "input": {"moment_max": 0.08}},
            ["input limit", "input.moment_max", "goal bending"],
        ),
        ({"duration": 0.02}, ["duration", "goal bending: violated by"]),
        ({"input": {"moment_max": 0.3, "rate_max": 0.5}}, ["rate limit", "input.rate_max"]),
        ({"goal": {"bending": (2.0, 2.0)}, "bounds": {"curvature": 5.0}}, ["curvature limit", "bounds.curvature"]),
        (
            {
                "bounds": {"keep_out": {"wall": {"type": "half_plane", "point": (-0.01, 0.0), "normal_angle": 0.0}}},
                "solver": {"starts": 1},
            },
            ["zone wall", "bounds.keep_out.wall"],
        ),
    ],
)
def test_goals_out_of_reach_are_named_with_what_stops_them(changes, texts):
    with pytest.raises(SolverError) as caught:
        plan(two_arcs(**changes))
    assert caught.value.status == "infeasible"
    assert all(text in str(caught.value) for text in texts)
    nearest = caught.value.result
    assert nearest.violated
    assert max(c.excess for name, c in nearest.constraints.items() if name.startswith("motion")) < 1e-6


@pytest.mark.parametrize(("share", "status"), [(0.999, PlanStatus.GOAL_MISSED), (1.001, PlanStatus.OPTIMAL)])
@pytest.mark.parametrize("aim", [{"tip": (-0.1, 0.25)}, {"bending": (0.6, 0.2)}])
def test_goal_that_has_a_weight_is_missed_beyond_its_tolerance(aim, share, status):
    (name, value), weight = *aim.items(), 1.0
    loose = plan(two_arcs(goal={name: {"value": value, "weight": weight, "tolerance": 10.0}, "end": "still"}))
    found = loose.tip[-1] if name == "tip" else loose.bending[-1]
    error = np.abs(found - value)
    off = float(np.hypot(*error) if name == "tip" else error.max())
    goal = {name: {"value": value, "weight": weight, "tolerance": share * off}, "end": "still"}
    tight = plan(two_arcs(goal=goal))
    assert loose.status is PlanStatus.OPTIMAL
    assert tight.status is status
    assert tight.solved
    assert any(f"goal {name}: violated by {off:.3g}" in text for text in tight.warnings) is (share < 1.0)


BEYOND = {"tip": {"value": (-0.2, 0.15), "weight": 1e5}, "end": "still"}
LEVERS = {
    "moment_max": (
        lambda f: {"input": {"moment_max": 0.1 * f}, "goal": BEYOND},
        "raise the input's limits (input.moment_max)",
    ),
    "rate_max": (
        lambda f: {"input": {"moment_max": 0.5, "rate_max": 1.0 * f}, "goal": BEYOND},
        "raise input.rate_max",
    ),
    "duration": (
        lambda f: {"input": {"moment_max": 0.5, "rate_max": 2.0}, "goal": BEYOND, "duration": 0.1 * f},
        "allow a longer duration",
    ),
    "curvature": (
        lambda f: {"bounds": {"curvature": 3.0 * f}, "input": {"moment_max": 0.5}, "goal": BEYOND, "duration": 0.3},
        "allow more curvature",
    ),
    "weight": (
        lambda f: {"goal": {**BEYOND, "tip": {"value": (-0.1, 0.25), "weight": 1.0 * f**8, "tolerance": 0.01}}},
        "raise the weight of the goal",
    ),
}
"""Plans that miss a goal with a weight, with a factor on what they lack, and what is advised."""


@pytest.mark.parametrize("lever", LEVERS)
def test_advice_names_what_brings_a_missed_goal_nearer(lever):
    """By plans with half as much again of it; and no weight is named where ten times as much brings nothing."""
    changes, advice = LEVERS[lever]
    missed, nearer = (plan(two_arcs(**changes(f), intervals=15), raise_on_failure=False) for f in (1.0, 1.5))
    aim = missed.scene.goal.tip
    off, less = (float(np.hypot(*(found.tip[-1] - aim.value))) for found in (missed, nearer))
    assert missed.status is PlanStatus.GOAL_MISSED
    assert less < 0.9 * off
    assert advice in missed.advice
    assert missed.message == "solved, but a goal is missed"
    if lever != "weight":
        heavy = {**BEYOND, "tip": {**BEYOND["tip"], "weight": 10.0 * aim.weight}}
        heavier = plan(two_arcs(**{**changes(1.0), "goal": heavy, "intervals": 15}), raise_on_failure=False)
        assert np.hypot(*(heavier.tip[-1] - aim.value)) > 0.9 * off
        assert "weight" not in missed.advice


def test_a_search_that_is_cut_says_so_where_its_motion_misses_the_goal():
    """Not that the goal is missed, of which it knows nothing: with more iterations it is met."""
    search = PlanSearch(two_arcs(goal={"bending": {"value": (0.4, 0.2), "weight": 1e3}}))
    search.run()
    assert _result(search).status is PlanStatus.OPTIMAL
    still = search.problem.start(Path(np.zeros((31, 4)), np.zeros((31, 1)), 0.15))
    search.best = replace(
        search.best, x=still, status=SolverStatus.ITERATION_LIMIT, outcome="Maximum_Iterations_Exceeded"
    )
    found = _result(search)
    assert found.status is PlanStatus.NOT_SOLVED
    assert found.message.startswith("no plan was found: the iterations were used up; the motion there misses goal bend")
    assert found.violated == ("goal bending: violated by 0.4 rad (goal.bending)",)
    assert "more iterations" in found.advice


@pytest.mark.parametrize(
    ("solver", "status", "text"),
    [
        ({"max_iterations": 2}, PlanStatus.NOT_SOLVED, "iterations were used up"),
        ({"max_total_iterations": 2}, PlanStatus.NOT_SOLVED, "solver.max_total_iterations"),
        ({"time_limit": 1e-6}, PlanStatus.STOPPED, "solver.time_limit"),
    ],
)
def test_solver_that_is_stopped_says_so(solver, status, text):
    found = plan(two_arcs(solver=solver), raise_on_failure=False)
    assert found.status is status
    assert text in found.message


@pytest.mark.parametrize(("changes", "status"), [({}, PlanStatus.OPTIMAL), ({"duration": 0.02}, PlanStatus.INFEASIBLE)])
def test_a_busy_machine_gives_the_same_plan_bit_by_bit(monkeypatch, changes, status):
    calm, readings = plan(two_arcs(**changes), raise_on_failure=False), itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: 10.0 * next(readings))  # s
    busy = plan(two_arcs(**changes), raise_on_failure=False)
    assert calm.status is busy.status is status
    assert calm.x.tobytes() == busy.x.tobytes()
    assert (calm.message, calm.violated, calm.iterations) == (busy.message, busy.violated, busy.iterations)


def test_interrupt_gives_what_there_is(monkeypatch):
    """Ctrl-C in the first solve ends it, and the search: its last iterate is the plan."""
    solve, calls = Solver.solve, []

    def pressed(*given):
        calls.append(given)
        os.kill(os.getpid(), signal.SIGINT)
        return solve(*given)

    monkeypatch.setattr(Solver, "solve", pressed)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # what begins in the background ignores it
    try:
        with pytest.raises(Interrupted) as caught:
            plan(two_arcs(intervals=20))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(calls) == 1
    assert not caught.value.result.solved
    assert caught.value.result.x.shape == (21, 4)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"goal": {}}, "goal: give tip"),
        ({"goal": {"bending": (0.1, 0.2, 0.3)}}, "expected 2 entries"),
        ({"objective": "least_time"}, "least_time needs a range"),
        ({"objective": "tracking"}, "cost is missing"),
        ({"input": {}}, "moment_max is needed"),
        ({"input": {"moment_max": 0.1, "initial": (0.2,)}}, "outside the limits"),
        ({"loads": (cg.ForceLoad(at=0.1, force=(1.0, 0.0)),)}, "expected one of contacts or the tip"),
        ({"goal": {"contact_force": (1.0,)}}, "needs an object"),
        ({"fidelity": cg.Fidelity(tolerance=0.01)}, "give family and elements"),
    ],
)
def test_wrong_scenes_are_refused(changes, text):
    with pytest.raises(InputError, match=text):
        plan(two_arcs(**changes))


def test_a_grasp_of_several_fingers_is_refused_by_its_key(tmp_path):
    text = (ROOT / "configs/plan/close_on_mug.yaml").read_text(encoding="utf-8")
    text = text.replace("../grasp/mug.yaml", f"{ROOT}/configs/grasp/pinch.yaml")
    text = text.replace("../fingers/", f"{ROOT}/configs/fingers/")
    file = tmp_path / "pinch.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"a plan moves one finger, and this grasp has several.* mission") as caught:
        plan(file)
    assert caught.value.key == "grasp"


def test_a_bound_that_cannot_be_satisfied_is_named_with_its_amount_and_instant():
    """A finger that stands 10 mm behind a wall, with half of its thickness of 2 mm, leaves it as fast as it can."""
    zone = {"type": "half_plane", "point": (0.01, 0.0), "normal_angle": 0.0}
    found = plan(small(bounds={"curvature": None, "keep_out": {"wall": zone}}), raise_on_failure=False)
    model, first = found.prediction, 0.1 / 25 / 4
    moved = after(first, lambda x: model.dynamics(x, [-0.3], []), found.x[0])
    amount = 0.011 - np.array(model.tip(moved, [-0.3], [])).ravel()[0]
    assert found.status is PlanStatus.INFEASIBLE
    assert f"wall is left by {amount:.3g} m at t = {first:.3g} s" in found.message
    assert any(text == f"wall: violated by {amount:.3g} m (bounds.keep_out.wall)" for text in found.violated)
    # Known from the first three of 25 intervals: whole horizons from five sides took a minute.
    assert len(found.t) == 4
    assert len(found.statistics["starts"]) == 1


def test_a_bound_that_is_left_between_the_places_of_the_problem_is_reported(monkeypatch):
    """The problem bounds quarters of intervals; in between a parabola passes its bound, by an integrator of its own."""
    monkeypatch.setattr(search, "MOST_ELEMENTS", 1)
    found = plan(small(bounds={"curvature": None, "speed": 7.0}, intervals=8, solver={"degree": 4}))
    model, rates = found.prediction, []
    for k, u in enumerate(found.u[:-1]):
        run = solve_ivp(
            lambda t, x, u=u: np.array(model.dynamics(x, u, [])).ravel(),
            (0.0, found.t[1]),
            found.x[k],
            rtol=1e-9,
            atol=1e-11,
            t_eval=np.linspace(0.0, found.t[1], 65),
        )
        rates.append(np.abs(run.y[1]))
    assert np.max([rate[::16] for rate in rates]) == pytest.approx(7.0, rel=1e-5)
    beyond = np.max(rates) / 7.0 - 1.0
    assert beyond > 5e-3
    said = f"between the nodes bending_rate_1 is left by {100 * beyond:.2g} % of its limit"
    assert any(said in warning for warning in found.warnings)


@pytest.mark.parametrize("end", ["still", "held"])
def test_a_wall_that_is_entered_after_the_end_is_said(end):
    """Against the same motion by an integrator of its own."""
    free = plan(small(goal={"bending": (0.5,), "end": end}))
    # Some periods of its sway: 6.5 times sqrt(m L^3 / E I).
    model, after = free.prediction, 6.5 * free.scene.finger.rod.natural_time
    times = np.linspace(0.0, after, 2001)
    run = solve_ivp(
        lambda t, x: np.array(model.dynamics(x, free.u[-1], [])).ravel(),
        (0.0, after),
        free.x[-1],
        rtol=1e-9,
        atol=1e-11,
        t_eval=times,
    )
    later = np.array([np.array(model.tip(x, free.u[-1], [])).ravel()[0] for x in run.y.T])
    wall = free.tip[:, 0].max() + 2e-3  # to the right, to which the finger swings back
    assert bool(later.max() > wall) is (end == "still")
    zone = {"type": "half_plane", "point": (wall, 0.0), "normal_angle": np.pi}
    walled = plan(
        small(
            goal={"bending": (0.5,), "end": end},
            bounds={"curvature": None, "keep_out": {"wall": zone}},
            solver={"starts": 1},
        )
    )
    assert walled.objective == pytest.approx(free.objective, rel=1e-4)
    share = 100 * (later.max() + 1e-3 - wall) / 0.3  # the surface is 1 mm from the backbone
    said = f"within {after:.2g} s after the end, under its last input, wall is left by {share:.2g} % of its limit"
    assert (said in walled.message) is (end == "still")
    assert walled.solved


# -- files and starts --------------------------------------------------------------------------------------------------


def test_saved_plan_comes_back_and_starts_the_next_one(tmp_path):
    found = plan(two_arcs())
    found.save(tmp_path)
    back = MotionPlan.load(tmp_path)
    for name in ("t", "x", "u", "tip", "bending"):
        assert getattr(back, name) == pytest.approx(getattr(found, name))
    assert (back.status, back.scene, back.deviation) == (found.status, found.scene, found.deviation)
    assert set(back.constraints) == set(found.constraints)
    again = plan(two_arcs(), warm=tmp_path)
    assert again.objective == pytest.approx(found.objective, rel=1e-6)
    assert again.iterations < found.iterations
    other = plan(two_arcs(duration=0.2, goal={"bending": (0.5, 0.2)}), warm=found)
    assert other.solved


def test_warm_start_of_another_model_is_refused():
    with pytest.raises(InputError, match="other bending coordinates"):
        plan(small(), warm=plan(two_arcs()))


def test_pictures_and_values_at_instants(tmp_path):
    found = plan(tendons(intervals=10))
    assert_declared(found)
    assert {path.name for path in found.save_pictures(tmp_path)} == {"path.png", "inputs.png", "coordinates.png"}
    middle = 0.5 * (found.t[3] + found.t[4])
    assert found.inputs_at([middle, 99.0]) == pytest.approx(found.u[[3, -1]])
    assert found.states_at(found.t) == pytest.approx(found.x)


def test_command(tmp_path):
    import typer

    from continuum_grasp.addons.planning.verbs import plan as verb

    app = typer.Typer()
    app.command()(verb)
    file = tmp_path / "swing.yaml"
    rod = "{length: 0.3, diameter: 0.002, density: 6450.0, youngs_modulus: 60e9}"
    file.write_text(
        f"schema_version: 1\nfinger: {{rod: {rod}, damping: {{material: 1e-4}}}}\ngravity: [0.0, 0.0]\n"
        "fidelity: {family: arc, elements: 1}\ninput: {moment_max: 0.3}\ngoal: {bending: [0.5]}\n"
        "duration: 0.1\nintervals: 10\n"
    )
    done = CliRunner().invoke(app, [str(file), "--out", str(tmp_path / "run"), "--json", "--no-pictures"])
    assert done.exit_code == 0
    printed = json.loads(done.stdout)
    assert printed["status"] == "optimal"
    assert MotionPlan.load(tmp_path / "run").objective == pytest.approx(printed["objective"])
    failed = CliRunner().invoke(app, [str(file), "--out", str(tmp_path / "no"), "--set", "duration=0.005"])
    assert isinstance(failed.exception, SolverError)
    assert MotionPlan.load(tmp_path / "no").status is PlanStatus.INFEASIBLE


# -- contact -----------------------------------------------------------------------------------------------------------


def test_plan_presses_on_an_object():
    """A single arc that lies against a disc with a force that is asked for: the moment carries it."""
    law = {"stiffness": 500.0, "friction": 0.0, "dissipation": 0.5, "rounding": 5e-4}
    obstacle = {"shape": "circle", "diameter": 0.06, "mass": 0.1, "position": (-0.13, 0.24)}
    scene = small(
        object=obstacle,
        contact_law=law,
        fidelity=cg.Fidelity(family="clothoid", elements=1),
        goal={"contact_force": {"value": (0.3,), "weight": 2e3}, "end": "held"},
        method="collocation",
        duration=0.4,
        intervals=50,
    )
    found = plan(scene)
    assert found.contact_forces[-1] == pytest.approx([0.3], rel=0.05)
    assert found.contact_forces[0] == pytest.approx([0.0])
    assert found.deviation.contact_forces == pytest.approx(tuple(found.contact_forces[-1]), rel=0.15)


def test_friction_with_a_state_is_refused():
    obstacle = {"shape": "circle", "diameter": 0.06, "mass": 0.1, "position": (-0.13, 0.24)}
    with pytest.raises(InputError, match="slip_speed"):
        small(object=obstacle, contact_law={"stiffness": 500.0, "friction": 0.5})
