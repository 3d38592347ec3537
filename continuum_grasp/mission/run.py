"""A mission carried out: grasp, controller and plant from approach to release."""

from __future__ import annotations

import math
from collections.abc import Callable
from os import PathLike

import numpy as np

from continuum_grasp import interrupt
from continuum_grasp.arguments import check_arguments
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.run import run_closed_loop
from continuum_grasp.control.controller import Controller
from continuum_grasp.errors import Interrupted, NumericalError
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.mission.assignment import Assignment, assign
from continuum_grasp.mission.plant import Timetable, Variation, mission_plant, mission_plant_model
from continuum_grasp.mission.precheck import exceeded, say
from continuum_grasp.mission.result import MissionRun
from continuum_grasp.mission.verdict import judge
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.mission import MissionScene

Progress = Callable[[float], None]


@interrupt.listening()
@check_arguments
def run_mission(
    scene: MissionScene | str | PathLike[str],
    *,
    grasp: GraspResult | None = None,
    variation: Variation | None = None,
    progress: Progress | None = None,
) -> MissionRun:
    """Optimize a grasp, and carry it out in closed loop.

    Parameters
    ----------
    scene : MissionScene or path-like
        The mission, or its YAML file.
    grasp : GraspResult, optional
        The grasp, where it has been found already.
    variation : Variation, optional
        How the plant differs from the mission's own.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    MissionRun

    Raises
    ------
    SolverError
        If there is no verified grasp.
    InputError
        If the mission does not make sense.
    NumericalError
        If the plant's motion does not stay finite; ``result`` is the mission until then.
    Interrupted
        On Ctrl-C; ``result`` is the mission until then.

    Examples
    --------
    The controller of a mission takes half a minute to compile where it is not in the cache:

    >>> import continuum_grasp as cg
    >>> run = cg.run_mission("configs/mission/mug.yaml")  # doctest: +SKIP
    >>> run.verdict.held  # doctest: +SKIP
    True
    """
    assignment = assign(scene_of(scene, MissionScene), grasp)
    say(assignment, [one.text for one in exceeded(assignment, variation or Variation())])
    return MissionRunner(assignment).run(variation, progress)


class MissionRunner:
    """Controller and plant of a mission, made once for any number of runs."""

    def __init__(self, assignment: Assignment) -> None:
        self.assignment, self.timetable = assignment, Timetable(assignment)
        # Without a deadline of its own a mission never drops a command for being late.
        self._controller = Controller(assignment.control, deadline=assignment.mission.controller.deadline or math.inf)
        self._model = mission_plant_model(assignment)

    def run(self, variation: Variation | None = None, progress: Progress | None = None) -> MissionRun:
        """Carry the mission out on one plant; errors are those of ``run_mission``."""
        of, control, asked = self.assignment, self._controller, variation or Variation()
        plant = mission_plant(of, self.timetable, control.prediction, asked, self._model)
        schedule = self.timetable.phases(control.stages)
        try:
            found = run_closed_loop(of.control, controller=control, plant=plant, schedule=schedule, progress=progress)
        except (Interrupted, NumericalError) as error:
            if isinstance(error.result, ControlRun):
                error.result = self._judged(asked, error.result)
            raise
        # Ctrl-C at the very end: the verdict is whole, and comes with the exception.
        with interrupt.held(quietly=True) as pressed:
            judged = self._judged(asked, found)
        if pressed():
            raise Interrupted("interrupted after the end of the mission", result=judged)
        return judged

    def _judged(self, variation: Variation, run: ControlRun) -> MissionRun:
        of = self.assignment
        force = std = np.zeros(0)
        if run.contact_force_estimate is not None and run.contact_force_std is not None:
            held = run.touch_names.index(of.contact)
            force, std = run.contact_force_estimate[:, held], run.contact_force_std[:, held]
        verdict = judge(of, self.timetable, variation, run, force, std)
        beyond = exceeded(of, variation)
        return MissionRun(of, self.timetable, variation, run, self._model.scene, force, std, verdict, beyond)
