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
    couples: int  # moments of the scene that act on the tip
    rates: bool

    @property
    def count(self) -> int:
        """Number of values."""
        return (2 if self.tendons else 1) + self.couples

    @property
    def labels(self) -> list[str]:
        """Name and unit of each entry of u."""
        entries = [("tension_1", "N"), ("tension_2", "N")] if self.tendons else [("tip_moment", "N m")]
        entries += [(f"tip_couple_{k + 1}", "N m") for k in range(self.couples)]
        derivatives = (("", ""), ("_rate", "/s"), ("_acceleration", "/s2")) if self.rates else (("", ""),)
        return [f"{name}{word} [{unit}{per}]" for word, per in derivatives for name, unit in entries]


@dataclass(frozen=True)
class Drive:
    """Tip moment from the tendons (or given), couples on the tip, and the rates of their sum."""

    moment: Scalar
    couple: Scalar
    rate: Scalar
    acceleration: Scalar

    @staticmethod
    def from_input(u: ca.SX, layout: InputLayout, offset: Scalar) -> Drive:
        """Read the input vector."""

        def split(block: int) -> tuple[Scalar, Scalar]:
            start = block * layout.count
            # Equation (42); tendon 1 is on the -X side, to which a positive moment bends.
            moment: Scalar = offset * (u[start] - u[start + 1]) if layout.tendons else u[start]
            couples = range(start + layout.count - layout.couples, start + layout.count)
            return moment, sum((u[k] for k in couples), 0.0)

        moment, couple = split(0)
        if not layout.rates:
            return Drive(moment, couple, 0.0, 0.0)
        (rate, couple_rate), (acceleration, couple_acceleration) = split(1), split(2)
        return Drive(moment, couple, rate + couple_rate, acceleration + couple_acceleration)


def friction_factors(friction: Scalar, bends: list[Scalar], shares: list[Scalar]) -> list[Scalar]:
    """Share of the tension that reaches the middle of each element, by the capstan law, of a tendon being pulled.

    It is exp(-friction * total bend from the base to there). A bend [rad] of a share h of the finger's length counts
    as b^2 / sqrt(b^2 + (1e-3 rad h)^2), without sign and smooth when straight.
    """
    factors: list[Scalar] = []
    total: Scalar = 0.0
    for bend, share in zip(bends, shares, strict=True):
        factor, total = friction_step(friction, total, bend, share)
        factors.append(factor)
    return factors


def friction_step(friction: Scalar, before: Scalar, bend: Scalar, share: Scalar) -> tuple[Scalar, Scalar]:
    """Share in the middle of one element, and the bend up to its end; ``before`` is that up to its start."""
    square, rounding = bend * bend, _BEND_ROUNDING * share
    size = square / ca.sqrt(square + rounding * rounding)
    return ca.exp(-friction * (before + 0.5 * size)), before + size
