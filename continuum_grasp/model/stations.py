"""Stations of a finger, its possible places of contact, and the forces on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from continuum_grasp.model.planar import ZERO, Scalar, Vec


@dataclass(frozen=True)
class Station:
    """A disc of the finger: world center, radius [m], velocity of the center, and angular velocity.

    ``turns``: by the couple of its force, too.
    """

    name: str
    center: Vec
    radius: float
    velocity: Vec = ZERO
    spin: Scalar = 0.0
    turns: bool = True


class Touched:
    """States and inputs of what a finger touches, and forces on its stations; here nothing."""

    def __init__(self) -> None:
        self.pairs: list[Any] = []  # surfaces that can touch
        self.press = ca.SX(0, 1)  # run-time reductions of their gaps [m]
        self.states, self.names = ca.SX(0, 1), list[str]()  # further states, and name and unit of each
        self.wrench, self.w_names = ca.SX(0, 1), list[str]()  # further inputs
        self.start: list[float] = []  # the first of the states at time zero: the pose of what moves

    @property
    def on_stations(self) -> list[tuple[Vec, Scalar]]:
        """Return the world force on each station [N], and its couple about the center line if it bends the finger [N
        m].
        """
        return []

    def rates(self, gravity: Vec) -> list[Scalar]:
        """Rates of the states, under gravity in the plane [m/s2]."""
        return []

    def energy(self, gravity: Vec) -> tuple[Scalar, Scalar]:
        """Kinetic and potential energy [J]."""
        return 0.0, 0.0


Touches = Callable[[Sequence[Station], Mapping[str, Scalar], bool], Touched]
"""Maker of what a finger touches: of its stations, run-time arguments by name, and whether gaps are pressed."""


def touching_nothing(stations: Sequence[Station], given: Mapping[str, Scalar], pressed: bool) -> Touched:
    """The finger touches nothing."""
    return Touched()
