"""How the fingers of a hand are opened, so that a grasp can be reached whose fingers at rest are in the object's way."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

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
    """Say how fingers are opened, by differences of their tensions [N]."""
    each = [
        f"{name} by {amount_text(abs(pull), 'N', '.3g')} on the {'bending' if pull > 0.0 else 'back'} tendon"
        for name, pull in found.items()
    ]
    return f"open {', '.join(each)} before the object is there"


def openings(scene: HandScene, arrays: Mapping[str, Array], names: Iterable[str]) -> dict[str, float]:
    """Difference of the tensions [N] that takes fingers off the object, from those of a grasp, by their names.

    Positive where a finger is opened by bending it further. Without the object, a finger follows its tendons alone; NaN
    where no difference within the limits of its tendons clears the object on the side on which it touches.
    """
    body = BodySurface(scene)
    frames = dict(zip((setup.name for setup in scene.setups), PlaneFrame.each(scene), strict=True))
    setups = {setup.name: setup for setup in scene.setups}
    return {name: _opening(body, setups[name], frames[name], arrays) for name in names}


def _opening(body: BodySurface, setup: FingerSetup, frame: PlaneFrame, arrays: Mapping[str, Array]) -> float:
    """The same of one finger."""
    left, right = (float(tension) for tension in arrays[f"{setup.name}.tensions"])
    now = left - right
    touched = [k for k, name in enumerate(arrays["contact_names"].tolist()) if name.startswith(f"{setup.name}.")]
    if not touched:
        return now
    most = setup.max_tension
    used = setup.finger.tendons_used
    ends = {1.0: most if used != "right" else 0.0, -1.0: -most if used != "left" else 0.0}
    half = setup.finger.profile.half_thickness
    # The side to which a greater difference moves the places that touch.
    step = 1e-3 * most
    stations, ahead = _line(setup, frame, now + step)
    _, behind = _line(setup, frame, now - step)
    moved = 0.0
    for k in touched:
        at = int(np.abs(stations - arrays["contact_stations"][k]).argmin())
        moved += float((ahead[at] - behind[at]) @ arrays["contact_normals"][k])
    for difference in np.linspace(now, ends[1.0 if moved > 0.0 else -1.0], STEPS + 1):
        stations, points = _line(setup, frame, float(difference))
        if float((body.distance(points)[0] - half(stations)).min()) > -CLEAR * setup.finger.rod.length:
            return float(difference)
    return float("nan")


def _line(setup: FingerSetup, frame: PlaneFrame, difference: float) -> tuple[Array, Array]:
    """Stations, and points (K, 3) as the hand sees them, of a finger pulled by a difference of its tensions [N]."""
    stations, line = free_line(setup, (max(difference, 0.0), max(-difference, 0.0)))
    return stations, frame.world(np.column_stack([line, np.zeros(len(line))]))
