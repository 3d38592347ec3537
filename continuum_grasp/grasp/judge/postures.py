"""Postures of a grasp in which friction has another history, at what its drives hold.

Unknown are moments in the bases, forces and places of contacts, tensions where drives hold cables, and the pose of an
object that fingers alone hold. Known histories make all of them follow but for forces that friction shares. Of these,

    maximize  s   subject to   mu N - |f| >= s of all contacts,  shapes touch the object and are clear of it,  balance,

by a sequence of linear problems in a region of trust (R. Fletcher, E. Sainz de la Maza, 1989,
doi:10.1007/BF01589355), whose slopes are differences of shapes that are integrated together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.findings import FOLLOWED
from continuum_grasp.grasp.judge.held import HeldRods
from continuum_grasp.grasp.judge.posture_parts import (
    FingerPart,
    ObjectPoses,
    PosturePart,
    PostureRows,
    SupportPart,
    dimensions_of,
)
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage

YIELDS = 0.1
"""Distance by which an object that fingers alone hold may move: part of its size, and rad."""
PLENTY = 0.03
"""Spare friction per force scale with which a history is not the worst one: of tensions that are 1 % too low, worst
histories of shipped scenes spare less than none."""
_STEP = 1e-6
"""Step of differences in units of the unknowns [1]: shapes are integrated with the same steps, so that they have
rounding alone."""
_PENALTIES = 1e4, 1e7
"""First and greatest cost of a violation, per cost of the reserve: 1e3 leaves fingers in the object for a while
(`mug_motor`)."""
_TRUST, _LEAST_TRUST = 0.3, 1e-9
"""First and least region of trust, in units of the unknowns."""
_SHARES = np.array([1.0, 0.4, 0.15, 0.05])
"""Shares of a step that are tried at once: integrated together, four shapes take as long as one."""
_CORRECTIONS = 3
"""Most corrections of a step: each leaves a tenth or less."""
_STEPS = 20
"""Most linear problems: 4 to 15 from the posture of a like history."""
_EXACT = 1e-7
"""Sum of violations, and gain of a step, that count as none [1]."""
_FAR = 0.1
"""Rows that are so much more than zero do not limit a step [1]."""


@dataclass(frozen=True, eq=False)
class JudgedPosture:
    """A posture: unknowns, the least spare friction per force scale, and what it leaves violated."""

    x: Array
    reserve: float
    violated: float
    weights: Array  # slope of the reserve by rows that are zero, zero or more, and of friction


class HistoryPostures:
    """Finds postures of a grasp for histories of friction: directions (cells, frictions) of each part."""

    def __init__(self, stage: GraspStage, held: HeldRods, rods: Sequence[SpaceRod]) -> None:
        self._stage, self._held, self.scale = stage, held, stage.scale(held)
        fingers = zip(held.fingers, rods, strict=True)
        self.parts: list[PosturePart] = [FingerPart(stage, held, *pair, self.scale) for pair in fingers]
        self.parts += [SupportPart(stage, held, contact, self.scale) for contact in held.supports]
        # An object on supports stays against them.
        self._moves = [] if held.supports else stage.moves
        self._units = np.array([*[stage.size] * 3, *[1.0] * 3])[self._moves]
        stay = np.zeros(len(self._moves))
        self.start = np.concatenate([*(part.start for part in self.parts), stay])
        self._low = np.concatenate([*(part.low for part in self.parts), stay - YIELDS])
        self._high = np.concatenate([*(part.high for part in self.parts), stay + YIELDS])
        self._ends = np.cumsum([part.start.size for part in self.parts])
        # The plane bears what leaves it, and an upright object what tilts it.
        rows = [0, 1, 5] if dimensions_of(stage) == 2 else [0, 1, 2, 3, 4, 5]
        self._balanced = [k for k in rows if not (stage.upright and k in (3, 4))]
        weight = np.concatenate([stage.mass * stage.gravity / self.scale, np.zeros(3)])
        self._weight = weight[self._balanced]

    # -- rows --------------------------------------------------------------------------------------------------

    def _rows(self, k: int, x: Array, moves: Array, history: Array) -> PostureRows:
        """Rows of a part at n of its unknowns, motions of the object and histories."""
        poses = np.zeros((len(x), 6))
        poses[:, self._moves] = moves * self._units
        return self.parts[k].rows(x, ObjectPoses(self._stage, self._held, poses), history)

    def _linearized(self, x: Array, histories: Sequence[Array]) -> tuple[PostureRows, PostureRows]:
        """Rows (1, ...) of a posture, and their slopes (unknowns, ...)."""
        *own, moves = np.split(x, self._ends)
        rows, slopes = list[PostureRows](), list[PostureRows]()
        for k, (values, history) in enumerate(zip(own, histories, strict=True)):
            count = values.size + moves.size
            changes = np.vstack([np.zeros((1, count)), _STEP * np.eye(count)])
            at = np.concatenate([values, moves]) + changes
            every = np.broadcast_to(history, (count + 1, *history.shape))
            found = self._rows(k, at[:, : values.size], at[:, values.size :], every)
            rows.append(found.first)
            place = np.zeros((count, x.size))
            place[: values.size, self._ends[k] - values.size : self._ends[k]] = np.eye(values.size)
            place[values.size :, self._ends[-1] :] = np.eye(moves.size)
            slopes.append(found.changes(_STEP).spread(place.T))
        return self._joined(rows, self._weight), self._joined(slopes, 0.0 * self._weight)

    def _joined(self, parts: Sequence[PostureRows], weight: Array) -> PostureRows:
        """Rows of all parts, and the balance of the object among those that are zero."""
        wrench = np.sum([part.wrench for part in parts], axis=0)[:, self._balanced] + weight
        zero, positive, friction = (
            np.concatenate([getattr(part, name) for part in parts], axis=1) for name in ("zero", "positive", "friction")
        )
        return PostureRows(np.concatenate([zero, wrench], axis=1), positive, friction, wrench[:, :0])

    def _values(self, x: Array, histories: Sequence[Array]) -> PostureRows:
        """Rows (n, ...) of n postures (n, unknowns)."""
        *own, moves = np.split(x, self._ends, axis=1)
        rows = list[PostureRows]()
        for k, (values, history) in enumerate(zip(own, histories, strict=True)):
            rows.append(self._rows(k, values, moves, np.broadcast_to(history, (len(x), *history.shape))))
        return self._joined(rows, self._weight)

    # -- postures ----------------------------------------------------------------------------------------------

    def found(self, histories: Sequence[Array], start: Array) -> JudgedPosture:
        """The posture with the greatest reserve next to a start; one with `PLENTY` is as good."""
        x, trust, penalty = np.clip(start, self._low, self._high), _TRUST, _PENALTIES[0]
        rows, slopes = self._linearized(x, histories)
        for _ in range(_STEPS):
            cuts, here = rows.cuts, float(rows.merits(penalty)[0])
            within = np.maximum(self._low - x, -trust), np.minimum(self._high - x, trust)
            if rows.violated[0] < _EXACT and rows.reserves[0] > PLENTY:
                break
            step, promised, _ = _linear(rows, slopes, cuts, within, penalty)
            if promised - here < _EXACT or trust < _LEAST_TRUST:
                if rows.violated[0] < FOLLOWED or penalty > _PENALTIES[1]:
                    break
                penalty, trust = 10.0 * penalty, max(trust, 1e-3)
                continue
            steps, after = self._corrected(x, step, histories, (rows.cut(cuts)[0], slopes.cut(cuts)), cuts)
            merits = after.merits(penalty)
            k = int(merits.argmax())
            size = float(np.abs(_SHARES[k] * step).max())
            if merits[k] - here > 0.1 * _SHARES[k] * (promised - here):
                x = x + steps[k]
                rows, slopes = self._linearized(x, histories)
                trust = min((1.0 if k else 2.0) * max(size, 0.0 if k else trust), 1.0)
            else:
                trust = 0.5 * _SHARES[-1] * min(trust, float(np.abs(step).max()))
        within = np.maximum(self._low - x, -_TRUST), np.minimum(self._high - x, _TRUST)
        weights = _linear(rows, slopes, rows.cuts, within, penalty)[2]
        return JudgedPosture(x, float(rows.reserves[0]), float(rows.violated[0]), weights)

    def _corrected(
        self, x: Array, step: Array, histories: Sequence[Array], linear: tuple[Array, Array], cuts: Array
    ) -> tuple[Array, PostureRows]:
        """Shares of a step, with further ones until rows that act are as the linear problem promised, and rows there.

        Second-order corrections: R. Fletcher, "Second order corrections for non-differentiable optimization", 1982.
        """
        steps = _SHARES[:, None] * step
        promised = linear[0] + steps @ linear[1]
        above = promised.copy()
        above[:, -len(cuts) :] -= promised[:, -len(cuts) :].min(axis=1, keepdims=True)
        acts = above < _EXACT
        after = self._values(x + steps, histories)
        acts[:, : after.zero.shape[1]] = True
        towards = [np.linalg.pinv(linear[1].T[own], rcond=1e-9) for own in acts]
        for _ in range(_CORRECTIONS):
            off = after.cut(cuts) - promised
            sizes = np.array([np.abs(row[own]).max() for row, own in zip(off, acts, strict=True)])
            going = np.isfinite(sizes) & (sizes > _EXACT)
            if not going.any():
                break
            back = [
                way @ row[own] if on else 0.0 * x for way, row, own, on in zip(towards, off, acts, going, strict=True)
            ]
            further = np.clip(x + steps - np.array(back), self._low, self._high) - x
            nearer = self._values(x + further, histories)
            left = nearer.cut(cuts) - promised
            less = [np.abs(row[own]).max() < size for row, own, size in zip(left, acts, sizes, strict=True)]
            taken = going & np.array(less)
            if not taken.any():
                break
            steps = np.where(taken[:, None], further, steps)
            after = nearer.where(taken, after)
        return steps, after

    def slopes(self, posture: JudgedPosture, histories: Sequence[Array]) -> Iterator[Array]:
        """Slope of the reserve by the directions of each part (cells, frictions)."""
        *own, moves = np.split(posture.x, self._ends)
        each = enumerate(zip(own, histories, strict=True))
        here = [self._rows(k, values[None], moves[None], history[None]) for k, (values, history) in each]
        first = self._joined(here, self._weight).all
        for k, (values, history) in enumerate(zip(own, histories, strict=True)):
            n = history.size
            inward = np.where(history.ravel() > 0.0, -1e-3, 1e-3)
            every = (history.ravel() + np.diag(inward)).reshape(n, *history.shape)
            others = [rows.spread(np.ones((n, 1))) for rows in here]
            if n:
                others[k] = self._rows(k, np.repeat(values[None], n, axis=0), np.repeat(moves[None], n, axis=0), every)
            changed = self._joined(others, self._weight).all - first
            yield (changed @ posture.weights / inward).reshape(history.shape)


def _linear(
    rows: PostureRows, slopes: PostureRows, cuts: Array, within: tuple[Array, Array], penalty: float
) -> tuple[Array, float, Array]:
    """Step with the greatest merit to first order, that merit, and its slopes by rows and numbers of friction."""
    low, high = within
    near = rows.positive[0] < _FAR
    a, b, c, n = rows.zero.size, int(near.sum()), len(cuts), low.size
    # Unknowns: step, reserve, what is violated of zero rows to both sides and of positive ones.
    cost = np.concatenate([np.zeros(n), [-1.0], np.full(2 * a + b, penalty)])
    zero = np.hstack([slopes.zero.T, np.zeros((a, 1)), np.eye(a), -np.eye(a), np.zeros((a, b))])
    positive = np.hstack([-slopes.positive.T[near], np.zeros((b, 1 + 2 * a)), -np.eye(b)])
    spare = np.hstack([-cuts @ slopes.friction.T, np.ones((c, 1)), np.zeros((c, 2 * a + b))])
    found = linprog(
        cost,
        A_ub=np.vstack([positive, spare]),
        b_ub=np.concatenate([rows.positive[0][near], cuts @ rows.friction[0]]),
        A_eq=zero,
        b_eq=-rows.zero[0],
        bounds=[*zip(low, high, strict=True), (None, None), *[(0.0, None)] * (2 * a + b)],
        method="highs",
    )
    if found.x is None:
        return np.zeros(n), -np.inf, np.zeros(rows.all.size)
    # The merit is the negative cost; rows are on the right-hand side, zero ones with the other sign.
    forces = -found.ineqlin.marginals
    positive_forces = np.zeros(near.size)
    positive_forces[near] = forces[:b]
    weights = np.concatenate([found.eqlin.marginals, positive_forces, forces[b:] @ cuts])
    return found.x[:n], float(-found.fun), weights
