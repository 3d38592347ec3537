"""Mathematical functions that give the same bits everywhere: additions, multiplications and divisions alone.

``c_source`` writes them as C, ``REFERENCE`` evaluates them on numpy arrays in the very same order of operations. Cosine
and sine reduce the angle by multiples of pi/2 in three parts (W. J. Cody, W. Waite, Software Manual for the Elementary
Functions, 1980), the exponential by multiples of ln 2 in two; both then are Taylor polynomials. The square root is
Newton's iteration for its inverse from a linear guess of the exponent, and one step of Heron's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.export.fields import Real
from continuum_grasp.export.template import fill

Array = NDArray[Any]


@dataclass(frozen=True)
class _Series:
    """Constants of one precision; all are numbers of that precision."""

    half_pi: tuple[float, float, float]
    ln2: tuple[float, float]
    sine: int
    """Terms of the sine; the cosine has one more."""
    exponential: int
    """Degree of the exponential."""
    newton: int
    """Iterations of the square root."""
    guess: int
    """Bits of the first guess of 1 / sqrt(x), less half those of x."""
    widest: tuple[float, float]
    """Arguments at which the exponential is zero or infinite for certain."""
    scale: tuple[float, float]
    """What brings a subnormal number up for the square root, and what takes the root down again."""


_SERIES = {
    "float": _Series(
        half_pi=(1.5703125, 4.837512969970703e-4, 7.549789954891882e-8),
        ln2=(0.693359375, -2.12194440e-4),
        sine=5,
        exponential=8,
        newton=3,
        guess=0x5F3759DF,
        widest=(-110.0, 90.0),
        scale=(2.0**24, 2.0**-12),
    ),
    "double": _Series(
        half_pi=(1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
        ln2=(6.93147180369123816490e-01, 1.90821492927058770002e-10),
        sine=8,
        exponential=14,
        newton=4,
        guess=0x5FE6EB50C7B537A9,
        widest=(-750.0, 710.0),
        scale=(2.0**54, 2.0**-27),
    ),
}


def c_source(names: Iterable[str], real: Real, prefix: str) -> str:
    """C of the named functions, in their own precision.

    Parameters
    ----------
    names : iterable of str
        Of ``FUNCTIONS``.
    real : Real
        What they compute in.
    prefix : str
        Of the package's names.
    """
    s, wanted = _SERIES[real.name], sorted(set(names))
    words = {
        "p": prefix,
        "P": prefix.upper(),
        "width": str(real.width),
        "exponent_mask": hex(real.exponent_mask) + "u" + real.bits_suffix,
        "guess": hex(s.guess) + "u" + real.bits_suffix,
        "newton": str(s.newton),
        "least": real.literal(real.least_normal),
        "up": real.literal(s.scale[0]),
        "down": real.literal(s.scale[1]),
        "per_ln2": real.literal(1.0 / math.log(2.0)),
        "ln2_1": real.literal(s.ln2[0]),
        "ln2_2": real.literal(s.ln2[1]),
        "exp_least": real.literal(s.widest[0]),
        "exp_most": real.literal(s.widest[1]),
        "bias": str(real.bias),
        "mantissa": str(real.mantissa_bits),
        "exp_series": _braces(_exponential(s), real),
        "exp_last": str(s.exponential),
        "per_half_pi": real.literal(2.0 / math.pi),
        "pi_1": real.literal(s.half_pi[0]),
        "pi_2": real.literal(s.half_pi[1]),
        "pi_3": real.literal(s.half_pi[2]),
        "sin_series": _braces(_sine(s), real),
        "cos_series": _braces(_cosine(s), real),
        "sin_last": str(s.sine - 1),
        "cos_last": str(s.sine),
        "half": real.literal(0.5),
        "three_halves": real.literal(1.5),
        "zero": real.literal(0.0),
        "one": real.literal(1.0),
    }
    parts = []
    if {"sin", "cos"} & set(wanted):
        parts.append(fill("strict/turn.c", words))
    return "\n".join([*parts, *(fill(f"strict/{name}.c", words) for name in wanted)])


def _braces(values: list[float], real: Real) -> str:
    return "{" + ", ".join(real.literal(v) for v in values) + "}"


def _exponential(s: _Series) -> list[float]:
    """Coefficients from the highest power down."""
    return [1.0 / math.factorial(k) for k in range(s.exponential, -1, -1)]


def _sine(s: _Series) -> list[float]:
    return [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(s.sine - 1, -1, -1)]


def _cosine(s: _Series) -> list[float]:
    return [(-1.0) ** k / math.factorial(2 * k) for k in range(s.sine, -1, -1)]


# -- the same on arrays --------------------------------------------------------------------------------------------


def _horner(coefficients: list[float], x: Array) -> Array:
    t = x.dtype.type
    value: Array = np.full_like(x, t(coefficients[0]))
    for c in coefficients[1:]:
        value = value * x + t(c)
    return value


def _nearest(x: Array) -> Array:
    """The nearest whole numbers, halves away from zero, as C's truncating cast finds them."""
    half = x.dtype.type(0.5)
    return np.asarray(np.trunc(x + np.where(x < 0, -half, half)))


def _power_of_two(k: Array, real: Real) -> Array:
    bits = (k.astype(np.int64) + real.bias) << real.mantissa_bits
    return np.asarray(bits.astype(real.bits).view(real.dtype))


def _exp(x: Array, real: Real) -> Array:
    s, t = _SERIES[real.name], real.dtype
    x = np.where(x < t(s.widest[0]), t(s.widest[0]), np.where(x > t(s.widest[1]), t(s.widest[1]), x))
    k = _nearest(x * t(1.0 / math.log(2.0)))
    r = (x - k * t(s.ln2[0])) - k * t(s.ln2[1])
    first = np.trunc(k / t(2.0))
    with np.errstate(over="ignore", under="ignore"):
        return _horner(_exponential(s), r) * _power_of_two(first, real) * _power_of_two(k - first, real)


def _turn(x: Array, real: Real, quarters: int) -> Array:
    """Cosine of x less so many quarters of a turn."""
    s, t = _SERIES[real.name], real.dtype
    k = _nearest(x * t(2.0 / math.pi))
    r = ((x - k * t(s.half_pi[0])) - k * t(s.half_pi[1])) - k * t(s.half_pi[2])
    square, at = r * r, (k.astype(np.int64) - quarters) & 3
    cosine, sine = _horner(_cosine(s), square), r * _horner(_sine(s), square)
    value = np.where(at & 1, sine, cosine)
    return np.where((at == 1) | (at == 2), -value, value)


def _sqrt(x: Array, real: Real) -> Array:
    s, t = _SERIES[real.name], real.dtype
    with np.errstate(all="ignore"):
        small = x < t(real.least_normal)
        scaled = np.where(small, x * t(s.scale[0]), x)
        y = (real.bits(s.guess) - (scaled.view(real.bits) >> real.bits(1))).view(t)
        for _ in range(s.newton):
            y = y * (t(1.5) - t(0.5) * scaled * y * y)
        root = scaled * y
        root = t(0.5) * (root + scaled / root)
        root = np.where(small, root * t(s.scale[1]), root)
        return np.where(x > 0, root, np.where(x < 0, t(np.nan), x))


FUNCTIONS: dict[str, Callable[[Array, Real], Array]] = {
    "cos": lambda x, real: _turn(x, real, 0),
    "exp": _exp,
    "sin": lambda x, real: _turn(x, real, 1),
    "sqrt": _sqrt,
}
"""Functions that kernels may call, by name, on arrays of the precision."""


def reference(name: str, x: Array, real: Real) -> Array:
    """A function on an array of finite numbers."""
    return FUNCTIONS[name](x, real)
