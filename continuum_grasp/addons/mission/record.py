"""Record of a mission, off which its verdict is read: the plant, the closed loops, the contacts."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from continuum_grasp.addons.mission.assignment import Assignment, present
from continuum_grasp.addons.mission.budget import plant_friction
from continuum_grasp.addons.mission.plant import PlantVariation, Timetable
from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.base import Array
from continuum_grasp.closed_loop import ControlRun
from continuum_grasp.simulation import ContactHistory


@dataclass(frozen=True)
class MissionRecord:
    """A mission over K periods, which may have been stopped early, before it is judged."""

    assignments: tuple[Assignment, ...]
    """Task of each finger."""
    timetable: Timetable
    variation: PlantVariation
    """Difference of the plant from the mission's own."""
    runs: tuple[ControlRun, ...]
    """The closed loop of each finger."""
    contacts: ContactHistory = field(repr=False)
    """Gaps and forces of all contacts."""

    @property
    def mission(self) -> MissionScene:
        """The mission."""
        return self.assignments[0].mission

    @property
    def t(self) -> Array:
        """Instants (K + 1,) [s]."""
        return self.runs[0].t

    @cached_property
    def object_pose(self) -> Array:
        """Pose of the object (K + 1, 4): x, y [m], angle [rad], height [m]."""
        return present(self.runs[0].object_pose)

    @cached_property
    def friction(self) -> Array:
        """Friction coefficient of each contact on the plant (K + 1, contacts) [1]; NaN for the table."""
        fallen = self.timetable.fallen(self.variation, self.t)
        return plant_friction(self.mission, self.variation, self.contacts.names, fallen)
