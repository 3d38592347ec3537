"""The search of hands: postures of fingers that touch, combined by the forces that hold the object, are the starts."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.hand.ranked import HandStart, HandStarts
from continuum_grasp.grasp.rods.answers import AskedAnswers
from continuum_grasp.grasp.rods.guess import PosedFinger
from continuum_grasp.grasp.rods.hand_numbers import hand_numbers, hand_table
from continuum_grasp.grasp.rods.numbers import FingerNumbers, SceneNumbers
from continuum_grasp.grasp.rods.solving import RodStart, StartedSearch
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import HandScene

STAGES = 12
"""Stages of a finger; of 15 hands 12 stages change the tension by at most 2e-5, and an iteration takes 60 % of the time
that it takes with 24. The grasp that is returned has four times as many (`Geometry.finer`)."""


class PostureStart(RodStart):
    """A posture of each finger, with the forces that leave least of the equilibria and the balance."""

    def __init__(self, search: HandRodSearch, start: HandStart) -> None:
        self._search, self._start, self.on = search, start, start.on
        self.imbalance = self.aim = start.left

    @cached_property
    def places(self) -> Array:
        """Places of the contacts [m]."""
        touched = [
            plane.place(posture, at)
            for plane, posture in zip(self._search.found.planes, self._start.chosen, strict=True)
            for name, at in ((plane.setup.middle_names[0], posture.joint), (plane.setup.tip_name, 1.0))
            if name in self.on
        ]
        return np.array(touched)

    def changed(self, scene: HandScene) -> PostureStart:
        """The start in a scene with other limits, or other places of its bases."""
        search = copy(self._search)
        search.scene, search._numbers = scene, {}
        return PostureStart(search, self._start)

    @property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return self._search.numbers_of(self.on)

    @cached_property
    def guesses(self) -> list[PosedFinger]:
        """Postures of the fingers."""
        one = self._start
        guesses = []
        for plane, posture, finger, pulls in zip(
            self._search.found.planes, one.chosen, self.numbers.fingers, one.pulls, strict=True
        ):
            held = {name: one.forces[name] / finger.force for name in finger.contacts}
            joints = (posture.joint,) * len(finger.middles)
            guesses.append(PosedFinger(*plane.knots(posture), joints, self._pulls(finger, pulls), held))
        return guesses

    @staticmethod
    def _pulls(finger: FingerNumbers, moments: Array) -> Array:
        """Pulls above the least ones, by moments of the left and the right tendon per E I / L of the finger."""
        unit = finger.setup.stiffness / finger.section.stiffness
        pairs = ((moments[0] if pull.side > 0.0 else moments[1], pull.least) for pull in finger.section.pulls)
        return np.array([unit * moment - least for moment, least in pairs])

    @property
    def supports(self) -> Mapping[str, Array]:
        """Forces of supports by name [F0]."""
        forces, force = self._start.forces, self.numbers.force
        return {support.name: forces[support.name] / force for support in self.numbers.supports}


class HandRodSearch(StartedSearch):
    """Finds grasps of a hand as exact rods."""

    iterations = 60
    """Most iterations of a solve: the best grasps of 13 shipped hands take 6 to 29, and no start that takes 48 or more
    leads to the best one."""
    likely = 0.5
    """Residual of a start, in units of the problem of its forces: of 30 random hands, starts that led to a grasp leave
    0.002 to 0.20, and 14 with 0.5 to 3.2 led to none."""

    def __init__(self, scene: HandScene, budget: Budget, stages: int = STAGES) -> None:
        super().__init__(budget, stages)
        self.scene = scene
        self.found = HandStarts(scene)
        self.apart = 0.25 * scene.object.size
        self._numbers = dict[frozenset[str], SceneNumbers]()

    def again(self, scene: HandScene) -> HandRodSearch:
        """A search of a changed scene."""
        return HandRodSearch(scene, self.budget, self.stages)

    def numbers_of(self, on: frozenset[str]) -> SceneNumbers:
        """The scene in plain numbers, with a set of contacts."""
        if on not in self._numbers:
            self._numbers[on] = hand_numbers(self.scene, on, self.table)
        return self._numbers[on]

    @property
    def asked(self) -> AskedAnswers | None:
        """Push that the scene asks for; None where it asks for none."""
        push = self.scene.contacts.push
        return AskedAnswers(push) if push else None

    @cached_property
    def table(self) -> DistanceTable:
        """Distances of the object."""
        return hand_table(self.scene)

    @cached_property
    def starts(self) -> list[RodStart]:
        """Starts with one contact of each finger: the likeliest of each set, mixed ones among them, then the next."""
        return [PostureStart(self, start) for start in self.found.in_turn(self.found.once_and_twice[0])]

    @cached_property
    def further(self) -> list[RodStart]:
        """Starts with both contacts of fingers."""
        return [PostureStart(self, start) for start in self.found.in_turn(self.found.once_and_twice[1])]
