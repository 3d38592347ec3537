"""Rods that are not uniform, of length, base stiffness and base density one, with their closed forms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from continuum_grasp.scene import Scene
from continuum_grasp.scene.profile import Channel, Curve
from tests.closed_forms.graded import stepped_frequencies, tapered_frequencies
from tests.rods import UNIT, rod_scene


@dataclass(frozen=True)
class GradedRod:
    """A rod and its first frequencies."""

    stiffness: Curve
    density: Curve
    frequencies: np.ndarray  # (2,) closed forms [rad/s]


def taper(power: int, ratio: float) -> GradedRod:
    """Thickness h from 1 to ``ratio``; density h^power, stiffness h^(power + 2): a wedge (1), a cone (2)."""

    def curve(exponent: int) -> Curve:
        polynomial = np.polynomial.Polynomial([1.0, ratio - 1.0]) ** exponent
        return Curve((0.0, 1.0), (tuple(polynomial.coef.tolist()),))

    return GradedRod(curve(power + 2), curve(power), tapered_frequencies(power, ratio))


def stepped(*steps: tuple[float, float, float]) -> GradedRod:
    """Uniform pieces (length, stiffness, density) from the base."""
    edges = tuple(np.cumsum([0.0, *(step[0] for step in steps)]).tolist())
    stiffness = Curve(edges, tuple((step[1],) for step in steps))
    return GradedRod(stiffness, Curve(edges, tuple((step[2],) for step in steps)), stepped_frequencies(steps))


def cut(pieces: int) -> GradedRod:
    """The uniform rod in pieces of equal values."""
    return stepped(*[(1.0 / pieces, 1.0, 1.0)] * pieces)


RODS = {
    "wedge 0.5": taper(1, 0.5),
    "wedge 0.25": taper(1, 0.25),
    "cone 0.25": taper(2, 0.25),
    "cone 0.1": taper(2, 0.1),
    "step": stepped((0.4, 1.0, 1.0), (0.6, 0.1, 0.3)),
}


def graded_scene(rod: GradedRod, *args: Any, rest: Curve | None = None, channels: Sequence[Channel] = (), **keys: Any):
    """A scene of that rod as `rod_scene` gives of the unit rod, with a rest curvature and tendons."""
    return with_profile(
        rod_scene(UNIT, *args, **keys),
        bending_stiffness=rod.stiffness,
        linear_density=rod.density,
        rest_curvature=Curve.uniform(1.0, 0.0) if rest is None else rest,
        channels=channels,
    )


def with_profile(scene: Scene, channels: Sequence[Channel] = (), **curves: Curve) -> Scene:
    """The scene with other curves in its finger's profile, and other channels where given."""
    finger = scene.finger.model_copy()
    finger.__dict__["profile"] = replace(scene.finger.profile, graded=True, **curves)
    if channels:
        finger.__dict__["channels"] = tuple(channels)
    return scene.model_copy(update={"finger": finger})
