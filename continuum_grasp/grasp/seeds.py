"""Starting shapes for the search, from geometry alone (numpy only).

In the frame of the base the finger points along +y and the object lies on its left (a grasp to the right is
mirrored). The curvature is continuous and linear on both sides of the middle contact: k0 at the base, k1 at
the contact, k2 at the tip. For a given contact position these three follow from tangency at the contact and
touch at the tip, by Newton's method; the scan over the contact position gives a family of shapes, all of
which touch the object as they should.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.grasp import GraspScene

__all__ = ["Seed", "bending_side", "make_seeds"]

Array = NDArray[Any]

_X, _W = np.polynomial.legendre.leggauss(24)
_NODES, _WEIGHTS = 0.5 * (_X + 1.0), 0.5 * _W


@dataclass(frozen=True)
class Seed:
    """A starting shape.

    Attributes
    ----------
    label : str
        Where it comes from.
    middle : float
        Position of the middle contact along the finger [m].
    curvatures : tuple of float
        Curvature at base, middle contact and tip, linear between [1/m].
    """

    label: str
    middle: float
    curvatures: tuple[float, float, float]

    def nodes(self, lengths: Array) -> Array:
        """Curvature at the ends of elements of these lengths (N + 1,) [1/m]."""
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        return np.asarray(np.interp(at, [0.0, self.middle, at[-1]], self.curvatures))

    def bends(self, lengths: Array) -> Array:
        """Bending angles of elements of these lengths (N,) [rad]."""
        nodes = self.nodes(lengths)
        return np.asarray(0.5 * lengths * (nodes[1:] + nodes[:-1]))


def bending_side(scene: GraspScene) -> int:
    """+1: the object lies on the left of the straight finger, which bends positively round it; -1: on the
    right.
    """
    return 1 if _object_in_base(scene)[0] <= 0.0 else -1


def make_seeds(scene: GraspScene) -> list[Seed]:
    """Starting shapes, the most promising first, as many as the scene asks for.

    Parameters
    ----------
    scene : GraspScene

    Returns
    -------
    list of Seed
        From the scan, then the wrapped shape, then random changes of these; the same list for the same scene.
    """
    side = bending_side(scene)
    cx, cy = _object_in_base(scene)
    geometry = _Geometry(scene.finger.rod.length, scene.object.radius + scene.finger.thickness_radius, (side * cx, cy))
    low, high = scene.middle_bounds
    wrap = geometry.wrap(low, high)
    scan = geometry.scan(wrap, np.linspace(max(low, 0.15 * high), high, 25))
    count = scene.solver.seeds
    if scan:
        picks = np.unique(np.linspace(0, len(scan) - 1, max(1, count - 1) + 2).round().astype(int)[1:-1])
        centre = len(scan) // 2
        ordered = [scan[i] for i in sorted(picks, key=lambda i: abs(i - centre))]
    else:
        ordered = []
    fidelity = scene.fidelity
    arcs = fidelity.family == "arc" and scene.element_count == 2
    found = [wrap, *ordered] if arcs else [*ordered, wrap]
    random = np.random.default_rng(scene.solver.random_seed)
    while len(found) < count:
        parent = found[int(random.integers(len(found)))]
        noise = 1.0 + 0.3 * random.uniform(-1.0, 1.0, 4)
        middle = float(np.clip(parent.middle * noise[0], low, high))
        k0, k1, k2 = (float(k * f) for k, f in zip(parent.curvatures, noise[1:], strict=True))
        found.append(Seed("random", middle, (k0, k1, k2)))
    return [
        Seed(s.label, s.middle, (side * s.curvatures[0], side * s.curvatures[1], side * s.curvatures[2]))
        for s in found[:count]
    ]


def _object_in_base(scene: GraspScene) -> tuple[float, float]:
    base = scene.finger.base
    x = scene.object.position[0] - base.position[0]
    y = scene.object.position[1] - base.position[1]
    c, s = math.cos(base.angle), math.sin(base.angle)
    return c * x + s * y, -s * x + c * y


@dataclass(frozen=True)
class _Geometry:
    length: float
    reach: float
    """Radius of the object plus half the finger's thickness [m]."""
    centre: tuple[float, float]
    """Object in the frame of the base, on its left [m]."""

    def wrap(self, low: float, high: float) -> Seed:
        """One arc up to the object, tangent to it, then round it: the exact shape of two arcs."""
        d, y, rho = -self.centre[0], self.centre[1], self.reach
        k1 = 2.0 * (d - rho) / max(d * d + y * y - rho * rho, 1e-12)
        if abs(k1) < 1e-9:
            middle = y
        else:
            r1 = 1.0 / k1
            sign = 1.0 if r1 > rho else -1.0
            middle = r1 * math.atan2(sign * y, sign * (r1 - d))
        if not low <= middle <= high:
            middle, k1 = min(max(middle if middle > 0 else 0.4 * self.length, low), high), 0.3 / rho
        return Seed("wrap", middle, (k1, 1.0 / rho, 1.0 / rho))

    def scan(self, wrap: Seed, positions: Array) -> list[Seed]:
        """Shapes that touch the object at a middle contact and at the tip, without deep penetration."""
        start = int(np.argmin(np.abs(positions - wrap.middle)))
        found: dict[int, Seed] = {}
        for order in (range(start, len(positions)), range(start - 1, -1, -1)):
            guess = np.array([wrap.curvatures[0], 0.9 / self.reach, 1.1 / self.reach])
            for i in order:
                solved = self._touching(float(positions[i]), guess)
                if solved is None:
                    break
                guess = solved
                if self._depth(float(positions[i]), solved) < 2e-3 * self.length:
                    k0, k1, k2 = (float(k) for k in solved)
                    found[i] = Seed("scan", float(positions[i]), (k0, k1, k2))
        return [found[i] for i in sorted(found)]

    def _gaps(self, middle: float, k: Array) -> Array:
        joint, angle, end = self._points(middle, k)
        normal = np.array([math.cos(angle), math.sin(angle)])
        off = joint - np.asarray(self.centre) - self.reach * normal
        return np.array([off[0], off[1], float(np.linalg.norm(end - self.centre)) - self.reach])

    def _touching(self, middle: float, guess: Array) -> Array | None:
        k = guess.astype(float)
        step = 1e-6 / self.length
        for _ in range(25):
            gap = self._gaps(middle, k)
            if np.abs(gap).max() < 1e-10 * self.length:
                return k
            slope = np.stack([(self._gaps(middle, k + step * e) - gap) / step for e in np.eye(3)], axis=1)
            try:
                change = np.linalg.solve(slope, -gap)
            except np.linalg.LinAlgError:
                return None
            k = k + change * min(1.0, 8.0 / (self.length * max(np.abs(change).max(), 1e-300)))
            if not np.isfinite(k).all() or np.abs(k).max() * self.length > 60.0:
                return None
        return None

    def _points(self, middle: float, k: Array) -> tuple[Array, float, Array]:
        first = _along(np.zeros(2), 0.0, k[0], k[1], middle, _NODES, _WEIGHTS)
        joint, angle = first
        end, _ = _along(joint, angle, k[1], k[2], self.length - middle, _NODES, _WEIGHTS)
        return joint, angle, end

    def _depth(self, middle: float, k: Array) -> float:
        worst = 0.0
        joint, angle, _ = self._points(middle, k)
        for start, turn, a, b, length in (
            (np.zeros(2), 0.0, k[0], k[1], middle),
            (joint, angle, k[1], k[2], self.length - middle),
        ):
            for part in np.linspace(0.05, 0.95, 12):
                end = a + (b - a) * part
                point, _ = _along(start, turn, a, end, part * length, _NODES, _WEIGHTS)
                worst = max(worst, self.reach - float(np.linalg.norm(point - self.centre)))
        return worst


def _along(
    start: Array, turn: float, a: float, b: float, length: float, nodes: Array, weights: Array
) -> tuple[Array, float]:
    """End point and end angle of a stretch whose curvature goes linearly from a to b."""
    angle = turn + length * nodes * (a + 0.5 * (b - a) * nodes)
    step = length * np.array([-(weights * np.sin(angle)).sum(), (weights * np.cos(angle)).sum()])
    return start + step, turn + 0.5 * length * (a + b)
