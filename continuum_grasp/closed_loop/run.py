"""A controller and a plant in closed loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp import interrupt
from continuum_grasp.closed_loop.plant import Plant
from continuum_grasp.closed_loop.record import Phase, Record, Schedule
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.setpoints import Function, setpoints
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import InputError, Interrupted, NumericalError
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.load import scene_of

Array = NDArray[np.float64]


class Controls(Protocol):
    """A controller, as a closed loop sees it."""

    @property
    def stages(self) -> Stages:
        """Its problem."""

    @property
    def prediction(self) -> Prediction:
        """Its model."""

    @property
    def period(self) -> float:
        """Time from one command to the next [s]."""

    def step(self, measurement: Array, reference: Array, *, p: Array | None = None) -> Any:
        """The command for a measurement (ny) and setpoints (N + 1, nr)."""

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Begin anew, from a state (nx) and an input (nu)."""


@interrupt.listening()
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
    control = _controller(scene) if controller is None else controller
    stages, model = control.stages, control.prediction
    tried = Plant(scene, model, control.period) if plant is None else plant
    if schedule is None:
        schedule = [Phase("run", setpoints(Outputs.of(scene.controller.cost, model), scene.reference, functions).rows)]
    plan = Schedule(schedule)
    duration = min(plan.duration, scene.duration or np.inf)
    if not np.isfinite(duration):
        raise InputError("a closed loop needs a duration [s]", key="duration")
    record = Record(scene, stages, model, tried, plan)
    control.reset(u=tried.model.rest_input)
    record.made_s = perf_counter() - began
    error = _loop(control, tried, plan, record, round(duration / control.period), progress or (lambda share: None))
    ended = "finished" if error is None else "stopped"
    with interrupt.held(quietly=True) as pressed:
        run = record.run(ended, getattr(control, "statistics", {}), tuple(getattr(control, "estimated_names", ())))
    if pressed() and error is None:
        error = Interrupted("interrupted after the end of the run")
    if isinstance(error, Interrupted):
        raise Interrupted(str(error), result=run) from error
    if error is not None:
        raise NumericalError(str(error), time=error.time, state=error.state, result=run) from error
    return run


def _loop(
    control: Controls, plant: Plant, plan: Schedule, record: Record, steps: int, progress: Callable[[float], None]
) -> NumericalError | Interrupted | None:
    """Run until the end, or until what stopped it."""
    ahead = np.asarray(control.stages.stage * np.arange(control.stages.stages + 1), dtype=float)
    plan.enter(plant.t, control, plant)
    try:
        for k in range(steps):
            reference, measured = plan.rows(plant.t + ahead), plant.measure()
            command = control.step(measured, reference, p=plan.phase.p)
            states = plant.advance(command.u)
            record.add(measured, reference[0], plan.phase.p, command, states[-1])
            progress((k + 1) / steps)
            if not plan.advance(plant.t, control, plant, command):
                break
    except KeyboardInterrupt:
        return Interrupted(f"interrupted after t = {plant.t:g} s")
    except NumericalError as error:
        return error
    return None


def _controller(scene: ControlScene) -> Controls:
    from continuum_grasp.control.controller import Controller

    made: Controls = Controller(scene, deadline=math.inf)
    return made
