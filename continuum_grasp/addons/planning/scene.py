"""A motion to be planned as a whole: from where, to what, at what cost and within which limits."""

from __future__ import annotations

from itertools import chain
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from continuum_grasp.base import InputError
from continuum_grasp.scene import (
    Bounds,
    CommandedScene,
    Consumer,
    ContactLaw,
    Cost,
    Duration,
    Fidelity,
    ForceLoad,
    GraspScene,
    InputLimits,
    Length,
    ListOf,
    NonNegative,
    Position,
    Positive,
    Row,
    Scene,
    SolverOptions,
    Unit,
    Value,
)


def _exact(value: Any) -> Any:
    """A bare row is what must be reached exactly."""
    return {"value": value} if isinstance(value, list | tuple) else value


class _Aim(Value):
    REFUSALS = Consumer.refusals("tolerance without weight: needs a weight; without one the goal is reached exactly")

    weight: Annotated[Positive, Field(examples=[1e6]), Unit("per square of the error's unit")] | None = None
    """Weight of half the squared error [per square of the error's unit]; None: reached exactly."""
    tolerance: Annotated[Positive, Field(examples=[1e-3]), Unit("unit of the error")] | None = None
    """Greatest error with which a goal that has a weight counts as reached [unit of the error]; None: 1 % of the
    finger's length of a point, 0.05 rad of an angle, and of forces and inputs a tenth of the greatest; of forces that
    are all zero a tenth of 5 E I / L^2."""


class RowAim(_Aim):
    """Numbers that are to be reached."""

    value: Annotated[Row, Unit(None)]
    """The numbers, in the unit of what they are given for."""


class PointAim(_Aim):
    """A point that is to be reached."""

    value: Position
    """World position [m]."""


class ShapeAim(_Aim):
    """Points along the finger that are to be reached."""

    at: Annotated[ListOf[Length], Field(min_length=1)]
    """Positions along the finger [m]."""
    value: Annotated[ListOf[Position], Field(min_length=1)]
    """World positions of the points [m]."""

    def _check(self) -> None:
        self._check_count("value", self.value, len(self.at), "position of at")


Aim = Annotated[RowAim, BeforeValidator(_exact, json_schema_input_type=Row | RowAim)]
TipAim = Annotated[PointAim, BeforeValidator(_exact, json_schema_input_type=Position | PointAim)]


class Goal(Value):
    """End of the motion."""

    end: Literal["moving", "still", "held"] = "still"
    """moving: with any speed; still: all rates are zero; held: the accelerations too, so that the finger stays there
    under its last input."""
    tip: TipAim | None = None
    """World position of the tip [m]."""
    bending: Annotated[Aim, Unit("rad")] | None = None
    """Bending angle of each element of the model [rad]."""
    shape: ShapeAim | None = None
    """World positions of points along the finger."""
    contact_force: Annotated[Aim, Unit("N")] | None = None
    """Normal force at each place where the finger may touch the object, from base to tip [N]."""
    input: Annotated[Aim, Unit("unit of the input")] | None = None
    """Last input: tip moment, tensions, or what drives take [unit of the input]."""

    @property
    def targets(self) -> dict[str, tuple[float, ...]]:
        """Targets, by key: rows of numbers, x and y of points one after the other."""
        targets = {key: aim.value for key, aim in self if isinstance(aim, RowAim | PointAim)}
        return targets if self.shape is None else {**targets, "shape": tuple(chain.from_iterable(self.shape.value))}


class DurationRange(Value):
    """A duration to optimize."""

    least: Annotated[Duration, Field(examples=[0.05, "50 ms"])]
    """Shortest duration [s]."""
    most: Annotated[Duration, Field(examples=[0.6, "600 ms"])]
    """Longest duration [s]."""

    def _check(self) -> None:
        self._check_below("least", "most")


class PlanInput(InputLimits):
    """Limits of the input, and how it runs over an interval."""

    form: Literal["hold", "linear"] = "hold"
    """hold: constant over an interval; linear: a straight line, without jumps from ``initial`` on."""
    initial: Annotated[Row, Unit("unit of the input")] | None = None
    """Input before the motion begins [unit of the input]; None: no tip moment, the least tensions, or the pretension of
    drives."""


class PlanBounds(Bounds):
    """Bounds that hold at the nodes of the grid; penalties of soft bounds are per share and second."""

    usual_penalty = "hard"
    least_tension: Annotated[NonNegative, Unit("N")] | None = None
    """Least tension of tendons under winches or motors at the nodes [N]; None: half their pretension, or nothing on
    one_pulley. Of two tendons with drives of their own the cheapest plan leaves one just about slack, where its tension
    is hardly defined; on one pulley the bend decides."""


class PlanSolver(SolverOptions):
    """The solver and its options."""

    REFUSALS = Consumer.refusals(
        "hessian=exact with method=sqp: needs gauss_newton for method: sqp, since its QPs have to be convex"
    )

    hessian: Literal["exact", "gauss_newton"] = "exact"
    """gauss_newton: without the curvature of the motion and of the bounds."""
    tolerance: Annotated[float, Field(ge=1e-12, le=1e-2, examples=[1e-8]), Unit("1")] = 1e-8
    """Relative tolerance of the solver, on optimality and constraints [1]."""
    max_iterations: Annotated[int, Field(ge=1, le=100_000)] = 500
    """Greatest number of iterations per start."""
    max_total_iterations: Annotated[int, Field(ge=1, le=10_000_000)] = 3000
    """Iterations of all starts together: counted work, so that the verdict does not depend on how fast or busy the
    machine is. Where it is not given, large plans take fewer, about a minute of one core."""
    starts: Annotated[int, Field(ge=1, le=9)] | None = None
    """Paths from which the search begins, the direct one first; None: one, or five where there are zones. With an
    object they are up to three motions that rest sooner or later, until one misses no goal, of presses two. The best
    plan counts."""
    substeps: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Runge-Kutta-Chebyshev steps per interval of single shooting; None: as many as the stiffness asks for."""
    degree: Annotated[int, Field(ge=2, le=9)] = 3
    """Number of collocation points of a polynomial, by Radau."""


class FineCheck(Value):
    """The inputs of the plan played to a finely integrated model."""

    tolerance: Annotated[float, Field(ge=1e-9, le=1.0), Unit("1")] = 1e-3
    """Deviation of the tip from the plan, per finger length [1], beyond which collocation takes up to 16 polynomials on
    the intervals that cause it; where that does not do, there is a warning. A goal without a weight is
    met within ten times that share of its size: a tenth of the length, half a radian, the greatest force or input."""
    finer: Fidelity | None = None
    """A finer model on which the inputs are tried too."""
    contact_law: ContactLaw | None = None
    """Law of contact of the finer model; None: the same."""


class PlanScene(CommandedScene):
    """A finger to move from an initial state to a goal, and its surroundings."""

    AT = "input"
    REFUSALS = (
        # Collocation was measured on two winches without friction, with stiffnesses of 1e4 to 1e5 N/m: IPOPT solves
        # them or not by rounding; with friction not in 200 iterations, at 25 times the usual presliding neither. The
        # NLP needs derivatives, and friction with presliding would add states to the plan.
        *Consumer.refusals(
            """
            fidelity.tolerance: is not for plans: give family and elements
            initial.motor_angles: is for statics and simulations alone: command what motors do
            loads.follows: is not for plans, whose forces keep their directions in the world
            method=collocation with sudden: is not for tendons with friction, winches or motors, whose forces change
                within 0.02 mm; leave it out, or take single_shooting
            object with transcription=single_shooting: plans with contact are not for method: single_shooting, nor for
                tendons with friction, winches or motors, which need it: its explicit steps are too long for stiff
                contacts; plan without the object
            contact_law with sticking: plans need friction that is a smooth function of the speed of slip: give
                slip_speed (0.01 m/s, for example), or friction: 0; check.contact_law may be another one
            loads.force.times with duration.least: needs a duration that is given
            solver.substeps with transcription=collocation: works only for shooting
            solver.{method,hessian,degree} with transcription=single_shooting:
                has no effect on method: single_shooting, which has its own; leave it out
            smoothing without objective=least_time: works only for objective: least_time
            {cost,reference} without objective=tracking: works only for objective: tracking
            grasp with several: a plan moves one finger, and this grasp has several: take one of one finger, or a
                mission, which has a controller for each
            contacts goal.contact_force with grasp: comes from the grasp: leave it out
            goal.contact_force grasp without object: needs an object
            check.contact_law without check.finer
            bounds.least_tension without finger.tendons.drive
            """,
            sticking=lambda s: (law := s.contact_law) and law.friction and not law.slip_speed,
            several=lambda s: s.grasp and len(s.grasp.setups) > 1,
        ),
        *Cost.reference_refusals("cost"),
    )

    grasp: GraspScene | None = None
    """A grasp of the object by this one finger, or the path of its file relative to this file. It is optimized first:
    contacts, contact forces to be reached, the finger's base and the object's pose are then the grasp's."""
    input: PlanInput = PlanInput()
    """Limits and form of the input."""
    bounds: PlanBounds = PlanBounds()
    """Bounds of the state and zones to keep out of."""
    loads: ListOf[ForceLoad] = ()
    """Known forces at places of ``contacts`` or at the tip; over time only where the duration is given."""
    goal: Goal
    """End of the motion."""
    objective: Literal["least_time", "least_effort", "least_input_rate", "tracking"] = "least_effort"
    """least_time: the duration; least_effort: integral of the squared input away from ``input.initial``;
    least_input_rate: integral of its squared rate; tracking: ``cost`` about ``reference``."""
    cost: Cost | None = None
    """Weights of ``tracking``."""
    smoothing: Annotated[NonNegative, Unit("1")] = 1e-3
    """Weight of input changes beside ``least_time``, whose inputs would not be unique [1]: the plan is this share of
    the duration, or less, longer for smooth inputs."""
    duration: Annotated[Duration | DurationRange, Field(examples=[0.8, "800 ms"])]
    """Duration of the motion, or bounds between which it is found [s]."""
    intervals: Annotated[int, Field(ge=2, le=5000)] = 50
    """Number of intervals of the time grid."""
    method: Literal["collocation", "single_shooting"] | None = None
    """collocation: polynomials that satisfy the equations of motion at some points of each interval; single_shooting:
    inputs are the only unknowns, states are simulated; None: single_shooting where tendons have friction or are wound
    up, else collocation."""
    solver: PlanSolver = PlanSolver()
    """Options of the solver."""
    check: FineCheck = FineCheck()
    """Trial of the plan on a finer model."""

    def _check(self) -> None:
        goal = self.goal
        limits = list(zip(*self.input_limits, strict=True))
        for key, row in (("input.initial", self.input.initial), ("goal.input", goal.targets.get("input"))):
            if row is not None:
                self.finger.check_commands(key, row, limits)
        if goal.shape is not None:
            self.finger.rod.check_inside("goal.shape.at[{}]", goal.shape.at)
        # The base of a plan with a grasp is that of the grasp, which is not known yet.
        if self.grasp is None:
            at = () if goal.shape is None else goal.shape.at
            self.check_reach("goal", goal.targets, at=at)
        if self.objective != "tracking" and not goal.targets and self.grasp is None:
            raise ValueError("goal: give tip, bending, shape, contact_force or input (only tracking can omit the goal)")
        free = isinstance(self.duration, DurationRange)
        if self.objective == "least_time" and not free:
            raise ValueError("duration: least_time needs a range, {least: ..., most: ...}")
        if self.objective == "tracking" and free:
            raise ValueError("duration: tracking needs a number, since its reference runs in time")
        if self.cost is None and self.objective == "tracking":
            raise ValueError("cost is missing: objective: tracking needs it")
        if self.cost is not None:
            self.check_references(self.cost)
        places = (*self.contacts, self.finger.rod.length)
        for k, load in enumerate(self.loads):
            # The model has forces as inputs at its contacts and tip alone.
            if not any(abs(load.at - at) <= 1e-9 * self.finger.rod.length for at in places):
                raise ValueError(f"loads[{k}].at = {load.at} m: expected one of contacts or the tip, {list(places)}")

    @property
    def angles_asked(self) -> list[tuple[str, Any]]:
        """Return the angles that setpoints and the goal request, as rows by name."""
        return [*super().angles_asked, ("bending", self.goal.targets.get("bending"))]

    @property
    def sudden(self) -> bool:
        """Whether forces of tendons change within micrometers."""
        return self.finger.has_tendon_friction or bool(self.finger.winches)

    @property
    def least_tension(self) -> float:
        """Least tension of tendons that are wound up [N]."""
        drives = self.finger.winches
        stated = self.bounds.least_tension
        if stated is not None:
            return stated
        # On a common pulley the bend decides how much the other tendon pulls: a bound would be one of the bend.
        return min((0.5 * drive.pretension for drive in drives if drive.arrangement == "per_tendon"), default=0.0)

    @property
    def transcription(self) -> str:
        """Method that is taken."""
        return self.method or ("single_shooting" if self.sudden else "collocation")

    @property
    def disturbances(self) -> frozenset[str]:
        """A known force at the tip is a parameter of the model; with ``contacts``, the tip is one of these."""
        return frozenset({"tip_force"} if self.loads and not self.contacts else ())

    @property
    def initial_input(self) -> tuple[float, ...]:
        """Input before the motion begins."""
        return self.rest_input if self.input.initial is None else self.input.initial

    @property
    def simulated(self) -> Scene:
        """The scene as models and simulations take it, under the input before the motion.

        One with a grasp raises an InputError.
        """
        if self.grasp is not None:
            why = "says where base and object are only when it is optimized: take the scene of the plan that is found"
            raise InputError(why, key="grasp")
        return super().simulated

    @property
    def duration_range(self) -> tuple[float, float]:
        """Shortest and longest duration [s]."""
        duration = self.duration
        return (duration.least, duration.most) if isinstance(duration, DurationRange) else (duration, duration)

    @property
    def load_varies(self) -> bool:
        """Whether a load varies over time."""
        return any(not isinstance(load.force, tuple) for load in self.loads)
