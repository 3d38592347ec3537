"""From the input u to the tip moment, and its loss along the finger by tendon friction."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from continuum_grasp.model.planar import Scalar

_BEND_ROUNDING = 1e-3
"""Bend of the whole finger below which the capstan law is rounded off to stay smooth [rad]: with a coefficient of 0.5
the tension is off by a share of 5e-4 at most."""


@dataclass(frozen=True)
class InputLayout:
    """What the input vector holds: values, then (for moving tip balances) their rates and accelerations."""

    tendons: bool
    couples: int
    """Moments of the scene that act on the tip."""
    rates: bool

    @property
    def count(self) -> int:
        """Number of values."""
        return (2 if self.tendons else 1) + self.couples

    @property
    def labels(self) -> list[str]:
        """Name and unit of each entry of u."""
        names = ["tension_1", "tension_2"] if self.tendons else ["tip_moment"]
        names += [f"tip_couple_{k + 1}" for k in range(self.couples)]
        units = ["N", "N"] if self.tendons else ["N m"]
        units += ["N m"] * self.couples
        labels = [f"{n} [{u}]" for n, u in zip(names, units, strict=True)]
        if self.rates:
            labels += [f"{n}_rate [{u}/s]" for n, u in zip(names, units, strict=True)]
            labels += [f"{n}_acceleration [{u}/s2]" for n, u in zip(names, units, strict=True)]
        return labels


@dataclass(frozen=True)
class Drive:
    """Tip moment from the tendons (or given), couples on the tip, and the rates of their sum."""

    moment: Scalar
    couple: Scalar
    rate: Scalar
    acceleration: Scalar

    @staticmethod
    def from_input(u: ca.SX, layout: InputLayout, offset: Scalar) -> Drive:
        """Read the input vector; equation (42) for tendons."""

        def split(block: int) -> tuple[Scalar, Scalar]:
            start = block * layout.count
            if layout.tendons:
                moment: Scalar = offset * (u[start] - u[start + 1])
                start += 2
            else:
                moment = u[start]
                start += 1
            couple: Scalar = 0.0
            for k in range(layout.couples):
                couple += u[start + k]
            return moment, couple

        moment, couple = split(0)
        if not layout.rates:
            return Drive(moment, couple, 0.0, 0.0)
        (rate, couple_rate), (acceleration, couple_acceleration) = split(1), split(2)
        return Drive(moment, couple, rate + couple_rate, acceleration + couple_acceleration)


def friction_factors(friction: Scalar, bends: list[Scalar], shares: list[Scalar]) -> list[Scalar]:
    """Share of the tension that reaches the middle of each element, by the capstan law.

    Parameters
    ----------
    friction : scalar
        Coefficient of friction between tendon and guides [1].
    bends : list of scalars
        Bending angle of each element [rad].
    shares : list of scalars
        Length of each element per that of the finger [1].

    Returns
    -------
    list of scalars
        exp(-friction * total bend from the base to the middle of the element), for a tendon that is being pulled;
        a bend b of a share h of the length is counted as b^2 / sqrt(b^2 + (1e-3 rad h)^2), without sign and smooth when
        straight.
    """
    factors: list[Scalar] = []
    total: Scalar = 0.0
    for bend, share in zip(bends, shares, strict=True):
        square, rounding = bend * bend, _BEND_ROUNDING * share
        size = square / ca.sqrt(square + rounding * rounding)
        factors.append(ca.exp(-friction * (total + 0.5 * size)))
        total += size
    return factors
