"""Starts of a plan whose tendons have friction: they slide one way, up to rest, so that friction is given."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from continuum_grasp.addons.planning.fine import simulated
from continuum_grasp.addons.planning.guess import Path, Posture, smooth_path
from continuum_grasp.addons.planning.problem import OneWay, PlanProblem
from continuum_grasp.base import Array, NumericalError
from continuum_grasp.nlp import Attempt

_TURNED, _TURNED_BY = 0.9, 0.8
"""Friction state from which on friction counts as turned around [1], and the latest node, per the number of intervals:
the finger needs the rest of the motion to come to rest."""
_MOST_TURNING = 60
"""Most iterations from a motion in which friction turns around [1]: the plans of twenty random cases took up to 33."""
_PACE = 0.85
"""Share of the sliding of the smooth motion that tendons keep up at first [1]. A cheap plan waits and lets friction
turn around late, where slopes of given friction are wrong: with 0.6, one of three releases was not solved."""
_SLIDES = 5.0
"""Sliding per presliding between first and last posture from which on tendons slide one way [1]; below, they may stick
all along."""


@dataclass(frozen=True)
class Trial:
    """A problem to solve from unknowns w, in ``most`` iterations; None: as many as any."""

    name: str
    problem: PlanProblem
    w: Array
    most: int | None = None
    is_plan: bool = True
    """Whether a solution is a plan; else it is a start alone."""


_Trials: TypeAlias = Generator[Trial, Attempt, bool]
"""Trials, each of which is answered by its attempt; whether one gave a plan."""


class SlidingStarts:
    """Starts from a state x0 (nx) and the ``first`` posture to the ``last`` one.

    ``usual`` is the problem in which tendons slide to and fro, ``feasible`` the violation up to which an attempt gives
    a plan.
    """

    def __init__(self, usual: PlanProblem, x0: Array, first: Posture, last: Posture, feasible: float) -> None:
        self.usual = usual
        self.motion = usual.motion
        self.x0 = x0
        self.first = first
        self.last = last
        self.feasible = feasible

    def trials(self, warm: Array | None) -> _Trials:
        """Trials one after the other, from unknowns ``warm`` of an earlier plan where there is one.

        Friction of tendons that slide one way is given: the problem is smooth. Its solution is the start where friction
        has its states.
        """
        motion = self.motion
        begin = motion.slid(self.first.q, self.first.u)
        change = motion.slid(self.last.q, self.last.u) - begin
        count = len(motion.tendon_friction)
        ways = np.where(np.abs(change) > _SLIDES, np.sign(change), 0.0)
        if not ways.any():
            return False
        now = self.x0[motion.friction_states]
        # Of a straight finger friction of tendons is none, whatever its states; motors turn theirs around soon.
        bent = motion.scene.finger.profile.rest_curvature.constant != 0.0 or np.abs(begin[:count]) > _SLIDES
        turns = bent & (ways * now < _TURNED)[:count]
        if (turns & (ways != 0.0)[:count]).any() or (ways * now < -_TURNED)[count:].any():
            return (yield from self._turning(change, warm))
        one_way = OneWay(ways, float(np.abs(change).max()) / motion.first_duration)
        w = self.usual.start(smooth_path(motion, self.x0, self.first, self.last)) if warm is None else warm
        given = self._problem(replace(one_way, given=True))
        smooth = yield Trial("friction one way", given, w, is_plan=False)
        if smooth.violation > self.feasible:
            return False
        attempt = yield Trial("sliding one way", self._problem(one_way), smooth.x)
        return attempt.violation <= self.feasible

    def _problem(self, one_way: OneWay) -> PlanProblem:
        return PlanProblem(self.motion, self.x0, one_way=one_way)

    def _turning(self, change: Array, warm: Array | None) -> _Trials:
        """Start from smooth motions in which friction turns around early; then tendons slide one way, up to rest.

        ``change`` is the sliding of tendons per presliding from the first to the last posture.
        """
        time = self.motion.first_duration
        intervals = self.motion.scene.intervals
        speed = float(np.abs(change).max()) / time
        if warm is not None and (yield from self._sliding_on("warm", self.usual.path(warm), speed)):
            return True
        path = smooth_path(self.motion, self.x0, self.first, self.last)
        tau = np.linspace(0.0, 1.0, intervals + 1)[:, None]
        rate = 30.0 * tau**2 * (1.0 - tau) ** 2 / time * change
        rate[int(_TURNED_BY * intervals) :] = 0.0  # while it comes to rest
        return (yield from self._sliding_on("sliding one way", path, speed, rate))

    def _sliding_on(self, name: str, path: Path, speed: float, rate: Array | None = None) -> _Trials:
        """Start from the motion under the inputs of a path, if its tendons end sliding one way.

        With ``rate`` (N + 1, states), their usual sliding per presliding [1/s], they keep up with it first: friction is
        sliding friction, on which inputs have no effect. From there on they only do not slide back.
        """
        motion = self.motion
        try:
            path = replace(path, x=simulated(motion.scene, motion.prediction, path, self.x0, 1))
        except NumericalError:
            return False
        friction = path.x[:, motion.friction_states]
        sliding = np.vstack([np.zeros(friction.shape[1], dtype=bool), friction * np.sign(friction[-1]) >= _TURNED])
        # Nodes since which tendons slide as they do at the end.
        since = np.asarray(len(path.x) - np.argmin(sliding[::-1], axis=0), dtype=np.int64)
        if since.max() > _TURNED_BY * motion.scene.intervals:
            return False
        one_way = OneWay(np.sign(friction[-1]), speed, since=since)
        w = self.usual.start(path)
        if rate is not None:
            least = np.maximum(_PACE * one_way.ways * rate, 0.0)
            keeping_up = self._problem(replace(one_way, least=least))
            w = (yield Trial(f"{name}, at least as fast", keeping_up, w, _MOST_TURNING)).x
        attempt = yield Trial(name, self._problem(one_way), w, _MOST_TURNING)
        return attempt.violation <= self.feasible
