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
    """Three parts of pi/2, the first ones of few digits, so that their products with whole numbers are exact."""
    ln2: tuple[float, float]
    """Two parts of ln 2, the same way."""
    sine: int
    """Terms of the sine; the cosine has one more. The first left out is below half a rounding at pi / 4."""
    exponential: int
    """Degree of the exponential; the first term left out is below half a rounding at ln 2 / 2."""
    newton: int
    """Iterations of the square root: each turns the relative error e, 0.034 of the guess, into 1.5 e^2."""
    guess: int
    """Bits of the first guess of 1 / sqrt(x), less half those of x; of the double by M. Robertson, A Brief History of
    InvSqrt (2012)."""
    widest: tuple[float, float]
    """Arguments at which the exponential is near the least normal number, or infinite for certain; lesser ones are
    taken for the first, so that what divides by it (friction of tendons) never divides by zero."""
    scale: tuple[float, float]
    """What brings a subnormal number up for the square root, and what takes the root down again."""

    @property
    def exponential_series(self) -> list[float]:
        """Taylor coefficients from the highest power down, as Horner's rule takes them."""
        return [1.0 / math.factorial(k) for k in range(self.exponential, -1, -1)]

    @property
    def sine_series(self) -> list[float]:
        """The same of sin(x) / x in x^2."""
        return [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(self.sine - 1, -1, -1)]

    @property
    def cosine_series(self) -> list[float]:
        """The same of cos(x) in x^2."""
        return [(-1.0) ** k / math.factorial(2 * k) for k in range(self.sine, -1, -1)]


_SERIES = {
    "float": _Series(
        half_pi=(1.5703125, 4.837512969970703e-4, 7.549789954891882e-8),
        ln2=(0.693359375, -2.12194440e-4),
        sine=5,
        exponential=8,
        newton=3,
        guess=0x5F3759DF,
        widest=(-87.0, 90.0),
        scale=(2.0**24, 2.0**-12),
    ),
    "double": _Series(
        half_pi=(1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
        ln2=(6.93147180369123816490e-01, 1.90821492927058770002e-10),
        sine=8,
        exponential=14,
        newton=4,
        guess=0x5FE6EB50C7B537A9,
        widest=(-708.0, 710.0),
        scale=(2.0**54, 2.0**-27),
    ),
}


def c_source(names: Iterable[str], real: Real, prefix: str) -> str:
    """C of the named functions (cos, exp, sin, sqrt) in their own precision, for a package's prefix."""
    s, wanted = _SERIES[real.name], sorted(set(names))
    numbers = {
        "least": real.least_normal,
        "up": s.scale[0],
        "down": s.scale[1],
        "per_ln2": 1.0 / math.log(2.0),
        "ln2_1": s.ln2[0],
        "ln2_2": s.ln2[1],
        "exp_least": s.widest[0],
        "exp_most": s.widest[1],
        "per_half_pi": 2.0 / math.pi,
        "pi_1": s.half_pi[0],
        "pi_2": s.half_pi[1],
        "pi_3": s.half_pi[2],
        "half": 0.5,
        "three_halves": 1.5,
        "zero": 0.0,
        "one": 1.0,
    }
    series = {"exp": s.exponential_series, "sin": s.sine_series, "cos": s.cosine_series}
    words = {
        "p": prefix,
        "P": prefix.upper(),
        "width": real.width,
        "exponent_mask": real.bit_pattern(real.exponent_mask),
        "guess": real.bit_pattern(s.guess),
        "newton": s.newton,
        "bias": real.bias,
        "mantissa": real.mantissa_bits,
        **{name: real.literal(value) for name, value in numbers.items()},
        **{f"{name}_series": f"{{{', '.join(map(real.literal, values))}}}" for name, values in series.items()},
        **{f"{name}_last": len(values) - 1 for name, values in series.items()},
    }
    shared = ["turn"] if {"sin", "cos"} & set(wanted) else []
    return "\n".join(fill(f"strict/{name}.c", words) for name in (*shared, *wanted))


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
    # 2^k in two factors: k is one beyond the exponents of normal numbers where the result is just finite.
    first = np.trunc(k / t(2.0))
    with np.errstate(over="ignore", under="ignore"):
        return _horner(s.exponential_series, r) * _power_of_two(first, real) * _power_of_two(k - first, real)


def _turn(x: Array, real: Real, quarters: int) -> Array:
    """Cosine of x less so many quarters of a turn."""
    s, t = _SERIES[real.name], real.dtype
    k = _nearest(x * t(2.0 / math.pi))
    r = ((x - k * t(s.half_pi[0])) - k * t(s.half_pi[1])) - k * t(s.half_pi[2])
    square, at = r * r, (k.astype(np.int64) - quarters) & 3
    cosine, sine = _horner(s.cosine_series, square), r * _horner(s.sine_series, square)
    # cos(r + at pi/2) is cos r, -sin r, -cos r, sin r for at = 0, 1, 2, 3.
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


_FUNCTIONS: dict[str, Callable[[Array, Real], Array]] = {
    "cos": lambda x, real: _turn(x, real, 0),
    "exp": _exp,
    "sin": lambda x, real: _turn(x, real, 1),
    "sqrt": _sqrt,
}


def reference(name: str, x: Array, real: Real) -> Array:
    """A function that kernels may call on an array of finite numbers of the precision, as its C computes it."""
    return _FUNCTIONS[name](x, real)
