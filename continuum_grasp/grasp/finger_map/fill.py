"""The map of one finger: its equilibria that touch, within its own limits, sampled so that no cell of them is missed.

Seeds are all rods of a grid of curvatures and forces at the base, between neighbors of which a gap closes. From those
the set is filled by steps along it, each of about a cell, until no cell is new. Cells differ by tension, use of
friction and places: by places alone the set of what is possible is thinner than a cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.finger_map.jets import Jet
from continuum_grasp.grasp.finger_map.rod import MapFinger, RodContact, Traced

PLACE, TENSION, FRICTION, TURN = 0.06, 0.06, 0.4, 0.5
"""Size of a cell: places per length of the finger, tension per its greatest, friction per normal force and coefficient,
angle of the tip [rad]."""
ENTERED, LOOSE = 0.005, 1.25
"""Depth in obstacles [L] that samples may have, and bends of elements per the range: the finger's own elements bend
otherwise than the exact rod."""
LOWS, SEEDS, ONTO = 2500, 600, 40
"""Most rods with a middle contact that are given forces; most seeds that are brought onto the set, and in how many
steps: of three fingers that wrap a jar, with 20 steps none leads to the part of the set with the least tension."""
CURVATURES, DIRECTIONS, FORCES = 25, 36, 10
"""Size of the grid of rods: curvatures at the base, directions and sizes of the force there."""
ON_SET = 1e-3
"""Residual up to which an equilibrium touches, in lengths and forces of the finger."""
MOST = 3000
"""Samples from which on a map is not filled further."""


def conditions(at: Traced) -> list[Jet]:
    """Residuals that vanish where a finger touches as it should."""
    rows = [at.missing_moment * 0.1]
    for touch in at.touches():
        if not touch.is_tip:
            rows += [touch.gap, touch.lean * 0.3]
        elif at.finger.tip:
            rows.append(touch.gap)
        else:
            rows += [part * 0.1 for part in touch.force]
    return rows


def shape_limits(at: Traced, entered: float) -> list[Jet]:
    """Excesses of a finger's tensions and shape over their limits, not above zero within them; it may be ``entered``
    deep [L] in obstacles.
    """
    finger = at.finger
    left, right = finger.sides
    # 0.1: a moment of the finger's greatest, or a bend, counts as much as so many lengths
    rows = [0.1 * at.pull - (0.1 if left else 0.0), -0.1 * at.pull - (0.1 if right else 0.0)]
    rows += [-clear - entered for clear in (*at.clear, at.clear_of_supports)]
    rows.append(0.1 * at.strain * (1.0 / finger.strain) - 0.1)
    rows += [0.1 * bend - 0.1 * LOOSE for bend in at.bends]
    low, high = finger.place_bounds
    touches = list(at.touches())
    for before, touch in zip([None, *touches], touches, strict=False):
        if not touch.is_tip:
            rows += [low - touch.at if before is None else before.at + PLACE - touch.at, touch.at - high]
        elif finger.tip:
            rows.append(touch.lean * 0.3)
    return rows


def limits(at: Traced) -> list[Jet]:
    """Excesses over all limits of a finger alone, those of its contacts' forces among them."""
    finger, rows = at.finger, shape_limits(at, ENTERED)
    for touch in at.touches():
        if not touch.is_tip or finger.tip:
            normal, along = touch.force
            rows += [-0.1 * normal, 0.3 * (normal * (1.0 / finger.greatest_force) - 1.0)]
            rows.append((along.size(1e-9) - finger.friction * normal.excess()) * 0.1)
    return rows


def features(at: Traced) -> Array:
    """Cells (B, F), as fractions."""
    finger = at.finger

    def use(touch: RodContact) -> Array:
        normal, along = (force.value for force in touch.force)
        return np.clip(along / (finger.friction * (np.abs(normal) + 0.05)), -2.0, 2.0) / FRICTION

    columns = [at.pull.value / TENSION]
    for touch in at.touches():
        columns += [place.value / PLACE for place in touch.place]
        if not touch.is_tip:
            columns.append(use(touch))
        elif finger.tip:
            columns += [np.arctan2(touch.normal[1].value, touch.normal[0].value) / TURN, use(touch)]
    return np.stack(columns, axis=1)


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
        seeds = _seeds(finger)
        if len(seeds):
            seeds = _onto(finger, seeds)
        if not len(seeds):
            return FingerMap(finger, finger.traced(np.zeros((0, finger.numbers))))
        return FingerMap(finger, _filled(finger, seeds))


def steps_of(z: Array) -> Array:
    """Steps (B, n) of the numbers of equilibria that change them alike."""
    steps = np.empty(z.shape)
    steps[:, 0], steps[:, 3] = 0.35, 1.5
    steps[:, 1:3] = np.maximum(0.3, 0.25 * np.hypot(z[:, 1], z[:, 2]))[:, None]
    for first in range(4, z.shape[1], 3):
        steps[:, first] = 0.04
        steps[:, first + 1 : first + 3] = np.maximum(0.3, 0.25 * np.abs(z[:, first + 1]))[:, None]
    return steps


def _grid(finger: MapFinger) -> tuple[tuple[int, int, int], Array]:
    """Rods of a grid of curvature at the base and force there (N, n), without middle contacts."""
    bends = [n * finger.bending_range for n in finger.elements]
    most = min(1.3 * sum(bends), 14.0)
    strongest = finger.greatest_force * math.hypot(1.0, finger.friction) * (1 + finger.middles)
    # 0.12: arm [L] at which the tendons' greatest moment is a force
    strongest = min(strongest, 2.5 * finger.greatest_moment / 0.12)
    curvatures = np.linspace(-most, most, CURVATURES)
    directions = (np.arange(DIRECTIONS) + 0.5) * (math.tau / DIRECTIONS)
    sizes = np.append(0.0, np.geomspace(min(0.05, 0.5 * strongest), strongest, FORCES - 1))
    bent, turn, size = np.meshgrid(curvatures, directions, sizes, indexing="ij")
    z = np.stack([bent, size * np.cos(turn), size * np.sin(turn), np.zeros(bent.shape)], axis=-1)
    return bent.shape, z.reshape(-1, 4)


def _edges(shape: tuple[int, ...], value: Array, around: int | None = None) -> Array:
    """Pairs of neighbors of a grid between which a value changes its sign; one axis may close on itself."""
    index, pairs = np.arange(value.size).reshape(shape), []
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
        traced = plain.traced(z, slopes=False)
        (tip,) = traced.touches()
        pairs = _edges(shape, tip.gap.value, around=1)
        return _between(z[pairs[:, 0]], z[pairs[:, 1]], tip.gap.value[pairs[:, 0]], tip.gap.value[pairs[:, 1]])
    seeds = z
    for contact in range(finger.middles):
        before = plain if contact == 0 else finger.with_middles(contact)
        seeds = _with_middle(before, seeds, shape if contact == 0 else None)
        # of these, drawn evenly
        seeds = seeds[np.linspace(0, len(seeds) - 1, min(len(seeds), LOWS)).astype(int)] if len(seeds) else seeds
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
        near = (gap[first] < 9.0) & (gap[second] < 9.0) & (np.abs(at[first] - at[second]) < 0.25)
        first, second = first[near], second[near]
        ends = np.column_stack([z, at])
        found.append(_between(ends[first], ends[second], gap[first], gap[second]))
    rows = np.concatenate(found)
    return np.column_stack([rows, np.zeros((len(rows), 2))])


def _with_forces(finger: MapFinger, z: Array) -> Array:
    """Rods whose last middle contact bears a force such that the tip touches, or is free (N, n)."""
    if not len(z):
        return z
    if not finger.tip:
        traced = finger.traced(z, slopes=False)
        # What is left at the tip is the contact's.
        *_, middle, tip = traced.touches()
        left = _complex(tip.force) * _complex(tip.normal) * np.conj(_complex(middle.normal))
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
    *_, tip = finger.traced(flat, slopes=False).touches()
    gap = tip.gap.value
    index = np.arange(len(flat)).reshape(len(z), normals, shares)
    pairs = []
    for a, b in ((index[:, :-1], index[:, 1:]), (index[:, :, :-1], index[:, :, 1:])):
        changes = (gap[a] > 0.0) != (gap[b] > 0.0)
        pairs.append(np.stack([a[changes], b[changes]], axis=1))
    first, second = np.concatenate(pairs).T
    return _between(flat[first], flat[second], gap[first], gap[second])


def _complex(pair: tuple[Jet, Jet]) -> Array:
    return np.asarray(pair[0].value + 1j * pair[1].value)


def _residual(at: Traced, hinges: bool) -> tuple[Array, Array]:
    rows = conditions(at)
    if hinges:
        rows += [row.excess() for row in limits(at)]
    return Jet.stacked(rows)


def is_sane(slope: Array) -> Array:
    """Mask (B,) of rods that have slopes (B, m, n) that say anything: those that coil up without end have none."""
    # 1e6: of a rod that makes a few turns they are below 1e4
    return np.asarray((np.abs(slope) < 1e6).all(axis=(1, 2)))


def _onto(finger: MapFinger, z: Array) -> Array:
    """The seeds nearest to the set, brought onto it within the limits."""
    z = z.copy()
    z[:, 3] = finger.traced(z, slopes=False).missing_moment.value
    at = finger.traced(z, slopes=False)
    order = np.argsort(np.abs(_residual(at, True)[0]).max(axis=1), kind="stable")
    # The nearest of each few cells: else those of one part of the set crowd out others.
    cells = np.round(features(at)[order] / 3.0)
    z = z[order[np.sort(np.unique(cells, axis=0, return_index=True)[1])[:SEEDS]]]
    landed, damping = [z[:0]], np.full(len(z), 1e-3)
    value, slope = _residual(finger.traced(z), True)
    # Damped steps of Gauss and Newton, each as long as it leads nearer.
    for _ in range(ONTO):
        off = np.abs(value).max(axis=1)
        going = is_sane(slope) & (off >= ON_SET)
        landed.append(z[off < ON_SET])
        z, value, slope, damping = z[going], value[going], slope[going], damping[going]
        steps = steps_of(z)
        scaled = slope * steps[:, None]
        across = scaled.transpose(0, 2, 1)
        square = across @ scaled + damping[:, None, None] * np.eye(z.shape[1])
        move = -np.linalg.solve(square, across @ value[..., None])[..., 0]
        move *= np.minimum(1.0, 1.5 / np.maximum(np.abs(move).max(axis=1), 1e-12))[:, None]
        trial = z + move * steps
        new_value, new_slope = _residual(finger.traced(trial), True)
        nearer = is_sane(new_slope) & ((new_value**2).sum(axis=1) < (value**2).sum(axis=1))
        z = np.where(nearer[:, None], trial, z)
        value = np.where(nearer[:, None], new_value, value)
        slope = np.where(nearer[:, None, None], new_slope, slope)
        damping = np.clip(np.where(nearer, 0.2 * damping, 5.0 * damping), 1e-7, 1e3)
    landed.append(z[np.abs(value).max(axis=1) < ON_SET])
    return np.concatenate(landed)


def _within(at: Traced, slack: float) -> Array:
    """Mask (B,) of equilibria that are within the limits, but for a slack."""
    return np.asarray(np.stack([row.value for row in limits(at)]).max(axis=0) <= slack)


def _filled(finger: MapFinger, seeds: Array) -> Traced:
    """All equilibria, one per cell, that steps of a cell along the set reach from the seeds."""
    known = set[bytes]()
    directions = _directions(finger.numbers - len(conditions(finger.traced(seeds[:1]))))

    def fresh(at: Traced) -> Traced:
        cells = np.round(features(at)).astype(np.int32)
        rows = []
        for row, key in enumerate(map(bytes, np.ascontiguousarray(cells))):
            if key not in known:
                known.add(key)
                rows.append(row)
        return at.take(rows)

    front = fresh(finger.traced(seeds))
    found = [front]
    while len(front) and len(known) < MOST:
        z = _neighbors(finger, front, directions)
        at = finger.traced(z, slopes=False)
        off = np.abs(Jet.stacked(conditions(at))[0]).max(axis=1)
        good = (off < ON_SET) & _within(at, 0.01)
        front = finger.traced(fresh(at.take(good)).z)
        found.append(front)
    return Traced.joined(found)


def _directions(size: int) -> Array:
    """Unit vectors (D, size), spread evenly and the same for all cells: both ways of each axis, and between axes."""
    axes = np.eye(size)
    between = [a + sign * b for k, a in enumerate(axes) for b in axes[:k] for sign in (1, -1)]
    half = np.concatenate([axes, np.array(between).reshape(-1, size)])
    half /= np.linalg.norm(half, axis=1)[:, None]
    return np.concatenate([half, -half])


def _neighbors(finger: MapFinger, front: Traced, directions: Array) -> Array:
    """Equilibria about a cell away from others, along the set (N, n)."""
    z, steps = front.z, steps_of(front.z)
    slope = Jet.stacked(conditions(front))[1]
    slope = slope * steps[:, None]
    count = slope.shape[1]
    _, _, across = np.linalg.svd(slope)
    null = across[:, count:].transpose(0, 2, 1)  # (B, n, d)
    measured = _feature_slopes(front) * steps[:, None] @ null
    metric = measured.transpose(0, 2, 1) @ measured + 1e-4 * np.eye(null.shape[2])
    sizes, axes = np.linalg.eigh(metric)
    ways = null @ (axes / np.sqrt(sizes)[:, None])  # of one cell each
    back = np.linalg.pinv(slope)
    move = np.einsum("bij,cj->cbi", ways, directions)
    move *= np.minimum(1.0, 3.0 / np.maximum(np.abs(move).max(axis=2, keepdims=True), 1e-12))
    out = (z[None] + move * steps[None]).reshape(-1, z.shape[1])
    back = np.tile(back, (len(directions), 1, 1))
    steps = np.tile(steps, (len(directions), 1))
    # 3: corrections by the slopes of where the step began
    for _ in range(3):
        off = Jet.stacked(conditions(finger.traced(out, slopes=False)))[0]
        out -= np.clip(np.einsum("bij,bj->bi", back, off), -1.0, 1.0) * steps
    return np.asarray(out)


def _feature_slopes(at: Traced) -> Array:
    """Slopes (B, F, n) of the cells."""
    finger = at.finger

    def use(touch: RodContact) -> Jet:
        normal, along = touch.force
        size = np.abs(normal.value) + 0.05
        share = along.value / size
        inside = np.abs(share) < 2.0 * finger.friction
        slope = (along.slope - (share * np.sign(normal.value))[:, None] * normal.slope) / size[:, None]
        return Jet(share, np.where(inside[:, None], slope, 0.0) / (finger.friction * FRICTION))

    rows = [at.pull * (1.0 / TENSION)]
    for touch in at.touches():
        rows += [place * (1.0 / PLACE) for place in touch.place]
        if not touch.is_tip:
            rows.append(use(touch))
        elif finger.tip:
            nx, ny = touch.normal
            turn = nx.value[:, None] * ny.slope - ny.value[:, None] * nx.slope
            rows += [Jet(nx.value, turn / TURN), use(touch)]
    return Jet.stacked(rows)[1]
