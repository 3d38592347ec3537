"""A finger as a nonlinear elastic rod in space under known loads, integrated from its base.

    r' = t,  R' = R [k]x,  M' = -t x F,  M . d1 = B_l k1,  M . t = G k2,  M . d3 + m(s) = B (k3 - k0)

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
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from continuum_grasp.base import Numbers as Array
from continuum_grasp.scene import Curve, FingerSetup

TOLERANCE = 1e-10
"""Relative tolerance of the integration [1]: a looser one, 1e-8, changes gaps of shipped grasps by up to 1e-8 L."""
_STEP = 1e-5
"""Step of differences in the moment at the base [E I / L]: the root of `TOLERANCE`."""
_NEWTON = 12
"""Most steps of Newton's method; from a grasp's own moment two or three are enough."""
_HALVINGS = 6
"""Halvings of a step that leaves more at the tip."""

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


@dataclass(frozen=True)
class RodSection:
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
    curvature: Array
    """Curvature about d3 (n,) [1/m]."""


class SpaceRod:
    """The shape of a finger under its loads."""

    def __init__(
        self,
        setup: FingerSetup,
        base: tuple[Array, Array],
        tensions: Array,
        loads: Sequence[RodLoad],
        gravity: Array,
        section: RodSection,
        *,
        tolerance: float = TOLERANCE,
    ) -> None:
        """Integrate a finger from its base (position (3,) [m], axes (3, 3)) under loads and gravity (3,) [m/s2]."""
        self.setup = setup
        self.position, self.axes = base
        self.profile = setup.finger.profile
        self.length = self.profile.length
        self._moment = setup.stiffness / self.length  # units of moment [N m] and force [N]
        self._force = self._moment / self.length
        self._gravity = self.axes.T @ gravity
        self._section, self._tolerance = section, tolerance
        self._channels = [
            (channel.shape, channel.gain * float(np.dot(channel.arms, tensions))) for channel in setup.finger.channels
        ]
        weights = [RodLoad(mass.at, mass.mass * gravity) for mass in setup.finger.masses]
        self.loads = sorted([*loads, *weights], key=lambda load: load.at)
        self._weight = self.profile.linear_density.integral()
        self._solutions: list[tuple[float, float, Any]] = []
        self.missing = np.full(3, np.nan)
        """Moment (3,) at the tip that no load explains [N m]."""

    @cached_property
    def edges(self) -> list[float]:
        """Positions between which all is smooth [m]."""
        smooth = [*self.profile.curves, *(shape for shape, _ in self._channels)]
        inside = {at for curve in smooth for at in curve.edges} | {load.at for load in self.loads}
        return [0.0, *sorted(at for at in inside if 0.0 < at < self.length), self.length]

    def solve(self, moment: Array) -> None:
        """Find the moment in the base with which nothing is left at the tip, beginning from one (3,) [N m]."""
        compliances = np.array([1.0 / self._section.lateral, 1.0 / self._section.torsion, 1.0])
        guess = self.axes.T @ moment / self._moment
        left = self._left_at_tip(guess)
        slopes = np.eye(3)
        for count in range(_NEWTON):
            size = np.abs(left).max()
            # 10: rounding of several hundred steps
            if not size > 10.0 * self._tolerance:
                break
            for k in np.flatnonzero(compliances) if count in (0, 4) else ():
                slopes[:, k] = (self._left_at_tip(guess + _STEP * np.eye(3)[k]) - left) / _STEP
            change = -np.linalg.lstsq(slopes, left, rcond=None)[0]
            for halving in range(_HALVINGS):
                trial = guess + 0.5**halving * change
                after = self._left_at_tip(trial)
                if np.abs(after).max() < size:
                    break
            else:
                break
            guess, left = trial, after
        self.missing = self.axes @ self._left_at_tip(guess, dense=True) * self._moment

    def _left_at_tip(self, moment: Array, *, dense: bool = False) -> Array:
        """Moment (3,) at the tip that no load explains, by the moment in the base, both along its axes [E I / L]."""
        state = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, *moment, 0.0])
        forces = [self.axes.T @ load.force for load in self.loads]
        beyond = np.sum([*forces, self._weight * self._gravity], axis=0)
        loads = list(zip(self.loads, forces, strict=True))
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
            state = done.y[:, -1].copy()
            self._solutions.append((a, b, done.sol))
            while loads and loads[0][0].at <= b:
                load, force = loads.pop(0)
                beyond = beyond - force
                if load.couple is not None:
                    place = self.position + self.length * self.axes @ state[:3]
                    state[7:10] -= self.axes.T @ load.couple(place) / self._moment
        return np.asarray(state[7:10])

    def _rates(self, beyond: Array, middle: float) -> Callable[[float, Array], list[float]]:
        """Rates of the state x, y, z [L], quaternion, moment [E I / L] and weight passed, along a smooth part.

        ``beyond`` is the force of all loads beyond the begin of the part, without the weight passed since the base [N].
        """
        profile, length = self.profile, self.length
        stiffness, rest, density = (
            _on(curve, middle) for curve in (profile.bending_stiffness, profile.rest_curvature, profile.linear_density)
        )
        pulls = [(_on(shape, middle), amplitude) for shape, amplitude in self._channels]
        soft1, soft2 = 1.0 / self._section.lateral, 1.0 / self._section.torsion
        unit = self._moment * length
        fx0, fy0, fz0 = (beyond / self._force).tolist()
        gx, gy, gz = (self._weight * self._gravity / self._force).tolist()
        mass = length / self._weight if self._weight else 0.0

        def rates(share: float, state: Array) -> list[float]:
            _, _, _, a, b, c, d, mx, my, mz, passed = state.tolist()
            s = share * length
            x1, y1, z1 = a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)
            x2, y2, z2 = 2.0 * (b * c - a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d + a * b)
            x3, y3, z3 = 2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a - b * b - c * c + d * d
            gives = unit / stiffness(s)
            pulled = sum(amplitude * shape(s) for shape, amplitude in pulls) / self._moment
            k1 = soft1 * gives * (x1 * mx + y1 * my + z1 * mz)
            k2 = soft2 * gives * (x2 * mx + y2 * my + z2 * mz)
            k3 = length * rest(s) + gives * (x3 * mx + y3 * my + z3 * mz + pulled)
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
            ]

        return rates

    def at(self, s: Array) -> RodPlaces:
        """Places at positions (n,) along the rod [m]."""
        s = np.asarray(s, dtype=float)
        states = np.full((11, s.size), np.nan)
        for a, b, solution in self._solutions:
            inside = (s >= a) & (s <= b)
            if inside.any():
                states[:, inside] = solution(s[inside] / self.length)
        a, b, c, d = states[3:7]
        axes = np.array(
            [
                [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
                [2.0 * (b * c + a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d - a * b)],
                [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a - b * b - c * c + d * d],
            ]
        )
        moment = states[7:10].T * self._moment
        about = np.einsum("jn,nj->n", axes[:, 2], moment)
        about += np.sum([amplitude * shape(s) for shape, amplitude in self._channels], axis=0)
        curvature = self.profile.rest_curvature(s) + about / self.profile.bending_stiffness(s)
        points = self.position + self.length * states[:3].T @ self.axes.T
        return RodPlaces(points, np.einsum("ij,jkn->nik", self.axes, axes), moment @ self.axes.T, curvature)

    def half(self, s: Array) -> Array:
        """Half the thickness at positions [m]."""
        return np.asarray(self.profile.half_thickness(s))


def _on(curve: Curve, middle: float) -> Callable[[float], float]:
    """The values of a curve on its piece around a position."""
    piece = int(np.searchsorted(np.asarray(curve.edges[1:-1]), middle))
    start, coefficients = curve.edges[piece], curve.coefficients[piece]
    if len(coefficients) == 1 and not curve.exponential:
        return lambda _: coefficients[0]
    if curve.exponential:
        return lambda s: float(curve.on(piece, s))

    def value(s: float) -> float:
        total = 0.0
        for coefficient in reversed(coefficients):
            total = total * (s - start) + coefficient
        return total

    return value
