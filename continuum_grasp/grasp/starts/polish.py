"""Fingers that touch with their tips alone: their shapes changed until the forces that bend them balance the object.

One contact leaves no choice of forces: shapes fix them. So for a set of fingers the imbalance is a smooth function of
their curvatures along the curves whose tips touch, and a few Gauss-Newton steps bring it down, for many sets at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.candidates import Candidates
from continuum_grasp.grasp.starts.force import Loads, finger_block
from continuum_grasp.grasp.starts.scan.curves import touch
from continuum_grasp.grasp.starts.scan.task import FingerTask, make_task, violation
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects.body import Pose

Array = NDArray[Any]

_STEPS, _STEP, _MOST, _DAMPING = 5, 1e-4, 0.8, 1e-3
"""Gauss-Newton steps; difference for their slopes [1/L], whose error of 1e-4 is far below the imbalance sought;
greatest change of a curvature in one step [1/L]; damping of the normal equations, which may be singular."""
_ENOUGH = 1e-3
"""Relative imbalance that is balance: IPOPT needs a start, no solution."""


def polished(
    scene: GraspScene, loads: Loads, setups: tuple[FingerSetup, ...], some: list[Candidates], pose: Pose
) -> list[Candidates] | None:
    """Sets of postures nearer to balance at a world pose of the object [m, rad]: of each finger K postures, the k-th of
    which belong together. None where these fingers are not of the kind that can be.
    """
    fingers = []
    for setup, mine in zip(setups, some, strict=True):
        same = (mine.bases == mine.bases[0]).all() and (mine.knots == mine.knots[0]).all()
        if not same or mine.stations.shape[1] != 1 or not np.all(np.diff(mine.knots[0]) > 0.0):
            return None
        x, y, angle = mine.bases[0].tolist()
        task = make_task(scene, setup, (x, y, angle), pose, 1, (setup.tip_name,))
        fingers.append(_Finger(scene, loads, setup, task, pose, mine))
    bent = [f.start.curvatures.copy() for f in fingers]
    best = [b.copy() for b in bent]
    least = np.full(len(bent[0]), np.inf)
    for step in range(_STEPS + 1):
        looks = [f.look(b, slopes=step < _STEPS) for f, b in zip(fingers, bent, strict=True)]
        bent = [look.curvatures for look in looks]
        off = sum(look.sums[:, 0] for look in looks) - np.append(loads.target[:3], loads.lift / loads.force)
        slack = off[:, 3] >= 0.0  # friction to spare is no imbalance
        off[slack, 3] = 0.0
        rest = np.concatenate([off, *(look.own[:, 0] for look in looks)], axis=1)
        size = np.sqrt((rest**2).sum(axis=1))
        better = size < least
        least = np.where(better, size, least)
        for k, b in enumerate(bent):
            best[k][better] = b[better]
        if step == _STEPS or least.max() < _ENOUGH:
            break
        slope = _slopes(looks, slack)
        square = np.einsum("kri,krj->kij", slope, slope) + _DAMPING * np.eye(slope.shape[2])
        change = -np.linalg.solve(square, np.einsum("kri,kr->ki", slope, rest)[..., None])[..., 0]
        change *= np.minimum(1.0, _MOST / np.maximum(np.abs(change).max(axis=1), 1e-300))[:, None]
        ends = np.cumsum([b.shape[1] for b in bent])[:-1]
        bent = [b + part for b, part in zip(bent, np.split(change, ends, axis=1), strict=True)]
    return [f.candidates(b, np.arange(len(b)), judged=True) for f, b in zip(fingers, best, strict=True)]


@dataclass(frozen=True)
class _Look:
    """Balance at a posture and, behind it, with each of its n curvatures changed a little."""

    curvatures: Array  # (K, n)
    sums: Array  # (K, 1 + n, 4) force and moment on the object and friction left for its weight, scaled
    own: Array  # (K, 1 + n, R) what should vanish for the finger alone


def _slopes(looks: list[_Look], slack: Array) -> Array:
    """Jacobian (K, 4 + sum R, sum n): what is common to all fingers above what is each one's own."""
    heights, widths = [look.own.shape[2] for look in looks], [look.curvatures.shape[1] for look in looks]
    out = np.zeros((len(slack), 4 + sum(heights), sum(widths)))
    row, column = 4, 0
    for look, height, width in zip(looks, heights, widths, strict=True):
        for first, part in ((0, look.sums), (row, look.own)):
            slope = np.swapaxes(part[:, 1:] - part[:, :1], 1, 2) / _STEP
            out[:, first : first + slope.shape[1], column : column + width] = slope
        row, column = row + height, column + width
    out[slack, 3] = 0.0
    return out


class _Finger:
    """One finger of the sets."""

    def __init__(
        self, scene: GraspScene, loads: Loads, setup: FingerSetup, task: FingerTask, pose: Pose, start: Candidates
    ) -> None:
        self.scene, self.loads, self.setup, self.task, self.pose, self.start = scene, loads, setup, task, pose, start
        self._walk = np.zeros(len(start))
        for part, shape in enumerate(task.shapes):
            mine = start.parts[:, 0] == part
            at = task.frame.point(start.points[mine, 0])
            self._walk[mine] = shape.nearest(at + task.half * np.exp(1j * task.frame.angle(start.angles[mine, 0])))[1]

    def look(self, bent: Array, slopes: bool) -> _Look:
        """Balance at curvatures (K, n), changed so that the tips touch, and with small changes for its slopes."""
        count, size = bent.shape
        moves = np.concatenate([np.zeros((1, size)), _STEP * np.eye(size)]) if slopes else np.zeros((1, size))
        every, copies = bent[:, None, :] + moves, len(moves)
        found = self.candidates(every.reshape(-1, size), np.repeat(np.arange(count), copies))
        sums, own = (part.reshape(count, copies, -1) for part in self._balance(found))
        return _Look(found.curvatures[::copies], sums, own)

    def candidates(self, bent: Array, rows: Array, judged: bool = False) -> Candidates:
        """The postures at curvatures (K, n), next to some of the first ones, all changed so that the tips touch."""
        task, some = self.task, self.start.take(rows)
        bent, good = bent.copy(), np.zeros(len(bent), bool)
        points, angles = np.zeros(len(rows), complex), np.zeros(len(rows))
        for part, shape in enumerate(task.shapes):
            mine = np.flatnonzero(some.parts[:, 0] == part)
            if len(mine):
                start, walk = (np.zeros(len(mine), complex), np.zeros(len(mine))), self._walk[rows[mine]]
                lengths = np.diff(some.knots[mine], axis=1)
                new, there, found = touch(shape, start, lengths, bent[mine], tuple(range(bent.shape[1])), walk)
                # Where the tip does not get there, the posture stays as it is.
                bent[mine[found]], walk[found], good[mine] = new[found], there[found], found
                at = shape.walk(walk)
                points[mine], angles[mine] = at.point, at.angle
        wrong = some.violation
        if judged:
            wrong = violation(task, some.knots, bent, some.joints) + np.where(good, 0.0, 1.0)
        surface = task.frame.back(points - task.half * np.exp(1j * angles))
        normals = task.frame.angle_back(angles)[:, None]
        return replace(some, curvatures=bent, points=surface[:, None], angles=normals, violation=wrong)

    def _balance(self, found: Candidates) -> tuple[Array, Array]:
        """What the shape's own forces do to the object (P, 4), and what should vanish for the finger alone (P, R)."""
        block = finger_block(self.scene, self.loads, self.setup, found, self.pose)
        # Both edges of the cone, and the left tendon, negative for the right: three forces, least squares.
        columns = [0, self.loads.edges - 1, -2]
        moments, onto = block.moments[:, :, columns], block.onto[:, :3, columns]
        square = np.einsum("pri,prj->pij", moments, moments)
        # Normal equations scaled to a unit diagonal, 1e-9 on it where the forces are not unique.
        span = np.sqrt(np.maximum(np.einsum("pii->pi", square), 1e-300))
        square = square / (span[:, :, None] * span[:, None, :]) + 1e-9 * np.eye(3)
        right = np.einsum("pri,pr->pi", moments, block.needed) / span
        forces = np.linalg.solve(square, right[..., None])[..., 0] / span
        left = (moments @ forces[..., None])[..., 0] - block.needed
        unit = self.loads.force
        outside = np.minimum(forces[:, :2], 0.0) / unit
        low, high = -block.high[-1], block.high[-2]
        over = np.maximum(forces[:, 2] - high, 0.0) + np.minimum(forces[:, 2] - low, 0.0)
        # Between edges with forces a and b, N = a + b and f = mu (a - b): the rest of the cone is 2 mu sqrt(a b) high.
        lifted = 2.0 * self.setup.friction * np.sqrt(np.maximum(forces[:, 0] * forces[:, 1], 1e-12 * unit**2)) / unit
        sums = np.concatenate([(onto @ forces[..., None])[..., 0] / unit, lifted[:, None]], axis=1)
        return sums, np.concatenate([left, outside, (over / max(high, -low, 1e-300))[:, None]], axis=1)
