"""Where the closed forms of the paper, equations (10)-(38), are printed wrong: both readings side by side.

C1 is cos(theta1) and so on. A slip with ``factors`` is a wrong rational factor; the others are of structure. How a
formula is read that cannot be meant as it stands is said in ``read``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from fractions import Fraction

from continuum_grasp.base import InputError


@dataclass(frozen=True)
class Slip:
    """One difference between the printed and the corrected closed forms."""

    printed: str
    corrected: str
    factors: tuple[Fraction, Fraction] | None = None
    """As printed and as corrected, where that is all."""
    read: str = ""
    """How the printed formula is read, where it cannot be meant literally."""


def _factor(where: str, printed: int, corrected: int) -> Slip:
    factors = Fraction(printed), Fraction(corrected)
    return Slip(f"factor {printed} of {where}", f"{corrected:+}", factors)


_AS_NUMBERS = "the numbers in SI units, although the dimensions do not agree"

SLIPS: dict[str, Slip] = {
    "(16) s": Slip("angle s theta2 / L2", "(s - L1) theta2 / L2"),
    "(19) cosine": _factor("C1 in the second row", -2, 2),
    "(19) rate": Slip("no rate of theta1", "all times the rate of theta1"),
    "(20) cosine": _factor("C2 in the second row", -2, 2),
    "(24) names": Slip("the two off-diagonal entries under each other's names", "the other way round"),
    "(24) plus": Slip("J_t21: product of its two terms", "their sum", read=_AS_NUMBERS),
    "(24) J12 bracket": Slip("J_t12: L2/theta2^2 before the first term only", "before both", read=_AS_NUMBERS),
    "(24) J22 bracket": Slip("J_t22: L2/theta2^2 before the first term only", "before both", read=_AS_NUMBERS),
    "(25) column": Slip("x and y in a row", "x and y in the first column"),
    "(25) cosine": _factor("C1 in y", -2, 2),
    "(26) names": Slip("the two off-diagonal entries under each other's names", "the other way round"),
    "(26) plus": Slip("J_G21: product of its two terms", "their sum", read=_AS_NUMBERS),
    "(26) cosine": _factor("C2 in J_G12", -2, 2),
    "(26) J22 end": Slip("J_G22 ends after its first term", "+ (theta2 S2 + 2 C2 - 2) C1 follows"),
    "(36) axes": Slip(
        "vcx, vcy not defined", "R_c' times column 1 of J_c", read="column 1 of J_c, as the appendix does"
    ),
    "(36) twice": _factor("the two cross terms of M11", 1, 2),
    "(36) M11 sine": _factor("S1/theta1^5 in M11", -1, -4),
    "(36) M12 cosine": _factor("C2 before vcy in M12", -2, 2),
    "(36) M12 end": Slip(
        "theta2^4 - (1 - C2)/theta2^3 + 1/(2 theta2^2)",
        "(1 - C2)/theta2^4 - S2/theta2^3 + 1/(2 theta2^2)",
        read="literally, although the fraction bar seems lost",
    ),
    "(36) M22 sine": _factor("S2/theta2^5 in M22", -1, -4),
}
"""By equation and key word."""

ALL = frozenset(SLIPS)
"""Everything as printed."""

DYNAMIC = frozenset(key for key in SLIPS if key[:4] in ("(24)", "(25)", "(26)", "(36)"))
"""Those that the motion depends on; velocities (16)-(20) enter through the Jacobians alone."""


class AsPrinted:
    """Which slips a formula is written with: keys of ``SLIPS`` that are taken as printed; the others are corrected."""

    def __init__(self, keys: Collection[str] = ()) -> None:
        unknown = sorted(set(keys) - ALL)
        if unknown:
            raise InputError(f"unknown slip {unknown[0]!r}: expected some of {', '.join(SLIPS)}")
        self._keys = frozenset(keys)

    def __contains__(self, key: str) -> bool:
        if key not in ALL:
            raise KeyError(key)
        return key in self._keys

    def factor(self, key: str) -> float:
        """The rational factor of a slip that has one."""
        factors = SLIPS[key].factors
        if factors is None:
            raise InputError(f"slip {key!r} is not a matter of a factor")
        return float(factors[0 if key in self._keys else 1])
