"""Two arcs as exact rational power series, from r(s) = integral of (-sin, cos) of the bending angle alone.

A series maps powers (of theta1, of theta2, of u = s / L along an arc, of L1, of L2) to a rational coefficient and is
cut at a total degree in the two angles. No closed form of an arc is used, so no division by an angle.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from math import factorial

DEGREE = 7
"""Total degree in the angles that positions keep: derivatives end at 6, the Christoffel symbols of M at 5."""

Powers = tuple[int, int, int, int, int]


class Series(dict):
    """A polynomial: powers -> Fraction."""

    def __add__(self, other: Series) -> Series:
        total = Series(self)
        for key, value in other.items():
            total[key] = total.get(key, Fraction(0)) + value
        return Series({key: value for key, value in total.items() if value})

    def __sub__(self, other: Series) -> Series:
        return self + other.scaled(-1)

    def __mul__(self, other: Series) -> Series:
        total = Series()
        for a, x in self.items():
            for b, y in other.items():
                if a[0] + a[1] + b[0] + b[1] <= DEGREE:
                    key = tuple(m + n for m, n in zip(a, b, strict=True))
                    total[key] = total.get(key, Fraction(0)) + x * y
        return Series({key: value for key, value in total.items() if value})

    def scaled(self, factor: Fraction | int) -> Series:
        return Series({key: factor * value for key, value in self.items()})

    def derivative(self, which: int) -> Series:
        """With respect to theta1 (0) or theta2 (1)."""
        return Series({_moved(key, which, -1): key[which] * value for key, value in self.items() if key[which]})

    def integral(self) -> Series:
        """From 0 to u along the arc."""
        return Series({_moved(key, 2, 1): value / (key[2] + 1) for key, value in self.items()})

    def at_end(self) -> Series:
        """At u = 1."""
        total = Series()
        for key, value in self.items():
            total = total + Series({(*key[:2], 0, *key[3:]): value})
        return total

    def cut(self, degree: int) -> Series:
        return Series({key: value for key, value in self.items() if key[0] + key[1] <= degree})

    def by_angles(self) -> dict[tuple[int, int], dict[tuple[int, int], Fraction]]:
        """Powers of the angles -> powers of the lengths -> coefficient."""
        found: dict[tuple[int, int], dict[tuple[int, int], Fraction]] = {}
        for (i, j, k, a, b), value in self.items():
            assert k == 0
            found.setdefault((i, j), {})[a, b] = value
        return found


def _moved(key: Powers, which: int, by: int) -> Powers:
    return tuple(power + (by if n == which else 0) for n, power in enumerate(key))  # type: ignore[return-value]


ONE = Series({(0, 0, 0, 0, 0): Fraction(1)})
THETA1, THETA2, U, L1, L2 = (Series({_moved((0,) * 5, n, 1): Fraction(1)}) for n in range(5))
Pair = tuple[Series, Series]


def tangent(angle: Series) -> Pair:
    """(-sin, cos) of an angle that vanishes with the two bends."""
    x, y, power = Series(), Series(), ONE
    for n in range(DEGREE + 1):
        term = power.scaled(Fraction((-1) ** ((n + 1) // 2), factorial(n)))
        x, y = (x + term, y) if n % 2 else (x, y + term)
        power = power * angle
    return x, y


def curve(length: Series, angle: Series) -> Pair:
    """Position along an arc from its start, in the axes that the angle is measured from."""
    x, y = tangent(angle)
    return length * x.integral(), length * y.integral()


def dot(a: Pair, b: Pair) -> Series:
    return a[0] * b[0] + a[1] * b[1]


def slope(r: Pair, which: int) -> Pair:
    return r[0].derivative(which), r[1].derivative(which)


def ends(r: Pair) -> Pair:
    return r[0].at_end(), r[1].at_end()


def plus(a: Pair, b: Pair) -> Pair:
    return a[0] + b[0], a[1] + b[1]


def mean(series: Series) -> Series:
    """Integral over the arc, per length."""
    return series.integral().at_end()


def mass_matrix(first: Pair, second: tuple[Pair, Pair]) -> dict[str, Series]:
    """M11, M12, M22 per mass per length; ``second``: the columns of the second arc's Jacobian."""
    one = slope(first, 0)
    alone = {"M11": L1 * mean(dot(one, one)), "M12": Series(), "M22": Series()}
    pairs = {"M11": (0, 0), "M12": (0, 1), "M22": (1, 1)}
    return {key: (alone[key] + L2 * mean(dot(second[i], second[j]))).cut(6) for key, (i, j) in pairs.items()}


def christoffel(m: dict[str, Series]) -> dict[str, Series]:
    """V11 ... V23 of equation (38): factors of rate1^2, rate1 rate2 and rate2^2."""
    table = [[m["M11"], m["M12"]], [m["M12"], m["M22"]]]
    found = {}
    for i in (0, 1):
        star = [
            [table[i][j].derivative(k) - table[j][k].derivative(i).scaled(Fraction(1, 2)) for k in (0, 1)]
            for j in (0, 1)
        ]
        values = star[0][0], star[0][1] + star[1][0], star[1][1]
        found.update({f"V{i + 1}{n + 1}": value for n, value in enumerate(values)})
    return found


def derived(first: Pair, second: Pair) -> dict[str, Series]:
    """Every entry of (A.1)-(A.4), and of gravity across the rod, to degree 5, from the two curves."""
    found = mass_matrix(first, (slope(second, 0), slope(second, 1)))
    found.update(christoffel(found))
    height = L1 * mean(first[1]) + L2 * mean(second[1])
    across = L1 * mean(first[0]) + L2 * mean(second[0])
    for n in (0, 1):
        found[f"GY{n + 1}"] = height.derivative(n)
        found[f"GX{n + 1}"] = across.derivative(n).scaled(-1)
        for axis in (0, 1):
            found[f"Jc{axis + 1}{n + 1}"] = ends(first)[axis].derivative(n)
            found[f"Jt{axis + 1}{n + 1}"] = ends(second)[axis].derivative(n)
    return {key: value.cut(5) for key, value in found.items()}


FIRST = curve(L1, U * THETA1)


@cache
def exact() -> dict[str, Series]:
    """The entries of the exact model."""
    return derived(FIRST, plus(ends(FIRST), curve(L2, THETA1 + U * THETA2)))


@cache
def unrotated() -> dict[str, Series]:
    """M and V to degree 5 when the contact's velocity is left in base axes beside a second arc in contact axes."""
    relative = curve(L2, U * THETA2)
    velocity = slope(ends(FIRST), 0)
    turning = velocity[0] - relative[1], velocity[1] + relative[0]
    found = mass_matrix(FIRST, (turning, slope(relative, 1)))
    found.update(christoffel(found))
    return {key: value.cut(5) for key, value in found.items()}
