"""A controller and a plant in closed loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from time import perf_counter
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp import interrupt
from continuum_grasp.arguments import check_arguments
from continuum_grasp.closed_loop.plant import Plant
from continuum_grasp.closed_loop.readings import Readings
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.schedule import Phase, Schedule
from continuum_grasp.control.controller import Controller
from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.setpoints import Function, setpoints
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import InputError, Interrupted, NumericalError
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.load import scene_of

Array = NDArray[np.float64]


_CHECKED = 50
"""Periods that are integrated again with steps half as long [1]; their cost does not grow with the run."""


@runtime_checkable
class Controls(Protocol):
    """A controller, as a closed loop sees it: problem, model, and time from one command to the next [s]."""

    @property
    def stages(self) -> Stages: ...
    @property
    def prediction(self) -> Prediction: ...
    @property
    def period(self) -> float: ...
    @property
    def estimated_names(self) -> tuple[str, ...]: ...
    @property
    def statistics(self) -> Mapping[str, Any]: ...
    def step(self, measurement: Array, reference: Array, *, p: Array | None = None) -> Any:
        """Return the command for a measurement (ny) and setpoints (N + 1, nr)."""

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Start again, from a state (nx) and an input (nu)."""


class _Step(NamedTuple):
    """A period: measurement, setpoints and parameters at its start, the command, the plant's state at its end."""

    y: Array
    r: Array
    p: Array
    command: Any
    x: Array


@interrupt.listening()
@check_arguments
def run_closed_loop(
    scene: ControlScene | str | PathLike[str],
    *,
    controller: Controls | None = None,
    plant: Plant | None = None,
    functions: Mapping[str, Function] | None = None,
    schedule: Sequence[Phase] | None = None,
    progress: Callable[[float], None] | None = None,
) -> ControlRun:
    """Let a controller move a plant.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, with a ``duration``, or its YAML file.
    controller : Controls, optional
        A controller of that scene, which is reset first; where not given, a new ``Controller`` without a deadline, so
        that a run does not depend on how busy the machine is. What would have been late is counted all the same.
    plant : Plant, optional
        A plant at its start; that of the scene where not given.
    functions : mapping of str to callable, optional
        Functions of time in place of references of the scene; see ``setpoints``.
    schedule : sequence of Phase, optional
        Phases in place of the scene's reference; the loop ends with the last one, or after the ``duration`` if that is
        sooner.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    ControlRun

    Raises
    ------
    InputError
        If the scene has no duration and nothing else ends the loop, or pieces do not fit.
    NumericalError
        If the plant's motion does not stay finite; ``result`` is the run until then.
    Interrupted
        On Ctrl-C; ``result`` is the run until then.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> scene = cg.load("configs/mpc/steady_tip.yaml", ["fidelity.family=arc", "duration=0.1"])
    >>> run = cg.run_closed_loop(scene)
    >>> round(float(run.t[-1]), 3), run.u.shape  # s; two tendon tensions per period [N]
    (0.1, (10, 2))
    """
    scene = scene_of(scene, ControlScene)
    began = perf_counter()
    control: Controls = Controller(scene, deadline=math.inf) if controller is None else controller
    model = control.prediction
    tried = Plant(scene, model, control.period) if plant is None else plant
    if schedule is None:
        schedule = [Phase("run", setpoints(Outputs.of(scene.controller.cost, model), scene.reference, functions).rows)]
    plan = Schedule(schedule)
    duration = min(plan.duration, scene.duration or np.inf)
    if not np.isfinite(duration):
        raise InputError("a closed loop needs a duration [s]", key="duration")
    control.reset(u=tried.model.rest_input)
    made_s = perf_counter() - began
    steps: list[_Step] = []
    first = tried.t, tried.x
    error = _loop(control, tried, plan, steps, round(duration / control.period), progress or (lambda share: None))
    with interrupt.held(quietly=True) as pressed:
        run = _result(scene, control, tried, plan, first, steps, error is None, made_s)
    if pressed() and error is None:
        error = Interrupted("interrupted after the end of the run")
    if isinstance(error, Interrupted):
        raise Interrupted(str(error), result=run) from error
    if error is not None:
        raise NumericalError(str(error), time=error.time, state=error.state, result=run) from error
    return run


def _loop(
    control: Controls, plant: Plant, plan: Schedule, done: list[_Step], steps: int, progress: Callable[[float], None]
) -> NumericalError | Interrupted | None:
    """Run until the end, or until what stopped it."""
    stages = control.stages
    ahead = np.asarray(stages.stage * np.arange(stages.stages + 1), dtype=float)
    plan.enter(plant.t, control, plant)
    try:
        for k in range(steps):
            reference, measured, p = plan.rows(plant.t + ahead), plant.measure(), plan.phase.p
            command = control.step(measured, reference, p=p)
            states = plant.advance(command.u)
            # The period is recorded at once and whole, wherever an interruption falls.
            done.append(_Step(measured, reference[0], stages.p_nominal if p is None else p, command, states[-1]))
            progress((k + 1) / steps)
            if not plan.advance(plant.t, control, plant, command):
                break
    except KeyboardInterrupt:
        return Interrupted(f"interrupted after t = {plant.t:g} s")
    except NumericalError as error:
        return error
    return None


def _result(
    scene: ControlScene,
    control: Controls,
    plant: Plant,
    plan: Schedule,
    first: tuple[float, Array],
    steps: list[_Step],
    finished: bool,
    made_s: float,
) -> ControlRun:
    """Collect what was recorded since the ``first`` instant and state, and read off the plant what was tracked."""
    model, stages, count = control.prediction, control.stages, len(steps)
    commands, rest = [step.command for step in steps], plant.model.rest_input
    t = np.asarray(first[0] + plant.period * np.arange(count + 1), dtype=float)
    x = np.array([first[1], *[step.x for step in steps]])
    u = np.array([c.u for c in commands]).reshape(count, stages.nu)
    held, last = np.vstack([rest, u]), np.vstack([u, u[-1:] if count else rest])
    w = plant.model.forces(t)
    readings = Readings(scene, plant.model, stages, model)
    health = tuple(c.health.name.lower() for c in commands)
    touched = [c.contact_forces for c in commands] if model.contact_names and scene.estimator is not None else []
    return ControlRun(
        scene=scene,
        readings=readings,
        t=t,
        x=x,
        u=u,
        w=w,
        y=np.array([step.y for step in steps]).reshape(count, len(plant.sensors.names)),
        estimate=_stack([c.estimate.x for c in commands]),
        parameters=_stack([c.estimate.p for c in commands]),
        given_parameters=_stack([step.p for step in steps]),
        std=_stack([() if c.estimate.std is None else c.estimate.std for c in commands]),
        contact_force_estimate=_stack([of.force for of in touched]) if touched else None,
        contact_force_std=_stack([of.std for of in touched]) if touched else None,
        r=np.array([*[step.r for step in steps], plan.rows(t[-1:])[0]]),
        tracked=readings.tracked(x, last, w, held),
        tip=readings.tip(x, last, w),
        plan_tip=_planned_tips(commands, model, stages.stages + 1),
        bounds=tuple(readings.bounds(x, last, w, held, plant.period)),
        status=tuple(c.status.name.lower() for c in commands),
        iterations=np.array([c.iterations for c in commands], dtype=np.int64),
        violation=np.array([c.violation for c in commands], dtype=float),
        phase_names=tuple(commands[0].time._fields) if count else (),
        phase_times=_stack([c.time for c in commands]),
        anomalies=tuple(tuple(c.anomalies) for c in commands),
        health=health,
        health_texts=tuple(c.health_text for c in commands),
        mismatch=np.array([c.mismatch for c in commands], dtype=float),
        activity=np.array([c.activity for c in commands], dtype=float),
        events=tuple(plan.events),
        ended="stopped" if not finished else "tripped" if "tripped" in health else "finished",
        x_names=plant.model.x_names,
        u_names=stages.u_names,
        y_names=plant.sensors.names,
        r_names=stages.r_names,
        p_names=stages.p_names,
        estimated_names=control.estimated_names,
        u_min=stages.u_min,
        u_max=stages.u_max,
        weights=stages.weights,
        period=plant.period,
        statistics={
            "plant_method": plant.method.name,
            "plant_substeps": plant.method.substeps,
            "plant_fastest_rate": plant.method.radius,
            "plant_compiled": plant.compiled,
            "plant_error_m": _plant_error(plant, x, u, t, readings),
            "made_s": made_s,
            "controller": dict(control.statistics),
        },
    )


def _stack(rows: list[Any]) -> Array:
    return np.array(rows, dtype=float).reshape(len(rows), -1) if rows else np.zeros((0, 0))


def _planned_tips(commands: list[Any], model: Prediction, nodes: int) -> Array:
    """Predicted tip paths (K, N + 1, 2) [m]."""
    if not commands:
        return np.zeros((0, nodes, 2))
    # Without the inputs before, which a problem with input rates has behind the model's states.
    plans = np.concatenate([c.plan.x[:, : model.nx] for c in commands])
    inputs = np.concatenate([np.vstack([c.plan.u, c.plan.u[-1:]]) for c in commands])
    p = np.repeat([c.estimate.p for c in commands], nodes, axis=0)
    points = np.array(model.tip.map(len(plans))(plans.T, inputs.T, p.T)).T
    return points.reshape(-1, nodes, 2)


def _plant_error(plant: Plant, x: Array, u: Array, t: Array, readings: Readings) -> float:
    """Greatest change of the tip over single periods when the plant takes half as long steps [m]."""
    if not len(u):
        return 0.0
    chosen = np.unique(np.linspace(0, len(u) - 1, min(len(u), _CHECKED)).astype(int))
    finer = np.array([plant.replayed(x[k], u[k], float(t[k])) for k in chosen])
    after = chosen + 1
    w = plant.model.forces(t[after])
    moved = readings.tip(finer, u[chosen], w) - readings.tip(x[after], u[chosen], w)
    return float(np.linalg.norm(moved, axis=1).max())
