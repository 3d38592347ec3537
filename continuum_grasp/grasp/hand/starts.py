"""Starts of a hand: postures of each finger alone that touch, combined by the forces that hold the object.

In the plane of a finger, a round finger touches where its line touches the section of the object grown by half its
thickness: tangent along the finger, or with its end. Postures have a curvature that is linear along the finger up to
the middle contact, and constant beyond it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.shape import skin
from continuum_grasp.scene import FingerSetup

Distance = Callable[[Array], tuple[Array, Array]]
"""Distance (...,) of points (..., 3) from the object and the outward normal (..., 3), as the hand sees them."""
BENDS = 4.0
"""Greatest bend of a posture, base to tip [rad]."""
FIRST, RISES, PLACES = 81, (-2.0, -1.0, 0.0, 1.0, 2.0, 3.0), 41
"""Number of curvatures at the base, rises of curvature to the tip per bend of one radian per length, and number of
places, that are tried."""
SAMPLED = np.linspace(0.0, 1.0, PLACES + 1)[1:]
"""Places along a finger that are tried, per length."""
DEPTH = 0.03
"""Depth, per length, that a posture may have in the object beside its contacts: the solver moves it out."""
APART = 0.06
"""Difference of the places of two postures along the finger, per length, below which they may be the same."""
FINE = 257
"""Places at which the stiffness of a finger that changes along it is looked at."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


@dataclass(frozen=True)
class TouchingPosture:
    """A posture that touches, per length of the finger."""

    first: float  # curvature at the base
    rise: float  # of the curvature, per length, up to the joint
    beyond: tuple[float, float]  # curvatures beyond the joint and at the tip
    joint: float  # place of the middle contact, or half way
    score: float  # the less, the more likely

    @property
    def knots(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Places and curvatures there, linear between them."""
        at = self.first + self.rise * self.joint
        # 1e-3: the step of curvature at the joint
        return (0.0, self.joint, min(self.joint + 1e-3, 1.0), 1.0), (self.first, at, *self.beyond)

    def is_near(self, other: TouchingPosture) -> bool:
        """Whether another posture is nearly the same."""
        curved = max(abs(self.first - other.first), abs(self.beyond[1] - other.beyond[1]))
        return abs(self.joint - other.joint) < APART and curved < 0.5


STRAIGHT = TouchingPosture(0.0, 0.0, (0.0, 0.0), 0.5, 0.0)
"""A finger that touches nothing."""


class FingerPlane:
    """A finger in its plane, with lengths per its own. Its bending moment is linear, so that its curvature is a linear
    function times the mean stiffness over the stiffness of each section.
    """

    def __init__(self, setup: FingerSetup, frame: PlaneFrame, distance: Distance) -> None:
        self.setup, self.frame, self._distance = setup, frame, distance
        self.length = setup.finger.rod.length
        profile = setup.finger.profile
        self._skin = skin(profile.half_thickness)
        self._graded = profile.bending_stiffness.constant is None
        fine = np.linspace(0.0, 1.0, FINE)
        # Of each place how much its section bends per moment; integrals of that, and of it times the place.
        self._gives = (fine, setup.stiffness / profile.bending_stiffness(fine * self.length))
        self._turned = [_running(fine, self._gives[1] * power) for power in (1.0, fine)]

    def half(self, s: ArrayLike) -> Array:
        """Half the thickness."""
        return np.asarray(self._skin(np.asarray(s) * self.length) / self.length)

    def gap(self, s: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Gap of the skin at places s whose line is at points (...,), and the normal of the object in the plane."""
        points = np.stack([x, y, np.zeros_like(x)], axis=-1) * self.length
        away, normal = self._distance(self.frame.world(points))
        inside = normal @ self.frame.axes[:, :2]
        return away / self.length - self.half(s), inside[..., 0], inside[..., 1]

    def normal(self, point: Array) -> Array:
        """Outward normal (3,) of the object next to a point, as the hand sees both."""
        return np.asarray(self._distance(point[None])[1][0])

    def turn(self, first: Array, rise: Array, start: Array | float, s: Array) -> Array:
        """Turn from a place to others, of curvature (first + rise (s - start)) where the stiffness is the mean."""
        if not self._graded:
            return first * (s - start) + 0.5 * rise * (s - start) ** 2
        whole, moment = (np.interp(s, *turned) - np.interp(start, *turned) for turned in self._turned)
        return np.asarray((first - rise * start) * whole + rise * moment)

    def line(self, first: Array, rise: Array, start: Array | float, s: Array) -> tuple[Array, Array, Array]:
        """Turn and position at places s of a line from the origin along y, which begins at a place ``start``."""
        at = start + (s - start)[..., None] * _NODES
        angle = self.turn(first[..., None], rise[..., None], start, at)
        x, y = ((s - start) * (part @ _WEIGHTS) for part in (-np.sin(angle), np.cos(angle)))
        return self.turn(first, rise, start, s), x, y

    @cached_property
    def first(self) -> Array:
        """Curvatures at the base (`FIRST`,) that are tried."""
        ends = {"both": (-1.0, 1.0), "left": (0.0, 1.0), "right": (-1.0, 0.0)}[self.setup.finger.tendons_used]
        return np.linspace(BENDS * ends[0], BENDS * ends[1], FIRST)

    @cached_property
    def sampled(self) -> list[tuple[Array, Array]]:
        """Per rise of the curvature, at each of `SAMPLED` (`FIRST`, `PLACES`): the normal of the object along the line,
        and the gap.
        """
        found = []
        for rise in RISES:
            angle, x, y = self.line(self.first[:, None], np.array(rise), 0.0, SAMPLED)
            gap, nx, ny = self.gap(SAMPLED, x, y)
            found.append((ny * np.cos(angle) - nx * np.sin(angle), gap))
        return found

    def knots(self, posture: TouchingPosture) -> tuple[Array, Array]:
        """Places, and curvatures there, which are linear between them."""
        places, curvatures = (np.array(part) for part in posture.knots)
        if not self._graded:
            return places, curvatures
        fine, gives = self._gives
        at = np.union1d(places, fine)
        return at, np.interp(at, places, curvatures) * np.interp(at, fine, gives)

    def bend(self, posture: TouchingPosture) -> float:
        """Turn of the tip."""
        places, curvatures = self.knots(posture)
        return float(0.5 * (curvatures[1:] + curvatures[:-1]) @ np.diff(places))

    def place(self, posture: TouchingPosture, at: float) -> Array:
        """Position of a place of a posture, as the hand sees it (3,) [m]."""
        s = np.linspace(0.0, at, 401)
        curvature = np.interp(0.5 * (s[1:] + s[:-1]), *self.knots(posture))
        angle = np.concatenate([[0.0], np.cumsum(curvature * np.diff(s))])
        middle = 0.5 * (angle[1:] + angle[:-1])
        point = np.array([-np.sin(middle) @ np.diff(s), np.cos(middle) @ np.diff(s), 0.0])
        return self.frame.world(self.length * point)


def _running(s: Array, values: Array) -> tuple[Array, Array]:
    """Places and the integral up to them, by trapezoids."""
    return s, np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(s))])


def postures(
    plane: FingerPlane,
    middle: bool,
    tip: bool,
    most: int,
    clears: Callable[[TouchingPosture], bool] = lambda posture: True,
) -> list[TouchingPosture]:
    """The likeliest postures of a finger that touch with middle contact or tip, or both, clear the rest, and differ."""
    low, high = (s / plane.length for s in plane.setup.middle_bounds)
    found = list[TouchingPosture]()
    for rise, (lean, gap) in zip(RISES, plane.sampled, strict=True):
        if middle:
            found += _with_middle(plane, rise, gap, (low, high), tip)
        else:
            found += _with_tip(plane.first, rise, gap, lean)
    found.sort(key=lambda posture: posture.score)
    different = list[TouchingPosture]()
    for posture in found:
        if not any(posture.is_near(other) for other in different) and clears(posture):
            different.append(posture)
        if len(different) == most:
            break
    return different


def _with_tip(first: Array, rise: float, gap: Array, lean: Array) -> list[TouchingPosture]:
    """Postures whose tip comes to the surface from outside, between two curvatures."""
    found = []
    for i in np.flatnonzero((gap[:-1, -1] > 0.0) != (gap[1:, -1] > 0.0)):
        share = gap[i, -1] / (gap[i, -1] - gap[i + 1, -1])
        start = float(first[i] + share * (first[i + 1] - first[i]))
        depth = max(-float(((1.0 - share) * gap[i] + share * gap[i + 1])[:-1].min()), 0.0)
        # 0.2: of the angle at which a tip touches with its side
        if depth < DEPTH and lean[i, -1] < 0.2:
            found.append(
                TouchingPosture(start, rise, (start + 0.5 * rise, start + rise), 0.5, abs(rise) + 100.0 * depth)
            )
    return found


def _with_middle(
    plane: FingerPlane, rise: float, gap: Array, bounds: tuple[float, float], tip: bool
) -> list[TouchingPosture]:
    """Postures tangent to the surface: there the least gap along the finger changes its sign between curvatures."""
    s, first = SAMPLED, plane.first
    inside = (s[1:-1] >= bounds[0]) & (s[1:-1] <= bounds[1])
    is_least = (gap[:, 1:-1] <= gap[:, :-2]) & (gap[:, 1:-1] <= gap[:, 2:]) & inside
    least = np.where(is_least, gap[:, 1:-1], np.inf)
    at = least.argmin(axis=1) + 1
    value = least.min(axis=1)
    found = []
    for i in range(len(first) - 1):
        # 6: places by which the least gap moves between two curvatures at most
        near = np.isfinite(value[i : i + 2]).all() and abs(at[i] - at[i + 1]) < 6
        if not near or (value[i] > 0.0) == (value[i + 1] > 0.0):
            continue
        share = value[i] / (value[i] - value[i + 1])
        start = float(first[i] + share * (first[i + 1] - first[i]))
        joint = float(s[at[i]] + share * (s[at[i + 1]] - s[at[i]]))
        found += _beyond(plane, start, rise, joint, tip)
    return found


def _beyond(plane: FingerPlane, first: float, rise: float, joint: float, tip: bool) -> list[TouchingPosture]:
    """A finger that touches at a joint, continued by arcs that are clear, or whose tip touches."""
    angle, x, y = (float(part[0]) for part in plane.line(np.array([first]), np.array([rise]), 0.0, np.array([joint])))
    here = first + rise * joint
    arcs = np.linspace(-BENDS, 2.0 * BENDS, 97) if tip else here + np.array([0.3, 1.0])
    s = joint + (1.0 - joint) * np.linspace(0.15, 1.0, 8)
    turn, dx, dy = plane.line(arcs[:, None], np.array([[0.0]]), joint, s)
    c, n = np.cos(angle), np.sin(angle)
    gap, nx, ny = plane.gap(s, x + c * dx - n * dy, y + n * dx + c * dy)
    early = joint * np.linspace(0.05, 0.9, 8)
    _, bx, by = plane.line(np.array([first]), np.array([rise]), 0.0, early)
    before = max(-float(plane.gap(early, bx, by)[0].min()), 0.0)
    if not tip:
        depths = [max(before, -float(row.min())) for row in gap]
        return [
            TouchingPosture(first, rise, (float(arc),) * 2, joint, 0.5 * abs(rise) + 100.0 * depth)
            for arc, depth in zip(arcs, depths, strict=True)
            if depth < DEPTH
        ]
    found = []
    lean = nx[:, -1] * -np.sin(angle + turn[:, -1]) + ny[:, -1] * np.cos(angle + turn[:, -1])
    for j in np.flatnonzero((gap[:-1, -1] > 0.0) != (gap[1:, -1] > 0.0)):
        share = gap[j, -1] / (gap[j, -1] - gap[j + 1, -1])
        arc = float(arcs[j] + share * (arcs[j + 1] - arcs[j]))
        depth = max(before, -float(((1.0 - share) * gap[j] + share * gap[j + 1])[:-1].min()))
        if depth < DEPTH and lean[j] < 0.2:
            score = 0.5 * abs(rise) + abs(arc - here) + 100.0 * depth
            found.append(TouchingPosture(first, rise, (arc, arc), joint, score))
    return found
