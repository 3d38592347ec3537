"""Rods that are not uniform, as in a configuration: length, base stiffness and base density are one."""

from __future__ import annotations

import math
from typing import Any

THICK = 0.02
"""Thickness at the base [m]: half of it is the greatest offset of a tendon."""


def taper(ratio: float, *, cone: bool) -> dict[str, Any]:
    """Thickness that falls linearly to ``ratio`` of that at the base: a cone, or a wedge of constant width."""
    ends = [THICK, ratio * THICK]
    section = {"diameter": ends} if cone else {"thickness": ends, "width": THICK}
    second = math.pi * THICK**4 / 64 if cone else THICK**4 / 12
    area = math.pi * THICK**2 / 4 if cone else THICK**2
    material = {"youngs_modulus": 1.0 / second, "density": 1.0 / area, "rotary_inertia": 0.0}
    return {"length": 1.0, **material, "sections": [{"to": 1.0, **section}]}


def sections(*steps: tuple[float, float, float]) -> dict[str, Any]:
    """Uniform pieces (end, stiffness, density) from the base."""
    names = ("to", "bending_stiffness", "linear_density")
    return {"length": 1.0, "sections": [dict(zip(names, step, strict=True)) for step in steps]}


RODS = {
    "uniform": {"length": 1.0, "bending_stiffness": 1.0, "linear_density": 1.0},
    "wedge 0.5": taper(0.5, cone=False),
    "wedge 0.25": taper(0.25, cone=False),
    "cone 0.25": taper(0.25, cone=True),
    "cone 0.1": taper(0.1, cone=True),
    "step": sections((0.4, 1.0, 1.0), (1.0, 0.1, 0.3)),
}
