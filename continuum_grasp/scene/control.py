"""A closed loop: finger, controller, estimator, and the plant that it acts on."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer, beside
from continuum_grasp.scene.controller import Controller, Plant
from continuum_grasp.scene.cost import Reference, RowSamples
from continuum_grasp.scene.drives import COMMANDS
from continuum_grasp.scene.estimator import Estimator
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.loads import ForceLoad
from continuum_grasp.scene.reach import check_references
from continuum_grasp.scene.simulate import Fidelity, FingerScene, Initial
from continuum_grasp.scene.value import Duration, Length, doubt

_CALM = 0.1
"""Share of the rate limit that the weight of the input's rate may tolerate [1]; at 0.075 the hand finger's loops
tolerate two periods of unmodeled delay, at 0.23 none (docs/control.md)."""


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


_LOOP = Consumer(
    "mpc",
    refused={
        "fidelity.tolerance": "is not for controllers: give family and elements",
        "initial.motor_angles": "is for statics and simulations alone: command what motors do",
    },
)
_EXACT = "needs an estimator: the controller is given the exact state at once"
_POSITION = "estimator.disturbances.object_position"
_TOUCHING = f"controller.cost.contact_force controller.cost.gap {_POSITION} estimator.disturbances.contact_friction"
_POSE = "controller.cost.object_position controller.cost.object_angle estimator.measured.object"
_MOVING = f"{_POSE} plant.object_mass plant.object_friction"
_OBJECT, _MOVES = "needs an object that is touched", "needs an object that moves: set object_moves"
_FORCE, _TENSION = "estimator.disturbances.contact_force", "estimator.measured.tension"
_COMMAND = "needs a lag; without one the tension is the command itself"
_OF_TENDONS = "plant.guides plant.tendon_friction plant.presliding plant.axial_stiffness plant.series_stiffness"
_SET, _OF_COMMANDS = "has no effect where the tension is commanded", "is that of commanded tensions"
_LOOPS = (
    _LOOP,
    beside("mpc without an estimator", lambda s: s.estimator is None, "plant.noise plant.delay", _EXACT),
    beside("mpc without contacts", lambda s: not s.contacts, _FORCE, "needs contacts"),
    beside("mpc without a lag", lambda s: s.lag is None and not s.finger.winches, _TENSION, _COMMAND),
    beside("mpc without tendons", lambda s: s.finger.tendons is None, _OF_TENDONS, "is for a finger with tendons"),
    beside("mpc of drives", lambda s: s.finger.winches, "plant.time_constant", _OF_COMMANDS),
    beside("mpc of commanded tensions", lambda s: not s.finger.winches, "plant.series_stiffness", _SET),
    beside("mpc of tensions", lambda s: not (s.finger.winches or s.plant.guides), "plant.axial_stiffness", _SET),
    beside("plant.guides beside others", lambda s: s.plant.guides, "plant.presliding", "has no effect under guides"),
    beside("mpc without an object", lambda s: s.object is None, _TOUCHING, _OBJECT),
    beside("mpc without an object that moves", lambda s: not s.object_moves, _MOVING, _MOVES),
    beside("mpc with an object that moves", lambda s: s.object_moves, _POSITION, "needs an object that stays"),
)


class ControlScene(FingerScene):
    """A finger, its controller and estimator, its surroundings, and the plant of the closed loop."""

    finger: Finger
    """The finger of the controller's model."""
    contacts: Annotated[tuple[Length, ...], Field(strict=False)] = ()
    """Positions along the finger where known forces act [m]; element boundaries. Contacts with an object are at these
    and at the tip."""
    fidelity: Fidelity = Fidelity()
    """How finely the controller's model is."""
    parameters: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Model parameters that are run-time arguments of the controller."""
    controller: Controller
    """The controller: horizon, weights, limits."""
    reference: Reference = Reference()
    """Setpoints of what the cost tracks."""
    estimator: Estimator | None = None
    """None: the controller measures the state."""
    initial: Initial = Initial(pose="rest")
    """State at time zero."""
    plant: Plant = Plant()
    """How the plant differs from the controller's model."""
    loads: Annotated[tuple[ForceLoad, ...], Field(strict=False)] = ()
    """Forces on the plant that the controller does not know."""
    duration: Annotated[Duration | None, Field(examples=[3.0, "3 s"])] = None
    """How long the closed loop runs [s]."""

    def _check(self) -> None:
        self.controller.input.check(self.finger, "controller.input")
        for one in _LOOPS:
            one.check(self)
        self._check_references()
        if self.estimator is not None:
            self._check_estimator(self.estimator)
        self._check_scenarios()
        self._doubt_margin()
        self.finger.rod.check_inside("loads", self.loads)

    def _check_references(self) -> None:
        cost, given = self.controller.cost, self.reference
        given.check(cost, "controller.cost")
        for key, names in (("contact_force", self.tracked_contacts), ("gap", cost.tracked_gaps(self.contact_names))):
            for name in names:
                if name not in self.contact_names:
                    known = ", ".join(self.contact_names)
                    raise ValueError(f"controller.cost.{key}.of: expected some of {known}, got {name!r:.60}")
        if cost.shape is not None:
            self.finger.rod.check_sections("controller.cost.shape", cost.shape.at)
        check_references(self, cost, self.object_moves)
        if given.input is not None:
            width = given.input.width if isinstance(given.input, RowSamples) else len(given.input)
            expected = len(self.input_limits[0])
            if width != expected:
                raise ValueError(f"reference.input: expected {self.finger.input_words}, got {width} numbers")

    def _doubt_margin(self) -> None:
        """Warn of a weight or delay that leaves no margin for unmodeled dead time.

        A tracked contact force is exempt: through a stiff contact, a calm command costs accuracy (the mug's mission: 12
        instead of 5 % of the force).
        """
        rate, weight = self.controller.input.rate_max, self.controller.cost.input_rate
        unit = f"{COMMANDS[self.finger.input_key][1]}/s"
        # The rate at which the weighted square is one, as that of an error of its own unit.
        tolerated = 1.0 / math.sqrt(weight) if weight else math.inf
        tracks_force = self.controller.cost.contact_force is not None
        if rate is not None and not tracks_force and tolerated > _CALM * rate * (1 + 1e-9):
            amount = f"{tolerated:.3g} {unit}" if weight else "any rate"
            doubt(
                f"controller.cost.input_rate tolerates {amount}, more than a tenth of input.rate_max: a drive or "
                "camera slower than the model can make the loop swing; expected a weight of "
                f"{1.0 / (_CALM * rate) ** 2:.2g} or more"
            )
        estimator = self.estimator
        if estimator is not None and estimator.measured.tip is not None and "delay" not in estimator.model_fields_set:
            doubt("estimator.delay is not given: a camera shows the past; state its age [s] (0.0 if it has none)")

    def _check_estimator(self, estimator: Estimator) -> None:
        estimator.measured.check(self.finger, "estimator.measured")
        if estimator.contact_detection is not None:
            asked, delay = estimator.measured, estimator.delay
            estimator.contact_detection.check(self.finger, asked, delay, "estimator.contact_detection")
        if estimator.measured.bending is not None:
            self.finger.rod.check_sections("estimator.measured.bending", estimator.measured.bending.at)
        if self.object_moves and estimator.measured.object is None:
            raise ValueError("object_moves needs estimator.measured.object, by which the controller knows where it is")
        for name in ("bending_stiffness", "tendon_friction"):
            if getattr(estimator.disturbances, name) is not None and name not in self.parameters:
                raise ValueError(f"estimator.disturbances.{name} needs parameters: [{name}]")
        if estimator.adapt is not None:
            estimator.adapt.check(estimator.disturbances, self.parameters, self.lag, "estimator.adapt")
        if estimator.disturbances.contact_friction is not None and not (self.contact_law and self.contact_law.friction):
            raise ValueError("estimator.disturbances.contact_friction needs contact_law.friction above 0")
        # The estimator corrects the state of a past period and repeats the inputs since, which it has one per period.
        periods = estimator.delay / self.controller.step
        if abs(periods - round(periods)) > 1e-6 * max(1.0, periods):
            raise ValueError(
                f"estimator.delay = {estimator.delay} s is not a whole number of control periods of "
                f"{self.controller.step} s"
            )

    def _check_scenarios(self) -> None:
        for k, one in enumerate(self.controller.scenarios):
            for key in one.changes:
                why = self._unvaried(key)
                if why:
                    raise ValueError(f"controller.scenarios[{k}].{key} {why}")

    def _unvaried(self, key: str) -> str:
        """Say why scenarios cannot differ in something; nothing where they can."""
        finger = self.finger
        if key in ("stiffness", "tip_mass"):
            return ""
        if key == "damping":
            return (
                ""
                if self.scenario_parameters(key)
                else "needs finger.damping.material above 0, of which it is a factor"
            )
        if not finger.tendon_list:
            return "is for a finger with tendons"
        if key in ("tendon_friction", "presliding") and not finger.has_tendon_friction:
            return "needs finger.tendons.friction above 0: without, the controller's model has no state of friction"
        if key == "time_constant" and (finger.winches or self.lag is None):
            return "is that of commanded tensions: it needs finger.tendons.time_constant"
        if key in ("axial_stiffness", "series_stiffness") and not finger.winches:
            return "has no effect where the tension is commanded"
        name = key.removeprefix("tendon_")
        values = {getattr(tendon, name) for tendon in finger.tendon_list}
        return "" if len(values) == 1 and None not in values else f"needs the same finger.tendons.{name} of all tendons"

    def scenario_parameters(self, key: str) -> tuple[str, ...]:
        """Names of the model parameters that a key of ``controller.scenarios`` changes."""
        damping = self.finger.damping
        absent = {"material_damping": damping.material == 0.0, "per_arc_damping": damping.per_arc == 0.0}
        return tuple(name for name in _OF_SCENARIOS[key] if not absent.get(name))

    @property
    def model_parameters(self) -> tuple[str, ...]:
        """Parameters of the controller's model: ``parameters``, and what scenarios differ in."""
        varied = [
            name for one in self.controller.scenarios for key in one.changes for name in self.scenario_parameters(key)
        ]
        return tuple(dict.fromkeys((*self.parameters, *varied)))

    @property
    def input_limits(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Least and greatest input, each in its unit."""
        return self.controller.input.limits(self.finger)

    @property
    def rest_input(self) -> tuple[float, ...]:
        """Input that leaves the finger alone: no tip moment, the least tensions, or the pretension of its drives."""
        return self.controller.input.rest(self.finger)

    @property
    def lag(self) -> float | None:
        """Shortest time constant of the drive [s]; None: an input acts at once."""
        return self.controller.input.lag(self.finger)

    @property
    def tracked_contacts(self) -> tuple[str, ...]:
        """Names of the contacts whose normal force is tracked."""
        return self.controller.cost.tracked_contacts(self.contact_names)

    @property
    def disturbances(self) -> frozenset[str]:
        """Names of the disturbances that are estimated."""
        return frozenset() if self.estimator is None else self.estimator.disturbances.names
