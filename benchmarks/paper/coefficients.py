"""Exact coefficients of the paper's appendix: corrected, as printed, and with the missing rotation only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

from continuum_grasp.model import Scalar

Reading = Literal["corrected", "printed", "unrotated"]
"""Which of the three values of a coefficient is taken."""


@dataclass(frozen=True)
class Coefficient:
    """A homogeneous polynomial in the arc lengths with rational coefficients."""

    denominator: int
    numerators: tuple[int, ...]
    """Factors of L1^n, L1^(n-1) L2, ..., L2^n."""

    @property
    def fractions(self) -> dict[tuple[int, int], Fraction]:
        """Powers of L1 and L2 -> coefficient, zeros left out."""
        degree = len(self.numerators) - 1
        return {(degree - k, k): Fraction(n, self.denominator) for k, n in enumerate(self.numerators) if n}

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
    """The coefficient of one monomial of the bending angles, in the three readings."""

    corrected: Coefficient
    """Taylor coefficient of the exact model."""
    printed: Coefficient
    """As the paper prints it."""
    unrotated: Coefficient
    """Taylor coefficient when the velocity of the contact is not turned into the axes of the second arc."""

    @property
    def cause(self) -> str:
        """Why the printed value is wrong: "R" the missing rotation, "T" a misprint, "R + T" both, "" if it is right."""
        rotation = "R" if self.unrotated != self.corrected else ""
        misprint = "T" if self.printed != self.unrotated else ""
        return " + ".join(part for part in (rotation, misprint) if part)


Polynomial = Mapping[tuple[int, int], Monomial]
"""Powers of theta1 and theta2 -> coefficient."""


def _monomial(text: str) -> Monomial:
    """Read what ``appendix.txt`` says of a coefficient after its powers."""
    values, cause = text.rstrip(" RT").split(" | "), text[-1]
    corrected, *others = (
        Coefficient(int(denominator), tuple(map(int, numerators.strip("()").split())))
        for numerators, denominator in (value.split("/") for value in values)
    )
    printed = others[0] if others else corrected
    unrotated = others[-1] if cause == "R" or len(others) == 2 else corrected
    return Monomial(corrected, printed, unrotated)


def _tables() -> Iterator[dict[str, Polynomial]]:
    """The tables of ``appendix.txt``, in their order."""
    for part in Path(__file__).with_name("appendix.txt").read_text(encoding="utf-8").split("\n\n")[1:]:
        table: dict[str, dict[tuple[int, int], Monomial]] = {}
        name = ""
        for line in part.splitlines()[1:]:
            powers, _, text = line.partition(": ")
            if text:
                i, j = map(int, powers.split())
                table[name][i, j] = _monomial(text)
            else:
                table[name := line] = {}
        yield dict(table)


MASS, BIAS, JACOBIAN, GRAVITY_ALONG, GRAVITY_ACROSS = _tables()
"""Polynomials by their names in (A.1), (A.3), (A.2) and (A.4); the paper has none of gravity across."""
