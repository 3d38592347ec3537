"""Closed forms of straight rods that are clamped at one end, free at the other, and not uniform."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import iv, jv, kv, yv

__all__ = ["pointed_frequencies", "stepped_frequencies", "tapered_frequencies"]

Array = NDArray[np.float64]


def pointed_frequencies(power: int, count: int = 3) -> Array:
    """Frequencies omega L^2 sqrt(rho A / EI) (both at the base) of a taper to a point, (count,).

    G. R. Kirchhoff, Über die Transversalschwingungen eines Stabes von veränderlichem Querschnitt, 1879: the zeros of
    J_n I_(n+1) + I_n J_(n+1) at 2 sqrt(Omega), for rho A ~ x^n and EI ~ x^(n+2); n = 1 is a wedge, 2 a cone.
    """

    def characteristic(omega: Array) -> Array:
        z = 2.0 * np.sqrt(omega)
        return (jv(power, z) * iv(power + 1, z) + iv(power, z) * jv(power + 1, z)) * np.exp(-z)

    return _roots(characteristic, count, 50.0)


def tapered_frequencies(power: int, ratio: float, count: int = 2) -> Array:
    """Frequencies omega L^2 sqrt(rho A / EI) (both at the base) of a truncated taper, (count,).

    Thickness falls linearly to ``ratio`` of that at the base; rho A ~ x^n and EI ~ x^(n+2) with n = ``power`` (1: a
    wedge, 2: a cone). H. H. Mabie, C. B. Rogers, Transverse vibrations of double-tapered cantilever beams, 1972,
    doi:10.1121/1.1913011: the deflection is x^(-n/2) times Bessel functions of 2 sqrt(k x), with x from 1 at the base.
    """

    def characteristic(omega: Array) -> Array:
        k = omega / (1.0 - ratio) ** 2
        # The scale of I at the base, of K at the tip.
        high, low = np.exp(-2.0 * np.sqrt(k)), np.exp(2.0 * np.sqrt(k * ratio))

        def row(x: float, order: int, signs: Sequence[float]) -> Array:
            z = 2.0 * np.sqrt(k * x)
            return np.array(signs) * np.stack([jv(order, z), yv(order, z), high * iv(order, z), low * kv(order, z)], -1)

        rows = [
            row(1.0, power, (1, 1, 1, 1)),  # deflection
            row(1.0, power + 1, (-1, -1, 1, -1)),  # slope
            row(ratio, power + 2, (1, 1, 1, 1)),  # moment
            row(ratio, power + 1, (1, 1, 1, -1)),  # shear force
        ]
        return np.linalg.det(np.stack(rows, -2))

    return _roots(characteristic, count, 80.0)


def stepped_frequencies(steps: Sequence[tuple[float, float, float]], count: int = 2) -> Array:
    """Frequencies omega [rad/s] of a rod of uniform pieces (length, EI, rho A) from the base, (count,), below 80 rad/s.

    Transfer matrices of deflection, slope, moment and shear force: W. T. Thomson, Matrix solution for the vibration of
    nonuniform beams, 1950, doi:10.1115/1.4010128.
    """

    def characteristic(omega: Array) -> Array:
        whole = np.eye(4)
        for length, stiffness, density in steps:
            b = np.sqrt(omega) * (density / stiffness) ** 0.25
            z, powers = b * length, np.stack([b**0, b, stiffness * b**2, stiffness * b**3], -1)
            # Derivatives of Krylov's functions: of (cosh + cos) / 2, (sinh + sin) / 2, (cosh - cos) / 2, ...
            krylov = [np.cosh(z) + np.cos(z), np.sinh(z) + np.sin(z), np.cosh(z) - np.cos(z), np.sinh(z) - np.sin(z)]
            local = 0.5 * np.stack(
                [np.stack([krylov[(column - row) % 4] for column in range(4)], -1) for row in range(4)], -2
            )
            whole = (powers[..., :, None] * local / powers[..., None, :]) @ whole
        return np.linalg.det(whole[..., 2:, 2:])

    return _roots(characteristic, count, 80.0)


def _roots(function: Callable[[Array], Array], count: int, highest: float) -> Array:
    places = np.linspace(0.05, highest, 4001)
    values = function(places)
    changes = np.flatnonzero(values[:-1] * values[1:] < 0.0)[:count]
    return np.array([brentq(function, places[k], places[k + 1], xtol=1e-14, rtol=1e-14) for k in changes])
