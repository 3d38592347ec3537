"""The plant of a mission, finger by finger, with an object that can be dropped, and the timetable of its motions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.plant import Plant
from continuum_grasp.closed_loop.plant_model import PlantModel, plant_scene
from continuum_grasp.closed_loop.schedule import Phase
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.mission.assignment import Assignment
from continuum_grasp.scene.drives import COMMANDS
from continuum_grasp.scene.mission import MissionScene
from continuum_grasp.scene.objects import GraspObject
from continuum_grasp.scene.surroundings import Table

Array = NDArray[np.float64]

_FINGER, _OBJECT = ("bending_stiffness", "material_damping"), ("object_mass", "friction_factor")
"""What of finger and object varies from plant to plant: run-time numbers, so that equations are compiled once. Friction
of the tendons is one of them where they have any."""
_SUNK = 0.05
"""How far the table sinks [m]."""
_WRENCH = ("object_force_x [N]", "object_force_y [N]", "object_moment [N m]")


@dataclass(frozen=True)
class Variation:
    """How one plant differs from another; None: as the mission's ``plant`` says."""

    stiffness: float | None = None
    """Per that of the controller's finger [1]."""
    damping: float | None = None
    """Per that of the controller's finger [1]."""
    mass: float = 1.0
    """Of the object, per that of the mission [1]."""
    friction: float = 1.0
    """Of all contacts of the object, per that of the mission [1]."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Of where the object stands, world x, y [m]."""
    seed: int | None = None
    """Of the measurement noise."""
    tendon_friction: float = 1.0
    """Friction of the tendons, per that of the plant [1]."""


def mission_plant_model(assignment: Assignment) -> PlantModel:
    """Equations of the plant of one finger."""
    mission, control = assignment.mission, assignment.control
    if control.object is None:
        raise ValueError("a mission has an object")
    mass = mission.grasp.object.mass if mission.object_mass is None else mission.object_mass
    scene = plant_scene(control).replaced(
        contacts=tuple(sorted({*control.contacts, *mission.more_contacts})),
        object=control.object.replaced(mass=mass),
        object_moves=True,
        supports=mission.grasp.supports,
        contact_law=mission.contact_law,
        out_of_plane_gravity=mission.gravity,
        table=_table(mission, control.object, mass),
    )
    of_tendons = ("tendon_friction",) * scene.finger.has_tendon_friction
    return PlantModel(control, scene, (*_FINGER, *of_tendons), _OBJECT)


def _table(mission: MissionScene, body: GraspObject, mass: float) -> Table:
    """What the object stands on: below the plane, or with gravity in the plane a wall below the object."""
    down = np.array(mission.plane_gravity)
    size = float(np.hypot(*down))
    if size == 0.0:
        return Table(friction=mission.table_friction)
    angle = math.atan2(down[1], down[0])
    below = max(part.support(angle - body.angle) for part in body.parts)
    # Pressed in by the weight, the object stands where the grasp has it.
    below -= mass * size / mission.contact_law.stiffness
    x, y = np.array(body.position) + below * down / size
    return Table(friction=mission.table_friction, point=(float(x), float(y)), normal_angle=angle + math.pi)


def mission_plant(
    assignment: Assignment, timetable: Timetable, prediction: Prediction, variation: Variation, equations: PlantModel
) -> Plant:
    """The plant of one finger at the start of a mission; its equations are those of ``mission_plant_model``."""
    own, nominal = assignment.mission.plant, np.array(equations.system.p_nominal)
    # The equations have the factors of the mission's ``plant`` already.
    stiffness = 1.0 if variation.stiffness is None else variation.stiffness / own.stiffness
    damping = 1.0 if variation.damping is None else variation.damping / own.damping
    of_tendons = [variation.tendon_friction] * equations.scene.finger.has_tendon_friction
    equations.p = nominal * np.array([stiffness, damping, *of_tendons, variation.mass, variation.friction])
    equations.outside = timetable.outside()
    fingers, seed = list(assignment.mission.grasp.named_fingers), variation.seed
    if (number := fingers.index(assignment.name)) > 0:
        # Each finger's sensors have noise of their own.
        drawn = np.random.SeedSequence((own.seed if seed is None else seed, number))
        seed = int(drawn.generate_state(1)[0])
    plant = Plant(assignment.control, prediction, assignment.mission.controller.period, equations, seed)
    plant.x = plant.x.copy()
    plant.x[equations.system.object_states][:2] += np.array(variation.shift)
    return plant


@dataclass(frozen=True)
class Span:
    """A phase by name, from its start to its end [s]."""

    name: str
    start: float
    end: float


class Timetable:
    """Phases of a mission: approach, squeeze, settle if asked for, lift, hold, then ``pull 1`` and so on with a
    ``rest`` after each, lower, release, end.
    """

    def __init__(self, assignment: Assignment) -> None:
        self._of = assignment
        asked = assignment.mission.phases
        lengths = [("approach", asked.approach), ("squeeze", asked.squeeze)]
        lengths += [("settle", asked.settle)] * (asked.settle > 0.0)
        lengths += [("lift", asked.lift), ("hold", asked.hold)]
        for k in range(len(assignment.pulls)):
            lengths += [(f"pull {k + 1}", asked.pull), ("rest", asked.rest)]
        # "end": nothing is asked any more, so that what still moves comes to rest.
        lengths += [("lower", asked.lower), ("release", asked.release), ("end", 0.25 * asked.release)]
        ends = np.cumsum([length for _, length in lengths])
        self.spans = tuple(
            Span(name, float(end - length), float(end)) for (name, length), end in zip(lengths, ends, strict=True)
        )

    def span(self, name: str) -> Span:
        """The first phase of a name."""
        return next(span for span in self.spans if span.name == name)

    @property
    def duration(self) -> float:
        """Of all phases [s]."""
        return self.spans[-1].end

    def _risen(self, t: Array, name: str) -> Array:
        """From 0 before a phase to 1 after it, with continuous rate and acceleration."""
        span = self.span(name)
        return _smooth((t - span.start) / (span.end - span.start))

    # -- the controller's -------------------------------------------------------------------------------------------

    def rows(self, t: Array, names: tuple[str, ...]) -> Array:
        """Setpoints (T, nr) at instants (T,) [s], in the order of ``Stages.r_names``."""
        of = self._of
        # The posture goes from straight to touching, and from there to the grasp, the last share of it while the force
        # is followed; release undoes all at once.
        share = of.mission.phases.squeeze_share
        closed = share * self._risen(t, "squeeze") - self._risen(t, "release")
        if share < 1.0:
            closed += (1.0 - share) * self._risen(t, "settle")
        begun = self._risen(t, "approach") - self._risen(t, "release")
        inputs = of.rest + np.outer(begun, of.before - of.rest) + np.outer(closed, of.held - of.before)
        word, unit = COMMANDS[of.control.finger.input_key]
        bends = np.outer(begun, of.bends) + np.outer(closed, of.posture - of.bends)
        columns: dict[str, Array] = {f"contact_force_{name} [N]": closed * force for name, force in of.forces.items()}
        columns |= {f"bending_{k + 1} [rad]": column for k, column in enumerate(bends.T)}
        columns |= {f"{word}_{k + 1} [{unit}]": column for k, column in enumerate(inputs.T)}
        return np.stack([columns.get(name, np.zeros_like(t)) for name in names], axis=1)

    def phases(self, stages: Stages) -> list[Phase]:
        """The phases for a closed loop; contact forces are followed once there are any, the posture until then."""
        begin = {name: self._weighing(stages) for name in ("approach", "release")}
        begin |= {name: self._weighing(stages, followed=True, held=name == "lift") for name in ("settle", "lift")}
        found = []
        for span in self.spans:
            rows = partial(self._rows_since, span.start, stages.r_names)
            found.append(Phase(span.name, rows, span.end - span.start, begin=begin.get(span.name)))
        return found

    def _rows_since(self, start: float, names: tuple[str, ...], since: Array) -> Array:
        return self.rows(start + since, names)

    def _weighing(self, stages: Stages, *, followed: bool = False, held: bool = False) -> Callable[[Any, Any], None]:
        """Gives the controller the weights and limits of a phase, in which a force is ``followed`` or the posture; what
        is ``held`` is not let go to correct a force.
        """
        off = "bending_" if followed else "contact_force"
        # One drive follows the posture or a force. Rates stay weighted, since they damp either.
        keep = [not name.startswith(off) or "rate" in name for name in stages.r_names]
        weights = np.where(keep, stages.weights, 0.0)

        def begin(controller: Any, plant: Any) -> None:
            low, high = stages.u_min, stages.u_max
            if held:
                # Positions hold where they are by now: friction and soft contacts move those of the grasp.
                away = plant.command - self._of.held if self._of.control.finger.winches else 0.0
                low, high = (np.clip(limit + away, low, high) for limit in self._of.holding)
            controller.change(weights=weights, u_min=low, u_max=high)

        return begin

    # -- the plant's ------------------------------------------------------------------------------------------------

    def outside(self) -> dict[str, Callable[[Array], Array]]:
        """Height of the table, and what pulls at the object, as functions of instants."""
        return {"table_height [m]": self._table, **{name: partial(self._pull, k) for k, name in enumerate(_WRENCH)}}

    def _table(self, t: Array) -> Array:
        return -_SUNK * (self._risen(t, "lift") - self._risen(t, "lower"))

    def _pull(self, axis: int, t: Array) -> Array:
        total = np.zeros_like(t)
        for k, wrench in enumerate(self._of.pulls):
            span = self.span(f"pull {k + 1}")
            quarter = 0.25 * (span.end - span.start)  # to grow, and to fade; half of it stays
            total += wrench[axis] * _smooth((t - span.start) / quarter)
            total -= wrench[axis] * _smooth((t - span.end + quarter) / quarter)
        return total


def _smooth(share: Array) -> Array:
    """The quintic from 0 to 1 with neither rate nor acceleration at both ends: setpoints that a drive can follow."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
