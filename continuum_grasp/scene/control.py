"""A closed loop: finger, controller, estimator, and the plant that it acts on."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.controller import CommandedScene, ControllerSettings, PlantDifferences
from continuum_grasp.scene.cost import Cost
from continuum_grasp.scene.drives import MotorDrive, WinchDrive
from continuum_grasp.scene.estimator import EstimatorSettings, Mounting
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.finger_scene import Fidelity
from continuum_grasp.scene.loads import ForceLoad
from continuum_grasp.scene.value import Duration, ListOf, Value

_CALM = 0.1
"""Share of the rate limit that the weight of the input's rate may tolerate [1]; at 0.075 the hand finger's loops
tolerate two periods of unmodeled delay, at 0.23 none (docs/control.md)."""


_BORNE_MASS, _BORNE_FORCE = 1.5, 1.0 / 12.0
"""Load of the tip that loops withstand without an unknown for it in the estimator [1]. The first number is a mass per
mass of the rod, weighted by (s / L)^4, which is a fifth of the mass of a uniform rod. The second is the first-order
deflection by a force, per length. For a uniform rod of mass m they mean 0.3 m and E I / 4 L^2. No shipped loop trips
under them, in four directions; twice the force trips tip_arc, tip_circle, keep_out, motor_servo, winches and
three_tendons: ``python -m benchmarks.tip_loads --factors 1 2``."""
_OF_SCENARIOS = {
    "stiffness": ("bending_stiffness",),
    "damping": ("material_damping", "per_arc_damping"),
    "tip_mass": ("tip_mass",),
    "tendon_friction": ("tendon_friction",),
    "presliding": ("tendon_presliding",),
    "axial_stiffness": ("tendon_axial_stiffness",),
    "series_stiffness": ("tendon_series_stiffness",),
    "time_constant": ("drive_time_constant",),
}
"""Model parameters behind the keys of ``controller.scenarios``."""
_OF_TENDON = {"tendon_friction": "friction", "presliding": "presliding_length"}
"""Attribute of a tendon behind those keys that have another name."""


def _jumps(scene: ControlScene) -> bool:
    """Whether the plant's tensions, or its tip moment, follow commands at once."""
    return bool(scene.finger.winches) or (scene.lag is None and scene.plant.time_constant is None)


def _never_saturates(drive: WinchDrive | None) -> WinchDrive | None:
    if isinstance(drive, MotorDrive) and drive.position_gain is not None:
        return drive.unlimited()
    return drive


class LogFormat(Value):
    """Form of the logs that ``replay`` and ``commission`` read."""

    columns: dict[str, str] = Field(default_factory=dict)
    """Columns of channels (tip_x, commanded_tension_1, ...) with another name in the log: a heading, or /topic.field of
    a bag, followed by its unit in brackets unless it is SI; t: the times of a table."""
    stamps: Literal["header", "log"] | None = None
    """Stamps of a bag: of the messages' headers, or of their recording; None: of headers."""
    max_age: Annotated[Duration | None, Field(examples=[0.02, "20 ms"])] = None
    """Greatest age of the last reading of a channel with its own stamps that ``commission`` accepts [s]; None: it needs
    readings with one stamp. ``replay`` takes the last reading of each period."""


class ControlScene(CommandedScene):
    """A finger, its controller and estimator, its surroundings, and the plant of the closed loop."""

    AT = "controller.input"
    REFUSALS = (
        *Consumer.refusals(
            """
            fidelity.tolerance: is not for controllers: give family and elements
            initial.motor_angles: is for statics and simulations alone: command what motors do
            plant.{noise,delay} without estimator: needs an estimator: the controller is given the exact state at once
            estimator.disturbances.contact_force without contacts
            plant.{guides,tendon_friction,presliding,axial_stiffness,series_stiffness} without finger.tendons
            plant.series_stiffness controller.scenarios.{axial_stiffness,series_stiffness} without finger.tendons.drive:
                has no effect where the tension is commanded
            controller.cost.{contact_force,gap} estimator.disturbances.{object_position,contact_friction}
                without object: needs an object that is touched
            controller.cost.{object_position,object_angle} estimator.measured.object plant.{object_mass,object_friction}
                without object_moves: needs an object that moves: set object_moves
            estimator.disturbances.contact_friction without contact_law.friction
            estimator.measured.length without finger.tendons.drive.kind=length
            estimator.measured.{angle,torque} without finger.tendons.drive.kind=motor
            controller.scenarios.{tendon_friction,presliding} without finger.tendons.friction:
                needs finger.tendons.friction above 0: without, the controller's model has no state of friction
            plant.time_constant with finger.tendons.drive: works only for commanded tensions
            plant.{presliding,fidelity} with plant.guides: a chain of guides has no use for it
            estimator.disturbances.object_position with object_moves: needs an object that stays
            estimator.adapt.bending_stiffness with estimator.disturbances.bending_stiffness:
                is estimated already: give one of both
            estimator.disturbances.{bending_stiffness,tendon_friction}
                estimator.adapt.{bending_stiffness,tip_mass,drive_time_constant}
                without parameters=NAME: needs parameters: [NAME]
            estimator.adapt.drive_time_constant without lag: needs a drive with a time_constant
            estimator.measured.tension without lag finger.winches finger.tendons.time_constant:
                needs a lag; without one the tension is the command itself
            plant.drive_order estimator.measured.tension with chambers_alone:
                works only for tendons: pressures have a lag of first order, which estimator.measured.pressure sees
            estimator.measured.pressure without finger.lagging_pressures:
                needs finger.pressure with a time_constant: a pressure without one is the command itself
            plant.axial_stiffness without finger.winches plant.guides: has no effect where the tension is commanded
            plant.guides with rigid:
                needs plant.axial_stiffness: a tendon that sticks at two guides must be elastic between them
            object_moves with unseen: needs estimator.measured.object, by which the controller knows where it is
            plant.fidelity.family=matched_clothoid with first_order jumps:
                needs a continuous tip moment: give the drive a lag of second order, or use clothoid
            plant.drive_order with jumps_alone: needs plant.time_constant
            controller.scenarios.damping without finger.damping.{material,per_arc}:
                needs finger.damping.material above 0, of which it is a factor
            controller.scenarios.time_constant with finger.winches:
                works only for commanded tensions: it needs finger.tendons.time_constant
            controller.scenarios.time_constant without lag:
                works only for commanded tensions: it needs finger.tendons.time_constant
            controller.scenarios.{tendon_friction,presliding,axial_stiffness,series_stiffness,time_constant}
                with unlike(NAME): needs tendons that have it alike
            """,
            chambers_alone=lambda s: s.finger.chambers and not s.finger.tendons,
            rigid=lambda s: not (s.plant.axial_stiffness or all(t.axial_stiffness for t in s.finger.tendon_list)),
            unseen=lambda s: s.estimator and not s.estimator.measured.object,
            jumps=_jumps,
            first_order=lambda s: s.plant_order == 1,
            jumps_alone=lambda s: _jumps(s) and not any(tendon.time_constant for tendon in s.finger.tendon_list),
            # Also where tendons do not have it.
            unlike=lambda s, name: (
                len({getattr(t, _OF_TENDON.get(name) or name) for t in s.finger.tendon_list} | {None}) != 2
            ),
        ),
        *Cost.reference_refusals("controller.cost"),
    )

    fidelity: Fidelity = Fidelity()
    """Resolution of the controller's model."""
    controller: ControllerSettings
    """The controller: horizon, weights, limits."""
    estimator: EstimatorSettings | None = None
    """Estimator of the state; None: the controller measures the state."""
    mounting: Mounting | None = None
    """Mounting of the bench, as found by ``commission``; readings and commands of drives are converted by it. None: the
    mounting of the model."""
    plant: PlantDifferences = PlantDifferences()
    """Differences of the plant from the controller's model."""
    loads: ListOf[ForceLoad] = ()
    """Forces on the plant that the controller does not know."""
    duration: Annotated[Duration | None, Field(examples=[3.0, "3 s"])] = None
    """Duration of the closed loop [s]."""
    log: LogFormat = LogFormat()
    """Form of logs of the bench."""

    def _check(self) -> None:
        self._check_references()
        if self.estimator is not None:
            self._check_estimator(self.estimator)
            self._doubt_loads()
        self._doubt_margin()
        self.plant.fidelity.check_lengths("plant.fidelity", self.finger.rod.length, self.contacts)
        self.finger.rod.check_inside("loads[{}].at", (load.at for load in self.loads))

    def _check_references(self) -> None:
        cost = self.controller.cost
        for key in ("contact_force", "gap"):
            for name in cost.tracked_contacts(key, self.contact_names):
                if name not in self.contact_names:
                    known = ", ".join(self.contact_names)
                    raise ValueError(f"controller.cost.{key}.of: expected some of {known}, got {name!r:.60}")
        if cost.shape is not None:
            self.finger.rod.check_inside("controller.cost.shape.at[{}]", cost.shape.at)
        self.check_references(cost, moves=self.object_moves)

    def _doubt_margin(self) -> None:
        """Warn of a weight or delay that leaves no margin for unmodeled dead time.

        A tracked contact force is exempt: through a stiff contact, a calm command costs accuracy (the mug's mission: 12
        instead of 5 % of the force).
        """
        rate, weight = self.controller.input.rate_max, self.controller.cost.input_rate
        unit = f"{self.finger.inputs[0].unit}/s"
        # The rate whose weighted square is 1, like that of an error of one unit.
        tolerated = 1.0 / math.sqrt(weight) if weight else math.inf
        tracks_force = self.controller.cost.contact_force is not None
        if rate is not None and not tracks_force and tolerated > _CALM * rate * (1 + 1e-9):
            amount = f"{tolerated:.3g} {unit}" if weight else "any rate"
            self._doubt(
                "controller.cost.input_rate",
                f"tolerates {amount}, more than a tenth of input.rate_max: a drive or "
                "camera slower than the model can make the loop swing; expected a weight of "
                f"{1.0 / (_CALM * rate) ** 2:.2g} or more",
            )
        estimator = self.estimator
        if estimator is not None and estimator.measured.tip is not None and "delay" not in estimator.model_fields_set:
            self._doubt(
                "estimator.delay", "is not given: a camera shows the past; state its age [s] (0.0 if it has none)"
            )

    @property
    def borne_mass(self) -> float:
        """Mass at the tip that the loop bears without tripping [kg]; infinite where the estimator learns it."""
        if (
            self.estimator is not None
            and self.estimator.adapt is not None
            and self.estimator.adapt.tip_mass is not None
        ):
            return math.inf
        length, profile = self.finger.rod.length, self.finger.profile
        return _BORNE_MASS * float(profile.panels().integral(lambda s: profile.linear_density(s) * (s / length) ** 4))

    @property
    def borne_force(self) -> float:
        """Force on the tip that the loop bears without tripping [N]; infinite where the estimator finds it."""
        if {"tip_force", "contact_force"} & set(self.disturbances):
            return math.inf
        length, profile = self.finger.rod.length, self.finger.profile
        compliance = float(profile.panels().integral(lambda s: (length - s) ** 2 / profile.bending_stiffness(s)))
        return _BORNE_FORCE * length / compliance

    @property
    def borne_loads(self) -> str:
        """Loads of the tip that the loop bears without tripping, in words."""
        mass = "mass" if math.isinf(self.borne_mass) else ""
        force = "force" if math.isinf(self.borne_force) else ""
        borne = [f"{1e3 * self.borne_mass:.2g} g"] * (not mass) + [f"{self.borne_force:.2g} N"] * (not force)
        found = " or ".join(filter(None, (mass, force)))
        words = [f"{' or '.join(borne)} at the tip"] if borne else []
        return ", ".join([*words, f"a {found} is estimated"] if found else words)

    def _doubt_loads(self) -> None:
        """Warn of a constant load of the plant that the estimator has no unknown for, and that may trip the loop."""
        if self.plant.tip_mass > self.borne_mass * (1.0 + 1e-9):
            self._doubt(
                "plant.tip_mass",
                f"= {1e3 * self.plant.tip_mass:.3g} g is unknown to the controller: the loop bears "
                f"{1e3 * self.borne_mass:.2g} g and may trip with more; add estimator.adapt.tip_mass, which learns it",
            )
        length = self.finger.rod.length
        constant = [(load.force, load.at / length) for load in self.loads if isinstance(load.force, tuple)]
        pushed = math.hypot(*(math.fsum(force[k] * share for force, share in constant) for k in (0, 1)))
        if pushed > self.borne_force * (1.0 + 1e-9):
            self._doubt(
                "loads",
                f"are {pushed:.3g} N at the tip, unknown to the controller: the loop bears "
                f"{self.borne_force:.2g} N and may trip with more; add estimator.disturbances.tip_force and measure "
                "angles",
            )

    def _check_estimator(self, estimator: EstimatorSettings) -> None:
        if estimator.measured.bending is not None:
            self.finger.rod.check_inside("estimator.measured.bending.at[{}]", estimator.measured.bending.at)
        # The estimator corrects the state of a past period and repeats the inputs since, which it has one per period.
        self._check_whole("estimator.delay", estimator.delay, self.controller.step, "control periods")

    def scenario_parameters(self, key: str) -> tuple[str, ...]:
        """Names of the model parameters that a key of ``controller.scenarios`` changes."""
        damping = self.finger.damping
        absent = {"material_damping": damping.material == 0.0, "per_arc_damping": damping.per_arc == 0.0}
        return tuple(name for name in _OF_SCENARIOS[key] if not absent.get(name))

    @property
    def model_parameters(self) -> tuple[str, ...]:
        """Parameters of the controller's model: ``parameters``, and what scenarios differ in."""
        varied = [
            name
            for scenario in self.controller.scenarios
            for key in scenario.changes
            for name in self.scenario_parameters(key)
        ]
        return tuple(dict.fromkeys((*self.parameters, *varied)))

    @property
    def plant_order(self) -> int:
        """Order of the lag of the plant's drive."""
        return self.plant.drive_order or self.finger.drive_order

    @property
    def bench_mounting(self) -> Mounting | None:
        """True mounting of the plant's bench; by default, the mounting that the controller knows."""
        return self.mounting if self.plant.mounting is None else self.plant.mounting

    @property
    def predicted_finger(self) -> Finger:
        """The finger with servos that do not saturate.

        A stage does not resolve how one that saturates catches up within milliseconds: two iterations of an implicit
        step from there end anywhere. Plans are bounded by what motors have instead.
        """
        return self.finger.with_drives(_never_saturates)

    @property
    def delay_periods(self) -> int:
        """Age of measurements in control periods."""
        return 0 if self.estimator is None else round(self.estimator.delay / self.controller.step)

    def measurement_std(self, name: str) -> float:
        """Return the standard deviation of a measurement, by its name; infinite if it is not measured."""
        return (self.estimator and self.estimator.measured.std_of(name)) or math.inf

    @property
    def disturbances(self) -> frozenset[str]:
        """Names of the disturbances that are estimated."""
        return frozenset() if self.estimator is None else frozenset(self.estimator.disturbances.stated())
