"""Histories of friction that a certificate tries: its own choice, in cells of its own.

All directions of friction of a finger alike, and turned from a place on, as a tendon slides that is let out after it
was pulled; of several fingers all combinations of the former. From each, the directions to which the slope of the
reserve points, until none is new: to first order the reserve is concave in the directions, so that it is least where
all are at their bounds.

No certificate asks for this check yet: postures that press a finger into the object beside a contact end at 2e-5,
twice of what passes, and a history that has no posture is no answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.check import FOLLOWED, Check, Requirement
from continuum_grasp.grasp.judge.held import HeldRods
from continuum_grasp.grasp.judge.postures import HistoryPostures, JudgedPosture
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage
from continuum_grasp.scene import FingerSetup

CELLS = 6
"""Cells of a part of a finger between base, contacts and tip in which friction has one direction each."""
_FRONTS = 3
"""Places along a finger from which on directions turn."""
_MOST = 24
"""Most histories that are tried: of a finger 8 are there at first, and 2 to 6 join them."""
_STARTS = 3
"""Postures from which one for another history is sought: those whose histories are most alike."""
SPARED = 5e-3
"""Share of the greatest force by which friction may be exceeded: 24 stages differ by as much from the cells here."""


def frictions_of(setup: FingerSetup) -> int:
    """Count of the frictions of a finger: of its tendons, and branches of dry friction in bending."""
    return (setup.tendons.friction > 0.0) + len(setup.finger.damping.dry_friction)


class HistoryTrials:
    """Postures of a grasp for the histories that are tried."""

    def __init__(self, stage: GraspStage, held: HeldRods, rods: list[SpaceRod]) -> None:
        self.postures = HistoryPostures(stage, held, rods)
        self._frictions = [frictions_of(stage.setups[finger.name]) for finger in held.fingers]
        self._cells = [
            CELLS * (1 + sum(contact.place < setup.finger.rod.length for contact in finger.contacts))
            for setup, finger in zip((stage.setups[finger.name] for finger in held.fingers), held.fingers, strict=True)
        ]
        self.tried: list[tuple[list[Array], JudgedPosture]] = []

    @property
    def chosen(self) -> Iterator[list[Array]]:
        """Histories (cells, frictions) of all fingers, the more alike next to each other."""
        sizes = list(zip(self._cells, self._frictions, strict=True))
        signs = [(1.0, -1.0) if count else (0.0,) for count in self._frictions]
        for each in product(*signs):
            yield [np.full(size, sign) for size, sign in zip(sizes, each, strict=True)]
        for k, (cells, count) in enumerate(sizes):
            for sign, front in product((1.0, -1.0), range(1, _FRONTS + 1)) if count else ():
                turned = [np.ones(size) for size in sizes]
                turned[k] *= sign
                turned[k][front * cells // (_FRONTS + 1) :] *= -1.0
                yield turned

    def run(self) -> None:
        """Try the chosen histories, and those to which slopes point."""
        known = set[bytes]()
        left = list(self.chosen)
        while left and len(self.tried) < _MOST:
            histories = left.pop(0)
            key = np.concatenate([history.ravel() for history in histories]).tobytes()
            if key in known:
                continue
            known.add(key)
            posture = self._posture(histories)
            self.tried.append((histories, posture))
            if posture.violated < FOLLOWED and np.any(posture.slopes):
                slopes = self.postures.slopes(posture, histories)
                pairs = zip(slopes, histories, strict=True)
                left.append([np.where(slope == 0.0, own, -np.sign(slope)) for slope, own in pairs])

    def _posture(self, histories: list[Array]) -> JudgedPosture:
        """The posture for histories, from the postures whose histories are most alike."""
        off = [
            sum(float(np.abs(one - other).sum()) for one, other in zip(histories, tried, strict=True))
            for tried, _ in self.tried
        ]
        order = np.argsort(off, kind="stable").tolist()
        known = [self.tried[k][1].x for k in order if self.tried[k][1].violated < FOLLOWED]
        found = list[JudgedPosture]()
        for start in [self.postures.start, *known[: _STARTS - 1]]:
            found.append(self.postures.found(histories, start))
            if found[-1].violated < FOLLOWED and found[-1].reserve > -FOLLOWED:
                break
        holding = [posture for posture in found if posture.violated < FOLLOWED]
        return max(holding, key=lambda posture: posture.reserve) if holding else found[-1]

    @property
    def least(self) -> float:
        """Least reserve per force scale; NaN where a history has no posture that is known."""
        if any(not posture.violated < FOLLOWED for _, posture in self.tried):
            return np.nan
        return min((posture.reserve for _, posture in self.tried), default=np.inf)


def history_checks(stage: GraspStage, held: HeldRods, rods: list[SpaceRod]) -> Iterator[Check]:
    """The check of friction with other histories, where a scene asks for it."""
    if stage.scene.friction_states != "any" or not any(map(frictions_of, stage.setups.values())):
        return
    trials = HistoryTrials(stage, held, rods)
    trials.run()
    scale = trials.postures.scale
    yield Check(Requirement.HISTORIES, "", -trials.least * scale, SPARED * scale, "N")
