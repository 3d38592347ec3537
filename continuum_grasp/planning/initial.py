"""The state from which a plan begins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.planning.guess import Posture
from continuum_grasp.scene.loads import Actuation
from continuum_grasp.scene.plan import PlanScene
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.initial import initial_state

__all__ = ["first_state_of_plan"]

Array = NDArray[np.float64]


def first_state_of_plan(scene: PlanScene, model: Prediction) -> tuple[Array, Posture]:
    """State (nx) at time zero, under the input before the motion, and its posture.

    Raises
    ------
    InputError
        If ``initial.q`` or ``initial.qd`` has the wrong size.
    SolverError
        If an initial equilibrium is not found.
    """
    u, finger = scene.initial_input, model.system.finger_model
    held = Actuation(tip_moment=u[0]) if len(u) == 1 else Actuation(tensions=(u[0], u[1]))
    alone = Scene(
        schema_version=1,
        finger=scene.finger,
        gravity=scene.gravity,
        contacts=scene.contacts,
        fidelity=scene.fidelity,
        actuation=held,
        initial=scene.initial,
        loads=scene.loads,
    )
    start = initial_state(alone, finger)
    q, qd = start[: finger.n], start[finger.n : 2 * finger.n]
    x = model.at_rest(q, u)
    x[finger.n : 2 * finger.n] = qd
    return x, Posture(q, np.array(u))
