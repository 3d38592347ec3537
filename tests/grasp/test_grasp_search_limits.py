"""Limits by which a search accepts grasps and reports reasons: each decides otherwise on either side of it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.reasons import words
from continuum_grasp.grasp.reasons.diagnosis import Repairs
from continuum_grasp.grasp.reasons.elastic import settled
from continuum_grasp.grasp.reasons.words import is_clear, is_rare, ordered
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.robust.response import Response
from continuum_grasp.grasp.search import Search
from continuum_grasp.grasp.solve import _Verdict
from continuum_grasp.grasp.tried import Tried, branch_of, least_of
from continuum_grasp.grasp.values import Reason
from continuum_grasp.nlp import Budget, Status
from tests import certificate_cases as cases

SCENE = cases.squeezed_disc()[0]
FRICTION = next(limit for limit in RELAXATIONS if limit.name == "friction")


class Some(SimpleNamespace):
    """Something of its own, whatever others hold."""

    __eq__ = object.__eq__
    __hash__ = object.__hash__


def start(angle=0.0):
    contact = Some(normal_angle=angle, part=0)
    return Some(contacts={"finger.tip": contact}, fingers={"finger": Some(sides=(1,))})


def grasp(objective=1.0, optimal=True):
    return Some(attempt=Some(objective=objective, optimal=optimal, converged=True), acceptable=True)


def verified(badness):
    """Whether an attempt whose violation is so much gets a certificate, which passes here."""
    tried = Tried(Some(badness=badness), None, None)
    tried.__dict__["certificate"] = Some(passed=True)
    return tried.verified


def proven(press):
    """Whether a grasp that presses with so much is the best, where no grasp presses with less than 1 N."""
    search = Search(SCENE.replaced(objective="least_normal_force"), Budget())
    arrays = {"contact_forces": np.array([[press, 0.0, 0.0]]), "finger.tensions": np.zeros(2)}
    search.good = [Some(attempt=Some(objective=1.0, optimal=True), arrays=arrays, acceptable=True)]
    search.__dict__["bound"] = 1.0
    return search.proven


def reason(name="tension", limit=1.0, needed=1.0):
    return Reason(name, "", "", limit, needed, "", "")


def repaired(amount, most=1.0, other=None):
    """Whether limits relaxed by an amount each, alone or with another one, are a repair."""
    limit = Some(name="tension", sensible=lambda scene: most, excuses=None, start=lambda scene: 1.0)
    second = Some(name="mass", sensible=lambda scene: most, excuses=None, start=lambda scene: 1.0)
    found, given = Some(x=np.zeros(1), violations=[], status=Status.SOLVED), {limit: amount, second: other}
    solver = Some(run=lambda *_, **__: found, given=lambda scene, x, one: given[one], arrays=lambda *_: {})
    search = Some(scene=SCENE, budget=Budget(), basins=[], unscanned=[], solver=lambda start: solver)
    repairs = Repairs(SCENE, search)
    repairs.holds = lambda *_: True
    repairs.attempt((limit,) if other is None else (limit, second), Some())
    return bool(repairs.found)


def tied(size):
    """Whether a second limit that is off by less, by the logarithm of a factor, comes after the first."""
    reasons = [reason("mass", 1.0, 2.0), reason("tension", 1.0, 2.0 * math.exp(size))]
    return [one.name for one in ordered(reasons)] == ["tension", "mass"]


def says_nothing(excess):
    """A grasp so far above a bound, where starts were left out, has no warning."""
    explored = Some(open=0, modes=1, sampled=0)
    search = Some(best=None, fallback=None, proven=True, excess=excess, left_out=1, exploration=explored)
    verdict = Some(search=search, _before=None, budget=Some(cut=None), interrupted=False)
    return not list(_Verdict._notes(verdict, Some(acceptable=True, attempt=Some(optimal=True))))


def slack(pull):
    """Whether a finger that pulls by so much more than it must, per force on the object, is slack."""
    finger, tendons = Some(tensions=np.array([1.0 + pull, 1.0])), Some(name="finger", tendons=Some(min_tension=1.0))
    held = Some(greatest_normal_force=1.0, scene=Some(setups=[tendons]), fingers={"finger": finger})
    return GraspResult._slack.fget(held)


def reached(beyond):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(words, "_reach", lambda *_: 1.0)
        patch.setattr(words, "_distance", lambda *_: 1.0 + beyond)
        return words.out_of_reach(SCENE) is None


LIMITS = [
    ("press above what is proven", 1.0 + 1e-3, proven),
    ("objective for which a grasp that converged is taken", 2.0 * (1.0 + 1e-3),
     lambda cost: least_of([grasp(2.0, optimal=False), grasp(cost)]).attempt.optimal),
    ("violation of a start that is verified", 1e-2, verified),
    ("turn of contacts of one branch", math.pi / 8, lambda a: branch_of(start(a)) == branch_of(start())),
    ("friction that is rare", 1.0, lambda x: not is_rare(reason("friction", 0.1, x))),
    ("what is missing of a limit", 1.03, lambda x: not is_clear(reason(needed=x), SCENE)),
    ("amounts that are one", 1.0 / (1.0 - 1e-4), lambda x: settled([1.0, 1.0, x])),
    ("most that makes sense of an amount", 20.0 * (1.0 - 1e-3), lambda x: repaired(x, FRICTION.sensible(SCENE))),
    ("part of several limits that is none", 1e-3, lambda x: not repaired(0.5, other=x)),
    ("factors that are equal", 1e-3, tied),
    ("reserve that is lost by rounding", 1e-4, lambda x: Response(*[None] * 4, -x, *[None] * 3).holds),
    ("part above what no grasp is below", 0.02, says_nothing),
    ("pull of tendons that are slack", 1e-3, slack),
    ("distance beyond reach", 1e-9, reached),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_a_search_decides_otherwise_on_either_side_of_a_limit(limit, decides):
    # Some limits are one and a part of a thousand.
    assert decides((1.0 - 1e-6) * limit)
    assert not decides((1.0 + 1e-6) * limit)


def test_directions_are_known_but_for_whole_turns():
    assert branch_of(start(angle=np.pi)) == branch_of(start(angle=-np.pi))


@pytest.mark.parametrize(("pegs", "count"), [(5, 32), (6, 64), (7, 64)])
def test_so_many_sets_of_contacts_are_tried_the_greatest_first(pegs, count):
    free = {"x": (-0.5, 0.5), "y": (-0.5, 0.5)}
    around = {
        f"peg_{k}": {"type": "point", "position": (1.0 + k, 0.0), "radius": 0.01, "touch": "auto"} for k in range(pegs)
    }
    sizes = [len(mode) for mode in contact_modes(SCENE.changed({"supports": around, "object.free": free}))]
    assert len(sizes) == count
    assert sizes[0] == pegs + 1
    assert sizes == sorted(sizes, reverse=True)
