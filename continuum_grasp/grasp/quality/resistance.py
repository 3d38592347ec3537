"""How far a disturbance may grow until a contact slips, parts or is pressed too hard, a tendon is at its limit, or the
grasp yields too much.

The fingers move as `continuum_grasp.grasp.quality.response` computes: to first order, contacts sticking until the first
one does not. It does not hold far from the stored grasp of soft fingers, so motions are limited too.
Forces out of the plane stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.response import GraspResponse, Tendons
from continuum_grasp.grasp.quality.response_limits import ResponseLimits
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["Resistance", "resistance", "resistance_polygon"]

Array = NDArray[Any]

DISPLACEMENT_LIMIT = 0.1
"""Greatest motion of the object: as a part of its size, and in rad; finger tips may turn three times as much."""


@dataclass(frozen=True)
class Resistance:
    """Answer of `resistance`.

    Attributes
    ----------
    wrenches : ndarray, shape (K, 3)
        Disturbances: force x, y [N] and moment about the center of mass [N m].
    factors : ndarray, shape (K,)
        Greatest multiple of each that the grasp resists [1]; infinite where nothing limits it, zero where the grasp is
        unstable or beyond a limit by itself.
    limiting : tuple of tuple of str
        What stops each from growing.
    motions : ndarray, shape (K, 3)
        How far the object moves at this factor: center of mass [m], angle [rad]; NaN where not limited.
    tendons : {"retensioned", "locked"}
        Whether tensions are chosen anew for each disturbance, or tendon lengths are fixed.
    stable : bool
        Whether the grasp is stable with its tendons so.
    """

    wrenches: Array
    factors: Array
    limiting: tuple[tuple[str, ...], ...]
    motions: Array
    tendons: Tendons
    stable: bool

    @property
    def least(self) -> float:
        """Least of the factors; infinite without disturbances."""
        return float(self.factors.min(initial=math.inf))


def resistance(
    scene: GraspScene,
    arrays: Mapping[str, Any],
    *,
    wrenches: Sequence[Sequence[float]] | None = None,
    tendons: Tendons | None = None,
    displacement_limit: float | None = DISPLACEMENT_LIMIT,
    response: GraspResponse | None = None,
) -> Resistance:
    """Greatest multiples of disturbances that a grasp resists, one disturbance at a time.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp.
    wrenches : sequence of (float, float, float), optional
        Force x, y [N] and moment about the center of mass [N m]; those of the scene where not given.
    tendons : {"retensioned", "locked"}, optional
        Those of the scene by default.
    displacement_limit : float or None, optional
        Greatest motion of the object, as a part of its size and in rad; finger tips may turn three times as much. None:
        no limit, which takes the first order at its word.
    response : GraspResponse, optional
        Of the same grasp, where it is at hand.
    """
    kind: Tendons = tendons or scene.disturbances.tendons
    given = np.asarray(scene.wrenches if wrenches is None else wrenches, dtype=float).reshape(-1, 3)
    response = response or GraspResponse(scene, arrays)
    count = len(given)
    if not response.stable(kind):
        return Resistance(given, np.zeros(count), (("unstable",),) * count, np.zeros((count, 3)), kind, False)
    limits = ResponseLimits(response, kind, math.inf if displacement_limit is None else displacement_limit)
    answers = [limits.greatest(wrench) for wrench in given]
    return Resistance(
        given,
        np.array([answer[0] for answer in answers]),
        tuple(answer[1] for answer in answers),
        np.array([answer[2] for answer in answers]).reshape(count, 3),
        kind,
        True,
    )


def resistance_polygon(
    scene: GraspScene,
    arrays: Mapping[str, Any],
    directions: int = 36,
    *,
    tendons: Tendons | None = None,
    displacement_limit: float | None = DISPLACEMENT_LIMIT,
    response: GraspResponse | None = None,
) -> Array:
    """Greatest pure forces at the center of mass that a grasp resists, in directions all round, shape (D, 2) [N].

    Parameters
    ----------
    scene, arrays, tendons, displacement_limit, response
        As in `resistance`.
    directions : int, optional
        Number D of directions, evenly spread from +x counter-clockwise.
    """
    turns = 2.0 * np.pi * np.arange(directions) / directions
    units = np.stack([np.cos(turns), np.sin(turns), np.zeros(directions)], axis=1)
    found = resistance(
        scene,
        arrays,
        wrenches=units.tolist(),
        tendons=tendons,
        displacement_limit=displacement_limit,
        response=response,
    )
    return np.asarray(found.factors[:, None] * units[:, :2])
