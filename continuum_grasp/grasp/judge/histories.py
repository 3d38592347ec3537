"""Histories of friction that a certificate tries: its own choice, of directions in cells along each finger.

All directions of friction of a finger alike, and turned from half of it on, as a tendon slides that is let out after it
was pulled; of several fingers all combinations of the former. From each, the directions to which the slope of the
reserve points, until none is new: to first order the reserve is concave in the directions, so that it is least where
all are at their bounds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.findings import FOLLOWED, Finding, Requirement
from continuum_grasp.grasp.judge.held import HeldRods
from continuum_grasp.grasp.judge.postures import HistoryPostures, JudgedPosture
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage

_MOST = 40
"""Most histories that are tried: of a finger 4 are there at first, and 2 to 8 join them."""
_HALVINGS = 3
"""Most halvings of the way to a history whose posture is not found from a known one at once."""
_NOTHING = 1e-4
"""Share of the greatest slope below which a direction stays as it is [1]."""
SPARED = 5e-4
"""Share of the greatest force by which friction may be exceeded: rods of 24 stages are clear of the object at their
nodes and half way between, and 3e-6 L elsewhere, which is as much."""

History = Sequence[Array]
"""Directions (cells, frictions) of each finger, and none of each support."""


class HistoryTrials:
    """Postures of a grasp for the histories that are tried."""

    def __init__(self, stage: GraspStage, held: HeldRods, rods: Sequence[SpaceRod]) -> None:
        self.postures = HistoryPostures(stage, held, rods)
        self.tried: list[tuple[History, JudgedPosture]] = []
        # Pulling bends a finger from its shape at rest to one side, all along.
        self._pulled = [1.0 if rod.turn >= 0.0 else -1.0 for rod in rods] + [1.0] * len(held.supports)

    def _alike(self, ways: Sequence[float]) -> History:
        return [np.full(part.history, way) for part, way in zip(self.postures.parts, ways, strict=True)]

    @property
    def chosen(self) -> Iterator[History]:
        """Histories to begin with: as pulled, and others."""
        parts = self.postures.parts
        for signs in product(*((1.0, -1.0) if np.prod(part.history) else (1.0,) for part in parts)):
            yield self._alike([sign * way for sign, way in zip(signs, self._pulled, strict=True)])
        for k, part in enumerate(parts):
            for sign in (1.0, -1.0) if np.prod(part.history) else ():
                turned = list(self._alike(self._pulled))
                turned[k] = sign * turned[k]
                turned[k][part.history[0] // 2 :] *= -1.0
                yield turned

    def run(self) -> None:
        """Try the chosen histories, and those to which slopes point."""
        known = set[bytes]()
        left = list(self.chosen)
        while left and len(self.tried) < _MOST:
            history = left.pop(0)
            key = _row(history).tobytes()
            if key in known:
                continue
            known.add(key)
            posture = self._posture(history)
            self.tried.append((history, posture))
            if _is_one(posture):
                left.insert(0, self._worse(history, posture))

    def _worse(self, history: History, posture: JudgedPosture) -> History:
        """The history to which the slope of the reserve points."""
        slopes = list(self.postures.slopes(posture, history))
        clear = _NOTHING * np.abs(_row(slopes)).max(initial=0.0)
        pairs = zip(slopes, history, strict=True)
        return [np.where(np.abs(slope) > clear, -np.sign(slope), own) for slope, own in pairs]

    def _posture(self, history: History) -> JudgedPosture:
        """The posture for a history, from the one whose history is most alike."""
        known = [(own, posture) for own, posture in self.tried if _is_one(posture)]
        if not known:
            return self.postures.found(history, self.postures.start)
        near, posture = min(known, key=lambda pair: float(np.abs(_row(pair[0]) - _row(history)).sum()))
        return self._led(near, posture, history, _HALVINGS)

    def _led(self, near: History, posture: JudgedPosture, history: History, halvings: int) -> JudgedPosture:
        """The posture for a history, led there from another by histories between them."""
        found = self.postures.found(history, posture.x)
        if (_is_one(found) and found.reserve > -SPARED) or not halvings:
            return found
        middle = [0.5 * (one + other) for one, other in zip(near, history, strict=True)]
        between = self._led(near, posture, middle, halvings - 1)
        if not _is_one(between):
            return found
        led = self._led(middle, between, history, halvings - 1)
        return max(found, led, key=lambda each: each.reserve if _is_one(each) else -np.inf)

    @property
    def worst(self) -> tuple[History, JudgedPosture]:
        """The history with the least reserve, and its posture; one without a posture comes first."""
        return min(self.tried, key=lambda pair: pair[1].reserve if _is_one(pair[1]) else -np.inf)


def history_findings(stage: GraspStage, held: HeldRods, rods: Sequence[SpaceRod]) -> Iterator[Finding]:
    """The finding of friction with other histories, where a scene asks for it."""
    frictions = any(setup.finger.has_friction for setup in stage.scene.setups)
    if stage.scene.friction_states != "any" or not frictions or next(held.contacts, None) is None:
        return
    trials = HistoryTrials(stage, held, rods)
    trials.run()
    _, posture = trials.worst
    scale, reserve = trials.postures.scale, posture.reserve if _is_one(posture) else np.nan
    yield Finding(Requirement.HISTORIES, "", -reserve * scale, SPARED * scale, "N")


def _is_one(posture: JudgedPosture) -> bool:
    """Whether a posture violates nothing."""
    return posture.violated < FOLLOWED


def _row(history: History) -> Array:
    return np.concatenate([np.ravel(part) for part in history])
