"""Palm and table of a hand: planes that carry an object at a given pose, and their points of contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from continuum_grasp.base import Array
from continuum_grasp.scene.solids import SolidBody, SpatialPosition, Vector3
from continuum_grasp.scene.supports import TOUCHING, Switch
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Extent, Friction, Real, Value

LEAST_FRICTION = 1e-3
"""Least coefficient of friction of fingers, palm and table [1]: cones have rounded apexes."""
_NEARLY = 1e-3
"""Gap, per size of the object, below which it is likely meant to touch [1]."""
_LEANS = 1e-3
"""Least cosine of the angle between the finger at its base and the normal of the plane that it leaves [1]."""


class _PlaneKeys(Value):
    friction: Annotated[Friction, Field(ge=LEAST_FRICTION)] | None = None
    """Friction coefficient between it and the object, not zero [1]; None: ``contacts.friction``."""
    touch: Switch = "auto"
    """Whether palm or table carries the object; auto: where the object lies against it."""

    def plane(
        self, name: str, key: str, point: Vector3, normal: Vector3, friction: float, radius: float | None = None
    ) -> PlaneSupport:
        """Return the surface through a point; by default it has the friction of all contacts."""
        size = math.hypot(*normal)
        x, y, z = (n / size for n in normal)
        own = friction if self.friction is None else self.friction
        has_own = self.friction is not None
        return PlaneSupport(name, key, point, (x, y, z), radius or math.inf, own, has_own, self.touch)


class HandPalm(_PlaneKeys):
    """A disc about the hand's axis, or a plane across it, that faces the object along -z."""

    radius: Extent | None = None
    """Radius of the disc [m]; None: a plane. The object and the fingers stay below its plane in any case."""
    height: Annotated[Real, Unit("m")] | None = None
    """Place of its surface along z [m]; None: where the bases are."""


class HandTable(_PlaneKeys):
    """A plane that may carry the object."""

    point: SpatialPosition
    """A point of its surface, as the hand sees it [m]."""
    normal: Annotated[Vector3, Unit("1")] = (0.0, 0.0, 1.0)
    """Direction of its normal, out of the material, of any length [1]."""

    def _check(self) -> None:
        if not math.hypot(*self.normal) > 0.0:
            raise ValueError("normal must not be zero")


@dataclass(frozen=True)
class PlaneSupport:
    """A plane, or a disc in it, that may carry the object and that the fingers keep clear of."""

    name: str
    key: str
    """Place in the scene."""
    point: tuple[float, float, float]
    """A point of it, of a disc the center [m]."""
    normal: tuple[float, float, float]
    """Unit normal, out of the material."""
    radius: float
    """Radius of the disc [m]; infinite for a plane."""
    friction: float
    has_own_friction: bool
    """Whether its friction differs from ``contacts``."""
    touch: Switch

    def height(self, point: Vector3) -> float:
        """Distance of a point from the plane [m], negative behind it."""
        return sum(n * (p - q) for n, p, q in zip(self.normal, point, self.point, strict=True))

    def clear_from(self, base: Vector3, direction: Vector3, half: float) -> float:
        """Return the least place along a finger of half a thickness that must stay clear of the plane [m].

        This is half a thickness, measured along the normal, beyond the place at which the straight finger is clear. It
        is infinite if a straight finger never leaves the plane.
        """
        missing = half - self.height(base)
        if missing <= 0.0:
            return 0.0
        leaves = sum(n * d for n, d in zip(self.normal, direction, strict=True)) / math.hypot(*direction)
        return (missing + half) / leaves if leaves > _LEANS else math.inf


@dataclass(frozen=True)
class SupportContact:
    """Point of contact between the object and a plane."""

    name: str
    support: PlaneSupport
    position: tuple[float, float, float]
    """As the hand sees it [m]."""


def outermost_points(body: Any, direction: Array) -> Array:
    """Return points (K, 3) of a solid, in the hand's frame, that include the farthest ones along a unit direction.

    For a round surface this is one point; for a body with edges, all its corners, so that equally far ends of an edge
    or corners of a face are included.
    """
    import numpy as np

    local = direction @ body.axes
    if body.shape == "sphere":
        points = 0.5 * body.diameter * local[None]
    elif body.shape == "ellipsoid":
        half = 0.5 * np.array(body.extents)
        points = (half**2 * local / np.linalg.norm(half * local))[None]
    elif body.shape == "box":
        # Everything within the radius of the box that the centers of its corners make.
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        points = signs * (0.5 * np.array(body.extents) - body.edge_radius) + body.edge_radius * local
    elif body.shape == "cylinder":
        # Four points of each rim, including the lowest.
        turn = math.atan2(local[1], local[0]) + 0.5 * math.pi * np.arange(4)
        rim = (0.5 * body.diameter - body.edge_radius) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        top = np.full((4, 1), 0.5 * body.height - body.edge_radius)
        points = np.concatenate([np.hstack([rim, top]), np.hstack([rim, -top])]) + body.edge_radius * local
    else:
        points = body.outermost(local)
    return np.asarray(np.array(body.position) + points @ body.axes.T)


def gap_of(body: SolidBody, support: PlaneSupport) -> float:
    """Return the distance of a solid from the plane of a support [m]; negative if it reaches behind the plane."""
    import numpy as np

    normal = np.array(support.normal)
    return float(((outermost_points(body, -normal) - np.array(support.point)) @ normal).min())


def lie_against(body: SolidBody, support: PlaneSupport) -> SolidBody:
    """A copy of a solid, moved along the normal of a support until it touches."""
    gap = gap_of(body, support)
    x, y, z = (p - gap * n for p, n in zip(body.position, support.normal, strict=True))
    return body.model_copy(update={"position": (x, y, z)})


def support_contacts(body: SolidBody, support: PlaneSupport) -> tuple[SupportContact, ...]:
    """Return the contact points of a solid on a support: one, or the corners of an edge or a face, within the disc."""
    import numpy as np

    normal = np.array(support.normal)
    points = outermost_points(body, -normal)
    points = points[(points - np.array(support.point)) @ normal <= TOUCHING * body.size]
    if len(points) and math.isfinite(support.radius):
        points = _within_disc(points, support)
    # Corners of a body without straight edges are the same.
    apart = [k for k, p in enumerate(points) if all(math.dist(p, q) > TOUCHING * body.size for q in points[:k])]
    places = ((float(x), float(y), float(z)) for x, y, z in points[apart])
    return tuple(SupportContact(f"{support.name}_{k + 1}", support, place) for k, place in enumerate(places))


def _within_disc(points: Array, support: PlaneSupport) -> Array:
    """Corners (K, 3) of the part of a point, an edge or a convex face that lies on a disc: where the face reaches over
    the rim, points of the rim.
    """
    import numpy as np

    center = np.array(support.point)
    normal = np.array(support.normal)
    radius = support.radius
    # Two axes of the plane: the axis of the hand's that is farthest from the normal gives the first.
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    axes = np.stack([first / np.linalg.norm(first), np.cross(normal, first) / np.linalg.norm(first)])
    flat = (points - center) @ axes.T
    heights = (points - center) @ normal
    if len(points) > 2:  # in the order of the outline
        around = flat - flat.mean(axis=0)
        flat = flat[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
    found = [corner for corner in flat if math.hypot(*corner) <= radius * (1.0 + TOUCHING)]
    for start, end in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        span = end - start
        a = span @ span
        b = start @ span
        c = start @ start - radius**2
        if a > 0.0 and b * b - a * c > 0.0:
            shares = (-b + math.sqrt(b * b - a * c) * np.array([-1.0, 1.0])) / a
            found += [start + share * span for share in shares if 0.0 <= share <= 1.0]
    if len(flat) > 2:
        quarters = radius * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        sides = np.roll(flat, -1, axis=0) - flat
        for point in quarters:
            away = point - flat
            if (sides[:, 0] * away[:, 1] - sides[:, 1] * away[:, 0] >= 0.0).all():
                found.append(point)
    return np.asarray(center + np.array(found).reshape(-1, 2) @ axes + heights.mean() * normal)


def check_support(body: SolidBody, support: PlaneSupport) -> None:
    """Refuse, by `ValueError`, an object in a support, or one that should touch it and does not."""
    gap = gap_of(body, support)
    near = TOUCHING * body.size
    advice = f"set object.against: {support.name}, or move object.position by {_shift(support, -gap)}"
    if gap < -near:
        raise ValueError(f"{support.key}: the object is {-1e3 * gap:.4g} mm inside it: {advice}")
    if support.touch == "on" and gap > near:
        raise ValueError(f"{support.key}: the object should touch it and is {1e3 * gap:.4g} mm away: {advice}")
    if support.touch == "auto" and near < gap < _NEARLY * body.size:
        raise ValueError(
            f"{support.key}: the object is {1e3 * gap:.4g} mm away, too near to be clear of it, too far to touch it: "
            f"{advice}, or set {support.key}.touch: off"
        )
    if support.touch == "on" and not support_contacts(body, support):
        raise ValueError(f"{support.key}: the object should touch it and lies beside the disc: a greater "
                         f"{support.key}.radius is needed, or touch: auto")  # fmt: skip


def _shift(support: PlaneSupport, by: float) -> str:
    shift = ", ".join(f"{1e3 * by * n + 0.0:.4g}" for n in support.normal)
    return f"[{shift}] mm"
