"""What the plots ask of the results they draw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from numpy.typing import ArrayLike, NDArray

__all__ = ["DrawableControl", "DrawableModes", "DrawableTrajectory"]


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
    def object_pose(self) -> NDArray[Any] | None:
        """Pose of the object (T, 3 or 4): x, y [m], angle [rad]; None without one."""

    @property
    def contacts(self) -> Any:
        """Its contacts: ``names``, ``normal_force`` and ``shear`` (T, K) [N]; None without an object."""

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


class DrawableControl(Protocol):
    """A closed loop of K control periods; SI units, world frame."""

    @property
    def t(self) -> NDArray[Any]:
        """Instants (K + 1,) [s]."""

    @property
    def u(self) -> NDArray[Any]:
        """Commands (K, nu)."""

    @property
    def u_names(self) -> Sequence[str]:
        """Name and unit of each command."""

    @property
    def u_min(self) -> NDArray[Any]:
        """Least commands (nu,)."""

    @property
    def u_max(self) -> NDArray[Any]:
        """Greatest commands (nu,)."""

    @property
    def r(self) -> NDArray[Any]:
        """Set-points (K + 1, nr)."""

    @property
    def tracked(self) -> NDArray[Any]:
        """What they are for (K + 1, nr)."""

    @property
    def r_names(self) -> Sequence[str]:
        """Name and unit of each set-point."""

    @property
    def tracked_groups(self) -> Sequence[Any]:
        """Columns of tracked quantities by cost term, each with ``unit`` and ``columns``."""

    @property
    def tip(self) -> NDArray[Any]:
        """Tip positions (K + 1, 2) [m]."""

    @property
    def tip_reference(self) -> NDArray[Any] | None:
        """Set-points of the tip (K + 1, 2) [m], where there are any."""

    @property
    def plan_tip(self) -> NDArray[Any]:
        """Predicted tip paths (K, N + 1, 2) [m]."""

    @property
    def bounds(self) -> Sequence[Any]:
        """Bounds with name, unit, excess (K + 1,) and scale."""

    @property
    def disturbance_names(self) -> Sequence[str]:
        """Name and unit of each estimated disturbance."""

    @property
    def disturbance(self) -> NDArray[Any]:
        """Estimated disturbances (K, nd)."""

    @property
    def disturbance_std(self) -> NDArray[Any]:
        """Their standard deviations (K, nd)."""

    @property
    def phase_names(self) -> Sequence[str]:
        """Names of the phases of a step."""

    @property
    def phase_times(self) -> NDArray[Any]:
        """Time that each took (K, phases) [s]."""

    @property
    def length(self) -> float:
        """Length of the finger [m]."""

    @property
    def scene(self) -> Any:
        """The scene, with ``controller.bounds.keep_out`` and ``finger.masses``."""

    @property
    def object_pose(self) -> NDArray[Any] | None:
        """Pose of the object (T, 3 or 4): x, y [m], angle [rad]; None without one."""

    @property
    def contacts(self) -> Any:
        """Its contacts: ``names``, ``normal_force`` and ``shear`` (T, K) [N]; None without an object."""

    @property
    def name(self) -> str | None:
        """Title of the pictures."""

    def backbone(self, indices: ArrayLike, points: int = 50) -> NDArray[Any]:
        """Backbones (len(indices), points, 2) of the plant [m]."""
