"""Verdict on a search of rods: optimal, feasible and the reason why no better, or infeasible by a proof."""

from __future__ import annotations

from dataclasses import dataclass, replace

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.bound import cannot_balance
from continuum_grasp.grasp.judge.certificate import RodCertificate, certify_rods
from continuum_grasp.grasp.rods.answers import AskedAnswers, steady_of, tangent_of
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.solving import RodGrasp
from continuum_grasp.grasp.values import DRIVEN_AWAY, GraspStatus

SAME_AIM = 1e-4
"""Share of an aim up to which two starts lead to the same grasp."""
AGREE = 0.01
"""Share of an aim by which the two choices of starts of three fingers may differ."""


@dataclass(frozen=True, eq=False)
class RodVerdict:
    """Verdict on a search.

    Attributes
    ----------
    status : GraspStatus
    missing : str
        Why the status is not a better one, in one line; empty where it is ``optimal``.
    certificate : RodCertificate or None
        Of the best grasp.
    grasp : RodGrasp or None
        The best grasp: as stable as the scene requires, where there is one.
    """

    status: GraspStatus
    missing: str
    certificate: RodCertificate | None = None
    grasp: RodGrasp | None = None


def verdict_of(search: RodSearch) -> RodVerdict:
    """Judge a search that has run; where a scene requires stability, go on to a stable grasp."""
    best = search.best
    if best is None:
        return _without(search)
    held = [grasp for grasp in search.tried if grasp.holds]
    steady = steady_of(search.scene)
    if steady is not None and not steady.met(best.problem, best.attempt.x):
        held = [g for g in search.answered(steady, fine=True) if g.holds and steady.met(g.problem, g.attempt.x)]
        if not held:
            return replace(_judged(search, best, [best]), status=GraspStatus.UNSTABLE, missing=_leaves(best, steady))
        best = min(held, key=lambda grasp: grasp.attempt.objective)
    return _judged(search, best, held)


def _leaves(best: RodGrasp, steady: AskedAnswers) -> str:
    """Say why the best grasp is not stable, and no grasp near one that was found is."""
    tangent = tangent_of(best.problem, best.attempt.x)
    if tangent is None or not tangent.stable:
        return DRIVEN_AWAY
    pushes = [amount_text(push, "N", ".3g") for push in (tangent.push, steady.push)]
    return f"it bears a push of {pushes[0]} in every direction, not of {pushes[1]} (contacts.push states another)"


def _judged(search: RodSearch, best: RodGrasp, held: list[RodGrasp]) -> RodVerdict:
    """Verdict on the best one of the grasps that hold."""
    return replace(_certified(search, best, held), grasp=best)


def _certified(search: RodSearch, best: RodGrasp, held: list[RodGrasp]) -> RodVerdict:
    certificate = certify_rods(search.scene, held_rods(best))
    if not certificate.passed:
        return RodVerdict(GraspStatus.NOT_SOLVED, f"the certificate finds {certificate.worst}", certificate)
    if sum(_near(grasp, best, SAME_AIM) for grasp in held) < 2:
        return RodVerdict(GraspStatus.FEASIBLE, "no other start leads to this grasp", certificate)
    if len(search.scene.setups) > 2 and not search.agree(AGREE):
        missing = "starts of the least tension and starts that differ lead to other grasps"
        return RodVerdict(GraspStatus.FEASIBLE, missing, certificate)
    return RodVerdict(GraspStatus.OPTIMAL, "", certificate)


def _near(grasp: RodGrasp, best: RodGrasp, share: float) -> bool:
    """Whether the aim of a grasp is that of the best one, but for a share."""
    return grasp.attempt.objective <= best.attempt.objective + share * abs(best.attempt.objective)


def _without(search: RodSearch) -> RodVerdict:
    """Verdict on a search that found no grasp."""
    if cannot_balance(search.scene):
        return RodVerdict(GraspStatus.INFEASIBLE, "no forces at any place of the object balance its weight")
    left = min(
        (grasp.problem.unborne(grasp.attempt.x) * grasp.problem.numbers.force for grasp in search.tried), default=None
    )
    if left is None:
        return RodVerdict(GraspStatus.NOT_SOLVED, "no finger touches the object in an equilibrium")
    return RodVerdict(GraspStatus.NOT_SOLVED, f"nothing bears {amount_text(left, 'N', '.3g')} of the load")
