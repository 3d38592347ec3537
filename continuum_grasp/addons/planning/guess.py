"""Starts of the search for a plan: the first state, a posture that meets the goal (of a grasp too), smooth paths."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.addons.planning.goal import GoalPart
from continuum_grasp.addons.planning.motion import PlannedMotion, objective_scale
from continuum_grasp.addons.planning.scene import PlanScene, RowAim
from continuum_grasp.base import Array, InputError, Interrupted, SolverError
from continuum_grasp.control import Prediction
from continuum_grasp.scene import GraspScene

_ITERATIONS = 60
"""Most steps of the least squares for the final posture [1]; the plan's solver closes what they leave."""
_BALANCE, _BALANCE_HELD = 0.1, 10.0
"""Weight of balance relative to the goal's in the final posture: little, unless the plan has to end in balance."""
_GRASPED = 26.7
"""Cost of half the squared error of the contact forces of a grasp, per its greatest force and per the scale of the
objective [1]: elements of a plan need not reach them."""
_PRESSED = 0.25
"""Share of the greatest force of a grasp within which its forces count as reached [1]. A finger at rest has one moment,
by which it presses soft pads in two places in another ratio than the grasp presses rigid ones: the best of
configs/plan/close_on_mug.yaml is 0.12 off."""


@dataclass(frozen=True)
class Posture:
    """Coordinates q (n) and input u (nu) at rest."""

    q: Array
    u: Array


@dataclass(frozen=True)
class Path:
    """States x (N + 1, nx), inputs u (N + 1, nu) and the duration [s]."""

    x: Array
    u: Array
    duration: float


def final_postures(
    motion: PlannedMotion, goal: list[GoalPart], first: Posture, near: Posture | None = None
) -> list[Posture]:
    """Postures at rest and nearly in balance that meet the goal as well as may be, near the first one or the hint; the
    best one comes first.
    """
    if all(part.at_rest for part in goal):
        return [first]
    n = len(first.q)
    reach = motion.reach
    residual = _residual(motion, goal, first)
    # Coordinates may leave the range of the sample shapes, which reach half the bending range.
    low, high = (
        np.concatenate([np.full(n, side), np.array(limit) / motion.scales.u])
        for side, limit in zip((-2.0, 2.0), motion.scene.input_limits, strict=True)
    )
    starts = [near] if near else [Posture(first.q + side * reach, first.u) for side in (0.0, 0.5, -0.5)]
    points = [np.concatenate([start.q / reach, start.u / motion.scales.u]) for start in starts]
    solutions = [_least_squares(residual, np.clip(y, low, high), low, high) for y in points]
    # A later start has to be clearly better: the first one is nearest.
    best = reduce(lambda best, new: new if new[0] < 0.9 * best[0] else best, solutions)
    ordered = [best, *(other for other in solutions if other is not best)]
    return [Posture(y[:n] * reach, y[n:] * motion.scales.u) for _, y in ordered]


def _with_bends(model: Prediction, first: Posture, bends: Array) -> Array:
    """Coordinates nearest to the first ones with other bending angles."""
    n = len(first.q)

    def bending(q: Array) -> Array:
        return np.array(model.bending(model.at_rest(q, first.u), first.u, model.p_nominal)).ravel()

    # Bends are linear in the coordinates.
    slope = np.array([bending(first.q + e) - bending(first.q) for e in np.eye(n)]).T
    return np.asarray(first.q + np.linalg.lstsq(slope, bends - bending(first.q), rcond=None)[0])


def _residual(motion: PlannedMotion, goal: list[GoalPart], first: Posture) -> ca.Function:
    """(y = scaled [q, u]) -> errors of the goal and of balance, and their Jacobian."""
    model = _without_play(motion.prediction, motion.scene)
    n = len(first.q)
    reach = motion.reach
    y = ca.SX.sym("y", n + motion.nu)
    q = y[:n] * ca.DM(reach)
    u = y[n:] * ca.DM(motion.scales.u)
    # A state at rest is affine in q and u, but for motors.
    base = model.at_rest(np.zeros(n), np.zeros(motion.nu))
    by_q = np.array([model.at_rest(e, np.zeros(motion.nu)) - base for e in np.eye(n)]).T
    by_u = np.array([model.at_rest(np.zeros(n), e) - base for e in np.eye(motion.nu)]).T
    x = _driven(model, ca.DM(base) + ca.mtimes(ca.DM(by_q), q) + ca.mtimes(ca.DM(by_u), u), q, u)
    s = x / ca.DM(motion.scales.x)
    if motion.linear:
        s = ca.vertcat(s, y[n:])
    numbers = ca.DM(motion.numbers([1.0]).ravel())
    p = numbers[: model.np]
    errors = []
    for part in goal:
        if part.key == "goal.contact_force":
            errors.append((_spring_forces(motion, x, u, p) - ca.DM(part.target)) / ca.DM(part.scale))
        elif not part.at_rest:
            errors.append(part.rows(motion).value(ca.vertcat(s, y[n:]), numbers))
    # Accelerations, per that of an oscillation over the reach whose period is the duration.
    frequency = 2.0 * np.pi / motion.first_duration
    rate = model.dynamics(x, u, p)[n : 2 * n] / ca.DM(reach * frequency**2)
    held = any(part.name == "held" for part in goal)
    least = motion.scene.least_tension
    if least > 0.0:
        # A tendon that is slack has no slopes, and a motor under a torque runs away from it.
        # 10.0: weight of tensions that are missing, per the least one
        errors.append(10.0 * ca.fmax(1.0 - model.tensions(x, u, p) / least, 0.0))
    away = y - ca.DM([*(first.q / reach), *(first.u / motion.scales.u)])
    # 1e-3: weight of what leaves the posture open: little, so that it decides nothing else
    residual = ca.vertcat(*errors, rate * (_BALANCE_HELD if held else _BALANCE), 1e-3 * away)
    return ca.Function("residual", [y], [residual, ca.jacobian(residual, y)])


def _without_play(model: Prediction, scene: PlanScene) -> Prediction:
    """The model with rigid gears: within a play the finger feels nothing of an input, which leaves no slopes."""
    if not any(motor.gear for motor in model.system.finger_model.structure.motors):
        return model
    drive = scene.finger.winches[0].replaced(backlash=0.0, gear_stiffness=None)
    return Prediction(scene.replaced(finger=scene.finger.with_tendons(drive=drive)))


def _driven(model: Prediction, x: ca.SX, q: ca.SX, u: ca.SX) -> ca.SX:
    """States with winches and motors as they are at rest."""
    finger = model.system.finger_model
    if not finger.structure.winches:
        return x
    inputs = ca.vertcat(u, ca.SX.zeros(finger.nu - u.numel()))
    # Of tendons that have not slid.
    history = [ca.SX.zeros(len(finger.friction_names) + 1)] if finger.friction_names else []
    drives = finger.drives_at_rest()(q, inputs, finger.p_nominal, *history)
    x[2 * finger.n : 2 * finger.n + drives.numel()] = drives
    return x


def _spring_forces(motion: PlannedMotion, x: ca.SX, u: ca.SX, p: ca.DM) -> ca.SX:
    """Contact forces as if surfaces that are apart pulled: they point to where they touch."""
    model = motion.prediction
    law = motion.scene.contact_law
    gap = ca.Function("gap", [model.x, model.u, model.p], [model.system.touch(*model.arguments)[0]])(x, u, p)
    return -(law.stiffness if law is not None else 0.0) * gap[: len(model.contact_names)]


def _least_squares(residual: ca.Function, y: Array, low: Array, high: Array) -> tuple[float, Array]:
    """Levenberg and Marquardt, clipped to the bounds: half the sum of squares and where.

    Not scipy's ``least_squares``, since starts are part of what makes a plan repeatable to the last bit.
    """
    damping = 1e-2
    r, jacobian = (np.array(v) for v in residual(y))
    value = 0.5 * float((r * r).sum())
    for _ in range(_ITERATIONS):
        normal = jacobian.T @ jacobian
        least = 1e-12 * float(np.trace(normal))  # what rounding leaves of a singular matrix
        step = np.linalg.solve(normal + max(damping, least) * np.eye(len(y)), -jacobian.T @ r).ravel()
        trial = np.clip(y + step, low, high)
        r_new, jacobian_new = (np.array(v) for v in residual(trial))
        new = 0.5 * float((r_new * r_new).sum())
        if np.isfinite(new) and new < value:
            done = value - new < 1e-10 * value
            y = trial
            r = r_new
            jacobian = jacobian_new
            value = new
            damping = damping / 3.0
            if done:
                break
        else:
            damping *= 4.0
            if damping > 1e8:  # a step this short changes nothing
                break
    return value, y


def smooth_path(
    motion: PlannedMotion, x0: Array, first: Posture, last: Posture, side: float = 0.0, share: float = 1.0
) -> Path:
    """Postures that go smoothly from the first to the last in a share of the duration, and stay there.

    They are bent to a ``side`` in between, by half bending ranges.
    """
    model = motion.prediction
    n = len(first.q)
    time = share * motion.first_duration
    tau = np.minimum(np.linspace(0.0, 1.0 / share, motion.scene.intervals + 1), 1.0)[:, None]
    # The quintic with neither rate nor acceleration at both ends, and its derivative.
    blend = tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
    rate = 30.0 * tau**2 * (1.0 - tau) ** 2
    reach = motion.reach / 2.0
    bump = side * reach * np.sin(np.pi * tau) ** 2
    q = first.q + blend * (last.q - first.q) + bump
    qd = (rate * (last.q - first.q) + side * reach * np.pi * np.sin(2.0 * np.pi * tau)) / time
    u = first.u + blend * (last.u - first.u)
    x = np.array([model.at_rest(*row) for row in zip(q, u, strict=True)])
    x[:, n : 2 * n] += qd
    x[0] = x0
    return Path(x, u, motion.first_duration)


def first_state_of_plan(scene: PlanScene, model: Prediction) -> tuple[Array, Posture]:
    """State (nx) at time zero, under the input before the motion, and its posture. Raises what `initial_state` does."""
    u = scene.initial_input
    n = model.system.finger_model.n
    x = model.start_state(scene.initial, u, scene.loads)
    return x, Posture(x[:n], np.array(u))


def closing(scene: PlanScene, given: Any = None) -> tuple[PlanScene, Posture | None]:
    """A copy of the plan with the goal of its grasp, and the posture there; a plan without a grasp as it is.

    ``given`` is the grasp, or its run folder, where it was found already.
    Raises a SolverError where there is no verified grasp, and an InputError where it does not fit the plan.
    """
    if scene.grasp is None:
        if given is not None:
            raise InputError("the plan has no grasp to carry out", key="grasp")
        return scene, None
    name = scene.grasp.setups[0].name
    data = _arrays(scene.grasp, given)
    if f"{name}.backbone" not in data or "object.pose" not in data:
        raise InputError(f"expected the grasp of a finger called {name!r}", key="grasp")
    touching = zip(data["contact_names"], data["contact_stations"], data["contact_forces"], strict=True)
    of_finger = {str(contact): (float(station), float(force[0])) for contact, station, force in touching}
    tip = of_finger.pop(f"{name}.tip", (0.0, 0.0))[1]
    middle = sorted(place for contact, place in of_finger.items() if contact.startswith(f"{name}."))
    backbone = data[f"{name}.backbone"]
    base = data[f"{name}.base"].tolist()
    pose = data["object.pose"].tolist()
    forces = (*(force for _, force in middle), tip)
    rod = scene.finger.rod
    greatest = max(rod.least_force, *forces)
    aim = RowAim(value=forces, weight=_GRASPED * objective_scale(scene) / greatest**2, tolerance=_PRESSED * greatest)
    closed = scene.replaced(
        grasp=None,
        finger=scene.finger.replaced(base={"position": tuple(base[:2]), "angle": base[2]}),
        object=scene.object and scene.object.moved_to(tuple(pose)),
        contacts=tuple(at for at, _ in middle),
        goal=scene.goal.model_copy(update={"contact_force": aim}),
    )
    # Bending angles of the plan's elements, whose ends are not the stations of the grasp.
    model = Prediction(closed)
    edges = np.cumsum([0.0, *model.system.finger_model.lengths])
    bends = np.diff(np.interp(edges, backbone[:, 0], np.unwrap(backbone[:, 3])))
    q = _with_bends(model, first_state_of_plan(closed, model)[1], bends)
    return closed, Posture(q, np.clip(data[f"{name}.tensions"], *closed.input_limits))


def _arrays(grasp: GraspScene, given: Any) -> Mapping[str, Any]:
    """Arrays of the grasp, which is optimized where it is not given."""
    from continuum_grasp.grasp import GraspResult, optimize_grasp

    if isinstance(given, (str, os.PathLike)):
        run = GraspResult.read(given)
        if run.meta.get("status") not in ("optimal", "feasible"):
            raise InputError("there is no verified grasp in this folder", file=os.fspath(given))
        return run.arrays
    result = optimize_grasp(grasp, raise_on_failure=False) if given is None else given
    if given is None and result.statistics["interrupted"]:
        raise Interrupted("interrupted while the grasp was optimized")
    if not result.solved:
        raise SolverError("no grasp to close to", status=str(result.status), advice=result.advice, result=result)
    arrays: Mapping[str, Any] = result.arrays
    return arrays
