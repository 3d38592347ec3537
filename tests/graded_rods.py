"""Rods that are not uniform, with the closed forms of their frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from benchmarks.rod_shapes import RODS, sections, taper
from continuum_grasp.scene import Channel, Curve, Scene
from tests.closed_forms.graded import stepped_frequencies, tapered_frequencies

SPIRAL = {
    "length": 1.0,
    "youngs_modulus": 12.0 / 0.02**4 / 0.5**3,
    "density": 1.0 / 0.02**2,
    "rotary_inertia": 0.0,
    "spirob": {"base_thickness": 0.02, "tip_thickness": 0.005, "width": 0.02, "units": 24, "core": 0.5},
}
"""A straightened spiral is a linear taper: cut from a plate, a wedge."""

FREQUENCIES = {
    "wedge 0.5": tapered_frequencies(1, 0.5),
    "wedge 0.25": tapered_frequencies(1, 0.25),
    "cone 0.25": tapered_frequencies(2, 0.25),
    "cone 0.1": tapered_frequencies(2, 0.1),
    "step": stepped_frequencies([(0.4, 1.0, 1.0), (0.6, 0.1, 0.3)]),
    "spiral": tapered_frequencies(1, 0.25),
}
"""Of the straight rods, mode 1 and 2 [rad/s]."""
CLOSED = {name: {**RODS, "spiral": SPIRAL}[name] for name in FREQUENCIES}
"""The rods of them, as in a configuration."""

__all__ = ["CLOSED", "FREQUENCIES", "RODS", "cut", "sections", "taper", "with_profile"]


def cut(pieces: int) -> dict[str, Any]:
    """The uniform rod in pieces of equal values."""
    return sections(*[((k + 1.0) / pieces, 1.0, 1.0) for k in range(pieces)])


def with_profile(scene: Scene, channels: Sequence[Channel] = (), **curves: Curve) -> Scene:
    """The scene with other curves in its finger's profile, and other channels where given."""
    finger = scene.finger.model_copy()
    finger.__dict__["profile"] = replace(scene.finger.profile, graded=True, **curves)
    if channels:
        finger.__dict__["channels"] = tuple(channels)
    return scene.model_copy(update={"finger": finger})
