"""Mathematical functions that give the same bits everywhere: additions, multiplications and divisions alone.

``c_source`` writes them as C, ``REFERENCE`` evaluates them on numpy arrays in the very same order of operations. Cosine
and sine reduce the angle by multiples of pi/2 in three parts (W. J. Cody, W. Waite, Software Manual for the Elementary
Functions, 1980), the exponential by multiples of ln 2 in two; both then are Taylor polynomials. The square root is
Newton's iteration for its inverse from a linear guess of the exponent, and one step of Heron's. The logarithm is the
series of artanh behind the exponent, the angle of a vector the series of arctan behind eighths of a turn; the others
follow from these.

Errors, in roundings (epsilon) of the result: sqrt, exp, log, sin, cos 2 (of one for sine and cosine); expm1, log1p,
atan, atan2, asin, acos, cosh 3; tan, tanh, sinh 5; pow 2 + 2 |y log(x)|.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import CReal
from continuum_grasp.export.fields import fill

_NUMBERS = {
    "half": 0.5,
    "one": 1.0,
    "three_halves": 1.5,
    "two": 2.0,
    "zero": 0.0,
    "per_ln2": 1.0 / math.log(2.0),
    "per_half_pi": 2.0 / math.pi,
    "quarter_pi": 0.25 * math.pi,
    "half_pi": 0.5 * math.pi,
    "root_two": math.sqrt(2.0),
    "tan_eighth": math.sqrt(2.0) - 1.0,
    "most_angle": 1e9,  # reduced [rad]: quarters of a turn within it are whole numbers of 32 bits
}
"""Constants of both precisions."""
_OWN_NUMBERS = {
    # Three parts of pi / 2 and two of ln 2, the first ones of few digits, so that their products with whole numbers are
    # exact; pi / 2 less its nearest number.
    "pi_1": (1.5703125, 1.57079632673412561417),
    "pi_2": (4.837512969970703e-4, 6.07710050630396597660e-11),
    "pi_3": (7.549789954891882e-8, 2.02226624879595063154e-21),
    "ln2_1": (0.693359375, 6.93147180369123816490e-01),
    "ln2_2": (-2.12194440e-4, 1.90821492927058770002e-10),
    "half_pi_rest": (-4.371139000186241e-08, 6.123233995736766e-17),
    # From where on tanh is one, and the lesser exponential of sinh and cosh nothing.
    "tanh_most": (10.0, 20.0),
    # Arguments at which the exponential is near the least normal number, or infinite for certain; lesser ones are taken
    # for the first, so that what divides by it (friction of tendons) never divides by zero.
    "exp_least": (-87.0, -708.0),
    "exp_most": (90.0, 710.0),
    # What brings a subnormal number up for the square root, and what takes the root down again.
    "up": (2.0**24, 2.0**54),
    "down": (2.0**-12, 2.0**-27),
}
"""Constants of float and double, numbers of that precision."""
_COUNTS = {
    # Terms of Taylor series, of which the first left out is below half a rounding: sin(x) / x and cos(x) in x^2 at
    # pi / 4; exp(x) at ln 2 / 2; 2 artanh(s) / s in s^2 at the greatest s, 0.172; arctan(t) / t in t^2 at tan(pi / 8).
    "sin": (5, 8),
    "cos": (6, 9),
    "exp": (9, 15),
    "log": (6, 11),
    "atan": (9, 21),
    # Iterations of the square root: each turns the relative error e, 0.034 of the guess, into 1.5 e^2.
    "newton": (3, 4),
    # Bits of the first guess of 1 / sqrt(x), less half those of x; of the double by M. Robertson, A Brief History of
    # InvSqrt (2012).
    "guess": (0x5F3759DF, 0x5FE6EB50C7B537A9),
    "up_power": (24, 54),
}
"""Whole numbers of float and double."""
_TERMS: dict[str, Callable[[int], float]] = {
    "exp": lambda k: 1.0 / math.factorial(k),
    "sin": lambda k: (-1.0) ** k / math.factorial(2 * k + 1),
    "cos": lambda k: (-1.0) ** k / math.factorial(2 * k),
    "log": lambda k: 2.0 / (2 * k + 1),
    "atan": lambda k: (-1.0) ** k / (2 * k + 1),
}
"""Coefficients of the series."""


@cache
def _constants(real: CReal) -> SimpleNamespace:
    """Constants in their own precision, and series from the highest power down, as Horner's rule takes them."""
    at = ("float", "double").index(real.name)
    counts = {name: values[at] for name, values in _COUNTS.items()}
    numbers = _NUMBERS | {name: values[at] for name, values in _OWN_NUMBERS.items()} | {"least": real.least_normal}
    return SimpleNamespace(
        real=real,
        numbers=list(numbers),
        **{name: real.dtype(value) for name, value in numbers.items()},
        **{name: counts[name] for name in ("newton", "guess", "up_power")},
        **{name: [real.dtype(term(k)) for k in range(counts[name])][::-1] for name, term in _TERMS.items()},
    )


def c_source(names: Iterable[str], real: CReal, prefix: str) -> str:
    """C of the named functions, keys of ``FUNCTIONS``, with what they call, for a package's prefix."""
    n = _constants(real)
    words = {
        "p": prefix,
        "n": n,
        "real": real,
        "exponent_mask": real.bit_pattern(real.exponent_mask),
        "guess": real.bit_pattern(n.guess),
        "sign_bit": real.width - 1,
        **{name: real.literal(getattr(n, name)) for name in n.numbers},
        **{f"{name}_series": f"{{{', '.join(map(real.literal, getattr(n, name)))}}}" for name in _TERMS},
        **{f"{name}_last": len(getattr(n, name)) - 1 for name in _TERMS},
    }
    sources: dict[str, str] = {}

    def add(name: str) -> None:
        """Add a function behind what it calls."""
        text = fill(f"strict/{name}.c", words)
        for called in sorted(set(_CALL.findall(text)) - {name, *sources}):
            add(called)
        sources[name] = text

    for name in sorted(set(names)):
        if name not in sources:
            add(name)
    return "\n".join(sources.values())


_CALL = re.compile(r"\bstrict_(\w+)\(")


# -- the same on arrays, by the constants of their precision ---------------------------------------------------------


def _horner(coefficients: list[Any], x: Array) -> Array:
    value: Array = np.full_like(x, coefficients[0])
    for c in coefficients[1:]:
        value = value * x + c
    return value


def _nearest(x: Array) -> Array:
    """The nearest whole numbers, halves away from zero, as C's truncating cast finds them."""
    half = x.dtype.type(0.5)
    return np.asarray(np.trunc(x + np.where(x < 0, -half, half)))


def _power_of_two(k: Array, n: SimpleNamespace) -> Array:
    bits = (k.astype(np.int64) + n.real.bias) << n.real.mantissa_bits
    return np.asarray(bits.astype(n.real.bits).view(n.real.dtype))


def _by_ln2(x: Array, n: SimpleNamespace) -> tuple[Array, Array]:
    """Whole multiples of ln 2, and the remainder."""
    k = _nearest(x * n.per_ln2)
    return k, (x - k * n.ln2_1) - k * n.ln2_2


def _exp(x: Array, n: SimpleNamespace) -> Array:
    k, r = _by_ln2(np.where(x < n.exp_least, n.exp_least, np.where(x > n.exp_most, n.exp_most, x)), n)
    # 2^k in two factors: k is one beyond the exponents of normal numbers where the result is just finite.
    first = np.trunc(k / n.two)
    return _horner(n.exp, r) * _power_of_two(first, n) * _power_of_two(k - first, n)


def _turn(x: Array, n: SimpleNamespace, quarters: int) -> Array:
    """Cosine of x less so many quarters of a turn."""
    k = _nearest(np.clip(x, -n.most_angle, n.most_angle) * n.per_half_pi)
    r = ((x - k * n.pi_1) - k * n.pi_2) - k * n.pi_3
    square = r * r
    at = (k.astype(np.int64) - quarters) & 3
    # cos(r + at pi/2) is cos r, -sin r, -cos r, sin r for at = 0, 1, 2, 3.
    value = np.where(at & 1, r * _horner(n.sin, square), _horner(n.cos, square))
    value = np.where((at == 1) | (at == 2), -value, value)
    return np.where(np.abs(x) > n.most_angle, n.real.dtype(np.nan), value)


def _sqrt(x: Array, n: SimpleNamespace) -> Array:
    bits = n.real.bits
    small = x < n.least
    scaled = np.where(small, x * n.up, x)
    y = (bits(n.guess) - (scaled.view(bits) >> bits(1))).view(n.real.dtype)
    for _ in range(n.newton):
        y = y * (n.three_halves - n.half * scaled * y * y)
    root = scaled * y
    root = n.half * (root + scaled / root)
    root = np.where(small, root * n.down, root)
    return np.where(x > 0, root, np.where(x < 0, n.real.dtype(np.nan), x))


def _expm1(x: Array, n: SimpleNamespace) -> Array:
    k, r = _by_ln2(np.clip(x, -n.one, n.one), n)
    scale = _power_of_two(k, n)
    value = scale * (_horner(n.exp[:-1], r) * r) + (scale - n.one)
    return np.asarray(np.where(np.abs(x) > 1, _exp(x, n) - n.one, value))


def _log(x: Array, n: SimpleNamespace) -> Array:
    bits = n.real.bits
    bias = n.real.bias
    mantissa = n.real.mantissa_bits
    small = x < n.least
    scaled = np.where(x > 0, np.where(small, x * n.up, x), n.one).view(bits)
    exponent = (scaled >> bits(mantissa)).astype(np.int64) - bias
    m = ((scaled & bits((1 << mantissa) - 1)) | bits(bias << mantissa)).view(n.real.dtype)
    beyond = m > n.root_two
    m = np.where(beyond, n.half * m, m)
    k = (exponent - n.up_power * small + beyond).astype(n.real.dtype)
    ratio = (m - n.one) / (m + n.one)
    value = k * n.ln2_1 + (k * n.ln2_2 + ratio * _horner(n.log, ratio * ratio))
    return np.asarray(np.where(x > 0, value, np.where(x < 0, n.real.dtype(np.nan), n.real.dtype(-np.inf))))


def _log1p(x: Array, n: SimpleNamespace) -> Array:
    u = n.one + x
    off = u - n.one
    return np.asarray(np.where(off != 0, _log(u, n) * (x / np.where(off != 0, off, n.one)), x))


def _tan(x: Array, n: SimpleNamespace) -> Array:
    sine = _turn(x, n, 1)
    cosine = _turn(x, n, 0)
    return np.where(cosine != 0, sine / np.where(cosine != 0, cosine, 1), n.real.dtype(np.nan))


def _signed(x: Array, value: Array) -> Array:
    return np.where(x < 0, -value, value)


def _tanh(x: Array, n: SimpleNamespace) -> Array:
    e = _expm1(n.two * np.abs(x), n)
    return _signed(x, np.where(np.abs(x) > n.tanh_most, n.one, e / (e + n.two)))


def _sinh(x: Array, n: SimpleNamespace) -> Array:
    size = np.abs(x)
    root = _exp(n.half * size, n)
    e = _expm1(size, n)
    return _signed(x, np.where(size > n.tanh_most, n.half * root * root, n.half * (e + e / (e + n.one))))


def _cosh(x: Array, n: SimpleNamespace) -> Array:
    far = np.abs(x) > n.tanh_most
    e = _exp(np.where(far, n.half * np.abs(x), np.abs(x)), n)
    return np.asarray(np.where(far, n.half * e * e, n.half * e + n.half / e))


def _atan2(y: Array, x: Array, n: SimpleNamespace) -> Array:
    a, b = np.abs(y), np.abs(x)
    none = (a == 0) & (b == 0)
    steep = a > b
    ratio = np.where(steep, b, a) / np.where(none, n.one, np.where(steep, a, b))
    turned = ratio > n.tan_eighth
    ratio = np.where(turned, (ratio - n.one) / (ratio + n.one), ratio)
    value = ratio * _horner(n.atan, ratio * ratio)
    value = np.where(turned, n.quarter_pi + (value + n.half * n.half_pi_rest), value)
    value = np.where(steep, n.half_pi - (value - n.half_pi_rest), value)
    value = np.where(x < 0, n.two * n.half_pi - (value - n.two * n.half_pi_rest), value)
    return np.where(none, n.zero, _signed(y, value))


def _cathetus(x: Array, n: SimpleNamespace) -> Array:
    return _sqrt((n.one - x) * (n.one + x), n)


def _pow(x: Array, y: Array, n: SimpleNamespace) -> Array:
    of_zero = np.where(y > 0, n.zero, np.where(y < 0, n.real.dtype(np.nan), n.one))
    return np.where(x == 0, of_zero, _exp(y * _log(x, n), n))


FUNCTIONS: dict[str, Callable[..., Array]] = {
    "acos": lambda x, n: _atan2(_cathetus(x, n), x, n),
    "asin": lambda x, n: _atan2(x, _cathetus(x, n), n),
    "atan": lambda x, n: _atan2(x, np.ones_like(x), n),
    "atan2": _atan2,
    "cos": lambda x, n: _turn(x, n, 0),
    "cosh": _cosh,
    "exp": _exp,
    "expm1": _expm1,
    "log": _log,
    "log1p": _log1p,
    "pow": _pow,
    "sin": lambda x, n: _turn(x, n, 1),
    "sinh": _sinh,
    "sqrt": _sqrt,
    "tan": _tan,
    "tanh": _tanh,
}
"""On arrays of finite numbers of a precision, by name, as their C computes them."""


def reference(name: str, *arguments: Array, real: CReal) -> Array:
    """A function of ``FUNCTIONS`` on arrays of the precision, as its C computes it."""
    with np.errstate(all="ignore"):
        results = FUNCTIONS[name](*arguments, _constants(real))
    if name in ("cos", "exp", "sin", "sqrt"):  # which pass on what is not finite
        return results
    finite = np.logical_and.reduce([np.isfinite(a) for a in arguments])
    return np.where(finite, results, real.dtype(np.nan))
