"""Friction of a finger of a grasp: of its tendons, and dry friction in bending, with the states of both."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.bending import DryBending
from continuum_grasp.grasp.certificate.tendons import TendonFriction
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

Array = NDArray[Any]


def friction_of(
    setup: FingerSetup, shape: FingerShape, states: Array | None = None
) -> tuple[TendonFriction | None, DryBending | None]:
    """Friction of the tendons and in bending, None where there is none; ``states`` (K,) are those of the tendons, then
    those of the bending, None: of a finger that was pulled from its shape at rest on.
    """
    count = setup.tendon_friction_states
    of_tendons, of_bending = (None, None) if states is None else (states[:count], states[count:])
    tendons = TendonFriction(setup, shape, of_tendons) if count else None
    return tendons, DryBending(setup, shape, of_bending) if setup.bending_cells else None


def pulled_states(setup: FingerSetup, shape: FingerShape) -> Array:
    """States (K,) of a finger that was pulled from its shape at rest on."""
    return np.concatenate([one.pulled for one in friction_of(setup, shape) if one is not None] or [np.zeros(0)])


def state_cells(scene: GraspScene) -> list[NDArray[np.bool_]]:
    """Which friction states (K,) of all fingers turn together: of one cell of the tendons, or all branches of one cell
    in bending.
    """
    cells: list[list[int]] = []
    for setup in (setup for setup in scene.setups if setup.name in scene.state_columns):
        columns = scene.state_columns[setup.name]
        bending = columns.start + setup.tendon_friction_states
        branches = max(len(setup.finger.damping.dry_friction), 1)
        cells += [[k] for k in range(columns.start, bending)]
        cells += [[*range(k, k + branches)] for k in range(bending, columns.stop, branches)]
    size = max((columns.stop for columns in scene.state_columns.values()), default=0)
    return [np.isin(np.arange(size), cell) for cell in cells]
