"""The plant of a mission, finger by finger, with an object that can be dropped, and the timetable of its motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.base import Array, InputError
from continuum_grasp.closed_loop import Plant, PlantModel
from continuum_grasp.control import Prediction

_FINGER, _OBJECT = ("bending_stiffness", "material_damping"), ("object_mass", "friction_factor")
"""Numbers of finger and object that vary from plant to plant: run-time numbers, so that equations are compiled once.
Friction of the tendons is one of them where they have any."""
MOVES = 0.75
"""Share of a stroke in which the setpoint of the angle moves, and of a squeeze in which inputs grow; in the rest object
and fingers come to rest."""

_FACTORS = {
    **dict.fromkeys(("stiffness", "mass"), (1e-12, 1e12)),
    **dict.fromkeys(("damping", "friction", "tendon_friction"), (0.0, 1e12)),
    "friction_fall": (0.0, 1.0),
}
"""Least and greatest factors of a plant [1]; a scene's numbers have the same bounds."""


@dataclass(frozen=True)
class PlantVariation:
    """A plant that differs from the one of the mission, by factors.

    Attributes
    ----------
    stiffness, damping : float, optional
        Stiffness and damping of the fingers, relative to the controllers' models [1]; None: as the mission's ``plant``
        says.
    mass, friction : float
        Mass of the object and friction of all its contacts, relative to the mission's [1].
    shift : tuple of two floats
        Shift of the object's place, world x, y [m].
    seed : int, optional
        Seed of the measurement noise; None: the seed of the mission's ``plant``.
    tendon_friction : float
        Relative to the plant's [1].
    friction_fall : float
        Share of ``friction`` that all contacts lose from the middle of the hold on [1].

    Raises
    ------
    InputError
        A number is negative, or zero where nothing would be left, not finite, or a share above one.

    Examples
    --------
    >>> from continuum_grasp.addons.mission import PlantVariation
    >>> PlantVariation(mass=1.1, friction=0.8).friction_fall
    0.0
    """

    stiffness: float | None = None
    damping: float | None = None
    mass: float = 1.0
    friction: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)
    seed: int | None = None
    tendon_friction: float = 1.0
    friction_fall: float = 0.0

    def __post_init__(self) -> None:
        for name, (least, most) in _FACTORS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise InputError(f"expected a number from {least:g} to {most:g}, got {value}", key=name)
        if not np.isfinite(self.shift).all():
            raise InputError(f"expected a distance in x and in y [m], got {self.shift}", key="shift")


def mission_plant_model(assignment: Assignment) -> PlantModel:
    """Equations of the plant of one finger."""
    mission = assignment.mission
    control = assignment.control
    body = control.body
    mass = mission.grasp.object.mass if mission.object_mass is None else mission.object_mass
    scene = PlantModel.plant_scene(control).replaced(
        contacts=tuple(sorted({*control.contacts, *mission.more_contacts})),
        object=body.replaced(mass=mass),
        object_moves=True,
        supports=mission.grasp.supports,
        contact_law=mission.contact_law,
        out_of_plane_gravity=mission.gravity,
        table=_table(assignment, mass),
    )
    of_tendons = ("tendon_friction",) * scene.finger.has_tendon_friction
    return PlantModel(control, scene, (*_FINGER, *of_tendons), _OBJECT, falls=True)


def _table(assignment: Assignment, mass: float) -> dict[str, Any]:
    """Table that the object stands on: below the plane, or with gravity in the plane a wall below the object."""
    mission = assignment.mission
    body = assignment.control.body
    down = np.array(mission.grasp.gravity[:2])
    size = float(np.hypot(*down))
    if size == 0.0:
        return {"friction": mission.table_friction, "friction_radius": mission.table_friction_radius}
    angle = math.atan2(down[1], down[0])
    below = max(part.support(angle - body.angle) for part in body.parts)
    # Pressed in by the weight, the object stands where the grasp has it.
    below -= mass * size / mission.contact_law.stiffness
    x, y = np.array(body.position) + below * down / size
    return {"friction": mission.table_friction, "point": (float(x), float(y)), "normal_angle": angle + math.pi}


class MissionPlant(Plant):
    """The plant of one finger at the start of a mission, with an object whose height is measured for ``slip``.

    Its equations come from ``mission_plant_model``.
    """

    def __init__(
        self,
        assignment: Assignment,
        timetable: Timetable,
        prediction: Prediction,
        variation: PlantVariation,
        equations: PlantModel,
    ) -> None:
        self._mission = mission = assignment.mission
        # The equations have the factors of the mission's ``plant`` already.
        stiffness = 1.0 if variation.stiffness is None else variation.stiffness / mission.plant.stiffness
        damping = 1.0 if variation.damping is None else variation.damping / mission.plant.damping
        of_tendons = [variation.tendon_friction] * equations.scene.finger.has_tendon_friction
        factors = [stiffness, damping, *of_tendons, variation.mass, variation.friction]
        equations.p = np.array(equations.system.p_nominal) * np.array(factors)
        equations.outside = {**timetable.outside(), PlantModel.FALL: partial(timetable.fallen, variation)}
        first = own = mission.plant.seed if variation.seed is None else variation.seed
        if (number := list(mission.grasp.named_fingers).index(assignment.name)) > 0:
            # Each finger's sensors have noise of their own.
            own = int(np.random.SeedSequence((first, number)).generate_state(1)[0])
        super().__init__(assignment.control, prediction, mission.controller.period, equations, own)
        # All fingers are given the same height.
        self._height_noise = np.random.default_rng((first, 0xBE16))
        self.x = self.x.copy()
        if any(variation.shift):
            self.x[equations.system.object_states][:2] += _clear_of_supports(equations, self.x, variation.shift)

    @property
    def height(self) -> float:
        """Height of the object that is measured now [m]; NaN where it is not."""
        slip = self._mission.slip
        if slip is None or slip.height is None:
            return math.nan
        pose = self.seen()[1][self.model.system.object_states]
        height = float(self._mission.object_height(pose[None])[0])
        return height + self._mission.plant.noise * slip.height * self._height_noise.standard_normal()


def _clear_of_supports(equations: PlantModel, x: Array, shift: tuple[float, float]) -> Array:
    """The displacement (2) of an object [m] that is nearest to a shift and presses it on no support.

    One that begins inside a support is ejected by it: from 0.6 mm inside a palm of 20 kN/m the mug of
    configs/mission/mug.yaml goes 4 mm, before the finger comes. A support that it presses at x, as a table does, may be
    pressed as much.
    """
    system = equations.system
    moved = np.array(shift, dtype=float)
    supports = [k for k, name in enumerate(system.touch_names) if not name.startswith("finger.")]
    u = np.zeros(system.nu)
    w = np.zeros(len(system.w_names))
    at = system.object_states.start
    start = x[: system.nx]

    def touching(displacement: Array) -> tuple[Array, Array]:
        there = start.copy()
        there[at : at + 2] += displacement
        touched = system.touch.call({"x": there, "u": u, "w": w, "p": equations.p})
        return np.array(touched["gap"]).ravel()[supports], np.array(touched["normal"])[:, supports]

    least = np.minimum(touching(np.zeros(2))[0], 0.0)
    # 200: supports that a shifted object is moved out of, one after the other: between two walls each leaves a part of
    # what the other had, of a groove of 60 degrees a quarter
    for _ in range(200):
        gap, normal = touching(moved)
        deepest = int(np.argmin(gap - least)) if supports else 0
        # 1e-9: depth in a support that is none [m]: 20 uN at 20 kN/m
        if not supports or gap[deepest] - least[deepest] >= -1e-9:
            break
        moved -= (least[deepest] - gap[deepest]) * normal[:, deepest]
    return moved


def reserve(of: Assignment) -> float:
    """Share by which the fingers of a task may press harder than in the grasp [1]: as far as the drive of ``of`` has
    tension, and each contact may be pressed (``normal_force_max``).
    """
    contacts = of.grasp.contacts
    firmest = min(
        of.mission.grasp.normal_force_max(contact.name) / max(contact.normal_force, 1e-9) for contact in contacts
    )
    return max(0.0, min(of.reserve, firmest - 1.0))


def firmer(of: Assignment, share: float) -> dict[str, float]:
    """Further setpoints, by name, of a finger that presses harder by a share of the forces of its grasp [1]."""
    part = share / of.reserve if of.reserve else 0.0
    inputs = [entry.label for entry in of.control.finger.inputs]
    forces = {f"contact_force_{name} [N]": share * force for name, force in of.forces.items()}
    return dict(zip(inputs, part * (of.tight - of.held), strict=True)) | forces


@dataclass(frozen=True)
class Span:
    """A phase by name, from its start to its end [s]."""

    name: str
    start: float
    end: float


class Timetable:
    """Phases of a mission: of each stroke of a turn ``touch 1``, ``turn 1``, ``leave 1`` and so on, then approach,
    squeeze, settle if asked for, lift, hold, then ``pull 1`` and so on with a ``rest`` after each, lower, release, end.

    Before the lift there is a ``confirm`` of up to the time of the squeeze where contacts bear too little; ``resume``
    says when it ended and with what the mission goes on.
    """

    def __init__(self, assignment: Assignment) -> None:
        self.of = assignment
        asked = assignment.mission.phases
        turn = assignment.mission.turn
        self.strokes = tuple(str(k + 1) for k in range(0 if turn is None else turn.strokes))
        stroke = (("touch", asked.touch), ("turn", asked.stroke), ("leave", asked.leave))
        lengths = [(f"{name} {k}", length) for k in self.strokes for name, length in stroke]
        lengths += [("approach", asked.approach), ("squeeze", asked.squeeze)]
        lengths += [("settle", asked.settle)] * (asked.settle > 0.0)
        lengths += [("lift", asked.lift), ("hold", asked.hold)]
        for k in range(len(assignment.pulls)):
            lengths += [(f"pull {k + 1}", asked.pull), ("rest", asked.rest)]
        # "end": nothing is asked any more, so that what still moves comes to rest.
        lengths += [("lower", asked.lower), ("release", asked.release), ("end", 0.25 * asked.release)]
        ends = np.cumsum([length for _, length in lengths])
        self._planned = tuple(
            Span(name, float(end - length), float(end)) for (name, length), end in zip(lengths, ends, strict=True)
        )
        self._waits = self._plan("lift").start
        # Instants of the mission, those of the plan then, and whether that goes on or is waited for.
        self._pieces = [(0.0, 0.0, 1.0)]
        self._down = list[tuple[float, float, float]]()

    def _plan(self, name: str) -> Span:
        return next(span for span in self._planned if span.name == name)

    @property
    def latest(self) -> float:
        """Latest time at which the mission goes on [s]."""
        return self._waits + self.of.mission.phases.squeeze

    def resume(self, t: float, name: str) -> None:
        """Go on at an instant [s] with a phase, after what came before the lift; those between are left out."""
        waited = t - self._waits > 1e-9  # times are sums of rounded periods
        wait = [(self._waits, self._waits, 0.0)] * waited
        later = [(t, self._plan(name).start, 1.0)] * (waited or name != "lift")
        self._pieces = [self._pieces[0], *wait, *later]

    def set_down(self, t: float) -> None:
        """Lower the object from an instant on [s]; forces that pull at it then pull on to their end."""
        self._down = [(t, self._plan("lower").start, 1.0)]

    def planned(self, t: Array) -> Array:
        """Instants (T,) of the plan, in which nothing is waited for or left out, at instants of the mission [s]."""
        return self._along([*self._pieces, *self._down], t)

    @staticmethod
    def _along(pieces: list[tuple[float, float, float]], t: Array) -> Array:
        begin, plan, rate = np.array(pieces).T
        k = np.maximum(np.searchsorted(begin, t) - 1, 0)
        return np.asarray(plan[k] + rate[k] * (t - begin[k]))

    @property
    def spans(self) -> tuple[Span, ...]:
        """The phases with their times."""
        pieces = [*self._pieces, *self._down]
        spans = list[Span]()
        for (begin, plan, rate), end in zip(pieces, [*(piece[0] for piece in pieces[1:]), math.inf], strict=True):
            inside = [s for s in self._planned if plan <= s.start < plan + (end - begin)]
            late = begin - plan
            spans += [Span(s.name, s.start + late, min(s.end + late, end)) for s in inside if rate]
            spans += [] if rate else [Span("confirm", begin, end)]
        return tuple(spans)

    def span(self, name: str) -> Span:
        """The first phase of a name; of one that was left out, after all times."""
        return next((span for span in self.spans if span.name == name), Span(name, math.inf, math.inf))

    @property
    def duration(self) -> float:
        """Duration of all phases [s]."""
        return self.spans[-1].end

    def _risen(self, t: Array, name: str) -> Array:
        """From 0 before a phase to 1 after it, with continuous rate and acceleration, at instants of the plan."""
        span = self._plan(name)
        return _smooth((t - span.start) / (span.end - span.start))

    # -- the controller's -------------------------------------------------------------------------------------------

    def moves(self, names: Sequence[str]) -> tuple[Array, Array, Array, Array]:
        """Setpoints (nr), in the order of ``Stages.r_names``, at first, and smooth moves of them: begin and duration of
        each (M) [s], and by how much it moves them (M, nr).
        """
        of = self.of
        turn = self.of.mission.turn
        finger = self.of.control.finger
        inputs = [finger_input.label for finger_input in finger.inputs]
        bends = [f"bending_{k + 1} [rad]" for k in range(len(of.bends))]
        forces = {f"contact_force_{name} [N]": force for name, force in of.forces.items()}
        first = dict(zip(inputs, of.rest, strict=True))
        by = {
            "begun": dict(zip((*inputs, *bends), (*of.before - of.rest, *of.bends), strict=True)),
            "closed": dict(zip((*inputs, *bends), (*of.held - of.before, *of.posture - of.bends), strict=True))
            | forces,
        }
        # The posture goes from straight to touching, and from there to the grasp, the last share of it while the force
        # is followed; release undoes all at once.
        share = of.mission.phases.squeeze_share
        moves = list[tuple[str, float, str, float]]()
        if turn is not None:
            first |= {"gap_finger.tip [m]": turn.clearance, "object_angle [rad]": of.object_pose[2] - turn.angle}
            by |= {"touched": {"gap_finger.tip [m]": -turn.clearance}, "turned": {"object_angle [rad]": turn.angle}}
            for k in self.strokes:
                moves += [(f"touch {k}", 1.0, "touched", 1.0), (f"turn {k}", MOVES, "turned", 1.0 / turn.strokes)]
                moves += [(f"leave {k}", 1.0, "touched", -1.0)]
            # After a turn the object stands as in the grasp: the finger leaves it from about where it touches there.
            moves += [(f"leave {self.strokes[-1]}", 1.0, "begun", -1.0)]
            first = {name: first.get(name, 0.0) + by["begun"].get(name, 0.0) for name in {**first, **by["begun"]}}
        moves += [("approach", 1.0, "begun", 1.0), ("squeeze", 1.0, "closed", share)]
        if share < 1.0:
            moves += [("settle", 1.0, "closed", 1.0 - share)]
        if of.standing:
            by["firmer"] = firmer(of, of.standing)
            moves += [("lift", MOVES, "firmer", 1.0), ("release", 1.0, "firmer", -1.0)]
        moves += [("release", 1.0, "closed", -1.0), ("release", 1.0, "begun", -1.0)]
        spans = [self._plan(name) for name, *_ in moves]
        return (
            np.array([first.get(name, 0.0) for name in names]),
            np.array([span.start for span in spans]),
            np.array([part * (span.end - span.start) for span, (_, part, *_) in zip(spans, moves, strict=True)]),
            np.array([[much * by[what].get(name, 0.0) for name in names] for *_, what, much in moves]),
        )

    def phases(self) -> list[Span]:
        """The planned phases, with a ``confirm`` of no length before the lift."""
        k = [span.name for span in self._planned].index("lift")
        return [*self._planned[:k], Span("confirm", self._waits, self._waits), *self._planned[k:]]

    # -- the plant's ------------------------------------------------------------------------------------------------

    def outside(self) -> dict[str, Callable[[Array], Array]]:
        """Height of the table, and what pulls at the object, as functions of instants."""
        return {
            "table_height [m]": self._table,
            **{name: partial(self._pull, k) for k, name in enumerate(PlantModel.WRENCH)},
        }

    def fallen(self, variation: PlantVariation, t: Array) -> Array:
        """Share (T,) by which friction of contacts has fallen on a plant at instants (T,) of the mission [s]."""
        span = self._plan("hold")
        return variation.friction_fall * _smooth(
            # Within two periods.
            0.5 * (self._along(self._pieces, t) - 0.5 * (span.start + span.end)) / self.of.control.controller.step
        )

    def _table(self, t: Array) -> Array:
        t = self.planned(t)
        # 0.05: distance by which the table sinks [m]
        return -0.05 * (self._risen(t, "lift") - self._risen(t, "lower"))

    def _pull(self, axis: int, t: Array) -> Array:
        # What pulls does not know that the object is set down; what has not begun by then does not come.
        t, total = self._along(self._pieces, t), np.zeros_like(t)
        down = self._along(self._pieces, np.array([piece[0] for piece in self._down] or [math.inf]))
        for k, wrench in enumerate(self.of.pulls):
            span = self._plan(f"pull {k + 1}")
            if span.start > down:
                break
            quarter = 0.25 * (span.end - span.start)  # to grow, and to fade; half of it stays
            total += wrench[axis] * _smooth((t - span.start) / quarter)
            total -= wrench[axis] * _smooth((t - span.end + quarter) / quarter)
        return total


def _smooth(share: Array) -> Array:
    """The quintic of ``control/c/mission.c``, by which the table and pulls move."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
