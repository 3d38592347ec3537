"""A finger as a chain of hinges: bars with its inertia, its elasticity, and tendons with a guide at every hinge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.arrays import Array
from continuum_grasp.closed_loop.links import Links, lump
from continuum_grasp.model.winches import Motor, winches_of
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.tendons import Tendon

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
        """Number of guides."""
        return len(self.gives) - 1


class HingeChain:
    """The numbers of a chain of N hinges in equal parts of the finger, each with the bend of its part.

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
