"""Bending of a finger's sections under a moment: stiffness, tendons, and friction by how a finger came to rest.

    B (x + sum clip(k_j x, M_j) / B_0) = M + m,  x = k3 - k0,  m = sum arm T exp(-side l) shape
    l' = mu |k3| (3 d - d^3) / 2,  d = clip(offset w / presliding),  l(0) = 0,    w' = -shape x,  w(L) = 0

m is the moment of the tendons. By the capstan equation the tension falls by exp(-l) from the base on where a tendon
slides toward it, and rises where one on the other side slides away. w is the length, per offset in the base, that the
bend beyond s draws in. Branches of dry friction k_j, M_j hold in the base, and go with the bending stiffness. Sections
are taken to be bent one way from rest on, as pulling does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.scene import Curve, FingerSetup


class SectionState(NamedTuple):
    """Curvature of a section, and the rates at which tension and path change along the finger."""

    curvature: float
    """Curvature k3 [1/m]."""
    loss: float
    """Change of the logarithm of the tension [1/m]."""
    path: float
    """Change of the length drawn in [1/m]."""


Bends = Callable[[float, float, float, float], SectionState]
"""State of a section by its position [m], its moment M [N m], l and w."""


class SectionBending:
    """The sections of a finger at tensions (T,) [N]."""

    def __init__(self, setup: FingerSetup, tensions: Array) -> None:
        self._profile = setup.finger.profile
        self._channels = [
            (channel.shape, [(arm * channel.gain * float(t), float(np.sign(arm))) for arm, t in pulls])
            for channel in setup.finger.channels
            for pulls in [list(zip(channel.arms, tensions, strict=True))]
        ]
        self.shape = setup.finger.channels[0].shape
        """Moment of a tendon along the finger, per that in the base."""
        self.end = setup.finger.tendon_list[0].end(self._profile.length)
        """Places at which tendons end [m]."""
        self._friction = setup.tendons.friction
        self._per_path = setup.tendons.offset / setup.finger.tendon_list[0].presliding_length
        self._branches = sorted(
            ((branch.stiffness, branch.moment) for branch in setup.finger.damping.dry_friction),
            key=lambda branch: branch[1] / branch[0],
        )

    @property
    def slides(self) -> bool:
        """Whether tendons have friction whose direction depends on the shape."""
        return self._friction > 0.0

    @property
    def curves(self) -> list[Curve]:
        """Functions along the finger that are smooth between their edges."""
        return [*self._profile.curves, *(shape for shape, _ in self._channels)]

    def on(self, middle: float) -> Bends:
        """The law on the smooth part around a position [m]."""
        stiffness, rest = (
            value_of(curve, middle) for curve in (self._profile.bending_stiffness, self._profile.rest_curvature)
        )
        base = float(self._profile.bending_stiffness(0.0))
        channels = [(value_of(shape, middle), pulls) for shape, pulls in self._channels]
        friction, per_path, branches = self._friction, self._per_path, self._branches

        def bends(s: float, moment: float, loss: float, path: float) -> SectionState:
            shaped = 0.0
            for shape, pulls in channels:
                shaped = shape(s)
                for pull, side in pulls:
                    moment += shaped * (pull if loss == 0.0 else pull * float(np.exp(-side * loss)))
            elastic = moment / stiffness(s)
            if branches:
                elastic = _yielded(elastic, base, branches)
            curvature = rest(s) + elastic
            if not friction:
                return SectionState(curvature, 0.0, 0.0)
            slid = min(max(per_path * path, -1.0), 1.0) if shaped else 0.0
            return SectionState(
                curvature, friction * abs(curvature) * 0.5 * slid * (3.0 - slid * slid), -shaped * elastic
            )

        return bends


def _yielded(elastic: float, stiffness: float, branches: list[tuple[float, float]]) -> float:
    """Curvature of a section that would bend elastically by another; branches that slide sooner come first."""
    size, held = stiffness * abs(elastic), 0.0
    sticking = sum(branch for branch, _ in branches)
    for branch, most in branches:
        bent = (size - held) / (stiffness + sticking)
        if branch * bent <= most:
            break
        held, sticking = held + most, sticking - branch
    return float(np.copysign((size - held) / (stiffness + sticking), elastic))


def value_of(curve: Curve, middle: float) -> Callable[[Any], Any]:
    """The values of a curve on its piece around a position, at floats or arrays."""
    piece = int(np.searchsorted(np.asarray(curve.edges[1:-1]), middle))
    start, coefficients = curve.edges[piece], curve.coefficients[piece]
    if curve.exponential:
        return lambda s: curve.on(piece, s)
    if len(coefficients) == 1:
        return lambda _: coefficients[0]

    def value(s: Any) -> Any:
        total = 0.0
        for coefficient in reversed(coefficients):
            total = total * (s - start) + coefficient
        return total

    return value
