"""Real types of C: their literals, their bits, and generated C made to compute in ``float`` throughout."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import InputError


@dataclass(frozen=True)
class CReal:
    """A C type that controllers and packages compute in, with its numpy reference and its IEEE 754 layout."""

    KINDS: ClassVar[dict[str, CReal]]
    """Both types by name."""
    TOKEN: ClassVar[re.Pattern[str]] = re.compile(
        r"(?P<comment>/\*.*?\*/|//[^\n]*)|(?P<text>\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*')|(?P<name>[A-Za-z_]\w*)"
        r"|(?P<number>(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+)(?![\w.])|\d\w*",
        re.DOTALL,
    )
    """C tokens that may contain digits: comments, texts, names, real numbers without a suffix, all other numbers."""

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

    @staticmethod
    def named(given: Any) -> CReal:
        """Return the type of a name; InputError if there is none."""
        if not isinstance(given, str) or given not in CReal.KINDS:
            raise InputError(f"precision: expected one of {', '.join(CReal.KINDS)}, got {given!r:.60}")
        return CReal.KINDS[given]

    def written(self, value: float, text: str | None = None) -> str:
        """A constant as a literal, written as ``text`` where given; InputError if float cannot hold it."""
        text = repr(value) if text is None else text
        if self.name == "double":
            return text
        if abs(value) > self.greatest or 0.0 < abs(value) < self.least_normal:
            raise InputError(
                f"the model has a constant of {value:g}, beyond single precision ({self.least_normal:.2g} to "
                f"{self.greatest:.2g}): take double precision, or a smaller bending_range or a coarser accuracy (1e-8, "
                "say) of the model where its series are long"
            )
        return f"{text}f"

    def literal(self, value: float) -> str:
        """C that means exactly ``rounded(value)``; negative ones in parentheses, so that -(-1) is no decrement."""
        text = self.written(float(value), str(self.dtype(value)))
        return f"({text})" if text.startswith("-") else text

    def finite_literal(self, value: float) -> str:
        """The literal of the nearest finite number: C99 has none of infinity."""
        return self.literal(min(max(float(value), -self.greatest), self.greatest))

    def bit_pattern(self, bits: int) -> str:
        """Unsigned literal of C for the bits of a number."""
        return f"{hex(bits)}u{'' if self.width == 32 else 'll'}"

    def hexadecimal(self, value: float) -> str:
        """The number as a hexadecimal floating literal of C99."""
        return float(self.dtype(value)).hex() + ("f" if self.name == "float" else "")


CReal.KINDS = {
    "double": CReal("double", np.float64, np.uint64, 52, 1023, float(np.finfo(np.float64).eps)),
    "float": CReal("float", np.float32, np.uint32, 23, 127, float(np.finfo(np.float32).eps)),
}


def single(source: str) -> str:
    """C that CasADi generated, with ``float`` as its real type, literals of that type, and its mathematical functions.

    Setting ``casadi_real`` alone would leave every literal and every call of the library in double precision.
    """
    real = CReal.KINDS["float"]
    tokens = CReal.TOKEN.sub(lambda m: real.written(float(m["number"]), m["number"]) if m["number"] else m[0], source)
    return "#define casadi_real float\n" + tokens.replace("#include <math.h>", "#include <tgmath.h>")
