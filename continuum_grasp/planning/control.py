"""The scene of a plan as that of a controller: where models, bounds and set-points are made."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.controller import Controller, Horizon, InputLimits
from continuum_grasp.scene.cost import Cost, Reference
from continuum_grasp.scene.estimator import Disturbed, Estimator, Measured
from continuum_grasp.scene.plan import PlanScene
from continuum_grasp.scene.surroundings import Surroundings
from continuum_grasp.simulation.signals import interpolate

__all__ = ["control_scene", "parameters_over_time"]

Array = NDArray[np.float64]


def control_scene(scene: PlanScene) -> ControlScene:
    """A controller's scene with the model, the bounds of the state and the cost of a plan.

    Limits of the input's rate and its price are left out: their rows depend on the duration.
    """
    cost, reference = Cost.model_validate({"bending": 1.0, "effort": 1.0}), Reference()
    if scene.cost is not None:
        cost = scene.cost.model_copy(update={"input_rate": None})
        reference = scene.reference
    limits = InputLimits(moment_max=scene.input.moment_max, time_constant=scene.input.time_constant)
    pushed_tip = bool(scene.loads) and not scene.contacts
    measured = Measured(tip=1e-3)
    around = {name: getattr(scene, name) for name in Surroundings.model_fields}
    return ControlScene(
        schema_version=1,
        finger=scene.finger,
        gravity=scene.gravity,
        contacts=scene.contacts,
        fidelity=scene.fidelity,
        parameters=scene.parameters,
        controller=Controller(horizon=Horizon(stages=2, substeps=1), cost=cost, input=limits, bounds=scene.bounds),
        reference=reference,
        # A force at the tip is a parameter of the model where it is to be estimated.
        estimator=Estimator(measured=measured, disturbances=Disturbed(tip_force=1.0)) if pushed_tip else None,
        initial=scene.initial,
        **around,
    )


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
