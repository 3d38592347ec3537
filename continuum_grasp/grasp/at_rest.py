"""Fingers at rest against their surroundings: without tensions, weight and contacts each has its rest curvature."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.scene import CommandedScene, Finger, GraspScene, HandScene, Scene, Wall

PANELS = 400
"""Number of chords of a finger at rest: for a bend of one turn they deviate by 3e-5 of its length."""
CLEAR = 1e-3
"""Up to this depth, per length of the finger, a finger at rest counts as touching a body [1]: drawings and rounded
positions have such errors."""


@dataclass(frozen=True)
class RestOverlap:
    """A finger at rest that passes through a body.

    Attributes
    ----------
    finger : str
        Name of the finger.
    key : str
        Key of the body in the scene.
    body : str
        ``object``, or the name of a support.
    depth : float
        Greatest depth of the finger's skin in the body [m].
    station : float
        Place along the finger where it is deepest [m].
    """

    finger: str
    key: str
    body: str
    depth: float
    station: float

    def __str__(self) -> str:
        name = "the object" if self.body == "object" else self.body
        return (
            f"{self.finger} at rest passes through {name}: {1e3 * self.depth:.3g} mm deep, {1e3 * self.station:.3g} mm "
            "from its base"
        )


def overlaps_at_rest(scene: GraspScene | HandScene | Scene | CommandedScene) -> tuple[RestOverlap, ...]:
    """Find the fingers that pass through the object or a support while no tendon pulls.

    This takes milliseconds, because it solves nothing. Bodies and bases are at the poses of the scene; a free pose
    counts at its start. The bend by weight and contacts is neglected.

    Parameters
    ----------
    scene : GraspScene, HandScene, Scene or CommandedScene
        A grasp, or a scene of motion (simulation, closed loop, plan), whose finger has the name ``finger``.

    Returns
    -------
    tuple of RestOverlap
        In the order of the fingers, for each the object first; empty if all fingers are clear.
    """
    lines = _in_space(scene) if isinstance(scene, HandScene) else _in_plane(scene)
    found = list[RestOverlap]()
    for name, stations, gaps in lines:
        for body, (key, gap) in gaps.items():
            deepest = int(gap.argmin())
            depth = -float(gap[deepest])
            if depth > CLEAR * stations[-1]:
                found.append(RestOverlap(name, key, body, depth, float(stations[deepest])))
    return tuple(found)


def free_line(finger: Finger, tensions: tuple[float, float] = (0.0, 0.0)) -> tuple[Array, Array]:
    """Return the shape of a finger without contacts: stations (K,) [m], and the center line (K, 2) [m] from the origin
    along y, bent in its plane by tensions [N] without friction.
    """
    profile = finger.profile
    stations = np.unique([*np.linspace(0.0, profile.length, PANELS + 1), *profile.rest_curvature.edges])
    middle = 0.5 * (stations[1:] + stations[:-1])
    steps = np.diff(stations)
    # Idle drives: other inputs than tensions, such as pressures, are zero too.
    channels = finger.channels if any(tensions) else ()
    moment = sum(np.dot(channel.arms, tensions) * channel.shape(middle) for channel in channels)
    turns = (profile.rest_curvature(middle) + moment / profile.bending_stiffness(middle)) * steps
    # Angle at the middle of each panel: exact for constant curvature.
    angle = np.cumsum(turns) - 0.5 * turns
    line = np.zeros((len(stations), 2))
    line[1:] = np.cumsum(np.column_stack([-np.sin(angle), np.cos(angle)]) * steps[:, None], axis=0)
    return stations, line


_Line = tuple[str, Array, dict[str, tuple[str, Array]]]
"""Name of a finger, stations along it [m], and by body its key and the gaps between body and skin [m]."""


def _in_space(scene: HandScene) -> Iterator[_Line]:
    from continuum_grasp.grasp.hand.body import BodySurface
    from continuum_grasp.grasp.hand.frames import PlaneFrame

    body = BodySurface(scene)
    bases = scene.hand.named_bases
    for setup, frame in zip(scene.setups, PlaneFrame.each(scene), strict=True):
        stations, line = free_line(setup.finger)
        points = frame.world(np.column_stack([line, np.zeros(len(line))]))
        half = setup.finger.profile.half_thickness(stations)
        # A mesh differs from its object by no more than its deviation.
        gaps = {"object": ("object", body.distance(points)[0] - half + scene.object.deviation)}
        for support in scene.supports:
            away = points - np.array(support.point)
            heights = away @ np.array(support.normal)
            beside = np.linalg.norm(away - heights[:, None] * np.array(support.normal), axis=1) - support.radius
            base = bases[setup.name]
            # Near its base, a finger may come out of the support.
            first = support.clear_from(base.position, base.direction, setup.finger.thickness_radius)
            gap = np.where(stations >= first, np.maximum(heights, beside) - half, np.inf)
            gaps[support.name] = support.key, gap
        yield setup.name, stations, gaps


def _in_plane(scene: GraspScene | Scene | CommandedScene) -> Iterator[_Line]:
    if isinstance(scene, GraspScene):
        fingers: dict[str, Finger] = {setup.name: setup.finger for setup in scene.setups}
    else:
        fingers = {"finger": scene.finger}
    body = scene.object
    for name, finger in fingers.items():
        stations, line = free_line(finger)
        base = finger.base
        c, s = math.cos(base.angle), math.sin(base.angle)
        points = np.array(base.position) + line @ np.array([[c, s], [-s, c]])
        half = finger.profile.half_thickness(stations)
        gaps = {}
        if body is not None:
            gaps["object"] = "object", np.array([body.distance((x, y)) for x, y in points.tolist()]) - half
        for place in scene.places:
            if isinstance(place, Wall):
                away = points - np.array(place.point)
                height = away @ np.array(place.normal)
                beside = np.abs(away @ np.array([-place.normal[1], place.normal[0]])) - place.half_length
                # An edge has no inside: the depth of a crossing is half its thickness.
                gap = height if math.isinf(place.half_length) else np.hypot(height, np.maximum(beside, 0.0))
            else:
                gap = np.linalg.norm(points - np.array(place.position), axis=1) - place.radius
            # A finger may come out of a support that its base is in.
            out = np.logical_or.accumulate(gap >= half)
            gap = np.where(out, gap - half, np.inf) if out.any() else gap - half
            gaps[place.name] = f"supports.{place.name}", gap
        yield name, stations, gaps
