"""Result of closing a grasp: the steps, the touches in order, and the outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from continuum_grasp.arrays import Array


class ClosingStatus(StrEnum):
    """Outcome of a path."""

    REACHED = "reached"
    """At the grasp."""
    ELSEWHERE = "elsewhere"
    """With all tension, but in another posture."""
    PUSHED = "pushed"
    """The object was moved away."""
    NOT_OPEN = "not_open"
    """The fingers cannot be opened enough to begin beside the object."""
    STOPPED = "stopped"
    """The solver found no next step: the fingers snap, or are jammed."""


@dataclass(frozen=True)
class Touch:
    """A place that begins or ceases to touch.

    Attributes
    ----------
    finger : str
    station : float
        Position along the finger [m].
    share : float
        Of the tensions of the grasp.
    on : bool
        False: it lifts off.
    """

    finger: str
    station: float
    share: float
    on: bool

    def __str__(self) -> str:
        return (
            f"{self.finger} {'touches' if self.on else 'lifts off'} at {1e3 * self.station:.0f} mm ({self.share:.0%})"
        )


@dataclass(frozen=True)
class ClosingPath:
    """Path of fingers that close on an object.

    Attributes
    ----------
    status : ClosingStatus
    message : str
    shares : ndarray, shape (K,)
        Tensions of the steps, per those of the grasp; negative while the fingers are opened by the other tendons.
    tensions : dict of str to ndarray, shape (K, 2)
        Per finger [N].
    stations : dict of str to ndarray, shape (S,)
        Places that may touch [m].
    lines : dict of str to ndarray, shape (K, S + 1, 2)
        World positions of the base and of these places [m].
    normal_forces, friction_forces : dict of str to ndarray, shape (K, S)
        At these places [N]; friction along the object's normal turned by +90 degrees, on the finger.
    poses : ndarray, shape (K, 3)
        World pose of the object [m, rad].
    wrenches : ndarray, shape (K, 3)
        What the fingers do to the object: world force [N] and moment about its center of mass [N m].
    touches : tuple of Touch
        In order.
    distance : float
        Greatest distance of a place from the grasp at the end [m].
    """

    status: ClosingStatus
    message: str
    shares: Array
    tensions: Mapping[str, Array]
    stations: Mapping[str, Array]
    lines: Mapping[str, Array]
    normal_forces: Mapping[str, Array]
    friction_forces: Mapping[str, Array]
    poses: Array
    wrenches: Array
    touches: tuple[Touch, ...]
    distance: float

    @property
    def reached(self) -> bool:
        """Whether the path ends at the grasp."""
        return self.status is ClosingStatus.REACHED
