"""Curves that drawn polygons approximate: arcs replace edges between corners that turn little."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from continuum_grasp.scene.parts import Face, OffsetPolygon, faces_between, joined
from continuum_grasp.scene.polygons import PlanePoint, edge_normal
from continuum_grasp.scene.value import SAME

BLUNT, _SPAN = 0.1, 0.3
"""Turn of the normal at a corner [rad] below which it may be a point of a curve, and what such corners, one after the
other, turn at least in all: a corner alone, however blunt, is a corner."""
_UNEVEN = 3.0
"""Least ratio of the lengths of two edges that makes the longer one a straight line, tangent to the curve."""
SHARE = 1e-3
"""Distance of a polygon from the curve that it stands for, per longer side of the object [1], by default and at most: a
circle that is drawn has 64 corners then."""
_NEAR = 2e-5
"""Greatest distance between arcs and the corners of a curve, per extent of the part: the rounding of coordinates to
whole micrometers, for a few centimeters."""
_BENT = 0.1, 1.0
"""Greatest turn of the normal between three corners whose circle gives the tangent at the middle one, and greatest turn
along two arcs [rad]."""


def curved(part: OffsetPolygon) -> OffsetPolygon:
    """Return the part with curves instead of edges between corners that are points of a curve.

    Such corners are convex, as blunt as `BLUNT`, and follow each other with a total turn of `_SPAN`. The curve has the
    tangents of circles through three corners, and stays within `SHARE` of the polygon's extent, because drawings are
    not more accurate. Corners between lines, and reflex corners, stay.
    """
    core, count = part.vertices, len(part.vertices)
    if count < 3 or part.radius > 0.0:
        return part
    turns = [turn for _, turn in part.turns]
    sizes = [math.dist(a, b) for a, b in pairwise((*core, core[0]))]
    most = SHARE * max(max(z) - min(z) for z in zip(*core, strict=True))
    smooth = [0.0 < turn < BLUNT for turn in turns]
    while any(smooth := _in_runs(smooth, turns)):
        bends = _bends(core, turns, sizes, smooth)
        refused = set[int]()
        for k, (size, (low, high)) in enumerate(zip(sizes, bends, strict=True)):
            # 8: a chord is its length times the angle to the tangents over 4 away from its arc
            if (low > 0.0) != (high > 0.0) or size * (low + high) > 8.0 * most:
                refused |= {k, (k + 1) % count}
        refused = {k for k in refused if smooth[k]}
        if not refused:
            return _fitted(part, bends, smooth)
        smooth = [on and k not in refused for k, on in enumerate(smooth)]
    return part


def hollowed(part: OffsetPolygon) -> tuple[Face, ...]:
    """Return lines and arcs of the core of a part, with arcs also between reflex corners that are points of a curve.

    This is `curved` with inside and outside exchanged. Such arcs turn by a negative angle about a center outside.
    """
    core, count = part.vertices, len(part.vertices)
    if count < 3:
        return part.faces
    bends = part.bends or ((0.0, 0.0),) * count
    turns = [-turn for _, turn in part.turns]
    sizes = [math.dist(a, b) for a, b in pairwise((*core, core[0]))]
    most = SHARE * max(max(z) - min(z) for z in zip(*core, strict=True))
    smooth = [0.0 < t < BLUNT and bends[k] == bends[k - 1] == (0.0, 0.0) for k, t in enumerate(turns)]
    hollow = [(0.0, 0.0)] * count
    while any(smooth := _in_runs(smooth, turns)):
        hollow = _bends(core, turns, sizes, smooth)
        refused = {
            j
            for k, (size, (low, high)) in enumerate(zip(sizes, hollow, strict=True))
            for j in (k, (k + 1) % count)
            if smooth[j] and ((low > 0.0) != (high > 0.0) or size * (low + high) > 8.0 * most)
        }
        if not refused:
            break
        hollow, smooth = [(0.0, 0.0)] * count, [on and k not in refused for k, on in enumerate(smooth)]
    faces = list[Face]()
    for (a, b), (low, high), bend in zip(pairwise((*core, core[0])), hollow, bends, strict=True):
        faces += faces_between(a, b, -low, -high) if low and high else faces_between(a, b, *bend)
    return joined(faces, SAME * part.extent)


def _fitted(part: OffsetPolygon, bends: list[tuple[float, float]], smooth: list[bool]) -> OffsetPolygon:
    """Return the part with few arcs instead of runs of bent edges; the corners lie on the arcs."""
    core, count = part.vertices, len(part.vertices)
    normals = [edge_normal(a, b) for a, b in pairwise((*core, core[0]))]
    inner = [smooth[k] and bends[k] != (0.0, 0.0) != bends[k - 1] for k in range(count)]
    first = inner.index(False) if False in inner else 0
    ring, places = [(first + k) % count for k in range(count)], list[tuple[PlanePoint, float, float]]()
    while ring:
        edge, run = ring[0], [ring.pop(0)]
        while ring and inner[ring[0]] and bends[edge] != (0.0, 0.0):
            run.append(ring.pop(0))
        ends = normals[edge] - bends[edge][0], normals[run[-1]] + bends[run[-1]][1]
        corners = [core[k] for k in (*run, (run[-1] + 1) % count)]
        if bends[edge] == (0.0, 0.0):
            places.append((corners[0], ends[0], ends[0]))
            continue
        tangents = _tangents(corners, ends, closed=all(inner))
        places += _on_arcs(corners, tangents, _NEAR * part.extent)
        places[-1] = (*places[-1][:2], places[-1][2])
    vertices = tuple(point for point, _, _ in places)
    edges = zip(pairwise((*vertices, vertices[0])), places, (*places[1:], places[0]), strict=True)
    fitted = []
    for (a, b), (_, after, end), _ in edges:
        normal = edge_normal(a, b)
        low, high = math.remainder(normal - after, math.tau), math.remainder(end - normal, math.tau)
        fitted.append((low, high) if min(low, high) > 1e-12 else (0.0, 0.0))
    return replace(part, vertices=vertices, bends=tuple(fitted))


def _tangents(corners: list[PlanePoint], ends: tuple[float, float], *, closed: bool) -> list[float]:
    """Angles of the normals at the corners of a run [rad], with those at its ends: of circles through three corners,
    which are as far apart as the normal turns little, so that rounding of coordinates matters less.
    """
    count = len(corners)
    normals = [edge_normal(a, b) for a, b in pairwise(corners)]
    angles = [ends[0]]
    for k in range(0 if closed else 1, count - 1):
        reach = 1
        while closed or (k > reach and k + reach + 1 < count):
            a, b = (corners[(k + side * (reach + 1)) % (count - 1 if closed else count)] for side in (-1, 1))
            turn = edge_normal(corners[k], b) - edge_normal(a, corners[k])
            if not 0.0 < math.remainder(2.0 * turn, math.tau) < _BENT[0]:
                break
            reach += 1
        a, b = (corners[(k + side * reach) % (count - 1 if closed else count)] for side in (-1, 1))
        # The angle of tangent and chord is that at the third corner.
        off = math.remainder(edge_normal(corners[k], b) - edge_normal(a, b), math.tau)
        angle = edge_normal(a, corners[k]) + off
        angles.append(normals[k] + math.remainder(angle - normals[k], math.tau))
    if closed:
        return [*angles[1:], angles[1]]
    return [*angles, ends[1]]


def _on_arcs(corners: list[PlanePoint], angles: list[float], near: float) -> list[tuple[PlanePoint, float, float]]:
    """Move the corners of a run onto arcs with given normals at some of them, if the arcs pass within ``near`` [m].

    Return the places of all corners except the last one, and the angles of the normals at the start and at the end of
    each edge [rad].
    """
    count, begin, places = len(corners), 0, list[tuple[PlanePoint, float, float]]()
    while begin < count - 1:
        # As many as fit, by doubling and halving the step.
        size, step, best = 1, 1, [(corners[begin], angles[begin])]
        while step:
            last = begin + size + step
            found = _over(corners[begin : last + 1], angles[begin], angles[last], near) if last < count else None
            if found is not None:
                size, step, best = size + step, 2 * step, found
            else:
                step //= 2
        begin += size
        turns = [angle for _, angle in best]
        places += [(point, a, b) for (point, a), b in zip(best, [*turns[1:], angles[begin]], strict=True)]
    return places


def _over(corners: list[PlanePoint], first: float, last: float, near: float) -> list[tuple[PlanePoint, float]] | None:
    """Return the corners, except the last one, on two arcs from the first to the last corner, with these normals.

    Also return the joint of both arcs and the angles of the normals; None if a corner is not near the arcs.
    """
    a, b = corners[0], corners[-1]
    normal = edge_normal(a, b)
    low, high = math.remainder(normal - first, math.tau), math.remainder(last - normal, math.tau)
    if min(low, high) <= 0.0 or low + high > _BENT[1]:
        return None
    pair = faces_between(a, b, low, high)
    if min(face.turn for face in pair) <= 0.0:
        return None
    places = [(a, first), (pair[1].start, first + pair[0].turn)]
    for corner in corners[1:-1]:
        angles = [math.atan2(corner[1] - arc.center[1], corner[0] - arc.center[0]) - arc.normal for arc in pair]
        turned = math.remainder(angles[0], math.tau)
        arc, turned = (pair[0], turned) if turned < pair[0].turn else (pair[1], math.remainder(angles[1], math.tau))
        if not 0.0 < turned < arc.turn or abs(math.dist(corner, arc.center) - arc.radius) > near:
            return None
        angle = arc.normal + turned
        x, y = arc.center
        at = x + arc.radius * math.cos(angle), y + arc.radius * math.sin(angle)
        places.append((at, first + math.remainder(angle - first, math.tau)))
    places.sort(key=lambda place: place[1])
    steps = [other[1] - place[1] for place, other in pairwise(places)]
    # 1e-3: an edge shorter than this share of the arcs is left out; the corner at its end stays, not the joint.
    spare = {places[k][0] for k, step in enumerate(steps) if step < 1e-3 * (low + high) and k > 0}
    return [place for place in places if place[0] not in spare]


def _in_runs(smooth: list[bool], turns: list[float]) -> list[bool]:
    """Find corners that are smooth together with their neighbors and turn by `_SPAN` in total."""
    count = len(turns)
    if all(smooth):
        return smooth
    long = list(smooth)
    for k in range(count):
        if smooth[k] and not smooth[k - 1]:
            run = [k]
            while smooth[(run[-1] + 1) % count]:
                run.append((run[-1] + 1) % count)
            if sum(turns[j] for j in run) < _SPAN:
                for j in run:
                    long[j] = False
    return long


def _bends(
    core: tuple[PlanePoint, ...], turns: list[float], sizes: list[float], smooth: list[bool]
) -> list[tuple[float, float]]:
    """Return, for each edge, the angles between it and a curve through smooth corners, at both ends [rad]."""
    count = len(core)
    low, high = [0.0] * count, [0.0] * count
    for k in (k for k in range(count) if smooth[k]):
        before, after = sizes[k - 1], sizes[k]
        if before > _UNEVEN * after:
            low[k] = turns[k]
        elif after > _UNEVEN * before:
            high[k - 1] = turns[k]
        else:
            # Half the diameter of the circle through three corners: the law of sines.
            radius = math.dist(core[k - 1], core[(k + 1) % count]) / (2.0 * math.sin(turns[k]))
            low[k] = math.asin(min(after / (2.0 * radius), math.sin(turns[k])))
            high[k - 1] = turns[k] - low[k]
    for k in range(count):
        # Toward a corner that does not belong to the curve, the curve continues as a circle.
        ends = (smooth[k], turns[k]), (smooth[(k + 1) % count], turns[(k + 1) % count])
        if low[k] > 0.0 == high[k] and not ends[1][0] and ends[1][1] > 2.0 * low[k]:
            high[k] = low[k]
        elif high[k] > 0.0 == low[k] and not ends[0][0] and ends[0][1] > 2.0 * high[k]:
            low[k] = high[k]
    return list(zip(low, high, strict=True))
