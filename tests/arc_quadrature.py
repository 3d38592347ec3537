"""Two arcs over many pairs of angles at once, by quadrature of r(s) = integral of (-sin, cos) of the bending angle.

In doubles, to 1e-14, and without any closed form of an arc; for maxima over the whole range of the angles, and for
Taylor polynomials by Cauchy's integral over complex angles.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.truth.quadrature import gauss

RANGE = 2 * np.pi / 3
"""Greatest bending angle of the paper, equation (44) [rad]."""


@cache
def _rule(nodes: int = 16) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rule = gauss(nodes)
    return tuple(np.array(part, dtype=float) for part in (rule.nodes, rule.weights, rule.integrals))


def square(points: int, largest: float = RANGE) -> np.ndarray:
    """Pairs of angles (2, points^2) over |theta| <= largest; with an odd number zero is among them."""
    side = np.linspace(-largest, largest, points)
    return np.array(np.meshgrid(side, side)).reshape(2, -1)


def entries(theta: np.ndarray, lengths=(0.3, 0.3)) -> dict[str, np.ndarray]:
    """Entries per mass per length, and per weight per length, at pairs of angles (2, n).

    M11 ... M22; V11 ... V23 (factors of rate1^2, rate1 rate2, rate2^2); GY1, GY2 (gravity along -Y), GX1, GX2 (along
    +X); Jacobians of contact Jc, tip Jt and mass centers Jg (first arc), Jh (second), each with row and column.
    """
    u, w, integrals = _rule()
    (l1, l2), (t1, t2) = lengths, np.asarray(theta)[..., None]
    zero = np.zeros_like(t1 * u)

    def along(start, length, values):
        """Integral of values (n, nodes) along an arc, at its nodes and at its end."""
        return start[:, None] + length * values @ integrals.T, start + length * values @ w

    arcs, start = [], [np.zeros(t1.shape[0])] * 10
    for length, angle, phi in ((l1, u * t1, (u + zero, zero)), (l2, t1 + u * t2, (1 + zero, u + zero))):
        c, s = np.cos(angle), np.sin(angle)
        curves = [-c * phi[0], -s * phi[0], -c * phi[1], -s * phi[1]]
        for share in (phi[0] ** 2, 2 * phi[0] * phi[1], phi[1] ** 2):
            curves += [s * share, -c * share]
        pairs = [along(first, length, curve) for first, curve in zip(start, curves, strict=True)]
        arcs.append((length * w, [pair[0] for pair in pairs]))
        start = [pair[1] for pair in pairs]
        if len(arcs) == 1:
            contact = start
    found = {}
    for i in (0, 1):
        for axis in (0, 1):
            found[f"Jc{axis + 1}{i + 1}"], found[f"Jt{axis + 1}{i + 1}"] = contact[2 * i + axis], start[2 * i + axis]
            for name, (weights, at), length in zip("gh", arcs, lengths, strict=True):
                found[f"J{name}{axis + 1}{i + 1}"] = at[2 * i + axis] @ weights / length
        found[f"GX{i + 1}"], found[f"GY{i + 1}"] = (
            sign * sum(at[2 * i + axis] @ weights for weights, at in arcs) for axis, sign in ((0, -1), (1, 1))
        )
        for key, first in [(f"M{i + 1}{j + 1}", 2 * j) for j in (0, 1)] + [
            (f"V{i + 1}{k}", 2 + 2 * k) for k in (1, 2, 3)
        ]:
            products = [(at[2 * i] * at[first] + at[2 * i + 1] * at[first + 1]) @ weights for weights, at in arcs]
            found[key] = products[0] + products[1]
    return found


def unrotated(theta: np.ndarray, lengths=(0.3, 0.3)) -> dict[str, np.ndarray]:
    """M11, M12, M22 when the contact's velocity is left in base axes beside a second arc in contact axes."""
    u, w, integrals = _rule()
    (l1, l2), (t1, t2) = lengths, np.asarray(theta)[..., None]
    first = [-l1 * u * f(u * t1) for f in (np.cos, np.sin)]
    x, y, x2, y2 = (
        l2 * curve @ integrals.T
        for curve in (-np.sin(u * t2), np.cos(u * t2), -u * np.cos(u * t2), -u * np.sin(u * t2))
    )
    one = [first[0] @ w[:, None] - y, first[1] @ w[:, None] + x]
    alone = sum((curve @ integrals.T) ** 2 for curve in first) @ w
    pairs = {"M11": (one, one), "M12": (one, (x2, y2)), "M22": ((x2, y2), (x2, y2))}
    found = {name: l2 * sum(a * b for a, b in zip(*pair, strict=True)) @ w for name, pair in pairs.items()}
    return {**found, "M11": found["M11"] + l1 * alone}


def taylor(function, lengths) -> dict[str, np.ndarray]:
    """Coefficients of theta1^i theta2^j by entry, from values on a torus of complex angles."""
    radius, points = 2.0, 32
    circle = radius * np.exp(2j * np.pi * np.arange(points) / points)
    values = function(np.array(np.meshgrid(circle, circle, indexing="ij")).reshape(2, -1), lengths)
    scale = radius ** np.add.outer(np.arange(points), np.arange(points))
    return {name: np.fft.fft2(f.reshape(points, points)).real / points**2 / scale for name, f in values.items()}


def christoffel(m: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Coefficients of V11 ... V23 of equation (38), factors of rate1^2, rate1 rate2 and rate2^2, from those of M."""

    def slope(name: str, axis: int) -> np.ndarray:
        powers = np.arange(len(m[name]))
        return np.roll(m[name] * (powers[:, None] if axis == 0 else powers), -1, axis)

    found = {}
    for i, name in enumerate("12"):
        own, mixed = ("M11", "M12") if i == 0 else ("M12", "M22")
        found[f"V{name}1"] = slope(own, 0) - slope("M11", i) / 2
        found[f"V{name}2"] = slope(own, 1) + slope(mixed, 0) - slope("M12", i)
        found[f"V{name}3"] = slope(mixed, 1) - slope("M22", i) / 2
    return found


def relative(found, wanted) -> float:
    """Largest difference over the largest wanted value."""
    return float(np.abs(np.asarray(found) - wanted).max() / np.abs(wanted).max())
