"""How far a disturbance may grow until a contact slips, parts or is pressed too hard, or a tendon is at its limit.

The fingers give way as `continuum_grasp.grasp.response` says: to first order, contacts sticking until the first one
does not. Forces out of the plane stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.conic_program import Cones, solve_conic
from continuum_grasp.grasp.response import Change, GraspResponse, Tendons
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

__all__ = ["Resistance", "resistance", "resistance_polygon"]

Array = NDArray[Any]

UNLIMITED = 1e4
"""A disturbance that makes forces this many times the greatest limit of a contact is not limited."""
_ACTIVE = 1e-6
"""Part of the force scale within which a limit counts as reached."""


@dataclass(frozen=True)
class Resistance:
    """Answer of `resistance`.

    Attributes
    ----------
    wrenches : ndarray, shape (K, 3)
        Disturbances: force x, y [N] and moment about the centre of mass [N m].
    factors : ndarray, shape (K,)
        Greatest multiple of each that the grasp resists [1]; infinite where nothing limits it, zero where the grasp is
        unstable or beyond a limit by itself.
    limiting : tuple of tuple of str
        What stops each from growing.
    tendons : {"retensioned", "locked"}
        Whether tensions are chosen anew for each disturbance, or tendons keep their lengths.
    stable : bool
        Whether the grasp is stable with its tendons so.
    """

    wrenches: Array
    factors: Array
    limiting: tuple[tuple[str, ...], ...]
    tendons: Tendons
    stable: bool

    @property
    def least(self) -> float:
        """Least of the factors; infinite without disturbances."""
        return float(self.factors.min(initial=math.inf))


def resistance(
    scene: GraspScene,
    arrays: Mapping[str, Any],
    *,
    wrenches: Sequence[Sequence[float]] | None = None,
    tendons: Tendons | None = None,
    response: GraspResponse | None = None,
) -> Resistance:
    """Greatest multiples of disturbances that a grasp resists, one disturbance at a time.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp.
    wrenches : sequence of (float, float, float), optional
        Force x, y [N] and moment about the centre of mass [N m]; those of the scene where not given.
    tendons : {"retensioned", "locked"}, optional
        As the scene says where not given.
    response : GraspResponse, optional
        Of the same grasp, where it is at hand.
    """
    kind: Tendons = tendons or scene.disturbances.tendons
    given = np.asarray(scene.wrenches if wrenches is None else wrenches, dtype=float).reshape(-1, 3)
    response = response or GraspResponse(scene, arrays)
    if not response.stable(kind):
        return Resistance(given, np.zeros(len(given)), (("unstable",),) * len(given), kind, False)
    limits = _Limits(response, kind)
    answers = [limits.greatest(wrench) for wrench in given]
    return Resistance(
        given, np.array([factor for factor, _ in answers]), tuple(what for _, what in answers), kind, True
    )


def resistance_polygon(
    scene: GraspScene,
    arrays: Mapping[str, Any],
    directions: int = 36,
    *,
    tendons: Tendons | None = None,
    response: GraspResponse | None = None,
) -> Array:
    """Greatest pure forces at the centre of mass that a grasp resists, in directions all round, shape (D, 2) [N].

    Parameters
    ----------
    scene, arrays, tendons, response
        As in `resistance`.
    directions : int, optional
        Number D of directions, evenly spread from +x counter-clockwise.
    """
    turns = 2.0 * np.pi * np.arange(directions) / directions
    units = np.stack([np.cos(turns), np.sin(turns), np.zeros(directions)], axis=1)
    found = resistance(scene, arrays, wrenches=units.tolist(), tendons=tendons, response=response)
    return np.asarray(found.factors[:, None] * units[:, :2])


class _Limits:
    """Limits of contact forces and tensions along the response."""

    def __init__(self, response: GraspResponse, tendons: Tendons) -> None:
        contacts = response.contacts
        self.names, self.setups = contacts.names, response.setups
        self.tendons: Tendons = tendons
        self.unit: Change = response.to_wrenches(tendons)
        self.forces = contacts.forces
        self.friction, self.normal_max = contacts.friction, contacts.normal_max
        self.scale = max(float(np.abs(contacts.forces).max(initial=0.0)), 1e-3 * float(contacts.normal_max.max()))
        slack = _ACTIVE * self.scale
        over = np.hypot(self.forces[:, 1], self.forces[:, 2]) - self.friction * self.forces[:, 0]
        self.room = np.where((over > 0.0) & (over < 10.0 * slack), over, 0.0)  # what rounding put outside is let be
        self.low = np.where(self.forces[:, 0] > -slack, np.minimum(self.forces[:, 0], 0.0), 0.0)
        near = self.forces[:, 0] < self.normal_max + slack
        self.high = np.where(near, np.maximum(self.normal_max, self.forces[:, 0]), self.normal_max)
        ranges = [
            _difference_range(setup, pair, tendons) for setup, pair in zip(self.setups, response.tensions, strict=True)
        ]
        self.ranges = np.array(ranges).reshape(-1, 2)
        self.retensioning = response.to_tensions().forces if tendons == "retensioned" else None
        self._cuts: list[tuple[int, Array]] | None = None

    def greatest(self, wrench: Array) -> tuple[float, tuple[str, ...]]:
        """Greatest factor of a wrench and what limits it."""
        along = self.unit.forces @ wrench
        if self.retensioning is None:
            return self._ray(along, self.unit.differences @ wrench)
        return self._programme(along)

    def _ray(self, along: Array, differences: Array) -> tuple[float, tuple[str, ...]]:
        """Forces and tensions change in proportion: the first limit that is met."""
        if (np.hypot(*self.forces[:, 1:].T) > self.friction * self.forces[:, 0] + self.room).any():
            return 0.0, self._reached(self.forces, np.zeros(len(self.setups)))
        ways = [math.inf]
        for k in range(len(self.names)):
            dn, df = along[k]
            ways.append(_way(self.forces[k, 0], dn, self.low[k], self.high[k]))
            ways.append(_cone_way(self.forces[k], dn, df, self.friction[k], self.room[k]))
        ways += [_way(0.0, d, a, b) for d, (a, b) in zip(differences, self.ranges, strict=True)]
        factor = max(0.0, min(ways))
        if factor * max(float(np.abs(along).max(initial=0.0)), 1e-300) > UNLIMITED * float(self.normal_max.max()):
            return math.inf, ()
        forces = self.forces.copy()
        forces[:, :2] += factor * along
        return factor, self._reached(forces, factor * differences)

    def _programme(self, along: Array) -> tuple[float, tuple[str, ...]]:
        """Tensions are free within their limits: the greatest factor by a conic programme over it and them."""
        count, free = len(self.names), np.flatnonzero(self.ranges[:, 1] > self.ranges[:, 0])
        size = 1 + free.size
        effect = np.zeros((count, 2, size))
        reach = float(np.abs(along).max(initial=0.0))
        if reach == 0.0 or self.retensioning is None:
            return math.inf, ()
        unit = self.scale / reach
        spans = np.abs(self.ranges[free]).max(axis=1)
        effect[:, :, 0] = along * unit / self.scale
        effect[:, :, 1:] = self.retensioning[:, :, free] * spans / self.scale
        matrix = np.zeros((count, 2, size))
        matrix[:, 0] = effect[:, 1]
        offset = self.forces[:, 1:] / self.scale
        width = self.friction[:, None] * effect[:, 0]
        room = (self.friction * self.forces[:, 0] + self.room) / self.scale
        cones = Cones.made(matrix, offset, width, room)
        if self._cuts is not None:
            cones.cuts = list(self._cuts)
        lower = np.concatenate([[0.0], self.ranges[free, 0] / spans])
        most = UNLIMITED * float(self.normal_max.max()) / self.scale
        upper = np.concatenate([[most], self.ranges[free, 1] / spans])
        cost = np.zeros(size)
        cost[0] = -1.0
        normal = self.forces[:, 0]
        found = solve_conic(
            cost, effect[:, 0], (self.low - normal) / self.scale, (self.high - normal) / self.scale, lower, upper, cones
        )
        if found.status == "infeasible":
            return 0.0, self._reached(self.forces, np.zeros(len(self.setups)))
        if not found.optimal:
            return math.nan, ("not computed",)
        self._cuts = cones.cuts
        if found.x[0] >= most * (1.0 - 1e-9):
            return math.inf, ()
        forces = self.forces.copy()
        forces[:, :2] += self.scale * (effect @ found.x)
        changes = np.zeros(len(self.setups))
        changes[free] = found.x[1:] * spans
        return float(found.x[0] * unit), self._reached(forces, changes)

    def _reached(self, forces: Array, changes: Array) -> tuple[str, ...]:
        """Names of the limits that are reached or passed."""
        slack, words = _ACTIVE * max(self.scale, float(np.abs(forces).max(initial=0.0))), []
        for k, name in enumerate(self.names):
            normal, friction, lift = forces[k]
            if normal <= self.low[k] + slack:
                words.append(f"{name} parts")
            elif math.hypot(friction, lift) >= self.friction[k] * normal + self.room[k] - slack:
                words.append(f"{name} slips")
            if normal >= self.high[k] - slack:
                words.append(f"{name} is pressed too hard")
        for setup, change, (least, most) in zip(self.setups, changes, self.ranges, strict=True):
            if change <= least + _ACTIVE * (most - least) or change >= most - _ACTIVE * (most - least):
                words.append(f"{setup.name} is at its tension limit")
        return tuple(words)


def _difference_range(setup: FingerSetup, tensions: Array, tendons: Tendons) -> tuple[float, float]:
    """By how much tension 1 less tension 2 may change [N].

    Locked antagonists share a change equally, until one would fall below the least tension; it stays there and the
    other takes the rest.
    """
    held = setup.finger.tendons
    if held is None:
        return 0.0, 0.0
    least, most, used = held.min_tension, held.max_tension, setup.finger.tendons_used
    now = float(tensions[0] - tensions[1])
    if used != "both":
        low, high = (least - now, most - now) if used == "left" else (-most - now, -least - now)
    elif tendons == "retensioned":
        low, high = least - most - now, most - least - now
    else:
        spare = np.maximum(most - tensions, 0.0), np.maximum(tensions - least, 0.0)
        high = float(min(2.0 * spare[0][0], spare[0][0] + spare[1][1]))
        low = -float(min(2.0 * spare[0][1], spare[0][1] + spare[1][0]))
    return min(low, 0.0), max(high, 0.0)


def _way(value: float, rate: float, low: float, high: float) -> float:
    """How far a value that changes at a rate may go."""
    if rate == 0.0:
        return math.inf
    return float(max(0.0, ((high if rate > 0.0 else low) - value) / rate))


def _cone_way(force: Array, dn: float, df: float, friction: float, room: float) -> float:
    """Least factor at which (N + x dn, f + x df, lift) leaves the friction cone; it starts within."""
    normal, sideways, lift = force
    width = friction * normal + room
    if lift == 0.0:
        rates = ((df - friction * dn, width - sideways), (-df - friction * dn, width + sideways))
        return float(min((max(0.0, left) / rate for rate, left in rates if rate > 0.0), default=math.inf))
    a = df**2 - (friction * dn) ** 2
    b = sideways * df - width * friction * dn
    c = min(0.0, sideways**2 + lift**2 - width**2)
    if c == 0.0 and (b > 0.0 or (b == 0.0 and a > 0.0)):
        return 0.0
    open_side = -1e-12 * abs(width)
    return float(
        min((x for x in _roots(a, b, c) if x > 0.0 and width + x * friction * dn >= open_side), default=math.inf)
    )


def _roots(a: float, b: float, c: float) -> list[float]:
    """Roots of a x^2 + 2 b x + c, computed without cancellation."""
    square = b * b - a * c
    if square < 0.0 or (a == 0.0 and b == 0.0):
        return []
    q = -(b + math.copysign(math.sqrt(square), b))
    return [*([q / a] if a != 0.0 else []), *([c / q] if q != 0.0 else [])]
