"""A scene with one set of contacts at one place, as plain numbers in units of its fingers and its object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.drives import DriveNumbers, drives_of
from continuum_grasp.grasp.rods.object_numbers import ObjectNumbers
from continuum_grasp.grasp.rods.obstacles import FingerObstacle
from continuum_grasp.grasp.rods.rod import THICKNESS, half_thickness
from continuum_grasp.grasp.rods.supports import SupportNumbers
from continuum_grasp.model import Section, SectionPull
from continuum_grasp.scene import FingerSetup

UNIFORM = 1e6
"""Curvature limit per length above which there is none."""
REACH = 2.5
"""Half thicknesses around the object that are in its table."""


@dataclass(frozen=True, eq=False)
class FingerNumbers:
    """A finger at its base, in units of its section."""

    setup: FingerSetup
    section: Section
    sides: tuple[float, ...]  # stiffnesses out of the plane of bending, per that of bending
    base: Array  # place and direction (`Geometry.oriented`,)
    base_bounds: tuple[Array, Array]  # within which they may be
    across: Array  # (3,) axis of bending at the base
    gravity: Array  # (dimensions,) [m/s2]
    history: Array  # of its friction: a row for each of as many cells of the same number of stages
    pulls: Array  # (pulls,) greatest ones
    arm: float  # of torsional friction, per friction
    friction: float  # coefficient, less the reserve
    places: tuple[tuple[float, float], ...]  # bounds of each middle contact
    curvature_limit: float  # where the elastic section is deepest
    middles: tuple[str, ...]
    tip: str | None
    obstacles: tuple[FingerObstacle, ...]
    drives: tuple[DriveNumbers, ...] = ()

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.section.length

    @property
    def force(self) -> float:
        """Unit of forces [N]."""
        return self.section.force

    @property
    def moment(self) -> float:
        """Unit of moments [N m]."""
        return self.section.moment

    @property
    def load(self) -> Array:
        """Force at the tip of the weight of the finger and of all masses (dimensions,)."""
        return self.section.mass * self.gravity

    @property
    def at_tip(self) -> Array:
        """Numbers of the body fastened to the tip: mass times where its center is (2,), and gravity (dimensions,)."""
        return np.array([*self.section.tip_arms, *self.gravity])

    @property
    def name(self) -> str:
        """Name of the finger."""
        return self.setup.name

    @property
    def contacts(self) -> list[str]:
        """Names of its contacts, from the base on."""
        return [*self.middles, *([self.tip] if self.tip else [])]

    def history_at(self, along: float) -> Array:
        """History in the stage that begins at a share of all stages."""
        # 1e-6: rounding of the share
        return np.asarray(self.history[int(along * len(self.history) + 1e-6)])

    def acting(self, piece: int, along: float = 0.0) -> Array:
        """Numbers of what acts in the stage that begins at a share of all stages, without its force and pulls."""
        return np.array([*self.gravity, *self.history_at(along), *self.section.numbers(piece), *self.sides])

    def thickness(self, piece: int) -> Array:
        """Numbers of the half thickness on a piece (`THICKNESS`,)."""
        return np.array([self.section.places[piece], *self.section.half_thickness(piece)])

    def depth(self, piece: int) -> Array:
        """Numbers of half the depth of the elastic section on a piece, per its greatest (`THICKNESS`,)."""
        numbers = np.zeros(THICKNESS)
        start, end = self.section.places[piece : piece + 2]
        numbers[:2] = start, 1.0
        curve = self.setup.finger.profile.half_depth
        if curve is not None:
            k = int(np.searchsorted(curve.edges, 0.5 * (start + end) * self.length)) - 1
            coefficients = np.asarray(curve.local(k, start * self.length).coef, dtype=float) / curve.most()
            numbers[1 : 1 + len(coefficients)] = coefficients * self.length ** np.arange(len(coefficients))
        return numbers

    def half(self, s: Any) -> Array:
        """Half thickness at places along the finger, as many as there are."""
        places = np.asarray(s, dtype=float)
        pieces = np.minimum(np.searchsorted(self.section.places[1:], places), len(self.section.pieces) - 1)
        values = np.zeros(places.shape)
        for piece in np.unique(pieces).tolist():
            on = pieces == piece
            values[on] = half_thickness(self.thickness(piece), places[on])
        return values

    def tensions(self, x: Array) -> Array:
        """Tensions [N], or pressures [Pa] of chambers, of pulls (pulls,)."""
        return np.array([pull.value(value) for pull, value in zip(self.section.pulls, x, strict=True)])

    @staticmethod
    def of(
        setup: FingerSetup, on: frozenset[str], acceleration: Array, *, paths: bool = False, **placed: Any
    ) -> FingerNumbers:
        """The numbers of a finger with the contacts ``on`` by name, under gravity (dimensions,) [m/s2]; with the
        ``paths`` of tendons among its states, if asked for.

        ``placed`` has the numbers that depend on the finger's place: base, its bounds, across, sides, arm and
        obstacles.
        """
        finger = setup.finger
        section = Section.of(finger, paths=paths)
        bounds = dict(zip(setup.middle_names, setup.contact_bounds, strict=True))
        middles = tuple(name for name in setup.middle_names if name in on)
        return FingerNumbers(
            setup=setup,
            section=section,
            gravity=acceleration,
            history=section.pulled[None],
            pulls=np.array([_greatest(setup, pull) for pull in section.pulls]),
            friction=setup.held_friction,
            places=tuple(
                (low / section.length, high / section.length) for low, high in (bounds[name] for name in middles)
            ),
            curvature_limit=min(finger.curvature_limit * section.length, UNIFORM),
            middles=middles,
            tip=setup.tip_name if setup.tip_name in on else None,
            drives=drives_of(setup, section),
            **placed,
        )


def _greatest(setup: FingerSetup, pull: SectionPull) -> float:
    """Greatest value of a pull: none of a tendon that is not used, no more than a motor pulls."""
    if setup.finger.tendons_used not in ("both", "left" if pull.side > 0.0 else "right"):
        return 0.0
    return min(pull.most, setup.max_tension / pull.unit - pull.least)


@dataclass(frozen=True, eq=False)
class GraspAims:
    """Aims of a grasp as costs: of the tension, per sum of the greatest ones, of the friction margin, and of the
    greatest normal force, per F0.
    """

    tension: float = 1.0
    margin: float = 0.0
    normal: float = 0.0


@dataclass(frozen=True, eq=False)
class SceneNumbers(ObjectNumbers):
    """A scene with one set of contacts at one place of the object and of the bases."""

    fingers: list[FingerNumbers]
    supports: list[SupportNumbers]
    force: float  # F0 [N]
    pose: Array  # (`Geometry.pose`,), the place [object size]
    pose_bounds: tuple[Array, Array]
    weight: Array  # (6,) force and moment on the object [F0, F0 size]
    balances: tuple[int, ...]  # rows of the object's balance that bind
    spatial: bool  # whether contacts exert forces out of the fingers' planes
    aims: GraspAims
    pairs: tuple[tuple[int, int], ...]  # of fingers that keep clear of each other
    penetration: float  # depth of a finger that is allowed [L]
    deviation: float = 0.0  # of the object's surface from the one that it stands for [m]
    least_normal: float = 0.0  # force of a contact of a finger [F0]
    reserve: float = 0.0  # share of all friction that stays free

    def unit(self, contact: str) -> float:
        """Unit of the force of a contact by name [F0]."""
        return next((finger.force for finger in self.fingers if contact in finger.contacts), self.force) / self.force

    def friction(self, contact: str) -> float:
        """Friction coefficient of a contact by name, with the reserve."""
        held = {support.name: support.friction for support in self.supports}
        held |= {name: finger.setup.held_friction for finger in self.fingers for name in finger.contacts}
        return held[contact] / (1.0 - self.reserve)

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
