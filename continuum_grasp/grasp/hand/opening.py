"""Open the fingers of a hand that would block the object at rest, so that they can reach the grasp."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from continuum_grasp.base import Array, amount_text
from continuum_grasp.grasp.at_rest import CLEAR, RestOverlap, free_line, overlaps_at_rest
from continuum_grasp.grasp.hand.body import BodySurface
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.scene import FingerSetup, HandScene

STEPS = 48
"""Number of steps of the tension difference up to its limit: 15 degrees each for a finger that curls by two turns."""


def in_the_way(scene: HandScene) -> tuple[RestOverlap, ...]:
    """Fingers that pass through the object at rest, and so cannot reach a grasp by pulling alone."""
    return tuple(overlap for overlap in overlaps_at_rest(scene) if overlap.body == "object")


def way_words(overlaps: Sequence[RestOverlap]) -> str:
    """Say which fingers pass through the object at rest."""
    names = " and ".join(overlap.finger for overlap in overlaps)
    deepest = amount_text(max(overlap.depth for overlap in overlaps), "m", ".2g")
    return f"{names} {'passes' if len(overlaps) == 1 else 'pass'} through the object at rest, {deepest} deep"


def opening_words(found: Mapping[str, float]) -> str:
    """Say how to open fingers that stay at the object when released, by differences of tensions [N]."""
    each = [
        f"{name} by {amount_text(abs(pull), 'N', '.3g')} on the {'bending' if pull > 0.0 else 'back'} tendon"
        for name, pull in found.items()
    ]
    return f"open {', '.join(each)} before the object arrives"


def openings(scene: HandScene, arrays: Mapping[str, Array]) -> dict[str, float]:
    """Return the tension difference [N] that opens each finger that stays at the object when released.

    At rest such a finger is inside the object or on its other side: it must open before the object arrives, and then
    close. A positive difference opens it by bending it further. NaN: no difference within the limits of the tendons
    clears the object on the side that the finger touches.
    """
    body = BodySurface(scene)
    frames = PlaneFrame.each(scene)
    names = arrays["contact_names"].tolist()
    found = dict[str, float]()
    for setup, frame in zip(scene.setups, frames, strict=True):
        touching = [k for k, name in enumerate(names) if name.startswith(f"{setup.name}.")]
        if not touching:
            continue
        left, right = (float(tension) for tension in arrays[f"{setup.name}.tensions"])
        side = _side(setup, frame, arrays, touching)
        now = left - right
        if side * now <= 0.0 and _is_clear(body, setup, frame, 0.0):
            continue
        most = setup.max_tension
        end = 0.0 if setup.finger.tendons_used == ("right" if side > 0.0 else "left") else side * most
        path = np.linspace(now, end, STEPS + 1) if side * (end - now) > 0.0 else [now]
        clear = (float(difference) for difference in path if _is_clear(body, setup, frame, float(difference)))
        found[setup.name] = next(clear, math.nan)
    return found


def _side(setup: FingerSetup, frame: PlaneFrame, arrays: Mapping[str, Array], touching: Sequence[int]) -> float:
    """Return the sign of the change of the tension difference that moves the contacts off the object."""
    line = arrays[f"{setup.name}.backbone"]
    stations, points = line[:, 0], line[:, 1:3]
    # Turn of the section at each place per bending moment.
    gives = np.gradient(stations) / setup.finger.profile.bending_stiffness(stations)
    moved = 0.0
    for k in touching:
        at = int(np.abs(stations - arrays["contact_stations"][k]).argmin())
        arm = points[at] - points[: at + 1]
        shift = gives[: at + 1] @ np.column_stack([-arm[:, 1], arm[:, 0]])
        moved += float(shift @ (arrays["contact_normals"][k] @ frame.axes[:, :2]))
    return 1.0 if moved > 0.0 else -1.0


def _is_clear(body: BodySurface, setup: FingerSetup, frame: PlaneFrame, difference: float) -> bool:
    """Whether a finger without contacts, under a difference of its tensions [N], is clear of the object."""
    stations, line = free_line(setup.finger, (max(difference, 0.0), max(-difference, 0.0)))
    points = frame.world(np.column_stack([line, np.zeros(len(line))]))
    gaps = body.distance(points)[0] - setup.finger.profile.half_thickness(stations)
    return float(gaps.min()) > -CLEAR * setup.finger.rod.length
