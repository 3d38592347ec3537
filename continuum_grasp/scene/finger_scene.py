"""A finger with its loads, its inputs and the fidelity of its model: all that its dynamics need."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from itertools import accumulate
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.drives import COMMANDS, TAKES, MotorDrive
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.loads import Actuation, Load, MomentLoad, Samples
from continuum_grasp.scene.methods import FamilyName
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    SAME,
    Acceleration,
    Configuration,
    Increasing,
    Length,
    ListOf,
    Real,
    Value,
)


class Fidelity(Value):
    """Resolution of the finger's model: by a tolerance, or by family, elements and accuracy."""

    DEFAULT_RANGE: ClassVar = 2.0 * math.pi / 3.0
    """Bending range of one element by default [rad]; equation (44) of the paper."""
    WIDEST: ClassVar = 40.0
    """Greatest bend of one element [rad], six turns: clothoids then need all of 32 quadrature nodes."""

    tolerance: Annotated[float, Field(ge=1e-9, le=0.5, examples=[0.005, "0.5 %"]), Unit("1")] | None = None
    """Greatest error of position per length, and of frequency where the scene moves [1], such as 0.005 or 0.5 %.
    The cheapest model that keeps it in this scene is found by measurement; what else is given stays fixed."""
    frequencies: Annotated[int, Field(ge=0, le=2)] = 1
    """Number of natural frequencies, from the first on, that must keep the tolerance where the scene moves."""
    family: FamilyName | None = None
    """Curvature family; None: matched_clothoid, or clothoid where the tip balance is not given by the input alone
    (tendon friction, quadratic damping, a moment on the tip that varies) or does not fit the pose at time zero."""
    elements: (
        Annotated[int, Field(ge=1, le=64)] | Annotated[ListOf[Length], Field(min_length=1, max_length=64)] | None
    ) = None
    """Number of elements, or their lengths from base to tip [m]. None: two, or one per segment between contacts and
    jumps of the rest curvature; with stops, enough elements, up to 16, to let each bend by at most one turn when links
    touch. Equilibria, modes and motions double this number, up to 16, until the error is below 1 %; controllers,
    exports and pages do not change it. For a grasp, None means eight, or 16 if exact rods take clearly other forces."""
    bending_range: Annotated[float, Field(ge=1e-3, le=WIDEST, examples=[2.5]), Unit("rad")] | None = None
    """Greatest bend of one element [rad] (for clothoids: its length times its greatest curvature), including the bend
    at rest, that controllers, grasps and C packages allow. None: chosen from the shapes of equilibria and motions; for
    packages also from the scene's inputs and loads; for controllers and plans from the setpoints of angles. The least
    is 2 pi / 3, or less if more than four elements share 8 pi / 3 or the strain limit allows less; with stops at least
    1.5 times the bend at which links touch; at least half of the range remains beyond the shape at rest. At most 40
    rad."""
    accuracy: Annotated[float, Field(ge=1e-16, le=1e-2, examples=[1e-6]), Unit("1")] | None = None
    """Relative accuracy of the evaluation of the chosen family over the bending range (Horner terms, quadrature nodes)
    [1]; None: rounding for arcs, and about the discretization error for clothoids."""

    def check_lengths(self, key: str, length: float, contacts: Sequence[float] = ()) -> None:
        """Refuse lengths of elements, of a fidelity at a key, that do not fit the finger's and its contacts [m]."""
        edges = [*accumulate(self.elements)] if isinstance(self.elements, tuple) else [*contacts, length]
        if abs(edges[-1] - length) > SAME * length:
            raise ValueError(f"{key}.elements: their lengths add up to {edges[-1]:.9g} m, the finger has {length} m")
        for at in contacts:
            if min(abs(at - edge) for edge in edges) > SAME * length:
                raise ValueError(f"{key}.elements: no element ends at {at} m, where contacts has an entry")


class Initial(Value):
    """State at time zero: a named pose, or bending and rates."""

    REFUSALS = Consumer.refusals(
        """
        friction_states without reached_by=state: friction_states and reached_by: state need each other
        reached_by=state without friction_states: friction_states and reached_by: state need each other
        path without reached_by=path: path and reached_by: path need each other
        reached_by=path without path: path and reached_by: path need each other
        path with motor_angles: has no effect: motors that stand at one angle are not commanded
        qd with pose: a named pose is at rest
        {held_by,motor_angles,path} without pose=equilibrium
        held_by.input: has no effect: what holds the finger is released at time zero
        held_by.{force,moment}.times: must be constant
        path.{tip_moment,tensions,lengths,torques,angles,pressures}.times: must be constant
        """
    )

    pose: Literal["straight", "rest", "equilibrium"] | None = None
    """straight; rest: the unloaded shape; equilibrium: under the scene's loads at time zero and ``held_by``. None
    without ``q``: straight, in plans and closed loops the unloaded shape."""
    held_by: ListOf[Load] = ()
    """Constant loads that hold the equilibrium pose and are released at time zero."""
    q: Annotated[ListOf[Real], Unit("rad or 1/m")] | None = None
    """Bending coordinates minus their values at rest: angles [rad] (arcs) or nodal curvatures [1/m] (clothoids)."""
    qd: Annotated[ListOf[Real], Unit("rad/s or 1/(m s)")] | None = None
    """Rates of the bending coordinates [rad/s] (arcs) or [1/(m s)] (clothoids)."""
    reached_by: Literal["pulling", "releasing", "path", "state"] | None = None
    """Path of the finger to its posture, for friction of tendons or of bending. pulling: from its unloaded shape;
    weight and loads came first, then the drives pulled. releasing: the drives first pulled far enough, so that all
    sections have since slid back by at least twice the presliding. path: through the inputs of ``path``. state: by
    ``friction_states``. None: nothing slid, and friction is zero; an equilibrium needs one of the other values."""
    path: ListOf[Actuation] = ()
    """Earlier inputs of the drives, in order, before the inputs at time zero, as ``[{tensions: [20, 0]},
    {tensions: [5, 0]}]``."""
    friction_states: Annotated[ListOf[Real], Unit("1")] | None = None
    """Direction of friction in each friction cell, from -1 to 1 [1]: as ``x_names`` of the model lists them."""
    motor_angles: Annotated[ListOf[Real], Unit("rad")] | None = None
    """Angles of motors in an equilibrium [rad], one per motor: dry friction, a worm gear or a brake holds them there,
    whatever the command is. A motion begins with the command from there. None: the commands determine the angles."""

    @property
    def without_history(self) -> Self:
        """Initial pose without the history of friction: for a finger without friction, or another finger."""
        return self.replaced(reached_by=None, friction_states=None, path=())

    def _check(self) -> None:
        self._check_one_given("pose", "q")


def begins(pose: str) -> BeforeValidator:
    """Make the default pose of a scene hold also where its ``initial`` says something else alone."""

    def completed(value: Any) -> Any:
        posed = not isinstance(value, dict) or any(value.get(key) is not None for key in ("pose", "q"))
        return value if posed else {**value, "pose": pose}

    return BeforeValidator(completed)


class FingerScene(Configuration):
    """Keys that scenes of one finger have in common."""

    REFUSALS: ClassVar[tuple[Consumer, ...]] = Consumer.refusals(
        """
        initial.reached_by without finger.has_friction: has no effect: neither tendons nor bending have friction
        finger.damping.friction_cells without finger.damping.dry_friction:
            has no effect: these are cells of finger.damping.dry_friction
        """
    )

    finger: Finger
    """The finger."""
    gravity: Acceleration
    """World gravity [m/s2]."""
    contacts: Annotated[ListOf[Length], Increasing] = ()
    """Increasing positions along the finger of possible contact forces [m]; they are element boundaries. The finger
    touches an object only at these positions and at the tip."""
    fidelity: Fidelity = Fidelity()
    """Resolution of the finger's model."""
    parameters: ListOf[str] = ()
    """Names of model parameters that stay run-time arguments of the generated functions and controllers."""

    @property
    @abstractmethod
    def simulated(self) -> LoadedFinger:
        """The scene as models and simulations take it."""

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts that the finger may have with an object."""
        return (*[f"finger.{k + 1}" for k in range(len(self.contacts))], "finger.tip")

    def _check(self) -> None:
        self.finger.rod.check_inside("contacts[{}]", self.contacts, tip=False)
        self.fidelity.check_lengths("fidelity", self.finger.rod.length, self.contacts)
        if self.fidelity.family is not None:
            self.finger.check_family("fidelity.family", self.fidelity.family)
        if self.gravity[1] > abs(self.gravity[0]):
            self._doubt("gravity", f"= {list(self.gravity)} m/s2 points up, along +Y; is a minus sign missing?")


class LoadedFinger(FingerScene):
    """One finger with gravity, contacts, inputs, loads and initial state: what a model is made of."""

    REFUSALS = Consumer.refusals(
        "\n".join(f"{{actuation,initial.path}}.{key} without finger.input_keys={key}: {TAKES}" for key in COMMANDS)
    )

    actuation: Actuation | None = None
    """Inputs over time; None: the finger is passive and its tendons are slack."""
    initial: Annotated[Initial, begins("straight")] = Initial(pose="straight")
    """State at time zero."""
    loads: ListOf[Load] = ()
    """Forces and moments on the finger, constant or over time."""

    def _check(self) -> None:
        self.finger.rod.check_inside("loads[{}].at", (load.at for load in self.loads))
        self.finger.rod.check_inside("initial.held_by[{}].at", (load.at for load in self.initial.held_by))
        if self.actuation is not None:
            self._check_commands("actuation", self.actuation)
        for k, inputs in enumerate(self.initial.path):
            self._check_commands(f"initial.path[{k}]", inputs)
        motors = sum(isinstance(drive, MotorDrive) for drive in self.finger.winches)
        self._check_count("initial.motor_angles", self.initial.motor_angles, motors, "drive.kind: motor")

    def _check_commands(self, place: str, inputs: Actuation) -> None:
        """Refuse commands that do not fit the drives and chambers, or are beyond their limits."""
        finger, commands = self.finger, inputs.given
        for key in dict.fromkeys(finger.input_keys):
            limits = [each for each in finger.inputs if each.key == key]
            allowed = _ALLOWED.get(key, "what drive.torque_max allows, {:g} to {:g}")
            ends = [(each.least, each.most) for each in limits]
            finger.check_commands(f"{place}.{key}", commands.get(key, ()), ends, allowed)

    @property
    def simulated(self) -> Self:
        """The scene itself."""
        return self

    @property
    def moves(self) -> bool:
        """Whether a motion is asked for."""
        return False

    @property
    def tip_moment_jumps(self) -> bool:
        """Whether the moments on the tip at time zero ask for another curvature there than the initial pose has.

        A matched tip then starts with the curvature of those moments, not with the pose's.
        """
        rod, initial, actuation = self.finger.rod, self.initial, self.actuation
        if initial.pose == "equilibrium":
            return any(isinstance(load, MomentLoad) and rod.is_tip(load.at) for load in initial.held_by)
        moments = [load for load in self.loads if isinstance(load, MomentLoad)]
        moment = sum(_at_zero(load.moment) for load in moments if rod.is_tip(load.at))
        inside = [_at_zero(load.moment) for load in moments if load.input]
        if actuation is not None and actuation.tip_moment is None and not self.finger.winches:
            pulls = [_at_zero(pull) for pull in actuation.values]
            for channel in self.finger.channels:
                amplitude = channel.gain * sum(arm * pull for arm, pull in zip(channel.arms, pulls, strict=True))
                if channel.shape.constant is None:
                    inside.append(amplitude)
                else:
                    moment += amplitude
        elif actuation is not None:
            moment += _at_zero(actuation.tip_moment or 0.0)
        curvature = float(self.finger.profile.rest_curvature(rod.length)) if initial.pose != "rest" else 0.0
        return moment != 0.0 or curvature != 0.0 or any(inside)


def _at_zero(value: float | Samples) -> float:
    """The value at time zero, linear between samples: whether it vanishes is all that is asked of it."""
    import numpy as np

    if not isinstance(value, Samples):
        return value
    if value.interpolation == "hold":
        return value.values[max(sum(at <= 0.0 for at in value.times) - 1, 0)]
    return float(np.interp(0.0, value.times, value.values))


_ALLOWED = {
    "tensions": "min_tension = {:g} to max_tension = {:g} N",
    "pressures": "min_pressure = {:g} to max_pressure = {:g} Pa",
}
