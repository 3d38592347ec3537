"""Stable grasps of a hand next to those that are in balance and turn away.

The least eigenvalue of the second-order test becomes a constraint of the problem, linear about a point; each solution
is the point of the next. With v its mode, H v + A' m = e v on the motions A v = 0 that the contacts leave, the
derivative of the eigenvalue e is v . dH v + 2 m . dA v.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.certificate.space import held_directions
from continuum_grasp.grasp.effort import LEAST_IN_SPACE, LINKS
from continuum_grasp.grasp.hand.certificate import HandCertificate, certify_hand
from continuum_grasp.grasp.hand.parts import Aims
from continuum_grasp.grasp.hand.problem import hand_problem
from continuum_grasp.grasp.hand.recomputed import RecomputedHand
from continuum_grasp.grasp.hand.search import HandSearch, HandTried
from continuum_grasp.grasp.hand.stability import HandSystem, steadying_system

ROUNDS = 10
"""Linearizations from one grasp."""
_STEP = 1e-6
"""Step of a difference, in units of the problem."""


def steadied(search: HandSearch, tried: HandTried, certificate: HandCertificate) -> Iterator[HandTried]:
    """Grasps next to one, each more stable than the one before, until one is stable."""
    problem = hand_problem(replace(tried.problem.spec, aims=Aims(steadied=True)))
    share = 1.0
    slope = eigenvalue_slope(search, tried)
    for _ in range(ROUNDS):
        value = certificate.stability.eigenvalue
        if search.budget.over or certificate.stability.stable or not np.isfinite(slope).all():
            return
        wanted = value + share * (LEAST_IN_SPACE - value)
        level = wanted - value + float(slope @ tried.attempt.x)
        found = search.next_to(tried, problem, problem.steadying(slope, level))
        better = found.attempt.converged
        if better:
            verdict = certify_hand(search.scene, found.arrays)
            better = verdict.passed and verdict.stability.eigenvalue > value
        if not better:
            share *= 0.4
            # 0.02: part of the way to stability of a step that the solver must at least follow
            if share < 0.02:
                return
            continue
        yield found
        share = min(1.0, 2.0 * share)
        tried = found
        certificate = verdict
        slope = eigenvalue_slope(search, found)


def eigenvalue_slope(search: HandSearch, tried: HandTried) -> Array:
    """Derivative of the least eigenvalue, in E I / L, by the unknowns of a problem; by forward differences."""
    scene = search.scene
    x = tried.attempt.x
    hand = RecomputedHand(scene, tried.arrays)
    system = steadying_system(hand, LINKS)
    held = held_directions(system.rows)
    left = np.linalg.svd(held, full_matrices=True)[0][:, held.shape[1] :]
    values, vectors = np.linalg.eigh(left.T @ system.hessian @ left)
    mode = left @ vectors[:, 0]
    multipliers = np.linalg.lstsq(system.rows.T, values[0] * mode - system.hessian @ mode, rcond=None)[0]
    unit = hand.fingers[0].plane.stiffness / hand.fingers[0].length

    def energy(x: Array) -> float:
        there = HandSystem(RecomputedHand(scene, search.arrays_at(tried, x)), LINKS, turning=bool(system.turning))
        return float(mode @ there.hessian @ mode + 2.0 * multipliers @ there.rows @ mode) / unit

    slope = np.zeros(x.size)
    here = energy(x)
    for name, place in tried.problem.x.at.items():
        # Limits that are relaxed, turns and shifts, which follow from the rest, are not stored.
        if not name.startswith("relaxed ") and not name.endswith(("turns", ".shifts")):
            for k in range(place.start, place.stop):
                slope[k] = (energy(x + _STEP * (np.arange(x.size) == k)) - here) / _STEP
    return slope
