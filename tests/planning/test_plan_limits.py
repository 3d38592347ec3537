"""The limits of the check of plans; from inside: results made here, on either side of each, are judged.

The limits of the check of plans: hand-made results just within and just beyond each, and the word of a verdict.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plan_cases import small

from continuum_grasp.addons.planning import PlanScene, PlanStatus, diagnosis, fine
from continuum_grasp.addons.planning.goal import goal_parts
from continuum_grasp.addons.planning.guess import Path
from continuum_grasp.addons.planning.motion import PlannedMotion
from continuum_grasp.addons.planning.problem import PlanProblem
from continuum_grasp.addons.planning.result import qualified
from continuum_grasp.addons.planning.search import PlanSearch
from continuum_grasp.addons.planning.solve import _result
from continuum_grasp.base import InputError
from continuum_grasp.nlp import SolverStatus, Violation

LENGTH, TOLERANCE, NODES, PARTS = 0.5, 2e-3, 3, fine.PARTS
"""Of the hand-made plan: finger [m], greatest deviation per length [1], nodes, and parts of an interval."""


@dataclass
class Made:
    """A plan at rest: tip (x, y) [m], a bound's row and a soft one's [1], x, y [m] and angle [rad] of an object."""

    scene: Any
    warnings: tuple[str, ...] = ()
    status: str = "optimal"
    message: str = ""
    advice: str = ""
    deviation: Any = None
    finer: Any = None
    duration: float = 1.0
    length: float = LENGTH

    def __post_init__(self):
        self.t, self.u = np.linspace(0.0, 1.0, NODES), np.zeros((NODES, 1))
        self.x, self.tip = np.zeros((NODES, 7)), np.zeros((NODES, 2))


def rows_of(count):
    return lambda x, u, p: x[2:4]


REACH = 0.05
"""Greatest extent of the object [m]."""
BODY = SimpleNamespace(object=SimpleNamespace(parts=[SimpleNamespace(extent=r) for r in (0.03, REACH)]))


def model_of(names=("x", "y", "row", "soft row")):
    return SimpleNamespace(
        nu=1, p_nominal=(), x_names=names, contact_names=(), tip=SimpleNamespace(map=lambda n: lambda x, u, p: x[:2]),
        bending_rate=lambda x, u, p: np.zeros(1),
        system=SimpleNamespace(
            finger_model=SimpleNamespace(lengths=(1.0,), family="arc"), object_states=slice(4, 7), surroundings=BODY
        ),
    )  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A goal that the row of a bound is to be zero at the end, up to a tolerance."""

    played: float
    at_rest = False
    weight = None

    def missed(self, motion, z, tolerance):
        return (Violation("goal row", 0, z[2], "N", "goal.row", z[2]) if abs(z[2]) > tolerance else None), abs(z[2])


def verdict(
    monkeypatch, states, *, drift=0.0, method="collocation", end="held", friction=False, finer=(), goal=(), grows=0.0
):
    """What the check says of states; after the last the tip moves on [m/s] and the row grows [1/s]; finer: the last
    state of a finer model.
    """
    own, other = model_of(("x", "y", "friction_1 [1]", "")) if friction else model_of(), model_of()
    check = SimpleNamespace(tolerance=TOLERANCE, finer="finer" if finer else None, contact_law=None)
    scene = SimpleNamespace(transcription=method, goal=SimpleNamespace(end=end), check=check, contact_law=None)
    scene.finger, scene.load_varies = SimpleNamespace(rod=SimpleNamespace(natural_time=0.1 / 1.3)), False
    scene.model_copy = lambda update: scene

    def simulated(scene, model, path, x0, parts=PARTS):
        if model is other:
            return np.outer(np.arange(NODES) == NODES - 1, np.resize([*finer, *[0.0] * 7], 7))
        after = x0 + np.array([0.6 * drift, 0.8 * drift, grows, *[0.0] * 4]) * path.duration
        return states if len(path.u) == NODES else np.array([x0, after])

    monkeypatch.setattr(fine, "simulated", simulated)
    monkeypatch.setattr(fine, "parameters_over_time", lambda *_: np.zeros((1, 0)))
    monkeypatch.setattr(fine, "first_state_of_plan", lambda *_: (np.zeros(7), None))
    monkeypatch.setattr(fine, "Prediction", lambda _: other)
    bounded = SimpleNamespace(
        names=("speed", "comfort"), least=[-1.0, -1.0], most=[2.0, 2.0], hard=np.array([True, False])
    )
    motion = SimpleNamespace(scene=scene, prediction=own, bounded=bounded, rows=SimpleNamespace(map=rows_of))
    motion.scaled_state, motion.scales = (lambda x, u: x), SimpleNamespace(u=np.ones(1))
    motion.missed_setpoints = lambda *_: ()
    return fine.checked(Made(scene), motion, goal)


def at(row, *values):
    """States that are zero but for one row."""
    states = np.zeros((PARTS * (NODES - 1) + 1, 7))
    states[row, : len(values)] = values
    return states


def off(amount, row=PARTS):
    """States whose tip is off by an amount [m] at a row."""
    return at(row, 0.6 * amount, 0.8 * amount)


SHOOTING = {"method": "single_shooting"}
ROW = {"goal": [Row(0.3)]}
HELD = {**SHOOTING, "end": "held", "friction": True}
VERDICTS = [
    ("tip off the plan [m]", TOLERANCE * LENGTH, "a fine simulation is up to", lambda a: (off(a), {})),
    ("tip off a plan in the inputs alone [m]", TOLERANCE * LENGTH, "no plan: a fine simulation of its inputs",
     lambda a: (off(a), SHOOTING)),
    ("tip that moves on [m/s], in 0.1 s", TOLERANCE * LENGTH / 0.1, "no plan: the tip moves on",
     lambda a: (off(0.0), {**HELD, "drift": a})),
    ("a bound that is left upwards", 2.0 + 1e-3, "between the nodes speed is left", lambda a: (at(2, 0, 0, a), {})),
    ("a bound that is left downwards", 1.0 + 1e-3, "between the nodes speed is left", lambda a: (at(6, 0, 0, -a), {})),
    ("object off the plan [m]", TOLERANCE * LENGTH, "a fine simulation is up to 1 mm off the plan (of the object; 0 mm",
     lambda a: (at(PARTS, 0, 0, 0, 0, 0.6 * a, 0.8 * a), {})),
    ("edge of an object that is turned off the plan [m]", TOLERANCE * LENGTH, "a fine simulation is up to 1 mm off",
     lambda a: (at(PARTS, 0, 0, 0, 0, 0, 0, 2.0 * np.arcsin(a / 2.0 / REACH)), {})),
    ("goal missed at the end", 0.3, "a fine simulation misses goal row: violated by", lambda a: (at(-1, 0, 0, a), ROW)),
    ("goal missed after the end [1/s], in 0.1 s", 0.3 / 0.1, "0.1 s after its end a fine simulation misses goal row",
     lambda a: (off(0.0), {**ROW, "grows": a})),
    ("tip off on a finer model [m]", 0.01 * LENGTH, "on 1 elements (arc) the tip ends",
     lambda a: (off(0.0), {"finer": (a,)})),
    ("object off on a finer model [m]", 0.01 * LENGTH, "on 1 elements (arc) the object ends",
     lambda a: (off(0.0), {"finer": (0, 0, 0, 0, a)})),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "text", "made"), [row[1:] for row in VERDICTS], ids=[row[0] for row in VERDICTS])
def test_a_check_says_so_beyond_its_limit_alone(monkeypatch, limit, text, made):
    # Some limits are a bound and a part of a thousand.
    for share, beyond in ((1.0 - 1e-6, False), (1.0 + 1e-6, True)):
        states, how = made(share * limit)
        found = verdict(monkeypatch, states, **how)
        verdicts = {"no plan": "not_solved", "a fine simulation": "feasible", "between the nodes": "feasible"}
        verdicts |= dict.fromkeys(("a fine simulation misses", "0.1 s after"), "goal_missed")
        departed = [status for begin, status in verdicts.items() if text.startswith(begin)] or ["optimal"]
        assert found.status == (departed[-1] if beyond else "optimal")
        assert any(said.startswith(text) for said in (*found.warnings, found.message)) is beyond
        assert (text in found.message) is beyond


def test_what_no_check_is_about_goes_unsaid(monkeypatch):
    """A tip off between nodes, soft bounds, the first state's bound, drift of what need not stay."""
    first = at(0, 0.0, 0.0, 9.0)
    assert not verdict(monkeypatch, off(1.0, row=PARTS + 1)).warnings
    assert not verdict(monkeypatch, at(3, 0.0, 0.0, 0.0, 9.0)).warnings
    assert not verdict(monkeypatch, first).warnings
    for how in ({**HELD, "friction": False}, {**HELD, "method": "collocation"}):
        assert verdict(monkeypatch, off(0.0), **how, drift=1.0).status == "optimal"


@pytest.mark.parametrize("given", [None, 3])
@pytest.mark.parametrize("sudden", [True, False])
def test_more_steps_than_can_be_taken_are_refused_with_what_to_try(monkeypatch, given, sudden):
    motion = PlannedMotion(small(method="single_shooting", intervals=4, solver={"substeps": given} if given else {}))
    monkeypatch.setattr(PlanScene, "sudden", sudden)
    for rate, refused in ((-40.0, False), (-1e12, True)):
        motion.__dict__.pop("_rates", None)
        motion.__dict__["prediction"] = SimpleNamespace(eigenvalues=lambda *_, rate=rate: np.array([rate + 0j]))
        if not refused:
            assert motion.steps == (given or 9, 2)  # 0.1 % of a mode of 40/s over 25 ms
            continue
        with pytest.raises(InputError, match=r"up to 1e\+12 1/s, so each of 4 intervals needs more") as caught:
            _ = motion.steps
        assert caught.value.key == ("solver.substeps" if given else "method")
        assert ("method: collocation" in str(caught.value)) is not sudden
        assert ("leave out solver.substeps" if given else "raise intervals") in str(caught.value)


@pytest.mark.parametrize(
    ("rate", "interval", "method", "substeps"),
    [
        # A step times the fastest rate is at most 0.1: four parts of 0.1 s have steps for 4/s each, 2 to 200.
        (0.0, 0.1, "rk4", 2),
        (7.99, 0.1, "rk4", 2),
        (8.01, 0.1, "rk4", 3),
        (799.9, 0.1, "rk4", 200),
        (800.1, 0.1, "rodas", 50),
        # Beyond, steps of 0.5 ms at most, four at least.
        (1e9, 4e-3, "rodas", 4),
        (1e9, 7.999e-3, "rodas", 4),
        (1e9, 8.001e-3, "rodas", 5),
    ],
)
def test_stiffness_chooses_method_and_steps_of_the_fine_simulation(monkeypatch, rate, interval, method, substeps):
    asked = []
    monkeypatch.setattr(fine, "_rollout", lambda model, method, steps: asked.append((method, steps)) or run)

    def run(begin, parts, count, h, *_):
        asked.append((count, h))
        return np.zeros((1, parts + 1, 1)), [parts]

    monkeypatch.setattr(fine, "parameters_over_time", lambda *_: np.zeros((1, 0)))
    monkeypatch.setattr(fine, "_units", lambda *_: np.ones(1))
    system = SimpleNamespace(structure=SimpleNamespace(stiff_method=lambda: "rodas", partial_step=1e-4))
    model = SimpleNamespace(fastest_rate=lambda *_: rate, nu=1, np=0, system=system)
    finger = SimpleNamespace(rod=SimpleNamespace(natural_time=0.076))
    limits = (0.0,), (1.0,)
    scene = SimpleNamespace(input_limits=limits, load_varies=False, input=SimpleNamespace(form="held"), finger=finger)
    path = Path(np.zeros((3, 1)), np.zeros((3, 1)), 2 * interval)
    assert len(fine.simulated(scene, model, path, np.zeros(1), 4)) == 9
    assert asked[0] == (method, 8 * substeps)
    assert asked[1] == (substeps, pytest.approx(interval / 4 / substeps))


GOALS = [
    ({}, 1e-5 * 0.1 * 0.3, 1e-5 * 0.5),
    ({"weight": 1.0}, 0.01 * 0.3, 0.05),
    ({"weight": 1.0, "tolerance": 2e-3}, 2e-3, 2e-3),
]
"""Aims of a finger of 0.3 m, and the errors up to which its tip [m] and its bend [rad] meet them."""


@pytest.mark.parametrize(("aim", "length", "angle"), GOALS)
def test_a_goal_is_missed_beyond_its_tolerance_alone(aim, length, angle):
    """A straight finger along y, and goals beside it."""
    for share, missed in ((0.999, []), (1.001, ["goal tip", "goal bending"])):
        tip, bend = (0.6 * share * length, 0.3 - 0.8 * share * length), share * angle
        goal = {"tip": {"value": tip, **aim}, "bending": {"value": (bend,), **aim}, "end": "moving"}
        motion = PlannedMotion(small(goal=goal, intervals=2))
        problem = PlanProblem(motion, np.zeros(motion.nx))
        w = problem.start(Path(np.zeros((3, motion.nx)), np.zeros((3, 1)), 0.1))
        found, worst = diagnosis.missed_goals(problem, w, weighted="weight" in aim)
        assert [text.split(":")[0] for text in found] == missed
        assert worst == pytest.approx(share * max(length / 0.03, angle / 0.5), rel=1e-9)


def test_a_shape_is_met_by_an_arc_through_its_points():
    bend, at = 0.8, (0.1, 0.3)
    points = [0.3 / bend * np.array((np.cos(bend * s / 0.3) - 1.0, np.sin(bend * s / 0.3))) for s in at]
    goal = {"shape": {"at": at, "value": np.array(points).tolist()}, "end": "moving"}
    motion = PlannedMotion(small(goal=goal, intervals=2))
    problem = PlanProblem(motion, np.zeros(motion.nx))
    w = problem.start(Path(np.tile([bend, 0.0], (3, 1)), np.zeros((3, 1)), 0.1))
    assert diagnosis.missed_goals(problem, w, weighted=False) == ([], pytest.approx(0.0, abs=1e-9))


def diagnosed(monkeypatch, strengths, *, error=1.0, excess=0.0):
    """What is said of strengths of limits, an error of a goal, and an excess of a bound of the state."""
    speed = Violation("speed", 3, excess, "m/s", "bounds.speed", excess)
    block = SimpleNamespace(key="bounds.speed", rows=np.zeros((4, 1)))
    monkeypatch.setattr(diagnosis, "missed_goals", lambda *_, **__: (["goal tip"] if error else [], error))
    monkeypatch.setattr(diagnosis, "_strengths", lambda *_: strengths)
    monkeypatch.setattr(diagnosis, "_nearest", lambda *_: "")
    problem = SimpleNamespace(
        assembly=SimpleNamespace(blocks=[block]),
        violations=lambda _: [speed],
        path=lambda _: SimpleNamespace(duration=2.0),
        motion=SimpleNamespace(scene=SimpleNamespace(limit_keys="")),
    )
    found = diagnosis.diagnose(problem, SimpleNamespace(x=None, g=None))
    return "nothing" if found is None else " and ".join((*found.violated, found.message))


REASONS = [
    ("share of the strongest limit", "the input limit stops it and the duration stops it",
     lambda p: ({"duration": 0.6 * p, "input": 3.0}, {})),
    ("strength near the goal", "the input limit stops it", lambda p: ({"input": 1e-6 * p}, {"error": 0.5})),
    ("strength far from it", "the speed limit stops it", lambda p: ({"speed": 3e-6 * p}, {"error": 3.0})),
    ("excess of a bound", "a bound of the state cannot be satisfied: speed is left by 1e-05 m/s at t = 2 s",
     lambda p: ({}, {"error": 0.0, "excess": 1e-5 * p})),
]  # fmt: skip


@pytest.mark.parametrize(("text", "made"), [row[1:] for row in REASONS], ids=[row[0] for row in REASONS])
def test_a_reason_is_named_beyond_its_limit_alone(monkeypatch, text, made):
    for part, named in ((0.999, False), (1.001, True)):
        strengths, how = made(part)
        assert (text in diagnosed(monkeypatch, strengths, **how)) is named


LEVERS = [
    ("input", lambda f: {"input": {"moment_max": 0.02 * f}}),
    ("input rate", lambda f: {"input": {"moment_max": 0.3, "rate_max": 0.5 * f}}),
    ("duration", lambda f: {"duration": 0.01 * f}),
    ("curvature", lambda f: {"bounds": {"curvature": 0.8 * f}}),
]


@pytest.mark.parametrize(("name", "changes"), LEVERS)
def test_the_strength_of_a_limit_is_what_widening_it_gains(name, changes):
    """Against differences of the least distance of problems solved anew."""

    def nearest(factor):
        search = PlanSearch(small(intervals=5, **changes(factor)))
        problem, motion = search._near_goal, search.motion
        path = Path(np.zeros((6, motion.nx)), np.zeros((6, 1)), motion.scene.duration_range[1])
        attempt = search._solved(problem, problem.start(path))
        assert attempt.violation < 1e-6
        return problem, attempt

    step = 1e-3
    wider, narrower = (nearest(1.0 + sign * step)[1].objective for sign in (1.0, -1.0))
    strengths = diagnosis._strengths(*nearest(1.0))
    assert strengths[name] == pytest.approx((narrower - wider) / (2 * step), rel=5e-3)


@pytest.mark.parametrize(("method", "limit"), [("collocation", 1e-6), ("single_shooting", 1e-5)])
def test_an_attempt_is_a_plan_up_to_its_violation(method, limit):
    search = PlanSearch(small(method=method, intervals=2))
    for share, good in ((0.999, True), (1.001, False)):
        search.best = None
        search._solved = lambda *_, v=share * limit, **__: SimpleNamespace(violation=v, converged=True, objective=1.0)
        assert search._try("made up", np.zeros(1)) is good
        assert (search.best is not None) is good


@pytest.fixture(scope="module")
def searched():
    search = PlanSearch(small(intervals=5))
    search.run()
    assert search.best is not None
    return search


STATUSES = [
    (PlanStatus.OPTIMAL, "solved", {}),
    (PlanStatus.FEASIBLE, "but the iterations were used up before the optimum", {"converged": False}),
    (PlanStatus.FEASIBLE, "(solver.max_total_iterations) before the search was complete", {"cut": "iterations"}),
    (PlanStatus.FEASIBLE, "(solver.time_limit) before the search was complete", {"cut": "clock"}),
    (PlanStatus.NOT_SOLVED, "no plan was found: the iterations were used up", {"found": False}),
    (PlanStatus.NOT_SOLVED, "(solver.max_total_iterations)", {"found": False, "cut": "iterations"}),
    (PlanStatus.STOPPED, "(solver.time_limit)", {"found": False, "cut": "clock"}),
    (PlanStatus.INFEASIBLE, "stops it", {"found": False, "diagnosis": True}),
    (PlanStatus.STOPPED, "(solver.time_limit)", {"found": False, "diagnosis": True, "cut": "clock"}),
]


@pytest.mark.parametrize(("status", "text", "how"), STATUSES)
def test_a_plan_says_in_a_word_how_the_search_ended(monkeypatch, searched, status, text, how):
    best = searched.best
    if not how.get("converged", True) or not how.get("found", True):
        best = replace(best, status=SolverStatus.ITERATION_LIMIT, outcome="Maximum_Iterations_Exceeded")
    cut = how.get("cut", "")
    monkeypatch.setattr(searched, "attempts", [("direct", best)])
    monkeypatch.setattr(searched, "relaxed", [("direct", best)])
    monkeypatch.setattr(searched, "best", best if how.get("found", True) else None)
    monkeypatch.setattr(searched, "budget", SimpleNamespace(cut=cut, stopped=cut == "clock"))
    if how.get("diagnosis"):
        monkeypatch.setattr(searched, "diagnosis", SimpleNamespace(message="what stops it", advice="", violated=("x",)))
    found = _result(searched)
    assert found.status is status
    assert text in found.message
    assert found.solved is (best is searched.best)
    assert found.message.count("but ") <= 1


def test_one_sentence_has_one_but():
    message = qualified(qualified(qualified("solved", "late"), "far"), "loose")
    assert message == "solved, but late; far; loose"


@pytest.mark.parametrize(("aim", "tolerance"), [((0.0, 0.3), 0.03), ((2.0, 1.0), 0.2), ((0.0, 0.0), 0.5 * 0.4)])
def test_a_force_counts_as_reached_within_a_tenth_of_the_greatest_that_is_asked(aim, tolerance):
    """Of a finger whose 5 E I / L^2 are 2 N: a tenth of these, for 0.3 N, was two thirds of what was asked."""
    body = {"shape": "circle", "diameter": 0.04, "mass": 0.1, "position": (0.1, 0.2)}
    law = {"stiffness": 1e3, "friction": 0.0}
    rod = {"length": 0.3, "linear_density": 0.03, "bending_stiffness": 0.4 * 0.3**2}
    keys = {"finger": {"rod": rod}, "contacts": (0.15,), "object": body, "contact_law": law}
    keys |= {"fidelity": {"family": "arc", "elements": 2}}
    for weight, share in ((1.0, 1.0), (None, 0.1)):  # of a fine simulation, at the usual check.tolerance
        goal = {"contact_force": {"value": aim, "weight": weight}}
        (part,) = (
            each
            for each in goal_parts(PlannedMotion(small(**{**keys, "goal": goal})), settles=False, presses=False)
            if not each.at_rest
        )
        assert np.max(part.played * part.scale) == pytest.approx(share * tolerance, rel=1e-9)


@pytest.mark.parametrize("name", ["speed", "motion", "bending_rate_1", "speed_1"])
def test_a_zone_may_have_any_name(name):
    """A zone called speed was one with the bound of the speed, and one called motion with the equations of motion."""
    wall = {"type": "half_plane", "point": (-9.0, 0.0), "normal_angle": 0.0, "of": "backbone"}
    asked = small(intervals=3, bounds={"curvature": None, "speed": 20.0, "keep_out": {name: wall}})
    search = PlanSearch(asked)
    blocks = {block.key: block for block in search.problem.assembly.blocks}
    speed, zone = blocks["bounds.speed"], blocks[f"bounds.keep_out.{name}"]
    assert (speed.name, speed.unit, speed.rows.shape) == ("speed", "of its limit", (12, 1))
    assert (zone.name, zone.unit, zone.rows.shape) == (name, "m", (12, 4))
    path = Path(np.tile([0.3, 5.0], (4, 1)), np.zeros((4, 1)), 0.1)
    w = search.problem.start(path)
    values = [search.problem.bounds.values(w, np.zeros(9999), block.key, block.rows) for block in (speed, zone)]
    assert values[0] == pytest.approx(np.full((12, 1), 0.25))
    # Four places of an arc of 0.3 m and 0.3 rad, 1 mm of half a diameter away from the backbone.
    gaps = 9.0 - (1.0 - np.cos(0.3 * np.arange(1, 5) / 4)) - 1e-3
    assert values[1] * 0.3 == pytest.approx(np.tile(gaps, (12, 1)))


def test_what_is_violated_is_judged_in_units_of_the_problem(searched, monkeypatch):
    """Their scales differ: 1e-6 of a rate of 200/s is nothing, and of a coordinate of 1e-3 m a part of a thousand."""
    problem, attempt = searched.problem, searched.attempts[-1][1]
    block = problem.assembly.blocks[0]
    for share, named in ((0.99, False), (1.01, True)):
        g = attempt.g.copy()
        g[block.rows[2, 0]] += share * searched.feasible
        monkeypatch.setattr(searched, "attempts", [("direct", replace(attempt, g=g))])
        monkeypatch.setattr(searched, "best", None)
        monkeypatch.setattr(searched, "diagnosis", None)
        assert any(text.startswith(f"{block.name}: violated by") for text in _result(searched).violated) is named
