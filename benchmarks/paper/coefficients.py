"""Exact coefficients of the paper's appendix: corrected, as printed, and with the missing rotation only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from continuum_grasp.model.planar import Scalar

__all__ = ["Coefficient", "Monomial", "Polynomial", "Reading", "misprint", "over", "right", "wrong"]

Reading = Literal["corrected", "printed", "unrotated"]
"""Which of the three values of a coefficient is taken."""


@dataclass(frozen=True)
class Coefficient:
    """A homogeneous polynomial in the arc lengths with rational coefficients.

    Attributes
    ----------
    denominator : int
    numerators : tuple of int
        Factors of L1^n, L1^(n-1) L2, ..., L2^n.
    """

    denominator: int
    numerators: tuple[int, ...]

    def __call__(self, l1: Scalar, l2: Scalar) -> Scalar:
        """Value for arc lengths l1, l2 [m]."""
        degree = len(self.numerators) - 1
        total: Scalar = 0.0
        for k, n in enumerate(self.numerators):
            if n:
                total = total + n * (l1 ** (degree - k) * l2**k)
        return total / self.denominator


@dataclass(frozen=True)
class Monomial:
    """The coefficient of one monomial of the bending angles, in the three readings.

    Attributes
    ----------
    corrected : Coefficient
        Taylor coefficient of the exact model.
    printed : Coefficient
        As the paper prints it.
    unrotated : Coefficient
        Taylor coefficient when the velocity of the contact is not turned into the axes of the second arc.
    """

    corrected: Coefficient
    printed: Coefficient
    unrotated: Coefficient

    @property
    def cause(self) -> str:
        """Why the printed value is wrong: "R" the missing rotation, "T" a misprint, "R + T" both, "" if it is right."""
        rotation = "R" if self.unrotated != self.corrected else ""
        misprint = "T" if self.printed != self.unrotated else ""
        return " + ".join(part for part in (rotation, misprint) if part)


Polynomial = Mapping[tuple[int, int], Monomial]
"""Powers of theta1 and theta2 -> coefficient."""


def over(denominator: int, *numerators: int) -> Coefficient:
    """A coefficient; ``over(18, 0, 0, -1, 0)`` is -L1 L2^2 / 18."""
    return Coefficient(denominator, numerators)


def right(denominator: int, *numerators: int) -> Monomial:
    """A monomial that the paper prints right."""
    value = over(denominator, *numerators)
    return Monomial(value, value, value)


def wrong(corrected: Coefficient, *, printed: Coefficient, unrotated: Coefficient | None = None) -> Monomial:
    """A monomial that the missing rotation makes wrong; misprinted besides, where ``unrotated`` is another value."""
    return Monomial(corrected, printed, printed if unrotated is None else unrotated)


def misprint(corrected: Coefficient, *, printed: Coefficient) -> Monomial:
    """A monomial that is wrong in print only."""
    return Monomial(corrected, printed, corrected)
