"""What the plots ask of the results they draw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from numpy.typing import ArrayLike, NDArray

__all__ = ["DrawableModes", "DrawableTrajectory"]


class DrawableTrajectory(Protocol):
    """A motion of the finger at T instants; SI units, world frame."""

    @property
    def t(self) -> NDArray[Any]:
        """Instants (T,) [s]."""

    @property
    def x(self) -> NDArray[Any]:
        """States (T, nx): bending coordinates, then their rates."""

    @property
    def tip(self) -> NDArray[Any]:
        """Tip positions (T, 2) [m]."""

    @property
    def kinetic(self) -> NDArray[Any]:
        """Kinetic energy (T,) [J]."""

    @property
    def potential(self) -> NDArray[Any]:
        """Potential energy, elastic and of gravity (T,) [J]."""

    @property
    def n(self) -> int:
        """Number of bending coordinates."""

    @property
    def x_names(self) -> Sequence[str]:
        """Name and unit of each state, as ``"name [unit]"``."""

    @property
    def length(self) -> float:
        """Length of the finger [m]."""

    @property
    def scene(self) -> Any:
        """What was simulated; where it has ``finger.masses``, they are drawn."""

    @property
    def name(self) -> str | None:
        """Title of the pictures."""

    def backbone(self, indices: ArrayLike, points: int = 50) -> NDArray[Any]:
        """Backbones (len(indices), points, 2), evenly spaced from base to tip [m]."""

    def loads_at(self, index: int) -> Sequence[tuple[NDArray[Any], NDArray[Any], str]]:
        """Forces at one instant: position (2,) [m], force (2,) [N], and what kind it is."""


class DrawableModes(Protocol):
    """Small oscillations about an equilibrium."""

    @property
    def frequencies_hz(self) -> NDArray[Any]:
        """Natural frequencies (m,) [Hz]."""

    @property
    def damping_ratios(self) -> NDArray[Any]:
        """Damping ratios (m,) [1]."""

    @property
    def backbone(self) -> NDArray[Any]:
        """Backbone in equilibrium (points, 2) [m]."""

    @property
    def shapes(self) -> NDArray[Any]:
        """Displacements (m, points, 2), each of greatest length one."""

    @property
    def stable(self) -> bool:
        """Whether the equilibrium is stable."""
