"""Which starts can hold the object: contact forces in their cones and tensions within limits that come closest to
balancing object and fingers, for many postures at once.

Friction cones are spanned by edges, each with a force that is not negative; a finger's bending moment is balanced at a
few of its sections. The remaining imbalance ranks the starts; it proves nothing.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.scan_curves import curvature_at, sample
from continuum_grasp.grasp.starts_candidates import Candidates
from continuum_grasp.grasp.starts_values import ContactStart
from continuum_grasp.scene.grasp import FingerSetup, GraspScene, OutOfPlaneGravity, PlanarGravity

__all__ = ["Block", "Loads", "finger_block", "imbalance", "loads_of", "support_block"]

Array = NDArray[Any]
Pose = tuple[float, float, float]

_SECTIONS = 9


@dataclass(frozen=True)
class Loads:
    """What the contacts have to carry, and scales.

    Attributes
    ----------
    force : float
        Force that counts as one [N].
    length : float
        Size of the object [m].
    planar : complex
        Weight in the plane [N].
    lift : float
        Weight out of the plane [N].
    gravity : complex
        Acceleration in the plane [m/s2].
    balance : bool
        Whether the lift must not tilt the object.
    """

    force: float
    length: float
    planar: complex
    lift: float
    gravity: complex
    balance: bool

    @property
    def rows(self) -> int:
        """Number of balances of the object."""
        return 3 + (0 if self.lift == 0.0 else 3 if self.balance else 1)

    @property
    def target(self) -> Array:
        """What the contacts must apply to the object, scaled (rows,)."""
        out = np.zeros(self.rows)
        out[0], out[1] = -self.planar.real / self.force, -self.planar.imag / self.force
        if self.lift:
            out[3] = self.lift / self.force
        return out


@dataclass(frozen=True)
class Block:
    """Forces of one finger, or of the supports: P postures, n forces of which the last is a tension for fingers.

    Attributes
    ----------
    onto : ndarray, (P, rows, n)
        What they do to the object, scaled.
    moments : ndarray, (P, S, n)
        What they do to the finger's sections, scaled.
    needed : ndarray, (P, S)
        What the sections need, scaled.
    low, high : ndarray, (n,)
        Bounds [N].
    """

    onto: Array
    moments: Array
    needed: Array
    low: Array
    high: Array

    def take(self, index: Any) -> Block:
        """Some of the postures."""
        return Block(self.onto[index], self.moments[index], self.needed[index], self.low, self.high)


def loads_of(scene: GraspScene) -> Loads:
    """What a scene's contacts have to carry."""
    gravity = complex(*scene.gravity.vector) if isinstance(scene.gravity, PlanarGravity) else 0j
    upright = scene.gravity if isinstance(scene.gravity, OutOfPlaneGravity) else None
    stiff = max(s.finger.rod.stiffness / s.finger.rod.length**2 for s in scene.setups)
    return Loads(
        force=max(scene.weight, 0.3 * stiff),
        length=scene.object.size,
        planar=scene.object.mass * gravity,
        lift=scene.object.mass * upright.magnitude if upright else 0.0,
        gravity=gravity,
        balance=upright is not None and upright.tilt == "balance",
    )


def _edges(loads: Loads, friction: float, normals: Array) -> tuple[Array, Array]:
    """Edges of friction cones (P, C, E), as forces in the plane on what touches the object, and their lifts (E,)."""
    if loads.lift:
        slopes, lifts = np.array([friction, -friction, 0.0]), np.array([0.0, 0.0, friction])
    else:
        slopes, lifts = np.array([friction, -friction]), np.zeros(2)
    return normals[..., None] * (1.0 + 1j * slopes), lifts


def _onto(loads: Loads, arms: Array, edges: Array, lifts: Array) -> Array:
    """Effect on the object (P, rows, C * E) of forces at ``arms`` (P, C) from its centre of mass."""
    count = len(arms)
    out = np.zeros((count, loads.rows, *edges.shape[1:]))
    out[:, 0], out[:, 1] = -edges.real, -edges.imag
    out[:, 2] = -(np.conj(arms)[..., None] * edges).imag / loads.length
    if loads.lift:
        out[:, 3] = lifts
        if loads.balance:
            out[:, 4] = arms.real[..., None] * lifts / loads.length
            out[:, 5] = arms.imag[..., None] * lifts / loads.length
    return out.reshape(count, loads.rows, -1)


def support_block(scene: GraspScene, loads: Loads, touched: dict[str, ContactStart], pose: Pose) -> Block:
    """Forces of the supports that the object touches at a world pose [m, rad]."""
    turn = cmath.exp(1j * pose[2])
    com = complex(*scene.object.com)
    parts: list[Array] = []
    high: list[float] = []
    for name, contact in touched.items():
        normal = np.array([[turn * cmath.exp(1j * contact.normal_angle)]])
        edges, lifts = _edges(loads, scene.friction(name), normal)
        parts.append(_onto(loads, np.array([[turn * (complex(*contact.point) - com)]]), edges, lifts))
        high.extend([_cap(loads, scene.normal_force_max(name))] * len(lifts))
    onto = np.concatenate(parts, axis=2) if parts else np.zeros((1, loads.rows, 0))
    size = onto.shape[2]
    return Block(onto, np.zeros((1, 0, size)), np.zeros((1, 0)), np.zeros(size), np.array(high))


def _cap(loads: Loads, most: float) -> float:
    return min(most, 50.0 * loads.force)


def finger_block(scene: GraspScene, loads: Loads, setup: FingerSetup, found: Candidates, pose: Pose) -> Block:
    """Forces of one finger in P postures, the object being at a world pose [m, rad]."""
    finger, length = setup.finger, setup.finger.rod.length
    count = len(found)
    turn, origin = cmath.exp(1j * pose[2]), complex(pose[0], pose[1])
    points, normals = origin + turn * found.points, turn * np.exp(1j * found.angles)
    at = np.broadcast_to(np.linspace(0.0, 1.0, _SECTIONS), (count, _SECTIONS))
    curve, _ = sample(found.knots, found.curvatures, at)
    base = found.bases
    world = (base[:, 0] + 1j * base[:, 1])[:, None] + length * np.exp(1j * base[:, 2:]) * curve
    rest = finger.rest_curvature if isinstance(finger.rest_curvature, int | float) else 0.0
    needed = finger.rod.stiffness * (curvature_at(found.knots, found.curvatures, at) / length - rest)
    if loads.gravity:
        needed = needed - _own_weight(setup, world, loads.gravity)
    edges, lifts = _edges(loads, setup.friction, normals)
    arms = points[:, None, :] - world[:, :, None]
    reaches = found.stations[:, None, :] >= at[:, :, None] - 1e-9
    moments = (np.conj(arms)[..., None] * edges[:, None]).imag * reaches[..., None]
    moments = moments.reshape(count, _SECTIONS, -1)
    tendons = finger.tendons
    pull, offset = (tendons.max_tension, tendons.offset) if tendons is not None else (0.0, 1.0)
    moments = np.concatenate([moments, np.full((count, _SECTIONS, 1), offset)], axis=2)
    com = origin + turn * complex(*scene.object.com)
    onto = _onto(loads, points - com, edges, lifts)
    onto = np.concatenate([onto, np.zeros((count, loads.rows, 1))], axis=2)
    scale = math.sqrt(_SECTIONS) * np.maximum(np.abs(needed).max(axis=1), 0.3 * finger.rod.stiffness / length)
    size = onto.shape[2]
    low, high = np.zeros(size), np.full(size, _cap(loads, setup.normal_force_max))
    low[-1] = -pull if finger.tendons_used in ("both", "right") else 0.0
    high[-1] = pull if finger.tendons_used in ("both", "left") else 0.0
    return Block(onto, moments / scale[:, None, None], needed / scale[:, None], low, high)


def _own_weight(setup: FingerSetup, world: Array, gravity: complex) -> Array:
    """Moment about each section of the weight of the finger beyond it (P, S)."""
    rod = setup.finger.rod
    count = world.shape[1]
    share = np.full(count, rod.length * rod.mass_per_length / (count - 1))
    share[[0, -1]] *= 0.5
    for mass in setup.finger.masses:
        share[round((count - 1) * mass.at / rod.length)] += mass.mass
    beyond = np.cumsum(share[::-1])[::-1]
    first = np.cumsum((share * world)[:, ::-1], axis=1)[:, ::-1]
    return np.asarray((np.conj(first - beyond * world) * gravity).imag)


def imbalance(loads: Loads, blocks: list[Block], index: list[Array]) -> tuple[Array, Array]:
    """Least imbalance of B combinations of postures, and the effort that goes with it.

    Parameters
    ----------
    loads : Loads
    blocks : list of Block
    index : list of ndarray of int, (B,)
        Which posture of each block.

    Returns
    -------
    imbalance, effort : ndarray, (B,)
        Relative to the loads; mean of the forces per their limits.
    """
    count = len(index[0])
    sizes = [b.onto.shape[2] for b in blocks]
    sections = [b.moments.shape[1] for b in blocks]
    system = np.zeros((count, loads.rows + sum(sections), sum(sizes)))
    right = np.zeros((count, loads.rows + sum(sections)))
    right[:, : loads.rows] = loads.target
    row, column = loads.rows, 0
    for block, rows, size, chosen in zip(blocks, sections, sizes, index, strict=True):
        system[:, : loads.rows, column : column + size] = block.onto[chosen] / loads.force
        system[:, row : row + rows, column : column + size] = block.moments[chosen]
        right[:, row : row + rows] = block.needed[chosen]
        row, column = row + rows, column + size
    low = np.concatenate([b.low for b in blocks])
    high = np.concatenate([b.high for b in blocks])
    return _boxed(system, right, low, high)


def _boxed(system: Array, right: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Least squares within bounds for many systems at once, by an interior point method."""
    span = high - low
    scaled = system * span
    right = right - system @ low
    square = np.einsum("brn,brm->bnm", scaled, scaled)
    linear = -np.einsum("brn,br->bn", scaled, right)
    size = len(low)
    square += 1e-7 * np.eye(size)
    linear = linear + 1e-5
    x = np.full(linear.shape, 0.3)
    zl, zu = np.full(linear.shape, 0.1), np.full(linear.shape, 0.1)
    barrier = 1e-2
    for _ in range(14):
        gradient = np.einsum("bnm,bm->bn", square, x) + linear
        room_low, room_high = x, 1.0 - x
        right_side = -gradient + barrier / room_low - barrier / room_high
        matrix = square.copy()
        diagonal = np.arange(size)
        matrix[:, diagonal, diagonal] += zl / room_low + zu / room_high
        step = np.linalg.solve(matrix, right_side[..., None])[..., 0]
        dl = barrier / room_low - zl - zl / room_low * step
        du = barrier / room_high - zu + zu / room_high * step
        limit = np.maximum(
            np.maximum(-step / room_low, step / room_high).max(axis=1), np.maximum(-dl / zl, -du / zu).max(axis=1)
        )
        length = np.minimum(1.0, 0.95 / np.maximum(limit, 1e-300))[:, None]
        x, zl, zu = x + length * step, zl + length * dl, zu + length * du
        barrier *= 0.35
    left = np.einsum("brn,bn->br", scaled, x) - right
    at_zero = np.where(low < 0.0, -low / np.where(span > 0.0, span, 1.0), 0.0)
    return np.sqrt((left**2).sum(axis=1)), np.abs(x - at_zero).mean(axis=1)
