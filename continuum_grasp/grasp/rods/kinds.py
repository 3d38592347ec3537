"""Kinds of blocks of a grasp: one rows-function each, for all fingers, contacts and bodies, in the plane and in space.

Each finger has units of its own: its length L, the force E I / L^2, the moment E I / L. The object has its size and a
force F0. ``ratio`` is L per size, ``unit`` the finger's force per F0. At a contact, n is the outward normal of the
object and z a fixed direction across the finger, in the plane z itself; with a = z x n / |z x n| and b = n x a, the
object exerts N n + f a + g b on what touches it, and a moment tau n.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.rods.geometry import Geometry, cross, dot, exerted, transposed, turned
from continuum_grasp.grasp.rods.rod import THICKNESS, between, half_thickness, taper
from continuum_grasp.model import RodLoads, SectionForm, stage_end
from continuum_grasp.nlp import BlockKind, Lookup

HELD = 4
"""Numbers of a contact: N, f, g and the moment tau per arm."""


class _Parts:
    """Symbols of a block, taken one after the other."""

    def __init__(self, geometry: Geometry | None = None) -> None:
        self._geometry = geometry
        self._unknowns: list[ca.SX] = []
        self._data: list[ca.SX] = []

    def unknown(self, name: str, size: int = 1) -> Any:
        """Symbols of unknowns; a single one as a scalar."""
        return self._taken(self._unknowns, name, size)

    def datum(self, name: str, size: int = 1) -> Any:
        """Symbols of data; a single one as a scalar."""
        return self._taken(self._data, name, size)

    def acting(self, geometry: Geometry, form: SectionForm) -> RodLoads:
        """Force and pulls as unknowns, all else that acts on a finger as data."""
        return RodLoads(
            self.unknown("force", geometry.dimensions),
            ca.vertcat(self.unknown("pulls", len(form.pulls))),
            self.datum("gravity", geometry.dimensions),
            ca.vertcat(self.datum("history", len(form.history_names))),
            self.datum("numbers", form.size),
            self.datum("sides", geometry.sides),
        )

    @staticmethod
    def _taken(into: list[ca.SX], name: str, size: int) -> Any:
        into.append(ca.SX.sym(name, size))
        return into[-1][0] if size == 1 else into[-1]

    def kind(self, name: str, rows: Sequence[Any], lookup: Lookup | None = None) -> BlockKind:
        """The kind of these symbols."""
        name = name if self._geometry is None else f"{name}_{self._geometry.name}"
        data = ca.vertcat(*self._data) if self._data else ca.SX(0, 1)
        return BlockKind(name, ca.vertcat(*self._unknowns), data, ca.vertcat(*rows), lookup)


class _Sight:
    """The object as a place of a finger [L] sees it, by the body's table: gap [L] and outward normal (3,).

    The gap is exact to the given order of derivatives, the normal to one less.
    """

    def __init__(
        self, parts: _Parts, geometry: Geometry, place: Sequence[Any], pose: Any, ratio: Any, order: int
    ) -> None:
        d = geometry.dimensions
        self.axes, table = parts.datum("axes", geometry.axes), parts.datum("table", 2 * d + 2)
        self.turn = geometry.turn(pose, self.axes)
        self.place = [ratio * part for part in geometry.in_space(place)]  # [object size]
        self.center = geometry.place(pose)
        away = [a - b for a, b in zip(self.place, self.center, strict=True)]
        local = ca.vertcat(*turned(transposed(self.turn), away)[:d])
        series = _series(d, order)
        found = ca.SX.sym("found", series.size1_out(0))
        point, terms = found[:d], found[d:]
        shift = ca.SX.sym("shift", d)
        distance = _polynomial(shift, terms, order)
        known = [shift, terms]
        seen = ca.Function("seen", known, [distance, ca.gradient(distance, shift)])
        distance, gradient = seen(local - point, terms)
        # 1e-30: no division by zero where a table is flat
        along = gradient / ca.sqrt(ca.sumsqr(gradient) + 1e-30)
        self.gap = distance / ratio
        self.normal = turned(self.turn, geometry.in_space([along[k] for k in range(d)]))
        given = ca.vertcat(local, table)
        self.lookup = Lookup(DistanceTable.cell(local, table), table[d + 1], table[d + 2 :], given, series, found)


def _orders(dimensions: int, order: int) -> list[tuple[int, ...]]:
    """Directions of all derivatives up to an order, the lower ones first."""
    each = (itertools.combinations_with_replacement(range(dimensions), n) for n in range(order + 1))
    return list(itertools.chain(*each))


@cache
def _series(dimensions: int, order: int) -> ca.Function:
    """A point in a table, its distance and derivatives up to an order, by point and data, cell and coefficients."""
    given, cell = ca.SX.sym("given", 3 * dimensions + 2), ca.SX.sym("cell", dimensions)
    coefficients = ca.SX.sym("coefficients", 4**dimensions)
    point = ca.SX.sym("point", dimensions)
    distance = DistanceTable.distance(point, given[dimensions:], cell, coefficients)
    derivatives: dict[tuple[int, ...], ca.SX] = {(): distance}
    for directions in _orders(dimensions, order)[1:]:
        *before, last = directions
        derivatives[directions] = ca.jacobian(derivatives[tuple(before)], point[last])
    found = ca.substitute([ca.vertcat(point, *derivatives.values())], [point], [given[:dimensions]])
    return ca.Function("series", [given, cell, coefficients], found, {"cse": True})


def _polynomial(shift: ca.SX, terms: ca.SX, order: int) -> ca.SX:
    """Taylor polynomial by its derivatives."""
    value = ca.SX(0)
    for k, directions in enumerate(_orders(shift.numel(), order)):
        times = math.prod(math.factorial(directions.count(axis)) for axis in set(directions))
        value += terms[k] / times * math.prod(shift[axis] for axis in directions)
    return value


def states(geometry: Geometry, form: SectionForm) -> int:
    """Numbers of a node: the rod's own states, then its tendons' states."""
    return geometry.state + len(form.sliding_names)


@cache
def stage_kind(geometry: Geometry, form: SectionForm) -> BlockKind:
    """Rows (states): a stage ends where the rod leads from its begin."""
    parts = _Parts(geometry)
    size = states(geometry, form)
    begin, end = parts.unknown("begin", size), parts.unknown("end", size)
    acting, ends = parts.acting(geometry, form), parts.unknown("ends", 2)
    u0, u1 = parts.datum("u0"), parts.datum("u1")
    span = ends[1] - ends[0]
    places = ends[0] + u0 * span, ends[0] + u1 * span
    reached = stage_end(form, geometry, ca.vertsplit(begin), *places, acting, geometry.steps)
    return parts.kind(f"stage_{form.key}", [a - b for a, b in zip(reached, ca.vertsplit(end), strict=True)])


def led(stage: BlockKind, state: Array, acting: Array, data: ArrayLike) -> Array:
    """States (n, states) at the ends of stages of a kind one after the other, from the one at the begin of the first.

    ``acting`` are the unknowns of a stage beyond its states, ``data`` (n, stage.data) those of each.
    """
    given = np.asarray(data, dtype=float)
    return np.array(_leading(stage, len(given))(state, acting, given.T)).T


@cache
def _leading(stage: BlockKind, count: int) -> ca.Function:
    """States at the ends of so many stages."""
    acting, data = ca.MX.sym("acting", stage.unknowns - 2 * stage.count), ca.MX.sym("data", stage.data)
    state = ca.MX.sym("state", stage.count)
    # The row is where the stage leads less where it ends.
    end = stage.values(ca.vertcat(state, ca.MX.zeros(stage.count), acting), data, ca.MX(0, 1))
    one = ca.Function("led", [state, acting, data], [end])
    given = ca.MX.sym("given", stage.data, count)
    return ca.Function("leading", [state, acting, given], [one.mapaccum(count)(state, acting, given)])


@cache
def enter_kind(form: SectionForm) -> BlockKind:
    """Rows: the losses that tendons have where they enter the finger."""
    parts = _Parts()
    sliding = parts.unknown("sliding", len(form.sliding_names))
    history, numbers = ca.vertcat(parts.datum("history", len(form.history_names))), parts.datum("numbers", form.size)
    entries = ca.vertsplit(ca.vertcat(sliding))
    losses = [entry for entry, name in zip(entries, form.sliding_names, strict=True) if name.startswith("loss")]
    found = form.first_losses(entries, numbers, history)
    return parts.kind(f"enter_{form.key}", [a - b for a, b in zip(losses, found, strict=True)])


@cache
def contact_kind(geometry: Geometry, *, tip: bool) -> BlockKind:
    """Rows of a contact: the gap, its direction along the finger, the force and the moment beyond it, or at the tip,
    and the balance of the object (6). Forces have the weight of everything before; ``load`` is that of all at the tip,
    ``arms`` are those of the weight of a body there.
    """
    parts = _Parts(geometry)
    d, moments = geometry.dimensions, len(geometry.moments)
    at, force = parts.unknown("at", geometry.state), parts.unknown("force", d)
    after = [0.0] * d if tip else parts.unknown("after", d)
    turns = [0.0] * moments if tip else ca.vertsplit(ca.vertcat(parts.unknown("turns", moments)))
    s, held = parts.unknown("s"), parts.unknown("held", HELD)
    pose = parts.unknown("pose", geometry.pose)
    ratio, unit, arm = (parts.datum(name) for name in ("ratio", "unit", "arm"))
    load, center = parts.datum("load", d), parts.datum("center", 3)
    across, thickness = parts.datum("across", 3), parts.datum("thickness", THICKNESS)
    state = ca.vertsplit(at)
    weighing = _tip_couple(parts, geometry, state) if tip else [0.0] * moments
    sight = _Sight(parts, geometry, state[:d], pose, ratio, 3)
    half, n = half_thickness(thickness, s), sight.normal
    # Directions of the finger and of the surface are the same but for the finger's taper.
    direction = dot(geometry.in_space(geometry.tangent(state)), n) - taper(thickness, s)
    on_finger, twist = exerted(held, n, ca.vertsplit(across)), [arm * held[3] * part for part in n]
    couple = [part - half * other for part, other in zip(twist, cross(n, on_finger), strict=True)]
    rows = [sight.gap - half, direction]
    rows += [after[k] - force[k] + on_finger[k] + (load[k] if tip else 0.0) for k in range(d)]
    turning = zip(turns, (state[k] for k in geometry.moments), geometry.moment(couple), weighing, strict=True)
    rows += [last - first + own + other for last, first, own, other in turning]
    com = turned(sight.turn, ca.vertsplit(center))
    lever = [sight.place[k] - ratio * half * n[k] - sight.center[k] - com[k] for k in range(3)]
    rows += _on_object([unit * part for part in on_finger], lever, [unit * ratio * part for part in twist])
    return parts.kind("tip" if tip else "middle", rows, sight.lookup)


def _tip_couple(parts: _Parts, geometry: Geometry, state: Sequence[Any]) -> list[Any]:
    """Moment of the weight of a body fastened to the tip, by its mass times where its center is."""
    arms, gravity = parts.datum("arms", 2), parts.datum("tip gravity", geometry.dimensions)
    axes = zip(geometry.across(state), geometry.tangent(state), strict=True)
    arm = geometry.in_space([arms[0] * across + arms[1] * along for across, along in axes])
    return geometry.moment(cross(arm, geometry.in_space(ca.vertsplit(gravity))))


def _on_object(force: Sequence[Any], lever: Sequence[Any], twist: Sequence[Any]) -> list[Any]:
    """Force and moment (6) on the object, by the force and the moment that it exerts."""
    moment = cross(lever, force)
    return [*(-part for part in force), *(-moment[k] - twist[k] for k in range(3))]


@cache
def support_kind(geometry: Geometry) -> BlockKind:
    """Rows (6): the force of a flat support on the object, which touches it with a ball about a point."""
    parts = _Parts(geometry)
    held, pose = parts.unknown("held", HELD), parts.unknown("pose", geometry.pose)
    n, point, radius = parts.datum("normal", 3), parts.datum("point", 3), parts.datum("radius")
    across, center, axes = parts.datum("across", 3), parts.datum("center", 3), parts.datum("axes", geometry.axes)
    force = exerted(held, n := ca.vertsplit(n), ca.vertsplit(across))
    arm = turned(geometry.turn(pose, axes), ca.vertsplit(point - center))
    lever = [a + radius * b for a, b in zip(arm, n, strict=True)]
    return parts.kind("support", _on_object(force, lever, [0.0] * 3))


@cache
def rest_kind(geometry: Geometry) -> BlockKind:
    """Row: the gap between a flat support and a ball about a point of the object."""
    parts = _Parts(geometry)
    pose = parts.unknown("pose", geometry.pose)
    n, point, radius = parts.datum("normal", 3), parts.datum("point", 3), parts.datum("radius")
    level, axes = parts.datum("level"), parts.datum("axes", geometry.axes)
    arm = turned(geometry.turn(pose, axes), ca.vertsplit(point))
    place = [a + b for a, b in zip(geometry.place(pose), arm, strict=True)]
    return parts.kind("rest", [level - dot(ca.vertsplit(n), place) - radius])


@cache
def peg_kind(geometry: Geometry) -> BlockKind:
    """Rows (6): the force of a round peg on the object."""
    parts = _Parts(geometry)
    held, pose = parts.unknown("held", HELD), parts.unknown("pose", geometry.pose)
    position, radius = parts.datum("position", geometry.dimensions), parts.datum("radius")
    sight = _Sight(parts, geometry, ca.vertsplit(position), pose, 1.0, 3)
    center, across = parts.datum("center", 3), parts.datum("across", 3)
    com = turned(sight.turn, ca.vertsplit(center))
    lever = [sight.place[k] - radius * sight.normal[k] - sight.center[k] - com[k] for k in range(3)]
    force = exerted(held, sight.normal, ca.vertsplit(across))
    return parts.kind("peg", _on_object(force, lever, [0.0] * 3), sight.lookup)


@cache
def peg_gap_kind(geometry: Geometry) -> BlockKind:
    """Row: the gap between a round peg and the object."""
    parts = _Parts(geometry)
    pose = parts.unknown("pose", geometry.pose)
    position, radius = parts.datum("position", geometry.dimensions), parts.datum("radius")
    sight = _Sight(parts, geometry, ca.vertsplit(position), pose, 1.0, 2)
    return parts.kind("peg_gap", [sight.gap - radius], sight.lookup)


@cache
def slip_kind(geometry: Geometry, form: SectionForm, *, tip: bool) -> BlockKind:
    """Rows of a contact (4): shift and turn of the finger's material there past the object's, to first order.

    The shift is along n, a and b [L], the turn about n. Where a contact jumps in curvature, the mean of both sides
    counts. ``moved``, ``along`` and ``shifted`` are the changes of the node, of its place and of the pose.
    """
    parts = _Parts(geometry)
    d, oriented = geometry.dimensions, geometry.oriented
    at = ca.vertsplit(parts.unknown("at", states(geometry, form)))
    turns = [] if tip else ca.vertsplit(ca.vertcat(parts.unknown("turns", len(geometry.moments))))
    acting, s = parts.acting(geometry, form), parts.unknown("s")
    pose, moved = parts.unknown("pose", geometry.pose), parts.unknown("moved", oriented)
    along, shifted = parts.unknown("along"), parts.unknown("shifted", geometry.pose)
    ratio, across, thickness = parts.datum("ratio"), parts.datum("across", 3), parts.datum("thickness", THICKNESS)
    sight = _Sight(parts, geometry, at[:d], pose, ratio, 3)
    before, sliding = at[: geometry.state], at[geometry.state :]
    sides = [
        _rates(geometry, form, acting, s, own, sliding) for own in (before, [*before[:oriented], *turns])[: 2 - tip]
    ]
    # The node moves along the finger with the contact, its material does not.
    material = [moved[k] - along * sum(rates[k] for rates in sides) / len(sides) for k in range(oriented)]
    turn, own_turn = geometry.section_turn(before, material), geometry.object_turn(pose, shifted)
    n, half = sight.normal, half_thickness(thickness, s)
    skin = [a - half * b for a, b in zip(geometry.in_space(material[:d]), cross(turn, n), strict=True)]
    arm = [a - ratio * half * b - c for a, b, c in zip(sight.place, n, sight.center, strict=True)]
    surface = zip(geometry.place(shifted), cross(own_turn, arm), strict=True)
    apart = [a - (b + c) / ratio for a, (b, c) in zip(skin, surface, strict=True)]
    beside = exerted([0.0, 1.0, 0.0], n, ca.vertsplit(across))
    rows = [dot(n, apart), dot(beside, apart), dot(cross(n, beside), apart), dot(n, turn) - dot(n, own_turn)]
    return parts.kind(f"slip_{'tip' if tip else 'middle'}_{form.key}", rows, sight.lookup)


def _rates(
    geometry: Geometry, form: SectionForm, acting: RodLoads, s: ca.SX, own: Sequence[Any], sliding: Sequence[Any]
) -> Sequence[Any]:
    """Derivatives of a finger's own states along it at a place; derivatives of moments are not used."""
    _, total = form.curvature(s, geometry.bending(own), acting.pulls, sliding, acting.numbers, acting.history)
    stiffness = form.at(s, acting.numbers).stiffness
    return geometry.rates(own, ca.vertsplit(ca.vertcat(acting.force)), total, stiffness, ca.vertsplit(acting.sides))


@cache
def rate_kind(geometry: Geometry, form: SectionForm) -> BlockKind:
    """Rows (oriented): derivatives of place and direction along the finger at a node."""
    parts = _Parts(geometry)
    at, acting = ca.vertsplit(parts.unknown("at", states(geometry, form))), parts.acting(geometry, form)
    ends, u = parts.unknown("ends", 2), parts.datum("u")
    s = ends[0] + u * (ends[1] - ends[0])
    rates = _rates(geometry, form, acting, s, at[: geometry.state], at[geometry.state :])
    return parts.kind(f"rate_{form.key}", rates[: geometry.oriented])


@cache
def support_slip_kind(geometry: Geometry) -> BlockKind:
    """Rows of a support, to first order: shift of the object there along n, a and b (3), and the moment on the object
    as its center of mass shifts and the contact rolls (3). ``rolls`` is the way of the contact per turn, a tensor.
    """
    parts = _Parts(geometry)
    held, pose = parts.unknown("held", HELD), parts.unknown("pose", geometry.pose)
    shifted = parts.unknown("shifted", geometry.pose)
    arm, n, across = (ca.vertsplit(parts.datum(name, 3)) for name in ("arm", "normal", "across"))
    center, rolls = ca.vertsplit(parts.datum("center", 3)), parts.datum("rolls", 9)
    axes = parts.datum("axes", geometry.axes)
    turn = geometry.object_turn(pose, shifted)
    com = cross(turn, turned(geometry.turn(pose, axes), center))
    com = [a + b for a, b in zip(geometry.place(shifted), com, strict=True)]
    moved = [a + b for a, b in zip(com, cross(turn, arm), strict=True)]
    rolled = turned([[rolls[3 * i + j] for j in range(3)] for i in range(3)], cross(n, turn))
    lever = [a - b for a, b in zip(rolled, com, strict=True)]
    beside = exerted([0.0, 1.0, 0.0], n, across)
    rows = [dot(n, moved), dot(beside, moved), dot(cross(n, beside), moved)]
    return parts.kind("support_slip", [*rows, *(-part for part in cross(lever, exerted(held, n, across)))])


@cache
def free_tip_kind(geometry: Geometry) -> BlockKind:
    """Rows: at a tip that touches nothing, force and moment come from the weight there."""
    parts = _Parts(geometry)
    d = geometry.dimensions
    at, force = ca.vertsplit(parts.unknown("at", geometry.state)), parts.unknown("force", d)
    load = parts.datum("load", d)
    moments = zip((at[k] for k in geometry.moments), _tip_couple(parts, geometry, at), strict=True)
    return parts.kind("free_tip", [*(load[k] - force[k] for k in range(d)), *(own - other for own, other in moments)])


@cache
def cone_kind(*, spatial: bool) -> BlockKind:
    """Rows: Coulomb friction of a contact, of which a margin v stays free; without forces across, it is two lines."""
    parts = _Parts()
    held, margin = parts.unknown("held", HELD), parts.unknown("margin")
    friction, apex = parts.datum("friction"), parts.datum("apex")
    most = friction * (1.0 - margin) * held[0]
    if spatial:
        return parts.kind("cone", [most - ca.sqrt(ca.sumsqr(held[1:]) + apex**2)])
    return parts.kind("wedge", [most - held[1], most + held[1]])


@cache
def pushed_kind(directions: int) -> BlockKind:
    """Rows: a contact is within its cone for changes of its force in every direction of a push.

    The normal force less, and with, what the push changes of it; then f' S f - e - sum l^2 over the last row of L; then
    L L' less the rest of the matrix. With S = diag(mu^2, -1, -1, -1), load f and changes G (4, directions), all
    f + G d, |d| <= 1, are within the cone if some e >= 0 and lower triangular L make

        [ G' S G + e 1    G' S f     ]
        [ f' S G          f' S f - e ]  =  L L',

    that is, positive semidefinite (`continuum_grasp.grasp.certificate.push`). The last entry of L is a bound. Pivots in
    place of L would not do: the last one has the sign of a fraction where another one is zero.
    """
    parts, size = _Parts(), directions + 1
    held, changes = parts.unknown("held", HELD), parts.unknown("changes", HELD * directions)
    spare, entries = parts.unknown("spare"), parts.unknown("factor", size * (size + 1) // 2 - 1)
    friction = parts.datum("friction")
    slope = ca.reshape(changes, HELD, directions)
    whole = ca.horzcat(slope, held)
    form = ca.diag(ca.vertcat(friction**2, *[-1.0] * (HELD - 1)))
    matrix = whole.T @ form @ whole + ca.diag(ca.vertcat(*[spare] * directions, -spare))
    places = [(i, j) for i in range(size) for j in range(i + 1)]
    factor = ca.SX(size, size)
    for k, place in enumerate(places[:-1]):
        factor[place] = entries[k]
    square = factor @ factor.T
    # 1e-24: keeps the root differentiable where nothing changes
    opening = ca.sqrt(ca.sumsqr(slope[0, :]) + 1e-24)
    left = [square[place] - matrix[place] for place in places]
    return parts.kind(f"pushed_{directions}", [held[0] - opening, held[0] + opening, -left[-1], *left[:-1]])


@cache
def moved_object_kind(geometry: Geometry) -> BlockKind:
    """Rows: shift of the object's center of mass and turn of the object by a small change of its pose."""
    parts = _Parts(geometry)
    pose, shifted = parts.unknown("pose", geometry.pose), parts.unknown("shifted", geometry.pose)
    center, axes = ca.vertsplit(parts.datum("center", 3)), parts.datum("axes", geometry.axes)
    turn = geometry.object_turn(pose, shifted)
    arm = turned(geometry.turn(pose, axes), center)
    shift = [a + b for a, b in zip(geometry.place(shifted), cross(turn, arm), strict=True)]
    return parts.kind("moved_object", [*shift[: geometry.dimensions], *geometry.moment(turn)])


@cache
def square_kind(size: int) -> BlockKind:
    """Rows (lower triangle of size): L L' of a lower triangular L, twice beside the diagonal, plus a number each."""
    parts, places = _Parts(), [(i, j) for i in range(size) for j in range(i + 1)]
    entries, more = parts.unknown("factor", len(places)), parts.datum("more", len(places))
    factor = ca.SX(size, size)
    for k, place in enumerate(places):
        factor[place] = entries[k]
    square = factor @ factor.T
    rows = [(1.0 if i == j else 2.0) * square[i, j] + more[k] for k, (i, j) in enumerate(places)]
    return parts.kind(f"square_{size}", rows)


@cache
def moved_kind(*, spatial: bool) -> BlockKind:
    """Rows: normal force of a contact after a change, and what its friction cone, or both lines of it, leave then."""
    parts = _Parts()
    held, change = parts.unknown("held", HELD), parts.unknown("change", HELD)
    friction, apex = parts.datum("friction"), parts.datum("apex")
    now = held + change
    if not spatial:
        return parts.kind("moved_wedge", [now[0], friction * now[0] - now[1], friction * now[0] + now[1]])
    return parts.kind("moved", [now[0], friction * now[0] - ca.sqrt(ca.sumsqr(now[1:]) + apex**2)])


@cache
def sum_kind() -> BlockKind:
    """Row: the sum of two unknowns."""
    parts = _Parts()
    first, last = parts.unknown("first"), parts.unknown("last")
    return parts.kind("sum", [first + last])


@cache
def clear_kind(geometry: Geometry) -> BlockKind:
    """Row: the gap between the object and a place of a stage, by the cubic through its ends, less half a thickness."""
    parts = _Parts(geometry)
    begin, end = parts.unknown("begin", geometry.oriented), parts.unknown("end", geometry.oriented)
    ends, pose = parts.unknown("ends", 2), parts.unknown("pose", geometry.pose)
    u0, u1, share, ratio = (parts.datum(name) for name in ("u0", "u1", "share", "ratio"))
    thickness = parts.datum("thickness", THICKNESS)
    span = ends[1] - ends[0]
    place = between(geometry, ca.vertsplit(begin), ca.vertsplit(end), span * (u1 - u0), share)
    sight = _Sight(parts, geometry, place, pose, ratio, 2)
    half = half_thickness(thickness, ends[0] + (u0 + share * (u1 - u0)) * span)
    return parts.kind("clear", [sight.gap - half], sight.lookup)


def _beside(parts: _Parts, geometry: Geometry) -> tuple[Any, Any]:
    """Place of a stage (dimensions,), and its clearance: half a thickness, or a height if it emerges."""
    begin, end = parts.unknown("begin", geometry.oriented), parts.unknown("end", geometry.oriented)
    ends = parts.unknown("ends", 2)
    u0, u1, share = (parts.datum(name) for name in ("u0", "u1", "share"))
    emerging, height, thickness = parts.datum("emerging"), parts.datum("height"), parts.datum("thickness", THICKNESS)
    span = ends[1] - ends[0]
    place = between(geometry, ca.vertsplit(begin), ca.vertsplit(end), span * (u1 - u0), share)
    half = half_thickness(thickness, ends[0] + (u0 + share * (u1 - u0)) * span)
    return ca.vertcat(*place), (1.0 - emerging) * half + emerging * height


@cache
def wall_kind(geometry: Geometry) -> BlockKind:
    """Row: the height of a place of a stage above a plane, less its clearance."""
    parts = _Parts(geometry)
    place, clear = _beside(parts, geometry)
    n, level = parts.datum("normal", geometry.dimensions), parts.datum("level")
    return parts.kind("wall", [ca.dot(n, place) - level - clear])


@cache
def post_kind(geometry: Geometry) -> BlockKind:
    """Row: the distance of a place of a stage from a segment with a radius, less its clearance."""
    parts = _Parts(geometry)
    place, clear = _beside(parts, geometry)
    first, last = (parts.datum(name, geometry.dimensions) for name in ("first", "last"))
    away = _from_chord(place, first, last)
    # 1e-16: a distance with derivatives everywhere
    return parts.kind("post", [ca.sqrt(ca.sumsqr(away) + 1e-16) - parts.datum("radius") - clear])


def _from_chord(place: Any, first: Any, last: Any) -> Any:
    """Way (dimensions,) to a place from the nearest point of a chord."""
    along = last - first
    # 1e-12: no division by zero where a chord has no length
    share = ca.fmin(ca.fmax(ca.dot(place - first, along) / (ca.sumsqr(along) + 1e-12), 0.0), 1.0)
    return place - first - share * along


@cache
def bend_kind(geometry: Geometry, form: SectionForm) -> BlockKind:
    """Row: curvature above rest at a node, times half the depth of the section per its greatest."""
    parts = _Parts(geometry)
    at, acting = parts.unknown("at", states(geometry, form)), parts.acting(geometry, form)
    ends, u, depth = parts.unknown("ends", 2), parts.datum("u"), parts.datum("depth", THICKNESS)
    state = ca.vertsplit(at)
    own, sliding = state[: geometry.state], state[geometry.state :]
    s = ends[0] + u * (ends[1] - ends[0])
    bend, _ = form.curvature(s, geometry.bending(own), acting.pulls, sliding, acting.numbers, acting.history)
    return parts.kind(f"bend_{form.key}", [bend * half_thickness(depth, s)])


@cache
def landing_kind(geometry: Geometry) -> BlockKind:
    """Rows (dimensions - 1): along its surface, an object is touched where a tip landed on it.

    Without errors, the object has the pose ``landed`` less the error ``off``. The tip touches the object
    at the same spot in both grasps: the object was displaced before it yielded to the tip.
    """
    parts = _Parts(geometry)
    d = geometry.dimensions
    at, pose = parts.unknown("at", d), parts.unknown("pose", geometry.pose)
    first, landed = parts.unknown("first", d), parts.unknown("landed", geometry.pose)
    ratio, off, across = parts.datum("ratio"), parts.datum("off", geometry.pose), parts.datum("across", 3)
    sight = _Sight(parts, geometry, ca.vertsplit(at), pose, ratio, 3)
    before = ca.vertsplit(landed + off)
    center, turn = geometry.place(before), geometry.turn(before, sight.axes)
    place = geometry.in_space([ratio * part for part in ca.vertsplit(first)])
    own = turned(transposed(turn), [a - b for a, b in zip(place, center, strict=True)])
    moved = zip(sight.place, sight.center, turned(sight.turn, own), strict=True)
    away = [place - center - part for place, center, part in moved]
    a = cross(ca.vertsplit(across), sight.normal)
    along = [dot(a, away), dot(cross(sight.normal, a), away)]
    return parts.kind("landing", along[: d - 1], sight.lookup)


@cache
def difference_kind() -> BlockKind:
    """Row: the second unknown less the first."""
    parts = _Parts()
    first, last = parts.unknown("first"), parts.unknown("last")
    return parts.kind("difference", [last - first])


@cache
def share_kind() -> BlockKind:
    """Row: an unknown times a number."""
    unknown, factor = ca.SX.sym("unknown"), ca.SX.sym("factor")
    return BlockKind("share", unknown, factor, factor * unknown)


@cache
def chord_kind(geometry: Geometry) -> BlockKind:
    """Row: a node is apart from the chord between two nodes of another finger: (d^2 - r^2) / (2 r), d the distance."""
    parts = _Parts(geometry)
    node, first, last = (parts.unknown(name, geometry.dimensions) for name in ("node", "first", "last"))
    ratio, reach = parts.datum("ratio"), parts.datum("reach")
    away = _from_chord(node, ratio * first, ratio * last)
    return parts.kind("chord", [(ca.sumsqr(away) - reach**2) / (2.0 * reach)])
