"""A mission carried out: grasp, controller and plant from approach to release."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from os import PathLike

from continuum_grasp import interrupt
from continuum_grasp.arguments import check_arguments
from continuum_grasp.closed_loop.plant import SharedPlant
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.run import FingerLoop, run_fingers
from continuum_grasp.closed_loop.shared_object import SharedModel
from continuum_grasp.control.controller import Controller
from continuum_grasp.errors import Interrupted
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.mission.assign import assign
from continuum_grasp.mission.assignment import Assignment, present
from continuum_grasp.mission.lift import LiftCheck
from continuum_grasp.mission.plant import Timetable, Variation, mission_plant, mission_plant_model
from continuum_grasp.mission.precheck import admit, exceeded
from continuum_grasp.mission.result import MissionRun
from continuum_grasp.mission.verdict import judge
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.mission import MissionScene
from continuum_grasp.simulation.contacts import ContactForces

Progress = Callable[[float], None]


@interrupt.computing()
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
        If there is no verified grasp, or its contacts bear too little on the mission's compliant pads.
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
    assignments = assign(scene_of(scene, MissionScene), grasp)
    admit(assignments, [number.text for number in exceeded(assignments, variation or Variation())])
    return MissionRunner(assignments).run(variation, progress)


class MissionRunner:
    """Controllers and plant of a mission, made once for any number of runs."""

    def __init__(self, assignments: Sequence[Assignment]) -> None:
        self.assignments, mission = tuple(assignments), assignments[0].mission
        # Without a deadline of its own a mission never drops a command for being late.
        deadline = mission.controller.deadline or math.inf
        self._controllers = [Controller(assignment.control, deadline=deadline) for assignment in assignments]
        self._models = [mission_plant_model(assignment) for assignment in assignments]
        self._shared = SharedModel(self._models) if len(assignments) > 1 else None

    def run(self, variation: Variation | None = None, progress: Progress | None = None) -> MissionRun:
        """Carry the mission out on one plant; errors are those of ``run_mission``."""
        asked, loops, tables = variation or Variation(), [], [Timetable(assignment) for assignment in self.assignments]
        check = LiftCheck(self.assignments, tables)
        for k, (assignment, control, model) in enumerate(
            zip(self.assignments, self._controllers, self._models, strict=True)
        ):
            plant = mission_plant(assignment, tables[k], control.prediction, asked, model)
            loops.append(FingerLoop(assignment.control, control, plant, check.schedule(k, control.stages)))
        shared = SharedPlant([loop.plant for loop in loops], self._shared)
        runs, error = run_fingers(loops, shared, loops[0].plan.duration, progress)
        # Ctrl-C at the very end: the verdict is whole, and comes with the exception.
        with interrupt.held(quietly=True) as pressed:
            judged = self._judged(asked, runs, tables[0], check)
        if pressed() and error is None:
            error = Interrupted("interrupted after the end of the mission")
        if error is not None:
            error.result = judged
            raise error
        return judged

    def _judged(
        self, variation: Variation, runs: Sequence[ControlRun], table: Timetable, check: LiftCheck
    ) -> MissionRun:
        of, scenes = self.assignments, tuple(model.scene for model in self._models)
        by_finger = {assignment.name: present(run.contacts) for assignment, run in zip(of, runs, strict=True)}
        contacts = ContactForces.joined(by_finger)
        verdict = judge(of, table, variation, runs, contacts, check.refused, check.slipped)
        beyond = exceeded(of, variation)
        return MissionRun(of, table, variation, tuple(runs), scenes, contacts, verdict, beyond)
