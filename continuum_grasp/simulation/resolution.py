"""Report how well the elements of a model resolve shapes at rest, small motions and motions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from continuum_grasp.base import Array

ENOUGH = 0.01
"""Default limit of the error of the elements [1], of a position per length and of a frequency: the stiffness of a
finger is seldom known better."""
OF_MODES = 2
"""Number of natural frequencies that must satisfy the limit in modes; higher ones only state their errors."""


@dataclass(frozen=True)
class Resolution:
    """Errors that the elements leave, and whether they are small enough.

    Attributes
    ----------
    elements : int
        Number of elements of the result.
    error : float
        Greatest error of position per length [1]; infinite if twice as many elements find no shape, nan without a
        comparison.
    frequencies : (m,) ndarray
        Relative errors of natural frequencies [1], from the first on; empty without a comparison.
    stable : bool or None
        Whether the exact rod, or a model with twice as many elements, is stable there; None if unknown.
    settled : bool
        Whether more elements confirm the verdict on stability.
    limit : float
        Limit of the error [1].
    counted : int
        Number of natural frequencies, from the first on, that must satisfy the limit.
    stated : bool
        Whether the user stated the elements: these are retained.
    enough : int or None
        Number of elements that satisfies the limit, if found.
    tried : int
        Greatest tried number of elements.
    raised : str
        Error with fewer elements, in words, if the program raised their number.
    from_rod : float
        Distance to the exact rod near the shape, per length [1], if the elements converge elsewhere; otherwise nan.
    """

    FAILED: ClassVar = "under_resolved"
    """Status of a result whose error is beyond the limit with the greatest number of elements."""

    elements: int
    error: float = math.nan
    frequencies: Array = field(default_factory=lambda: np.zeros(0))
    stable: bool | None = None
    settled: bool = True
    limit: float = ENOUGH
    counted: int = 0
    stated: bool = False
    enough: int | None = None
    tried: int = 0
    raised: str = ""
    from_rod: float = math.nan

    def joined(self, other: Resolution) -> Resolution:
        """Return the worse of two shapes at rest with the same elements, in every respect."""
        count = min(len(self.frequencies), len(other.frequencies))
        verdicts = {self.stable, other.stable}
        return replace(
            self,
            error=float(np.fmax(self.error, other.error)),
            frequencies=np.fmax(self.frequencies[:count], other.frequencies[:count]),
            stable=False if False in verdicts else None if None in verdicts else True,
            settled=self.settled and other.settled,
        )

    @property
    def counting(self) -> Array:
        """Errors of the frequencies that must satisfy the limit [1]."""
        return self.frequencies[: self.counted]

    @property
    def suffices(self) -> bool:
        """Whether all known errors are within the limit."""
        return self.settled and not self.error > self.limit and not np.any(self.counting > self.limit)

    @property
    def fails(self) -> bool:
        """Whether the number of elements was open, and no tried number suffices."""
        return not self.suffices and not self.stated

    @property
    def left(self) -> str:
        """Errors that the elements leave, in words."""
        parts = []
        if self.error > self.limit:
            parts.append(f"an error of {_share(self.error)} of the length" if self.error < math.inf else "no shape")
        off = [k for k, error in enumerate(self.counting, 1) if error > self.limit]
        parts += [f"natural frequency {k} wrong by {_share(self.frequencies[k - 1])}" for k in off]
        if not self.settled:
            verdict = "a shape that is unstable" if self.stable is False else "the stability open"
            parts.append(f"{verdict}, near a critical load")
        of = f"{self.elements} element{'s leave' if self.elements > 1 else ' leaves'}"
        return f"{of} {' and '.join(parts) or f'less than {_share(self.limit)}'}"

    def note(self, family: str) -> str:
        """Reason for the number of elements; empty if it is the initial one."""
        return f"{self.elements} x {family}: {self.raised}" if self.raised else ""

    @property
    def outcome(self) -> str:
        """Outcome, in one line, of a result beyond the limit."""
        return f"not within {_share(self.limit)}: {self.left}"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warning that the elements do not suffice, with a number that does."""
        if self.suffices:
            return ()
        if not self.stated:
            return (f"{self.outcome}; more elements are not tried",)
        if self.enough is not None:
            return (f"{self.left}: fidelity.elements: {self.enough} keeps {_share(self.limit)}",)
        more = f", and up to {self.tried} do not suffice" if self.tried > self.elements else ""
        return (f"{self.left}{more}: take more elements, or fidelity.tolerance",)


def _share(error: float) -> str:
    """Write a relative error for users."""
    if error >= 2.0:
        return f"{error:.2g} times its value" if math.isfinite(error) else "any amount"
    return f"{100.0 * error:.2g} %"
