"""The limits of a scene that can be relaxed, one at a time, to find out which of them rules a grasp out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.grasp_options import GraspFinger, OutOfPlaneGravity
from continuum_grasp.scene.value import Value


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
        Amount from which on a relaxation makes no sense.
    size : int
        Components of the relaxation; beyond one, the amount is their norm.
    measured : bool
        The amount itself is the number to report; no key of the scene holds one.
    excuses : callable, optional
        Whether a check of the certificate, by its name, may then be off by the amount: where no key of the scene can
        be changed for it.
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
    excuses: Callable[[str], bool] | None = None
    additive: bool = True
    """Whether the amount has the unit of the limit; False: it is a part of it."""
    repair: str = "{key} = {needed:.4g} {unit}"
    without: Callable[[GraspScene], GraspScene] | None = None
    """The scene without what is in the way, where no key of it can be changed by the amount."""

    def eased(self, scene: GraspScene, amount: float) -> GraspScene:
        """The scene to start from; the same one where nothing is known to be in the way."""
        if self.without is not None:
            return self.without(scene)
        return scene if self.measured else self.relaxed(scene, amount)

    def value(self, scene: GraspScene, amount: float) -> float:
        """The limit after it is relaxed by ``amount``."""
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


V = TypeVar("V", bound=Value)


def _with(value: V, **changes: object) -> V:
    return value.model_copy(update=changes)


def _each_finger(scene: GraspScene, change: Callable[[GraspFinger], GraspFinger]) -> GraspScene:
    return scene.with_fingers({name: change(finger) for name, finger in scene.named_fingers.items()})


def _tension(scene: GraspScene, amount: float) -> GraspScene:
    def stronger(setup: FingerSetup) -> GraspFinger:
        return _with(setup.finger, tendons=_with(setup.tendons, max_tension=setup.tendons.max_tension + amount))

    return scene.with_fingers({setup.name: stronger(setup) for setup in scene.setups})


def _raised(key: str) -> Callable[[GraspScene, float], GraspScene]:
    """What raises a limit of contacts wherever the scene has a number for it."""

    def raised(scene: GraspScene, amount: float) -> GraspScene:
        def more(value: V) -> V:
            given = getattr(value, key, None)
            return value if given is None else _with(value, **{key: given + amount})

        fingers = _each_finger(scene, lambda f: _with(f, contacts=more(f.contacts)))
        supports = {name: more(support) for name, support in scene.supports.items()}
        return _with(fingers, contacts=more(scene.contacts), supports=supports)

    return raised


def _mass(scene: GraspScene, amount: float) -> GraspScene:
    return _with(scene, object=_with(scene.object, mass=scene.object.mass * (1.0 - amount)))


def _strain(scene: GraspScene, amount: float) -> GraspScene:
    def tougher(finger: GraspFinger) -> GraspFinger:
        limit = finger.strain_limit
        return finger if limit is None else _with(finger, strain_limit=limit * (1.0 + amount))

    return _each_finger(scene, tougher)


def _bending(scene: GraspScene, amount: float) -> GraspScene:
    def wider(setup: FingerSetup) -> GraspFinger:
        fidelity = _with(setup.finger.fidelity or scene.fidelity, bending_range=setup.bending_range + amount)
        return _with(setup.finger, fidelity=fidelity)

    return scene.with_fingers({setup.name: wider(setup) for setup in scene.setups})


def _tilt(scene: GraspScene, amount: float) -> GraspScene:
    return _with(scene, gravity=_with(scene.gravity, tilt="ignore"))


def _tilt_scale(scene: GraspScene) -> float:
    """Moment of the object's weight about its rim [N m]."""
    magnitude = scene.gravity.magnitude if isinstance(scene.gravity, OutOfPlaneGravity) else 0.0
    return scene.object.mass * magnitude * scene.object.size


def _into_object(name: str) -> bool:
    return name.startswith("penetration into the object, ")


def _unchanged(scene: GraspScene, amount: float) -> GraspScene:
    return scene


def _without_obstacles(scene: GraspScene) -> GraspScene:
    """Without the supports that the object must not touch."""
    retained = {name: support for name, support in scene.supports.items() if support.touch != "off"}
    return scene if len(retained) == len(scene.supports) else _with(scene, supports=retained)


def _max_tension(scene: GraspScene) -> float:
    return max(setup.tendons.max_tension for setup in scene.setups)


def _normal_max(scene: GraspScene) -> float:
    return max([setup.normal_force_max for setup in scene.setups] + [scene.contacts.normal_force_max])


def _least_friction(scene: GraspScene) -> float:
    return min([setup.friction for setup in scene.setups] + [scene.contacts.friction])


def _strain_limit(scene: GraspScene) -> float:
    return min((f.strain_limit for f in scene.named_fingers.values() if f.strain_limit is not None), default=0.0)


def _bending_range(scene: GraspScene) -> float:
    return max(setup.bending_range for setup in scene.setups)


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
        _least_friction,
        _raised("friction"),
        "friction is too low: coefficient {limit:.4g}, {needed:.4g} needed",
        lambda s: 0.5,
        most=20.0,
    ),
    Relaxation(
        "normal force",
        "contacts.normal_force_max",
        "N",
        _normal_max,
        _raised("normal_force_max"),
        "a contact must bear more: {limit:.4g} N allowed, {needed:.4g} N needed",
        _normal_max,
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
        additive=False,
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
        _strain_limit,
        _strain,
        "the rod must bend more: strain {limit:.4g} allowed, {needed:.4g} needed",
        lambda s: 1.0,
        additive=False,
    ),
    Relaxation(
        "bending range",
        "fidelity.bending_range",
        "rad",
        _bending_range,
        _bending,
        "an element must bend beyond the model's range: {limit:.4g} rad allowed, {needed:.4g} rad needed",
        lambda s: 1.0,
        most=3.0,
    ),
    Relaxation(
        "clearance at the supports",
        "supports",
        "m",
        lambda s: 0.0,
        _unchanged,
        "a support is in the way: a finger would have to pass {needed:.2g} m deep through it",
        lambda s: 0.5 * s.object.size,
        measured=True,
        excuses=lambda name: name.startswith("penetration into ") and not _into_object(name),
        without=_without_obstacles,
        repair="make space of {needed:.2g} m at the support (a shorter finger, another base or support)",
    ),
    Relaxation(
        "clearance at the object",
        "object",
        "m",
        lambda s: 0.0,
        _unchanged,
        "a finger cannot touch as wanted without passing {needed:.2g} m deep through the object",
        lambda s: 0.25 * s.object.size,
        measured=True,
        excuses=_into_object,
        repair="place base or object so that no finger need pass {needed:.2g} m deep through the object",
    ),
)
