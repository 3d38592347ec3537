"""Sets of postures of several fingers that touch with their tips alone: which go together, by the object's balance.

Shapes fix the forces of such fingers, so a table of what each posture does to the object is enough to match them; what
supports add is the nearest point of their friction cones.
"""

from __future__ import annotations

import numpy as np

from continuum_grasp.arrays import Numbers as Array
from continuum_grasp.grasp.starts.candidates import Candidates, spread_order
from continuum_grasp.grasp.starts.force import Block, Loads, cone_edges
from continuum_grasp.grasp.starts.values import ContactStart
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

_TABLE = {2: 400, 3: 36, 4: 14}
"""Postures per finger that are matched, by number of fingers: 40,000 to 160,000 sets."""
_LIKELY = 600
"""Sets that are likely to balance: with 48 of two fingers that differ one of 24 scenes has no grasp, and one 67 % more
tension."""
_DESCENTS = 24
"""Steps to the nearest forces of supports."""
_COST = 0.1
"""Weight of the tensions of a set, per those of likely sets, beside its relative imbalance."""


def matched_sets(
    scene: GraspScene,
    loads: Loads,
    found: list[Candidates],
    features: list[Array],
    blocks: list[Block],
    supports: tuple[Block, dict[str, ContactStart]],
) -> list[Array]:
    """Postures of each finger by index, the k-th of which belong together in a set that is likely to balance."""
    row_limit = _TABLE[len(found)]
    picks, tables = [], []
    for setup, candidates, unlike, block in zip(scene.setups, found, features, blocks, strict=True):
        forces, remainder = shape_forces(loads, setup, block)
        edges, pull = forces[:, :2] / loads.force, forces[:, 2] / loads.force
        onto = (block.onto[:, :3, _columns(loads, setup)] @ forces[..., None])[..., 0] / loads.force
        high = float(block.high[-2:].max()) / loads.force
        normal = edges.sum(axis=1)
        # What is outside of the cone or a limit, per the forces in play.
        outside = np.maximum(-edges, 0.0).sum(axis=1) + np.maximum(np.abs(pull) - high, 0.0)
        outside += np.maximum(normal - setup.normal_force_max / loads.force, 0.0)
        alone = outside / (1.0 + np.abs(edges).sum(axis=1)) + np.sqrt((remainder**2).sum(axis=1))
        alone += np.minimum(10.0 * candidates.violation, 1.0)
        lift = 2.0 * setup.held_friction * np.sqrt(np.maximum(edges[:, 0] * edges[:, 1], 0.0))
        cost = np.abs(pull) / high
        score = alone + _COST * cost / max(float(np.median(cost)), 1e-9)
        picks.append(pick := np.array(spread_order(score, unlike, row_limit)))
        tables.append(np.column_stack([onto, lift, alone, cost])[pick])
    sizes = [len(pick) for pick in picks]
    total = tables[0]
    size = 1.0 + np.sqrt((total[:, :3] ** 2).sum(axis=1))
    for table in tables[1:]:
        # Sets as rows, the last finger's postures counting fastest.
        total = (total[:, None, :] + table).reshape(-1, total.shape[1])
        size = (size[:, None] + np.sqrt((table[:, :3] ** 2).sum(axis=1))).ravel()
    off = total[:, :3] - loads.target[:3]
    off, lift = _supported(scene, loads, off, *supports)
    short = np.maximum(loads.lift / loads.force - total[:, 3] - lift, 0.0)
    wrong = np.sqrt((off**2).sum(axis=1) + short**2) / size + total[:, 4]
    cost = total[:, 5]
    likely = np.argpartition(wrong, min(_LIKELY, len(wrong) - 1))[:_LIKELY]
    score = wrong + _COST * cost / max(float(np.median(cost[likely])), 1e-9)
    likely = np.argpartition(score, min(_LIKELY, len(score) - 1))[:_LIKELY]
    return [pick[i] for pick, i in zip(picks, np.unravel_index(likely, sizes), strict=True)]


def _supported(
    scene: GraspScene, loads: Loads, off: Array, block: Block, touched: dict[str, ContactStart]
) -> tuple[Array, Array]:
    """Remainder of imbalances (S, 3) under the best forces of supports, and how much these may lift (S,)."""
    if not touched:
        return off, np.zeros(len(off))
    friction = np.array([scene.held_friction(name) for name in touched])
    columns = [loads.edges * k + edge for k, mu in enumerate(friction) for edge in cone_edges(loads, mu)]
    effects = block.onto[0][:3, columns]
    force = pressed(effects, off)
    pairs = force.reshape(len(off), -1, 2)
    return off + force @ effects.T, (2.0 * friction * np.sqrt(pairs[..., 0] * pairs[..., 1])).sum(axis=1)


def _columns(loads: Loads, setup: FingerSetup) -> list[int]:
    """Forces along two edges of the tip's cone, and the tension left minus right."""
    return [*cone_edges(loads, setup.held_friction), -2]


def shape_forces(loads: Loads, setup: FingerSetup, block: Block) -> tuple[Array, Array]:
    """Forces (P, 3) of `_columns` [N] that come closest to bending P postures of a finger that touches with its tip
    alone as they are, and what is missing for its balance (P, R).
    """
    moments = block.moments[:, :, _columns(loads, setup)]
    square = np.einsum("pri,prj->pij", moments, moments)
    # Normal equations scaled to a unit diagonal, 1e-9 on it where the forces are not unique.
    span = np.sqrt(np.maximum(np.einsum("pii->pi", square), 1e-300))
    square = square / (span[:, :, None] * span[:, None, :]) + 1e-9 * np.eye(3)
    right = np.einsum("pri,pr->pi", moments, block.needed) / span
    forces = np.linalg.solve(square, right[..., None])[..., 0] / span
    return forces, (moments @ forces[..., None])[..., 0] - block.needed


def pressed(onto: Array, off: Array) -> Array:
    """Forces (S, E) along the edges of the cones of supports, with effects ``onto`` (3, E), that leave the least of
    imbalances (S, 3), nearly: by Y. Nesterov's accelerated projected gradient, in which all edges count alike.
    """
    square, slope = onto.T @ onto, off @ onto
    stiff = np.linalg.eigvalsh(square).max(initial=1e-300)
    force = ahead = np.zeros_like(slope)
    for k in range(_DESCENTS):
        new = np.maximum(ahead - (ahead @ square + slope) / stiff, 0.0)
        force, ahead = new, new + k / (k + 3.0) * (new - force)
    return force
