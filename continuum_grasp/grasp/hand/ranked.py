"""Starts of a hand: postures of its fingers, combined and ranked by the best forces that go with them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product, zip_longest

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.numbers import ForceRows
from continuum_grasp.grasp.hand.points import HandPoints
from continuum_grasp.grasp.hand.problem import HandSpec, hand_problem
from continuum_grasp.grasp.hand.starts import STRAIGHT, TouchingPosture
from continuum_grasp.scene import HandScene

POSTURES = {"quick": 2, "normal": 4, "thorough": 8}
"""Postures of each finger that are combined, by effort."""
COMBINED = 64
"""Most combinations whose forces are looked at."""
MIXED = 2
"""Postures of each finger and kind of contact where kinds are mixed."""


@dataclass(frozen=True)
class PostureCandidate:
    """A posture of one finger."""

    on: frozenset[str]  # names of its contacts
    posture: TouchingPosture
    rows: ForceRows  # of a hand whose other fingers are anyhow


@dataclass(frozen=True)
class HandStart:
    """A posture of each finger."""

    on: frozenset[str]  # names of the contacts
    chosen: tuple[TouchingPosture, ...]
    left: float  # residual that the best forces leave


class HandStarts:
    """Starts of a scene, of one set of contacts after the other."""

    def __init__(self, scene: HandScene) -> None:
        self.scene = scene
        self.points = HandPoints(scene)
        # Fingers that touch the object in no posture, by set of contacts.
        self.untouched = dict[frozenset[str], list[str]]()

    @property
    def modes(self) -> list[frozenset[str]]:
        """Sets of contacts that the scene leaves to choose: the same kinds for all fingers, where they are free."""
        sets = dict[frozenset[str], None]()
        carried = {contact.name for contact in self.scene.support_contacts}
        for middle, tip in ((True, False), (False, True), (True, True)):
            on = set[str]()
            for setup in self.scene.setups:
                (one,) = setup.middles
                on |= {setup.middle_names[0]} if one == "on" or (middle and one == "auto") else set()
                on |= {setup.tip_name} if setup.tip == "on" or (tip and setup.tip == "auto") else set()
            if on and all({s.middle_names[0], s.tip_name} & on for s in self.scene.setups):
                sets[frozenset(on | carried)] = None
        return list(sets)

    @property
    def once_and_twice(self) -> tuple[list[frozenset[str]], list[frozenset[str]]]:
        """Sets of contacts with one contact of each finger, and those with more.

        Fingers that touch with both of their contacts rarely hold with less, and take twice the equations.
        """
        once = [on for on in self.modes if len(HandSpec.of(self.scene, on).contacts) <= len(self.scene.setups)]
        return once, [on for on in self.modes if on not in once]

    def in_turn(self, modes: Sequence[frozenset[str]]) -> Iterator[HandStart]:
        """The likeliest start of each set of contacts and of mixed ones, then the next of each."""
        touching = [self.candidates(on, "normal") for on in modes]
        sets = [self.ranked([each]) for each in touching]
        if len(touching) > 1:
            sets.append(self.ranked(touching))
        for starts in zip_longest(*sets):
            likely = (start for start in starts if start is not None and np.isfinite(start.left))
            yield from sorted(likely, key=lambda start: start.left)

    def candidates(self, on: frozenset[str], effort: str) -> list[list[PostureCandidate]]:
        """Postures of each finger with contacts of a set; none for a finger that touches in no posture."""
        most = POSTURES[effort]
        each = [self.points.postures(plane, on, most) for plane in self.points.planes]
        untouched = [setup.name for setup, found in zip(self.scene.setups, each, strict=True) if not found]
        if untouched:
            self.untouched[on] = untouched
        problem = hand_problem(HandSpec.of(self.scene, on))
        candidates = [list[PostureCandidate]() for _ in each]
        for n in range(max(map(len, each))):
            chosen = tuple(found[min(n, len(found) - 1)] if found else STRAIGHT for found in each)
            rows = ForceRows.of(self.scene, problem, *self.points.at(problem, chosen))
            for setup, found, own in zip(self.scene.setups, each, candidates, strict=True):
                names = frozenset({setup.middle_names[0], setup.tip_name} & on)
                own += [PostureCandidate(names, found[n], rows)] if n < len(found) else []
        return candidates

    def ranked(self, sets: Sequence[Sequence[Sequence[PostureCandidate]]]) -> list[HandStart]:
        """Combinations of the candidates of each finger, by the remainder of their best forces: of one
        set of contacts, or of several sets, not all from the same; none where a finger has no posture.
        """
        fingers = range(len(self.scene.setups))
        most = MIXED if len(sets) > 1 else None
        each = [[one for candidates in sets for one in candidates[k][:most]] for k in fingers]
        alike = [frozenset().union(*(own[0].on for own in candidates if own)) for candidates in sets]
        carried = frozenset(contact.name for contact in self.scene.support_contacts)
        starts = list[HandStart]()
        for chosen in _likeliest(each):
            on = frozenset[str]().union(*(one.on for one in chosen))
            if len(sets) > 1 and on in alike:
                continue
            left, _ = ForceRows.combined([one.rows for one in chosen]).best(self.scene)
            starts.append(HandStart(on | carried, tuple(one.posture for one in chosen), left))
        return sorted(starts, key=lambda start: start.left)

    def forces(self, start: HandStart) -> tuple[dict[str, Array], dict[str, Array]]:
        """Pulls (2,) by finger, per E I / L of it, and forces (N, f, g) [N] with the moment per arm [N] by contact."""
        problem = hand_problem(HandSpec.of(self.scene, start.on))
        x, p = self.points.at(problem, start.chosen)
        rows = ForceRows.of(self.scene, problem, x, p)
        _, x[rows.columns] = rows.best(self.scene)
        unit, at = self.points.units.force, problem.x.at
        pulls = {setup.name: x[at[f"{setup.name}.pulls"]] for setup in self.scene.setups}
        forces = {}
        for name in start.on:
            twist = x[at[f"torsion, {name}"]] if f"torsion, {name}" in at else np.zeros(1)
            forces[name] = unit * np.concatenate([x[at[f"force, {name}"]], twist])
        return pulls, forces


def _likeliest(each: Sequence[Sequence[PostureCandidate]]) -> list[tuple[PostureCandidate, ...]]:
    """Combinations of a posture of each finger, least scores first."""
    combined = sorted(product(*each), key=lambda chosen: sum(one.posture.score for one in chosen))
    return combined[:COMBINED]
