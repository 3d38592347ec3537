"""What is measured of a plant: noisy, late, and only that."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.controller import Measured

Array = NDArray[np.float64]

_PER_ELEMENT = 4
"""Sections of each element of the coarse model whose angles are compared."""


class Sensors:
    """Measurements of a plant.

    Parameters
    ----------
    scene : ControlScene
        Its ``estimator.measured`` says what is measured and how well, ``plant`` how noisy and how late. Without an
        estimator the controller is given its state, exactly: the one whose section angles and their rates are nearest
        to the plant's, four sections to an element.
    seed : int, optional
        Of the noise; ``plant.seed`` of the scene where not given.

    Attributes
    ----------
    names : tuple of str
        Name and unit of each measured number.
    delay : float
        Age of measurements when they arrive [s].
    std : (ny,) ndarray
        Standard deviation of each one's noise.
    """

    def __init__(self, scene: ControlScene, plant: PlantModel, prediction: Prediction, seed: int | None = None) -> None:
        self._rng = np.random.default_rng(scene.plant.seed if seed is None else seed)
        self.delay, self.std = 0.0, np.zeros(0)
        if scene.estimator is None:
            self.names: tuple[str, ...] = prediction.x_names
            self.std = np.zeros(len(self.names))
            self._value = plant.function("state", y=_nearest_state(plant, prediction))
            return
        estimator = scene.estimator
        self.delay = estimator.delay if scene.plant.delay is None else scene.plant.delay
        self.names, values, std = _measured(estimator.measured, plant)
        self.std = scene.plant.noise * np.array(std)
        self._value = plant.function("measured", y=ca.vertcat(*values))

    def exact(self, x: Array, u: Array, w: Array) -> Array:
        """What sensors without noise show in a state (ny)."""
        return np.array(self._value(x, u, w)).ravel()

    def read(self, x: Array, u: Array, w: Array) -> Array:
        """A measurement (ny) of a state, with noise."""
        return self.exact(x, u, w) + self.std * self._rng.standard_normal(len(self.std))


def _measured(measured: Measured, plant: PlantModel) -> tuple[tuple[str, ...], list[ca.SX], list[float]]:
    """Names, expressions and standard deviations."""
    names: list[str] = []
    values: list[ca.SX] = []
    std: list[float] = []
    if measured.tip is not None:
        names += ["tip_x [m]", "tip_y [m]"]
        values.append(plant.tip)
        std += [measured.tip] * 2
    if measured.tension is not None:
        names += list(plant.u_names)
        values.append(plant.drive)
        std += [measured.tension] * plant.nu
    if measured.bending is not None:
        at = measured.bending.at
        names += [f"angle_{k + 1} [rad]" for k in range(len(at))]
        values.append(plant.sections(at)[1])
        std += [measured.bending.std] * len(at)
    return tuple(names), values, std


def _nearest_state(plant: PlantModel, prediction: Prediction) -> ca.SX:
    """A controller's state (nx) as an expression of the plant's ``arguments``.

    Angles of sections are affine in the bending coordinates, so that coordinates and rates are linear least squares
    of them; all other states (drive, object) are those of the plant.

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
