"""The limits of a scene that can be relaxed, one at a time, to find out which of them rules a grasp out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from continuum_grasp.grasp.values import NEAR
from continuum_grasp.scene import FAMILIES, ONE_TURN, FingerSetup, GraspFinger, GraspScene, MotorDrive, Value

BEYOND = 0.01
"""Part of a limit by which its repair goes beyond the amount that is just enough: there one grasp is left, at the edge
of all limits, which neither a rounded number nor a search from other starts reaches."""


@dataclass(frozen=True)
class RelaxedLimit:
    """A limit that may be relaxed by an amount z >= 0, in SI units."""

    name: str
    key: str  # YAML key of the limit
    unit: str
    needed: str  # sentence for a reason; ``{limit}``, ``{needed}``, ``{digits}``, ``{unit}`` stand for these
    start: Callable[[GraspScene], float]  # an amount to begin the search with; well inside what it may be
    limit: Callable[[GraspScene], float] | None = None
    """The limit of a scene. None: no key of the scene holds one, and the amount itself is the number to report."""
    relaxed: Callable[[GraspScene, float], GraspScene] = lambda scene, amount: scene
    """The scene with its limit relaxed by an amount."""
    repair: str = "{key} = {needed:.3g} {unit}"
    """Advice where no numbers of a scene change; ``{key}``, ``{needed}`` and ``{unit}`` stand for these."""
    most: Callable[[GraspScene], float] = lambda scene: math.inf  # amount from which on a relaxation makes no sense
    size: int = 1  # components of the relaxation; beyond one, the amount is their norm
    additive: bool = True  # whether the amount has the unit of the limit; False: it is a part of it
    excuses: Callable[[str], bool] | None = None
    """Whether a check of the certificate, by its name, may then be off by the amount: where no key of the scene can be
    changed for it."""
    without: Callable[[GraspScene], GraspScene] = lambda scene: scene
    """The scene without the obstacle, where no key of it can be changed by the amount."""
    applies: Callable[[GraspScene], bool] = lambda scene: True  # whether a scene has the limit at all
    spare: float = 1e-4
    """Part of an amount that may be added to it where it is just enough; none where it changes what forces balance."""
    bounds_shape: bool = True  # whether it bounds shapes and places; False: it bounds forces alone

    def sensible(self, scene: GraspScene) -> float:
        """Amount from which on a relaxation counts as none."""
        return self.most(scene) * (1.0 - NEAR)

    def eased(self, scene: GraspScene, amount: float) -> GraspScene:
        """The scene to start from; the same one where nothing is known to be in the way."""
        return self.without(scene) if self.limit is None else self.relaxed(scene, amount)

    def value(self, scene: GraspScene, amount: float) -> float:
        """The limit after it is relaxed by ``amount``."""
        return amount if self.limit is None else self.limit(self.relaxed(scene, amount))

    def enough(self, scene: GraspScene, amount: float) -> float:
        """An amount beyond one that is just enough, with which the limit has three digits."""
        bound = self.value(scene, 0.0)
        needed = self.value(scene, amount)
        way = math.copysign(1.0, needed - bound)
        if needed == bound:
            return amount
        beyond = amount * (beyond_needed(needed, way) - bound) / (needed - bound)
        return beyond if beyond < self.sensible(scene) else amount


def beyond_needed(needed: float, way: float) -> float:
    """A number of three digits beyond the one that is just enough, above it for a ``way`` of 1, below for -1."""
    number = (1.0 + way * BEYOND) * needed
    digit = 10.0 ** (math.floor(math.log10(number)) - 2)
    return way * math.ceil(way * number / digit) * digit


V = TypeVar("V", bound=Value)


def _with(value: V, **changes: object) -> V:
    return value.model_copy(update=changes)


def _fingers(scene: GraspScene, change: Callable[[FingerSetup], GraspFinger]) -> GraspScene:
    return scene.with_fingers({setup.name: change(setup) for setup in scene.setups})


def _tension(scene: GraspScene, amount: float) -> GraspScene:
    return _fingers(scene, lambda setup: stronger(setup, amount))


def stronger(setup: FingerSetup, amount: float) -> GraspFinger:
    """A finger whose tendons and motors pull by an amount [N] more; those that are strong enough stay."""
    most = max(setup.tendons.max_tension, setup.max_tension + amount)
    law = setup.drive
    more = setup.finger.with_tendons(max_tension=most)
    if law is None or not isinstance(law.drive, MotorDrive):
        return more
    # Motors of a pulley pull with a difference, which may need all of it.
    pull = (law.greatest if law.pulley else setup.max_tension) + amount
    torque = max(law.drive.torque_max, law.drive.coulomb_friction + law.radius * pull)
    return more.with_tendons(drive=law.drive.replaced(torque_max=torque))


def changed_numbers(old: object, new: object, path: str = "") -> Iterator[tuple[str, float]]:
    """Keys at which a scene, or part of one, has numbers that another has not, and these numbers."""
    if isinstance(old, Value) and isinstance(new, Value):
        parts = [(f"{path}.{name}" if path else name, value, getattr(new, name, None)) for name, value in old]
    elif isinstance(old, dict) and isinstance(new, dict):
        parts = [(f"{path}.{name}", value, new.get(name)) for name, value in old.items()]
    elif isinstance(old, tuple) and isinstance(new, tuple):
        parts = [(f"{path}[{k}]", value, other) for k, (value, other) in enumerate(zip(old, new, strict=False))]
    else:
        parts = []
        # What has no number, such as a bending range that the program chooses, has no key to be changed.
        if isinstance(old, float) and isinstance(new, float) and new != old:
            yield path, new
    for key, value, other in parts:
        if value is not other:
            yield from changed_numbers(value, other, key)


def with_contacts_changed(scene: GraspScene, key: str, change: Callable[[float], float]) -> GraspScene:
    """The scene with a limit of contacts changed wherever it has a number for it."""

    def changed(value: V) -> V:
        current = getattr(value, key, None)
        return value if current is None else _with(value, **{key: change(current)})

    fingers = _fingers(scene, lambda setup: _with(setup.finger, contacts=changed(setup.finger.contacts)))
    supports = {name: changed(support) for name, support in scene.supports.items()}
    return _with(fingers, contacts=changed(scene.contacts), supports=supports)


def _strain(scene: GraspScene, amount: float) -> GraspScene:
    def tougher(setup: FingerSetup) -> GraspFinger:
        limit = setup.finger.strain_limit
        return setup.finger if limit is None else _with(setup.finger, strain_limit=limit * (1.0 + amount))

    return _fingers(scene, tougher)


def with_bending_range(scene: GraspScene, least: float, more: float = 0.0) -> GraspScene:
    """The scene with elements that may bend by ``more``, and by so much at ``least`` [rad]."""

    def wider(setup: FingerSetup) -> GraspFinger:
        range_ = max(setup.bending_range + more, least)
        return _with(setup.finger, fidelity=_with(setup.finger.fidelity or scene.fidelity, bending_range=range_))

    fidelity = scene.fidelity
    given = scene.fidelity.bending_range
    if given is not None:  # of fingers that have none of their own
        fidelity = _with(fidelity, bending_range=max(given + more, least))
    return _with(_fingers(scene, wider), fidelity=fidelity)


def gives_bending_range(scene: GraspScene) -> bool:
    """Whether the user gave a bending range: by default it is a choice of the program, which it refines itself."""
    return any((setup.fidelity or scene.fidelity).bending_range is not None for setup in scene.named_fingers.values())


def gives_elements(scene: GraspScene) -> bool:
    """Whether the user gave a number of elements."""
    return any((setup.fidelity or scene.fidelity).elements is not None for setup in scene.named_fingers.values())


def _bendable(scene: GraspScene) -> float:
    """The most by which a bending range may be greater: a given one up to what its family follows."""
    one_turn = [setup.bending_range for setup in scene.setups if FAMILIES[setup.family].one_turn]
    return min(3.0, ONE_TURN - max(one_turn)) if one_turn and gives_bending_range(scene) else 3.0


def _may_tilt(scene: GraspScene) -> GraspScene:
    return _with(scene, upright=True)


def _without_obstacles(scene: GraspScene) -> GraspScene:
    """Without the supports that the object must not touch."""
    retained = {name: support for name, support in scene.supports.items() if support.touch != "off"}
    return scene if len(retained) == len(scene.supports) else _with(scene, supports=retained)


def _into_object(check: str) -> bool:
    return check.startswith("penetration into the object, ")


def _max_tension(scene: GraspScene) -> float:
    return max(setup.max_tension for setup in scene.setups)


def _normal_max(scene: GraspScene) -> float:
    return max([setup.normal_force_max for setup in scene.setups] + [scene.contacts.normal_force_max])


RELAXATIONS = (
    RelaxedLimit(
        "tension",
        "finger.tendons.max_tension",
        "N",
        "the tendon is too weak: {limit:.{digits}g} {unit} at most, {needed:.{digits}g} {unit} needed",
        start=_max_tension,
        limit=_max_tension,
        relaxed=_tension,
        bounds_shape=False,
    ),
    RelaxedLimit(
        "friction",
        "contacts.friction",
        "1",
        "friction is too low: coefficient {limit:.{digits}g}, {needed:.{digits}g} needed",
        start=lambda s: 0.5,
        limit=lambda s: min([setup.friction for setup in s.setups] + [s.contacts.friction]),
        relaxed=lambda s, amount: with_contacts_changed(s, "friction", lambda friction: friction + amount),
        most=lambda s: 20.0,
        bounds_shape=False,
    ),
    RelaxedLimit(
        "normal force",
        "contacts.normal_force_max",
        "N",
        "a contact must bear more: {limit:.{digits}g} {unit} allowed, {needed:.{digits}g} {unit} needed",
        start=_normal_max,
        limit=_normal_max,
        relaxed=lambda s, amount: with_contacts_changed(s, "normal_force_max", lambda force: force + amount),
        bounds_shape=False,
    ),
    RelaxedLimit(
        "mass",
        "object.mass",
        "kg",
        "the object is too heavy: {limit:.{digits}g} kg, {needed:.{digits}g} kg can be held",
        start=lambda s: 0.8,
        limit=lambda s: s.object.mass,
        relaxed=lambda s, amount: _with(s, object=_with(s.object, mass=s.object.mass * (1.0 - amount))),
        most=lambda s: 1.0,
        spare=0.0,
        additive=False,
        applies=lambda s: s.weight > 0.0,
        bounds_shape=False,
    ),
    RelaxedLimit(
        "tilt balance",
        "upright",
        "N m",
        "the object would tip over: the contacts leave a moment of at least {needed:.3g} {unit}",
        start=lambda s: s.weight * s.object.size,  # moment of the weight about the rim
        relaxed=lambda s, amount: _may_tilt(s),
        without=_may_tilt,
        repair="{key}: true, if something else bears {needed:.3g} {unit}",
        size=2,
        applies=lambda s: 3 in s.balances and s.object.mass > 0,
        bounds_shape=False,
    ),
    RelaxedLimit(
        "strain",
        "finger.strain_limit",
        "1",
        "the rod must bend more: strain {limit:.{digits}g} allowed, {needed:.{digits}g} needed",
        start=lambda s: 1.0,
        limit=lambda s: min(f.strain_limit for f in s.named_fingers.values() if f.strain_limit is not None),
        relaxed=_strain,
        additive=False,
        applies=lambda s: any(f.strain_limit is not None for f in s.named_fingers.values()),
    ),
    RelaxedLimit(
        "bending range",
        "fidelity.bending_range",
        "rad",
        "an element must bend beyond the model's range: {limit:.{digits}g} rad allowed, {needed:.{digits}g} rad needed",
        start=lambda s: 1.0,
        limit=lambda s: max(setup.bending_range for setup in s.setups),
        relaxed=lambda s, amount: with_bending_range(s, 0.0, amount),
        most=_bendable,
        applies=lambda s: _bendable(s) > 0.0,
    ),
    RelaxedLimit(
        "clearance at the supports",
        "supports",
        "m",
        "a support is in the way: a finger would have to pass {needed:.2g} m deep through it",
        start=lambda s: 0.5 * s.object.size,
        repair="make space of {needed:.2g} m at the support (a shorter finger, another base or support)",
        excuses=lambda check: check.startswith("penetration into ") and not _into_object(check),
        without=_without_obstacles,
        applies=lambda s: bool(s.supports),
    ),
    RelaxedLimit(
        "clearance at the object",
        "object",
        "m",
        "a finger cannot touch as wanted without passing {needed:.2g} m deep through the object",
        start=lambda s: 0.25 * s.object.size,
        repair="place base or object so that no finger need pass {needed:.2g} m deep through the object",
        excuses=_into_object,
    ),
    RelaxedLimit(
        "overlap",
        "overlap",
        "m",
        "fingers are in each other's way: two would have to overlap by {needed:.2g} m",
        start=lambda s: 0.25 * s.object.size,
        repair="move the bases {needed:.2g} m apart, or overlap: allow where the fingers lie at different heights",
        excuses=lambda check: check.startswith("overlap of fingers, "),
        without=lambda s: _with(s, overlap="allow"),
        applies=lambda s: bool(s.pairs),
    ),
)
