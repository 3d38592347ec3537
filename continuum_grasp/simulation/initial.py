"""Start state of a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Array, check_arguments
from continuum_grasp.model import FingerModel, Memory, System
from continuum_grasp.scene import Scene
from continuum_grasp.simulation.resting import model_at_rest, rest_at, states_of_motors
from continuum_grasp.simulation.signals import Signals


@check_arguments
def initial_state(scene: Scene, model: FingerModel | System) -> Array:
    """State of a scene at time zero; an object is at rest, and contacts have no friction yet.

    Parameters
    ----------
    scene : Scene
        The scene. An initial equilibrium is taken of the finger alone.
    model : FingerModel or System
        Its model.

    Returns
    -------
    (nx,) ndarray

    Raises
    ------
    InputError
        If ``initial.q`` or ``initial.qd`` has the wrong size.
    SolverError
        If an initial equilibrium is not found.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.simulation import initial_state
    >>> scene = cg.load("configs/simulate/hanging.yaml")
    >>> model = cg.FingerModel(scene)
    >>> initial_state(scene, model).shape == (model.nx,)
    True
    """
    if isinstance(model, System):
        finger_state = initial_state(scene, model.finger_model)
        return np.concatenate([finger_state, model.state()[len(finger_state) :]])
    signals = Signals(scene, model)
    u = signals.u(0.0)[0]
    initial, n = scene.initial, model.n
    q, qd = np.zeros(n), np.zeros(n)
    stands, rest = np.zeros(0), None
    if initial.q is not None:
        model.structure.check_initial(initial)
        q = np.array(initial.q, dtype=float)
        qd = np.zeros(n) if initial.qd is None else np.array(initial.qd, dtype=float)
    elif initial.pose == "equilibrium":
        # A model may have other friction cells than the scene.
        own = scene.replaced(finger=model.finger)
        rest = rest_at(own, model_at_rest(own, model, (*scene.loads, *initial.held_by)))
        q, stands = rest.q, rest.u[: len(initial.motor_angles or ())]
    elif initial.pose == "straight":
        q = model.structure.straight()
    # Drives have reached their commands at time zero, so they cause no motion.
    p = np.array(model.p_nominal)
    if rest is not None:
        ways = rest.friction_states
    else:
        # Coordinates, or the unloaded or straight shape, without loads that hold them: as if bent there by hand.
        history = model.friction_history(q, u, p, **model.structure.friction_of(initial, needed=False))
        ways = model.friction_after(q, u, p, history)
    at_rest = np.concatenate([stands, u[stands.size :]])
    drives = np.array(model.drives_at(q, at_rest, ways))
    if stands.size:
        drives = _standing(model, drives, initial.motor_angles or (), at_rest, u)
    # Tendon friction of a motion acts by another function of its states than that at rest.
    count = model.structure.tendon_friction_states
    return np.concatenate([q, qd, drives, Memory.state_of(ways[:count]), ways[count:]])


def _standing(model: FingerModel, drives: Array, angles: Sequence[float], at_rest: Array, u: Array) -> Array:
    """Return the states of motors at angles [rad] under a command ``u``, while ``at_rest`` balances the tensions.

    The dry friction of the motors bears the difference up to its limit.
    """
    standing = drives.copy()
    for k, (motor, states) in enumerate(zip(model.structure.motors, states_of_motors(model, standing), strict=True)):
        states[0] = angles[k]
        if motor.drive.presliding_angle is not None:
            torque, needed = (float(motor.torque(command, angles[k])) for command in (u[k], at_rest[k]))
            states[2:3] = Memory.state_of(np.clip([(torque - needed) / motor.drive.coulomb_friction], -1.0, 1.0))
    return standing
