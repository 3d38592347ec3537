"""The grasp of a hand: search, certificate, reasons and verdict."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from continuum_grasp.base import Interrupted, amount_text
from continuum_grasp.grasp.hand.certificate import HandCertificate, certify_hand, least_push
from continuum_grasp.grasp.hand.gripped import GrippedGrasp, least_pushed, pushed_grasps, turned_grasps
from continuum_grasp.grasp.hand.opening import in_the_way, opening_words, openings, way_words
from continuum_grasp.grasp.hand.repairs import LIMITS, repair_of
from continuum_grasp.grasp.hand.result import HandResult
from continuum_grasp.grasp.hand.search import HandSearch, HandTried
from continuum_grasp.grasp.hand.steady import steadied
from continuum_grasp.grasp.problem.relaxations import beyond_needed
from continuum_grasp.grasp.values import NEAR, OPENED, PUSH_SHARE, SATISFIED, GraspStatus, unloaded_words
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import HandScene

_SLIGHT = 1e-3
"""Push, per weight, below which none is promised."""
_NO_RESERVE = "; a contact is at the edge of friction, so a slight push may make it slip: give contacts.reserve, as 0.2"
_PROBED = 0.01
"""Weight that replaces a missing weight in a search for grasps that bear a push, per sum of the tip forces that the
tendons can exert [1]: a tenth of the push that strong grasps must then bear."""
_FAINT = 1e-3
"""Gravity of that weight in a scene without gravity [m/s2]."""
_PUSHED = 3
"""Number of grasps, by least tension, whose forces the search raises to bear a push."""
_STEADIED = 2
"""Unstable grasps next to which stable ones are sought, the most stable."""


def hold(scene: HandScene, progress: Callable[[str], None] | None = None) -> HandResult:
    """Find the best grasp of a hand, or why none exists; the search opens fingers that block the object at rest."""
    way = in_the_way(scene)
    result = _held(scene, progress)
    opened = openings(scene, result.arrays) if result.solved else {}
    words = [way_words(way)] if way and result.solved else []
    words += [opening_words(opened)] if opened else []
    return replace(result, message="; ".join([result.message, *words]))


def _held(scene: HandScene, progress: Callable[[str], None] | None) -> HandResult:
    """Find the best grasp for the loads of the object."""
    if scene.contacts.push or scene.unloaded:
        return _pushed(scene, progress)
    if not scene.turned:
        return _hold(scene, progress)[0]
    # First with the weight along -z, then with more tension while it takes every direction.
    result, held = _hold(scene.replaced(gravity=(0.0, 0.0, -scene.turned)), progress)
    if not held:
        return replace(result, scene=scene, message=f"with the weight along -z: {result.message}")
    return _turned(scene, result, held[0], progress)


def _pushed(scene: HandScene, progress: Callable[[str], None] | None) -> HandResult:
    """Find the grasp with the least normal forces that bears a push in every direction."""
    asked = scene.contacts.push
    plain = scene.replaced(contacts=scene.contacts.replaced(push=None))
    weight = _PROBED * sum(setup.tip_force for setup in scene.setups)
    result, held = _hold(_weighing(plain, weight) if plain.unloaded else plain, progress)
    if not held:
        if not plain.unloaded:
            return replace(result, scene=scene)
        stands_for = amount_text(weight, "N", ".2g")
        message = f"no grasp was found that bears a push of {stands_for} on the object, whose weight is negligible"
        return replace(
            result,
            scene=scene,
            status=result.status if result.status is GraspStatus.UNSTABLE else GraspStatus.NOT_SOLVED,
            message=f"{message}; with a weight of {stands_for} instead of the push: {result.message}",
            certificate=None,
        )
    search = HandSearch(plain, Budget.of(scene.solver, progress))
    found = [pushed_grasps(plain, one, search, asked or math.inf) for one in held[:_PUSHED]]
    statistics = {**result.statistics, "grips tried": sum(map(len, found))}
    strongest = max((grasp for each in found for grasp in each), key=lambda grasp: grasp.push, default=None)
    greatest = 0.0 if strongest is None else strongest.push
    push = PUSH_SHARE * greatest if asked is None else asked
    if asked is None and greatest <= NEAR * max(setup.tip_force for setup in scene.setups):
        push = 0.0  # as small as a negligible weight
    bearing = [grasp for each in found if (grasp := least_pushed(each, search, push)) is not None] if push else []
    if not bearing:
        return _gives_way(scene, strongest, statistics)
    best = min(bearing, key=lambda grasp: grasp.tried.tension)
    borne = amount_text(best.push, "N", ".3g")
    message = (
        f"held with a sum of tensions of {amount_text(best.tried.tension, 'N', '.4g')} against any push up to {borne}"
    )
    message += f"; {result.statistics['starts']} starting postures were tried, a sample of all postures"
    if asked is None:
        message += f"; {unloaded_words(greatest)}"
    final = scene.replaced(contacts=scene.contacts.replaced(push=push))
    certificate = certify_hand(final, best.tried.arrays)
    words = "" if certificate.stability.stable else OPENED
    return HandResult(
        final, GraspStatus.FEASIBLE, message + words, best.tried.arrays, certificate, statistics=statistics
    )


def _gives_way(scene: HandScene, strongest: GrippedGrasp | None, statistics: dict[str, Any]) -> HandResult:
    """Give the verdict if no grasp bears the push, with the grasp that bears the greatest push."""
    if strongest is None:
        message = "no grasp was found whose contacts press harder than the weight requires"
        advice = "Use stronger tendons, more friction, or a palm."
        return HandResult(scene, GraspStatus.NOT_SOLVED, message, advice=advice, statistics=statistics)
    certificate = strongest.certificate
    status = GraspStatus.NOT_SOLVED
    if strongest.push:
        message = f"the grasp bears a push of {amount_text(strongest.push, 'N', '.3g')} in every direction, "
        asked = scene.contacts.push
        message += f"less than contacts.push, {amount_text(asked, 'N', '.3g')}" if asked else "which is negligible"
        advice = "Use stronger tendons, more friction, more fingers, or a smaller contacts.push."
    elif certificate.passed:
        status = GraspStatus.UNSTABLE
        message = f"in balance, but a small push drives the object away: {certificate.stability}"
        advice = "For a stable grasp, use fingers with a wider section, shorter fingers, or middle contacts."
    else:
        broken = ", ".join(check.name for check in certificate.failed)
        message = f"the solver converged, but the independent check rejects: {broken}"
        advice = "Give the fingers more space, or raise fidelity.elements."
    return HandResult(
        scene,
        status,
        message,
        strongest.tried.arrays,
        certificate,
        advice=advice + _of_two(scene),
        statistics=statistics,
    )


def _weighing(scene: HandScene, weight: float) -> HandScene:
    """Return the scene with a given weight of the object [N] along gravity, or along -z without gravity."""
    gravity = scene.acceleration
    if not any(gravity):
        # So small that the fingers' own weight does not matter.
        gravity = (0.0, 0.0, -_FAINT)
    mass = weight / math.hypot(*gravity)
    return scene.replaced(object=scene.object.replaced(mass=mass, density=None), gravity=gravity)


def _turned(scene: HandScene, down: HandResult, held: HandTried, progress: Callable[[str], None] | None) -> HandResult:
    """The grasp with the least tension that holds every direction of the weight, from one with the weight along -z."""
    search = HandSearch(scene, Budget.of(scene.solver, progress))
    found = turned_grasps(scene, held, search)
    steps = {"tensions tried": len(found)}
    if not found:
        message = "held with the weight along -z, but no grasp without weight was found next to it"
        advice = "Give gravity as [x, y, z], or other contacts."
        return HandResult(
            scene, GraspStatus.NOT_SOLVED, message, advice=advice, statistics={**down.statistics, **steps}
        )
    best = min(found, key=lambda grasp: (not grasp.certificate.acceptable, max(grasp.friction, 1.0), grasp.yielding))
    arrays = best.tried.arrays
    certificate = best.certificate
    worst = max(certificate.turned, key=lambda contact: contact.friction / contact.held)
    towards = ", ".join(f"{c:.2f}" for c in worst.direction)
    tension = amount_text(best.tried.tension, "N", ".4g")
    statistics = {**down.statistics, **steps}
    shift, turn = certificate.turned_motion
    moves = f"the object moves by up to {_motion_text(shift, turn)}"
    if certificate.acceptable:
        message = (
            f"held in every direction of the weight with a sum of tensions of {tension}; {worst.name} needs a friction "
            f"of {worst.friction:.3g} where the weight points along ({towards}); {moves}"
        )
        return HandResult(scene, GraspStatus.FEASIBLE, message, arrays, certificate, statistics=statistics)
    if certificate.passed:
        message = f"in balance with a sum of tensions of {tension}, but a small push drives the object away"
        message += f": {certificate.stability}"
        advice = "For a stable grasp: a wider section of the fingers, shorter fingers, or middle contacts."
        return HandResult(
            scene, GraspStatus.UNSTABLE, message, arrays, certificate, advice=advice, statistics=statistics
        )
    if best.friction <= 1.0:
        message = f"held in every direction of the weight, but {moves}; {_motion_text(*scene.most_motion)} is allowed"
        advice = f"Use fingers about {best.yielding:.2g} times as stiff, more of them, or drives that lock."
        return HandResult(
            scene, GraspStatus.NOT_SOLVED, message, arrays, certificate, advice=advice, statistics=statistics
        )
    advice = "More fingers or contacts, a palm, stiffer fingers, or a lighter object."
    where = f"{worst.name} where the weight points along ({towards})"
    if not np.isfinite(worst.friction):
        message = f"not held in every direction of the weight: at best, with {tension}, it opens {where}"
        return HandResult(
            scene, GraspStatus.NOT_SOLVED, message, arrays, certificate, advice=advice, statistics=statistics
        )
    # Only one grasp was turned; another may hold in every direction.
    needed = beyond_needed(max(c.friction / c.held for c in certificate.turned) * scene.contacts.friction, 1.0)
    limit = next(limit for limit in LIMITS if limit.name == "friction")
    other = certify_hand(limit.changed(scene, needed), arrays)
    reasons = (limit.reason(scene, needed, best.tried, stable=other.acceptable),) if other.passed else ()
    message = f"not held in every direction of the weight: at best, with {tension}, a friction of {worst.friction:.3g} "
    message += f"is needed, by {where}"
    return HandResult(
        scene, GraspStatus.NOT_SOLVED, message, arrays, certificate, reasons, advice, statistics=statistics
    )


def _tension_text(scene: HandScene, tried: HandTried) -> str:
    """Return the sum of the tensions of a grasp; zero if it is within the solver's tolerance."""
    most = sum(setup.max_tension for setup in scene.setups)
    return amount_text(tried.tension if tried.tension > SATISFIED * most else 0.0, "N", ".4g")


def _motion_text(shift: float, turn: float) -> str:
    """A displacement [m] and a turn [rad], where they are finite."""
    shown = [f"{1e3 * shift:.3g} mm"] if math.isfinite(shift) else []
    return " and ".join([*shown, f"{math.degrees(turn):.2g} degrees"] if math.isfinite(turn) else shown)


def _hold(scene: HandScene, progress: Callable[[str], None] | None = None) -> tuple[HandResult, list[HandTried]]:
    """Find the best grasp under gravity in one direction, or why none exists, and all grasps that satisfy the scene,
    the best first.
    """
    began = time.monotonic()
    budget = Budget.of(scene.solver, progress)
    search = HandSearch(scene, budget)
    tried = list[HandTried]()
    verified = list[tuple[HandTried, HandCertificate]]()
    way = in_the_way(scene)
    if way:
        budget.tell(way_words(way))
    # If every finger blocks the object, its position is the reason, whatever else may change.
    misplaced = len(way) == len(scene.setups)

    def look(one: HandTried) -> None:
        tried.append(one)
        if not one.attempt.converged:
            return
        certificate = certify_hand(scene, one.arrays)
        if certificate.passed and not any(map(math.isnan, openings(scene, one.arrays).values())):
            verified.append((one, certificate))
            search.held |= certificate.acceptable
            budget.tell(f"held with {amount_text(one.tension, 'N', '.4g')}")

    try:
        for one in search.run(further=not misplaced):
            look(one)
        if not search.held:
            for pair in sorted(verified, key=lambda pair: -pair[1].stability.eigenvalue)[:_STEADIED]:
                for one in steadied(search, *pair):
                    look(one)
    except KeyboardInterrupt:
        if not verified:
            raise Interrupted(f"interrupted before a grasp was found ({len(tried)} starts tried)") from None
    statistics = {
        "starts": len(tried),
        "iterations": sum(one.attempt.iterations for one in tried),
        "seconds": time.monotonic() - began,
    }
    stable = [pair for pair in verified if pair[1].stability.stable]
    asked = stable if scene.stability == "require" else verified
    if asked or verified:
        ranked = sorted(asked or verified, key=lambda pair: pair[0].tension)
        best, certificate = ranked[0]
        held = f"a sum of tensions of {_tension_text(scene, best)}"
        if not asked:
            unstable = HandResult(
                scene,
                GraspStatus.UNSTABLE,
                f"in balance with {held}, but a small push drives the object away: {certificate.stability}",
                best.arrays,
                certificate,
                advice="For a stable grasp, use fingers with a wider section, shorter fingers, or middle contacts. "
                "Set stability: ignore where something else steadies the object." + _of_two(scene),
                statistics=statistics,
            )
            return unstable, []
        words = "" if certificate.stability.stable else OPENED
        if least_push(certificate.promise) < _SLIGHT * scene.weight:
            words += _NO_RESERVE
        message = f"held with {held}; {len(tried)} starting postures were tried, a sample of all postures{words}"
        result = HandResult(scene, GraspStatus.FEASIBLE, message, best.arrays, certificate, statistics=statistics)
        return result, [one for one, _ in ranked]
    if misplaced:
        message = f"{way_words(way)}, and no grasp was found that they reach by opening and closing"
        advice = "Move the object or the bases, or give the fingers a rest_curvature that clears the object."
        arrays = min(tried, key=lambda one: one.attempt.violation).arrays if tried else {}
        return HandResult(scene, GraspStatus.NOT_SOLVED, message, arrays, advice=advice, statistics=statistics), []
    return _without(scene, search, tried, statistics), []


def _without(scene: HandScene, search: HandSearch, tried: list[HandTried], statistics: dict[str, float]) -> HandResult:
    """The verdict when no start leads to a grasp."""
    if not tried:
        idle = sorted({name for fingers in search.untouched.values() for name in fingers})
        message = f"no sampled posture of {' and '.join(idle)} touches the object"
        advice = "Move the object or the bases, turn the planes of the fingers to it (twist), or use longer fingers."
        return HandResult(scene, GraspStatus.NOT_SOLVED, message, advice=advice, statistics=statistics)
    search.budget.tell("no grasp found; looking for a change that allows one")
    starts = [(one, search.left(one)) for one in tried]
    found = [repair_of(scene, search, starts, limit) for limit in LIMITS]
    reasons = sorted((reason for reason in found if reason is not None), key=lambda reason: not reason.stable)
    nearest = min(tried, key=lambda one: one.attempt.violation)
    if reasons:
        repairs = "; ".join(reason.repair for reason in reasons)
        advice = f"Any one of these repairs it: {repairs}."
        if not reasons[0].stable:
            advice = f"Any one of these balances the forces, but a small push then drives the object away: {repairs}."
            advice += _of_two(scene)
        tries = f"the search tried {len(tried)} starting postures, a sample of all postures"
        status, message = GraspStatus.INFEASIBLE, f"{reasons[0].text}; {tries}"
        if not search.agreed:
            # A search of greater effort may find a grasp without a change.
            status = GraspStatus.NOT_SOLVED
            message = f"no grasp found; nearest to one: {message}{_more(scene, search)}"
        arrays = dict(reasons[0].arrays)
        return HandResult(scene, status, message, arrays, None, tuple(reasons), advice, statistics=statistics)
    converged = [one for one in tried if one.attempt.converged]
    if converged:
        broken = ", ".join(check.name for check in certify_hand(scene, converged[0].arrays).failed)
        message = f"the solver converged, but the independent check rejects: {broken}"
        advice = "Give the fingers more space, or raise fidelity.elements."
    else:
        worst = nearest.problem.rows.violations(nearest.attempt.g, 1e-6, {})
        names = ", ".join(violation.name for violation in worst[:3])
        message = (
            f"No grasp found. {len(tried)} starting postures were tried{_more(scene, search)}; the nearest violates "
        )
        message += f"{names}. No single limit explains it."
        advice = (
            "Probably the geometry is the cause: move the object or the bases, or turn the planes of the fingers to "
            "it (twist)."
        )
        advice += _of_two(scene)
    status = GraspStatus.STOPPED if search.budget.stopped else GraspStatus.NOT_SOLVED
    return HandResult(scene, status, message, nearest.arrays, None, advice=advice, statistics=statistics)


def _more(scene: HandScene, search: HandSearch) -> str:
    """Say how to let a search try more starts."""
    if search.budget.stopped:
        return f" (the clock stopped it after {scene.solver.time_limit:g} s: solver.time_limit)"
    if search.budget.cut:
        return " (all iterations were used up: solver.max_total_iterations)"
    return "" if scene.solver.effort == "thorough" else " (solver.effort: thorough tries more)"


def _of_two(scene: HandScene) -> str:
    """Advice where two fingers touch at points."""
    if len(scene.setups) != 2 or scene.contacts.torsional_friction:
        return ""
    return (
        " Two fingers that touch once each leave the object free to turn about the line through them: give "
        "contacts.torsional_friction of soft pads, contacts.middle: on and contacts.tip: on, a palm, or a third finger."
    )
