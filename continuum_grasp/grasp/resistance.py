"""How far a disturbance may grow until a contact slips, parts or is pressed too hard, a tendon is at its limit, or the
grasp gives way too much.

The fingers move as `continuum_grasp.grasp.response` says: to first order, contacts sticking until the first one does
not. What soft fingers do far from the stored grasp it cannot tell, so how far things move is limited too. Forces out of
the plane stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.conic_program import Cones, solve_conic
from continuum_grasp.grasp.ray import way, way_in_cone
from continuum_grasp.grasp.response import Change, GraspResponse, Tendons
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

__all__ = ["Resistance", "resistance", "resistance_polygon"]

Array = NDArray[Any]

UNLIMITED = 1e4
"""A disturbance that makes forces this many times the greatest limit of a contact is not limited."""
GIVE = 0.1
"""Greatest motion of the object: as a part of its size, and in rad; finger tips may turn `TURN` times as much."""
TURN = 3.0
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
    motions : ndarray, shape (K, 3)
        How far the object moves on the way there: centre of mass [m], angle [rad]; NaN where not limited.
    tendons : {"retensioned", "locked"}
        Whether tensions are chosen anew for each disturbance, or tendons keep their lengths.
    stable : bool
        Whether the grasp is stable with its tendons so.
    """

    wrenches: Array
    factors: Array
    limiting: tuple[tuple[str, ...], ...]
    motions: Array
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
    give: float | None = GIVE,
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
    give : float or None, optional
        Greatest motion of the object, as a part of its size and in rad; finger tips may turn three times as much. None:
        no limit, which takes the first order at its word.
    response : GraspResponse, optional
        Of the same grasp, where it is at hand.
    """
    kind: Tendons = tendons or scene.disturbances.tendons
    given = np.asarray(scene.wrenches if wrenches is None else wrenches, dtype=float).reshape(-1, 3)
    response = response or GraspResponse(scene, arrays)
    count = len(given)
    if not response.stable(kind):
        return Resistance(given, np.zeros(count), (("unstable",),) * count, np.zeros((count, 3)), kind, False)
    limits = _Limits(response, kind, math.inf if give is None else give)
    answers = [limits.greatest(wrench) for wrench in given]
    return Resistance(
        given,
        np.array([answer[0] for answer in answers]),
        tuple(answer[1] for answer in answers),
        np.array([answer[2] for answer in answers]).reshape(count, 3),
        kind,
        True,
    )


def resistance_polygon(
    scene: GraspScene,
    arrays: Mapping[str, Any],
    directions: int = 36,
    *,
    tendons: Tendons | None = None,
    give: float | None = GIVE,
    response: GraspResponse | None = None,
) -> Array:
    """Greatest pure forces at the centre of mass that a grasp resists, in directions all round, shape (D, 2) [N].

    Parameters
    ----------
    scene, arrays, tendons, give, response
        As in `resistance`.
    directions : int, optional
        Number D of directions, evenly spread from +x counter-clockwise.
    """
    turns = 2.0 * np.pi * np.arange(directions) / directions
    units = np.stack([np.cos(turns), np.sin(turns), np.zeros(directions)], axis=1)
    found = resistance(scene, arrays, wrenches=units.tolist(), tendons=tendons, give=give, response=response)
    return np.asarray(found.factors[:, None] * units[:, :2])


_Answer = tuple[float, tuple[str, ...], Array]
_NOWHERE = np.full(3, np.nan)


class _Limits:
    """Limits of contact forces, tensions and motions along the response."""

    def __init__(self, response: GraspResponse, tendons: Tendons, give: float) -> None:
        contacts = response.contacts
        self.names, self.setups = contacts.names, response.setups
        self.unit: Change = response.to_wrenches(tendons)
        self.retensioned: Change | None = response.to_tensions() if tendons == "retensioned" else None
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
        size = response.scene.object.size
        self.reach = give * np.array([size, size, 1.0, *(TURN for _ in self.setups)])
        """Greatest motions of the object and turns of the tips."""
        self._cuts: list[tuple[int, Array]] | None = None

    def greatest(self, wrench: Array) -> _Answer:
        """Greatest factor of a wrench, what limits it, and the motion of the object there."""
        along = self.unit.forces @ wrench
        motion = np.concatenate([self.unit.pose @ wrench, self.unit.bends @ wrench])
        if self.retensioned is None:
            return self._ray(along, self.unit.differences @ wrench, motion)
        return self._programme(along, motion, self.retensioned)

    def _ray(self, along: Array, differences: Array, motion: Array) -> _Answer:
        """Forces and tensions change in proportion: the first limit that is met."""
        still = np.zeros(len(self.setups))
        if (np.hypot(*self.forces[:, 1:].T) > self.friction * self.forces[:, 0] + self.room).any():
            return 0.0, self._reached(self.forces, still, 0.0 * motion), np.zeros(3)
        ways = [math.inf]
        for k in range(len(self.names)):
            dn, df = along[k]
            ways.append(way(self.forces[k, 0], dn, self.low[k], self.high[k]))
            ways.append(way_in_cone(self.forces[k], dn, df, self.friction[k], self.room[k]))
        ways += [way(0.0, d, a, b) for d, (a, b) in zip(differences, self.ranges, strict=True)]
        ways += [way(0.0, d, -most, most) for d, most in zip(motion, self.reach, strict=True)]
        factor = max(0.0, min(ways))
        if factor * max(float(np.abs(along).max(initial=0.0)), 1e-300) > UNLIMITED * float(self.normal_max.max()):
            return math.inf, (), _NOWHERE
        forces = self.forces.copy()
        forces[:, :2] += factor * along
        return factor, self._reached(forces, factor * differences, factor * motion), factor * motion[:3]

    def _programme(self, along: Array, motion: Array, retensioned: Change) -> _Answer:
        """Tensions are free within their limits: the greatest factor by a conic programme over it and them."""
        count, free = len(self.names), np.flatnonzero(self.ranges[:, 1] > self.ranges[:, 0])
        reach = float(np.abs(along).max(initial=0.0))
        if reach == 0.0:
            return math.inf, (), _NOWHERE
        unit, spans = self.scale / reach, np.abs(self.ranges[free]).max(axis=1)
        effect = np.zeros((count, 2, 1 + free.size))
        effect[:, :, 0] = along / reach
        effect[:, :, 1:] = retensioned.forces[:, :, free] * spans / self.scale
        moves = np.column_stack([motion * unit, np.concatenate([retensioned.pose, retensioned.bends])[:, free] * spans])
        matrix = np.zeros_like(effect)
        matrix[:, 0] = effect[:, 1]
        cones = Cones.made(
            matrix,
            self.forces[:, 1:] / self.scale,
            self.friction[:, None] * effect[:, 0],
            (self.friction * self.forces[:, 0] + self.room) / self.scale,
        )
        if self._cuts is not None:
            cones.cuts = list(self._cuts)
        most = UNLIMITED * float(self.normal_max.max()) / self.scale
        normal, bound = self.forces[:, 0], np.where(np.isfinite(self.reach), 1.0, np.inf)
        scaled = moves / np.where(np.isfinite(self.reach), self.reach, 1.0)[:, None]
        found = solve_conic(
            np.append(-1.0, np.zeros(free.size)),
            np.concatenate([effect[:, 0], scaled]),
            np.concatenate([(self.low - normal) / self.scale, -bound]),
            np.concatenate([(self.high - normal) / self.scale, bound]),
            np.append(0.0, self.ranges[free, 0] / spans),
            np.append(most, self.ranges[free, 1] / spans),
            cones,
        )
        changes = np.zeros(len(self.setups))
        if found.status == "infeasible":
            return 0.0, self._reached(self.forces, changes, 0.0 * motion), np.zeros(3)
        if not found.optimal:
            return math.nan, ("not computed",), _NOWHERE
        self._cuts = cones.cuts
        if found.x[0] >= most * (1.0 - 1e-9):
            return math.inf, (), _NOWHERE
        forces = self.forces.copy()
        forces[:, :2] += self.scale * (effect @ found.x)
        changes[free], moved = found.x[1:] * spans, moves @ found.x
        return float(found.x[0] * unit), self._reached(forces, changes, moved), moved[:3]

    def _reached(self, forces: Array, changes: Array, motion: Array) -> tuple[str, ...]:
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
        far = np.abs(motion) >= self.reach * (1.0 - _ACTIVE)
        words += ["the object moves"] if far[:3].any() else []
        words += [f"{setup.name} bends" for setup, much in zip(self.setups, far[3:], strict=True) if much]
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
