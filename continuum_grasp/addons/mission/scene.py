"""A whole grasp under control: approach, squeeze, lift, hold against disturbances, release."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from continuum_grasp.base import Array
from continuum_grasp.scene import (
    AnyTendons,
    Configuration,
    Consumer,
    ContactLaw,
    Duration,
    EstimatorSettings,
    Extent,
    GraspScene,
    Horizon,
    Length,
    Limited,
    ListOf,
    NonNegative,
    PlantDifferences,
    Position,
    Positive,
    Real,
    Unit,
    Value,
)

Count = Annotated[int, Field(ge=1, le=8)]
_Spread = Annotated[float, Field(ge=0.0, lt=1.0), Unit("1")]


class Phases(Value):
    """Durations of the phases; setpoints move smoothly within a phase."""

    REFUSALS = Consumer.refusals("squeeze_share without settle")

    touch: Duration = 0.8
    """Time of each stroke of a ``turn``, until the tip touches the object [s]."""
    stroke: Duration = 1.5
    """While the object is turned [s]."""
    leave: Duration = 0.6
    """Until the tip has left it [s]; after the last stroke, until the finger is straight."""
    approach: Duration = 0.8
    """From the straight finger until it is about to touch [s]."""
    squeeze: Duration = 0.8
    """Until the contact forces reach the grasp's, or ``squeeze_share`` of them [s]."""
    squeeze_share: Annotated[float, Field(gt=0.0, le=1.0, examples=[0.85, "85 %"]), Unit("1")] = 1.0
    """Share of the contact forces that the posture closes up to; the rest rises in ``settle``, where the force is
    followed [1]. Below 1 the posture of a finger that differs from its model does not overshoot the force: tendons with
    friction are pulled all the way, and the history of their friction is known."""
    settle: Annotated[NonNegative, Unit("s")] = 0.0
    """While the force is followed and the object still stands on the table [s]; 0: it is followed from the lift on."""
    lift_share: Annotated[float, Field(ge=0.0, le=1.0, examples=[0.5, "50 %"]), Unit("1")] = 0.5
    """Share of its normal force in the certificate that each contact of a finger has to bear before the lift, by the
    estimate: otherwise, and while sensors contradict the finger's model, the fingers squeeze on for as long as
    ``squeeze``, following the force, and then let go where it lacks. Before the run the same force is asked of the
    fingers on compliant pads. 0: the object is lifted whatever they bear [1]."""
    lift: Duration = 0.3
    """While the table under the object sinks away [s]."""
    hold: Duration = 1.0
    """Time before anything pulls [s]."""
    pull: Duration = 0.4
    """Time of each disturbance: a quarter to grow, half to stay, a quarter to fade [s]."""
    rest: Duration = 0.2
    """Time after each disturbance [s]."""
    hold_until_release: bool = False
    """Whether an exported controller then holds the object until it is asked to release; runs of the mission release it
    there."""
    lower: Duration = 0.3
    """While the table comes back [s]."""
    release: Duration = 0.8
    """Until the finger is straight again [s]; a quarter of that follows in which nothing is asked."""


class MissionController(Limited):
    """The controller in all phases."""

    period: Annotated[float, Field(ge=1e-4, le=1.0), Unit("s")] = 0.01
    """Time from one command to the next [s]."""
    horizon: Horizon = Horizon(stages=20)
    """Time grid of the prediction."""
    elements: Annotated[tuple[Count, Count], Field(strict=False)] = (2, 2)
    """Matched clothoids before the first and after the last middle contact; between two there is one. Of a finger
    without middle contacts together as many."""
    posture: Annotated[Positive, Unit("1/rad2")] = 50.0
    """Weight of the bending angles while nothing is touched [1/rad2]."""
    force: Annotated[Positive, Unit("1/N2")] = 1.0
    """Weight of the contact force while the object is held [1/N2]."""
    object_angle: Annotated[Positive, Unit("1/rad2")] = 1e4
    """Weight of the object's angle while it is turned [1/rad2]."""
    gap: Annotated[Positive, Unit("1/m2")] = 1e4
    """Weight of the distance of the tip from the object meanwhile [1/m2]."""
    held: Literal["middle", "tip", "all"] = "middle"
    """Contact of each finger whose normal force is held at the grasp's. middle: of the middle contacts the one
    that presses hardest, of a finger without one the tip; all: every contact, with equal weights, where one drive holds
    the best compromise only."""
    speed: Annotated[NonNegative, Unit("s2/rad2")] = 0.05
    """Weight of the bending rates [s2/rad2]."""
    effort: Annotated[Positive, Unit("1/N2")] = 0.001
    """Weight of the tensions away from the grasp's [1/N2]."""
    input_rate: Annotated[NonNegative, Unit("s2/N2")] = 1e-5
    """Weight of the tensions' rates [s2/N2]."""
    retained: Annotated[float, Field(gt=0.0, le=1.0, examples=[0.85, "85 %"]), Unit("1")] = 0.85
    """Share of the grasp's tension that the closing tendon keeps while the object is held, however large its force is
    estimated [1]. Commanded positions keep what leaves as much of that at the lift; with 1 they let nothing out again,
    so that friction of the tendons keeps acting as it did when they were pulled, and a force that is too high at the
    lift stays too high."""


class Turn(Value):
    """Pose of the object before its grasp, and the strokes that turn it into the grasp: pushed on its table by the
    fingertip.

    The controller predicts the object's pose meanwhile, with friction of fingertip, table and supports, and a camera
    measures it (``estimator.measured.object``).
    """

    angle: Annotated[Real, Field(examples=[0.5235987755982989, "30 deg"]), Unit("rad")]
    """By which it is turned until it stands as in the grasp, counter-clockwise [rad]."""
    position: Position
    """World position at which it stands before [m]."""
    strokes: Annotated[int, Field(ge=1, le=8)] = 1
    """Into how many equal parts the turn is divided; after each one the tip leaves the object and touches it anew."""
    clearance: Annotated[Extent, Field(examples=[0.02, "20 mm"])] = 0.02
    """Distance to which the tip leaves the object between two strokes [m]."""
    tolerance: Annotated[Positive, Field(examples=[0.03490658503988659, "2 deg"]), Unit("rad")] = math.radians(2.0)
    """Error of the angle up to which it counts as turned [rad]."""

    def _check(self) -> None:
        if self.angle == 0.0:
            raise ValueError("angle must not be zero: omit `turn` where the object should not turn")
        if abs(self.angle) > math.pi:
            self._doubt("angle", f"= {self.angle:g} rad is more than half a turn (expected: rad, or a number with deg)")
        if self.tolerance >= abs(self.angle):
            raise ValueError(f"tolerance = {self.tolerance:g} rad is not less than the angle, {abs(self.angle):g} rad")


class Slip(Value):
    """Signs of slip that are watched while the object is held, and limits from which on they are answered.

    An object that sinks in the hand, or a contact that bears hardly anything, makes the fingers squeeze as hard as
    drives and ``grasp.contacts.normal_force_max`` allow. Where that does not stop it, it is set down.
    """

    height: Annotated[Extent, Field(examples=[1e-4, "0.1 mm"])] | None = None
    """Standard deviation of the object's measured height in the hand [m]; None: not measured, and what sinks is not
    noticed."""
    sunk: Annotated[Extent, Field(examples=[6e-5, "0.06 mm"])] = 6e-5
    """Height lost since the lift, beyond what fingers give way along gravity, that is answered once it stands out of
    the noise; half of ``height`` at least [m]. In a firm grip that has settled three times as much sets the object
    down."""
    down: Annotated[Extent, Field(examples=[2.5e-3, "2.5 mm"])] = 2.5e-3
    """Height lost since the lift, while the grip becomes firm, from which on the object is set down [m]."""
    parted: Annotated[float, Field(ge=0.0, le=1.0, examples=[0.1, "10 %"]), Unit("1")] = 0.1
    """Share of its normal force in the certificate below which a contact counts as parted, by the estimate [1]; 0:
    never."""

    def _check(self) -> None:
        self._check_below("sunk", "down")


class Trials(Value):
    """Plants that differ at random, each evenly within its range either way."""

    count: Annotated[int, Field(ge=1, le=100_000)] = 100
    """Number of plants."""
    stiffness: _Spread = 0.10
    """Range of the bending stiffness [1]."""
    damping: _Spread = 0.30
    """Range of the damping [1]."""
    mass: _Spread = 0.10
    """Range of the object's mass [1]."""
    friction: _Spread = 0.10
    """Range of all friction coefficients between finger, object and supports [1]."""
    tendon_friction: _Spread = 0.0
    """Range of the friction of the tendons [1]."""
    friction_fall: Annotated[float, Field(ge=0.0, lt=1.0, examples=[0.3, "30 %"]), Unit("1")] = 0.0
    """Share by which friction between finger, object and supports falls in the middle of the hold, on all plants
    [1]."""
    position: Annotated[NonNegative, Unit("m")] = 0.001
    """Range of each coordinate of where the object stands [m]."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the random numbers; equal seeds give equal plants."""


_CARRIERS = Consumer.refusals(
    """
    tendons with jumps: needs a time_constant: tensions that jump throw a fine finger
    tendons with torques: a mission commands tensions, lengths of winches or angles of motors with a position_gain
    """,
    jumps=lambda finger: not finger.winches and None in {tendon.time_constant for tendon in finger.tendon_list},
    torques=lambda finger: not {"tensions", "lengths", "angles"}.issuperset(finger.input_keys),
)


class MissionScene(Configuration):
    """A grasp that is optimized first, and then carried out by a controller on a plant.

    Each finger has a controller of its own, which knows nothing of the others. It believes that the object is fixed and
    touches at the finger's middle contacts of the grasp and at its tip, without friction unless its estimator has
    ``contact_friction``; in the plant the object moves, has friction and a weight and stands on a table until that
    sinks away. The table lies below the plane, or with gravity in the plane below the object in it. With a ``turn`` the
    controller predicts the object's pose, and turns it on the table first.
    """

    REFUSALS = Consumer.refusals(
        """
        grasp.gravity with no_table:
            must be [x, y, 0] or [0, 0, z], z below zero: a mission lifts the object off a table in or below the plane
        plant.mounting: works only for closed loops: a mission counts as the model does, leave it out
        plant.{object_mass,object_friction}: works only for closed loops: give object_mass, and contact_law.friction
        grasp.{,finger.,fingers.}contacts.tip=off with grasp.setups.tip=off:
            must have the tip: a mission closes with it
        estimator.measured.object phases.{touch,stroke,leave} controller.{object_angle,gap} without turn: needs a turn
        turn without estimator.measured.object:
            needs estimator.measured.object, by which the controller knows where the object is
        estimator.disturbances.object_position with turn: has no effect with a turn: a camera measures it
        drive_tension with tendons: has no effect beside tendons, which have a max_tension
        table_friction_radius turn without gravity:
            works only for a table below the plane: it needs grasp.gravity: [0, 0, z]
        turn with several:
            needs a grasp of one finger: a controller predicts what its own finger does to the object, not
            what others do
        """,
        several=lambda s: len(s.grasp.setups) > 1,
        no_table=lambda s: s.gravity < 0.0 or any(s.grasp.gravity[:2]) is (s.gravity > 0.0),
    )

    grasp: GraspScene
    """The grasp, or the path of its file relative to this file: fingers with tendon drives, each with its tip on the
    object, and middle contacts as it has them."""
    contact_law: ContactLaw
    """Law of all contacts; the controller knows it but for its friction."""
    controller: MissionController = MissionController()
    """The controller in all phases."""
    estimator: EstimatorSettings
    """Measured quantities, and estimated ones."""
    plant: PlantDifferences = PlantDifferences()
    """Differences of the plant from the controller's model."""
    tendons: AnyTendons | None = None
    """Tendons of the finger that carries the grasp out, with their drives; None: the grasp's tendons."""
    drive_tension: Annotated[Positive, Field(examples=[60.0, "60 N"]), Unit("N")] | None = None
    """Greatest tension of the drives [N], where the grasp keeps some in reserve; None: the grasp's."""
    object_mass: Annotated[Positive, Unit("kg")] | None = None
    """Mass of the object in the plant [kg]; None: the grasp's."""
    table_friction: Annotated[NonNegative, Unit("1"), Field(examples=[0.5])] = 0.3
    """Friction coefficient between the object and the table on which it stands until it is held [1]."""
    table_friction_radius: Annotated[NonNegative, Unit("m"), Field(examples=[0.02, "20 mm"])] = 0.0
    """Greatest moment of the table's friction against turning, per its greatest friction force [m]; see
    ``table.friction_radius`` of closed loops. 0: the object turns freely on the table."""
    turn: Turn | None = None
    """A turn of the object on its table before it is grasped; None: it stands as in the grasp."""
    slip: Slip | None = None
    """Answer to an object that slips while it is held; None: it is held as planned."""
    more_contacts: ListOf[Length] = ()
    """More positions along each finger where it may touch the object in the plant, which its controller does not know
    [m]."""
    phases: Phases = Phases()
    """Durations of the phases."""
    pull_share: Annotated[float, Field(ge=0.0, le=10.0), Unit("1")] = 1.0
    """Share of the disturbances that the certificate promises to resist, pulled one after the other [1]."""
    beyond_certificate: Literal["warn", "refuse"] = "warn"
    """Treatment of a mission with a heavier object, less friction, stronger pulls or a weaker drive than the
    certificate of its grasp covers. warn: it is tried, after a warning with both numbers; refuse: it is an error."""
    trials: Trials = Trials()
    """Plants that differ at random, for ``--trials``."""

    def _check(self) -> None:
        if "table" in (*self.grasp.named_fingers, *self.grasp.supports):
            raise ValueError("grasp: a finger or support has the name of the table: use another")
        for setup in self.grasp.setups:
            self.plant.fidelity.check_lengths("plant.fidelity", setup.finger.rod.length)
            # The tip is a contact already.
            setup.finger.rod.check_inside("more_contacts[{}]", self.more_contacts, tip=False)
            if self.turn is not None and setup.finger.base_free is None:
                setup.check_reach("turn", self.turn.position, self.grasp.object)
            finger = setup.finger
            where = f"grasp.{setup.where}"
            if self.tendons is not None:
                finger = finger.replaced(tendons=self.tendons)
                where = ""
            for feature in _CARRIERS:
                feature.check(finger, where)

    @property
    def gravity(self) -> float:
        """Gravity onto a table below the plane [m/s2]; zero where it acts in the plane."""
        return -self.grasp.gravity[2] or 0.0

    def object_height(self, pose: Array) -> Array:
        """Height (K,) of an object with poses (K, 3 or 4): out of the plane, or in it against gravity [m]."""
        up = -np.array(self.grasp.gravity[:2])
        size = float(np.hypot(*up))
        return np.asarray(pose[:, 3] if size == 0.0 else pose[:, :2] @ up / size)
