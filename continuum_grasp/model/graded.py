"""Links of rods that are not uniform, by numbers that are integrated when the model is built."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from continuum_grasp.base import Array, InputError
from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.family import RodProperties
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.quadrature import STRICT, Collocation, graded_collocation
from continuum_grasp.scene import Curve, Panels

_MOST_NODES = 32
"""Most nodes of each smooth part of an element [1]."""
_ROUNDING = 3e-14
"""Relative error of a rule that is rounding [1]: two rules that are exact differ by some 2e-14."""
_FIT = 20
"""Degree of the polynomials for bending angles within an element [1]; terms below rounding are cut off."""


@dataclass(frozen=True)
class CurvatureShapes:
    """Curvature shapes on one element: hat functions or moments, less their values at its ends, per stiffness."""

    start: float
    end: float
    stiffness: Curve
    rest: Curve
    parts: Panels  # with smooth curves
    values: tuple[tuple[float, float], ...]  # per shape, what of the linear functions from start and end is in it
    moments: tuple[Curve | None, ...]  # per shape
    linear_density: Curve
    rotary_inertia: Curve

    def on(self, s: Array, *, tip_side: bool = False) -> Array:
        """Shapes (K, M), and the rest curvature as one more row, at positions (M,) [m]; at jumps on one side."""
        rising = (s - self.start) / (self.end - self.start)
        rows = []
        for (first, last), moment in zip(self.values, self.moments, strict=True):
            row = first * (1.0 - rising) + last * rising
            rows.append(row if moment is None else row + moment(s, tip_side=tip_side))
        bent = np.array(rows) / self.stiffness(s, tip_side=tip_side)
        return np.vstack([bent, self.rest(s, tip_side=tip_side)])

    @cached_property
    def sides(self) -> Array:
        """Shapes (K + 1, 2 P) at both ends of each part, from inside."""
        starts, ends = np.array(self.parts).T
        both = [self.on(starts, tip_side=True), self.on(ends)]
        return np.stack(both, axis=-1).reshape(len(self.values) + 1, -1)

    @property
    def peaks(self) -> Array:
        """Greatest sizes (K,) of the shapes, at the ends of the parts."""
        return np.asarray(np.abs(self.sides[:-1]).max(axis=1))

    @cached_property
    def gram(self) -> Array:
        """Integrals (K, K) of the stiffness times products of shapes."""
        return self.parts.integral(lambda s: (shapes := self.on(s)[:-1])[:, None] * shapes * self.stiffness(s))

    def work(self, moment: Curve) -> Array:
        """Integrals (K,) of a moment times the shapes."""
        return self.parts.cut(moment).integral(lambda s: self.on(s)[:-1] * moment(s))

    @cached_property
    def angles(self) -> list[Array]:
        """Return, per part, coefficients (degree + 1, K + 1) of the integrals of the shapes and of the rest curvature.

        They belong to powers of the distance from the part's middle, per half its length.
        """
        total, coefficients = np.zeros(len(self.values) + 1), []
        x = chebyshev.chebpts1(_FIT)
        # The inverse of the table at these nodes is its transpose, except for the first row.
        transform = 2.0 / _FIT * chebyshev.chebvander(x, _FIT - 1).T
        transform[0] *= 0.5
        for a, b in self.parts:
            s, half = a + 0.5 * (b - a) * (x + 1.0), 0.5 * (b - a)
            series = transform @ self.on(s).T
            # Digits below rounding would only be carried along.
            series[np.abs(series) < 1e-15 * np.abs(series).max(axis=0, initial=1e-300)] = 0.0
            integral = [chebyshev.cheb2poly(chebyshev.chebint(c, lbnd=-1.0) * half) for c in series.T]
            powers: Array = np.column_stack([np.pad(c, (0, _FIT + 1 - len(c))) for c in integral]).astype(float)
            powers[0] += total
            total = powers.sum(axis=0)
            coefficients.append(powers[: np.flatnonzero(np.any(powers, axis=1))[-1] + 1])
        return coefficients

    def angle(self, fraction: Scalar, piece: int) -> list[Scalar]:
        """Integrals of shapes and rest curvature from the start to a fraction of the length on a part [m, rad]."""
        (a, b), length = self.parts[piece], self.end - self.start
        # Numbers of the parts are fractions too; 0 and 1 stay exact.
        v = ((self.start - a) + fraction * length) * (2.0 / (b - a)) - 1.0
        table = self.angles[piece]
        integrals: list[Scalar] = []
        for column in table.T.tolist():
            while len(column) > 1 and column[-1] == 0.0:
                column = column[:-1]
            value: Scalar = column[-1]
            for c in reversed(column[:-1]):
                value = value * v + c
            integrals.append(value)
        return integrals

    def rule(self, count: int) -> Collocation:
        """A rule with nodes on each part."""
        length = self.end - self.start
        pieces = [((a - self.start) / length, (b - self.start) / length) for a, b in self.parts]
        pieces[0], pieces[-1] = (0.0, pieces[0][1]), (pieces[-1][0], 1.0)
        return graded_collocation(
            pieces,
            count,
            lambda u: self.linear_density(self.start + length * u),
            lambda u: self.rotary_inertia(self.start + length * u),
        )


@lru_cache(maxsize=1024)
def measured_rule(shapes: CurvatureShapes, reach: float, accuracy: float) -> Collocation:
    """Find the quadrature rule with the fewest nodes and the required accuracy, for bends up to ``reach`` [rad].

    Its error is the difference from a finer rule: mass matrix and end point over extreme shapes, relative to the
    largest entry.
    """
    length = shapes.end - shapes.start
    peaks = shapes.peaks
    # Bent all one way, to both sides, and by one end or one moment alone; scaled so that the range is used.
    turns = np.vstack([np.eye(len(peaks)), np.ones(len(peaks)), [(-1.0) ** k for k in range(len(peaks))]])
    cases = []
    # A cone may have its greatest curvature inside.
    looked = np.hstack([shapes.sides[:-1], *(shapes.on(s)[:-1] for s, _ in shapes.parts.nodes())])
    for turn in np.vstack([turns, -turns]) / peaks:
        bend = np.abs(turn @ looked).max() * length
        cases.append(turn * (reach / bend))
    fewest = 3 if len(shapes.parts) == 1 else 2

    def sample(count: int) -> tuple[Array, Array]:
        rule = shapes.rule(count)
        points = zip(rule.nodes, rule.piece, strict=True)
        angles = np.array([shapes.angle(float(u), piece) for u, piece in points], dtype=float).T
        phi, rest = angles[:-1], angles[-1]
        ends, masses = [], []
        for q in cases:
            direction = q @ phi + rest
            ends.append(rule.weights @ np.exp(1j * direction))
            scaled = phi / peaks[:, None]
            kernel = rule.kernel * np.cos(direction[:, None] - direction[None, :])
            masses.append(scaled @ kernel @ scaled.T)
        return np.array(ends), np.array(masses)

    wanted = max(accuracy if accuracy > STRICT else 0.1 * accuracy, _ROUNDING)
    # 8: by how many nodes per piece a rule is finer that another one is measured with
    end, mass = sample(_MOST_NODES + 8)
    for count in range(fewest, _MOST_NODES + 1):
        ends, masses = sample(count)
        error = max(np.abs(ends - end).max(), np.abs(masses - mass).max() / np.abs(mass).max())
        if error <= wanted:
            return shapes.rule(count)
    raise InputError(
        f"the element from {shapes.start:g} to {shapes.end:g} m tapers or bends so much that {_MOST_NODES} nodes leave "
        f"an error of {error:.2g} where {accuracy:.2g} is wanted: take more elements",
        key="elements",
    )


class GradedLink(CollocatedLink):
    """A link with varying stiffness, mass or rest curvature, or with the end of a known moment."""

    def __init__(
        self,
        local: Sequence[Scalar],
        shapes: CurvatureShapes,
        rod: RodProperties,
        reach: float,
        rule: Collocation,
        end_mass: float,
    ) -> None:
        self._shapes = shapes
        length = shapes.end - shapes.start
        super().__init__(local, length, rod.linear_density, rod.rotary_inertia, reach, rule, end_mass)
        self._bent: Scalar = 0.0 if rod.rest is None else rod.rest

    def _angles(self, fraction: Scalar, piece: int) -> list[Scalar]:
        return [phi / self._length for phi in self._shapes.angle(fraction, piece)[:-1]]

    def _rest(self, fraction: Scalar, piece: int) -> Scalar:
        if isinstance(self._bent, float) and self._bent == 0.0:
            return self._shapes.angle(fraction, piece)[-1]
        return self._bent * self._length * fraction

    @property
    def curvatures(self) -> list[Scalar]:
        shapes, rest = np.split(self._shapes.sides, [-1])
        first, *inside, last = (
            sum((b * q for b, q in zip(column.tolist(), self._local, strict=True)), float(k) + self._bent)
            for column, k in zip(shapes.T, rest[0], strict=True)
        )
        return [first, last, *inside]
