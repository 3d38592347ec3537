"""A finger as a nonlinear elastic rod in space under known loads, integrated from its base.

    r' = t,  R' = R [k]x,  M' = -t x F,  M . d1 = B_l k1,  M . t = G k2,  M . d3 + m = B (k3 - k0)

The rod keeps its length and does not shear. R = (d1, t, d3) are the axes of a section: d1 across, t along the rod, d3
the axis about which tendons bend it. k are the rates at which R turns, k0 the curvature at rest, B, B_l and G the
stiffnesses of bending about d3 and about d1 and of torsion, and m the moment of the tendons. M and F are the moment and
the force of what lies beyond s. All loads are known, so that F is known everywhere; the moment in the base is the one
with which none is left at the tip. Fingers that are rigid across their plane stay in it.

S. S. Antman, "Nonlinear Problems of Elasticity", chapter 8. Tendons are taken to have no moment about d1 and t.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.bending import FrictionCells, SectionBending, value_of
from continuum_grasp.scene import FingerSetup

TOLERANCE = 1e-10
"""Relative tolerance of the integration [1]: a looser one, 1e-8, changes gaps of shipped grasps by up to 1e-8 L."""
_STEP = 1e-5
"""Step of differences in the moment at the base [E I / L]: the root of `TOLERANCE`."""
_NEWTON = 30
"""Most steps of Newton's method; from a grasp's own moment one or two are enough."""
_PATHS = 8
"""Integrations until the path of tendons with friction is found; each leaves a tenth or less."""
_HALVINGS = 6
"""Halvings of a step that leaves more at the tip."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)

Couple = Callable[[Array], Array]
"""Couple (3,) of a load at a place (3,) [N m]."""


@dataclass(frozen=True, eq=False)
class RodLoad:
    """A force at the center line of a rod in the world, and the couple that goes with it."""

    at: float
    """Position along the rod [m]."""
    force: Array
    """Force (3,) [N]."""
    couple: Couple | None = None
    """Couple by the place of the center line; None: there is none."""
    arm: tuple[float, float] = (0.0, 0.0)
    """Place of the force from the center line, across and along the rod [m]."""


@dataclass(frozen=True)
class SideStiffness:
    """Stiffness of a section per its bending stiffness in the plane."""

    lateral: float = np.inf
    """Stiffness of bending out of the plane [1]."""
    torsion: float = np.inf
    """Stiffness of torsion [1]."""


@dataclass(frozen=True, eq=False)
class RodPlaces:
    """Places of a rod in the world, at n positions along it."""

    points: Array
    """Center line (n, 3) [m]."""
    axes: Array
    """Axes of the sections (n, 3, 3), columns d1, t, d3."""
    moment: Array
    """Moment of what lies beyond (n, 3) [N m]."""


_BASE = np.array([*[0.0] * 3, 1.0, *[0.0] * 9])
"""State of a rod in its base, at the origin of the base's axes."""


class RodClamp(NamedTuple):
    """A place at which a rod is held as it is."""

    at: float
    """Position along the rod [m]."""
    state: Array
    """State (13,) of the integration there."""


class SpaceRod:
    """The shape of a finger under its loads."""

    def __init__(
        self,
        setup: FingerSetup,
        base: tuple[Array, Array],
        tensions: Array,
        loads: Sequence[RodLoad],
        gravity: Array,
        section: SideStiffness,
        *,
        tolerance: float = TOLERANCE,
        history: FrictionCells | None = None,
        clamp: RodClamp | None = None,
    ) -> None:
        """Integrate a finger from its base (position (3,) [m], axes (3, 3)) under loads and gravity (3,) [m/s2].

        With a history of friction, its directions are constant; else the finger was pulled. With a clamp, what is
        before that stays, and moments are those there.
        """
        self.setup = setup
        self.position, self.axes = base
        self.profile = setup.finger.profile
        self.length = self.profile.length
        self._moment = setup.stiffness / self.length  # units of moment [N m] and force [N]
        self._force = self._moment / self.length
        self._gravity = self.axes.T @ gravity
        self._section, self._tolerance = section, tolerance
        self._soft = [0, 1, 2] if np.isfinite(section.torsion) else [2]
        self._bending = SectionBending(setup, tensions, history)
        self._path = 0.0  # drawn in by the whole finger, per offset in the base
        weights = [RodLoad(mass.at, mass.mass * gravity) for mass in setup.finger.masses]
        if (body := setup.finger.tip_body) is not None:
            weights.append(RodLoad(self.length, body.mass * gravity, arm=body.center_of_mass))
        self.loads = sorted([*loads, *weights], key=lambda load: load.at)
        self._weight = self.profile.linear_density.integral()
        self._clamp = clamp or RodClamp(0.0, _BASE)
        self._solutions: list[tuple[float, float, Any]] = []
        self.missing = np.full(3, np.nan)
        """Moment (3,) at the tip that no load explains [N m]."""

    @cached_property
    def edges(self) -> list[float]:
        """Positions between which all is smooth [m]."""
        inside = {at for curve in self._bending.curves for at in curve.edges} | {load.at for load in self.loads}
        inside |= set(self._bending.ends)
        first = self._clamp.at
        return [first, *sorted(at for at in inside if first < at < self.length), self.length]

    def integrate(self, moment: Array) -> None:
        """Integrate from a moment in the base (3,) [N m]; `missing` is then what no load explains."""
        start = self.axes.T @ moment / self._moment
        if self._bending.slides:
            self._left_at_tip(start)  # finds the path
        left = self._shot(start, dense=True)[self._soft]
        self.missing = self._moment * self.axes[:, self._soft] @ left

    def solve(self, moment: Array) -> None:
        """Find the moment in the base with which nothing is left at the tip, beginning from one (3,) [N m]."""
        guess = self.axes.T @ moment / self._moment
        left = self._left_at_tip(guess)
        slopes, fresh = np.zeros((left.size, left.size)), False
        for _ in range(_NEWTON):
            size = np.abs(left).max()
            # 10: rounding of several hundred steps
            if not size > 10.0 * self._tolerance:
                break
            if not fresh:
                steps = _STEP * np.eye(3)[self._soft]
                slopes = np.column_stack([self._left_at_tip(guess + step) - left for step in steps]) / _STEP
            change = np.zeros(3)
            change[self._soft] = -np.linalg.lstsq(slopes, left, rcond=None)[0]
            for halving in range(_HALVINGS):
                trial = guess + 0.5**halving * change
                after = self._left_at_tip(trial)
                if np.abs(after).max() < size:
                    break
            else:
                break
            # Slopes that leave a tenth serve once more.
            fresh = np.abs(after).max() < 0.1 * size
            guess, left = trial, after
        self.integrate(self._moment * self.axes @ guess)

    def _left_at_tip(self, moment: Array) -> Array:
        """Moments at the tip that no load explains, by the moment in the base (3,), along the base's axes [E I / L].

        A rod that is rigid across its plane bears any moments but the one about the plane's normal.
        """
        if not self._bending.slides:
            return self._shot(moment)[self._soft]
        for _ in range(_PATHS):
            *left, path = self._shot(moment)
            self._path -= path
            if abs(path) < self._tolerance:
                break
        return np.array(left)[self._soft]

    def _shot(self, moment: Array, *, dense: bool = False) -> Array:
        """Moment (3,) and path (1,) that are left at the tip, by the moment in the base [E I / L]."""
        state = self._clamp.state.copy()
        state[7:10], state[12] = moment, state[12] + self._path
        loads = [(load, self.axes.T @ load.force) for load in self.loads if load.at > self._clamp.at]
        beyond = np.sum([*(force for _, force in loads), self._weight * self._gravity], axis=0)
        self._solutions = []
        for a, b in zip(self.edges[:-1], self.edges[1:], strict=True):
            rates = self._rates(beyond, 0.5 * (a + b))
            # Positions of 1 nm of a finger count as nothing.
            done = solve_ivp(
                rates,
                (a / self.length, b / self.length),
                state,
                method="DOP853",
                rtol=self._tolerance,
                atol=0.01 * self._tolerance,
                dense_output=dense,
            )
            if not done.success:
                return np.full(4, np.nan)
            state = done.y[:, -1].copy()
            self._solutions.append((a, b, done.sol))
            while loads and loads[0][0].at <= b:
                load, force = loads.pop(0)
                beyond = beyond - force
                if load.couple is not None:
                    place = self.position + self.length * self.axes @ state[:3]
                    state[7:10] -= self.axes.T @ load.couple(place) / self._moment
                if any(load.arm):
                    across, along, _ = _axes(state[3:7])
                    arm = load.arm[0] * across + load.arm[1] * along
                    state[7:10] -= np.cross(arm, force) / self._moment
        return state[[7, 8, 9, 12]]

    def _rates(self, beyond: Array, middle: float) -> Callable[[float, Array], list[float]]:
        """Rates of the state x, y, z [L], quaternion, moment [E I / L], weight passed, l and w, along a smooth part.

        ``beyond`` is the force of all loads beyond the begin of the part, without the weight passed since the base [N].
        """
        length, moment_unit = self.length, self._moment
        stiffness = value_of(self.profile.bending_stiffness, middle)
        density = value_of(self.profile.linear_density, middle)
        bends = self._bending.on(middle)
        soft1, soft2 = 1.0 / self._section.lateral, 1.0 / self._section.torsion
        unit = moment_unit * length
        fx0, fy0, fz0 = (beyond / self._force).tolist()
        gx, gy, gz = (self._weight * self._gravity / self._force).tolist()
        mass = length / self._weight if self._weight else 0.0

        def rates(share: float, state: Array) -> list[float]:
            _, _, _, a, b, c, d, mx, my, mz, passed, loss, path = state.tolist()
            s = share * length
            x1, y1, z1 = a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)
            x2, y2, z2 = 2.0 * (b * c - a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d + a * b)
            x3, y3, z3 = 2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a - b * b - c * c + d * d
            gives = unit / stiffness(s)
            k1 = soft1 * gives * (x1 * mx + y1 * my + z1 * mz)
            k2 = soft2 * gives * (x2 * mx + y2 * my + z2 * mz)
            bent = bends(s, moment_unit * (x3 * mx + y3 * my + z3 * mz), loss, path)
            k3 = length * bent.curvature
            fx, fy, fz = fx0 - passed * gx, fy0 - passed * gy, fz0 - passed * gz
            return [
                x2,
                y2,
                z2,
                -0.5 * (b * k1 + c * k2 + d * k3),
                0.5 * (a * k1 + c * k3 - d * k2),
                0.5 * (a * k2 + d * k1 - b * k3),
                0.5 * (a * k3 + b * k2 - c * k1),
                z2 * fy - y2 * fz,
                x2 * fz - z2 * fx,
                y2 * fx - x2 * fy,
                mass * density(s),
                length * bent.loss,
                length * bent.path,
            ]

        return rates

    def at(self, s: Array) -> RodPlaces:
        """Places at positions (n,) along the rod [m]."""
        states = self._states(np.asarray(s, dtype=float))
        axes = _axes(states[3:7])
        points = self.position + self.length * states[:3].T @ self.axes.T
        moment = self._moment * states[7:10].T @ self.axes.T
        return RodPlaces(points, np.einsum("ij,kjn->nik", self.axes, axes), moment)

    def curvature(self, s: Array) -> Array:
        """Curvature (n,) about d3 at positions (n,) [1/m]."""
        places, (loss, path) = self.at(s), self._states(s)[11:]
        about = (places.axes[:, :, 2] * places.moment).sum(axis=1)
        found = np.full(s.size, np.nan)
        for a, b, _ in self._solutions:
            bends = self._bending.on(0.5 * (a + b))
            inside = np.flatnonzero((s >= a) & (s <= b))
            rows = np.column_stack([s, about, loss, path])[inside].tolist()
            # At a jump, the sharper bend counts.
            bent = np.array([bends(*row).curvature for row in rows])
            found[inside] = np.where(np.abs(found[inside]) > np.abs(bent), found[inside], bent)
        return found

    def cables(self) -> tuple[float, Array]:
        """Length that the bend draws in from straight on, per offset in the base [rad], and mean shares of tensions.

        The shares (2,) belong to the left and the right tendon, from the base to where both end.
        """
        shape, end = self._bending.shape, self._bending.end
        drawn, shares = 0.0, np.zeros(2)
        for a, b, _ in self._solutions:
            if a >= end:
                break
            s, weights = 0.5 * (a + b) + 0.5 * (b - a) * _NODES, 0.5 * (b - a) * _WEIGHTS
            own = value_of(shape, 0.5 * (a + b))
            drawn += float((self.curvature(s) * [own(at) for at in s.tolist()]) @ weights)
            shares += np.exp(np.outer([-1.0, 1.0], self._states(s)[11])) @ weights
        return drawn, shares / end

    def clamped(self, at: float) -> RodClamp:
        """A clamp of this shape at a position along the rod [m]."""
        return RodClamp(at, self._states(np.array([at]))[:, 0])

    def _states(self, s: Array) -> Array:
        """States (13, n) at positions [m]."""
        states = np.full((13, s.size), np.nan)
        for a, b, solution in self._solutions:
            inside = (s >= a) & (s <= b)
            if inside.any():
                states[:, inside] = solution(s[inside] / self.length)
        return states

    def half(self, s: Array) -> Array:
        """Half the thickness at positions [m]."""
        return np.asarray(self.profile.half_thickness(s))


def _axes(quaternion: Array) -> Array:
    """Rows (3, 3, ...): the axes of sections by their unit quaternions (4, ...), the real part first."""
    a, b, c, d = quaternion
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)],
            [2.0 * (b * c - a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d + a * b)],
            [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a - b * b - c * c + d * d],
        ]
    )
