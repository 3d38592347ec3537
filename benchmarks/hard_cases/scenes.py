"""The rod of the paper as scenes for hard cases."""

from __future__ import annotations

import math
from typing import Any

from continuum_grasp.scene import Scene

FAMILIES = ("arc", "clothoid", "matched_clothoid")
LENGTH = 0.6
NITINOL = {"length": LENGTH, "diameter": 0.002, "density": 6450.0, "youngs_modulus": 60e9}
STIFFNESS = 60e9 * math.pi * 0.002**4 / 64
MASS = 6450.0 * math.pi * 0.002**2 / 4 * LENGTH
ALONG_X, UPRIGHT, HANGING = -math.pi / 2, 0.0, math.pi
"""Base angles with which the undeformed rod points along world +X, +Y and -Y."""
WEIGHTLESS, WEIGHT = (0.0, 0.0), (0.0, -9.81)


def nitinol(
    family: str,
    elements: Any = 2,
    *,
    angle: float = ALONG_X,
    gravity: tuple[float, float] = WEIGHTLESS,
    tip_mass: float = 0.0,
    damping: float = 0.0,
    bending_range: float | None = None,
    finger: dict[str, Any] | None = None,
    **keys: Any,
) -> Scene:
    """A scene with the 0.6 m rod; further keys as in a configuration."""
    body = {
        "rod": NITINOL,
        "damping": {"material": damping},
        "masses": [{"at": LENGTH, "mass": tip_mass}] if tip_mass else [],
        "base": {"position": [0.0, 0.0], "angle": angle},
        **(finger or {}),
    }
    fidelity = {"family": family, "elements": elements, "bending_range": bending_range}
    data = {"finger": body, "gravity": gravity, "fidelity": fidelity, **keys}
    return Scene(**data)


def push(x: float, y: float, at: float = LENGTH) -> dict[str, Any]:
    """A dead force in the world's axes [N]."""
    return {"kind": "force", "at": at, "force": [x, y]}


def coordinates(family: str, bends: tuple[float, ...], lengths: tuple[float, ...]) -> list[float]:
    """Coordinates of a shape by the bends of its elements [rad]; clothoids bend evenly from node to node."""
    if family == "arc":
        return list(bends)
    nodes = [bend / length for bend, length in zip(bends, lengths, strict=True)]
    return nodes if family == "matched_clothoid" else [*nodes, 0.0]
