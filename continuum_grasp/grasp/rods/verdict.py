"""Verdict on a search of rods: optimal, feasible and why no better, infeasible by a proof, or not solved and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from continuum_grasp.grasp.bound import cannot_balance
from continuum_grasp.grasp.judge.certificate import Certificate, certify_held
from continuum_grasp.grasp.judge.held import HeldRods
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.solving import AGREE, RodGrasp, StartedSearch
from continuum_grasp.grasp.values import NEAR, GraspStatus
from continuum_grasp.scene import GraspScene

REFUSED = 3
"""Grasps that the certificate may refuse, before none is tried any more."""


class VerdictDoubt(Enum):
    """Reason why a verdict is not a better one."""

    LONE_START = "no other start leads to this grasp"
    CHOICES_DIFFER = "starts of the least tension and starts that differ lead to other grasps"
    REFUSED = "the independent certificate refuses a better grasp"
    CUT = "the budget ended before all starts were tried"
    INTERRUPTED = "you interrupted the search, so it did not try all starts"
    LEAST_TENSION = "this grasp has the least tension; no grasp was found for the objective"
    DRIVEN_AWAY = "any small push drives the object away (no stable grasp was found)"
    YIELDS = "it does not bear the required push in every direction (contacts.push states another)"
    UNBORNE = "nothing bears a part of the load"
    UNTOUCHED = "no finger touches the object in an equilibrium"
    NO_BALANCE = "no forces at any place of the object balance its weight"


@dataclass(frozen=True, eq=False)
class RodVerdict:
    """Verdict on a search.

    Attributes
    ----------
    status : GraspStatus
    doubts : tuple of VerdictDoubt
        Why the status is not a better one; empty where it is ``optimal``.
    best : RodGrasp or None
        The grasp: as stable as the scene requires, where there is one; without one, what came nearest to it.
    held : HeldRods or None
        Its record.
    certificate : Certificate or None
        Of the record.
    """

    status: GraspStatus
    doubts: tuple[VerdictDoubt, ...]
    best: RodGrasp | None = None
    held: HeldRods | None = None
    certificate: Certificate | None = None


def verdict_of(search: StartedSearch, *, interrupted: bool = False) -> RodVerdict:
    """Judge a search that is over, or was ``interrupted``."""
    refused: RodVerdict | None = None
    for best in _candidates(search):
        held = held_rods(best)
        certificate = certify_held(search.scene, held)
        if certificate.passed:
            doubts = tuple(_doubts(search, refused is not None, interrupted))
            status = GraspStatus.FEASIBLE if doubts else GraspStatus.OPTIMAL
            if search.steady is not None and not best.meets(search.steady):
                return RodVerdict(GraspStatus.UNSTABLE, (_unsteady(best),), best, held, certificate)
            return RodVerdict(status, doubts, best, held, certificate)
        refused = refused or RodVerdict(GraspStatus.NOT_SOLVED, (VerdictDoubt.REFUSED,), best, held, certificate)
    return refused or _without(search)


def _unsteady(best: RodGrasp) -> VerdictDoubt:
    """Why the best grasp is not as stable as the scene requires, and no grasp near one that was found is."""
    return VerdictDoubt.YIELDS if best.is_stable else VerdictDoubt.DRIVEN_AWAY


def _candidates(search: StartedSearch) -> Iterator[RodGrasp]:
    """Grasps that hold, the best first, each as exactly as it can be."""
    held = sorted((g for g in search.tried if g.holds), key=lambda g: g.attempt.objective)
    for grasp in held[:REFUSED]:
        finer = grasp if grasp.fine or search.budget.over else search.refined(grasp)
        yield finer if finer.holds else grasp


def _doubts(search: StartedSearch, refused: bool, interrupted: bool) -> Iterator[VerdictDoubt]:
    """Why a better grasp may have been missed."""
    best = search.best
    if search.bound and best is not None and best.greatest_normal_force <= (1.0 + NEAR) * search.bound:
        return
    if refused:
        yield VerdictDoubt.REFUSED
    if interrupted:
        yield VerdictDoubt.INTERRUPTED
    elif search.budget.cut:
        yield VerdictDoubt.CUT
    if not search.aimed:
        yield VerdictDoubt.LEAST_TENSION
    if not search.confirmed:
        yield VerdictDoubt.LONE_START
    if len(search.scene.setups) > 2 and not search.agree(AGREE):
        yield VerdictDoubt.CHOICES_DIFFER


def _without(search: StartedSearch) -> RodVerdict:
    """Verdict on a search that found no grasp."""
    nearest = min(search.tried, key=lambda grasp: grasp.unborne, default=None)
    if search.budget.stopped:
        return RodVerdict(GraspStatus.STOPPED, (VerdictDoubt.CUT,), nearest)
    if isinstance(search.scene, GraspScene) and cannot_balance(search.scene):
        return RodVerdict(GraspStatus.INFEASIBLE, (VerdictDoubt.NO_BALANCE,), nearest)
    cut = (VerdictDoubt.CUT,) if search.budget.cut else ()
    if nearest is None:
        return RodVerdict(GraspStatus.NOT_SOLVED, (VerdictDoubt.UNTOUCHED, *cut))
    return RodVerdict(GraspStatus.NOT_SOLVED, (VerdictDoubt.UNBORNE, *cut), nearest)
