"""Disturbances that a grasp resists: the limits that it meets as it yields, of forces, tensions and motions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.check import EXACT, YIELDS
from continuum_grasp.grasp.judge.drives import LEAST_PULL
from continuum_grasp.grasp.quality.conic import Cones, solve_conic
from continuum_grasp.grasp.quality.response import GraspResponse, Tendons
from continuum_grasp.scene import FingerSetup

TURN = 3.0
"""Allowed turn of a finger's tip, per allowed turn of the object: soft fingers turn more than what they hold."""

Answer = tuple[float, tuple[str, ...]]
"""Greatest factor, and what limits it."""


@dataclass(frozen=True)
class Resistance:
    """Multiples of K disturbances that a grasp resists."""

    wrenches: Array  # (K, 3) force x, y [N] and moment about the center of mass [N m]
    # (K,) greatest multiple of each that the grasp resists [1]; infinite where nothing limits it, zero where the grasp
    # is unstable or beyond a limit by itself.
    factors: Array
    limiting: tuple[tuple[str, ...], ...]  # what stops each from growing
    tendons: Tendons
    stable: bool  # whether the grasp is stable with its tendons so

    @classmethod
    def of(
        cls,
        response: GraspResponse,
        *,
        wrenches: Sequence[Sequence[float]] | None = None,
        tendons: Tendons | None = None,
        displacement_limit: float = YIELDS,
    ) -> Resistance:
        """Greatest multiples of disturbances that a grasp resists, one disturbance at a time.

        Until a contact slips, parts or is pressed too hard, a tendon is at its limit, or the grasp yields too much. The
        fingers move as ``response`` says: to first order, contacts sticking until the first one does not. It does not
        hold far from the stored grasp of soft fingers, so motions are limited too: the object's to
        ``displacement_limit``, as a part of its size and in rad, finger tips' to three times as much; infinite
        takes the first order at its word. Forces out of the plane stay as they are. Wrenches (force x, y [N], moment
        about the center of mass [N m]) and tendons are by default the scene's.
        """
        scene = response.contacts.scene
        kind: Tendons = tendons or scene.disturbances.tendons
        disturbances = np.asarray(scene.wrenches if wrenches is None else wrenches, dtype=float).reshape(-1, 3)
        stable = response.stable(kind)
        if stable:
            limits = _Limits(response, kind, displacement_limit)
            answers = [limits.greatest(wrench) for wrench in disturbances]
        else:
            answers = [(0.0, ("unstable",))] * len(disturbances)
        return cls(disturbances, np.array([a[0] for a in answers]), tuple(a[1] for a in answers), kind, stable)

    @property
    def least(self) -> float:
        """Least of the factors; infinite without disturbances."""
        return float(self.factors.min(initial=math.inf))


class _Limits:
    """Limits of contact forces, tensions and motions along the response."""

    def __init__(self, response: GraspResponse, tendons: Tendons, displacement_limit: float) -> None:
        contacts = response.contacts
        self.names = contacts.names
        self.setups = response.setups
        self.unit = response.to_wrenches(tendons)
        self.retensioned = response.to_tensions()
        self.forces = contacts.forces
        self.friction = contacts.friction
        self.normal_max = contacts.normal_max
        # The unit of force that makes the numbers of the SOCP near one, where nothing presses yet too [N].
        self.scale = max(float(np.abs(contacts.forces).max(initial=0.0)), 1e-3 * float(contacts.normal_max.max()))
        slack = EXACT * self.scale
        # Optima lie on cones and limits up to the solver's tolerance: what rounding put outside widens them by as much.
        over = np.hypot(self.forces[:, 1], self.forces[:, 2]) - self.friction * self.forces[:, 0]
        self.spare = np.where((over > 0.0) & (over < 10.0 * slack), over, 0.0)
        self.low = np.where(self.forces[:, 0] > -slack, np.minimum(self.forces[:, 0], 0.0), 0.0)
        near = self.forces[:, 0] < self.normal_max + slack
        self.high = np.where(near, np.maximum(self.normal_max, self.forces[:, 0]), self.normal_max)
        pairs = zip(self.setups, response.tensions, strict=True)
        self.ranges = np.array([difference_range(setup, pair, tendons) for setup, pair in pairs]).reshape(-1, 2)  # [N]
        free = (self.ranges[:, 1] > self.ranges[:, 0]) & (tendons == "retensioned")
        self.free = np.flatnonzero(free)  # fingers whose tensions can be chosen anew
        size = contacts.scene.object.size
        # Greatest motions of the object [m, m, rad] and turns of the tips [rad].
        self.reach = displacement_limit * np.array([size, size, 1.0, *(TURN for _ in self.setups)])

    def greatest(self, wrench: Array) -> Answer:
        """The answer for a wrench (3,) [N, N, N m], by a SOCP over the factor and the changes of tensions that are
        free; of all ways to get there, the one that changes them least.
        """
        along, differences = self.unit.forces @ wrench, self.unit.differences @ wrench
        motion = np.concatenate([self.unit.pose @ wrench, self.unit.bends @ wrench])
        count = len(self.names)
        free = self.free
        reach = float(np.abs(along).max(initial=0.0))
        if reach == 0.0:
            return math.inf, ()
        unit = self.scale / reach
        spans = np.abs(self.ranges[free]).max(axis=1)
        # Unknowns: the factor, and the change of each free difference of tensions per its span.
        effect = np.zeros((count, 2, 1 + free.size))
        effect[:, :, 0] = along / reach
        effect[:, :, 1:] = self.retensioned.forces[:, :, free] * spans / self.scale
        moved = np.concatenate([self.retensioned.pose, self.retensioned.bends])[:, free] * spans
        moves = np.column_stack([motion * unit, moved])
        pulls = np.column_stack([differences * unit, np.eye(len(self.setups))[:, free] * spans])
        matrix = np.zeros_like(effect)  # the lift, second in the cones, stays as it is
        matrix[:, 0] = effect[:, 1]
        cones = Cones(
            matrix,
            self.forces[:, 1:] / self.scale,
            self.friction[:, None] * effect[:, 0],
            (self.friction * self.forces[:, 0] + self.spare) / self.scale,
        )
        normal = self.forces[:, 0]
        widest = np.maximum(np.abs(self.ranges).max(axis=1), self.scale)
        rows = np.concatenate([effect[:, 0], moves / self.reach[:, None], pulls / widest[:, None]])
        still = np.ones(motion.size)
        row_low = np.concatenate([(self.low - normal) / self.scale, -still, self.ranges[:, 0] / widest])
        row_high = np.concatenate([(self.high - normal) / self.scale, still, self.ranges[:, 1] / widest])
        low, high = (np.append(of_factor, self.ranges[free, k] / spans) for k, of_factor in ((0, 0.0), (1, math.inf)))
        # 1e-7: worth of the square of a change of tensions per their span, beside the factor in its unit of force
        cost = np.append(-1.0, np.zeros(free.size))
        squares = np.append(0.0, np.full(free.size, 1e-7))
        solution = solve_conic(cost, rows, row_low, row_high, low, high, cones, squares)
        if solution.status == "infeasible":
            return 0.0, self._reached(self.forces, 0.0 * differences, 0.0 * motion)
        # 1e4: a disturbance that makes forces this many times the greatest limit of a contact counts as unlimited
        if solution.status == "unbounded" or solution.x[0] * self.scale >= 1e4 * self.normal_max.max():
            return math.inf, ()
        if not solution.optimal:
            return math.nan, ("not computed",)
        forces = self.forces.copy()
        forces[:, :2] += self.scale * (effect @ solution.x)
        return float(solution.x[0] * unit), self._reached(forces, pulls @ solution.x, moves @ solution.x)

    def _reached(self, forces: Array, changes: Array, motion: Array) -> tuple[str, ...]:
        """Names of the limits that are reached or passed."""
        slack = EXACT * max(self.scale, float(np.abs(forces).max(initial=0.0)))
        words = []
        for k, name in enumerate(self.names):
            normal, friction, lift = forces[k]
            if normal <= self.low[k] + slack:
                words.append(f"{name} parts")
            elif math.hypot(friction, lift) >= self.friction[k] * normal + self.spare[k] - slack:
                words.append(f"{name} slips")
            if normal >= self.high[k] - slack:
                words.append(f"{name} is pressed too hard")
        for setup, change, (least, greatest) in zip(self.setups, changes, self.ranges, strict=True):
            if change <= least + EXACT * (greatest - least) or change >= greatest - EXACT * (greatest - least):
                words.append(f"{setup.name} is at its tension limit")
        far = np.abs(motion) >= self.reach * (1.0 - EXACT)
        words += ["the object moves"] if far[:3].any() else []
        words += [f"{setup.name} bends" for setup, much in zip(self.setups, far[3:], strict=True) if much]
        return tuple(words)


def difference_range(setup: FingerSetup, tensions: Array, tendons: Tendons) -> tuple[float, float]:
    """By how much tension 1 less tension 2 may change [N].

    Locked antagonists share a change equally, until one would fall below the least tension; it stays there and the
    other takes the rest.
    """
    least = setup.tendons.min_tension
    greatest = setup.max_tension
    used = setup.finger.tendons_used
    now = float(tensions[0] - tensions[1])
    slack = tensions <= LEAST_PULL * greatest
    if setup.drive is not None and tendons == "locked" and slack.any():
        # A slack tendon stays so; the other takes all of a change until it is slack itself.
        low, high = (-tensions[0], greatest - tensions[0]) if slack[1] else (tensions[1] - greatest, tensions[1])
    elif used != "both":
        low, high = (least - now, greatest - now) if used == "left" else (-greatest - now, -least - now)
    elif tendons == "retensioned":
        low, high = least - greatest - now, greatest - least - now
    else:
        spare = np.maximum(greatest - tensions, 0.0), np.maximum(tensions - least, 0.0)
        high = float(min(2.0 * spare[0][0], spare[0][0] + spare[1][1]))
        low = -float(min(2.0 * spare[0][1], spare[0][1] + spare[1][0]))
    return min(low, 0.0), max(high, 0.0)
