"""Rods lumped into rigid links and hinges, of second order in their number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.scene import SAME, Finger, Profile


@dataclass(frozen=True)
class Links:
    """N elements of a rod, each lumped into one hinge, and the N rigid links that begin at these hinges.

    The hinge of an element is where a moment that is linear along it bends it by the same angle: its compliance is the
    integral of 1/EI, its place the centroid of 1/EI. On a uniform rod that is the middle (the midpoint rule); with
    jumps of EI inside the element it stays of second order. What lies before the first hinge is clamped.
    """

    edges: Array  # (N + 1,) ends of the elements [m]
    at: Array  # (N,) places of the hinges [m]
    stiffness: Array  # (N,) [N m/rad]
    damping: Array  # (N,) [N m s/rad]
    rest: Array  # (N,) angles of the unloaded rod [rad]
    ends: Array  # (N,) where the links end [m]: the next hinge, or the tip
    mass: Array  # (N,) of the links, with point masses and the tip body [kg]
    center: Array  # (N,) their centers of mass along the finger [m]
    across: Array  # (N,) and across it, on the +X side [m]
    inertia: Array  # (N,) about these [kg m2]
    clamped: Array  # (4,) the same four numbers for the part before the first hinge
    stop: Array | None  # (N,) bend from which on a stop adds to the stiffness [rad], a magnitude; None: no stops

    @staticmethod
    def of(
        finger: Finger, count: int, marks: Sequence[float] = (), *, per_arc: Sequence[float] = (), even: bool = False
    ) -> Links:
        """Lump a finger into hinges.

        ``marks`` are places where the bending moment jumps [m]: ends of elements, as a hinge inside would take all of
        the jump or nothing. ``per_arc`` are the lengths [m] of the elements that have the damping per arc. ``even``:
        all of one length.
        """
        profile = finger.profile
        length = profile.length
        edges = np.linspace(0.0, length, count + 1) if even else _edges(profile, count, marks)
        compliance, first = profile.moments(lambda s: 1.0 / profile.bending_stiffness(s), edges, 2)
        at = first / compliance
        (rest,) = profile.moments(profile.rest_curvature, edges)
        # The damping goes with the stiffness along the finger; its coefficient is that of the rod itself at the base.
        stiffness = 1.0 / compliance
        damping = finger.damping.material / profile.own_stiffness * stiffness
        if per_arc and finger.damping.per_arc:
            # An element of ours that bends evenly has m hinges with the m-th part of its rate each.
            element = np.clip(np.searchsorted(np.cumsum(per_arc), at), 0, len(per_arc) - 1)
            damping = damping + finger.damping.per_arc * np.asarray(per_arc)[element] / np.diff(edges)
        bounds = np.concatenate([[0.0], at, [length]])
        mass, first, second = profile.moments(profile.linear_density, bounds, 3)
        (turning,) = profile.moments(profile.rotary_inertia, bounds)
        sideways = np.zeros(count + 1)
        for point in finger.masses:
            k = int(np.searchsorted(at, point.at, side="right"))
            mass[k] += point.mass
            first[k] += point.mass * point.at
            second[k] += point.mass * point.at**2
        if (body := finger.tip_body) is not None:
            x, y = body.center_of_mass
            mass[-1] += body.mass
            first[-1] += body.mass * (length + y)
            second[-1] += body.mass * (x**2 + (length + y) ** 2)
            sideways[-1] += body.mass * x
            turning[-1] += body.rotary_inertia
        center, across = first / mass, sideways / mass
        inertia = turning + second - mass * (center**2 + across**2)
        stop = None if finger.stop_curvature is None else profile.moments(finger.stop_curvature, edges)[0]
        bodies = np.stack([mass, center, across, inertia])
        first_body, (mass, center, across, inertia) = bodies[:, 0], bodies[:, 1:]
        return Links(edges, at, stiffness, damping, rest, bounds[2:], mass, center, across, inertia, first_body, stop)

    def body(self, k: int) -> Array:
        """Return mass [kg], center of mass along and across the finger [m], and inertia about the center [kg m2] of a
        link (-1: the clamped part).
        """
        return self.clamped if k < 0 else np.array([self.mass[k], self.center[k], self.across[k], self.inertia[k]])

    def span(self, k: int) -> tuple[float, float]:
        """Ends of a link [m]; of the clamped part, -1, too."""
        return (float(self.at[k]), float(self.ends[k])) if k >= 0 else (0.0, float(self.at[0]))

    def link_of(self, s: float) -> int:
        """Index of the link that carries a position [m]; -1 before the first hinge."""
        return int(np.searchsorted(self.at, s, side="right")) - 1

    def pulsations(self, ratio: float = 1.0) -> tuple[Array, Array]:
        """Angular frequencies of small motions of the straight, unloaded chain [rad/s], increasing, and their decay
        times [s].

        A mode with damping d and stiffness k has the decay time d / k; it is the same in all where the damping goes
        with the stiffness. ``ratio`` is a factor of the stiffness.
        """
        from scipy.linalg import eigh

        squares, modes = eigh(np.diag(ratio * self.stiffness), self.mass_matrix)
        decay = np.einsum("ka,k,ka->a", modes, self.damping, modes) / squares
        return np.sqrt(squares), decay

    @property
    def bars(self) -> Array:
        """Lengths of the links from hinge to hinge, of the last one to the tip (N,) [m]."""
        return np.asarray(self.ends - self.at)

    @property
    def turning(self) -> tuple[Array, Array]:
        """Weights (N, N) [kg m2] of products of the links' turning, and first moments (N,) [kg m] of their weight."""
        lever = self.center - self.at
        beyond = np.append(np.cumsum(self.mass[::-1])[::-1], 0.0)[1:]
        carried = self.mass * lever + self.bars * beyond
        diagonal = self.inertia + self.mass * (lever**2 + self.across**2) + self.bars**2 * beyond
        above = np.triu(np.outer(self.bars, carried), 1)
        return np.diag(diagonal) + above + above.T, carried

    @property
    def mass_matrix(self) -> Array:
        """Mass matrix of the straight chain (N, N) [kg m2]: its links turn by the sum of the bends before them."""
        on = np.tri(len(self.at))
        return np.asarray(on.T @ self.turning[0] @ on)

    def longest_step(self, ratio: float = 1.0, springs: Array | None = None) -> float:
        """Longest stable step [s] of semi-implicit Euler steps with implicit damping, for the straight chain.

        The eigenvalues of one step of ``m v' = -d v - k q`` are within the unit circle while
        ``h^2 k < 4 m + 2 h d``. ``ratio`` is a factor of the stiffness, where stops touch; ``springs`` (N, N) is added
        to it, by cables in tension.
        """
        pulsations, decay = self.pulsations(ratio)
        longest = float(np.min(decay + np.sqrt(decay**2 + 4.0 / pulsations**2)))
        if springs is None or not springs.any():
            return longest
        from scipy.linalg import eigvalsh
        from scipy.optimize import brentq

        # No modes of the damping any more: the same condition, of the matrices.
        mass = 4.0 * self.mass_matrix
        stiffness = np.diag(ratio * self.stiffness) + springs

        def spare(step: float) -> float:
            rest = mass + np.diag(2.0 * step * self.damping) - step**2 * stiffness
            return float(eigvalsh(rest, subset_by_index=(0, 0))[0])

        return float(brentq(spare, 0.0, 1.01 * longest, xtol=1e-6 * longest))


def _edges(profile: Profile, count: int, marks: Sequence[float]) -> Array:
    """Ends of the elements: between the marks equal parts of the integral of (rho A / EI)^(1/4).

    That is the number of waves of bending along the rod; a uniform one gets equal lengths.
    """
    length = profile.length
    inside = sorted({at for at in marks if SAME * length < at < (1.0 - SAME) * length})
    bounds = [0.0, *(b for a, b in pairwise([0.0, *inside]) if b - a > SAME * length), length]
    if count < len(bounds) - 1:
        raise InputError(
            f"expected at least {len(bounds) - 1}, one per segment between jumps of the bending moment "
            f"(tendon ends, couples), got {count}",
            key="hinges",
        )
    # 4097: places of the table from which the elements' ends are taken: four times as many as the most hinges
    s = np.unique(np.concatenate([np.linspace(0.0, length, 4097), bounds, profile.breaks]))
    along = profile.waves(s)
    marked = np.interp(bounds, s, along)
    counts = np.ones(len(bounds) - 1, dtype=int)
    for _ in range(count - len(counts)):  # the next one where the elements are longest
        counts[np.argmax(np.diff(marked) / counts)] += 1
    pieces = [np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairwise(marked), counts, strict=True)]
    edges = np.interp(np.concatenate([*pieces, marked[-1:]]), along, s)
    edges[np.cumsum([0, *counts])] = bounds  # where marks are, to the last digit
    return np.asarray(edges)


def rounded_step(longest: float, whole: float | None) -> float:
    """A step [s] no longer than allowed: a whole part of another step where one is given, else 1, 2 or 5 times 10^k."""
    if whole is not None:
        return whole / math.ceil(whole / longest)
    power = 10.0 ** math.floor(math.log10(longest))
    return max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= longest)
