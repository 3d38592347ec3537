"""Starts of a hand: postures of its fingers, combined and ranked by the best forces that go with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product, zip_longest

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.body import BodySurface
from continuum_grasp.grasp.hand.forces import HandForces, PostureRows
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.hand.starts import DEPTH, FingerPlane, TouchingPosture, postures
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
    rows: PostureRows


@dataclass(frozen=True)
class HandStart:
    """A posture of each finger."""

    on: frozenset[str]  # names of the contacts
    chosen: tuple[TouchingPosture, ...]
    left: float  # residual that the best forces leave
    pulls: tuple[Array, ...]  # moments (2,) of the tendons of each finger [E I / L]
    forces: Mapping[str, Array]  # (N, f, g) and the moment per arm of each contact by name [N]


class HandStarts:
    """Starts of a scene, of one set of contacts after the other."""

    def __init__(self, scene: HandScene) -> None:
        self.scene = scene
        body, frames = BodySurface(scene), PlaneFrame.each(scene)
        self.planes = [
            FingerPlane(setup, frame, body.distance) for setup, frame in zip(scene.setups, frames, strict=True)
        ]
        self._forces = HandForces(scene)
        self._supports = self._forces.supports

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
        carried = len(self.scene.support_contacts)
        once = [on for on in self.modes if len(on) - carried <= len(self.scene.setups)]
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
        candidates = []
        for plane in self.planes:
            setup = plane.setup
            names = frozenset({setup.middle_names[0], setup.tip_name} & on)
            middle, tip = setup.middle_names[0] in on, setup.tip_name in on
            found = postures(plane, middle, tip, POSTURES[effort], self._clears_supports(plane))
            rows = (self._forces.finger(plane, posture, names) for posture in found)
            candidates.append([PostureCandidate(names, *pair) for pair in zip(found, rows, strict=True)])
        return candidates

    def _clears_supports(self, plane: FingerPlane) -> Callable[[TouchingPosture], bool]:
        """Whether postures of a finger stay above palm and table, near whose base it may come out of them."""
        at = np.linspace(0.05, 1.0, 20)
        half, axis = plane.length * float(plane.half(0.0)), plane.frame.axes[:, 1]

        def clears(posture: TouchingPosture) -> bool:
            if not self.scene.supports:
                return True
            points = np.array([plane.place(posture, s) for s in at])
            away = np.linalg.norm(points - plane.frame.base, axis=1)
            for support in self.scene.supports:
                needed = support.clear_from(tuple(plane.frame.base), tuple(axis), half)
                heights = (points - np.array(support.point)) @ np.array(support.normal) - plane.length * plane.half(at)
                if (heights[away >= needed] < -DEPTH * plane.length).any():
                    return False
            return True

        return clears

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
            rows = (*(one.rows for one in chosen), self._supports)
            left, x = self._forces.best(rows)
            pulls, forces = self._forces.named(rows, x)
            starts.append(HandStart(on | carried, tuple(one.posture for one in chosen), left, tuple(pulls), forces))
        return sorted(starts, key=lambda start: start.left)


def _likeliest(each: Sequence[Sequence[PostureCandidate]]) -> list[tuple[PostureCandidate, ...]]:
    """Combinations of a posture of each finger, least scores first."""
    combined = sorted(product(*each), key=lambda chosen: sum(one.posture.score for one in chosen))
    return combined[:COMBINED]
