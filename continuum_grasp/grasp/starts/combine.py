"""Which postures of several fingers go together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.force import Block, Loads, imbalance
from continuum_grasp.grasp.starts.order import spread_order

__all__ = ["Combined", "combine", "doubt"]

Array = NDArray[Any]
Combined = tuple[list[Array], Array, Array, Array]
"""Posture per finger, and for each combination what is left, its cost, and its forces."""

_MOST = 160
"""Pairs of postures that are weighed where shapes fix the forces."""
_CLOSE = 0.02
"""Relative imbalance up to which its size ranks starts; IPOPT brings a few parts in a hundred to zero."""
_PER_FINGER = {2: 14, 3: 8, 4: 6}
"""Postures per finger that are combined, by number of fingers: 200 to 1300 combinations."""
_FIRST, _IMPROVED = 64, 3
"""Combinations that are weighed first, and the best of them of which one finger's posture at a time is exchanged."""


def combine(
    loads: Loads, blocks: list[Block], supports: Block, features: list[Array], paired: bool = False
) -> Combined:
    """Weigh combinations of the postures of all fingers.

    Parameters
    ----------
    loads : Loads
    blocks : list of Block
        Of the fingers.
    supports : Block
    features : list of ndarray, (P, F)
        In which different postures of a finger differ.
    paired : bool
        Only the first of each together, the second, and so on.
    """
    if len(blocks) == 1 or paired:
        return _weigh(loads, blocks, supports, [np.arange(len(block.needed)) for block in blocks])
    alone = [_alone(loads, block) for block in blocks]
    if len(blocks) == 2 and supports.onto.shape[2] == 0 and all(block.single for block in blocks):
        return _weigh(loads, blocks, supports, _opposed(loads, alone))
    most = _PER_FINGER[len(blocks)]
    picks = [
        np.array(spread_order(doubt(left) + cost, what, most))
        for (left, cost, _), what in zip(alone, features, strict=True)
    ]
    sizes = [len(pick) for pick in picks]
    total = int(np.prod(sizes))
    some = np.arange(total)
    if total > _FIRST:
        some = np.unique((np.arange(_FIRST) * 0.6180339887498949 % 1.0 * total).astype(int))
    index = [pick[i] for pick, i in zip(picks, np.unravel_index(some, sizes), strict=True)]
    found = _weigh(loads, blocks, supports, index)
    if total <= _FIRST:
        return found
    best = np.argsort(doubt(found[1]) + found[2], kind="stable")[:_IMPROVED]
    more = []
    for row in best:
        for finger, pick in enumerate(picks):
            more.append([pick if k == finger else np.full(len(pick), i[row]) for k, i in enumerate(index)])
    changed = [np.concatenate([m[k] for m in more]) for k in range(len(blocks))]
    every = np.unique(np.stack(changed), axis=1)
    return _joined(found, _weigh(loads, blocks, supports, list(every)))


def doubt(left: Array) -> Array:
    """How unlikely a grasp is where forces and tensions leave this imbalance: beyond a few parts in a hundred, how much
    it is means little.
    """
    return np.where(left < _CLOSE, 10.0 * left, 10.0 * _CLOSE + 2.0 * (left - _CLOSE))


def _weigh(loads: Loads, blocks: list[Block], supports: Block, index: list[Array]) -> Combined:
    left, cost, forces = imbalance(loads, [*blocks, supports], [*index, np.zeros(len(index[0]), int)])
    return index, left, cost, forces


def _joined(a: Combined, b: Combined) -> Combined:
    index = [np.concatenate([one, two]) for one, two in zip(a[0], b[0], strict=True)]
    return index, *(np.concatenate([one, two]) for one, two in zip(a[1:], b[1:], strict=True))  # type: ignore[return-value]


def _alone(loads: Loads, block: Block) -> tuple[Array, Array, Array]:
    """What is left of the fingers' own balance, its cost, and what the forces then do to the object."""
    free = Loads(loads.force, loads.length, 0j, 0.0, loads.gravity, False)
    own = Block(0.0 * block.onto[:, :3], block.moments, block.needed, block.low, block.high, block.cost)
    left, cost, forces = imbalance(free, [own], [np.arange(len(block.needed))])
    return left, cost, (block.onto[:, :3] @ forces[..., None])[..., 0] / loads.force


def _opposed(loads: Loads, alone: list[tuple[Array, Array, Array]]) -> list[Array]:
    """Pairs whose forces, which their shapes fix, come closest to balancing the object."""
    (left, _, one), (right, _, two) = alone
    sums = one[:, None, :] + two[None, :, :] - loads.target[:3]
    size = 1.0 + np.abs(one).max(axis=1)[:, None] + np.abs(two).max(axis=1)[None, :]
    misfit = np.sqrt((sums**2).sum(axis=2)) / size + left[:, None] + right[None, :]
    order = np.argsort(misfit, axis=None, kind="stable")[:_MOST]
    return list(np.unravel_index(order, misfit.shape))
