"""Equilibria of scenes and models, one by one and along a path of growing loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import check_arguments
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Consumer, Load, Scene
from continuum_grasp.simulation.friction_path import FrictionPath
from continuum_grasp.simulation.rest import LoadState
from continuum_grasp.simulation.resting import rest_at, rest_under
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.static_shape import Equilibrium

_STATICS = Consumer(
    "statics, modes",
    refused={"object": "statics and modes do not support contact: leave the object out"},
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        "name": "a title alone",
        "time": "inputs and loads are those at time zero",
        **dict.fromkeys(
            ("actuation.tensions.times", "actuation.tensions.interpolation", "loads.force.times"), "those at time zero"
        ),
        "parameters": "they have their nominal values",
        **{f"initial.{key}": "an equilibrium is sought" for key in ("pose", "q", "qd")},
        "initial.held_by": "released at time zero",
        **dict.fromkeys(
            ("finger.half_thickness", "finger.rod.samples.thickness"), "of contacts, and of the strain limit"
        ),
        "finger.damping.quadratic": "of rates alone, and smaller than small motions",
        "finger.damping.relaxation.time": "a finger at rest has relaxed; of small motions all or nothing has",
        "finger.rod.spirob.units": "the taper is the same, however it is cut",
        **Consumer.LIMITS_OF_COMMANDS,
        **{
            f"finger.{key}": "commands are reached"
            for key in (
                "tendons.time_constant",
                "tendons.drive_order",
                "tendons.drive.time_constant",
                "tendons.drive.rate_max",
                "pressure.time_constant",
            )
        },
        **{
            f"finger.tendons.drive.{key}": "of initial.motor_angles: other motors are where commands lead, or free"
            for key in ("viscous_friction", "coulomb_friction", "presliding_angle", "rate_gain", "torque_max")
        },
    },
)
_STOOD = "motors that stand at one angle have no path: command what they do in actuation"
_WHOLE = Consumer("statics of a given model", {"extra_loads": "the model has them among its loads"})
_PATH = Consumer("statics of a path", {"initial.motor_angles": _STOOD})


@check_arguments
def equilibrium_of(
    scene: Scene,
    *,
    extra_loads: Sequence[Load] = (),
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
    model: FingerModel | None = None,
) -> Equilibrium:
    """Find the equilibrium of a scene with its present elements; see `continuum_grasp.equilibrium`."""
    made = model_of_statics(scene, extra_loads, model)
    return Equilibrium.of(rest_at(scene, made, guess=guess, stable=stable, side=side), scene)


def model_of_statics(scene: Scene, extra_loads: Sequence[Load] = (), model: FingerModel | None = None) -> FingerModel:
    """Model of a scene at rest with further loads, or the given one; InputError where the scene does not fit."""
    _STATICS.check(scene)
    _WHOLE.check(scene, of={"extra_loads": bool(model is not None and extra_loads)})
    return model or FingerModel(scene, loads=(*scene.loads, *extra_loads), input_rates=False)


@check_arguments
def equilibrium_under(
    model: FingerModel,
    u: ArrayLike,
    w: ArrayLike,
    *,
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
    reached_by: str = "pulling",
    friction_states: ArrayLike | None = None,
    path: Sequence[ArrayLike] = (),
) -> Equilibrium:
    """Find the equilibrium of a model under constant input and forces.

    Parameters
    ----------
    model : FingerModel
        The model; parameters are nominal.
    u : (nu,) array_like
        Input.
    w : (nw,) array_like
        Forces.
    guess : (n,) array_like, optional
        Start coordinates of the search.
    stable : bool
        Whether to leave an unstable equilibrium for a stable one.
    side : {1, -1}
        Direction in which the search leaves it.
    reached_by : {"pulling", "releasing", "path", "state"}
        How a finger with friction came to this shape. ``pulling``: from its shape at rest under the forces, without
        drives, to this input. ``releasing``: all sections that slid have slid back from a greater pull. ``path``:
        through the inputs of ``path`` first. ``state``: with ``friction_states``.
    friction_states : array_like, optional
        Direction of friction, per cell, from -1 to 1, for ``state``.
    path : sequence of (K,) array_like
        Inputs of drives and chambers that come before this one, in order, for ``path``.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.simulation import equilibrium_under
    >>> finger = cg.Finger(rod=cg.Rod(length=0.2, linear_density=0.02, bending_stiffness=0.01))
    >>> model = cg.FingerModel(finger, family="arc", elements=1, gravity=(0.0, 0.0), tip_force=False)
    >>> equilibrium_under(model, [0.05], []).q.round(6).tolist()  # bend = moment L / EI [rad]
    [1.0]
    """
    history = {"reached_by": reached_by, "friction_states": friction_states, "path": path}
    return Equilibrium.of(rest_under(model, u, w, history, guess=guess, stable=stable, side=side))


@check_arguments
def equilibrium_path(scene: Scene, factors: Sequence[float], *, side: int = 1) -> list[Equilibrium]:
    """Equilibria while gravity, input and loads grow together.

    Each starts from the one before; where the straight path loses its stability, the buckled one is followed. Friction,
    of tendons or in bending, begins with none in the unloaded shape and remembers the whole path, so that factors that
    turn back give loops.

    Parameters
    ----------
    scene : Scene
        The scene whose loads at time zero are scaled.
    factors : sequence of float
        Scales, in order.
    side : {1, -1}
        Direction in which the search leaves an unstable equilibrium.

    Returns
    -------
    list of Equilibrium

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.simulation import equilibrium_path
    >>> scene = cg.load("configs/simulate/hanging.yaml")
    >>> [found.stable for found in equilibrium_path(scene, [0.5, 1.0])]
    [True, True]
    """
    _PATH.check(scene)
    names = tuple(dict.fromkeys((*scene.parameters, "gravity")))
    model = FingerModel(scene, parameters=names, input_rates=False)
    signals = Signals(scene, model)
    u = signals.u(0.0)[0]
    w = signals.w(0.0)[0]
    p = np.array(model.p_nominal)
    gravity = [k for k, label in enumerate(model.p_names) if label.startswith("gravity_")]

    def scaled(factor: float) -> LoadState:
        parameters = p.copy()
        parameters[gravity] *= factor
        return LoadState(factor * u, factor * w, parameters)

    path = FrictionPath(model, scaled(0.0), side=side)
    return [Equilibrium.of(path.go(scaled(factor))) for factor in factors]
