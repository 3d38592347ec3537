"""The two real types that a package may compute in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.core.precision import literal, precision_of

__all__ = ["REALS", "Real", "real_of"]


@dataclass(frozen=True)
class Real:
    """A C type with its numpy reference and its IEEE 754 layout."""

    name: str
    dtype: Any
    bits: Any
    """Unsigned whole numbers of the same width."""
    mantissa_bits: int
    bias: int
    epsilon: float

    @property
    def width(self) -> int:
        """Bits of a number."""
        return 8 * int(np.dtype(self.dtype).itemsize)

    @property
    def bits_suffix(self) -> str:
        """Behind the u of a literal of so many bits."""
        return "" if self.width == 32 else "ll"

    @property
    def exponent_mask(self) -> int:
        """Bits of the exponent; all are set in numbers that are not finite."""
        return ((1 << (self.width - 1 - self.mantissa_bits)) - 1) << self.mantissa_bits

    @property
    def greatest(self) -> float:
        """The greatest finite number."""
        return float(np.finfo(self.dtype).max)

    @property
    def least_normal(self) -> float:
        """The least normal number above zero."""
        return float(np.finfo(self.dtype).tiny)

    def rounded(self, value: float) -> float:
        """The nearest number of the type."""
        return float(self.dtype(value))

    def literal(self, value: float) -> str:
        """C that means exactly ``rounded(value)``, in parentheses where negative.

        Raises
        ------
        InputError
            If it is outside the range of single precision.
        """
        text = literal(float(value), self.name, str(self.dtype(value)))
        return f"({text})" if text.startswith("-") else text

    def hexadecimal(self, value: float) -> str:
        """The number as a hexadecimal floating literal of C99."""
        return float(self.dtype(value)).hex() + ("f" if self.name == "float" else "")


REALS = {
    "float": Real("float", np.float32, np.uint32, 23, 127, float(np.finfo(np.float32).eps)),
    "double": Real("double", np.float64, np.uint64, 52, 1023, float(np.finfo(np.float64).eps)),
}


def real_of(name: Any) -> Real:
    """The type of a name.

    Raises
    ------
    InputError
        If there is none.
    """
    return REALS[precision_of(name)]
