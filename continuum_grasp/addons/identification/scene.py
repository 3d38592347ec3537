"""Parameters to be estimated from measurements, and how measurements are read."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene import (
    Angle,
    Consumer,
    Duration,
    Interval,
    Length,
    ListOf,
    Position,
    Positive,
    Real,
    Scene,
    Unit,
    Value,
)

Quantity = Literal["x", "y", "angle", "bend", "tension", "length", "motor_angle", "torque", "frequency", "decay_rate"]
_NUMBERED = ("tension", "length", "motor_angle", "torque", "frequency", "decay_rate")
Estimated = Annotated[float, Field(ge=-1e15, le=1e15), Unit("SI unit of the parameter")]
_Window = Annotated[Interval, Unit("s")]
_Place = Annotated[float, Field(ge=0.0, le=1e4), Unit("m")]
_Axis = Literal["x", "-x", "y", "-y"]


class Column(Value):
    """One column of a table: its number times the unit times ``scale``."""

    column: str
    """Heading of the column, with or without the unit that it has in brackets."""
    unit: str | None = None
    """Unit, such as mm; None: as in brackets in the heading, or SI."""
    scale: Annotated[Real, Unit("1")] = 1.0
    """Factor [1], -1 for a drop that is counted downwards."""
    minus: str | None = None
    """Heading of a column of the same unit that is subtracted first, such as the base's position."""
    zero: Annotated[Real, Unit("unit of the column")] = 0.0
    """Reading of the column where the quantity is zero, subtracted first [unit of the column], such as the motor's
    steps at the straight finger."""


ColumnLike = str | Column


def as_column(given: ColumnLike) -> Column:
    """A column that is given by its heading alone, or as such."""
    return Column(column=given) if isinstance(given, str) else given


class Condition(Column):
    """A column that says under which load, input or parameter a row was measured."""

    name: str
    """Entry of the model's inputs (tip_moment, tension_1, ...), forces (tip_y, load_1_y, ...) or parameters."""
    choices: Annotated[ListOf[Real], Unit("unit of the column")] = ()
    """Cells of the column that ``identify --design`` may propose [unit of the column], such as the weights that there
    are."""


(OF_BENDS,) = Consumer.refusals("since without quantity=bend: goes with bend")


class ReadingColumn(Column):
    """A column with what was measured at a section, at the drive of a tendon, or of a natural mode."""

    REFUSALS = (
        OF_BENDS,
        *Consumer.refusals(
            f"""
            of without numbered: goes with {", ".join(_NUMBERED)}
            {{at,offset}} with numbered: goes with sections
            """,
            numbered=lambda reading: reading.quantity in _NUMBERED,
        ),
    )

    quantity: Quantity
    """x, y: world position [m]; angle: of the section in the world [rad]; bend: between base and section [rad];
    tension: of a tendon at its drive [N]; length: cable that a winch has wound up [m]; motor_angle [rad], torque
    [N m]: of a motor; frequency [Hz], decay_rate [1/s]: of a damped free vibration about rest."""
    of: Annotated[int, Field(ge=1, le=16)] | None = None
    """Number of the tendon, of the drive or of the natural mode, from 1; None: the first."""
    at: _Place | Column | None = None
    """Position along the finger [m], or the column that has it, in a table with a row per point; None: the tip."""
    offset: Annotated[Real, Unit("m")] | Column = 0.0
    """Distance of a marker from the backbone [m], positive along the section's X axis, to the right seen from base to
    tip, or the column that has it."""
    since: Length | None = None
    """Position from which a bend counts [m], such as the near side of a joint; None: the base."""
    sigma: Annotated[Positive, Field(examples=[1e-3]), Unit("unit of the quantity")] | None = None
    """Standard deviation [unit of the quantity], where known: weights unlike quantities; None: from the residuals."""

    @property
    def place(self) -> float | None:
        """The position along the finger [m] where it is a number; None: the tip, or a column has it."""
        return self.at if isinstance(self.at, float) else None


class RowsEqual(Value):
    """Choice of the rows in which a column has one of some texts."""

    column: str
    """Heading of the column."""
    equals: Annotated[ListOf[str], Field(min_length=1)]
    """The texts, or numbers as texts."""


class _Data(Value):
    name: str | None = None
    """Name of this set in reports; by default the file's name."""
    file: str | None = None
    """Name of the file with wildcards, torque_*.csv, with its folder where names are not enough; None: every file that
    is given."""
    where: ListOf[RowsEqual] = ()
    """Rows to read; all of them must hold."""
    set: ListOf[str] = ()
    """Changes of the scene for this set, as ``key.path=value``."""
    use: Literal["fit", "holdout"] = "fit"
    """holdout: predicted and compared, not fitted."""
    axes: Annotated[tuple[_Axis, _Axis], Field(strict=False)] = ("x", "y")
    """World axes along which the file's x and y count; [x, -y]: y down, as in images."""
    origin: Position = (0.0, 0.0)
    """World position of the origin of the file's x and y [m]."""
    plane: Annotated[Angle, Field(examples=["87 deg"])] | None = None
    """Direction in which this set bends, about the straight finger [rad], where fingers bend in several planes."""
    stamps: Literal["header", "log"] | None = None
    """Stamps of a bag: of the messages' headers, or of their recording; None: of headers."""
    max_age: Annotated[Duration | None, Field(examples=[0.02, "20 ms"])] = None
    """Age up to which the last value of a topic counts at a stamp of the topic of ``t``, without ``t`` of the first
    measured column [s]; None: values have that stamp."""

    def _check(self) -> None:
        if self.axes[0][-1] == self.axes[1][-1]:
            raise ValueError(f"axes: both are along {self.axes[0][-1]}: expected x and y, such as [x, -y]")


class StaticPoses(_Data):
    """Shapes at rest, and vibrations about them: a row per load case."""

    REFUSALS = Consumer.refusals(
        """
        conditions.choices without propose
        propose with sequence: takes rows reached by themselves
        """
    )

    kind: Literal["static"]
    conditions: ListOf[Condition] = ()
    """Columns with loads, inputs and parameters of each row."""
    holdout_rows: ListOf[Annotated[int, Field(ge=1)]] = ()
    """Rows, counted from 1 among those read, that are predicted and not fitted."""
    measured: Annotated[ListOf[ReadingColumn], Field(min_length=1)]
    """Columns with what was measured."""
    pose: str | None = None
    """Heading of the column that is the same in all rows of a pose, in a table with a row per point; None: every row is
    a pose."""
    sequence: bool = False
    """Whether the rows follow one another, so that the friction of each comes from those before it; the first is
    reached as ``initial.reached_by`` says. False: each row is reached by itself."""
    propose: Annotated[int, Field(ge=1, le=200)] | None = None
    """Number of rows that ``identify --design`` proposes to measure, of the ``choices`` of all conditions; None: none,
    these are measured."""


class StartPrior(Value):
    """Prior of an estimated start: standard deviations about what the first samples show."""

    bend: Annotated[Positive, Unit("rad")]
    """Standard deviation of the bend of every element [rad]."""
    rate: Annotated[Positive, Unit("rad/s")]
    """Standard deviation of the rate of that bend [rad/s]."""


class TipTrajectory(_Data):
    """Readings along a motion, such as the path of the tip."""

    REFUSALS = Consumer.refusals(
        """
        start_prior without start=estimated: goes with start: estimated
        conditions.choices: goes with propose
        """
    )

    kind: Literal["trajectory"]
    t: ColumnLike = "t"
    """Column of the instants [s]."""
    conditions: ListOf[Condition] = ()
    """Columns with the commands of the drives at these instants, smooth between them, by their names in the model
    (tension_1, length_1, angle_1, ...); they replace ``actuation``."""
    measured: Annotated[ListOf[ReadingColumn], Field(min_length=1)] = (
        ReadingColumn(quantity="x", column="x"),
        ReadingColumn(quantity="y", column="y"),
    )
    """Columns with what was measured; by default the path of the tip, in columns x and y. Instants at which one
    of the cells is empty are left out."""
    start: Literal["scene", "estimated"] = "scene"
    """Start of the motion. scene: at time zero as ``initial`` says; estimated: at the first sample, in a shape and
    rates that are estimated with the parameters, from the smoothest ones through the measurements from there on."""
    start_prior: StartPrior | None = None
    """Standard deviations of an estimated start about what the first samples show; None: any start is as likely,
    whatever its rates."""
    window: _Window | None = None
    """Instants from and to which samples are used [s]."""


class RingDown(_Data):
    """Free vibration after a motion: each signal becomes a frequency and a decay rate."""

    kind: Literal["ring_down"]
    t: ColumnLike = "t"
    """Column of the instants [s]."""
    signals: Annotated[ListOf[str], Field(min_length=1)] = ("signal",)
    """Headings of the columns, in any unit; empty cells are samples that are missing."""
    window: _Window
    """Instants from and to which samples are used [s]."""
    mode: Annotated[int, Field(ge=1)] = 1
    """Natural mode that rings, from 1."""


DataSet = Annotated[StaticPoses | TipTrajectory | RingDown, Field(discriminator="kind")]


class Estimate(Value):
    """A parameter to estimate."""

    name: str
    """youngs_modulus, bending_stiffness, linear_density, material_damping, per_arc_damping, quadratic_damping,
    rest_curvature, tip_mass, mass_0 (of masses[0]), tip_body_mass, _inertia, _along or _across, clamp_angle, base_x,
    base_y (added to angle and position of the base: a frame that is turned or shifted), softening_curvature,
    softening_ratio, gyration_radius, tendon_offset, tendon_friction, tendon_presliding, tendon_axial_stiffness,
    tendon_series_stiffness, dry_friction_1_stiffness or _moment (of damping.dry_friction[0]), relaxation_1_share or
    _time (of damping.relaxation[0]), chamber_area, drive_time_constant, drive_delay,
    drive_pretension, drive_slack, drive_inertia, drive_viscous_friction or drive_coulomb_friction."""
    start: Annotated[Estimated | None, Field(examples=[0.7])] = None
    """Start of the search [SI unit of the parameter]; None: the scene's value."""
    min: Annotated[Estimated | None, Field(examples=[0.0])] = None
    """Least value [SI unit of the parameter]; None: 0, or none for angles and curvatures."""
    max: Annotated[Estimated | None, Field(examples=[2.0])] = None
    """Greatest value [SI unit of the parameter]; None: none."""
    sigma: Annotated[Estimated | None, Field(examples=[0.05], gt=0.0)] = None
    """Standard deviation about the start value with which the parameter is known beforehand, such as a mass that was
    weighed [SI unit of the parameter]; None: nothing is known."""
    per: Literal["all", "set", "plane"] = "all"
    """all: one value; set: each set of data has its own, such as a clamp that is turned anew. plane: one value, and a
    vector across the finger, such as a lean or a camera that is shifted, whose part along ``plane`` of each set is
    added there. Estimates of sets and vectors are reported beside the parameters, and no scene takes them."""

    def _check(self) -> None:
        self._check_below("min", "max")


class Law(Value):
    """A law of the finger that may hold: changes of the scene, and the parameters to estimate under it."""

    name: str
    """Name of the law in reports."""
    set: ListOf[str] = ()
    """Changes of the scene under this law, as ``key.path=value``."""
    estimate: ListOf[Estimate] = ()
    """Parameters to find under this law, in addition to the scene's."""


class Excitation(Value):
    """Commands over time from which a finger with its drives is to be identified."""

    duration: Duration = 20.0
    """Duration of the excitation [s]."""
    sample: Annotated[Duration, Field(examples=[0.01, "10 ms"])] = 0.01
    """Time between two samples of the measurements [s]."""
    reach: Annotated[float, Field(ge=0.01, le=1.0), Unit("1")] = 0.8
    """Greatest share of bending range, tensions and torques that is used [1]."""

    def _check(self) -> None:
        if self.duration < 200 * self.sample:
            raise ValueError(f"duration = {self.duration} s is shorter than 200 samples of {self.sample} s")


_FIT = Consumer(
    "identify",
    refused={"object": "is not supported: measurements are of the finger alone, leave the object out"},
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        **dict.fromkeys(("finger.half_thickness", "finger.rod.samples.thickness"), "of contacts"),
        **Consumer.LIMITS_OF_COMMANDS,
        "time": "rows have times of their own",
        "name": "of reports",
    },
)


class IdentifyScene(Scene):
    """A scene, its unknown parameters, and the measurements that determine them."""

    REFUSALS = (_FIT,)

    estimate: ListOf[Estimate] = ()
    """Parameters that are to be found; none: the scene is compared with the data as it is."""
    laws: ListOf[Law] = ()
    """Laws to choose from, by their predictions of hold-outs; none: the scene's law."""
    data: ListOf[DataSet] = ()
    """Formats of the files that are given beside this one."""
    excitation: Excitation = Excitation()
    """Commands that ``identify --design`` designs, where it is given and a set is a ``trajectory``."""

    def _check(self) -> None:
        names = [estimate.name for estimate in self.estimate]
        for k, name in enumerate(names):
            if name in names[:k]:
                raise ValueError(f"estimate[{k}].name: {name} is estimated twice")
        laws = [law.name for law in self.laws]
        if len(laws) == 1 or len(set(laws)) < len(laws):
            raise ValueError("laws: expected two or more, with names of their own")
        if self.estimate and self.data and all(data_set.use == "holdout" for data_set in self.data):
            raise ValueError("data: every set is a hold-out; at least one must be fitted")
