"""Closed curves of drawings as polygons of few corners."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise

from continuum_grasp.scene.polygons import PlanePoint, corners_of

FINER = 0.25
"""Share of the tolerance at which reports measure the effect of the tolerance [1]: chords are then half as long."""
MOST = 512
"""Corners of that polygon at most: it is solved next to a grasp that is known, without a search."""


def simplified(ring: Sequence[PlanePoint], tolerance: float, retained: Collection[int] = ()) -> tuple[PlanePoint, ...]:
    """Corners, counter-clockwise, of a polygon no farther from a closed curve than a tolerance [m].

    They are points of the curve, which has each once; those ``retained``, by index, are among them.
    """
    import shapely

    if not retained:
        return corners_of(shapely.Polygon(ring).simplify(tolerance).exterior.coords[:-1])
    # A closed line may lose its own end: two points at least divide the curve.
    first = min(retained)
    ends = sorted({*retained, (first + len(ring) // 2) % len(ring)})
    pieces = [[*ring[a:b], ring[b]] for a, b in pairwise(ends)]
    pieces.append([*ring[ends[-1] :], *ring[: ends[0] + 1]])
    lines = shapely.MultiLineString(pieces).simplify(tolerance).geoms  # of one geometry, so that they do not cross
    return corners_of([point for line in lines for point in line.coords[:-1]])


def deviation(curve: Sequence[PlanePoint], corners: Sequence[PlanePoint]) -> float:
    """Greatest distance of points of a curve from a polygon's outline [m]."""
    import shapely

    return float(shapely.distance(shapely.LinearRing(corners), shapely.points(curve)).max())


def grown(corners: Sequence[PlanePoint], by: float) -> tuple[PlanePoint, ...]:
    """Return the corners of a polygon with sides farther out by a distance [m]."""
    import shapely

    if by == 0.0:
        return tuple(corners)
    whole = shapely.Polygon(corners).buffer(by, join_style="mitre")
    return corners_of(whole.exterior.coords[:-1])
