"""A scene with one set of contacts at one place, as plain numbers in units of its fingers and its object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.rods.geometry import Geometry
from continuum_grasp.grasp.rods.rod import Course
from continuum_grasp.scene import FingerSetup

DEGREE = 4
"""Degree of the polynomials of what varies along a finger: that of the stiffness of a linear taper."""
UNIFORM = 1e6
"""Curvature limit per length above which there is none."""
REACH = 2.5
"""Half thicknesses around the object that are in its table."""


@dataclass(frozen=True, eq=False)
class WallNumbers:
    """A plane of which a finger keeps clear, in units of the finger."""

    normal: Array
    level: float  # place along the normal
    first: float = 0.0  # place along the finger from which on it keeps clear
    emerging: float | None = None
    """Level of which the finger's line keeps clear before its first contact, if its base is in the wall."""


@dataclass(frozen=True, eq=False)
class FingerNumbers:
    """A finger at its base, in units of L, E I / L^2 and E I / L."""

    setup: FingerSetup
    course: Course
    sides: tuple[float, ...]  # of the section, beyond the course
    base: Array  # place and direction (`Geometry.oriented`,)
    across: Array  # (3,) axis of bending at the base
    force: float  # [N]
    moment: float  # [N m]
    gravity: Array  # (dimensions,), of a weight per length
    load: Array  # (dimensions,) at the tip
    pulls: Array  # (2,) greatest moments of the tendons above their least tension
    offset: float  # [m]
    arm: float  # of torsional friction, per friction
    places: tuple[float, float]  # of middle contacts
    curvature_limit: float
    middles: tuple[str, ...]
    tip: str | None
    walls: tuple[WallNumbers, ...]

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.setup.finger.rod.length

    @property
    def name(self) -> str:
        """Name of the finger."""
        return self.setup.name

    @property
    def coefficients(self) -> int:
        """Coefficients of each polynomial of the course."""
        return len(self.course.half)

    @property
    def contacts(self) -> list[str]:
        """Names of its contacts, from the base on."""
        return [*self.middles, *([self.tip] if self.tip else [])]

    @staticmethod
    def of(setup: FingerSetup, on: frozenset[str], acceleration: Array, **placed: Any) -> FingerNumbers:
        """The numbers of a finger with the contacts ``on`` by name, under gravity (dimensions,) [m/s2].

        ``placed`` are the numbers that depend on where it is: base, across, sides, arm and walls.
        """
        finger, length = setup.finger, setup.finger.rod.length
        (channel,) = finger.channels
        moment = setup.stiffness / length
        force = moment / length
        gravity = acceleration / force
        tip_mass = sum(mass.mass for mass in finger.masses if abs(mass.at - length) <= 1e-9 * length)
        offset = float(channel.arms[0])
        used = np.array([finger.tendons_used in ("both", side) for side in ("left", "right")], dtype=float)
        reach = (setup.max_tension - setup.tendons.min_tension) * offset / moment
        first, last = setup.middle_bounds
        return FingerNumbers(
            setup=setup,
            course=_course(setup),
            force=force,
            moment=moment,
            gravity=gravity,
            load=tip_mass * gravity,
            pulls=reach * used,
            offset=offset,
            places=(first / length, last / length),
            curvature_limit=min(finger.curvature_limit * length, UNIFORM),
            middles=tuple(name for name in setup.middle_names if name in on),
            tip=setup.tip_name if setup.tip_name in on else None,
            **placed,
        )


def _course(setup: FingerSetup) -> Course:
    """Polynomials of what varies along a finger."""
    finger, length = setup.finger, setup.finger.rod.length
    profile = finger.profile
    (channel,) = finger.channels
    at = length * (np.linspace(0.0, 1.0, 65) if setup.graded else np.zeros(1))
    columns = (
        profile.bending_stiffness(at) / setup.stiffness,
        profile.rest_curvature(at) * length,
        channel.shape(at),
        profile.linear_density(at) * length,
        profile.half_thickness(at) / length,
    )
    fits = list[list[float]]()
    for column in columns:
        values = np.broadcast_to(np.asarray(column, float), at.shape)
        degree = DEGREE if setup.graded else 0
        fit = np.polynomial.polynomial.polyfit(at / length, values, degree)
        off = np.abs(np.polynomial.polynomial.polyval(at / length, fit) - values).max()
        # 1e-6: share of the greatest value, far below what manufacturing leaves
        if off > 1e-6 * np.abs(values).max(initial=1e-300):
            raise InputError("a finger whose section jumps along it", key=setup.where)
        fits.append(fit.tolist())
    return Course(*fits)


@dataclass(frozen=True, eq=False)
class SupportNumbers:
    """Contact of a support with an object that does not move."""

    name: str
    arm: Array  # (3,) from the center of mass [object size]
    normal: Array  # (3,)
    across: Array  # (3,) a direction along the surface
    friction: float
    most: float  # [F0]


@dataclass(frozen=True, eq=False)
class GraspAims:
    """What a grasp is to have, as prices: of the tension, per sum of the greatest ones, and of the friction margin."""

    tension: float = 1.0
    margin: float = 0.0


@dataclass(frozen=True, eq=False)
class SceneNumbers:
    """A scene with one set of contacts at one place of the object and of the bases."""

    geometry: Geometry
    fingers: list[FingerNumbers]
    supports: list[SupportNumbers]
    table: DistanceTable  # [object size]
    size: float  # [m]
    force: float  # F0 [N]
    pose: Array  # (`Geometry.pose`,), the place [object size]
    axes: Array  # (`Geometry.axes`,)
    pose_bounds: tuple[Array, Array]
    center: Array  # (3,) of mass, in the object's frame [object size]
    weight: Array  # (6,) force and moment on the object [F0, F0 size]
    balances: tuple[int, ...]  # rows of the object's balance that bind
    spatial: bool  # whether contacts exert forces out of the fingers' planes
    aims: GraspAims
    pairs: tuple[tuple[int, int], ...]  # of fingers that keep clear of each other
    penetration: float  # depth of a finger that is allowed [L]
    deviation: float = 0.0  # of the object's surface from the one that it stands for [m]
    least_normal: float = 0.0  # force of a contact of a finger [F0]

    def seen(self, finger: FingerNumbers, points: Array, pose: Array, contact: str = "") -> tuple[Array, Array]:
        """Gaps (n,) of the object at points (n, dimensions) of a finger [L], and normals (n, 3) as the hand sees them.

        With a contact, by the table around that.
        """
        d = self.geometry.dimensions
        turn: Array = np.array(self.geometry.turn(pose, self.axes))
        gap, slope = self.table.values(self.local(finger, points, pose), contact)
        normal = np.zeros((len(slope), 3))
        # 1e-30: no division by zero where a table is flat
        normal[:, :d] = slope / (np.linalg.norm(slope, axis=1, keepdims=True) + 1e-30)
        return gap * self.size / finger.length, normal @ turn.T

    def local(self, finger: FingerNumbers, points: Array, pose: Array) -> Array:
        """Points (n, dimensions) of a finger [L] in the object's frame [object size]."""
        d = self.geometry.dimensions
        turn: Array = np.array(self.geometry.turn(pose, self.axes))[:d, :d]
        return np.asarray((points * finger.length / self.size - pose[:d]) @ turn)


def unit(vector: Array) -> Array:
    """A vector of length one."""
    return np.asarray(vector / np.linalg.norm(vector))
