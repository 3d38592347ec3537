"""The map of one finger: its equilibria that touch, within its own limits, sampled so that no cell of them is missed.

Seeds are all rods of a grid of curvatures and forces at the base, between neighbors of which a gap closes. From seeds
the set is filled by steps along it, each of about a cell, until no cell is new. Cells differ by tension, use of
friction and places: by places alone the set of possible rods is thinner than a cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.finger_map.jets import Jet
from continuum_grasp.grasp.finger_map.rod import FORCE, MapFinger, Touches, Traced

PLACE, TENSION, FRICTION, TURN, NORMAL = 0.06, 0.06, 0.4, 0.5, 0.8
"""Size of a cell: places per length of the finger, tension per its greatest, friction per normal force and coefficient,
angle of the tip [rad], normal forces, by their logarithm where they are large."""
LIGHT = 3.0
"""Normal force [E I / L^2] up to which its changes count, and not changes of its logarithm."""
ENTERED = 0.005
"""Depth in obstacles [L] that samples may have: samples are coarser than the rods that start from them."""
ONTO = 40
"""Steps in which seeds are brought onto the set: of three fingers that wrap a jar, with 20 steps none leads to the part
of the set with the least tension."""
ON_SET = 1e-3
"""Residual up to which an equilibrium touches, in lengths and forces of the finger."""
WITHIN = 0.01
"""Excess over limits that a sample may have, in lengths and forces of the finger."""
CURLED = 14.0
"""Greatest curvature at the base of the rods between which seeds are sought [1/L]: more than two turns per length."""
FAR = 0.25
"""Distance [L] from which on two minima of the gap along rods next to each other are not the same."""
COARSE = 3.0
"""Cells of a map that are one where it is a seed of another."""
MOST = 3000
"""Samples from which on a map is not filled further."""


def _use(finger: MapFinger, touches: Touches) -> tuple[Array, Array]:
    """Friction per normal force and coefficient (B, C), and normal forces that are not zero."""
    normal, along = (force.value for force in touches.force)
    # 0.05: normal force [E I / L^2] that is as good as none
    size = np.abs(normal) + 0.05
    return along * _per_friction(finger) / size, size


def _per_friction(finger: MapFinger) -> float:
    """Inverse of the coefficient of friction; 0 where that is so small that its use makes no difference."""
    return 1.0 / finger.friction if finger.friction > WITHIN else 0.0


def features(at: Traced) -> Array:
    """Cells (B, F), as fractions."""
    finger, touches = at.finger, at.touches
    used = finger.middles + finger.tip
    columns = [at.pull.value[:, None] / TENSION, *(place.value / PLACE for place in touches.place)]
    columns.append(np.clip(_use(finger, touches)[0][:, :used], -2.0, 2.0) / FRICTION)
    columns.append(np.arcsinh(touches.force[0].value[:, :used] / LIGHT) / NORMAL)
    if finger.tip:
        nx, ny = (part.value[:, -1:] for part in touches.normal)
        # Relative to the base, which may be turned.
        turned = np.exp(-1j * finger.base[2]) * (nx + 1j * ny)
        columns.append(np.angle(turned) / TURN)
    return np.concatenate(columns, axis=1)


def _feature_slopes(at: Traced) -> Array:
    """Slopes (B, F, n) of the cells."""
    finger, touches = at.finger, at.touches
    used = finger.middles + finger.tip
    rows = [at.pull.beside() * (1.0 / TENSION), *(place * (1.0 / PLACE) for place in touches.place)]
    share, size = _use(finger, touches)
    normal, along = touches.force
    turned = (share * finger.friction * np.sign(normal.value))[..., None] * normal.slope
    slope = (along.slope - turned) / size[..., None] * (_per_friction(finger) / FRICTION)
    slope = np.where((np.abs(share) < 2.0)[..., None], slope, 0.0)
    rows.append(Jet(share[:, :used], slope[:, :used]))
    steep = NORMAL * np.hypot(normal.value, LIGHT)
    rows.append(Jet(normal.value[:, :used], (normal.slope / steep[..., None])[:, :used]))
    if finger.tip:
        nx, ny = (Jet(part.value[:, -1:], part.slope[:, -1:]) for part in touches.normal)
        turn = nx.value[..., None] * ny.slope - ny.value[..., None] * nx.slope
        rows.append(Jet(nx.value, turn / TURN))
    return rows[0].followed_by(*rows[1:]).slope


@dataclass(frozen=True)
class FingerMap:
    """The equilibria of a finger that touch."""

    finger: MapFinger
    samples: Traced

    def __len__(self) -> int:
        return len(self.samples)

    @staticmethod
    def of(finger: MapFinger) -> FingerMap:
        """Sample a finger's equilibria."""
        seeds = _onto(finger, _seeds(finger), finger.sampling.seeds, finger.sampling.enough)
        none = finger.traced(np.zeros((0, finger.numbers)))
        return FingerMap(finger, _filled(finger, seeds) if len(seeds) else none)


def _grid(finger: MapFinger) -> tuple[tuple[int, int, int], Array]:
    """Rods of a grid of curvature at the base and force there (N, n), without middle contacts."""
    curvature_count, direction_count, force_count = finger.sampling.grid if finger.middles else finger.sampling.of_tips
    strongest = finger.greatest_force * math.hypot(1.0, finger.friction) * (1 + finger.middles)
    # 0.12: arm [L] at which the tendons' greatest moment is a force
    strongest = min(strongest, 2.5 * finger.greatest_moment / 0.12)
    curvatures = np.linspace(-CURLED, CURLED, curvature_count)
    # From the base, so that a scene that is turned has the same rods.
    directions = finger.base[2] + (np.arange(direction_count) + 0.5) * (math.tau / direction_count)
    sizes = np.append(0.0, np.geomspace(min(0.05, 0.5 * strongest), strongest, force_count - 1))
    bent, turn, size = np.meshgrid(curvatures, directions, sizes, indexing="ij")
    z = np.stack([bent, size * np.cos(turn), size * np.sin(turn), np.zeros(bent.shape)], axis=-1)
    return bent.shape, z.reshape(-1, 4)


def _edges(shape: tuple[int, ...], value: Array, around: int | None = None) -> Array:
    """Pairs of neighbors of a grid between which a value changes its sign; one axis may close on itself."""
    index = np.arange(value.size).reshape(shape)
    pairs = []
    for axis in range(len(shape)):
        after = np.roll(index, -1, axis) if axis == around else np.take(index, range(1, shape[axis]), axis)
        before = index if axis == around else np.take(index, range(shape[axis] - 1), axis)
        changes = (value[before] > 0.0) != (value[after] > 0.0)
        pairs.append(np.stack([before[changes], after[changes]], axis=1))
    return np.concatenate(pairs)


def _between(a: Array, b: Array, at_a: Array, at_b: Array) -> Array:
    """Points at which values that are linear from a to b vanish."""
    share = at_a / (at_a - at_b + 1e-300)
    return np.asarray(a + share.reshape(-1, *[1] * (a.ndim - 1)) * (b - a))


def _seeds(finger: MapFinger) -> Array:
    """Rods that nearly touch (N, n)."""
    plain = finger.with_middles(0)
    shape, z = _grid(finger)
    if not finger.middles:
        gap = plain.touches(z).conditions.value[:, -1]
        first, second = _edges(shape, gap, around=1).T
        return _between(z[first], z[second], gap[first], gap[second])
    seeds = z
    for contact in range(finger.middles):
        before = plain if contact == 0 else finger.with_middles(contact)
        seeds = _with_middle(before, seeds, shape if contact == 0 else None)
        # of these, drawn evenly
        lows = min(len(seeds), finger.sampling.lows)
        seeds = seeds[np.linspace(0, len(seeds) - 1, lows).astype(int)] if len(seeds) else seeds
        finger_here = finger.with_middles(contact + 1)
        seeds = _with_forces(finger_here, seeds)
        if not len(seeds):
            break
    return seeds


def _with_middle(finger: MapFinger, z: Array, shape: tuple[int, ...] | None) -> Array:
    """Rods on to one more middle contact without force, where a minimum of the gap closes (N, n + 3)."""
    out = finger.nearest(z)
    found = []
    for at, gap in ((out[:, 0], out[:, 1]), (out[:, 2], out[:, 3])):
        if shape is None:
            rows = np.flatnonzero(np.abs(gap) < 0.5 * PLACE)
            found.append(np.column_stack([z[rows], at[rows]]))
            continue
        pairs = _edges(shape, gap, around=1)
        first, second = pairs.T
        # Where minima change places there is no contact.
        near = (gap[first] < 9.0) & (gap[second] < 9.0) & (np.abs(at[first] - at[second]) < FAR)
        first, second = first[near], second[near]
        ends = np.column_stack([z, at])
        found.append(_between(ends[first], ends[second], gap[first], gap[second]))
    rows = np.concatenate(found)
    if len(rows):
        # Before a corner the minimum is not where it is on a line between neighbors.
        places = finger.nearest(rows[:, :-1])[:, ::2]
        off = np.where(places < 0.0, np.inf, np.abs(places - rows[:, -1:]))
        closest = off.argmin(axis=1)[:, None]
        rows[:, -1:] = np.where(
            off.min(axis=1, keepdims=True) < FAR, np.take_along_axis(places, closest, 1), rows[:, -1:]
        )
    return np.column_stack([rows, np.zeros((len(rows), 2))])


def _with_forces(finger: MapFinger, z: Array) -> Array:
    """Rods whose last middle contact bears a force such that the tip touches, or is free (N, n)."""
    if not len(z):
        return z
    if not finger.tip:
        touches = finger.touches(z).touches
        # The remainder at the tip is the contact's.
        force, normal = (pair[0].value + 1j * pair[1].value for pair in (touches.force, touches.normal))
        left = force[:, -1] * normal[:, -1] * np.conj(normal[:, -2])
        z = z.copy()
        z[:, -2], z[:, -1] = left.real, left.imag
        return z
    normals, shares = 8, 5
    most = min(finger.greatest_force, 2.5 * finger.greatest_moment / 0.12)
    sizes = np.append(0.0, np.geomspace(min(0.1, 0.5 * most), most, normals - 1))
    uses = np.linspace(-finger.friction, finger.friction, shares)
    each = np.repeat(z[:, None, None], normals, axis=1).repeat(shares, axis=2)
    each[..., -2] = sizes[None, :, None]
    each[..., -1] = sizes[None, :, None] * uses[None, None]
    flat = each.reshape(-1, z.shape[1])
    gap = finger.touches(flat).conditions.value[:, -1]
    index = np.arange(len(flat)).reshape(len(z), normals, shares)
    pairs = []
    for a, b in ((index[:, :-1], index[:, 1:]), (index[:, :, :-1], index[:, :, 1:])):
        changes = (gap[a] > 0.0) != (gap[b] > 0.0)
        pairs.append(np.stack([a[changes], b[changes]], axis=1))
    first, second = np.concatenate(pairs).T
    return _between(flat[first], flat[second], gap[first], gap[second])


def _onto(finger: MapFinger, z: Array, count: int, enough: int) -> Array:
    """So many seeds that are nearest to the set within the limits, brought onto it; all others too where not enough of
    them arrive.
    """
    if not len(z):
        return np.zeros((0, finger.numbers))
    z = z.copy()
    z[:, 3] = finger.with_middles(finger.middles).touches(z).conditions.value[:, 0] / FORCE
    at = finger.traced(z, slopes=False, entered=ENTERED)
    order = np.argsort(np.maximum(np.abs(at.conditions.value).max(axis=1), at.excess), kind="stable")
    # The nearest of each few cells: else one part of the set crowds out others.
    cells = np.round(features(at)[order] / COARSE)
    near = z[order[np.sort(np.unique(cells, axis=0, return_index=True)[1])]]
    first = finger.onto(near[:count], ONTO, ENTERED, ON_SET)
    if len(first) >= enough:
        return first
    return np.concatenate([first, finger.onto(near[count:], ONTO, ENTERED, ON_SET)])


def _filled(finger: MapFinger, seeds: Array) -> Traced:
    """All equilibria, one per cell, that steps of a cell along the set reach from the seeds."""
    known = set[bytes]()
    directions = _directions(finger.numbers - finger.conditions)

    def unknown(place: Array) -> NDArray[np.bool_]:
        return np.array([key not in known for key in _keys(place)], bool)

    def fresh(place: Array) -> NDArray[np.int64]:
        """Rows in cells that are new, one of each, which are known from now on."""
        rows = _one_per_cell(place)
        rows = rows[unknown(place[rows])]
        known.update(_keys(place[rows]))
        return rows

    seeded = finger.traced(seeds)
    front = seeded.take(fresh(features(seeded)))
    found = [front]
    while len(front) and len(known) < MOST:
        near = finger.touches(_neighbors(finger, front, directions))
        near = near.take(np.abs(near.conditions.value).max(axis=1) < ON_SET)
        place = features(near)
        new = unknown(place)
        z, place = near.z[new], place[new]
        # Most are beyond the limits or in one cell: only what is left needs slopes.
        within = finger.traced(z, slopes=False, entered=ENTERED).excess < WITHIN
        z, place = z[within], place[within]
        front = finger.traced(z[fresh(place)])
        found.append(front)
    return Traced.joined(found)


def _one_per_cell(place: Array, size: float = 1.0) -> NDArray[np.int64]:
    """Rows of features that are nearest to the middles of their cells, so that images of a scene have the same."""
    place = place / size
    cells = np.round(place)
    order = np.argsort(np.round(np.abs(place - cells).max(axis=1), 6), kind="stable")
    first = dict[bytes, int]()
    for row, key in zip(order.tolist(), _keys(cells[order]), strict=True):
        first.setdefault(key, row)
    return np.array([*first.values()], np.int64)


def _keys(place: Array) -> list[bytes]:
    """Keys of the cells of features (B, F)."""
    cells = np.round(place).astype(np.int32)
    size = cells.shape[1] * cells.itemsize
    whole = cells.tobytes()
    return [whole[at : at + size] for at in range(0, len(whole), size)]


def _directions(size: int) -> Array:
    """Unit vectors (D, size), spread evenly and the same for all cells: both ways of axes and diagonals of a plane, in
    more dimensions of the corners of a simplex.
    """
    if size == 2:
        half = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
    else:
        # The axes of one dimension more, seen along their sum.
        half = np.linalg.svd(np.eye(size + 1) - 1.0 / (size + 1))[0][:, :size]
    half = half / np.linalg.norm(half, axis=1)[:, None]
    return np.concatenate([half, -half])


def _neighbors(finger: MapFinger, front: Traced, directions: Array) -> Array:
    """Equilibria about a cell away from others, along the set (N, n)."""
    z = front.z
    steps = finger.scales(front.z)
    slope = front.conditions.slope * steps[:, None]
    count = slope.shape[1]
    left, size, across = np.linalg.svd(slope)
    null = across[:, count:].transpose(0, 2, 1)  # (B, n, d)
    back = (
        across[:, :count].transpose(0, 2, 1) / np.maximum(size, 1e-15 * size[:, :1])[:, None] @ left.transpose(0, 2, 1)
    )
    measured = _feature_slopes(front) * steps[:, None] @ null
    metric = measured.transpose(0, 2, 1) @ measured + 1e-4 * np.eye(null.shape[2])
    sizes, axes = np.linalg.eigh(metric)
    ways = null @ (axes / np.sqrt(sizes)[:, None])  # of one cell each
    move = np.einsum("bij,cj->cbi", ways, directions)
    move *= np.minimum(1.0, 3.0 / np.maximum(np.abs(move).max(axis=2, keepdims=True), 1e-12))
    out = (z[None] + move * steps[None]).reshape(-1, z.shape[1])
    # 3: corrections by the slopes of where the step began
    return finger.corrected(out, 3, np.tile(back, (len(directions), 1, 1)), np.tile(steps, (len(directions), 1)))
