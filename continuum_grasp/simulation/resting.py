"""Find the shape at rest of a finger in a scene, with its history and with held motors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Actuation, LengthDrive, Load, MotorDrive, Scene
from continuum_grasp.simulation.friction_path import FrictionPath
from continuum_grasp.simulation.rest import EquilibriumSearch, LoadState, RestingShape
from continuum_grasp.simulation.signals import Signals

_NO_REST = (
    "without its drives the finger has no equilibrium: friction counts from the unloaded shape, as if weight, loads "
    "and tensions came together"
)


def rest_at(scene: Scene, model: FingerModel, *, at: float = 0.0, **search: Any) -> RestingShape:
    """Find a model's shape at rest under a scene's inputs and its own loads at an instant [s], time zero by default.

    If motors are held at ``initial.motor_angles``, tendons act as on winches that follow a length, with the backlash of
    the gear, and the input of the result balances the tensions without dry friction of the motors; SolverError if it
    exceeds their ``torque_max``.
    """
    angles = scene.initial.motor_angles
    if angles is None:
        signals, friction = Signals(scene, model), model.structure.friction_of(scene.initial)
        return rest_under(model, signals.u(at)[0], signals.w(at)[0], friction, **search)
    motors, finger = model.structure.motors, scene.finger.with_drives(_locked)
    wound = tuple(motor.radius * angle for motor, angle in zip(motors, angles, strict=True))
    # Chambers have their own pressures.
    pressures = scene.actuation.values[len(wound) :] if scene.actuation else (0.0,) * len(finger.chambers)
    held_at = wound if "lengths" in finger.input_keys else tuple(angles)
    actuation = Actuation.of(finger.input_keys, (*held_at, *pressures))
    same = scene.replaced(finger=finger, actuation=actuation, initial=scene.initial.replaced(motor_angles=None))
    solution = rest_at(same, model_at_rest(same, model, model.loads), **search)
    tensions = [] if solution.tensions is None else solution.tensions.tolist()
    held = solution.u.copy()  # moments that are inputs come after the drives
    for k, (motor, angle) in enumerate(zip(motors, angles, strict=True)):
        least, greatest = motor.holding([angle], [tensions[j] for j in motor.tendons], 0.0)
        if not math.isfinite(least + greatest):
            raise SolverError(
                "no equilibrium found",
                status="torque limit",
                violated=[f"motor {k + 1} does not balance its tendons at {angle:.4g} rad: {tensions} N"],
                advice="raise tendons.drive.torque_max, or let initial.motor_angles wind up less",
            )
        held[k] = 0.5 * (least + greatest)
    return replace(solution, model=model, u=held, p=np.array(model.p_nominal))


def model_at_rest(scene: Scene, model: FingerModel, loads: Sequence[Load]) -> FingerModel:
    """Return a model with the same elements for other loads, without rates of the inputs."""
    accuracy = model.structure.accuracy
    return FingerModel(
        scene, family=model.family, elements=model.lengths, accuracy=accuracy, loads=loads, input_rates=False
    )


def _locked(drive: Any) -> Any:
    """Return a winch that follows a length instead of a motor, or the held motor in front of its gear."""
    if drive.gear_stiffness is None:
        same = {key: getattr(drive, key) for key in ("arrangement", "pretension", "slack")}
        return LengthDrive(kind="length", time_constant=1.0, **same)  # of no effect at rest
    # A servo and a gear of twice the stiffness in series yield as much as the gear.
    stiffness = 2.0 * drive.gear_stiffness
    servo = drive.replaced(gear_stiffness=stiffness, position_gain=stiffness, rate_gain=0.0)
    return servo.unlimited()


def rest_under(
    model: FingerModel,
    u: ArrayLike,
    w: ArrayLike,
    history: Mapping[str, Any],
    *,
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
) -> RestingShape:
    """Find the shape at rest under constant input and forces; arguments are as in ``equilibrium_under``.

    ``history`` has ``reached_by``, ``friction_states`` and ``path`` if they are stated.
    """
    reached_by, path = history.get("reached_by", "pulling"), history.get("path", ())
    friction_states = history.get("friction_states")
    CheckedArgument("side", side).choice((1, -1))
    CheckedArgument("reached_by", reached_by).choice(("pulling", "releasing", "path", "state"))
    end = LoadState(CheckedArgument("u", u).array(), CheckedArgument("w", w).array(), np.array(model.p_nominal))
    start = None if guess is None else CheckedArgument("guess", guess).array()
    if start is not None and (start.shape != (model.n,) or not np.all(np.isfinite(start))):
        raise InputError(f"guess: expected {model.n} finite entries, got {start.tolist()}")
    states = np.array(() if friction_states is None else friction_states, dtype=float).ravel()
    count = len(model.friction_names)
    if count and reached_by == "state" and states.size != count:
        raise InputError(f"friction_states: expected {count} entries, got {states.tolist()}")
    if not count or reached_by == "state":
        friction = model.friction_history(np.zeros(model.n), end.u, end.p, reached_by, states)
        search = EquilibriumSearch(model, end, friction)
        return search.find(search.rest() if start is None else start, stable, side)
    idle = _idle(model, end)
    way = FrictionPath(model, idle, stable=stable, side=side)
    stages = [*(replace(end, u=_commanded(model, end.u, row)) for row in path), end]
    lost: tuple[str, ...] = ()
    if way.loaded and not np.array_equal(stages[0].u, idle.u):
        try:
            way.go(idle)
        except SolverError:
            lost = (_NO_REST,)
    for stage in stages[:-1]:
        way.go(stage)
    before = way.q
    found = way.go(end, start)
    if reached_by == "releasing":
        found = way.released(found, before)
    return replace(found, warnings=(*found.warnings, *lost))


def _commanded(model: FingerModel, u: Array, row: ArrayLike) -> Array:
    """Return an input with other commands of drives and chambers."""
    commands, count = CheckedArgument("path", row).array(), len(model.finger.inputs)
    if commands.shape != (count,) or not np.all(np.isfinite(commands)):
        raise InputError(f"path: expected rows of {count} finite entries, got {commands.tolist()}")
    return np.append(commands, u[count:])


def _idle(model: FingerModel, end: LoadState) -> LoadState:
    """Return the loads with idle drives: without tensions, pressures and torques.

    Position drives stand where the tendons of the unloaded shape have the tension or slack that the scene states for
    the straight finger.
    """
    u = end.u.copy()
    winches = model.structure.winches
    u[: len(model.finger.inputs)] = 0.0
    follow = [not isinstance(winch.drive, MotorDrive) or winch.drive.position_gain is not None for winch in winches]
    if any(follow):
        shapes = EquilibriumSearch(model, end, np.zeros(0)).rest(), model.structure.straight()
        at_rest, straight = (np.array(model.drives_at(q, u, pulled=0.0, p=end.p)) for q in shapes)
        first = len(model.structure.states["lag"])
        for k, (winch, follows) in enumerate(zip(winches, follow, strict=True)):
            u[k] = (at_rest - straight)[first] if follows else 0.0
            first += winch.states
    return replace(end, u=u)


def states_of_motors(model: FingerModel, drives: Array) -> list[Array]:
    """Return views of the motors' states, which come last in the states of all drives."""
    ends = np.cumsum([motor.states for motor in reversed(model.structure.motors)])
    return np.split(drives, len(drives) - ends[::-1])[1:]
