"""All shapes of a finger of two elements that touch a fixed convex object as asked.

With a middle contact: the contact's place u on the grown outline fixes point and tangent of the joint. A circular arc
from the base meets both at single places only; a clothoid (curvature linear along it) at every place, in one or more
ways. The second element has one number left, which the tip's gap fixes. So arcs give single shapes and clothoids curves
of shapes over u, and a scan finds all of either.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.numbers import Hand, Numbers
from benchmarks.grasp_oracle.outline import Outline
from benchmarks.grasp_oracle.rod import NODES, WEIGHTS, Array, trace, walk

MOST = 2.0 * math.pi
"""Greatest bend of an element: its length times its greatest curvature [rad]."""
CLEARANCE = 1e-6
"""Depth that counts as none, per length of the finger: roots and distances to superellipses are good to 2e-7."""


@dataclass(frozen=True)
class Posture:
    """A shape of the finger."""

    u: float
    """Place of the middle contact on the grown outline [turns]; without one the first curvature times the length."""
    side: int
    """+1: the section's x axis is the object's outward normal at the middle contact; -1: its opposite."""
    ends: Array
    """Curvatures (2, 2) [1/m]."""
    lengths: Array
    """Of the elements (2,) [m]."""


class Fingers:
    """Shapes of one finger about the object."""

    def __init__(self, numbers: Numbers, hand: Hand) -> None:
        self.numbers, self.hand = numbers, hand
        self.outline: Outline = numbers.outline(hand.thickness)
        self.base = np.array(hand.base)

    # -- scans -----------------------------------------------------------------------------------------------

    def arcs(self, count: int = 1440) -> list[Posture]:
        """Every shape of two arcs that touches with middle and tip, or with the middle alone."""
        found = []
        u = np.linspace(0.0, 1.0, count + 1)
        for side in (1, -1):
            for turn in (0, 1, -1):
                gap, _, bend = self._arc_gap(u, side, turn)
                sign = (np.sign(gap[:-1]) != np.sign(gap[1:])) & (np.abs(gap[:-1] - gap[1:]) < 0.5)
                sign &= np.abs(bend[:-1] - bend[1:]) < 0.5
                if not sign.any():
                    continue
                # bound to locals: the loop goes on
                root = refine(
                    lambda v, s=side, t=turn: self._arc_gap(v, s, t)[0], u[:-1][sign], u[1:][sign], tolerance=1e-15
                )
                _, chord, bend = self._arc_gap(root, side, turn)
                half = 0.5 * bend
                length = chord * np.where(np.abs(half) < 1e-9, 1.0, half / np.where(half == 0, 1, np.sin(half)))
                good = (length >= self.hand.bounds[0]) & (length <= self.hand.bounds[1]) & (np.abs(bend) <= MOST)
                if good.any():
                    first = np.repeat((bend / length)[good, None], 2, axis=1)
                    found += self._ended(root[good], side, first, length[good], bends=True)
        return found

    def clothoids(self, count: int = 180) -> list[Posture]:
        """Shapes of two clothoids that touch with middle and tip, for many places of the middle contact."""
        u = np.arange(count) / count
        return self.at_places(u, 1) + self.at_places(u, -1)

    def at_places(self, u: Array, side: int) -> list[Posture]:
        """All shapes at some places of the curves: of the middle contact, or first curvatures times the length."""
        if not self.hand.middle:
            lengths = self._fixed_lengths()
            first = np.repeat((u / lengths[0])[:, None], 2, axis=1)
            return self._ended(u, side, first, np.full(len(u), lengths[0]), bends=True)
        found = self._first(u, side)
        if not found:
            return []
        places, ends, l1 = (np.array(v) for v in zip(*found, strict=True))
        return self._ended(places, side, ends, l1, bends=False)

    def free_arcs(self, count: int = 400) -> list[Posture]:
        """Shapes of two arcs of given lengths that touch with the tip alone, for many first and many second curvatures.

        Both, since curves of shapes turn back in either.
        """
        lengths = self._fixed_lengths()
        turns = np.linspace(-MOST, MOST, count)
        found = self.at_places(turns, 1)

        def gap(bend: Array, second: Array) -> Array:
            joint = self.base + walk(hand.angle, bend / lengths[0], bend / lengths[0], lengths[0])
            ahead = second / lengths[1]
            return np.asarray(self.outline.gap(joint + walk(hand.angle + bend, ahead, ahead, lengths[1])))

        hand = self.hand
        grid = np.linspace(-MOST, MOST, 281)
        table = gap(grid[:, None], turns[None, :])
        k, column = np.nonzero(np.sign(table[:-1]) != np.sign(table[1:]))
        roots = refine(lambda bend: gap(bend, turns[column]), grid[k], grid[k + 1])
        for bend, second in zip(roots, turns[column], strict=True):
            ends = np.repeat([[bend / lengths[0]], [second / lengths[1]]], 2, axis=1)
            found.append(Posture(float(bend), 1, ends, lengths))
        return found

    def unloaded(self, count: int = 800) -> list[Posture]:
        """Shapes of one curvature that touch with the tip: those of a finger without weight and contact force."""
        lengths = self._fixed_lengths()
        grid = np.linspace(-MOST, MOST, count) / lengths.max()

        def gap(curvature: Array) -> Array:
            return np.asarray(self.outline.gap(self.base + walk(self.hand.angle, curvature, curvature, lengths.sum())))

        values = gap(grid)
        k = np.nonzero(np.sign(values[:-1]) != np.sign(values[1:]))[0]
        roots = refine(gap, grid[k], grid[k + 1]) if len(k) else np.empty(0)
        return [Posture(float(c * lengths[0]), 1, np.full((2, 2), c), lengths) for c in roots]

    # -- one shape from a near one ----------------------------------------------------------------------------

    def near(self, like: Posture, u: float) -> Posture | None:
        """The shape at another place of the middle contact on the same curve of shapes."""
        hand = self.hand
        if not hand.middle:
            l1 = float(like.lengths[0])
            ends = np.array([u / l1, u / l1])
            return self._finish(u, like.side, ends, l1, float(like.ends[1, 1]), bends=True)
        point, normal = self.outline.at(np.array(u))
        chord = point - self.base
        angle = self._heading(normal, like.side)
        bend = float(like.ends[0].mean() * like.lengths[0])
        bend += math.remainder(angle - hand.angle - bend, 2.0 * math.pi)
        turn = self._solve(lambda a: self._aim(a, bend, chord), float(like.ends[0, 0] * like.lengths[0]), 1e-6)
        if turn is None:
            return None
        along = self._unit_walk(np.array(turn), np.array(bend))
        l1 = float(np.linalg.norm(chord) / np.linalg.norm(along))
        if not hand.bounds[0] <= l1 <= hand.bounds[1] or along @ chord < 0:
            return None
        ends = np.array([turn, 2.0 * bend - turn]) / l1
        if np.abs(ends).max() * l1 > MOST:
            return None
        return self._finish(u, like.side, ends, l1, float(like.ends[1, 1]), bends=False)

    def depth(self, postures: list[Posture], count: int = 100) -> Array:
        """Deepest that each shape goes into the object or a wall [m]; negative: it keeps clear."""
        ends, lengths = np.stack([p.ends for p in postures]), np.stack([p.lengths for p in postures])
        points, _ = trace(self.base, self.hand.angle, ends, lengths, count)
        center = np.array(self.numbers.com)
        near = self.numbers.size + self.hand.thickness + 3.0 * self.hand.length / count
        close = np.linalg.norm(points - center, axis=-1) < near
        gap = np.full(close.shape, np.inf)
        if close.any():
            gap[close] = self.outline.gap(points[close])
        deep = -_valleys(gap).reshape(len(postures), -1).min(axis=1)
        for point, normal in self.numbers.walls:
            heights = _valleys((points - np.array(point)) @ np.array(normal)).reshape(len(postures), -1)
            # Half the thickness above a wall, or as low as the base.
            least = min(self.hand.thickness, float((self.base - np.array(point)) @ np.array(normal)))
            deep = np.maximum(deep, least - heights.min(axis=1))
        return deep

    # -- pieces ----------------------------------------------------------------------------------------------

    def _fixed_lengths(self) -> Array:
        hand = self.hand
        first = hand.length * hand.before / hand.count
        return np.array([first, hand.length - first])

    def _heading(self, normal: Array, side: int) -> Any:
        return np.arctan2(side * normal[..., 1], side * normal[..., 0])

    def _arc_gap(self, u: Array, side: int, turn: int) -> tuple[Array, Array, Array]:
        """What is missing for an arc from the base to a place of the outline: angle; chord; bend."""
        point, normal = self.outline.at(u)
        chord = point - self.base
        bend = _wrap(self._heading(normal, side) - self.hand.angle) + 2.0 * math.pi * turn
        # a chord leans by half the bend; the tangent of an angle is its x axis turned by 90 degrees
        lean = np.arctan2(-chord[..., 0], chord[..., 1])
        return _wrap(lean - self.hand.angle - 0.5 * bend), np.linalg.norm(chord, axis=-1), bend

    def _unit_walk(self, turn: Array, bend: Array) -> Array:
        phi = self.hand.angle + turn[..., None] * NODES + (bend - turn)[..., None] * NODES**2
        return np.stack([-(np.sin(phi) @ WEIGHTS), np.cos(phi) @ WEIGHTS], axis=-1)

    def _aim(self, turn: Any, bend: Any, chord: Array) -> Any:
        """Sine-like measure of how far a clothoid with first curvature ``turn`` per length misses the chord."""
        along = self._unit_walk(np.asarray(turn), np.asarray(bend))
        across = along[..., 0] * chord[..., 1] - along[..., 1] * chord[..., 0]
        return across / np.linalg.norm(chord, axis=-1)

    def _first(self, u: Array, side: int) -> list[tuple[float, Array, float]]:
        """First elements: place, curvatures at both ends, length."""
        point, normal = self.outline.at(u)
        chord = point - self.base
        distance = np.linalg.norm(chord, axis=-1)
        small = _wrap(self._heading(normal, side) - self.hand.angle)
        found = []
        grid = np.linspace(-MOST, MOST, 121)
        for whole in (0.0, -2.0 * math.pi, 2.0 * math.pi):
            bend = small + whole
            some = (np.abs(bend) <= MOST) & (distance <= self.hand.bounds[1])
            if not some.any():
                continue
            where, b, c = u[some], bend[some], chord[some]
            miss = self._aim(grid[None, :], b[:, None], c[:, None, :])
            row, column = np.nonzero(np.sign(miss[:, :-1]) != np.sign(miss[:, 1:]))
            if not len(row):
                continue
            turn = refine(
                lambda a, b=b[row], c=c[row]: self._aim(a, b, c), grid[column], grid[column + 1], tolerance=1e-14
            )
            along = self._unit_walk(turn, b[row])
            length = distance[some][row] / np.linalg.norm(along, axis=-1)
            right = (along * c[row]).sum(-1) > 0.0
            right &= (length >= self.hand.bounds[0]) & (length <= self.hand.bounds[1])
            right &= np.abs(2.0 * b[row] - turn) <= MOST
            for k in np.nonzero(right)[0]:
                ends = np.array([turn[k], 2.0 * b[row][k] - turn[k]]) / length[k]
                found.append((float(where[row[k]]), ends, float(length[k])))
        return found

    def _ended(self, u: Array, side: int, first: Array, l1: Array, bends: bool) -> list[Posture]:
        """All shapes with these first elements (curvatures (n, 2), lengths (n,)) whose tips touch."""
        hand = self.hand
        l2 = hand.length - l1
        joint = self.base + walk(hand.angle, first[:, 0], first[:, 1], l1)
        angle = hand.angle + 0.5 * (first[:, 0] + first[:, 1]) * l1
        if not hand.tip:
            last = np.repeat(first[:, 1:], 2, axis=1)
            ends = np.stack([first, last], axis=1)
            return [Posture(float(p), side, e, np.array([a, b])) for p, e, a, b in zip(u, ends, l1, l2, strict=True)]
        grid = np.linspace(-MOST, MOST, 141)
        center, reach = np.array(self.numbers.com), self.numbers.size + hand.thickness
        begin = (grid if bends else first[:, 1:] * l2[:, None]) / l2[:, None]
        tips = joint[:, None] + walk(angle[:, None], begin, grid / l2[:, None], l2[:, None])
        gap = np.linalg.norm(tips - center, axis=-1) - reach
        close = gap < 0.0  # within the circle around the object, where the true gap is worth its cost
        if close.any():
            gap[close] = self.outline.gap(tips[close])
        row, k = np.nonzero(np.sign(gap[:, :-1]) != np.sign(gap[:, 1:]))
        if not len(row):
            return []
        ends = refine(
            lambda v: self._tip_gap(v / l2[row], joint[row], angle[row], first[row, 1], l2[row], bends),
            grid[k],
            grid[k + 1],
        )
        found = []
        for n, end in zip(row, ends / l2[row], strict=True):
            shape = np.array([first[n], [end if bends else first[n, 1], end]])
            found.append(Posture(float(u[n]), side, shape, np.array([l1[n], l2[n]])))
        return found

    def _tip_gap(self, end: Array, joint: Array, angle: Any, start: Any, length: Any, bends: bool) -> Array:
        begin = end if bends else np.broadcast_to(start, end.shape)
        return np.asarray(self.outline.gap(joint + walk(angle, begin, end, length)))

    def _finish(self, u: float, side: int, first: Array, l1: float, guess: float, bends: bool) -> Posture | None:
        hand = self.hand
        l2 = hand.length - l1
        joint = self.base + walk(hand.angle, first[0], first[1], l1)
        angle = hand.angle + 0.5 * (first[0] + first[1]) * l1

        def gap(end: float) -> float:
            return float(self._tip_gap(np.array([end]), joint, angle, first[1], l2, bends)[0])

        end = self._solve(gap, guess, 1e-6 / l2) if hand.tip else float(first[1])
        if end is None or abs(end) * l2 > MOST:
            return None
        return Posture(u, side, np.array([first, [end if bends else first[1], end]]), np.array([l1, l2]))

    @staticmethod
    def _solve(f: Any, start: float, step: float) -> float | None:
        """A root near a start, by secants."""
        x0, x1 = start, start + step
        f0, f1 = float(f(x0)), float(f(x1))
        for _ in range(30):
            if f1 == f0:
                return x1 if abs(f1) < 1e-12 else None
            x2 = x1 - f1 * (x1 - x0) / (f1 - f0)
            if abs(x2 - start) > 1e6 * step:
                return None
            x0, f0, x1 = x1, f1, x2
            f1 = float(f(x1))
            if abs(x1 - x0) < 1e-8 * step or f1 == 0.0:
                return x1
        return x1 if abs(f1) < 1e-12 else None


def _wrap(angle: Array) -> Array:
    """Into (-pi, pi]."""
    return np.asarray((np.asarray(angle) + math.pi) % (2.0 * math.pi) - math.pi)


def _valleys(gap: Array) -> Array:
    """Samples (..., K) lowered to the bottom of the parabola through each and its neighbors, where it has one."""
    before, here, after = gap[..., :-2], gap[..., 1:-1], gap[..., 2:]
    with np.errstate(invalid="ignore"):
        curve, slope = before - 2.0 * here + after, before - after
        bottom = (curve > 0.0) & np.isfinite(curve) & (np.abs(slope) <= 2.0 * curve)
        lower = here - slope**2 / (8.0 * np.where(bottom, curve, 1.0))
    found = gap.copy()
    found[..., 1:-1] = np.where(bottom, lower, here)
    return found


def refine(f: Callable[[Array], Array], low: Array, high: Array, steps: int = 60, tolerance: float = 1e-14) -> Array:
    """Roots between ``low`` and ``high``, where ``f`` (n,) -> (n,) has different signs (Chandrupatla's method)."""
    b, a = np.array(low, dtype=float), np.array(high, dtype=float)
    c = a.copy()
    fa, fb = f(a), f(b)
    fc = fa.copy()
    t = np.full_like(a, 0.5)
    best = b.copy()
    for _ in range(steps):
        x = a + t * (b - a)
        fx = f(x)
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        width = np.abs(b - a)
        limit = tolerance * (1.0 + np.abs(best)) / np.maximum(width, 1e-300)
        if ((limit > 0.5) | (fa == 0.0)).all():
            break
        with np.errstate(all="ignore"):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            smooth = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            quick = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        t = np.where(smooth & np.isfinite(quick), quick, 0.5)
        t = np.clip(t, np.minimum(limit, 0.5), 1.0 - np.minimum(limit, 0.5))
    return best
