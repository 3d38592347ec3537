"""Postures in which contacts press as a goal asks, and to which inputs lead."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from continuum_grasp.addons.planning.fine import simulated
from continuum_grasp.addons.planning.goal import PRESSES, GoalPart
from continuum_grasp.addons.planning.guess import Path, Posture
from continuum_grasp.addons.planning.motion import PlannedMotion
from continuum_grasp.base import Array, NumericalError

_RAMP, _RAMP_NODES = 16.0, 80
"""Natural times of the finger in which a scan raises inputs to their limits, slowly enough for the finger to follow at
rest, and instants at which it looks [1]."""


@dataclass
class PressingPostures:
    """Search from a state x0 (nx), of the ``first`` posture, for one that presses.

    ``can_press``: a motion under slow inputs presses at all contacts that are to press.
    """

    motion: PlannedMotion
    x0: Array
    first: Posture
    can_press: bool = False

    def nearest(self, postures: list[Posture], part: GoalPart, direct: Path) -> Posture:
        """The first posture, if inputs that go there, by a ``direct`` path, press as a part of the goal asks; else the
        nearest one to the forces along the way of the finger while inputs rise to their limits.

        Least squares may end on the far side of the object, or short of balance; a plan that begins where nothing
        touches stays there, since forces have no slopes.
        """
        aim = np.array(self.motion.scene.goal.targets["contact_force"])
        ends = list[tuple[int, float, float, int, Posture]]()
        for path in (direct, *self.ramps(postures)):
            with suppress(NumericalError):
                states = simulated(self.motion.scene, self.motion.prediction, path, self.x0, 1)
                chosen = slice(-1, None) if not ends else slice(1, None)
                ends += self._presses(states[chosen], path.u[chosen], aim, len(ends))
                if len(ends) == 1 and ends[0][2] <= float(np.max(part.tolerance * part.scale)):
                    break
        if not ends:
            return postures[0]
        loose, *_, nearest = min(ends)
        self.can_press = not loose
        return nearest

    def ramps(self, postures: list[Posture]) -> Iterator[Path]:
        """Inputs that rise to their limits, each alone and towards postures, without states."""
        u = self.first.u
        low, high = (np.array(limit) for limit in self.motion.scene.input_limits)
        alone = [np.diag(limit - u) for limit in (high, low)]
        ways = np.vstack([*alone, *(posture.u - u for posture in postures)])
        rise = np.linspace(0.0, 1.0, _RAMP_NODES + 1)[:, None]
        taken = list[Array]()
        for way in ways:
            if not way.any():
                continue
            left = np.where(way > 0.0, high - u, u - low)[way != 0.0]
            end = u + way * (left / np.abs(way[way != 0.0])).min()
            # 0.01: share of the input's range within which two ways are one
            if any(np.abs(end - other).max() <= 0.01 * np.abs(high - low).max() for other in (u, *taken)):
                continue
            taken.append(end)
            time = _RAMP * self.motion.scene.finger.rod.natural_time
            yield Path(np.zeros((_RAMP_NODES + 1, 0)), u + rise * (end - u), time)

    def _presses(self, x: Array, u: Array, aim: Array, first: int) -> list[tuple[int, float, float, int, Posture]]:
        """States (count, nx) under inputs (count, nu) by how well they press: contacts that do not though they are to,
        their gaps [m], distance from the forces [N], and a number from ``first`` on; with the posture of each.
        """
        model = self.motion.prediction
        count = len(x)
        p = np.tile(self.motion.numbers([1.0])[:, : model.np], (count, 1))
        force, gap = (np.array(f.map(count)(x.T, u.T, p.T)).T for f in (model.contact_force, model.gap))
        loose = force < PRESSES * aim
        apart = (np.maximum(gap, 0.0) * loose).sum(axis=1).tolist()
        off = np.linalg.norm(force - aim, axis=1).tolist()
        ends = zip(loose.sum(axis=1).tolist(), apart, off, range(first, first + count), strict=True)
        return [(*end, Posture(q, last)) for end, q, last in zip(ends, x[:, : model.system.n], u, strict=True)]
