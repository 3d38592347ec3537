"""Curvatures from which on a finger is stiffer, where its links touch, or softer, where its material yields.

Beyond a curvature c the bending stiffness changes by a share r of it; with the width e of the corner and y = kappa - c

    energy per length r E I s^2 / 2,    s = (y + sqrt(y^2 + e^2)) / 2,    moment r E I s^2 / sqrt(y^2 + e^2)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from continuum_grasp.model.family import Family
from continuum_grasp.model.laws.section import Bend, Number, Numbers, SectionLaw, places, points
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.graded_profile import line
from continuum_grasp.scene.profile import Curve

_POINTS = 3
"""Points per element at which the curvature is compared with a limit [1]: as good as dense ones."""
_STOP_ROUNDING = 0.005
"""Share of the curvature where links touch within which they do so smoothly [1]; 0.02 costs 3e-3 of it."""


class _Limit(SectionLaw):
    """A curvature from which on the stiffness changes."""

    kind = "elastic"
    _signs: tuple[float, ...]  # the sides on which it does
    _rounding: float  # width of the corner per curvature [1]
    _change: Scalar  # of the stiffness, per that before [1]
    _scale: Scalar = 1.0  # of the curvature

    def _place(self, family: Family, numbers: Numbers, curvature: Curve) -> None:
        at = curvature(places(family, _POINTS)).tolist()
        self.ports = tuple(replace(port, own=(c,)) for port, c in zip(points(family, _POINTS), at, strict=True))
        self._stiffness = numbers["bending_stiffness"] * float(family.mesh.stiffness(0.0))

    def _of(self, bend: Bend) -> Scalar:
        """The curvature that counts."""
        return bend.curvature

    def _beyond(self, bend: Bend) -> Iterator[tuple[float, Scalar, Scalar]]:
        """Per side its sign, s and the root."""
        touch = self._scale * bend.own[0]
        rounding = self._rounding * touch
        for sign in self._signs:
            beyond = sign * self._of(bend) - touch
            root = ca.sqrt(beyond * beyond + rounding * rounding)
            yield sign, 0.5 * (beyond + root), root

    def moment(self, bend: Bend) -> Scalar:
        parts = sum((sign * (s * s / root) for sign, s, root in self._beyond(bend)), 0.0)
        return (self._change * self._stiffness) * parts

    def energy(self, bend: Bend) -> Scalar:
        return (0.5 * self._change * self._stiffness) * sum((s * s for _, s, _ in self._beyond(bend)), 0.0)


class Stops(_Limit):
    """Links that touch: on one side or both, at a curvature of the finger itself, that at rest included."""

    _rounding = _STOP_ROUNDING

    def __init__(self, finger: Finger, family: Family, numbers: Numbers) -> None:
        if finger.stops is None or finger.stop_curvature is None:
            raise TypeError("a finger without stops")
        self._signs, self._change = finger.stops.signs, finger.stops.stiffness_ratio - 1.0
        self._place(family, numbers, finger.stop_curvature)

    @classmethod
    def applies(cls, finger: Finger, numbers: Numbers) -> bool:
        return finger.stops is not None and finger.stop_curvature is not None

    @classmethod
    def numbers(cls, finger: Finger) -> dict[str, Number]:
        return {}

    def _of(self, bend: Bend) -> Scalar:
        return bend.curvature + bend.rest


class Softening(_Limit):
    """A material that yields, to both sides alike, at a curvature above that at rest."""

    _signs = (1.0, -1.0)

    def __init__(self, finger: Finger, family: Family, numbers: Numbers) -> None:
        if finger.softening is None:
            raise TypeError("a finger that does not soften")
        soft = finger.softening
        self._rounding, self._change = soft.rounding, numbers["softening_ratio"] - 1.0
        if numbers.is_runtime("softening_curvature"):
            self._scale = numbers["softening_curvature"] / self.numbers(finger)["softening_curvature"].value
        self._place(family, numbers, line(finger.rod.length, soft.curvature))

    @classmethod
    def applies(cls, finger: Finger, numbers: Numbers) -> bool:
        return finger.softening is not None

    @classmethod
    def numbers(cls, finger: Finger) -> dict[str, Number]:
        if finger.softening is None:
            return {}
        ratio = Number("1", finger.softening.stiffness_ratio, "softening.stiffness_ratio", positive=False)
        found = {"softening_ratio": ratio}
        if not isinstance(finger.softening.curvature, tuple):
            found["softening_curvature"] = Number("1/m", finger.softening.curvature, "softening.curvature")
        return found
