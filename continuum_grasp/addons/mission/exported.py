"""A mission as exports take it: the controller of a finger, and the phases of its task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike

from numpy.typing import ArrayLike

from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.addons.mission.plan import certified_forces, mission_settings
from continuum_grasp.addons.mission.plant import Timetable, mission_plant_model
from continuum_grasp.addons.mission.precheck import admitted
from continuum_grasp.addons.mission.result import MissionRun
from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.base import InputError, Summarized, check_arguments, interruptible
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.control import Stages
from continuum_grasp.export import ExportedLoop
from continuum_grasp.grasp import GraspResult
from continuum_grasp.scene import scene_of

_REPORTED = {
    True: (("others_bear", "BEARS"), ("others_lack", "LACKS"), ("others_doubt", "DOUBTS"), ("others_blind", "BLIND")),
    False: (("lift", "LIFTS"), ("let_go", "LETS_GO")),
}
"""Reports that the finger that decides takes from others, and they from it, with the words in ``c/mission.h``."""


@dataclass(frozen=True)
class AssignedMission(Summarized):
    """A mission with its grasp and the tasks of its fingers, before anything moves: the input of exports.

    Attributes
    ----------
    assignments : tuple of Assignment
        Task of each finger.
    """

    assignments: tuple[Assignment, ...]

    @staticmethod
    def of(given: MissionScene | AssignedMission | MissionRun) -> AssignedMission:
        """Assigned mission of a run; InputError for a mission without its grasp."""
        if isinstance(given, MissionScene):
            raise InputError(
                "the grasp of this mission is not optimized yet: pass the result of assign_mission(mission) or "
                "run_mission(mission)",
                key="given",
            )
        return given if isinstance(given, AssignedMission) else AssignedMission(given.assignments)

    @property
    def name(self) -> str:
        """Name of the mission."""
        return self.assignments[0].mission.name or ""

    def headline(self) -> str:
        """Name of the mission and status of its grasp."""
        return self.quoted(self.name, self.assignments[0].grasp.status.value)

    def pairs(self) -> dict[str, str]:
        """Tensions that hold the object, by finger."""
        return {
            f"tensions of {of.name}": ", ".join(f"{tension:.3g} N" for tension in of.tensions)
            for of in self.assignments
        }

    @property
    def timetables(self) -> tuple[Timetable, ...]:
        """Planned phases of each finger."""
        return tuple(map(Timetable, self.assignments))

    @property
    def plant_models(self) -> tuple[PlantModel, ...]:
        """Equations of the plant of each finger."""
        return tuple(map(mission_plant_model, self.assignments))

    def exported(self, finger: str | None = None) -> ExportedLoop:
        """The controller of a finger with the phases of its mission; ``finger`` names one of several.

        InputError if there is no such finger.
        """
        by_name = {assignment.name: assignment for assignment in self.assignments}
        _check_finger(finger, list(by_name))
        of = self.assignments[0] if finger is None else by_name[finger]
        leads = of is self.assignments[0]
        spans = Timetable(of).phases()
        return ExportedLoop(
            of.control,
            of.mission.model_dump(mode="json"),
            partial(_settings_of, self.assignments, of, leads=leads),
            names=tuple(span.name for span in spans),
            ends=spans[-1].start,
            reported=() if len(self.assignments) == 1 else _REPORTED[leads],
        )


@check_arguments
@interruptible()
def assign_mission(scene: MissionScene | str | PathLike[str], *, grasp: GraspResult | None = None) -> AssignedMission:
    """Optimize the grasp of a mission, and assign each of its controllers its task.

    Parameters
    ----------
    scene : MissionScene or path-like
        The mission, or its YAML file.
    grasp : GraspResult, optional
        The grasp, if you have it already.

    Returns
    -------
    AssignedMission

    Raises
    ------
    SolverError
        If there is no verified grasp, or its contacts bear too little on the mission's compliant pads.
    InputError
        If the mission is inconsistent.
    Interrupted
        On Ctrl-C.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.addons.mission import assign_mission
    >>> mission = assign_mission("configs/mission/mug.yaml")  # doctest: +SKIP
    >>> cg.export_c(mission, "build/mug")  # doctest: +SKIP
    """
    return AssignedMission(admitted(scene_of(scene, MissionScene), grasp))


def prepared(mission: MissionScene, finger: str | None) -> AssignedMission:
    """The mission with its grasp, as exports need it; a finger that it has not is refused before that is sought."""
    _check_finger(finger, [setup.name for setup in mission.grasp.setups])
    return assign_mission(mission)


def _check_finger(finger: str | None, names: Sequence[str]) -> None:
    """Refuse a name of no finger, and none where there are several."""
    if finger not in names and (finger is not None or len(names) > 1):
        expected = f"one of {', '.join(names)}, which have a package each"
        raise InputError(f"expected {expected}, got {finger!r:.60}", key="finger")


def exported_loop(mission: MissionScene | AssignedMission | MissionRun, finger: str | None = None) -> ExportedLoop:
    """The controller of a finger with its phases, of what has a mission; InputError of one whose grasp is not found."""
    return AssignedMission.of(mission).exported(finger)


def _settings_of(
    assignments: Sequence[Assignment], of: Assignment, stages: Stages, *, leads: bool
) -> tuple[dict[str, int], dict[str, ArrayLike]]:
    """Dimensions and settings of the phases of the finger ``of``, one of those that are assigned."""
    certified = certified_forces(assignments, of)
    holds_on = of.mission.phases.hold_until_release
    return mission_settings(Timetable(of), stages, certified, leads=leads, holds_on=holds_on)
