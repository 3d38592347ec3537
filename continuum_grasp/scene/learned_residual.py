"""What a model misses, as it was learned from logs: generalized forces as functions of its state."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from continuum_grasp.scene.families import FamilyName
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Length, Positive, Real, Value

_Row = Annotated[tuple[Annotated[Real, Unit("1")], ...], Field(strict=False)]
_Rows = Annotated[tuple[_Row, ...], Field(strict=False)]


class ResidualTraining(Value):
    """How a residual was learned; nothing is computed from it."""

    logs: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Logs from which it was learned."""
    rows: Annotated[int, Field(ge=0)] = 0
    """Number of steps in them."""
    ridge: Annotated[float, Field(ge=0.0), Unit("1")] = 0.0
    """Weight of the squared weights, per that of the errors [1]; chosen by cross-validation."""
    error_share: Annotated[float, Field(ge=0.0), Unit("1")] = 0.0
    """Root mean square of one-step errors in cross-validation, per that of the model without the residual [1]."""


class LearnedResidual(Value):
    """Generalized forces that a model misses, learned from logs by ``continuum-grasp identify``.

    Of the features less ``center`` and per ``scale``, z (d), each force is a sum of a constant, of z, and of kernels
    max(0, 1 - |z - c|^2 / width^2)^3 about ``kernels`` c. Beyond ``radius`` of the length of ``metric`` z it fades; from
    one and a half times that on it is zero.
    """

    family: FamilyName
    """Curvature family of the model that it belongs to."""
    elements: Annotated[tuple[Length, ...], Field(strict=False, min_length=1, max_length=64)]
    """Lengths of that model's elements [m]."""
    features: Annotated[tuple[str, ...], Field(strict=False, min_length=1, max_length=64)]
    """Names and units of the model's states and inputs that it depends on (d)."""
    center: Annotated[_Row, Field(min_length=1)]
    """Mean of each feature in the logs (d), in its unit."""
    scale: Annotated[tuple[Annotated[Positive, Unit("unit of the feature")], ...], Field(strict=False, min_length=1)]
    """Standard deviation of each feature (d) [unit of the feature]."""
    metric: _Rows
    """Upper triangular matrix (d, d) [1] that makes the features of the logs uncorrelated."""
    radius: Annotated[Positive, Unit("1")]
    """Greatest length of ``metric`` z in the logs [1]: the trust region."""
    kernels: _Rows = ()
    """Centers of the kernels (m, d), in standard deviations from the mean [1]."""
    width: Annotated[Positive, Unit("1")] = 6.0
    """Distance from its center at which a kernel ends, in standard deviations [1]."""
    weights: _Rows
    """Of each generalized force the constant, the weights of z and of the kernels (n, 1 + d + m) [unit of the force]."""
    training: ResidualTraining | None = None
    """How it was learned."""

    def _check(self) -> None:
        d, m = len(self.features), len(self.kernels)
        for name in ("center", "scale"):
            if len(getattr(self, name)) != d:
                raise ValueError(f"{name} must have an entry per feature ({d}), got {len(getattr(self, name))}")
        if len(set(self.features)) < d:
            raise ValueError("features must differ from each other")
        for name, rows, width in (("metric", d, d), ("kernels", m, d), ("weights", None, 1 + d + m)):
            given = getattr(self, name)
            if (rows is not None and len(given) != rows) or any(len(row) != width for row in given):
                raise ValueError(f"{name} must be of {'any number of' if rows is None else rows} rows of {width} numbers")
        if any(self.metric[i][j] != 0.0 for i in range(d) for j in range(i)):
            raise ValueError("metric must be zero below its diagonal")
        if any(self.metric[i][i] <= 0.0 for i in range(d)):
            raise ValueError("metric must be positive on its diagonal")
        if not self.weights:
            raise ValueError("weights must have a row per coordinate of the model")
