"""A controller and a plant in closed loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from time import perf_counter
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import (
    Array,
    InputError,
    Interrupted,
    NumericalError,
    check_arguments,
    interruptible,
)
from continuum_grasp.closed_loop.plant import Plant, SharedPlant
from continuum_grasp.closed_loop.readings import Readings
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.shared_object import SharedModel
from continuum_grasp.control import Controller, Outputs, Prediction, Setpoints, Stages
from continuum_grasp.scene import ControlScene, scene_of


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
    def step(self, measurement: Array, reference: Array) -> Any:
        """Return the command for a measurement (ny) and setpoints (N + 1, nr)."""

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Start again, from a state (nx) and an input (nu)."""


class _Step(NamedTuple):
    """A period: measurement and setpoints at its start, the command, the plant's state at its end."""

    y: Array
    r: Array
    command: Any
    x: Array


@interruptible()
@check_arguments
def run_closed_loop(
    scene: ControlScene | str | PathLike[str],
    *,
    controller: Controls | None = None,
    plant: Plant | None = None,
    functions: Mapping[str, Callable[[float], ArrayLike]] | None = None,
    progress: Callable[[float], None] | None = None,
    times: bool = False,
) -> ControlRun:
    """Let a controller move a plant.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, with a ``duration``, or its YAML file.
    controller : Controls, optional
        A controller of that scene, which is reset first; by default a new ``Controller`` without a deadline, so
        that a run does not depend on how busy the machine is. Late steps are counted all the same.
    plant : Plant, optional
        A plant at its start; by default the scene's.
    functions : mapping of str to callable, optional
        Functions of time instead of references of the scene; see ``setpoints``.
    progress : callable, optional
        Called with the share done so far, 0 to 1.
    times : bool
        True: optimize the controller's code, so that its steps take as long as in use. Else few
        steps run in code that is compiled quickly, and the metrics have no times.

    Returns
    -------
    ControlRun

    Raises
    ------
    InputError
        If the scene has no duration, or pieces do not fit.
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
    if scene.duration is None:
        raise InputError("a closed loop needs a duration [s]", key="duration")
    steps = math.inf if times else scene.duration / scene.controller.step
    control: Controls = Controller(scene, deadline=math.inf, steps=steps) if controller is None else controller
    model = control.prediction
    tried = Plant(scene, model, control.period) if plant is None else plant
    rows = Setpoints.of(Outputs.of(scene.controller.cost, model), scene.reference, functions).rows
    while True:
        loop = FingerLoop(scene, control, tried, rows)
        (run,), error = FingerLoop.run_together([loop], scene.duration, progress, began=began)
        wider = None if plant is not None or isinstance(error, Interrupted) else run.wider_plant()
        if wider is None:
            break
        tried = Plant(scene, model, control.period, wider)
    if error is not None:
        error.result = run
        raise error
    return run


class LoopPhases(Protocol):
    """Phases of a closed loop, which change its setpoints and its controller; ``events`` notes when each began [s]."""

    @property
    def events(self) -> Sequence[tuple[float, str]]: ...
    def enter(self, t: float, controller: Any, plant: Any) -> None:
        """Begin the first phase at an instant [s]."""

    def advance(self, t: float, controller: Any, plant: Any, command: Any) -> bool:
        """Begin the work that is due at an instant [s], by the last command; False after the last phase."""


class FingerLoop(NamedTuple):
    """A finger of a closed loop; ``rows`` gives its setpoints (T, nr) at instants (T,) [s]."""

    scene: ControlScene
    control: Controls
    plant: Plant
    rows: Callable[[Array], Array]
    phases: LoopPhases | None = None

    @staticmethod
    @interruptible()
    def run_together(
        loops: Sequence[FingerLoop],
        duration: float,
        progress: Callable[[float], None] | None = None,
        *,
        joint: SharedModel | None = None,
        began: float | None = None,
    ) -> tuple[list[ControlRun], NumericalError | Interrupted | None]:
        """Let controllers of equal periods move their plants for a time [s], each by its own setpoints.

        Returns the run of each finger, and the exception that stopped them if any, which is not raised. ``joint`` has
        the equations of plants that move together, if they exist already; ``began`` is the time before the construction
        of the arguments, by ``perf_counter`` [s].
        """
        started = perf_counter() if began is None else began
        shared = SharedPlant([loop.plant for loop in loops], joint)
        for loop in loops:
            loop.control.reset(u=loop.plant.model.rest_input)
        count = round(duration / loops[0].control.period)
        code = shared.prepare(count)
        made_s = perf_counter() - started
        steps: list[list[_Step]] = []
        first = [(loop.plant.t, loop.plant.x) for loop in loops]
        error = _loop(loops, shared, steps, count, progress or (lambda share: None))
        with Interrupted.after("the run") as late:
            known = [_result(loop, first[k], [of[k] for of in steps], error is None) for k, loop in enumerate(loops)]
            runs = []
            for run, off in zip(known, _plant_errors(shared, known), strict=True):
                of_plant = {"plant_code": str(code), "plant_error_m": off, "made_s": made_s}
                runs.append(replace(run, statistics={**run.statistics, **of_plant}))
        return runs, error or late()


def _loop(
    loops: Sequence[FingerLoop],
    shared: SharedPlant,
    done: list[list[_Step]],
    steps: int,
    progress: Callable[[float], None],
) -> NumericalError | Interrupted | None:
    """Run until the end, or until what stopped it."""
    problems = [loop.control.stages for loop in loops]
    ahead = [problem.stage * np.arange(problem.stages + 1.0) for problem in problems]
    phased = [(k, loop.phases) for k, loop in enumerate(loops) if loop.phases is not None]
    for k, phases in phased:
        phases.enter(loops[k].plant.t, loops[k].control, loops[k].plant)
    try:
        for k in range(steps):
            asked = []
            for loop, later in zip(loops, ahead, strict=True):
                reference = loop.rows(loop.plant.t + later)
                measured = loop.plant.measure()
                asked.append((measured, reference[0], loop.control.step(measured, reference)))
            states = shared.advance([of[-1].u for of in asked])
            # The period is recorded at once and whole, wherever an interruption falls.
            done.append([_Step(*of, plant_states[-1]) for of, plant_states in zip(asked, states, strict=True)])
            progress((k + 1) / steps)
            goes_on = [
                phases.advance(loops[k].plant.t, loops[k].control, loops[k].plant, asked[k][-1]) for k, phases in phased
            ]
            if not all(goes_on):
                break
    except KeyboardInterrupt:
        return Interrupted(f"interrupted after t = {loops[0].plant.t:g} s")
    except NumericalError as error:
        return error
    return None


def _result(loop: FingerLoop, first: tuple[float, Array], steps: list[_Step], finished: bool) -> ControlRun:
    """Collect what was recorded since the ``first`` instant and state, and read off the plant what was tracked."""
    scene, control, plant, rows, phases = loop
    model = control.prediction
    stages = control.stages
    count = len(steps)
    commands = [step.command for step in steps]
    rest = plant.model.rest_input
    t = np.asarray(first[0] + plant.period * np.arange(count + 1), dtype=float)
    x = np.array([first[1], *[step.x for step in steps]])
    u = np.array([c.u for c in commands]).reshape(count, stages.nu)
    held = np.vstack([rest, u])
    last = np.vstack([u, u[-1:] if count else rest])
    w = plant.model.forces(t)
    readings = Readings(scene, plant.model, stages, model)
    by_commands = _of_commands(commands, model, stages, touches=scene.estimator is not None)
    return ControlRun(
        **by_commands,
        scene=scene,
        readings=readings,
        t=t,
        x=x,
        u=u,
        w=w,
        y=np.array([step.y for step in steps]).reshape(count, len(plant.sensors.names)),
        given_parameters=_stack([stages.p_nominal] * count),
        r=np.array([*[step.r for step in steps], rows(t[-1:])[0]]),
        tracked=readings.tracked(x, last, w, held),
        tip=readings.tip(x, last, w),
        bounds=tuple(readings.bounds(x, last, w, held, plant.period)),
        events=() if phases is None else tuple(phases.events),
        ended="stopped" if not finished else "tripped" if "tripped" in by_commands["health"] else "finished",
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
            "controller": dict(control.statistics),
            "controller_code": str(control.code) if isinstance(control, Controller) else "",
        },
    )


def _of_commands(commands: list[Any], model: Prediction, stages: Stages, *, touches: bool) -> dict[str, Any]:
    """Fields of a run that follow from its commands."""
    touched = [c.contact_forces for c in commands] if model.contact_names and touches else []
    return {
        "estimate": _stack([c.estimate.x for c in commands]),
        "parameters": _stack([c.estimate.p for c in commands]),
        "std": _stack([() if c.estimate.std is None else c.estimate.std for c in commands]),
        "contact_force_estimate": _stack([of.force for of in touched]) if touched else None,
        "contact_force_std": _stack([of.std for of in touched]) if touched else None,
        "plan_tip": _planned_tips(commands, model, stages.stages + 1),
        "status": tuple(c.status.name.lower() for c in commands),
        "iterations": np.array([c.iterations for c in commands], dtype=np.int64),
        "violation": np.array([c.violation for c in commands], dtype=float),
        "phase_names": tuple(commands[0].time._fields) if commands else (),
        "phase_times": _stack([c.time for c in commands]),
        "anomalies": tuple(tuple(c.anomalies) for c in commands),
        "health": tuple(c.health.name.lower() for c in commands),
        "health_texts": tuple(c.health_text for c in commands),
        "mismatch": np.array([c.mismatch for c in commands], dtype=float),
        "activity": np.array([c.activity for c in commands], dtype=float),
        "adapted": commands[-1].adapted if commands else {},
    }


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


def _plant_errors(shared: SharedPlant, runs: Sequence[ControlRun]) -> list[float]:
    """Greatest change of each tip over single periods when the plants take half as long steps [m]."""
    count = len(runs[0].u)
    if not count:
        return [0.0] * len(runs)
    # 50: periods that are integrated again with steps half as long; their cost does not grow with the run
    chosen = np.unique(np.linspace(0, count - 1, min(count, 50)).astype(int))
    finer = []
    for k in chosen:
        states = [run.x[k] for run in runs]
        inputs = [run.u[k] for run in runs]
        finer.append(shared.moved(states, inputs, float(runs[0].t[k]), finer=2))
    after = chosen + 1
    errors = []
    for number, run in enumerate(runs):
        states = [moved[number][-1] for moved in finer]
        w = run.readings.plant.forces(run.t[after])
        moved = run.readings.tip(np.array(states), run.u[chosen], w) - run.readings.tip(run.x[after], run.u[chosen], w)
        errors.append(float(np.linalg.norm(moved, axis=1).max()))
    return errors
