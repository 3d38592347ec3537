"""Tendons of a finger, with a guide at each hinge of its chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model import Motor, Winch
from continuum_grasp.scene import Finger


@dataclass(frozen=True)
class Guided:
    """A tendon and its guides from the drum on: the guide of a conduit, if any, then one per hinge up to its end.

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


def guided_tendons(finger: Finger, at: Array, axial_stiffness: float | None) -> list[Guided]:
    """Tendons of a finger with guides at places [m]; ``axial_stiffness`` [N] is of those whose tension is commanded."""
    length = finger.rod.length
    motors = [winch for winch in Winch.of_finger(finger) if isinstance(winch, Motor)]
    gears = {
        motor.tendons[0]: (gear[0] / motor.radius**2, gear[1] * motor.radius)
        for motor in motors
        if (gear := motor.gear)
    }
    tendons = []
    for k, tendon in enumerate(finger.tendon_list):
        to = tendon.end(length)
        arms = tendon.arm(length) * tendon.shape(length)(at, tip_side=True)
        stiffness = tendon.axial_stiffness or axial_stiffness or np.inf
        free = 0.0 if tendon.series_stiffness is None else 1.0 / tendon.series_stiffness
        pieces = np.diff([0.0, *at[at < to], to]) / stiffness
        conduit = tendon.conduit_bend > 0.0
        # Without a conduit the first piece is one with what gives beyond it.
        parts = [free, *pieces] if conduit else [free + pieces[0], *pieces[1:]]
        gives = np.array(parts)
        gear = gears.get(k, (0.0, 0.0))
        tendons.append(Guided(arms, gives, tendon.friction, tendon.conduit_bend, tendon.drive is not None, gear))
    return tendons
