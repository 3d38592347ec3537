"""Forces of starts that can hold the object: contact forces in their cones and tensions within limits that come closest
to balancing object and fingers, for many postures at once.

Friction cones are spanned by edges, each with a force that is not negative; a finger's bending moment is balanced at a
few of its sections. The remaining imbalance ranks the starts; it proves nothing.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.starts.candidates import Candidates
from continuum_grasp.grasp.starts.scan.curves import curvature_at, gauss_legendre, sample
from continuum_grasp.grasp.starts.scan.kernel import within_bounds
from continuum_grasp.grasp.starts.scan.task import FINE
from continuum_grasp.grasp.starts.values import ContactStart, Pose
from continuum_grasp.model import Family
from continuum_grasp.scene import FAMILIES, FingerSetup, GraspScene

_NODES, _WEIGHTS = gauss_legendre(4)
_TENSION_WEIGHT, _ENOUGH = 5e-5, 1e-6
"""Weight of the tensions (per their limits) beside the squared imbalance; mean product of distances and multipliers,
per weight, at which a system is solved: of 26 forces the tensions are exact to 5e-5 of their limits then."""


@dataclass(frozen=True)
class Loads:
    """Loads on the contacts, and scales."""

    force: float  # force that counts as one [N]
    length: float  # size of the object [m]
    planar: complex  # weight in the plane [N]
    lift: float  # weight out of the plane [N]
    gravity: complex  # acceleration in the plane [m/s2]
    balance: bool  # whether the lift must not tilt the object
    directions: int = 24  # edges of a friction cone, where there is lift; they lose less than 1 % of the friction, and
    # point downwards too, since with a balance of the tilt the best grasp may push a contact down

    @property
    def rows(self) -> int:
        """Number of balances of the object."""
        return 3 + (0 if self.lift == 0.0 else 3 if self.balance else 1)

    @property
    def edges(self) -> int:
        """Number of edges of a friction cone."""
        return self.directions if self.lift else 2

    @property
    def target(self) -> Array:
        """Wrench that the contacts must apply to the object, scaled (rows,)."""
        out = np.zeros(self.rows)
        out[0], out[1] = -self.planar.real / self.force, -self.planar.imag / self.force
        if self.lift:
            out[3] = self.lift / self.force
        return out


@dataclass(frozen=True)
class ForceBlock:
    """Forces of one finger, or of the supports: P postures, n forces of which the last two are tensions for fingers."""

    onto: Array  # (P, rows, n) what they do to the object, scaled
    moments: Array  # (P, S, n) what they do to the finger's sections, scaled
    needed: Array  # (P, S) what the sections need, scaled
    low: Array  # (n,) bounds [N]
    high: Array  # (n,)
    cost: Array  # (n,) 1 for tensions


def loads_of(scene: GraspScene) -> Loads:
    """Loads on a scene's contacts."""
    gravity = complex(*scene.gravity_in_plane)
    stiff = max(s.stiffness / s.finger.rod.length**2 for s in scene.setups)
    return Loads(
        # Where nothing weighs, forces that bend a finger well are about E I / L^2.
        force=max(scene.weight, 0.3 * stiff),
        length=scene.object.size,
        planar=scene.object.mass * gravity,
        lift=scene.weight if scene.lifted else 0.0,
        gravity=gravity,
        balance=scene.balances_tilt,
    )


def _slopes(loads: Loads, friction: float) -> tuple[Array, Array]:
    """Friction in the plane and lift, per normal force, along the edges (E,) of a friction cone."""
    if loads.lift:
        around = math.tau / loads.directions * np.arange(loads.directions)
        return friction * np.cos(around), friction * np.sin(around)
    return np.array([friction, -friction]), np.zeros(2)


def cone_edges(loads: Loads, friction: float) -> list[int]:
    """The two edges of a friction cone that lie in the plane."""
    lifts = _slopes(loads, friction)[1]
    return [k for k, lift in enumerate(lifts.tolist()) if abs(lift) <= 1e-9 * friction][:2]


def _onto(loads: Loads, arms: Array, edges: Array, lifts: Array) -> Array:
    """Effect on the object (P, rows, C * E) of forces at ``arms`` (P, C) from its center of mass.

    The ``edges`` (P, C, E) are those in the plane on what touches the object, ``lifts`` (E,) those out of it.
    """
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


def support_block(scene: GraspScene, loads: Loads, touched: dict[str, ContactStart], pose: Pose) -> ForceBlock:
    """Forces of the supports that the object touches at a world pose [m, rad]."""
    turn = cmath.exp(1j * pose[2])
    com = complex(*scene.object.com)
    parts: list[Array] = [np.zeros((1, loads.rows, 0))]
    high: list[float] = []
    for name, contact in touched.items():
        slopes, lifts = _slopes(loads, scene.held_friction(name))
        edges = np.array([[turn * cmath.exp(1j * contact.normal_angle)]])[..., None] * (1.0 + 1j * slopes)
        parts.append(_onto(loads, np.array([[turn * (complex(*contact.point) - com)]]), edges, lifts))
        high.extend([_cap(loads, scene.normal_force_max(name))] * len(lifts))
    onto = np.concatenate(parts, axis=2)
    size = onto.shape[2]
    return ForceBlock(onto, np.zeros((1, 0, size)), np.zeros((1, 0)), np.zeros(size), np.array(high), np.zeros(size))


def _cap(loads: Loads, limit: float) -> float:
    # The interior point method scales forces by their ranges: far greater ones than the loads cost digits.
    return min(limit, 1000.0 * loads.force)


def finger_block(scene: GraspScene, loads: Loads, setup: FingerSetup, candidates: Candidates, pose: Pose) -> ForceBlock:
    """Forces of one finger in P postures, the object being at a world pose [m, rad]."""
    finger, length = setup.finger, setup.finger.rod.length
    turn, origin = cmath.exp(1j * pose[2]), complex(pose[0], pose[1])
    points, normals = origin + turn * candidates.points, turn * np.exp(1j * candidates.angles)
    mesh = _Mesh.of(setup, candidates)
    at = mesh.sections
    curve = sample(
        candidates.knots, candidates.curvatures, np.concatenate([np.zeros((len(candidates), 1)), at], axis=1)
    )
    base = candidates.bases
    world = (base[:, 0] + 1j * base[:, 1])[:, None] + length * np.exp(1j * base[:, 2:]) * curve[:, 1:]
    profile, (channel,) = finger.profile, finger.channels
    bent = curvature_at(candidates.knots, candidates.curvatures, at) / length - profile.rest_curvature(length * at)
    needed = profile.bending_stiffness(length * at) * bent
    # A straight finger needs no moment, but a scale.
    scale = np.maximum(np.abs(needed).max(axis=1), 0.3 * setup.stiffness / length)[:, None]
    if loads.gravity:
        needed = needed - _own_weight(setup, world, at, loads.gravity)
    slopes, lifts = _slopes(loads, setup.held_friction)
    edges = normals[..., None] * (1.0 + 1j * slopes)
    arms = points[:, None, :] - world[:, :, None]
    # A section bears what acts beyond it, up to the tip.
    reaches = candidates.stations[:, None, :] >= at[:, :, None] - 1e-9
    moments = (np.conj(arms)[..., None] * edges[:, None]).imag * reaches[..., None]
    moments = moments.reshape(*at.shape, -1)
    tendons, used = setup.tendons, finger.tendons_used
    low, high = tendons.min_tension, setup.max_tension
    moments = np.concatenate([moments, channel.shape(length * at)[..., None] * np.asarray(channel.arms)], axis=2)
    com = origin + turn * complex(*scene.object.com)
    onto = _onto(loads, points - com, edges, lifts)
    onto = np.concatenate([onto, np.zeros((len(candidates), loads.rows, 2))], axis=2)
    pushes = onto.shape[2] - 2
    return ForceBlock(
        onto,
        mesh.project(moments) / scale[..., None],
        mesh.project(needed[..., None])[..., 0] / scale,
        np.array([0.0] * pushes + [low, low]),
        np.array(
            [_cap(loads, setup.normal_force_max)] * pushes
            + [high if used in ("both", side) else low for side in ("left", "right")]
        ),
        np.array([0.0] * pushes + [1.0, 1.0]),
    )


@dataclass(frozen=True)
class _Mesh:
    """Elements of P postures with Gauss points, and the shapes over which their moments are balanced."""

    sections: Array  # positions (P, 4 M + 1), the last one the tip's
    shares: Array  # lengths of the elements (P, 4 M), at each point
    shapes: Array  # (R, 4 M) at the points, times the weights of these
    matches_tip: bool

    @staticmethod
    def of(setup: FingerSetup, candidates: Candidates) -> _Mesh:
        """The elements of a finger, or fewer where it has many."""
        few, count = setup.elements <= FINE, len(candidates)
        counts = tuple(n if few else min(n, 2) for n in np.diff((0, *setup.before, setup.elements)).tolist())
        at, share, shapes = _elements(counts, few and Family.named(setup.family).degree == 0)
        ends = np.concatenate([np.zeros((count, 1)), candidates.joints, np.ones((count, 1))], axis=1)
        return _Mesh(ends @ at, ends @ share, shapes, FAMILIES[setup.family].matches_tip)

    def project(self, values: Array) -> Array:
        """Means (P, R, n) of values (P, 4 M + 1, n) over the shapes."""
        rows = self.shapes @ (values[:, :-1] * self.shares[..., None])
        if self.matches_tip:
            # The tip's curvature has a balance of its own, which counts as half an element's.
            rows[:, -1] = 0.5 * values[:, -1]
        return np.asarray(rows)


@lru_cache(maxsize=64)
def _elements(counts: tuple[int, ...], constant: bool) -> tuple[Array, Array, Array]:
    """For so many elements per segment, what the ends of the segments are multiplied by: (J, 4 M + 1) for the Gauss
    points and the tip, (J, 4 M) for the lengths of the elements there; and the shapes (R, 4 M), which are ``constant``
    on each element, or hats over the ends of elements.
    """
    total, points = sum(counts), len(_NODES)
    at, share = np.zeros((len(counts) + 1, total * points + 1)), np.zeros((len(counts) + 1, total * points))
    at[-1, -1] = 1.0
    shapes = np.zeros((total + (0 if constant else 1), total * points))
    element = 0
    for segment, count in enumerate(counts):
        for k in range(count):
            nodes = slice(element * points, (element + 1) * points)
            part = (k + _NODES) / count
            at[segment, nodes], at[segment + 1, nodes] = 1.0 - part, part
            share[segment, nodes], share[segment + 1, nodes] = -1.0 / count, 1.0 / count
            shapes[element, nodes] = _WEIGHTS if constant else _WEIGHTS * (1.0 - _NODES)
            if not constant:
                shapes[element + 1, nodes] = _WEIGHTS * _NODES
            element += 1
    return at, share, shapes


def _own_weight(setup: FingerSetup, world: Array, at: Array, gravity: complex) -> Array:
    """Moment about each section of the weight of the finger beyond it (P, S)."""
    rod = setup.finger.rod
    # Lumped half-way between sections, which is enough to rank starts.
    density = setup.finger.profile.linear_density(rod.length * at)
    share = np.diff(at, axis=1, prepend=0.0) * rod.length * density
    middle = 0.5 * (world + np.concatenate([world[:, :1], world[:, :-1]], axis=1))
    force = np.cumsum(share[:, ::-1], axis=1)[:, ::-1] - share
    first = np.cumsum((share * middle)[:, ::-1], axis=1)[:, ::-1] - share * middle
    rows = np.arange(len(at))
    for mass in setup.finger.masses:
        place = np.minimum((at < mass.at / rod.length - 1e-9).sum(axis=1), at.shape[1] - 1)
        beyond = np.arange(at.shape[1]) <= place[:, None]
        force = force + mass.mass * beyond
        first = first + mass.mass * world[rows, place][:, None] * beyond
    return np.asarray((np.conj(first - force * world) * gravity).imag)


def contact_forces(
    scene: GraspScene, loads: Loads, names: list[str], found: Array
) -> dict[str, tuple[float, float, float]]:
    """Normal, friction and lift [N] at contacts, from the forces along the edges of their cones."""
    out = {}
    for k, name in enumerate(names):
        friction = scene.held_friction(name)
        slopes, lifts = _slopes(loads, friction)
        edge_forces = found[k * len(slopes) : (k + 1) * len(slopes)]
        out[name] = (float(edge_forces.sum()), float(edge_forces @ slopes), float(edge_forces @ lifts))
    return out


def imbalance(loads: Loads, blocks: list[ForceBlock], index: list[Array]) -> tuple[Array, Array, Array]:
    """Least imbalance of B combinations of postures, ``index`` (B,) per block, and the effort that goes with it.

    Returns the imbalances (B,) relative to the loads, the sums of the tensions per their limits (B,), and the forces of
    all blocks (B, n) [N].
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
    low, high, cost = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("low", "high", "cost"))
    cost = cost / max(float((cost * high).sum()), 1e-300)
    # In shares of their ranges all unknowns lie in (0, 1); 1e-8 beside the cost makes the optimum unique.
    span = np.maximum(high - low, 1e-12)
    across = np.ascontiguousarray(np.swapaxes(system * span, 1, 2))
    weight = _TENSION_WEIGHT * cost * span + 1e-8
    x = within_bounds(across, right - system @ low, weight, _ENOUGH * _TENSION_WEIGHT) * span + low
    left = (system @ x[..., None])[..., 0] - right
    return np.sqrt((left**2).sum(axis=1)), x @ cost, x
