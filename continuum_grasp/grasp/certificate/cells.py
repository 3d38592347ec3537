"""Integrals over the cells of a finger of a grasp, to rounding wherever something along it has a kink."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def cell_nodes(edges: Array, *breaks: Sequence[float]) -> tuple[Array, Array, NDArray[np.int64]]:
    """Nodes (G,) [m] and weights [m] between places where something may have a kink, and the cell that each is in.

    ``edges`` (K + 1,) are those of the cells, ``breaks`` other such places [m]. Sixteen nodes between two places: to
    rounding for tapers to a tenth.
    """
    inside = [at for at in np.concatenate(breaks) if edges[0] < at < edges[-1]] if breaks else []
    places = np.unique(np.concatenate([edges, inside]))
    middle, half = 0.5 * (places[1:] + places[:-1])[:, None], 0.5 * np.diff(places)[:, None]
    cell = np.searchsorted(edges, middle.ravel()) - 1
    return (middle + half * _NODES).ravel(), (half * _WEIGHTS).ravel(), np.repeat(cell, _NODES.size)
