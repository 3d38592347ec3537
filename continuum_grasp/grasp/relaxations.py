"""The limits of a scene that can be relaxed, one at a time, to find out which of them rules a grasp out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from continuum_grasp.scene.grasp import GraspScene, OutOfPlaneGravity
from continuum_grasp.scene.value import Value

__all__ = ["RELAXATIONS", "Relaxation"]


@dataclass(frozen=True)
class Relaxation:
    """A limit that may be relaxed by an amount z >= 0, in SI units.

    Attributes
    ----------
    name : str
    key : str
        YAML key of the limit.
    unit : str
    limit : callable
        The limit of a scene.
    relaxed : callable
        The scene with its limit relaxed by an amount.
    needed : str
        Sentence for a reason; ``{limit}``, ``{needed}`` stand for numbers.
    start : callable
        An amount to begin the search with, for a scene; well inside what it may be.
    most : float
        Amount that makes no sense any more: nothing short of it is a repair.
    size : int
        Components of what gives way; beyond one, the amount is their norm.
    measured : bool
        The amount is itself the number to tell; no key of the scene holds one.
    excuses : str
        Check of the certificate that may then be off by the amount, where no key of the scene can be changed
        for it.
    repair : str
        What to do; ``{key}``, ``{needed}`` and ``{unit}`` stand for these.
    """

    name: str
    key: str
    unit: str
    limit: Callable[[GraspScene], float]
    relaxed: Callable[[GraspScene, float], GraspScene]
    needed: str
    start: Callable[[GraspScene], float]
    most: float = float("inf")
    size: int = 1
    measured: bool = False
    excuses: str = ""
    repair: str = "{key} = {needed:.4g} {unit}"

    def value(self, scene: GraspScene, amount: float) -> float:
        """The limit after it has given way by ``amount``."""
        if self.measured:
            return amount
        return self.limit(self.relaxed(scene, amount))

    def sentence(self, scene: GraspScene, amount: float) -> str:
        """The reason with its numbers."""
        return self.needed.format(limit=self.limit(scene), needed=self.value(scene, amount))

    def advice(self, scene: GraspScene, amount: float) -> str:
        """What to do."""
        unit = "" if self.unit == "1" else self.unit
        return self.repair.format(key=self.key, needed=self.value(scene, amount), unit=unit).strip()


def _with(value: Value, **changes: object) -> Value:
    return value.model_copy(update=changes)


def _tension(scene: GraspScene, amount: float) -> GraspScene:
    tendons = scene.finger.tendons
    if tendons is None:
        return scene
    stronger = _with(tendons, max_tension=tendons.max_tension + amount)
    return _changed(scene, finger=_with(scene.finger, tendons=stronger))


def _changed(scene: GraspScene, **changes: object) -> GraspScene:
    return scene.model_copy(update=changes)


def _friction(scene: GraspScene, amount: float) -> GraspScene:
    palm = None if scene.palm is None else _with(scene.palm, friction=scene.palm_friction + amount)
    contacts = _with(scene.contacts, friction=scene.contacts.friction + amount)
    return _changed(scene, contacts=contacts, palm=palm)


def _normal(scene: GraspScene, amount: float) -> GraspScene:
    most = scene.contacts.normal_force_max + amount
    return _changed(scene, contacts=_with(scene.contacts, normal_force_max=most))


def _mass(scene: GraspScene, amount: float) -> GraspScene:
    return _changed(scene, object=_with(scene.object, mass=scene.object.mass * (1.0 - amount)))


def _strain(scene: GraspScene, amount: float) -> GraspScene:
    finger = scene.finger
    if finger.strain_limit is None or finger.rod.diameter is None:
        return scene
    limit = finger.strain_limit + 0.5 * finger.rod.diameter * amount
    return _changed(scene, finger=_with(finger, strain_limit=limit))


def _bending(scene: GraspScene, amount: float) -> GraspScene:
    return _changed(scene, fidelity=_with(scene.fidelity, bending_range=scene.bending_range + amount))


def _tilt(scene: GraspScene, amount: float) -> GraspScene:
    return _changed(scene, gravity=_with(scene.gravity, tilt="ignore"))


def _tilt_scale(scene: GraspScene) -> float:
    """Moment of the object's weight about its rim [N m]."""
    magnitude = scene.gravity.magnitude if isinstance(scene.gravity, OutOfPlaneGravity) else 0.0
    return scene.object.mass * magnitude * scene.object.radius


def _unchanged(scene: GraspScene, amount: float) -> GraspScene:
    return scene


def _max_tension(scene: GraspScene) -> float:
    return 0.0 if scene.finger.tendons is None else scene.finger.tendons.max_tension


RELAXATIONS = (
    Relaxation(
        "tension",
        "finger.tendons.max_tension",
        "N",
        _max_tension,
        _tension,
        "the tendon is too weak: {limit:.4g} N at most, {needed:.4g} N needed",
        _max_tension,
    ),
    Relaxation(
        "friction",
        "contacts.friction",
        "1",
        lambda s: s.contacts.friction,
        _friction,
        "friction is too low: coefficient {limit:.4g}, {needed:.4g} needed",
        lambda s: 0.5,
        most=20.0,
    ),
    Relaxation(
        "normal force",
        "contacts.normal_force_max",
        "N",
        lambda s: s.contacts.normal_force_max,
        _normal,
        "a contact must bear more: {limit:.4g} N allowed, {needed:.4g} N needed",
        lambda s: s.contacts.normal_force_max,
    ),
    Relaxation(
        "mass",
        "object.mass",
        "kg",
        lambda s: s.object.mass,
        _mass,
        "the object is too heavy: {limit:.4g} kg, {needed:.4g} kg can be held",
        lambda s: 0.8,
        most=1.0,
    ),
    Relaxation(
        "tilt balance",
        "gravity.tilt",
        "N m",
        lambda s: 0.0,
        _tilt,
        "the object would tip over: the contacts leave a moment of {needed:.3g} N m at least",
        _tilt_scale,
        size=2,
        measured=True,
        repair="{key}: ignore, if something else bears {needed:.3g} {unit}",
    ),
    Relaxation(
        "strain",
        "finger.strain_limit",
        "1",
        lambda s: s.finger.strain_limit or 0.0,
        _strain,
        "the rod must bend more: strain {limit:.4g} allowed, {needed:.4g} needed",
        lambda s: s.finger.curvature_limit,
    ),
    Relaxation(
        "bending range",
        "fidelity.bending_range",
        "rad",
        lambda s: s.bending_range,
        _bending,
        "an element must bend beyond the model's range: {limit:.4g} rad allowed, {needed:.4g} rad needed",
        lambda s: 1.0,
        most=3.0,
    ),
    Relaxation(
        "room at the palm",
        "palm",
        "m",
        lambda s: 0.0,
        _unchanged,
        "the palm is in the way: the finger would have to pass {needed:.2g} m deep through it",
        lambda s: 0.5 * s.object.radius,
        measured=True,
        excuses="penetration into the palm",
        repair="make room of {needed:.2g} m at the palm (a shorter finger, another base or palm)",
    ),
    Relaxation(
        "room at the object",
        "object",
        "m",
        lambda s: 0.0,
        _unchanged,
        "the finger cannot touch as wanted without passing {needed:.2g} m deep through the object",
        lambda s: 0.25 * s.object.radius,
        measured=True,
        excuses="penetration into the object",
        repair="place base or object so that the finger need not pass {needed:.2g} m deep through the object",
    ),
)
