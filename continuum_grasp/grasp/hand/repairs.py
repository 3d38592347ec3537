"""Limits of a hand that may stand in the way of a grasp, and the numbers that repair it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

from continuum_grasp.base import Array
from continuum_grasp.grasp.hand.certificate import certify_hand
from continuum_grasp.grasp.hand.search import HandSearch, HandTried
from continuum_grasp.grasp.problem.relaxations import beyond_needed, changed_numbers, stronger
from continuum_grasp.grasp.values import NEAR, Reason
from continuum_grasp.scene import HandScene

_NEAREST = 2
"""Starts of each set of contacts from which limits are relaxed, those whose forces balance best with more of it; the
next where none of the first is solved."""
_EASES, _LITTLE = 0.75, 0.2
"""Part of what the best forces of a start leave, and residual, scaled: a limit is relaxed from starts that leave this
much at most with more of it. In eight hands that hold nothing, relaxing led to a point with 0.06 to 0.62 of what was
left, and with more where little was."""


@dataclass(frozen=True)
class HandLimit:
    """A limit of a hand that may be relaxed."""

    name: str
    key: str
    unit: str
    why: str  # sentence with ``{limit}`` and ``{needed}``
    limit: Callable[[HandScene], float]
    changed: Callable[[HandScene, float], HandScene]
    eased: Callable[[HandScene], float]  # an amount to begin with (SI); of additive ones, the most that makes sense
    additive: bool = True  # whether the amount is in the unit of the limit; False: a part by which it is less

    def reason(self, scene: HandScene, needed: float, held: HandTried, *, stable: bool) -> Reason:
        """The reason that a grasp with this limit confirms; one that is not stable says so."""
        changed = self.changed(scene, needed)
        limit = self.limit(scene)
        text = self.why.format(limit=limit, needed=needed)
        # Fingers may have limits of their own, and motors torques, which go with it.
        numbers = dict(changed_numbers(scene, changed)) or {self.key: needed}
        key, *others = sorted(numbers, key=lambda each: each != self.key)
        repair = " together with ".join(f"{each} = {self._text(each, numbers[each])}" for each in (key, *others))
        repair += "" if stable else " (in balance, but not stable)"
        unit = self._unit(key)
        if unit != self.unit:
            limit = dict(changed_numbers(changed, scene))[key]
            needed = numbers[key]
        return Reason(self.name, key, unit, limit, needed, text, repair, stable=stable, arrays=held.arrays)

    def _unit(self, key: str) -> str:
        return "N m" if key.endswith("torque_max") else self.unit

    def _text(self, key: str, number: float) -> str:
        unit = self._unit(key)
        return f"{number:.3g}" if unit == "1" else f"{number:.{4 if unit == 'N m' else 3}g} {unit}"

    def needed(self, scene: HandScene, amount: float) -> float:
        """The limit where it is relaxed by an amount (SI)."""
        limit = self.limit(scene)
        return limit + amount if self.additive else limit * (1.0 - amount)


def _stronger(scene: HandScene, tension: float, weak: Collection[str] | None = None) -> HandScene:
    """Tendons and motors, of all fingers or the weak ones, bear a tension; those that bear more stay."""
    hand = scene.hand
    setups = [setup for setup in scene.setups if weak is None or setup.name in weak]
    fingers = {id(setup.finger): stronger(setup, tension - setup.max_tension) for setup in setups}
    bases = {
        name: base if base.finger is None else base.replaced(finger=fingers.get(id(base.finger), base.finger))
        for name, base in (hand.bases or {}).items()
    }
    return scene.replaced(hand=hand.replaced(finger=fingers.get(id(hand.finger), hand.finger), bases=bases or None))


def _of_weak(limit: HandLimit, scene: HandScene, arrays: Mapping[str, Array]) -> HandLimit:
    """A limit of tensions that is only about the fingers that a relaxed grasp overloads; others are as they are."""
    if limit.name != "tension":
        return limit
    weak = dict[str, float]()
    for setup in scene.setups:
        tensions = arrays[f"{setup.name}.tensions"]
        law = setup.drive
        # Motors of a pulley pull with a difference.
        overloaded = law is not None and law.pulley and abs(tensions[0] - tensions[1]) > law.greatest
        if overloaded or tensions.max() > setup.max_tension:
            weak[setup.name] = setup.max_tension
    if not weak:
        return limit
    return replace(limit, limit=lambda _: max(weak.values()), changed=lambda scene, t: _stronger(scene, t, weak))


LIMITS = (
    HandLimit(
        "tension",
        "hand.finger.tendons.max_tension",
        "N",
        "the tendons are too weak: {limit:.3g} N at most, {needed:.3g} N needed",
        lambda scene: max(setup.max_tension for setup in scene.setups),
        _stronger,
        lambda scene: 4.0 * max(setup.max_tension for setup in scene.setups),
    ),
    HandLimit(
        "friction",
        "contacts.friction",
        "1",
        "friction is too low: coefficient {limit:.3g}, {needed:.3g} needed",
        lambda scene: scene.contacts.friction,
        lambda scene, friction: scene.changed({"contacts.friction": friction}),
        lambda scene: 1.5,
    ),
    HandLimit(
        "normal force",
        "contacts.normal_force_max",
        "N",
        "a contact must bear more: {limit:.3g} N allowed, {needed:.3g} N needed",
        lambda scene: scene.contacts.normal_force_max,
        lambda scene, force: scene.changed({"contacts.normal_force_max": force}),
        lambda scene: 4.0 * scene.contacts.normal_force_max,
    ),
    HandLimit(
        "mass",
        "object.mass",
        "kg",
        "the object is too heavy: {limit:.3g} kg, {needed:.3g} kg can be held",
        lambda scene: scene.object.weighed,
        lambda scene, mass: scene.replaced(object=scene.object.replaced(mass=mass, density=None)),
        lambda scene: 0.8,
        additive=False,
    ),
)
"""Limits that may stand in the way, in the order in which they are named."""


def repair_of(
    scene: HandScene, search: HandSearch, starts: Sequence[tuple[HandTried, float]], limit: HandLimit
) -> Reason | None:
    """The least relaxation of a limit with which the object is held, where it is confirmed by a certificate.

    Of each start that was solved, ``starts`` have what its best forces leave.
    """
    unit = search.units.force if limit.unit == "N" else 1.0
    easing = limit.eased(scene)
    eased = HandSearch(limit.changed(scene, limit.needed(scene, easing)), search.budget)
    sets = dict[frozenset[str], list[tuple[float, HandTried]]]()
    for one, left in starts:
        less = eased.left(one)
        if less <= max(_EASES * left, _LITTLE):
            sets.setdefault(one.on, []).append((less, one))
    ranked = [sorted(each, key=lambda pair: pair[0])[:_NEAREST] for each in sets.values()]
    found = list[tuple[float, HandTried]]()
    for each in zip_longest(*ranked):
        for _, one in filter(None, each):
            if not search.budget.over:
                relaxed, amount = search.relaxed(one, limit.name, eased, easing / unit)
                found += [(amount * unit, relaxed)] if relaxed.attempt.converged else []
        if found:
            break
    unstable: Reason | None = None
    for amount, relaxed in sorted(found, key=lambda pair: pair[0]):
        if amount > (easing if limit.additive else 1.0 - NEAR):
            break  # no repair that makes sense: of an object, nothing at all would be left
        own = _of_weak(limit, scene, relaxed.arrays)
        needed = beyond_needed(own.needed(scene, amount), 1.0 if limit.additive else -1.0)
        other = HandSearch(own.changed(scene, needed), search.budget)
        held = other.again(relaxed)
        certificate = certify_hand(other.scene, held.arrays)
        if held.attempt.converged and certificate.acceptable:
            return own.reason(scene, needed, held, stable=True)
        if held.attempt.converged and certificate.passed and unstable is None:
            unstable = own.reason(scene, needed, held, stable=False)
    return unstable
