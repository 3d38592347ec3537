"""Mathematical functions that give the same bits everywhere: additions, multiplications and divisions alone.

``c_source`` writes them as C, ``REFERENCE`` evaluates them on numpy arrays in the very same order of operations. Cosine
and sine reduce the angle by multiples of pi/2 in three parts (W. J. Cody, W. Waite, Software Manual for the Elementary
Functions, 1980), the exponential by multiples of ln 2 in two; both then are Taylor polynomials. The square root is
Newton's iteration for its inverse from a linear guess of the exponent, and one step of Heron's. The logarithm is the
series of artanh behind the exponent, the angle of a vector that of arctan behind eighths of a turn; the others follow
from these.

Errors, in roundings (epsilon) of the result: sqrt, exp, log, sin, cos 2 (of one for sine and cosine); expm1, log1p,
atan, atan2, asin, acos, cosh 3; tan, tanh, sinh 5; pow 2 + 2 |y log(x)|.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
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
    logarithm: int
    """Terms of artanh(s) / s in s^2; the first left out is below half a rounding at the greatest s, 0.172."""
    arctangent: int
    """Terms of arctan(t) / t in t^2; the first left out is below half a rounding at tan(pi / 8)."""
    half_pi_rest: float
    """pi / 2 less its nearest number."""
    saturation: float
    """From where on tanh is one, and the lesser exponential of sinh and cosh nothing."""
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

    @cached_property
    def coefficients(self) -> dict[str, list[float]]:
        """Series from the highest power down, as Horner's rule takes them: exp(x); sin(x) / x and cos(x) in x^2;
        2 artanh(s) / s in s^2; arctan(t) / t in t^2.
        """
        series = {
            "exp": [1.0 / math.factorial(k) for k in range(self.exponential + 1)],
            "sin": [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(self.sine)],
            "cos": [(-1.0) ** k / math.factorial(2 * k) for k in range(self.sine + 1)],
            "log": [2.0 / (2 * k + 1) for k in range(self.logarithm)],
            "atan": [(-1.0) ** k / (2 * k + 1) for k in range(self.arctangent)],
        }
        return {name: values[::-1] for name, values in series.items()}


_SERIES = {
    "float": _Series(
        half_pi=(1.5703125, 4.837512969970703e-4, 7.549789954891882e-8),
        ln2=(0.693359375, -2.12194440e-4),
        sine=5,
        exponential=8,
        logarithm=6,
        arctangent=9,
        half_pi_rest=-4.371139000186241e-08,
        saturation=10.0,
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
        logarithm=11,
        arctangent=21,
        half_pi_rest=6.123233995736766e-17,
        saturation=20.0,
        newton=4,
        guess=0x5FE6EB50C7B537A9,
        widest=(-708.0, 710.0),
        scale=(2.0**54, 2.0**-27),
    ),
}


def c_source(names: Iterable[str], real: Real, prefix: str) -> str:
    """C of the named functions, keys of ``FUNCTIONS``, in their own precision, for a package's prefix."""
    s, wanted = _SERIES[real.name], _with_needs(names)
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
        "two": 2.0,
        "three_halves": 1.5,
        "most_angle": _MOST_ANGLE,
        "root_two": math.sqrt(2.0),
        "tan_eighth": _TAN_EIGHTH,
        "quarter_pi": 0.25 * math.pi,
        "half_pi": 0.5 * math.pi,
        "half_pi_rest": s.half_pi_rest,
        "tanh_most": s.saturation,
        "zero": 0.0,
        "one": 1.0,
    }
    words = {
        "p": prefix,
        "P": prefix.upper(),
        "width": real.width,
        "exponent_mask": real.bit_pattern(real.exponent_mask),
        "guess": real.bit_pattern(s.guess),
        "newton": s.newton,
        "bias": real.bias,
        "mantissa": real.mantissa_bits,
        "sign_bit": real.width - 1,
        "up_power": round(math.log2(s.scale[0])),
        **{name: real.literal(value) for name, value in numbers.items()},
        **{f"{name}_series": f"{{{', '.join(map(real.literal, values))}}}" for name, values in s.coefficients.items()},
        **{f"{name}_last": len(values) - 1 for name, values in s.coefficients.items()},
    }
    return "\n".join(fill(f"strict/{name}.c", words) for name in wanted)


_MOST_ANGLE = 1e9
"""Greatest angle that is reduced [rad]: quarters of a turn within it are whole numbers of 32 bits."""
_TAN_EIGHTH = math.sqrt(2.0) - 1.0
_NEEDS = {
    "turn": ("nan",),
    "sqrt": ("nan",),
    "cos": ("turn",),
    "sin": ("turn",),
    "tan": ("turn",),
    "exp": ("power_of_two",),
    "expm1": ("nan", "exp"),
    "log": ("nan",),
    "log1p": ("log",),
    "tanh": ("nan", "expm1"),
    "sinh": ("nan", "expm1"),
    "cosh": ("nan", "exp"),
    "atan2": ("nan",),
    "atan": ("atan2",),
    "asin": ("sqrt", "atan2"),
    "acos": ("sqrt", "atan2"),
    "pow": ("exp", "log"),
}
"""Functions that the C of a function calls."""


def _with_needs(names: Iterable[str]) -> list[str]:
    """Functions with those that they call, each behind what it calls."""
    found: dict[str, None] = {}
    for name in sorted(set(names)):
        found |= dict.fromkeys([*_with_needs(_NEEDS.get(name, ())), name])
    return list(found)


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
        return _horner(s.coefficients["exp"], r) * _power_of_two(first, real) * _power_of_two(k - first, real)


def _turn(x: Array, real: Real, quarters: int) -> Array:
    """Cosine of x less so many quarters of a turn."""
    s, t = _SERIES[real.name], real.dtype
    k = _nearest(np.clip(x, -t(_MOST_ANGLE), t(_MOST_ANGLE)) * t(2.0 / math.pi))
    r = ((x - k * t(s.half_pi[0])) - k * t(s.half_pi[1])) - k * t(s.half_pi[2])
    square, at = r * r, (k.astype(np.int64) - quarters) & 3
    cosine, sine = _horner(s.coefficients["cos"], square), r * _horner(s.coefficients["sin"], square)
    # cos(r + at pi/2) is cos r, -sin r, -cos r, sin r for at = 0, 1, 2, 3.
    value = np.where(at & 1, sine, cosine)
    value = np.where((at == 1) | (at == 2), -value, value)
    return np.where(np.abs(x) > t(_MOST_ANGLE), t(np.nan), value)


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


def _expm1(x: Array, real: Real) -> Array:
    s, t = _SERIES[real.name], real.dtype
    near = np.clip(x, t(-1), t(1))
    k = _nearest(near * t(1.0 / math.log(2.0)))
    r = (near - k * t(s.ln2[0])) - k * t(s.ln2[1])
    scale = _power_of_two(k, real)
    value = scale * (_horner(s.coefficients["exp"][:-1], r) * r) + (scale - t(1))
    return np.asarray(np.where(np.abs(x) > 1, _exp(x, real) - t(1), value))


def _log(x: Array, real: Real) -> Array:
    s, t = _SERIES[real.name], real.dtype
    small = x < t(real.least_normal)
    scaled = np.where(x > 0, np.where(small, x * t(s.scale[0]), x), t(1))
    exponent = (scaled.view(real.bits) >> real.bits(real.mantissa_bits)).astype(np.int64) - real.bias
    fraction = scaled.view(real.bits) & real.bits((1 << real.mantissa_bits) - 1)
    m = (fraction | real.bits(real.bias << real.mantissa_bits)).view(t)
    k = np.where(small, exponent - round(math.log2(s.scale[0])), exponent)
    beyond = m > t(math.sqrt(2.0))
    m, k = np.where(beyond, t(0.5) * m, m), np.where(beyond, k + 1, k).astype(t)
    ratio = (m - t(1)) / (m + t(1))
    value = k * t(s.ln2[0]) + (k * t(s.ln2[1]) + ratio * _horner(s.coefficients["log"], ratio * ratio))
    return np.asarray(np.where(x > 0, value, np.where(x < 0, t(np.nan), t(-np.inf))))


def _log1p(x: Array, real: Real) -> Array:
    t = real.dtype
    u = t(1) + x
    off = u - t(1)
    return np.asarray(np.where(off != 0, _log(u, real) * (x / np.where(off != 0, off, t(1))), x))


def _tan(x: Array, real: Real) -> Array:
    sine, cosine = _turn(x, real, 1), _turn(x, real, 0)
    return np.where(cosine != 0, sine / np.where(cosine != 0, cosine, 1), real.dtype(np.nan))


def _signed(x: Array, value: Array) -> Array:
    return np.where(x < 0, -value, value)


def _tanh(x: Array, real: Real) -> Array:
    t = real.dtype
    e = _expm1(t(2) * np.abs(x), real)
    return _signed(x, np.where(np.abs(x) > t(_SERIES[real.name].saturation), t(1), e / (e + t(2))))


def _sinh(x: Array, real: Real) -> Array:
    t, size = real.dtype, np.abs(x)
    root, e = _exp(t(0.5) * size, real), _expm1(size, real)
    far = size > t(_SERIES[real.name].saturation)
    return _signed(x, np.where(far, t(0.5) * root * root, t(0.5) * (e + e / (e + t(1)))))


def _cosh(x: Array, real: Real) -> Array:
    t, size = real.dtype, np.abs(x)
    far = size > t(_SERIES[real.name].saturation)
    e = _exp(np.where(far, t(0.5) * size, size), real)
    return np.asarray(np.where(far, t(0.5) * e * e, t(0.5) * e + t(0.5) / e))


def _atan2(y: Array, x: Array, real: Real) -> Array:
    s, t = _SERIES[real.name], real.dtype
    a, b = np.abs(y), np.abs(x)
    none, steep, rest = (a == 0) & (b == 0), a > b, t(s.half_pi_rest)
    ratio = np.where(steep, b, a) / np.where(none, t(1), np.where(steep, a, b))
    turned = ratio > t(_TAN_EIGHTH)
    ratio = np.where(turned, (ratio - t(1)) / (ratio + t(1)), ratio)
    value = ratio * _horner(s.coefficients["atan"], ratio * ratio)
    value = np.where(turned, t(0.25 * math.pi) + (value + t(0.5) * rest), value)
    value = np.where(steep, t(0.5 * math.pi) - (value - rest), value)
    value = np.where(x < 0, t(2) * t(0.5 * math.pi) - (value - t(2) * rest), value)
    return np.where(none, t(0), _signed(y, value))


def _cathetus(x: Array, real: Real) -> Array:
    return _sqrt((real.dtype(1) - x) * (real.dtype(1) + x), real)


def _pow(x: Array, y: Array, real: Real) -> Array:
    t = real.dtype
    of_zero = np.where(y > 0, t(0), np.where(y < 0, t(np.nan), t(1)))
    return np.where(x == 0, of_zero, _exp(y * _log(x, real), real))


FUNCTIONS: dict[str, Callable[..., Array]] = {
    "acos": lambda x, real: _atan2(_cathetus(x, real), x, real),
    "asin": lambda x, real: _atan2(x, _cathetus(x, real), real),
    "atan": lambda x, real: _atan2(x, np.ones_like(x), real),
    "atan2": _atan2,
    "cos": lambda x, real: _turn(x, real, 0),
    "cosh": _cosh,
    "exp": _exp,
    "expm1": _expm1,
    "log": _log,
    "log1p": _log1p,
    "pow": _pow,
    "sin": lambda x, real: _turn(x, real, 1),
    "sinh": _sinh,
    "sqrt": _sqrt,
    "tan": _tan,
    "tanh": _tanh,
}
"""On arrays of finite numbers of a precision, by name, as their C computes them."""


def reference(name: str, *arguments: Array, real: Real) -> Array:
    """A function of ``FUNCTIONS`` on arrays of the precision, as its C computes it."""
    with np.errstate(all="ignore"):
        found = FUNCTIONS[name](*arguments, real)
    if name in ("cos", "exp", "sin", "sqrt"):  # which pass on what is not finite
        return found
    finite = np.logical_and.reduce([np.isfinite(a) for a in arguments])
    return np.where(finite, found, real.dtype(np.nan))
