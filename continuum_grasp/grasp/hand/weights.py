"""Contact forces under pushes and a weight of any direction, to first order at constant tensions, by numpy alone.

Under gravity g d, |d| <= 1, a contact bears f(d) = a + G d. It is within the cone of friction mu for every d if and
only if, with n the normal, S = (1 + mu^2) n n' - 1 and M = [G, a], some e >= 0 makes

    M' S M - e diag(-1, -1, -1, 1)

positive semidefinite (the S-lemma, which is exact for one quadratic: I. Polik, T. Terlaky, SIAM Review 49 (2007),
doi:10.1137/S003614450444614X), and n . a >= |G' n|. The vector whose quadratic form vanishes first is the worst d.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.push import bears, maximum
from continuum_grasp.grasp.hand.recomputed import ObjectTouch, RecomputedHand
from continuum_grasp.grasp.hand.stability import HandResponse

MOST = 20.0
"""Friction above which none is said to be enough."""
_RATIOS, _SAME = 40, 1e-10
"""Steps to the worst direction at most, each with the friction needed at the one before (W. Dinkelbach,
Management Science 13 (1967), doi:10.1287/mnsc.13.7.492), and relative change that ends them; 3 to 8 are enough."""


@dataclass(frozen=True)
class TurnedContact:
    """Needs of a contact while the weight takes every direction."""

    name: str
    friction: float  # coefficient needed; infinite where the contact opens
    direction: Array  # (3,) of the weight at which that is
    greatest: float  # normal force, most [N]
    limit: float  # normal force that is allowed [N]
    held: float  # coefficient that is there, less the reserve


def turned_contacts(hand: RecomputedHand, response: HandResponse, gravity: float) -> tuple[TurnedContact, ...]:
    """Needs of each contact that presses under gravity [m/s2] of every direction."""
    found = []
    slopes = zip(response.forces_by_gravity, response.moments_by_gravity, strict=True)
    for contact, (slope, twist) in zip(hand.pressing, slopes, strict=True):
        load, slopes_of_load, normal = _with_moment(contact, gravity * slope, gravity * twist)
        needed, direction = worst_friction(load, slopes_of_load, normal)
        greatest = contact.normal_force + gravity * float(np.linalg.norm(slope.T @ contact.normal))
        limit = contact.normal_force_max
        found.append(TurnedContact(contact.name, needed, direction, greatest, limit, contact.held_friction))
    return tuple(found)


def promised_wrench(hand: RecomputedHand, response: HandResponse, along: Array) -> float:
    """Greatest multiple of a wrench (6,) on the object, about its center of mass, that leaves every contact in its cone
    of friction and within its greatest normal force, to first order at constant tensions.
    """
    most = float("inf")
    for contact, slope, twist in zip(hand.pressing, response.forces, response.moments, strict=True):
        load, slopes, normal = _with_moment(contact, slope, twist)
        rate = slopes @ along
        press = contact.normal_force
        more = float(normal @ rate)
        across, aside = load - press * normal, rate - more * normal
        # |across + c aside| = mu (press + c more) at the edge of the cone.
        mu = contact.friction
        edges = np.roots(
            [
                float(aside @ aside) - (mu * more) ** 2,
                2.0 * (float(across @ aside) - mu**2 * press * more),
                float(across @ across) - (mu * press) ** 2,
            ]
        )
        most = min([most, *(float(edge.real) for edge in edges if edge.imag == 0.0 and edge.real > 0.0)])
        if more > 0.0:
            most = min(most, (contact.normal_force_max - press) / more)
        elif more < 0.0:
            # Through the apex of the cone the edges are a double root, which rounding makes complex.
            most = min(most, press / -more)
    return most


def borne_push(hand: RecomputedHand, response: HandResponse) -> float:
    """Return the greatest push on the object that the grasp bears in every direction [N], to first order at constant
    tensions.
    """
    slopes = zip(response.forces[..., :3], response.moments[:, :3], strict=True)
    return min(
        bears(*_with_moment(contact, slope, twist), contact.friction, contact.normal_force_max)
        for contact, (slope, twist) in zip(hand.pressing, slopes, strict=True)
    )


def _with_moment(contact: ObjectTouch, slope: Array, twist: Array) -> tuple[Array, Array, Array]:
    """Load (4,), its slope (4, K) and the normal (4,) of a contact, whose moment per arm is the fourth component."""
    arm = contact.arm or math.inf
    load = np.append(contact.load, contact.moment / arm)
    return load, np.vstack([slope, twist / arm]), np.append(contact.normal, 0.0)


def worst_friction(force: Array, slope: Array, normal: Array) -> tuple[float, Array]:
    """Friction with which ``force + slope @ d`` is within the cone for all |d| <= 1, and the d that needs it."""
    opening = slope.T @ normal
    steepest = float(np.linalg.norm(opening))
    if not force @ normal > steepest:
        return float("inf"), -opening / max(steepest, 1e-300)
    whole = np.column_stack([slope, force])
    needed = 0.0
    worst = np.zeros(3)
    for _ in range(_RATIOS):
        direction = _margin(whole, normal, needed)[1]
        there = force + slope @ direction
        press = float(there @ normal)
        friction = float(np.linalg.norm(there - press * normal)) / press
        if not friction > needed * (1.0 + _SAME):
            break
        needed, worst = friction, direction
    return (needed, worst) if needed <= MOST else (float("inf"), worst)


def _margin(whole: Array, normal: Array, friction: float) -> tuple[float, Array]:
    """Greatest least eigenvalue over e, of a concave function of e, and the direction that goes with it."""
    form = whole.T @ ((1.0 + friction**2) * np.outer(normal, normal) - np.eye(normal.size)) @ whole
    ball = np.diag([-1.0, -1.0, -1.0, 1.0])

    def least(e: float) -> float:
        return float(np.linalg.eigvalsh(form - e * ball)[0])

    high = float(np.abs(form).sum())
    e, _ = maximum(least, 0.0, high)
    values, vectors = np.linalg.eigh(form - e * ball)
    # Rounding of the form, where the cone is touched exactly; of equal eigenvalues, as of a contact with symmetry, the
    # vectors span several directions; any one of length one is as bad as another.
    near = vectors[:, values - values[0] < 1e-7 * high]
    last = near[3] / max(float(near[3] @ near[3]), 1e-300)
    inside = near[:3] @ last
    if near.shape[1] > 1 and float(inside @ inside) < 1.0:
        across = near[:3] @ np.linalg.svd(near[3:])[2][-1]
        square, double = float(across @ across), float(across @ inside)
        inside = inside + across * (np.sqrt(double**2 + square * (1.0 - float(inside @ inside))) - double) / square
    return float(values[0]) + 1e-14 * high, inside / max(float(np.linalg.norm(inside)), 1e-300)
