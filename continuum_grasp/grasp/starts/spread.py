"""The best of many that differ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RANGE = 0.5
"""Distance of features within which two are alike: about 0.25 L along the finger, or 30 degrees of a normal."""


def spread_order(score: Array, features: Array, count: int) -> list[int]:
    """Indices of ``count`` of P, each the best by score (P,), less being better, under a penalty for being like one
    before by its features (P, F).
    """
    order: list[int] = []
    near = np.full(len(score), np.inf)
    taken = np.zeros(len(score), bool)
    for _ in range(min(count, len(score))):
        likeness = np.exp(-((near / _RANGE) ** 2))
        pick = int(np.argmin(np.where(taken, np.inf, score + 0.5 * likeness)))
        order.append(pick)
        taken[pick] = True
        near = np.minimum(near, np.sqrt(((features - features[pick]) ** 2).sum(axis=1)))
    return order
