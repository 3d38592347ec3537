"""The state of a coarse model that is nearest to that of a plant."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.control.prediction import Prediction

__all__ = ["nearest_state"]

_PER_ELEMENT = 4
"""Sections of each element of the coarse model whose angles are compared."""


def nearest_state(plant: PlantModel, prediction: Prediction) -> ca.SX:
    """A controller's state (nx) as an expression of the plant's ``arguments``.

    Angles of sections are affine in the bending coordinates, so that coordinates and rates are linear least squares
    of them; all other states (drive, object) are those of the plant.

    Parameters
    ----------
    plant : PlantModel
    prediction : Prediction
        The controller's model.

    Returns
    -------
    casadi.SX
        Exact where the plant's shapes are among those of the controller's model.
    """
    n, length = prediction.system.n, plant.scene.finger.rod.length
    edges = np.cumsum([0.0, *prediction.system.finger_model.lengths])
    parts = [np.linspace(a, b, _PER_ELEMENT + 1)[1:] for a, b in pairwise(edges)]
    at = tuple(float(s) for s in np.minimum(np.concatenate(parts), length))
    angles = _angles(prediction, at)
    own = plant.named_states
    others = [own[name] for name in prediction.x_names[2 * n :]]
    offset, rate = angles(ca.vertcat(ca.SX(2 * n, 1), *others))
    straight = np.array(angles(np.zeros(prediction.nx))[0])
    units = np.eye(prediction.nx)[:n]
    inverse = ca.DM(np.linalg.pinv(np.hstack([np.array(angles(e)[0]) - straight for e in units])))
    q = ca.mtimes(inverse, plant.sections(at)[1] - offset)
    qd = ca.mtimes(inverse, plant.angle_rates(at) - rate)
    return ca.vertcat(q, qd, *others)


def _angles(model: Prediction, at: tuple[float, ...]) -> ca.Function:
    """Angles of sections and their rates, from the state alone."""
    angle = model.sections(at)(model.x, model.u, model.p)[1]
    rate = ca.jtimes(angle, model.x, model.dynamics(model.x, model.u, model.p))
    full = ca.Function("angles", [model.x, model.u, model.p], [angle, rate])
    x = ca.SX.sym("x", model.nx)
    values = full.call([x, ca.SX(ca.DM.zeros(model.nu)), ca.SX(ca.DM(model.p_nominal))])
    found: ca.Function = ca.Function("angles", [x], values)
    return found
