"""Rods lumped into rigid links and hinges, of second order in their number; fingers as such chains with guides."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh, eigvalsh
from scipy.optimize import brentq

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError
from continuum_grasp.model.winches import Motor, winches_of
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.profile import Profile
from continuum_grasp.scene.tendons import Tendon

_SAME = 1e-9
"""Distance per length up to which two positions are the same [1]: above the rounding of sums of lengths."""


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
    stop: Array | None  # (N,) bend from which on a stop adds to the stiffness [rad], a magnitude; None: no stops

    def link_of(self, s: float) -> int:
        """Index of the link that carries a position [m]; -1 before the first hinge."""
        return int(np.searchsorted(self.at, s, side="right")) - 1

    def pulsations(self, ratio: float = 1.0) -> tuple[Array, Array]:
        """Angular frequencies of small motions of the straight, unloaded chain [rad/s], increasing, and their decay
        times [s].

        A mode with damping d and stiffness k has the decay time d / k; it is the same in all where the damping goes
        with the stiffness. ``ratio`` is a factor of the stiffness.
        """
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
        # No modes of the damping any more: the same condition, of the matrices.
        mass, stiffness = 4.0 * self.mass_matrix, np.diag(ratio * self.stiffness) + springs

        def spare(step: float) -> float:
            rest = mass + np.diag(2.0 * step * self.damping) - step**2 * stiffness
            return float(eigvalsh(rest, subset_by_index=(0, 0))[0])

        return float(brentq(spare, 0.0, 1.01 * longest, xtol=1e-6 * longest))


def lump(
    finger: Finger, count: int, marks: Sequence[float] = (), *, per_arc: Sequence[float] = (), even: bool = False
) -> Links:
    """Lump a finger into hinges.

    ``marks`` are places where the bending moment jumps [m]: ends of elements, as a hinge inside would take all of the
    jump or nothing. ``per_arc`` are the lengths [m] of the elements that have the damping per arc. ``even``: all of one
    length.
    """
    profile = finger.profile
    length = profile.length
    edges = np.linspace(0.0, length, count + 1) if even else _edges(profile, count, marks)
    compliance, first = profile.moments(lambda s: 1.0 / profile.bending_stiffness(s), edges, 2)
    at = first / compliance
    (rest,) = profile.moments(profile.rest_curvature, edges)
    # The damping goes with the stiffness along the finger; its coefficient is that at the base.
    stiffness = 1.0 / compliance
    damping = finger.damping.material / float(profile.bending_stiffness(0.0)) * stiffness
    if per_arc and finger.damping.per_arc:
        # An element of ours that bends evenly has m hinges with the m-th part of its rate each.
        element = np.clip(np.searchsorted(np.cumsum(per_arc), at), 0, len(per_arc) - 1)
        damping = damping + finger.damping.per_arc * np.asarray(per_arc)[element] / np.diff(edges)
    bounds = np.append(at, length)
    mass, first, second = profile.moments(profile.linear_density, bounds, 3)
    (turning,) = profile.moments(profile.rotary_inertia, bounds)
    sideways = np.zeros(count)
    for point in finger.masses:
        k = int(np.searchsorted(at, point.at, side="right")) - 1
        if k >= 0:
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
    return Links(edges, at, stiffness, damping, rest, bounds[1:], mass, center, across, inertia, stop)


def _edges(profile: Profile, count: int, marks: Sequence[float]) -> Array:
    """Ends of the elements: between the marks equal parts of the integral of (rho A / EI)^(1/4).

    That is the number of waves of bending along the rod; a uniform one gets equal lengths.
    """
    length = profile.length
    inside = sorted({at for at in marks if _SAME * length < at < (1.0 - _SAME) * length})
    bounds = [0.0, *(b for a, b in pairwise([0.0, *inside]) if b - a > _SAME * length), length]
    if count < len(bounds) - 1:
        raise InputError(
            f"expected {len(bounds) - 1} at least, one for each part between the places where the bending moment jumps "
            f"(ends of tendons, couples), got {count}",
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


OF_FINGER = ("bending_stiffness", "material_damping", "tendon_friction")
"""Numbers of the finger that may be changed without compiling anew."""


@dataclass(frozen=True)
class Guided:
    """A tendon and its guides from the drum on: that of a conduit, if any, then one per hinge up to its end.

    ``arms`` (N) [m] are what a bend of each hinge draws in, zero beyond its end; ``gives`` are the compliances [m/N]
    of its pieces: to the first guide, from guide to guide, and to its end; ``gear`` is the stiffness [N/m] and half the
    play [m], in cable, of a gear before the pulley on which it is the first, else zeros.
    """

    arms: Array
    gives: Array
    friction: float
    conduit: float
    wound: bool
    gear: tuple[float, float]

    @property
    def guides(self) -> int:
        return len(self.gives) - 1


class HingeChain:
    """The numbers of a chain of N hinges in equal parts of the finger, each with the bend of its part.

    ``axial_stiffness`` [N] is of tendons whose tension is commanded.
    """

    def __init__(self, finger: Finger, hinges: int, axial_stiffness: float | None = None) -> None:
        self.finger, self.hinges = finger, hinges
        self.length, self.pitch = finger.rod.length, finger.rod.length / hinges
        self.winches = winches_of(finger.tendon_list, self.length)
        motors = [winch for winch in self.winches if isinstance(winch, Motor)]
        gears = {
            motor.tendons[0]: (gear[0] / motor.radius**2, gear[1] * motor.radius)
            for motor in motors
            if (gear := motor.gear)
        }
        self.tendons = [
            self._guided(tendon, axial_stiffness, gears.get(k, (0.0, 0.0)))
            for k, tendon in enumerate(finger.tendon_list)
        ]

    @cached_property
    def links(self) -> Links:
        """The rod, lumped into hinges and what is between them."""
        return lump(self.finger, self.hinges, even=True)

    def place(self, at: float) -> tuple[int, float]:
        """Return which bar carries a position along the finger [m], counted from that after the first hinge (-1: before
        it), and how far along it that is [m].
        """
        bar = self.links.link_of(at + 1e-9 * self.pitch)
        return bar, at - (self.links.at[bar] if bar >= 0 else 0.0)

    def _guided(self, tendon: Tendon, axial_stiffness: float | None, gear: tuple[float, float]) -> Guided:
        to = tendon.end(self.length)
        at = self.links.at[self.links.at < to]
        arms = tendon.arm(self.length) * tendon.shape(self.length)(self.links.at, tip_side=True)
        stiffness = tendon.axial_stiffness or axial_stiffness or np.inf
        free = 0.0 if tendon.series_stiffness is None else 1.0 / tendon.series_stiffness
        pieces = np.diff([0.0, *at, to]) / stiffness
        conduit = tendon.conduit_bend > 0.0
        gives = np.array([free, *pieces] if conduit else [free + pieces[0], *pieces[1:]])
        return Guided(arms, gives, tendon.friction, tendon.conduit_bend, tendon.drive is not None, gear)

    def numbers(self, gravity: tuple[float, float], places: Sequence[float], factors: Mapping[str, float]) -> Array:
        """All that the C of the motion needs to know of it: ``factors`` on what ``OF_FINGER`` names."""
        links = self.links
        weights, carried = links.turning
        base, points = self.finger.base, [self.place(at) for at in places]
        parts: list[ArrayLike] = [
            [*base.position, base.angle, links.at[0], *gravity],
            weights.ravel(),
            factors.get("bending_stiffness", 1.0) * links.stiffness,
            links.rest,
            # Material damping follows from the stiffness of the section as it is described.
            factors.get("material_damping", 1.0) * links.damping,
            carried,
            links.bars,
            [bar for bar, _ in points],
            [along for _, along in points],
        ]
        for tendon in self.tendons:
            gives = np.zeros(self.hinges + 2)
            gives[: len(tendon.gives)] = tendon.gives
            friction = factors.get("tendon_friction", 1.0) * tendon.friction
            numbers = [tendon.guides, tendon.wound, tendon.conduit > 0.0, friction, tendon.conduit, *tendon.gear]
            parts += [numbers, tendon.arms, gives]
        return np.concatenate([np.asarray(part, dtype=float).ravel() for part in parts])
