"""How far one can go along a straight line in forces until a limit is met."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

__all__ = ["way", "way_in_cone"]

Array = NDArray[Any]


def way(value: float, rate: float, low: float, high: float) -> float:
    """How far a value that changes at a rate may go."""
    if rate == 0.0:
        return math.inf
    return float(max(0.0, ((high if rate > 0.0 else low) - value) / rate))


def way_in_cone(force: Array, dn: float, df: float, friction: float, room: float) -> float:
    """Least factor at which (N + x dn, f + x df, lift) leaves the friction cone; it starts within."""
    normal, sideways, lift = force
    width = friction * normal + room
    if lift == 0.0:
        rates = ((df - friction * dn, width - sideways), (-df - friction * dn, width + sideways))
        return float(min((max(0.0, left) / rate for rate, left in rates if rate > 0.0), default=math.inf))
    a = df**2 - (friction * dn) ** 2
    b = sideways * df - width * friction * dn
    c = min(0.0, sideways**2 + lift**2 - width**2)
    if c == 0.0 and (b > 0.0 or (b == 0.0 and a > 0.0)):
        return 0.0
    open_side = -1e-12 * abs(width)
    return float(
        min((x for x in _roots(a, b, c) if x > 0.0 and width + x * friction * dn >= open_side), default=math.inf)
    )


def _roots(a: float, b: float, c: float) -> list[float]:
    """Roots of a x^2 + 2 b x + c, computed without cancellation."""
    square = b * b - a * c
    if square < 0.0 or (a == 0.0 and b == 0.0):
        return []
    q = -(b + math.copysign(math.sqrt(square), b))
    return [*([q / a] if a != 0.0 else []), *([c / q] if q != 0.0 else [])]
