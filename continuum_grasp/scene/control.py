"""A closed loop: finger, controller, estimator, and the plant that it acts on."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer, beside, excludes, needs
from continuum_grasp.scene.controller import CommandedScene, Controller, Plant
from continuum_grasp.scene.cost import tracked
from continuum_grasp.scene.estimator import Estimator, Mounting
from continuum_grasp.scene.loads import ForceLoad
from continuum_grasp.scene.reach import check_references
from continuum_grasp.scene.simulate import Fidelity
from continuum_grasp.scene.value import Duration, ListOf, doubt

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


def _late(scene: ControlScene) -> bool:
    """Whether commanded torques stand in for measured ones, and are not as old as the angles of the motors."""
    of = scene.estimator
    return bool(of and of.measured.angle and of.delay and not of.measured.torque)


def _blurred(scene: ControlScene) -> bool:
    """Whether one error of the friction stands for tendons with different coefficients."""
    asked = scene.estimator and scene.estimator.contact_detection
    return bool(asked and asked.tendon_friction) and len({tendon.friction for tendon in scene.finger.tendon_list}) > 1


def _sees(scene: ControlScene, *names: str) -> bool:
    """Whether the estimator is given one of some quantities."""
    return scene.estimator is not None and any(getattr(scene.estimator.measured, name) for name in names)


def _unlike(name: str) -> Consumer:
    """Refuse that plants differ in something that tendons do not have, or not alike."""

    def differs(scene: ControlScene) -> bool:
        return len({getattr(tendon, name.removeprefix("tendon_")) for tendon in scene.finger.tendon_list} | {None}) != 2

    return beside(f"mpc of tendons unlike in {name}", differs, _scenarios(name), "needs tendons that have it alike")


def _scenarios(*names: str) -> str:
    return " ".join(f"controller.scenarios.{name}" for name in names)


def _rigid(scene: ControlScene) -> bool:
    """Whether the scene leaves open how elastic the plant's tendons are."""
    stiffnesses = (tendon.axial_stiffness for tendon in scene.finger.tendon_list)
    return scene.plant.axial_stiffness is None and None in stiffnesses


def _lags(scene: ControlScene) -> bool:
    """Whether tensions lag, beside chambers which need not."""
    return any(tendon.time_constant for tendon in scene.finger.tendon_list)


def _jumps(scene: ControlScene) -> bool:
    """Whether the plant's tensions, or its tip moment, follow commands at once."""
    return bool(scene.finger.winches) or (scene.lag is None and scene.plant.time_constant is None)


_DRIVE, _MATCHED = "finger.tendons.drive", "plant.fidelity.family=matched_clothoid"
_CABLES, _SLIDING = ("axial_stiffness", "series_stiffness"), ("tendon_friction", "presliding")
_OF_TENDONS = " ".join(f"plant.{name}" for name in ("guides", *_SLIDING, *_CABLES))
_POSITION, _CONTACT = "estimator.disturbances.object_position", "estimator.contact_detection"
_TENSION = "estimator.measured.tension"
_SHARE, _STIFFNESS = "estimator.disturbances.contact_friction", "estimator.adapt.bending_stiffness"
_TOUCHING = f"controller.cost.contact_force controller.cost.gap {_POSITION} {_SHARE}"
_POSE = "controller.cost.object_position controller.cost.object_angle estimator.measured.object"
_OF_MOTORS = "estimator.measured.angle estimator.measured.torque"
_EXACT = "needs an estimator: the controller is given the exact state at once"
_COMMAND = "needs a lag; without one the tension is the command itself"
_SET, _COMMANDED = "has no effect where the tension is commanded", "is that of commanded tensions"
_MOVES = "needs an object that moves: set object_moves"
_ELASTIC = "needs plant.axial_stiffness: a tendon that sticks at two guides must be elastic between them"
_SEEN = "needs estimator.measured.object, by which the controller knows where it is"
_STATELESS = "needs finger.tendons.friction above 0: without, the controller's model has no state of friction"
_FACTOR = "needs finger.damping.material above 0, of which it is a factor"
_LAGGING = "is that of commanded tensions: it needs finger.tendons.time_constant"
_SMOOTH = "needs a continuous tip moment: give the drive a lag of second order, or use clothoid"
_HIDDEN = "sees nothing through a gear with backlash, whose drum is not measured"
_PLACED = "needs estimator.measured.length or estimator.measured.angle of drives, whose tension a contact changes"
_PULLED = "needs estimator.measured.tension of winches"
_BLURRED = "needs tendon_friction: 0 where tendons have different coefficients"
_OLD = "needs estimator.measured.torque with a delay: a commanded torque is not as old as the angle"
_PRESSURE, _BY_TENDONS = "estimator.measured.pressure", "plant.drive_order estimator.measured.tension"
_CHAMBERS = "is of tendons: pressures follow by a lag of first order, and estimator.measured.pressure sees them"
_COMMANDED_PRESSURE = "needs finger.pressure with a time_constant: a pressure without one is the command itself"
_LOOP = {
    "fidelity.tolerance": "is not for controllers: give family and elements",
    "initial.motor_angles": "is for statics and simulations alone: command what motors do",
}
_ESTIMATED = {
    "bending_stiffness": f"estimator.disturbances.bending_stiffness {_STIFFNESS}",
    "tendon_friction": "estimator.disturbances.tendon_friction",
    "tip_mass": "estimator.adapt.tip_mass",
    "drive_time_constant": "estimator.adapt.drive_time_constant",
}
"""Keys of what is estimated, by the parameter of the model that it is."""


def _parameter(name: str, keys: str) -> Consumer:
    """Refuse that a parameter is estimated which the model does not have."""
    return beside(
        f"mpc without parameters: {name}", lambda s: name not in s.parameters, keys, f"needs parameters: [{name}]"
    )


_LOOPS = (
    Consumer("mpc", _LOOP),
    needs("mpc", "plant.noise plant.delay", "estimator", _EXACT),
    needs("mpc", "estimator.disturbances.contact_force", "contacts"),
    needs("mpc", _OF_TENDONS, "finger.tendons"),
    needs("mpc", f"plant.series_stiffness {_scenarios(*_CABLES)}", _DRIVE, _SET),
    needs("mpc", _TOUCHING, "object", "needs an object that is touched"),
    needs("mpc", f"{_POSE} plant.object_mass plant.object_friction", "object_moves", _MOVES),
    needs("mpc", _SHARE, "contact_law.friction"),
    needs("mpc", "estimator.measured.length", f"{_DRIVE}.kind=length"),
    needs("mpc", _OF_MOTORS, f"{_DRIVE}.kind=motor"),
    needs("mpc", _scenarios(*_SLIDING), "finger.tendons.friction", _STATELESS),
    excludes("mpc", "plant.time_constant", _DRIVE, _COMMANDED),
    excludes("mpc", "plant.presliding plant.fidelity", "plant.guides", "a chain of guides has no use for it"),
    excludes("mpc", _POSITION, "object_moves", "needs an object that stays"),
    excludes("mpc", _STIFFNESS, "estimator.disturbances.bending_stiffness", "is estimated already: give one of both"),
    excludes("mpc", _CONTACT, f"{_DRIVE}.backlash", _HIDDEN),
    *(_parameter(name, keys) for name, keys in _ESTIMATED.items()),
    beside(
        "mpc at once", lambda s: s.lag is None, _ESTIMATED["drive_time_constant"], "needs a drive with a time_constant"
    ),
    beside("mpc of tensions at once", lambda s: not (s.lag or s.finger.winches or _lags(s)), _TENSION, _COMMAND),
    beside("mpc of chambers alone", lambda s: s.finger.chambers and not s.finger.tendons, _BY_TENDONS, _CHAMBERS),
    beside("mpc of pressures at once", lambda s: not s.finger.lagging_pressures, _PRESSURE, _COMMANDED_PRESSURE),
    beside("mpc of rigid tendons", lambda s: not (s.finger.winches or s.plant.guides), "plant.axial_stiffness", _SET),
    beside("mpc of inelastic tendons", _rigid, "plant.guides", _ELASTIC),
    beside("mpc of an unseen object", lambda s: s.estimator and not _sees(s, "object"), "object_moves", _SEEN),
    beside("mpc of a plant that jumps", lambda s: s.plant.drive_order == 1 or _jumps(s), _MATCHED, _SMOOTH),
    beside("mpc of no lag", lambda s: _jumps(s) and not _lags(s), "plant.drive_order", "needs plant.time_constant"),
    beside("mpc without damping", lambda s: not s.scenario_parameters("damping"), _scenarios("damping"), _FACTOR),
    beside("mpc of no such lag", lambda s: s.finger.winches or not s.lag, _scenarios("time_constant"), _LAGGING),
    *map(_unlike, (*_SLIDING, *_CABLES, "time_constant")),
    beside("mpc of drives unseen", lambda s: not _sees(s, "length", "angle"), _CONTACT, _PLACED),
    beside("mpc of tendons unlike in friction", _blurred, _CONTACT, _BLURRED),
    beside("mpc of winches unfelt", lambda s: _sees(s, "length") and not _sees(s, "tension"), _CONTACT, _PULLED),
    beside("mpc of motors seen late", _late, _CONTACT, _OLD),
    *tracked("mpc", "controller.cost"),
)


class ControlScene(CommandedScene):
    """A finger, its controller and estimator, its surroundings, and the plant of the closed loop."""

    AT = "controller.input"
    REFUSALS = _LOOPS

    fidelity: Fidelity = Fidelity()
    """Resolution of the controller's model."""
    controller: Controller
    """The controller: horizon, weights, limits."""
    estimator: Estimator | None = None
    """Estimator of the state; None: the controller measures the state."""
    mounting: Mounting | None = None
    """Mounting of the bench, as ``commission`` finds it; what drives read and are sent goes through it. None: as the
    model does."""
    plant: Plant = Plant()
    """Differences of the plant from the controller's model."""
    loads: ListOf[ForceLoad] = ()
    """Forces on the plant that the controller does not know."""
    duration: Annotated[Duration | None, Field(examples=[3.0, "3 s"])] = None
    """Duration of the closed loop [s]."""

    def _check(self) -> None:
        self._check_references()
        if self.estimator is not None:
            self._check_estimator(self.estimator)
        self._doubt_margin()
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
        check_references(self, cost, self.object_moves)

    def _doubt_margin(self) -> None:
        """Warn of a weight or delay that leaves no margin for unmodeled dead time.

        A tracked contact force is exempt: through a stiff contact, a calm command costs accuracy (the mug's mission: 12
        instead of 5 % of the force).
        """
        rate, weight = self.controller.input.rate_max, self.controller.cost.input_rate
        unit = f"{self.finger.inputs[0].unit}/s"
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
        if estimator.contact_detection is not None:
            places = estimator.contact_detection.places
            self.finger.rod.check_inside("estimator.contact_detection.places[{}]", places)
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
    def bench_mounting(self) -> Mounting | None:
        """True mounting of the plant's bench: where it states none, the one that the controller knows."""
        return self.mounting if self.plant.mounting is None else self.plant.mounting

    @property
    def disturbances(self) -> frozenset[str]:
        """Names of the disturbances that are estimated."""
        return frozenset() if self.estimator is None else frozenset(self.estimator.disturbances.stated())
