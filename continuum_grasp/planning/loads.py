"""Parameters of a plan's model over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene.plan import PlanScene
from continuum_grasp.simulation.signals import interpolate

__all__ = ["parameters_over_time"]

Array = NDArray[np.float64]


def parameters_over_time(scene: PlanScene, model: Prediction, times: ArrayLike) -> Array:
    """Parameters (len(times), np) of the model at instants [s]: nominal ones, and the known forces."""
    instants, length = np.atleast_1d(np.asarray(times, dtype=float)), scene.finger.rod.length
    p = np.tile(np.array(model.p_nominal, dtype=float), (len(instants), 1))
    names = list(model.p_names)
    for load in scene.loads:
        place = [k for k, at in enumerate(scene.contacts) if abs(at - load.at) <= 1e-9 * length]
        start = names.index(f"contact_{place[0] + 1}_x [N]" if place else "tip_x [N]")
        force = load.force
        p[:, start : start + 2] += np.array(force) if isinstance(force, tuple) else interpolate(force, instants)[0]
    return p
