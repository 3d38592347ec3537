"""How the fingers of a hand are opened, so that grasps are reached whose fingers at rest are in the object's way."""

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
"""Steps of the difference of the tensions to its limit: of a finger that curls by two turns, 15 degrees each."""


def in_the_way(scene: HandScene) -> tuple[RestOverlap, ...]:
    """Fingers that pass through the object at rest, where pulling alone would not bring them to a grasp."""
    return tuple(overlap for overlap in overlaps_at_rest(scene) if overlap.body == "object")


def way_words(overlaps: Sequence[RestOverlap]) -> str:
    """Say which fingers pass through the object at rest."""
    names = " and ".join(overlap.finger for overlap in overlaps)
    deepest = amount_text(max(overlap.depth for overlap in overlaps), "m", ".2g")
    return f"{names} {'passes' if len(overlaps) == 1 else 'pass'} through the object at rest, {deepest} deep"


def opening_words(found: Mapping[str, float]) -> str:
    """Say how fingers are opened that do not leave the object as they are released, by differences of tensions [N]."""
    each = [
        f"{name} by {amount_text(abs(pull), 'N', '.3g')} on the {'bending' if pull > 0.0 else 'back'} tendon"
        for name, pull in found.items()
    ]
    return f"open {', '.join(each)} before the object is there"


def openings(scene: HandScene, arrays: Mapping[str, Array]) -> dict[str, float]:
    """Difference of the tensions [N] that takes each finger off the object which does not leave it as it is released.

    Such a finger at rest is in the object or on its other side: it is opened before the object is there, then closed.
    Positive where it is opened by bending it further. Without the object, a finger follows its tendons alone; NaN where
    no difference within the limits of its tendons clears the object on the side on which it touches.
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
    """Sign of the change of the difference of the tensions that moves the places which touch off the object."""
    line = arrays[f"{setup.name}.backbone"]
    stations, points = line[:, 0], line[:, 1:3]
    # How much the section at each place turns per bending moment.
    gives = np.gradient(stations) / setup.finger.profile.bending_stiffness(stations)
    moved = 0.0
    for k in touching:
        at = int(np.abs(stations - arrays["contact_stations"][k]).argmin())
        arm = points[at] - points[: at + 1]
        shift = gives[: at + 1] @ np.column_stack([-arm[:, 1], arm[:, 0]])
        moved += float(shift @ (arrays["contact_normals"][k] @ frame.axes[:, :2]))
    return 1.0 if moved > 0.0 else -1.0


def _is_clear(body: BodySurface, setup: FingerSetup, frame: PlaneFrame, difference: float) -> bool:
    """Whether a finger pulled by a difference of its tensions [N], which nothing touches, is clear of the object."""
    stations, line = free_line(setup.finger, (max(difference, 0.0), max(-difference, 0.0)))
    points = frame.world(np.column_stack([line, np.zeros(len(line))]))
    gaps = body.distance(points)[0] - setup.finger.profile.half_thickness(stations)
    return float(gaps.min()) > -CLEAR * setup.finger.rod.length
