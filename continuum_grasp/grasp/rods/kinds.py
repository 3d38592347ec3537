"""Kinds of blocks of a grasp in the plane: one rows-function each, for all fingers, contacts and bodies.

Each finger has units of its own: its length L, the force E I / L^2, the moment E I / L. The object has its size and a
force F0. ``ratio`` is L per size, ``unit`` the finger's force per F0. A finger's tangent is (-sin a, cos a). At a
contact, n is the outward normal of the object and n' is n turned by +90 degrees: N n + f n' is the force on the body
that touches the object, and u is the lift on the object, out of the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import casadi as ca

from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.rods.rod import Course, between, integral, polynomial, slope, stage
from continuum_grasp.nlp import BlockKind, Lookup

Symbols = Any
STATE, FORCE, HELD, POSE = 4, 2, 3, 3
"""Numbers of a node (x, y, a, M), a force, the forces of a contact (N, f, u), and a pose (x, y, angle)."""
TABLE, CELL = 6, 18
"""Data of a `DistanceTable` in the plane, and of a cell (2) with its coefficients (16)."""


class _Parts:
    """Symbols of a block, taken one after the other."""

    def __init__(self) -> None:
        self._unknowns: list[ca.SX] = []
        self._data: list[ca.SX] = []

    def unknown(self, name: str, size: int = 1) -> Any:
        """Symbols of unknowns; a single one as a scalar."""
        return self._taken(self._unknowns, name, size)

    def datum(self, name: str, size: int = 1) -> Any:
        """Symbols of data; a single one as a scalar."""
        return self._taken(self._data, name, size)

    def course(self, count: int) -> Course:
        """A course whose polynomials have so many coefficients."""
        return Course.of(ca.vertsplit(ca.vertcat(self._taken(self._data, "course", 5 * count))))

    @staticmethod
    def _taken(into: list[ca.SX], name: str, size: int) -> Any:
        into.append(ca.SX.sym(name, size))
        return into[-1] if size > 1 else into[-1][0]

    def kind(self, name: str, rows: Sequence[Any], lookup: Lookup | None = None) -> BlockKind:
        """The kind of these symbols."""
        data = ca.vertcat(*self._data) if self._data else ca.SX(0, 1)
        return BlockKind(name, ca.vertcat(*self._unknowns), data, ca.vertcat(*rows), lookup)


class _Sight:
    """Gap and normal of the object at a place of a finger [L], by the body's table."""

    def __init__(self, parts: _Parts, place: Sequence[Any], pose: Any, ratio: Any) -> None:
        table = parts.datum("table", TABLE)
        point, found = ca.SX.sym("point", 2), ca.SX.sym("found", CELL)
        numbers = ca.SX.sym("numbers", TABLE)
        distance = DistanceTable.distance(point, numbers, found[:2], found[2:])
        seen = ca.Function("seen", [point, numbers, found], [distance, ca.gradient(distance, point)])
        cosine, sine = ca.cos(pose[2]), ca.sin(pose[2])
        dx, dy = ratio * place[0] - pose[0], ratio * place[1] - pose[1]
        local = ca.vertcat(cosine * dx + sine * dy, cosine * dy - sine * dx)
        read = ca.SX.sym("read", CELL)
        distance, gradient = seen(local, table, read)
        # 1e-30: no division by zero where a table is flat
        along = gradient / ca.sqrt(ca.sumsqr(gradient) + 1e-30)
        self.gap = distance / ratio
        self.normal = cosine * along[0] - sine * along[1], sine * along[0] + cosine * along[1]
        self.lookup = Lookup(DistanceTable.cell(local, table), table[3], table[4:6], read)


@cache
def stage_kind(count: int) -> BlockKind:
    """Rows (4): a stage ends where the rod leads from its begin; friction of a contact before it adds a couple."""
    parts = _Parts()
    begin, end = parts.unknown("begin", STATE), parts.unknown("end", STATE)
    force, pulls, segment = parts.unknown("force", FORCE), parts.unknown("pulls", 2), parts.unknown("segment", 2)
    friction = parts.unknown("friction")
    u0, u1, couple = (parts.datum(name) for name in ("u0", "u1", "couple"))
    gravity, course = parts.datum("gravity", FORCE), parts.course(count)
    span = segment[1] - segment[0]
    s = segment[0] + u0 * span
    weight = integral(course.weight, segment[0], s)
    state = [*ca.vertsplit(begin)[:3], begin[3] + couple * polynomial(course.half, segment[0]) * friction]
    beyond = [force[k] - gravity[k] * weight for k in range(2)]
    reached = stage(course, ca.vertsplit(gravity), state, beyond, pulls[0] - pulls[1], s, span * (u1 - u0))
    return parts.kind(f"stage{count}", [a - b for a, b in zip(reached, ca.vertsplit(end), strict=True)])


@cache
def contact_kind(count: int, *, tip: bool) -> BlockKind:
    """Rows of a contact: the gap, its direction along the finger, the forces on both sides of a middle contact (2) or
    the forces and the moment at the tip (3), and the balance of the object (6).
    """
    parts = _Parts()
    at, force = parts.unknown("at", STATE), parts.unknown("force", FORCE)
    after = None if tip else parts.unknown("after", FORCE)
    segment, held, pose = parts.unknown("segment", 2), parts.unknown("held", HELD), parts.unknown("pose", POSE)
    ratio, unit = parts.datum("ratio"), parts.datum("unit")
    gravity, load, center = (parts.datum(name, 2) for name in ("gravity", "load", "center"))
    course = parts.course(count)
    sight = _Sight(parts, (at[0], at[1]), pose, ratio)
    half = polynomial(course.half, segment[1])
    nx, ny = sight.normal
    normal, along, lift = (held[k] for k in range(3))
    on_finger = normal * nx - along * ny, normal * ny + along * nx
    weight = integral(course.weight, segment[0], segment[1])
    beyond = [force[k] - gravity[k] * weight for k in range(2)]
    # Directions of the finger and of the surface are the same but for the finger's taper.
    direction = ca.cos(at[2]) * ny - ca.sin(at[2]) * nx - slope(course.half, segment[1])
    rows = [sight.gap - half, direction]
    if after is None:
        rows += [beyond[k] - load[k] - on_finger[k] for k in range(2)]
        rows += [at[3] + half * along]
    else:
        rows += [after[k] - beyond[k] + on_finger[k] for k in range(2)]
    cosine, sine = ca.cos(pose[2]), ca.sin(pose[2])
    rx = ratio * (at[0] - half * nx) - pose[0] - (cosine * center[0] - sine * center[1])
    ry = ratio * (at[1] - half * ny) - pose[1] - (sine * center[0] + cosine * center[1])
    rows += _on_object((-on_finger[0], -on_finger[1], lift), (rx, ry), unit)
    return parts.kind(f"{'tip' if tip else 'middle'}{count}", rows, sight.lookup)


def _on_object(force: Sequence[Any], arm: Sequence[Any], unit: Any) -> list[Any]:
    """Force and moment on the object (6)."""
    fx, fy, fz = force
    rx, ry = arm
    return [unit * part for part in (fx, fy, fz, ry * fz, -rx * fz, rx * fy - ry * fx)]


@cache
def support_kind() -> BlockKind:
    """Rows (6): the force of a support on an object that does not move."""
    parts = _Parts()
    held = parts.unknown("held", HELD)
    arm, n = parts.datum("arm", 2), parts.datum("normal", 2)
    fx, fy = held[0] * n[0] - held[1] * n[1], held[0] * n[1] + held[1] * n[0]
    return parts.kind("support", _on_object((-fx, -fy, held[2]), (arm[0], arm[1]), 1.0))


@cache
def free_tip_kind(count: int) -> BlockKind:
    """Rows (3): at a tip that touches nothing, the moment is zero and the force is that of its load."""
    parts = _Parts()
    moment, force, segment = parts.unknown("moment"), parts.unknown("force", FORCE), parts.unknown("segment", 2)
    gravity, load, course = parts.datum("gravity", 2), parts.datum("load", 2), parts.course(count)
    weight = integral(course.weight, segment[0], segment[1])
    return parts.kind(f"free_tip{count}", [moment, *(force[k] - gravity[k] * weight - load[k] for k in range(2))])


@cache
def cone_kind(*, spatial: bool) -> BlockKind:
    """Rows: Coulomb friction of a contact, of which a margin v stays free; in the plane it is two lines."""
    parts = _Parts()
    held, margin = parts.unknown("held", HELD), parts.unknown("margin")
    friction, apex = parts.datum("friction"), parts.datum("apex")
    most = friction * (1.0 - margin) * held[0]
    if spatial:
        return parts.kind("cone", [most - ca.sqrt(held[1] ** 2 + held[2] ** 2 + apex**2)])
    return parts.kind("wedge", [most - held[1], most + held[1]])


@cache
def clear_kind(count: int) -> BlockKind:
    """Row: the gap between the object and a place of a stage, by the cubic through its ends, less half a thickness."""
    parts = _Parts()
    begin, end = parts.unknown("begin", 3), parts.unknown("end", 3)
    segment, pose = parts.unknown("segment", 2), parts.unknown("pose", POSE)
    u0, u1, share, ratio = (parts.datum(name) for name in ("u0", "u1", "share", "ratio"))
    course = parts.course(count)
    span = segment[1] - segment[0]
    place = between(ca.vertsplit(begin), ca.vertsplit(end), span * (u1 - u0), share)
    sight = _Sight(parts, place, pose, ratio)
    half = polynomial(course.half, segment[0] + (u0 + share * (u1 - u0)) * span)
    return parts.kind(f"clear{count}", [sight.gap - half], sight.lookup)


@cache
def wall_kind(count: int) -> BlockKind:
    """Row: the height of a node above a plane, less half a thickness; nothing is taken off where it emerges."""
    parts = _Parts()
    at, segment = parts.unknown("at", 2), parts.unknown("segment", 2)
    u, height, emerging = (parts.datum(name) for name in ("u", "height", "emerging"))
    n, course = parts.datum("normal", 2), parts.course(count)
    half = (1.0 - emerging) * polynomial(course.half, segment[0] + u * (segment[1] - segment[0]))
    return parts.kind(f"wall{count}", [n[0] * at[0] + n[1] * at[1] - height - half])


@cache
def bend_kind(count: int) -> BlockKind:
    """Row: curvature above rest at a node."""
    parts = _Parts()
    moment, pulls, segment = parts.unknown("moment"), parts.unknown("pulls", 2), parts.unknown("segment", 2)
    u, course = parts.datum("u"), parts.course(count)
    s = segment[0] + u * (segment[1] - segment[0])
    pulled = polynomial(course.tendon, s) * (pulls[0] - pulls[1])
    return parts.kind(f"bend{count}", [(moment + pulled) / polynomial(course.stiffness, s)])


@cache
def difference_kind() -> BlockKind:
    """Row: the second unknown less the first."""
    parts = _Parts()
    first, last = parts.unknown("first"), parts.unknown("last")
    return parts.kind("difference", [last - first])


@cache
def share_kind() -> BlockKind:
    """Row: an unknown times a number."""
    parts = _Parts()
    unknown, factor = parts.unknown("unknown"), parts.datum("factor")
    return parts.kind("share", [factor * unknown])


@cache
def chord_kind() -> BlockKind:
    """Row: a node is apart from the chord between two nodes of another finger: (d^2 - r^2) / (2 r), d the distance."""
    parts = _Parts()
    node, first, last = (parts.unknown(name, 2) for name in ("node", "first", "last"))
    ratio, reach = parts.datum("ratio"), parts.datum("reach")
    a, b = ratio * first, ratio * last
    along = b - a
    # 1e-12: no division by zero where a chord has no length
    share = ca.fmin(ca.fmax(ca.dot(node - a, along) / (ca.sumsqr(along) + 1e-12), 0.0), 1.0)
    away = node - a - share * along
    return parts.kind("chord", [(ca.sumsqr(away) - reach**2) / (2.0 * reach)])
