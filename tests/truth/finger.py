"""What the reference implementation needs to know of a finger, and the curvature bases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tests.truth.quadrature import ctx

FAMILIES = ("arc", "clothoid", "matched_clothoid", "quadratic")


@dataclass(frozen=True)
class TruthFinger:
    """A planar inextensible rod with a finite curvature basis; SI units, numbers taken exactly as given.

    The unknowns q are the bending angles of the elements [rad] ("arc"), all nodal curvatures [1/m]
    ("clothoid"), all nodal curvatures but the last, which is prescribed ("matched_clothoid"), or the
    curvatures at start, middle and end of each element ("quadratic"); all above those at rest, of which arcs
    and quadratics have the mean on each element.
    """

    lengths: Sequence
    """Element lengths [m]."""
    family: str = "arc"
    mass_per_length: object = 1
    """[kg/m]"""
    rotary_inertia: object = 0
    """Rotary inertia per length [kg m]."""
    bending_stiffness: object = 0
    """[N m2]"""
    rest_curvature: object = 0
    """A number [1/m], or pieces (start [m], end [m], curvature [1/m])."""
    masses: Sequence = ()
    """Point masses (s [m], mass [kg])."""
    gravity: Sequence = (0, 0)
    """World axes [m/s2]."""
    base_position: Sequence = (0, 0)
    """World axes [m]."""
    base_angle: object = 0
    """World angle of the base axes [rad]; the undeformed backbone points along base Y."""
    material_damping: object = 0
    """eta [N m2 s]: moment per rate of curvature."""
    element_damping: object = 0
    """c [N m s]: moment per rate of each element's bend."""

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise ValueError(f"family must be one of {FAMILIES}, got {self.family!r}")

    @property
    def count(self) -> int:
        """Number of coordinates including a prescribed one."""
        if self.family == "quadratic":
            return 3 * len(self.lengths)
        return len(self.lengths) + (self.family != "arc")

    @property
    def unknowns(self) -> int:
        """Number of unknowns q."""
        return self.count - (self.family == "matched_clothoid")

    @property
    def edges(self) -> list:
        """Positions of the element boundaries [m]."""
        edges = [ctx.mpf(0)]
        for length in self.lengths:
            edges.append(edges[-1] + ctx.mpf(length))
        return edges

    @property
    def pieces(self) -> list:
        """Rest curvature as (start, end, value)."""
        if isinstance(self.rest_curvature, (list, tuple)):
            return [tuple(ctx.mpf(v) for v in piece) for piece in self.rest_curvature]
        return [(ctx.mpf(0), self.edges[-1], ctx.mpf(self.rest_curvature))]


def rest_of(finger: TruthFinger, e: int) -> list:
    """Rest curvature on an element, as (start, end, value) from its start."""
    a, b = finger.edges[e : e + 2]
    parts = [(max(a, start) - a, min(b, end) - a, value) for start, end, value in finger.pieces]
    parts = [part for part in parts if part[1] > part[0]]
    # The last piece reaches to the tip however the lengths were rounded.
    parts[-1] = (parts[-1][0], b - a, parts[-1][2])
    if finger.family.endswith("clothoid"):
        return parts
    return [(ctx.mpf(0), b - a, ctx.fsum((high - low) * value for low, high, value in parts) / (b - a))]


class Shape(NamedTuple):
    """One coordinate's share of the angle: c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 3, x from the element's start."""

    c0: object
    c1: object
    c2: object
    c3: object = ctx.mpf(0)

    def angle(self, x):
        """d(angle)/dq at x."""
        return self.c0 + x * (self.c1 + x * (self.c2 / 2 + x * self.c3 / 3))

    def curvature(self, x):
        """d(curvature)/dq at x."""
        return self.c1 + x * (self.c2 + x * self.c3)

    @property
    def active(self) -> bool:
        return any(bool(c) for c in self)


def shapes(finger: TruthFinger) -> list[list[Shape]]:
    """``shapes[e][j]``: coordinate j on element e."""
    zero = ctx.mpf(0)
    start = [zero] * finger.count
    table = []
    for e, length in enumerate(finger.lengths):
        h = ctx.mpf(length)
        row = [Shape(c0, zero, zero) for c0 in start]
        if finger.family == "arc":
            row[e] = Shape(start[e], 1 / h, zero)
        elif finger.family == "quadratic":
            # One at the place itself and zero at the two others.
            values = ((1, -3 / h, 2 / h**2), (0, 4 / h, -4 / h**2), (0, -1 / h, 2 / h**2))
            for j, (c1, c2, c3) in enumerate(values, 3 * e):
                row[j] = Shape(start[j], ctx.mpf(c1), c2, c3)
        else:
            row[e] = Shape(start[e], ctx.mpf(1), -1 / h)
            row[e + 1] = Shape(start[e + 1], zero, 1 / h)
        table.append(row)
        start = [shape.angle(h) for shape in row]
    return table
