"""The state of a controller's model in the scene's initial pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.loads import ForceLoad
from continuum_grasp.simulation.statics import equilibrium_under

Array = NDArray[np.float64]


def rest_input(scene: ControlScene) -> Array:
    """Return the least tensions, or no moment (nu)."""
    tendons = scene.finger.tendons
    return np.zeros(1) if tendons is None else np.full(2, tendons.min_tension)


def first_state(scene: ControlScene, model: Prediction) -> Array:
    """Compute the state (nx) of the scene's initial pose at rest, under ``rest_input``.

    ``initial.q`` belongs to the plant's model. It is used where the controller's model has as many coordinates;
    otherwise the state is that of the unloaded shape.

    Returns
    -------
    (nx,) ndarray

    Raises
    ------
    SolverError
        If an initial equilibrium is not found.
    """
    finger, initial = model.system.finger_model, scene.initial
    x = model.at_rest(_shape(scene, model), rest_input(scene))
    if initial.q is not None and initial.qd is not None and len(initial.q) == len(initial.qd) == finger.n:
        x[finger.n : 2 * finger.n] = initial.qd
    return x


def _shape(scene: ControlScene, model: Prediction) -> Array:
    finger, initial = model.system.finger_model, scene.initial
    if initial.q is not None and len(initial.q) == finger.n:
        return np.array(initial.q)
    held = initial.pose == "equilibrium"
    if initial.pose == "straight" or not (held or scene.finger.rest_curvature != 0.0):
        return np.zeros(finger.n)
    loads = initial.held_by if held else ()
    alone = FingerModel(
        scene.finger,
        family=finger.family,
        elements=finger.lengths,
        accuracy=finger.structure.accuracy,
        bending_range=scene.fidelity.bending_range,
        contacts=scene.contacts,
        gravity=scene.gravity if held else (0.0, 0.0),
        loads=loads,
        tip_force=bool(scene.contacts),
        input_rates=False,
    )
    given = {"u": np.zeros(alone.nu), "w": np.zeros(alone.nw)}
    for load, (vector, start) in zip(loads, alone.load_entries, strict=True):
        value = np.atleast_1d(np.asarray(load.force if isinstance(load, ForceLoad) else load.moment, dtype=float))
        given[vector][start : start + value.size] = value
    return np.array(equilibrium_under(alone, given["u"], given["w"]).q)
