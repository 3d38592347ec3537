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
    """Sets of postures nearer to balance.

    Parameters
    ----------
    scene : GraspScene
    loads : Loads
    setups : tuple of FingerSetup
    some : list of Candidates
        Per finger, K postures; the k-th of each belong together.
    pose : (float, float, float)
        World pose of the object [m, rad].

    Returns
    -------
    list of Candidates or None
        The same, changed; None where these fingers are not of the kind that can be.
    """
    fingers = []
    for setup, mine in zip(setups, some, strict=True):
        same = (mine.bases == mine.bases[0]).all() and (mine.knots == mine.knots[0]).all()
        if not same or mine.stations.shape[1] != 1 or not np.all(np.diff(mine.knots[0]) > 0.0):
            return None
        base = (float(mine.bases[0, 0]), float(mine.bases[0, 1]), float(mine.bases[0, 2]))
        fingers.append(
            _Finger(scene, loads, setup, make_task(scene, setup, base, pose, 1, (setup.tip_name,)), pose, mine)
        )
    bent = [f.start.curvatures.copy() for f in fingers]
    best = [b.copy() for b in bent]
    least = np.full(len(bent[0]), np.inf)
    for step in range(_STEPS + 1):
        parts = [f.look(b, slopes=step < _STEPS) for f, b in zip(fingers, bent, strict=True)]
        bent = [p.curvatures for p in parts]
        carried = sum(p.sums for p in parts)
        off = carried - np.append(loads.target[:3], loads.lift / loads.force)
        slack = off[:, 3] >= 0.0
        off[slack, 3] = 0.0
        rest = np.concatenate([off, *(p.own for p in parts)], axis=1)
        size = np.sqrt((rest**2).sum(axis=1))
        better = size < least
        least = np.where(better, size, least)
        for k, b in enumerate(bent):
            best[k][better] = b[better]
        if step == _STEPS or least.max() < _ENOUGH:
            break
        slope = _joined_slopes(parts, slack)
        square = np.einsum("kri,krj->kij", slope, slope) + _DAMPING * np.eye(slope.shape[2])
        change = -np.linalg.solve(square, np.einsum("kri,kr->ki", slope, rest)[..., None])[..., 0]
        change *= np.minimum(1.0, _MOST / np.maximum(np.abs(change).max(axis=1), 1e-300))[:, None]
        ends = np.cumsum([0, *(b.shape[1] for b in bent)])
        bent = [b + change[:, ends[k] : ends[k + 1]] for k, b in enumerate(bent)]
    return [f.candidates(b) for f, b in zip(fingers, best, strict=True)]


@dataclass(frozen=True)
class _Look:
    curvatures: Array
    sums: Array
    """Force and moment on the object and friction left for its weight, scaled (K, 4)."""
    own: Array
    """What should vanish for the finger alone (K, R)."""
    sums_slope: Array
    own_slope: Array


def _joined_slopes(parts: list[_Look], slack: Array) -> Array:
    count = len(slack)
    widths = [p.sums_slope.shape[2] for p in parts]
    heights = [p.own.shape[1] for p in parts]
    out = np.zeros((count, 4 + sum(heights), sum(widths)))
    row, column = 4, 0
    for part, width, height in zip(parts, widths, heights, strict=True):
        out[:, :4, column : column + width] = part.sums_slope
        out[:, row : row + height, column : column + width] = part.own_slope
        row, column = row + height, column + width
    out[slack, 3] = 0.0
    return out


class _Finger:
    """One finger of the sets."""

    def __init__(
        self, scene: GraspScene, loads: Loads, setup: FingerSetup, task: FingerTask, pose: Pose, start: Candidates
    ) -> None:
        self.scene, self.loads, self.setup, self.task, self.pose, self.start = scene, loads, setup, task, pose, start
        self._lengths = np.diff(start.knots[0])
        self._walk = np.zeros(len(start))
        for part, shape in enumerate(task.shapes):
            mine = start.parts[:, 0] == part
            at = task.frame.point(start.points[mine, 0])
            self._walk[mine] = shape.nearest(at + task.half * np.exp(1j * task.frame.angle(start.angles[mine, 0])))[1]

    def look(self, bent: Array, slopes: bool) -> _Look:
        """Balance at curvatures (K, n), changed so that the tips touch, and its slopes."""
        count, size = bent.shape
        moves = np.concatenate([np.zeros((1, size)), _STEP * np.eye(size)]) if slopes else np.zeros((1, size))
        every, copies = bent[:, None, :] + moves, len(moves)
        found = self._candidates(every.reshape(-1, size), np.repeat(np.arange(count), copies))
        sums, own = (part.reshape(count, copies, -1) for part in self._balance(found))
        bent = found.curvatures[::copies]
        return _Look(
            bent,
            sums[:, 0],
            own[:, 0],
            np.swapaxes(sums[:, 1:] - sums[:, :1], 1, 2) / _STEP,
            np.swapaxes(own[:, 1:] - own[:, :1], 1, 2) / _STEP,
        )

    def candidates(self, bent: Array) -> Candidates:
        """The postures at curvatures (K, n)."""
        return self._candidates(bent, np.arange(len(bent)), judged=True)

    def _touching(self, bent: Array, walk: Array, parts: Array) -> tuple[Array, Array, Array]:
        bent, walk, good = bent.copy(), walk.copy(), np.zeros(len(bent), bool)
        columns = tuple(range(bent.shape[1]))
        for part, shape in enumerate(self.task.shapes):
            mine = np.flatnonzero(parts == part)
            if len(mine):
                start = (np.zeros(len(mine), complex), np.zeros(len(mine)))
                lengths = np.broadcast_to(self._lengths, (len(mine), len(self._lengths)))
                new, there, found = touch(shape, start, lengths, bent[mine], columns, walk[mine])
                bent[mine[found]], walk[mine[found]], good[mine] = new[found], there[found], found
        return bent, walk, good

    def _candidates(self, bent: Array, rows: Array, judged: bool = False) -> Candidates:
        parts = self.start.parts[rows, 0]
        bent, walk, good = self._touching(bent, self._walk[rows], parts)
        points, angles = np.zeros(len(rows), complex), np.zeros(len(rows))
        for part, shape in enumerate(self.task.shapes):
            at = shape.walk(walk[parts == part])
            points[parts == part], angles[parts == part] = at.point, at.angle
        retained = self.start.take(rows)
        wrong = retained.violation
        if judged:
            wrong = violation(self.task, retained.knots, bent, retained.joints) + np.where(good, 0.0, 1.0)
        frame = self.task.frame
        surface = frame.back(points - self.task.half * np.exp(1j * angles))
        normals = frame.angle_back(angles)[:, None]
        return replace(retained, curvatures=bent, points=surface[:, None], angles=normals, violation=wrong)

    def _balance(self, found: Candidates) -> tuple[Array, Array]:
        block = finger_block(self.scene, self.loads, self.setup, found, self.pose)
        columns = [0, self.loads.edges - 1, -2]
        moments, onto = block.moments[:, :, columns], block.onto[:, :3, columns]
        square = np.einsum("pri,prj->pij", moments, moments)
        span = np.sqrt(np.maximum(np.einsum("pii->pi", square), 1e-300))
        square = square / (span[:, :, None] * span[:, None, :]) + 1e-9 * np.eye(3)
        right = np.einsum("pri,pr->pi", moments, block.needed) / span
        forces = np.linalg.solve(square, right[..., None])[..., 0] / span
        left = (moments @ forces[..., None])[..., 0] - block.needed
        unit = self.loads.force
        outside = np.minimum(forces[:, :2], 0.0) / unit
        low, high = -block.high[-1], block.high[-2]
        over = np.maximum(forces[:, 2] - high, 0.0) + np.minimum(forces[:, 2] - low, 0.0)
        lifted = 2.0 * self.setup.friction * np.sqrt(np.maximum(forces[:, 0] * forces[:, 1], 1e-12 * unit**2)) / unit
        sums = np.concatenate([(onto @ forces[..., None])[..., 0] / unit, lifted[:, None]], axis=1)
        return sums, np.concatenate([left, outside, (over / max(high, -low, 1e-300))[:, None]], axis=1)
