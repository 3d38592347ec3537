"""A mission as exports take it: the controller of a finger, and the phases of its task."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.plan import certified_forces, mission_settings
from continuum_grasp.addons.mission.plant import PlantVariation, Timetable
from continuum_grasp.addons.mission.precheck import admit, exceeded
from continuum_grasp.addons.mission.result import MissionRun
from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.base import InputError
from continuum_grasp.control import Stages
from continuum_grasp.export import ExportedLoop, ExportedPhases

_REPORTED = {
    True: (("others_bear", "BEARS"), ("others_lack", "LACKS"), ("others_doubt", "DOUBTS"), ("others_blind", "BLIND")),
    False: (("lift", "LIFTS"), ("let_go", "LETS_GO")),
}
"""Reports that the finger that decides takes from others, and they from it, with the words in ``c/mission.h``."""


def assigned(given: MissionScene | MissionRun) -> tuple[Assignment, ...]:
    """Tasks of the fingers of a mission, whose grasp is optimized where that has not run."""
    if isinstance(given, MissionRun):
        return given.assignments
    assignments = assign(given)
    admit(assignments, [limit.text for limit in exceeded(assignments, PlantVariation())])
    return assignments


def exported_loop(mission: MissionScene | MissionRun, finger: str | None) -> ExportedLoop:
    """The controller of a finger with the phases of its mission; ``finger`` names one of several.

    InputError if there is no such finger.
    """
    assignments = assigned(mission)
    by_name = {assignment.name: assignment for assignment in assignments}
    if finger not in by_name and (finger is not None or len(by_name) > 1):
        expected = f"one of {', '.join(by_name)}, which have a package each"
        raise InputError(f"expected {expected}, got {finger!r:.60}", key="finger")
    of = assignments[0] if finger is None else by_name[finger]
    return ExportedLoop(of.control, of.mission.model_dump(mode="json"), partial(phases_of, assignments, of))


def phases_of(assignments: Sequence[Assignment], of: Assignment, stages: Stages) -> ExportedPhases:
    """Phases of the finger ``of``, one of those that are assigned, by the problem of its controller."""
    table, leads = Timetable(of), of is assignments[0]
    certified, holds_on = certified_forces(assignments, of), of.mission.phases.hold_until_release
    sizes, settings = mission_settings(table, stages, certified, leads=leads, holds_on=holds_on)
    reported = () if len(assignments) == 1 else _REPORTED[leads]
    spans = table.phases()
    return ExportedPhases(sizes, settings, tuple(span.name for span in spans), spans[-1].start, reported)
