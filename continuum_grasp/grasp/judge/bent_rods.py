"""Shapes of one finger under many loads and histories of friction at once, integrated together from its base.

The equations are those of `space_rod`, of which each shape is a column; steps of the classical Runge-Kutta method are
the same for all, so that differences of shapes have no noise of step sizes. Friction has the direction of its cell:

    B k3 = B k0 + M . d3 + tendons - sum z_j M_j,    l' = mu |k3| z
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.bending import value_of
from continuum_grasp.grasp.judge.held import HeldFinger
from continuum_grasp.grasp.judge.space_rod import SideStiffness
from continuum_grasp.scene import FingerSetup

STEPS = 3
"""Steps of each smooth part, of which 24 cells make as many: 2 change places of `mug_motor` by 1e-9 L."""

Near = Callable[[Array], tuple[Array, Array]]
"""Signed distances (n,) of places (n, 3) of n shapes [m] from the object, and its normals (n, 3)."""


@dataclass(frozen=True, eq=False)
class BentLoads:
    """Loads of n shapes of a finger."""

    moment: Array
    """Moment in the base (n, 3) in the world [N m]."""
    tensions: Array
    """Tensions (n, tendons) [N]."""
    forces: Array
    """Forces of contacts on the finger (n, contacts, 3) in the world [N]."""
    twists: Array
    """Moments of contacts about the normal of the object (n, contacts) [N m]."""
    places: Array
    """Places of contacts along the finger (n, contacts) [m]."""
    directions: Array
    """Directions of friction (n, cells, frictions) from -1 to 1: of the tendons, then of branches of dry friction."""

    @staticmethod
    def of(finger: HeldFinger, moment: Array, directions: Array) -> BentLoads:
        """Loads (1, ...) of a finger of a grasp."""
        contacts = finger.contacts
        parts = (
            moment,
            finger.tensions,
            np.array([contact.force for contact in contacts]).reshape(-1, 3),
            np.array([contact.moment for contact in contacts]),
            np.array([contact.place for contact in contacts]),
            directions,
        )
        return BentLoads(*(np.array(part, dtype=float)[None] for part in parts))

    def repeated(self, count: int) -> BentLoads:
        """Copies of one column."""
        return BentLoads(*(np.repeat(getattr(self, field.name), count, axis=0) for field in fields(self)))


@dataclass(frozen=True, eq=False)
class BentShapes:
    """Shapes of n loads."""

    missing: Array
    """Moment at the tip that no load explains (n, 3), along the base's axes [N m]."""
    centers: Array
    """Center line at the contacts (n, contacts, 3) [m]."""
    along: Array
    """Direction of the finger there (n, contacts, 3)."""
    distances: Array
    """Distance of the center line from the object there (n, contacts) [m]."""
    normals: Array
    """Outward normal of the object there (n, contacts, 3)."""
    drawn: Array
    """Length that the bend draws in, per offset in the base (n,) [rad]."""
    shares: Array
    """Mean shares of tensions (n, 2), of the left and the right tendon."""
    s: Array
    """Positions of all steps (steps, n) [m]."""
    points: Array
    """Center line there (steps, n, 3) [m]."""


@dataclass(frozen=True, eq=False)
class _Edge:
    """An end of a smooth part: positions (n,) [m], and the contact or the weight there."""

    at: Array
    contact: int | None = None
    weight: tuple[Array, Array] | None = None  # force (3,) and arm (2,)


class BentRods:
    """Integrates a finger under many loads."""

    def __init__(
        self, setup: FingerSetup, base: tuple[Array, Array], gravity: Array, section: SideStiffness, cells: int
    ) -> None:
        """Take the base (position (3,) [m], axes (3, 3)), gravity [m/s2], and cells of each part between contacts."""
        self._position, self._axes = base
        self._profile, self._length = setup.finger.profile, setup.finger.rod.length
        self._gravity, self._section, self._cells = gravity, section, cells
        self._channels = setup.finger.channels
        self._end = setup.finger.tendon_list[0].end(self._length)
        self._friction = setup.tendons.friction
        self._most = np.array([branch.moment for branch in setup.finger.damping.dry_friction])
        self._weights = [(mass.at, mass.mass * gravity, np.zeros(2)) for mass in setup.finger.masses]
        if (body := setup.finger.tip_body) is not None:
            self._weights.append((self._length, body.mass * gravity, np.array(body.center_of_mass)))

    def shapes(self, loads: BentLoads, near: Near) -> BentShapes:
        """Integrate from the base."""
        state = np.zeros((20, len(loads.moment)))
        state[:3], state[3:12] = self._position[:, None], self._axes.T.ravel()[:, None]
        state[12:15] = loads.moment.T
        weight = self._profile.linear_density.integral() * self._gravity
        beyond = loads.forces.sum(axis=1).T + sum((force for _, force, _ in self._weights), weight)[:, None]
        touched = [np.zeros(loads.forces.shape) for _ in range(3)]
        distances = np.zeros(loads.places.shape)
        edges = self._edges(loads)
        s, points = [edges[0].at], [state[:3].T]
        for first, last in pairwise(edges):
            rates = self._rates(loads, beyond, 0.5 * (first.at[0] + last.at[0]))
            step = (last.at - first.at) / STEPS
            for k in range(STEPS):
                state = _advanced(rates, first.at + k * step, state, step)
                s.append(first.at + (k + 1) * step)
                points.append(state[:3].T)
            if last.weight is not None:
                force, arm = last.weight
                beyond = beyond - force[:, None]
                reach = arm[0] * state[3:6] + arm[1] * state[6:9]
                state[12:15] -= np.cross(reach.T, force).T
            if last.contact is not None:
                c = last.contact
                force, center = loads.forces[:, c], state[:3].T
                distances[:, c], normal = near(center)
                half = self._profile.half_thickness(loads.places[:, c])
                couple = loads.twists[:, c, None] * normal - half[:, None] * np.cross(normal, force)
                state[12:15] -= couple.T
                beyond = beyond - force.T
                for kept, own in zip(touched, (center, state[6:9].T, normal), strict=True):
                    kept[:, c] = own
        centers, along, normals = touched
        return BentShapes(
            state[12:15].T @ self._axes,
            centers,
            along,
            distances,
            normals,
            state[16],
            state[17:19].T / self._end,
            np.array(s),
            np.array(points),
        )

    def _marks(self, loads: BentLoads) -> Array:
        """Positions (marks, n) of base, contacts and tip [m]."""
        inner = [at for at in loads.places.T if at[0] < self._length]
        return np.array([0.0 * loads.moment[:, 0], *sorted(inner, key=lambda at: float(at[0])), self._tips(loads)])

    def _tips(self, loads: BentLoads) -> Array:
        return np.full(len(loads.moment), self._length)

    def _edges(self, loads: BentLoads) -> list[_Edge]:
        """Ends of all smooth parts, in their order."""
        marks, shares = self._marks(loads), np.arange(1, self._cells) / self._cells
        edges = [_Edge(a + share * (b - a)) for a, b in pairwise(marks) for share in shares]
        edges += [_Edge(at, contact) for contact, at in enumerate(loads.places.T)]
        curves = (*self._profile.curves, *(channel.shape for channel in self._channels))
        fixed = {at for curve in curves for at in curve.edges if 0.0 < at < self._length}
        edges += [_Edge(np.full(marks.shape[1], at)) for at in fixed]
        edges += [_Edge(np.full(marks.shape[1], at), None, (force, arm)) for at, force, arm in self._weights]
        return [_Edge(marks[0]), *sorted(edges, key=lambda edge: float(edge.at[0])), _Edge(marks[-1])]

    def _rates(self, loads: BentLoads, beyond: Array, middle: float) -> _Rates:
        """Rates of the state along the smooth part around a position [m]."""
        profile = self._profile
        curves = profile.bending_stiffness, profile.rest_curvature, profile.linear_density
        stiffness, rest, density = (value_of(curve, middle) for curve in curves)
        channels = [
            (
                value_of(channel.shape, middle),
                loads.tensions @ np.maximum(arms, 0.0),
                loads.tensions @ np.minimum(arms, 0.0),
            )
            for channel in self._channels
            for arms in [channel.gain * np.array(channel.arms)]
        ]
        cell = self._cell(loads, middle)
        way, held = (cell[:, 0], cell[:, 1:] @ self._most) if self._friction else (0.0, cell @ self._most)
        held = held / float(profile.bending_stiffness(0.0))
        soft1, soft2 = 1.0 / self._section.lateral, 1.0 / self._section.torsion
        friction, gravity = self._friction, self._gravity[:, None]
        heavy, ends = bool(np.any(self._gravity)), middle < self._end

        def rates(s: Array, state: Array) -> Array:
            d1, t, d3, moment = state[3:6], state[6:9], state[9:12], state[12:15]
            share = np.exp(-state[15]) if friction else np.ones(1)
            bending, shaped = (d3 * moment).sum(axis=0), 0.0
            for shape, left, right in channels:
                shaped = shape(s)
                bending = bending + shaped * (left * share + right / share)
            stiff = stiffness(s)
            k3 = rest(s) + bending / stiff - held
            force = beyond - state[19] * gravity if heavy else beyond
            out = np.zeros_like(state)
            out[:3], out[3:6], out[6:9] = t, k3 * t, -k3 * d1
            if soft2:
                k1, k2 = soft1 * (d1 * moment).sum(axis=0) / stiff, soft2 * (t * moment).sum(axis=0) / stiff
                out[3:6] -= k2 * d3
                out[6:9] += k1 * d3
                out[9:12] = k2 * d1 - k1 * t
                out[12:15] = np.cross(force, t, axis=0)
            else:
                # What is rigid across its plane bears all other moments.
                out[12:15] = (force * d1).sum(axis=0) * d3
            out[15] = friction * np.abs(k3) * way
            if ends:
                out[16], out[17], out[18] = shaped * k3, share, 1.0 / share
            out[19] = density(s)
            return out

        return rates

    def _cell(self, loads: BentLoads, middle: float) -> Array:
        """Directions (n, frictions) of the cell around a position [m]."""
        marks = self._marks(loads)[:, 0]
        part = int(np.clip(np.searchsorted(marks, middle) - 1, 0, len(marks) - 2))
        share = (middle - marks[part]) / (marks[part + 1] - marks[part])
        return loads.directions[:, part * self._cells + min(int(share * self._cells), self._cells - 1)]


_Rates = Callable[[Array, Array], Array]


def _advanced(rates: _Rates, s: Array, state: Array, step: Array) -> Array:
    """The state after a step of the classical Runge-Kutta method."""
    half = 0.5 * step
    a = rates(s, state)
    b = rates(s + half, state + half * a)
    c = rates(s + half, state + half * b)
    d = rates(s + step, state + step * c)
    return state + step / 6.0 * (a + 2.0 * (b + c) + d)
