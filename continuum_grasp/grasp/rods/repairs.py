"""Repairs of a scene without a grasp: contacts that may be left out, and least amounts by which limits change.

A limit is widened in the problem at a cost, from the starts that come nearest to a grasp; then its amount alone is
minimized, with everything borne. The scene with its keys changed by this amount is solved, so that each repair is a
grasp. Where no limit alone is enough, all are widened at once: linear costs leave few of them in use, of which two at a
time are tried.
"""

from __future__ import annotations

import itertools
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from continuum_grasp.base import InputError
from continuum_grasp.grasp.rods.answers import AskedAnswers
from continuum_grasp.grasp.rods.limits import LIMITS, AnyGraspScene, WidenedFriction, WidenedLimit, WidenedPlace, shown
from continuum_grasp.grasp.rods.numbers import SceneNumbers
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.solving import RodGrasp, RodStart, StartedSearch
from continuum_grasp.grasp.values import GraspStatus, Reason

COST = 3.0
"""Cost of a limit's relative amount, of which an unborne force costs 100 and all tensions together 1."""
ALONE = 1e3
"""Cost of a limit's relative amount where that is minimized alone [1]."""
STARTS = 3
"""Starts from which a limit is widened [1]."""
MISSES = 2
"""Limits with which a start leads nowhere where another one leads to a grasp, after which it is left out [1]: in 15
scenes without a grasp, amounts are the same without that, which takes up to three times as long (`LeastRepairs.found`).
"""
UNUSUAL = 1.0
"""Friction coefficient that few surfaces have."""
USED = 1e-3
"""Relative amount from which on a limit is in use [1]."""
SPARES = (0.0, 1e-3, 1e-2)
"""Shares by which an amount is exceeded until the changed scene holds [1]: numbers are rounded, tables are smooth."""
FARTHER = (0.03, 0.08, 0.24)
"""Shares of a number by which it changes until the grasp is as stable as the scene requires [1]: the least push is 1 %
of a weight, and of 9 repairs of 5 scenes (`pinch`, bottles), all took 1 to 3 % in steps of 1 %."""


@dataclass(frozen=True, eq=False)
class LeastRepair:
    """Changes of a scene with which it has a grasp.

    Attributes
    ----------
    limits
        Limits that change; none where contacts may be left out.
    amounts
        Relative amount of each.
    changes
        New values by key.
    grasp
        A grasp of the changed scene.
    widened
        Solution with the limits widened that the amounts are from.
    is_stable
        Whether the grasp is as stable as the scene requires.
    """

    limits: tuple[WidenedLimit, ...]
    amounts: tuple[float, ...]
    changes: dict[str, Any]
    grasp: RodGrasp
    widened: RodGrasp | None = None
    is_stable: bool = True

    @property
    def is_unusual(self) -> bool:
        """Whether the repair asks for a friction coefficient that few surfaces have."""
        slips = any(isinstance(limit, WidenedFriction) for limit in self.limits)
        return slips and any(value > UNUSUAL for key, value in self.changes.items() if key.endswith("friction"))


class LeastRepairs:
    """Least amounts of the limits of a scene without a grasp."""

    def __init__(self, search: StartedSearch) -> None:
        self._search, self._scene = search, search.scene
        nearest = _different([grasp for grasp in search.tried if grasp.attempt.converged])[:STARTS]
        self._nearest: Sequence[RodGrasp | RodStart] = nearest or search.starts[:STARTS]
        self._misses = Counter[RodGrasp | RodStart]()
        self._driven_away = False  # whether no steadier grasp was found next to one that any small push opens

    def found(self) -> list[LeastRepair]:
        """Repairs: contacts, a limit alone, or two limits where none alone is enough; unusual friction comes last."""
        limits = [limit for limit in LIMITS if limit.applies(self._scene)]
        refuted = self._search.refuted
        if refuted is not None:
            # Nothing else enters the proof.
            limits = [limit for limit in limits if limit.loads]
        others = [*self._contacts(), *self._overlap()] if refuted is None else []
        repairs = [*others, *filter(None, (self._least((limit,)) for limit in limits))]
        if all(repair.is_unusual for repair in repairs):
            repairs = [*self._pairs(limits), *repairs]
        return sorted(repairs, key=lambda repair: (not repair.is_stable, repair.is_unusual))

    def _contacts(self) -> Iterator[LeastRepair]:
        """A repair by contacts that the search may leave out, or take."""
        changes = self._search.with_free_contacts()
        if not changes:
            return
        scene = changed(self._scene, changes)
        if scene is None:
            return
        other = self._search.with_contacts(scene)
        other.try_some(STARTS)
        if other.best is not None:
            on = other.best.start.on
            needed = {key: value for key, value in changes.items() if self._search.needs_free(key, on)}
            repair = LeastRepair((), (), needed or changes, other.best)
            required = self._required(repair)
            yield repair if required is None or repair.grasp.meets(required) else self._steadied(repair)

    def _overlap(self) -> Iterator[LeastRepair]:
        """A repair by fingers that may pass through each other, where that alone is in the way."""
        crossed = [grasp for grasp in self._nearest if isinstance(grasp, RodGrasp) and grasp.crosses]
        if not (crossed and getattr(self._scene, "overlap", "allow") == "forbid"):
            return
        changes = {"overlap": "allow"}
        scene = changed(self._scene, changes)
        for grasp in crossed:
            found = self._search.solved(grasp.start.changed(scene))
            if found.holds:
                yield LeastRepair((), (), changes, found)
                return

    def _pairs(self, limits: Sequence[WidenedLimit]) -> Iterator[LeastRepair]:
        """Repairs by two limits that are in use where all are widened."""
        known = set[frozenset[str]]()
        for near in self._nearest:
            grasp = self._widened(near, limits, COST)
            if not grasp.holds:
                continue
            used = {limit: limit.used(grasp.problem, grasp.attempt.x) for limit in limits}
            most = sorted((limit for limit in limits if used[limit] > USED), key=lambda limit: -used[limit])[:3]
            for pair in itertools.combinations(most, 2):
                names = frozenset(limit.name for limit in pair)
                # Where either body goes, the other may go the other way.
                twice = all(isinstance(limit, WidenedPlace) for limit in pair)
                if names not in known and not twice and (repair := self._least(pair)) is not None:
                    yield repair
                known.add(names)

    def _least(self, limits: tuple[WidenedLimit, ...]) -> LeastRepair | None:
        """The repair of the least amounts of limits from any of the starts."""
        if self._search.budget.over:
            return None
        widened = self._each_widened(limits)
        least = [self._widened(grasp, limits, ALONE) for grasp in _different([one for one in widened if one.holds])]
        held = [grasp for grasp in least if grasp.holds]
        for grasp in sorted(held, key=lambda grasp: sum(_amounts(grasp, limits))):
            for spare in SPARES:
                if (repair := self._confirmed(grasp, limits, spare)) is not None:
                    return self._firm(repair)
        return None

    def _firm(self, repair: LeastRepair) -> LeastRepair:
        """The repair with numbers so much farther that its grasp is as stable as required; the same where none is."""
        required = self._required(repair)
        if required is None or repair.grasp.meets(required):
            return repair
        # At a least amount, contacts are at the edge of their cones, where none bears a push.
        for share in FARTHER if repair.grasp.is_stable else () if self._driven_away else FARTHER[:1]:
            if (farther := self._exceeded(repair, share)).is_stable:
                return farther
        self._driven_away |= not repair.grasp.is_stable
        return replace(repair, is_stable=False)

    def _exceeded(self, repair: LeastRepair, share: float) -> LeastRepair:
        """A repair with numbers that are a share farther, steadied; unstable where its scene cannot be."""
        pairs = zip(repair.limits, repair.amounts, strict=True)
        amounts = tuple(limit.beyond(amount, share) for limit, amount in pairs)
        changes = changes_by(self._scene, repair.limits, amounts, repair.widened or repair.grasp)
        more = replace(repair, amounts=amounts, changes=changes)
        if changed(self._scene, changes) is None:
            return replace(more, is_stable=False)
        return self._steadied(more)

    def _steadied(self, repair: LeastRepair) -> LeastRepair:
        """The repair with a grasp that is as stable as the changed scene requires, if there is one next to its own."""
        required, known = self._required(repair), repair.widened or repair.grasp
        start = known.start.changed(changed(self._scene, repair.changes))
        # Stages are as coarse as of what is known: numbers are farther than finer ones move them.
        grasp = self._search.solved(start, widen=required, beside=known, fine=known.fine)
        is_stable = grasp.holds if required is None else grasp.meets(required)
        return replace(repair, grasp=grasp if is_stable else repair.grasp, is_stable=is_stable)

    def _required(self, repair: LeastRepair) -> AskedAnswers | None:
        """Answers to loads that the changed scene requires; None where it requires none."""
        search = self._search.again(changed(self._scene, repair.changes))
        required = search.steady if search.steady is not None else search.asked
        return required if required is not None and required.required else None

    def _each_widened(self, limits: Sequence[WidenedLimit]) -> list[RodGrasp]:
        """Solve from each of the starts, but for those that led nowhere where others led to a grasp."""
        known = [near for near in self._nearest if self._misses[near] < MISSES]
        widened = [self._widened(near, limits, COST) for near in known]
        if any(grasp.holds for grasp in widened):
            self._misses.update(near for near, grasp in zip(known, widened, strict=True) if not grasp.holds)
        return widened

    def _widened(self, near: RodGrasp | RodStart, limits: Sequence[WidenedLimit], cost: float) -> RodGrasp:
        """Solve from a start, or next to a solution, with limits widened at a cost; alone, everything is borne."""

        def loosen(numbers: SceneNumbers) -> SceneNumbers:
            for limit in limits:
                numbers = limit.loosened(numbers)
            return numbers

        def widen(problem: GraspRods) -> None:
            if cost == ALONE:
                problem.bear_all()
            for limit in limits:
                limit.widen(problem, cost)

        start, beside = (near.start, near) if isinstance(near, RodGrasp) else (near, None)
        return self._search.solved(start, widen=widen, loosen=loosen, beside=beside, fine=False)

    def _confirmed(self, widened: RodGrasp, limits: tuple[WidenedLimit, ...], spare: float) -> LeastRepair | None:
        """A grasp of the scene with limits changed by the amounts of a solution, and a share more."""
        amounts = tuple((1.0 + spare) * amount for amount in _amounts(widened, limits))
        changes = changes_by(self._scene, limits, amounts, widened)
        scene = changed(self._scene, changes)
        if scene is None:
            return None
        grasp = self._search.solved(widened.start.changed(scene), beside=widened)
        return LeastRepair(limits, amounts, changes, grasp, widened) if grasp.holds else None


def changed(scene: AnyGraspScene, changes: dict[str, Any]) -> Any:
    """A scene with changed keys, without doubts about numbers that are only tried; None where they contradict it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return scene.changed(changes)
        except InputError:
            return None


def changes_by(
    scene: AnyGraspScene, limits: Sequence[WidenedLimit], amounts: Sequence[float], widened: RodGrasp
) -> dict[str, Any]:
    """Changes of a scene's keys by relative amounts of limits, towards a solution with these widened."""
    changes = dict[str, Any]()
    for limit, amount in zip(limits, amounts, strict=True):
        changes |= limit.changes(scene, amount, widened.problem, widened.attempt.x)
    return changes


def _amounts(grasp: RodGrasp, limits: Sequence[WidenedLimit]) -> list[float]:
    return [limit.used(grasp.problem, grasp.attempt.x) for limit in limits]


def _different(tried: Sequence[RodGrasp]) -> list[RodGrasp]:
    """Solutions that differ in what nothing bears or in their aims, those that leave least first."""
    left = [(grasp.problem.unborne(grasp.attempt.x), grasp.attempt.objective, grasp) for grasp in tried]
    different = list[tuple[float, float, RodGrasp]]()
    for one in sorted(left, key=lambda each: each[:2]):
        if not any(np.allclose(one[:2], other[:2], rtol=1e-4) for other in different):
            different.append(one)
    return [grasp for _, _, grasp in different]


def reason_of(scene: AnyGraspScene, repair: LeastRepair) -> Reason:
    """A repair in words, with what its grasp lacks."""
    reason = _reason_of(scene, repair)
    if repair.is_stable:
        return reason
    return replace(reason, repair=f"{reason.repair}, but the grasp found then is {GraspStatus.UNSTABLE}", stable=False)


def _reason_of(scene: AnyGraspScene, repair: LeastRepair) -> Reason:
    if not repair.limits:
        key = next(iter(repair.changes))
        if key == "overlap":
            text = "fingers pass through each other, which they may where they lie at different heights"
            return Reason("overlap", key, "1", 0.0, 1.0, text, _advice(repair.changes, {}))
        text = "the contacts that are on or off leave no grasp: with other ones there is one"
        return Reason("contacts", key, "1", 0.0, 1.0, text, _advice(repair.changes, {}))
    first, *others = (_part(scene, repair, limit) for limit in repair.limits)
    if not others:
        return first
    text = "; and ".join(each.text for each in (first, *others))
    advice = " together with ".join(each.repair for each in (first, *others))
    return Reason(
        first.name, first.key, first.unit, first.limit, first.needed, f"two limits at once: {text}", advice,
        also=tuple(others),
    )  # fmt: skip


def _part(scene: AnyGraspScene, repair: LeastRepair, limit: WidenedLimit) -> Reason:
    """A limit of a repair in words."""
    problem, x = (repair.widened or repair.grasp).problem, (repair.widened or repair.grasp).attempt.x
    amount = repair.amounts[repair.limits.index(limit)]
    changes = limit.changes(scene, amount, problem, x)
    text, unit, given, needed = limit.words(scene, changes, amount)
    if isinstance(limit, WidenedFriction) and repair.is_unusual:
        text += ", which is unusual: few surfaces have it"
    return Reason(
        limit.name, next(iter(changes)), unit, given, needed, text, _advice(changes, dict.fromkeys(changes, unit))
    )


def _advice(changes: dict[str, Any], units: dict[str, str]) -> str:
    return " together with ".join(f"{key} = {shown(value, units.get(key, '1'))}" for key, value in changes.items())
