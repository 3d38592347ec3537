"""Model parameters that an estimator adapts."""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

from continuum_grasp.base import Array

_KNOWN = 0.5
"""Share of the standard deviation at the start below which a parameter counts as observed [1]: measurements tell three
times as much as was known before."""
_ABSOLUTE = ("tip_mass",)
"""Parameters with an additive error; errors of others are relative."""


class Observability(Enum):
    """Whether measurements tell a parameter."""

    OBSERVED = "observed"
    NOT_YET = "not observed yet"
    DEAD_TIME = "only lag and delay together are observed"


class Adapted(NamedTuple):
    """A parameter of ``estimator.adapt``: value, its standard deviation now and at the start, all in ``unit``.

    Of ``drive_time_constant``, which is ``DEAD_TIME`` at best, it stands for both the lag and the delay.
    """

    value: float
    std: float
    initial_std: float
    unit: str
    observability: Observability

    def __str__(self) -> str:
        return f"{self.value:.4g} ± {self.std:.2g} {self.unit} ({self.observability.value})"

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {**self._asdict(), "observability": self.observability.name.lower()}


class AdaptedState(NamedTuple):
    """An adapted parameter: name and unit, indices in z and p, deviation of its error at the start."""

    label: str
    state: int
    parameter: int
    spread: float

    @property
    def name(self) -> str:
        """Name without unit."""
        return self.label.split(" ")[0]

    def read(self, p: Array, z: Array, deviations: Array) -> Adapted:
        """Combine the estimate: of parameters (np) with their errors, of the state (nz) and its standard
        deviations.
        """
        value, error, std = p[self.parameter], z[self.state], deviations[self.state]
        # The deviation of a relative error is that per the parameter as it was given.
        scale = 1.0 if self.name in _ABSOLUTE else value / (1.0 + error)
        observability = Observability.NOT_YET
        if std < _KNOWN * self.spread:
            observability = Observability.DEAD_TIME if self.name == "drive_time_constant" else Observability.OBSERVED
        unit = self.label.split(" ", 1)[1][1:-1]
        return Adapted(float(value), float(scale * std), float(scale * self.spread), unit, observability)
