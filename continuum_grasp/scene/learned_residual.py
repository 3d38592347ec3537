"""Residual of a model, learned from logs: generalized forces as functions of its state."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from continuum_grasp.scene.families import FamilyName
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Length, Positive, Real, Value

_Row = Annotated[tuple[Annotated[Real, Unit("1")], ...], Field(strict=False)]
_Features = Annotated[tuple[Annotated[Real, Unit("unit of the feature")], ...], Field(strict=False, min_length=1)]
_Forces = Annotated[tuple[Annotated[Real, Unit("unit of the force")], ...], Field(strict=False)]
_Rows = Annotated[tuple[_Row, ...], Field(strict=False)]


class ResidualTraining(Value):
    """Record of how a residual was learned; nothing is computed from it."""

    logs: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Logs from which it was learned."""
    rows: Annotated[int, Field(ge=0)] = 0
    """Number of steps in them."""
    ridge: Annotated[float, Field(ge=0.0), Unit("1")] = 0.0
    """Weight of the squared weights, per that of the errors [1]."""
    error_share: Annotated[float, Field(ge=0.0), Unit("1")] = 0.0
    """Error of predictions over ten periods, per that of the model without the residual [1]."""


class LearnedResidual(Value):
    """Generalized forces that a model misses, learned from logs by ``continuum-grasp identify``.

    Each force is a weighted sum of a constant; of coordinates and rates, z (2 n), less their mean and per their
    standard deviation in the logs; of the directions of the rates, s = v / sqrt(v^2 + v0^2), with v0 three tenths of
    that deviation; of s times the magnitude of each drive's pull; and of kernels max(0, 1 - |y - c|^2 / width^2)^3,
    where y are the coordinates of z, s, and the scaled pulls. Where ``metric`` z, the pulls in z too, is longer than
    ``radius`` it fades; from one and a half times that on it is zero.
    """

    family: FamilyName
    """Curvature family of the model that it belongs to."""
    elements: Annotated[tuple[Length, ...], Field(strict=False, min_length=1, max_length=64)]
    """Lengths of that model's elements [m]."""
    coordinates: Annotated[tuple[str, ...], Field(strict=False, min_length=1, max_length=256)]
    """Names and units of that model's coordinates (n)."""
    drives: Annotated[tuple[str, ...], Field(strict=False, max_length=16)] = ()
    """Names and units of the states or inputs that say how drives pull (k)."""
    center: _Features
    """Mean of coordinates, rates and pulls in the logs (2 n + k) [unit of the feature]."""
    scale: Annotated[tuple[Annotated[Positive, Unit("unit of the feature")], ...], Field(strict=False, min_length=1)]
    """Standard deviations of the features (2 n + k) [unit of the feature]."""
    metric: _Rows
    """Upper triangular matrix (2 n + k, 2 n + k) [1] that makes them uncorrelated."""
    radius: Annotated[Positive, Unit("1")]
    """Greatest length of ``metric`` z in the logs [1]: the trust region."""
    kernels: _Rows = ()
    """Centers of the kernels (m, 2 n + k) [1]."""
    width: Annotated[Positive, Unit("1")] = 6.0
    """Distance from its center at which a kernel ends [1]."""
    weights: Annotated[tuple[_Forces, ...], Field(strict=False)]
    """Weights of each generalized force (n, 1 + 3 n + n k + m), in the order above [unit of the force]."""
    training: ResidualTraining | None = None
    """Record of the training."""

    def _check(self) -> None:
        n, k, m = len(self.coordinates), len(self.drives), len(self.kernels)
        d = 2 * n + k
        for name in ("center", "scale"):
            self._check_count(name, getattr(self, name), d, "coordinate, rate and drive")
        if len({*self.coordinates, *self.drives}) < n + k:
            raise ValueError("coordinates and drives must differ from each other")
        for name, rows, width in (("metric", d, d), ("kernels", m, d), ("weights", n, 1 + 3 * n + n * k + m)):
            given = getattr(self, name)
            if len(given) != rows or any(len(row) != width for row in given):
                raise ValueError(f"{name} must be {rows} rows of {width} numbers")
        if any(self.metric[i][j] != 0.0 for i in range(d) for j in range(i)):
            raise ValueError("metric must be zero below its diagonal")
        if any(self.metric[i][i] <= 0.0 for i in range(d)):
            raise ValueError("metric must be positive on its diagonal")
