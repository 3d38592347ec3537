"""A finger as a chain of hinges: bars with its inertia, its elasticity, and tendons with a guide at every hinge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.scene.drives import MotorDrive
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.graded import ends
from continuum_grasp.scene.tendons import Tendon

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
OF_FINGER = ("bending_stiffness", "material_damping", "tendon_friction")
"""What of the finger may be changed without compiling anew."""


@dataclass(frozen=True)
class Place:
    """A point of the chain: which bar, counted from that after the first hinge (-1: before it), how far along [m]."""

    bar: int
    along: float


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
        """Number of guides."""
        return len(self.gives) - 1


class HingeChain:
    """The numbers of a chain of N hinges, evenly spread, each in the middle of the part whose bend it has.

    Parameters
    ----------
    finger : Finger
    hinges : int
    axial_stiffness : float, optional
        Of tendons whose tension is commanded [N].
    """

    def __init__(self, finger: Finger, hinges: int, axial_stiffness: float | None = None) -> None:
        self.finger, self.hinges = finger, hinges
        self.length, self.pitch = finger.rod.length, finger.rod.length / hinges
        self.tendons = [self._guided(tendon, axial_stiffness) for tendon in finger.tendon_list]

    @cached_property
    def hinge_at(self) -> Array:
        """Positions of the hinges (N) [m]."""
        return np.asarray(self.pitch * (np.arange(self.hinges) + 0.5))

    def place(self, at: float) -> Place:
        """Return the point at a position along the finger [m]."""
        bar = int(np.floor(at / self.pitch - 0.5 + 1e-9))
        bar = min(max(bar, -1), self.hinges - 1)
        return Place(bar, at - (self.hinge_at[bar] if bar >= 0 else 0.0))

    @cached_property
    def bars(self) -> Array:
        """Lengths of the bars after each hinge (N) [m]."""
        lengths = np.full(self.hinges, self.pitch)
        lengths[-1] = 0.5 * self.pitch
        return lengths

    def _integral(self, low: float, high: float, *powers: int) -> list[float]:
        """Integrals of the density times powers of the distance from ``low``, then of the rotary inertia."""
        s, weights = self._nodes(low, high)
        density = self.finger.profile.linear_density(s)
        found = [weights @ (density * (s - low) ** k) for k in powers]
        return [float(v) for v in (*found, weights @ self.finger.profile.rotary_inertia(s))]

    def _nodes(self, low: float, high: float) -> tuple[Array, Array]:
        """Places and weights of integrals over a part, between the places where the finger changes at once."""
        inner = [low, *[at for at in self.finger.profile.breaks if low < at < high], high]
        places = [0.5 * (a + b) + 0.5 * (b - a) * _NODES for a, b in pairwise(inner)]
        return np.concatenate(places), np.concatenate([0.5 * (b - a) * _WEIGHTS for a, b in pairwise(inner)])

    @cached_property
    def inertia(self) -> tuple[Array, Array]:
        """Weights (N, N) [kg m2] of the products of the bars' turning, and first moments (N) [kg m] of their weight."""
        n, finger = self.hinges, self.finger
        mass, first, second = np.zeros(n), np.zeros(n), np.zeros(n)
        for i, start in enumerate(self.hinge_at):
            own = self._integral(start, start + self.bars[i], 0, 1, 2)
            mass[i], first[i], second[i] = own[0], own[1], own[2] + own[3]
        points = [(self.place(one.at), one.mass) for one in finger.masses]
        if finger.tip_body is not None:
            body, tip = finger.tip_body, self.place(self.length)
            points.append((Place(tip.bar, tip.along + body.center_of_mass[1]), body.mass))
            second[-1] += body.rotary_inertia
        for place, own_mass in points:
            if place.bar >= 0:
                mass[place.bar] += own_mass
                first[place.bar] += own_mass * place.along
                second[place.bar] += own_mass * place.along**2
        beyond = np.append(np.cumsum(mass[::-1])[::-1], 0.0)[1:]
        carried = first + self.bars * beyond
        weights = np.zeros((n, n))
        for i in range(n):
            weights[i, i] = second[i] + self.bars[i] ** 2 * beyond[i]
            weights[i, i + 1 :] = weights[i + 1 :, i] = self.bars[i] * carried[i + 1 :]
        return weights, carried

    @cached_property
    def elasticity(self) -> tuple[Array, Array, Array]:
        """Stiffness [N m], bend at rest [rad] and damping [N m s] of the hinges (N) each."""
        profile, n = self.finger.profile, self.hinges
        soft, rest = np.zeros(n), np.zeros(n)
        for i in range(n):
            s, weights = self._nodes(i * self.pitch, (i + 1) * self.pitch)
            soft[i] = weights @ (1.0 / profile.bending_stiffness(s))
            rest[i] = weights @ profile.rest_curvature(s)
        # Kelvin-Voigt: the damping is that at the base, and goes with the stiffness of the section.
        viscosity = self.finger.damping.material / float(profile.bending_stiffness(0.0))
        return 1.0 / soft, rest, viscosity / soft

    def _guided(self, tendon: Tendon, axial_stiffness: float | None) -> Guided:
        to = self.length if tendon.to is None else tendon.to
        at = self.hinge_at[self.hinge_at < to]
        first, last = ends(tendon.offset)
        # The constant cosine between a tendon and the backbone.
        arms = np.zeros(self.hinges)
        arms[: len(at)] = (first + (last - first) * at / to) / np.sqrt(1.0 + tendon.slope(self.length) ** 2)
        stiffness = tendon.axial_stiffness or axial_stiffness or np.inf
        free = 0.0 if tendon.series_stiffness is None else 1.0 / tendon.series_stiffness
        pieces = np.diff([0.0, *at, to]) / stiffness
        conduit = tendon.conduit_bend > 0.0
        gives = np.array([free, *pieces] if conduit else [free + pieces[0], *pieces[1:]])
        drive, gear = tendon.drive, (0.0, 0.0)
        if isinstance(drive, MotorDrive) and drive.gear_stiffness is not None and tendon is self.finger.tendon_list[0]:
            gear = drive.gear_stiffness / drive.winch_radius**2, 0.5 * drive.backlash * drive.winch_radius
        return Guided(arms, gives, tendon.friction, tendon.conduit_bend, drive is not None, gear)

    def numbers(self, gravity: tuple[float, float], places: Sequence[float], factors: Mapping[str, float]) -> Array:
        """All that the C of the motion needs to know of it: ``factors`` on what ``OF_FINGER`` names."""
        stiffness, rest, damping = self.elasticity
        weights, carried = self.inertia
        # Material damping follows from the stiffness of the section as it is described.
        scaled = factors.get("bending_stiffness", 1.0) * stiffness, factors.get("material_damping", 1.0) * damping
        base = self.finger.base
        points = [self.place(at) for at in places]
        parts: list[ArrayLike] = [
            [*base.position, base.angle, 0.5 * self.pitch, *gravity],
            weights.ravel(),
            scaled[0],
            rest,
            scaled[1],
            carried,
            self.bars,
            [point.bar for point in points],
            [point.along for point in points],
        ]
        for tendon in self.tendons:
            gives = np.zeros(self.hinges + 2)
            gives[: len(tendon.gives)] = tendon.gives
            friction = factors.get("tendon_friction", 1.0) * tendon.friction
            own = [
                tendon.guides,
                float(tendon.wound),
                float(tendon.conduit > 0.0),
                friction,
                tendon.conduit,
                *tendon.gear,
            ]
            parts += [own, tendon.arms, gives]
        return np.concatenate([np.asarray(part, dtype=float).ravel() for part in parts])
