"""Limits of what follows a search; from inside: results on either side of each are put into its steps.

Limits of what follows a search: reasons, stable grasps, stations and robust ones; each decides
otherwise on either side of it, or counts so many tries.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.grasp_oracle import scenes
from continuum_grasp import nlp
from continuum_grasp.grasp import GraspResult, Reason, certify, changes, stations
from continuum_grasp.grasp.certificate.model_error import ModelError
from continuum_grasp.grasp.certificate.out_of_plane import stability_out_of_plane
from continuum_grasp.grasp.finger_map import SceneMaps
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.reasons import diagnosis
from continuum_grasp.grasp.reasons.diagnosis import Repairs, is_clear, is_rare, ordered
from continuum_grasp.grasp.reasons.elastic import Repair, settled
from continuum_grasp.grasp.reasons.starts import Starts
from continuum_grasp.grasp.robust import joint
from continuum_grasp.grasp.robust import response as responses
from continuum_grasp.grasp.robust import search as exchange
from continuum_grasp.grasp.robust import solve as robust
from continuum_grasp.grasp.robust.errors import InError
from continuum_grasp.grasp.robust.joint import JointSolverRun
from continuum_grasp.grasp.robust.response import Responder, Response, _reserve
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.supports import base_poses, object_poses
from continuum_grasp.grasp.starts.values import ContactStart
from continuum_grasp.grasp.stations import _slope
from continuum_grasp.grasp.verdict import SearchVerdict
from continuum_grasp.nlp import Budget, SolverStatus
from continuum_grasp.scene import Robust, load
from tests import certificate_cases as cases
from tests.grasp.test_grasp_problem_limits import first_start
from tests.grasp_scenes import CONFIGS, make_scene

TENSION, FRICTION = (limit for limit in RELAXATIONS if limit.name in ("tension", "friction"))
SCENE = cases.squeezed_disc()[0]


class Some(SimpleNamespace):
    """Something of its own, whatever others hold."""

    __eq__ = object.__eq__
    __hash__ = object.__hash__


def reason(name="tension", limit=1.0, needed=1.0):
    return Reason(name, "", "", limit, needed, "", "")


def searching(scene=SCENE, **more):
    known = {"scene": scene, "budget": Budget(), "settled": [], "tried": [], "good": [], "best": None}
    return Some(**{**known, "impossible": False, "maps": SceneMaps(scene), **more})


# -- reasons ---------------------------------------------------------------------------------------------------


def repaired(amount, most=1.0, other=None):
    """Whether limits relaxed by an amount each, alone or with another one, are a repair."""
    limit = Some(name="tension", sensible=lambda scene: most, excuses=None, start=lambda scene: 1.0)
    second = Some(name="mass", sensible=lambda scene: most, excuses=None, start=lambda scene: 1.0)
    found = Some(x=np.zeros(1), violations=[], status=SolverStatus.SOLVED)
    given = {limit: amount, second: other}
    solver = Some(run=lambda *_, **__: found, given=lambda scene, x, one: given[one], arrays=lambda *_: {})
    repairs = Repairs(SCENE, searching(solver=lambda start: solver, keep_clear=lambda _: False))
    repairs.certificate = lambda repair: Some(failed=())
    repairs.attempt((limit,) if other is None else (limit, second), Some())
    return bool(repairs.found)


def relaxed_again(curls):
    """How often a limit is relaxed from a start where the grasp that this gives curls up, once or never."""
    begun, start = [], Some()
    search = searching(keep_clear=lambda certificate: curls and len(begun) == 1)
    repairs = Repairs(SCENE, search)
    repairs.relax = lambda limits, begin: (
        begun.append(begin) or Repair(dict.fromkeys(limits, 1.0), {}, Some(start=start))
    )
    repairs.certificate = lambda repair: Some(failed=())
    repairs.attempt((TENSION,), start)
    return len(begun), all(begin is start for begin in begun), (TENSION,) in repairs.found


def tied(size):
    """Whether a second limit that is off by less, by the logarithm of a factor, comes after the first."""
    reasons = [reason("mass", 1.0, 2.0), reason("tension", 1.0, 2.0 * math.exp(size))]
    return [one.name for one in ordered(reasons)] == ["tension", "mass"]


# -- solver, stable and robust grasps ----------------------------------------------------------------------------


def stable(*found, value=-0.09):
    """Levels asked for, and iterations, where attempts give (eigenvalue, objective, acceptable) in turn."""
    asked, solver = [], Some(problem=Some(spec=None))

    def grasp(eigenvalue, objective=1.0, acceptable=False):
        attempt = Some(x=np.zeros(1), start=None, features={}, objective=objective, converged=True)
        certificate = Some(stability=Some(eigenvalue=eigenvalue, in_plane=False, in_space=None, why=""))
        return Some(attempt=attempt, certificate=certificate, acceptable=acceptable, solver=solver)

    def attempt(*_, numbers, **options):
        asked.append((numbers["stability level"], options["iterations"]))
        return grasp(*found[min(len(asked), len(found)) - 1])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stations, "_slope", lambda *_: np.ones(1))
        problem = Some(steadying=lambda slope, level: {"stability level": level})
        patch.setattr(stations, "solver_for", lambda spec: Some(problem=problem))
        patch.setattr(stations, "replace", lambda some, **_: some)
        stations._stabilize(searching(attempt=attempt), grasp(value))
    return asked


def unstable(*objectives):
    """How many of the unstable grasps with these objectives stable ones are sought from."""
    found = [Some(acceptable=False, attempt=Some(objective=objective)) for objective in objectives]
    seen = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stations, "_stabilize", lambda search, at: seen.append(at))
        stations.stabilize(searching(good=found))
    return len(seen)


def same_branch(part):
    """Whether a grasp whose tension differs by a part is none of its own."""

    def grasp(tension):
        arrays = {"contact_names": np.array(["finger.tip"]), "finger.tensions": np.array([tension, 0.0])}
        return Some(arrays=arrays, acceptable=True)

    best, other = grasp(1.0), grasp(1.0 - part)
    return not list(robust._others(searching(good=[other]), best.arrays))


def acts(force):
    """Whether an error counts whose force on what postures share is this part of that of another."""
    whole = Some(_solvers=[], _links=[1, 1], errors=np.arange(2.0))
    links = Some(multipliers=Some(constraints=np.array([1.0, -force])))
    return len(JointSolverRun.acting(whole, links)) == 2


def near_object(gap):
    """Whether a contact that is clear by so much of the length may be what is missing."""
    scene, arrays = cases.squeezed_disc()
    setup, pose = scene.setups[0], np.zeros(3)
    along = np.linspace(0.0, setup.finger.rod.length, 3)
    away = float(setup.finger.profile.half_thickness(along[-1])) + gap * along[-1]
    line = np.stack([along, np.full(3, away), 0.0 * along, 0.0 * along], axis=1)
    response = Some(scene=scene, arrays={**arrays, "object.pose": pose, "finger.backbone": line}, error=np.zeros(6))
    at = ContactStart(0, (0.0, 0.0), 0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(responses, "nearest_contact", lambda *_: at)
        return bool(list(Responder._near_object(None, response, ["finger.tip"])))


def goes_on(worse):
    """Whether friction states count that lower the reserve by so much."""
    responder = Some(scene=Some(state_columns=True), to=lambda error: Some(error=error, reserve=-worse))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exchange, "worst_vertex", lambda last: last.error)
        patch.setattr(exchange, "state_cells", lambda _: np.eye(2, dtype=bool))
        return len(list(exchange.descended(responder, [Some(error=np.ones(8), reserve=0.0)]))) > 2


def effort_in_error():
    """Weight of what makes postures in error unique."""
    scene = make_scene("arc")
    start, seen = first_start(scene), []
    run = JointSolverRun(scene, start, np.zeros((1, 6)))

    def cut(solve, problem, start, *_):
        seen.append(run._ps(start.p)[1][run._solvers[1].problem.numbers.at["effort weight"]])
        return nlp.Attempt(SolverStatus.FAILED, "", start.x, start.lower, 0.0, None, 0, 0.0, 0.0, 0.0), start.p

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint, "solve_clear", cut)
        run.run(scene, start, Budget())
    return seen[0].tolist()


# -- words -------------------------------------------------------------------------------------------------------


def says_nothing(excess):
    """A grasp so far above a bound, where starts were left out, has no warning."""
    return not notes(excess=excess, left_out=1)


def notes(off=0.0, **more):
    """Why a grasp may not be the best, whose exact rods are so far off."""
    explored = Some(open=0, modes=1, sampled=0, exact_less=np.nan, untried=0)
    search = Some(**{"best": None, "fallback": None, "proven": True, "excess": 0.0, "exploration": explored, **more})
    scene = Some(setups=[Some(elements=2)])
    verdict = SearchVerdict(scene, search, Some(cut=None), began=0.0, by_stations=False, interrupted=False)
    error = ModelError({"finger.tip": off * 0.2}, 0.2, 0.0)
    certificate = Some(model_error=error)
    return list(verdict._notes(Some(certificate=certificate, attempt=Some(optimal=True))))


def slack(pull):
    """Whether a finger that pulls by so much more than it must, per force on the object, is slack."""
    finger, tendons = Some(tensions=np.array([1.0 + pull, 1.0])), Some(name="finger", tendons=Some(min_tension=1.0))
    held = Some(greatest_normal_force=1.0, scene=Some(setups=[tendons]), fingers={"finger": finger})
    return GraspResult._slack.fget(held)


def reached(beyond):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnosis, "_reach", lambda *_: 1.0)
        patch.setattr(diagnosis, "_distance", lambda *_: 1.0 + beyond)
        return diagnosis.out_of_reach(SCENE) is None


def holds(reserve):
    return Response(*[None] * 4, reserve, *[None] * 3).holds


LIMITS = [
    ("friction that is rare", 1.0, lambda x: not is_rare(reason("friction", 0.1, x))),
    ("what is missing of a limit", 1.03, lambda x: not is_clear(reason(needed=x), SCENE)),
    ("amounts that are one", 1.0 / (1.0 - 1e-4), lambda x: settled([1.0, 1.0, x])),
    ("most that makes sense of an amount", 20.0 * (1.0 - 1e-3), lambda x: repaired(x, FRICTION.sensible(SCENE))),
    ("part of several limits that is none", 1e-3, lambda x: not repaired(0.5, other=x)),
    ("factors that are equal", 1e-3, tied),
    ("part of a limit beside which another is enough alone", 1e-3, lambda x: alone_after(x) == ["tension"]),
    ("objectives of unstable grasps that are one", 1.001, lambda x: unstable(1.0, x) == 1),
    ("change of a stable grasp that is settled", 1e-4 / (1.0 - 1e-4),
     lambda x: len(stable((0.02, 1.0, True), (0.02, 1.0 + x, True), (0.02, 1.0 + x, True))) == 2),
    ("tensions of a branch", 1e-3, same_branch),
    ("reserve that friction states must lower", 1e-6, lambda x: not goes_on(x)),
    ("gap of a contact that is missing", 1e-3, near_object),
    ("reserve that is lost by rounding", 1e-4, lambda x: holds(-x)),
    ("force of an error that acts", 1e-4, lambda x: not acts(x)),
    ("part above what no grasp is below", 0.02, says_nothing),
    ("displacement of exact rods per length of a grasp that is optimal", 0.01, lambda off: not notes(off)),
    ("pull of tendons that are slack", 1e-3, slack),
    ("distance beyond reach", 1e-9, reached),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_a_step_decides_otherwise_on_either_side_of_a_limit(limit, decides):
    assert decides((1.0 - 1e-6) * limit)
    assert not decides((1.0 + 1e-6) * limit)


# -- counts ------------------------------------------------------------------------------------------------------


def starts_per_limit(agreeing):
    """Starts from which a limit is relaxed that gives less each time, as much, or no grasp."""
    starts, asked = [Some(k=k) for k in range(20)], []
    repairs = Repairs(SCENE, searching())

    def attempt(limits, start):
        asked.append(start.k)
        repairs.totals[limits].append({None: math.inf, True: 1.0, False: 1.0 / len(asked)}[agreeing])
        if agreeing is not None:
            repairs.found[limits] = Repair({TENSION: 1.0}, {}, None)

    repairs.starts = Some(of=lambda limits: starts[:10], closer=lambda limits, enough: [], near=starts[10:])
    repairs.attempt = attempt
    repairs._relaxed([(TENSION,)])
    return sorted(set(asked))


def amounts_of_starts(*holding):
    """Usual amounts by which a limit is relaxed in search of starts, where those hold, and how many that gives."""
    eased, known = [], Starts(SCENE, searching())
    known._widest = [Some(imbalance=0.0)]

    def settled(scene):
        eased.append((scene.setups[0].max_tension - SCENE.setups[0].max_tension) / TENSION.start(SCENE))
        return [Some(imbalance=0.0 if round(eased[-1], 9) in holding else 1.0) for _ in range(20)]

    known._settled = settled
    starts = known.of((TENSION,))
    return np.round(eased, 9).tolist(), len(starts)


def limits_needed(*needed):
    """Limits without which nothing holds, where it holds with those that are ``needed``."""
    known = Starts(SCENE, searching())
    most = SCENE.setups[0].max_tension, SCENE.contacts.friction

    def settled(scene):
        eased = scene.setups[0].max_tension > most[0], scene.contacts.friction > most[1]
        return [Some(imbalance=float(any(need and not is_ for need, is_ in zip(needed, eased, strict=True))))]

    known._settled = settled
    return {limit.name for limit in known.needed}


def pairs_tried(*needed):
    """Whether limits are relaxed two at a time, of which nothing is a substitute for the ``needed`` ones."""
    asked, repairs = [], Repairs(SCENE, searching())
    repairs.starts = Some(of=lambda limits: asked.append(limits) or [], near=[], needed=frozenset(needed))
    repairs.look()
    return {frozenset(limit.name for limit in limits) for limits in asked if len(limits) > 1}


def equal_starts():
    """Starts from which a limit is relaxed, twice from two, of some that are equal."""
    asked, repairs = [], Repairs(SCENE, searching())
    repairs.attempt = lambda limits, start: asked.append(start)
    repairs.totals[TENSION,] = []
    for _ in range(2):
        repairs._from((TENSION,), [0, 0, 1, 2, 3], 2)
    return asked


def alone_after(part):
    """Limits relaxed alone from where two are, one of them by a part."""
    asked, repairs = [], Repairs(SCENE, searching())
    repairs.attempt = lambda limits, begin: asked.append(limits)
    repairs._alone(Repair({TENSION: 1.0, FRICTION: part}, {}, None))
    return [limit.name for (limit,) in asked]


def ends_of_a_start(*found):
    """What ends a run with a limit relaxed: iterations, and how many in vain, where some reasons are known."""
    asked = []
    run = lambda *_, iterations, patience, **__: (  # noqa: E731
        asked.append((iterations, patience)) or Some(x=np.full(1, np.nan), violations=[])
    )
    repairs = Repairs(SCENE, searching(solver=lambda start: Some(run=run)))
    repairs.found = dict.fromkeys(found)
    for begin in (Some(), Repair({TENSION: 1.0}, {}, Some(start=None, x=None))):
        repairs.relax((TENSION,), begin)
    return asked


def further(least):
    """Usual amounts by which a repair is relaxed further, where a grasp holds for all friction states from one on."""
    steps, repairs = [], Repairs(SCENE.replaced(robust=Robust(mass=0.1)), searching())
    repairs._further = lambda repair, step: steps.append(step) or (step if step >= least else None)
    return repairs.as_demanded(Repair({TENSION: 1.0}, {}, None)), steps


def share_that_holds(most):
    """The share of the friction of the fingers that is reported where grasps hold up to one."""
    scene = SCENE.changed({"finger.tendons.friction": 0.1, "fidelity.family": "arc"})
    response = Some(holds=False, reserve=-1.0, error=np.zeros(6), weakest="", attempt=Some(violations=[]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(robust, "_holds", lambda result, bounds, share, budget: share <= most)
        patch.setattr(robust, "replace", lambda some, **changes: Some(**changes))
        nominal, found = Some(nominal=Some(tension=1.0)), Some(responses=[response])
        result = robust._none(Some(scene=scene), nominal, found, None, Budget())
    return result.reasons[0].needed / 0.1


def begun(count):
    """Grasps with one middle contact from which stations are sought."""
    before, begins = GraspSearch(SCENE, Budget()), []
    before.good = [Some(attempt=Some(objective=k), arrays=k) for k in range(count)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stations, "_on_nearest", lambda scene, before, arrays: arrays)
        patch.setattr(stations, "_better", lambda search, start, options_at: begins.append(start) or True)
        stations.search_stations(searching(), before)
    return begins


def contacts_tried(errors):
    """Sets of contacts that are tried for so many errors one after the other, none of which holds with any."""
    tried = []

    def with_(begin, error):
        tried.append(error)
        return Some(holds=False, reserve=-1.0, begin=begin)

    responder = Some(_fruitless=0, start=Some(contacts=()), _nearest=lambda _: None, _with=with_)
    responder._next = lambda _: [Some(contacts=(k,)) for k in range(9)]
    for error in range(errors):
        Responder.to(responder, error)
    return [tried.count(error) for error in range(errors)]


def taken_in():
    """Errors that are part of the problem, where none of forty ever holds."""
    sizes = []

    def response(error):
        return Some(error=error, reserve=-1.0, holds=False, begin=Some(contacts={}))

    def solved(responder, responses, budget):
        sizes.append(len(responses))
        return Some(iterations=1, status=None), {}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exchange, "tried_errors", lambda *_: np.arange(40.0)[:, None])
        patch.setattr(exchange, "Responder", lambda *_: Some(to=response))
        patch.setattr(exchange, "descended", lambda *_: [])
        patch.setattr(exchange, "_solved", solved)
        patch.setattr(exchange, "certify_reached", lambda *_: None)
        exchange.find_robust(SCENE, None, {}, Budget())
    return sizes


def robustly(holds=False, **bounds):
    """Grasps that robust ones are sought next to, and draws with which each is tried, where none or all hold."""
    scene, sought, draws = SCENE.replaced(robust=Robust(**bounds) if bounds else None), [], []
    seen = Some(robust=scene.robust, objective="", solver=scene.solver, state_columns={})
    arrays = {"contact_names": np.zeros(0)}
    found = Some(holds=holds, optimal=True, responses=[], first=[], errors=[], touching=[], iterations=0, arrays=arrays)
    found.certificate = Some(passed=True, acceptable=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(robust, "find_robust", lambda *_: sought.append(1) or found)
        patch.setattr(robust, "_others", lambda *_: [{}] * 20)
        patch.setattr(robust, "_trials", lambda *given: draws.append(len(given[3])) or Some(tension=1.0, holds=True))
        for name in ("_none", "replace", "Robustness"):
            patch.setattr(robust, name, lambda *_, **__: Some(holds=True))
        patch.setattr(robust, "_whatever", lambda _: "")
        robust.with_robust(Some(scene=seen, arrays=None, status=None, message="", statistics={}), None, Budget())
    return len(sought), draws


def within_tolerance():
    """Elements of a fine model of one element per segment, and of those that are tried where none is as good."""
    elements = []

    def solve(scene, *_):
        elements.append(scene.setups[0].elements)
        return Some(arrays={})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(changes, "_solve_again", solve)
        patch.setattr(changes, "_change", lambda *_: Some(size=1.0))
        changes.resolve_elements(SCENE, Some(scene=SCENE), 0.1, Budget())
    return np.divide(elements, len(SCENE.setups[0].middles) + 1).tolist()


def yields_by():
    """How far an object may move, per its size, and turn."""
    scene, arrays = cases.squeezed_disc()
    in_error = InError(scene, arrays)
    in_error.on = frozenset()  # of fingers alone
    free = in_error.scene_with(np.zeros(6)).object.free
    return [np.ptp(free.x) / scene.object.size, np.ptp(free.y) / scene.object.size, np.ptp(free.angle)]


def tried_poses():
    """Poses of an object that may move, and of a base at the first of them and at the others."""
    free, base = {"x": (-0.01, 0.01), "y": (0.2, 0.3)}, {"x": (-0.01, 0.01), "y": (-0.01, 0.01)}
    scene = SCENE.changed({"supports": {}, "object.free": free, "finger.base_free": base})
    of_bases = [len(set(base_poses(scene.setups[0], k))) for k in (0, 1, 2)]
    return len(set(object_poses(scene, frozenset()))), *of_bases


COUNTS = [
    ("sets of contacts of an error", [4, 4, 4, 4, 1, 1], lambda: contacts_tried(6)),
    ("errors that enter the problem", [4, 8, 12, 16, 20, 24], taken_in),
    ("branches of a robust grasp, and draws without errors", (3, [100]), robustly),
    ("draws of a nominal grasp, and of a robust one", (1, [200, 1000]), lambda: robustly(True, friction=0.1)),
    ("elements per segment", [6, 1, 2, 3, 4, 5], within_tolerance),
    ("parts by which an object yields", [0.2, 0.2, 0.2], lambda: pytest.approx(yields_by())),
    ("poses", (7, 5, 3, 3), tried_poses),
    ("weight of postures in error", [1e-6], effort_in_error),
    ("starts of a limit that gives no grasp", [0, 1, 2, 3], lambda: starts_per_limit(None)),
    ("starts of a limit that gives as much", [0, 1, 2], lambda: starts_per_limit(True)),
    ("starts of a limit that gives less", [*range(10)], lambda: starts_per_limit(False)),
    ("repairs that curl up", (2, True, True), lambda: relaxed_again(True)),
    ("repairs that do not", (1, True, True), lambda: relaxed_again(False)),
    ("amounts of starts", ([3.0, 1.0], 40), lambda: amounts_of_starts(3.0)),
    ("amounts of starts where none holds", ([3.0], 0), amounts_of_starts),
    ("limits needed", set(), lambda: limits_needed(False, False)),
    ("limits needed of two", {"friction"}, lambda: limits_needed(False, True)),
    ("both limits needed", {"tension", "friction"}, lambda: limits_needed(True, True)),
    ("pairs where two are needed", {frozenset({"tension", "friction"})}, lambda: pairs_tried(TENSION, FRICTION)),
    ("pairs where three are needed", set(), lambda: pairs_tried(*RELAXATIONS[:3])),
    ("equal starts", [0, 1, 2, 3], equal_starts),
    ("iterations of each", [(80, None), (80, None)], ends_of_a_start),
    ("iterations in vain of each but the first", [(80, 7), (80, None)], lambda: ends_of_a_start((TENSION,))),
    ("steps of repairs for all states", (None, [0.01, 0.04, 0.16, 0.64]), lambda: further(1.0)),
    ("halvings of such a step", [0.01, 0.04, 0.16, 0.1, 0.13], lambda: pytest.approx(further(0.12)[1])),
    ("amounts that agree", (False, True), lambda: (settled([1.0, 1.0]), settled([1.0, 1.0, 1.0]))),
    ("amounts no less", (False, True), lambda: (settled([3.0, 1.0, 2.0, 2.0]), settled([1.0, 2.0, 3.0, math.inf]))),
    ("halvings of a share", 0.25, lambda: pytest.approx(share_that_holds(0.3))),
    ("begins of stations", [0, 1, 2], lambda: begun(9)),
    ("rounds towards stability", [(pytest.approx(0.1), 40), 12],
     lambda: [stable((-0.09,))[0], len(stable((-0.09,)))]),
    ("steps to a solver that does not follow", [0.1, 0.04], lambda: pytest.approx([a for a, _ in stable((-1.0,))])),
    ("a step after one that was followed", [0.1, 0.04, 0.048],
     lambda: pytest.approx([level for level, _ in stable((-1.0,), (-0.05,))][:3])),
    ("unstable grasps", 2, lambda: unstable(1.0, 2.0, 3.0)),
]  # fmt: skip


@pytest.mark.parametrize(("count", "counted"), [row[1:] for row in COUNTS], ids=[row[0] for row in COUNTS])
def test_a_step_tries_so_many(count, counted):
    assert counted() == count


@pytest.mark.parametrize(
    ("converged", "reserve", "violations", "deepest", "stands"),
    [
        (True, -0.1, [], 0.0, True),
        (False, 0.1, [], 1e-6, True),
        (False, 0.1, [], 1e-5, False),
        (False, 0.1, ["object force balance"], 0.0, False),
        (False, -0.1, [], 0.0, False),
        (False, np.nan, [], 0.0, False),
    ],
)
def test_where_a_solver_was_stopped_is_a_posture_if_it_violates_nothing(
    converged, reserve, violations, deepest, stands
):
    """An optimum is one in any case; another point only says that cones are not left, not by how much they are."""
    attempt = SimpleNamespace(converged=converged, x=np.array([reserve]), violations=violations, numbers=None)
    near = SimpleNamespace(look=lambda *_: (deepest, {}))
    solver = SimpleNamespace(problem=SimpleNamespace(x=SimpleNamespace(at={"reserve": slice(0, 1)})), near=near)
    found = _reserve(solver, load(CONFIGS / "mug_arcs.yaml"), attempt)
    assert found == (reserve if stands else -np.inf)


def test_what_a_model_leaves_out_is_small_up_to_half_a_percent_of_the_shortest_finger():
    for part in (0.999, 1.001):
        assert ModelError({"a": 1e-9, "b": part * 0.005 * cases.LENGTH}, cases.LENGTH, 0.0).small is (part < 1.0)


def test_the_slope_of_the_least_eigenvalue_leads_to_stability():
    """A step along it changes the eigenvalue by as much as the slope says, which a difference ten times as long, or as
    short, does not know so well.
    """
    scene = scenes.scene_of("one", 125).changed({"stability": "require"})
    search = GraspSearch(scene, Budget())
    search.run()
    at = next(t for t in search.good if not t.acceptable)
    slope = _slope(scene, at)
    step = 3e-6 * slope / np.linalg.norm(slope)

    def eigenvalue(x):
        moved = type(at.attempt)(**{**vars(at.attempt), "x": x})
        return certify(scene, at.solver.arrays(scene, moved)).stability.eigenvalue

    change = eigenvalue(at.attempt.x + step) - eigenvalue(at.attempt.x - step)
    assert change == pytest.approx(2.0 * slope @ step, rel=1e-5)


def test_the_slope_of_the_least_eigenvalue_in_space_is_that_of_its_changes():
    changes = {f"fingers.{name}.section": {"shape": "round"} for name in ("left", "right")}
    scene = load(CONFIGS / "pinch.yaml").changed(changes)
    search = GraspSearch(scene, Budget())
    search.run()
    at = next(t for t in search.good if not t.acceptable)
    slope = _slope(scene, at, True)
    step = 3e-6 * slope / np.linalg.norm(slope)

    def eigenvalue(x):
        moved = type(at.attempt)(**{**vars(at.attempt), "x": x})
        grasp = certify(scene, at.solver.arrays(scene, moved)).grasp
        return stability_out_of_plane(grasp, stations.LINKS).eigenvalue

    change = eigenvalue(at.attempt.x + step) - eigenvalue(at.attempt.x - step)
    assert change == pytest.approx(2.0 * slope @ step, rel=1e-4)
