"""Fit a chain of lines and arcs to measured points by least squares, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.measured.chain import LineArcChain, slopes_of, turn_slopes_of
from continuum_grasp.scene.objects.measured.noise import Noise, frames
from continuum_grasp.scene.objects.measured.pieces import PointRun

_STEPS = 20
"""Greatest number of Gauss-Newton steps; a chain near its points takes three to six."""
_MEANS = 800
"""Greatest number of points, or means of points, that settle a chain."""
_STIFF = 1e3
"""Stiffness of a smooth or level joint, per stiffness of the points [1]: its error is a thousandth of the noise."""
_HUBER = 2.0
"""Residual, per scatter, beyond which the pull of a point is constant [1]: 95 % of normal noise are within."""
_Entry = TypeVar("_Entry")


@dataclass(frozen=True)
class ChainFit:
    """A chain through points.

    Attributes
    ----------
    chain : LineArcChain
    points : Array
        Points that settle the chain (n, 2), in the order of the curve, without blurred corners.
    owner : Array
        PointRun of each point (n,), increasing.
    noise : Noise
    covariance : Array
        Covariance of joints and bulges (3k, 3k).
    """

    chain: LineArcChain
    points: Array
    owner: NDArray[np.int_]
    noise: Noise
    covariance: Array

    @classmethod
    def through(cls, points: Array, pieces: Sequence[PointRun], noise: Noise, worth: float, near: float) -> ChainFit:
        """Fit a chain to points (n, 2) that are divided into pieces; corners are ``near`` some of the points.

        A joint is smooth if noise explains its change of direction, by the same criterion as for pieces: one parameter
        less against a greater sum of squares.
        """
        runs: list[Array] = [points[np.arange(p.first, p.last) % len(points)] for p in pieces if not p.is_blur]
        kinds = [piece.is_arc for piece in pieces if not piece.is_blur]
        while True:
            fit = cls._of(runs, kinds, noise)
            slopes = turn_slopes_of(fit.chain)
            unlike = fit.chain.turns**2 / np.einsum("ki,ij,kj->k", slopes, fit.covariance, slopes)
            corner = np.logical_not(np.logical_or(fit.chain.is_arc, np.roll(fit.chain.is_arc, 1)))
            spurious = _apart(fit._spurious(runs, near))
            # Two lines in line are one: a line more has three parameters.
            straight = _apart(corner & (unlike < 3.0 * worth))
            if len(runs) - int(spurious.sum()) >= 3 and spurious.any():
                runs, kinds = _without(runs, spurious), _without(kinds, spurious)
            elif len(runs) - int(straight.sum()) >= 3 and straight.any():
                for k in np.flatnonzero(straight):
                    runs[k - 1] = np.concatenate([runs[k - 1], runs[k]])
                runs, kinds = _without(runs, straight), _without(kinds, straight)
            else:
                break
        smooth = (unlike <= worth) & ~corner
        return replace(fit, chain=replace(fit.chain, smooth=smooth))._settled() if smooth.any() else fit

    @classmethod
    def _of(cls, runs: Sequence[Array], kinds: Sequence[bool], noise: Noise) -> ChainFit:
        """Return the chain with corners at all ends of runs."""
        joints = np.array([0.5 * (before[-1] + run[0]) for before, run in zip([runs[-1], *runs], runs, strict=False)])
        bulges = np.array([_bulge(run) if is_arc else 0.0 for run, is_arc in zip(runs, kinds, strict=True)])
        # Means of neighbors determine the pieces as well as the points do, at less cost.
        count = max(sum(map(len, runs)) // _MEANS, 1)
        means = [
            run[: len(run) // count * count].reshape(-1, count, 2).mean(axis=1) if len(run) > 4 * count else run
            for run in runs
        ]
        owner = np.repeat(np.arange(len(runs)), [len(each) for each in means])
        noise = noise if count == 1 else Noise(max(noise.density / count, (noise.scatter / count) ** 2) ** 0.5, 1.0)
        chain = LineArcChain(joints, bulges, np.array(kinds), np.zeros(len(runs), dtype=bool))
        return cls(chain, np.concatenate(means), owner, noise, np.zeros((0, 0)))._settled()

    def _spurious(self, runs: Sequence[Array], near: float) -> Array:
        """Pieces (k,) without space between their neighbors, or with a corner far from all points."""
        along = np.array([run[-1] - run[0] for run in runs])
        spurious = np.asarray((self.chain.chords * along).sum(axis=1) < 0.0)
        for k, joint in enumerate(self.chain.joints):
            gap = float(np.linalg.norm(runs[k][0] - runs[k - 1][-1]))
            beside = np.concatenate([runs[k - 1], runs[k]])
            if np.linalg.norm(beside - joint, axis=1).min() > near + gap:
                spurious[k if len(runs[k]) < len(runs[k - 1]) else k - 1] = True
        return spurious

    @property
    def spread(self) -> float:
        """Greatest standard deviation of the chain's distance from the curve."""
        slopes = slopes_of(self.chain, self.points, self.owner)
        count = len(self.chain.joints)
        begin, end = 3 * self.owner, 3 * ((self.owner + 1) % count)
        places = np.stack([begin, begin + 1, begin + 2, end, end + 1], axis=1)
        around = self.covariance[places[:, :, None], places[:, None, :]]
        return float(np.sqrt(np.einsum("ni,nij,nj->n", slopes, around, slopes).max()))

    def level(self, normal: tuple[float, float], within: float) -> ChainFit:
        """Return the chain with all joints within a distance of the outermost one along a normal moved level with
        it.
        """
        heights = self.chain.joints @ normal
        outer = np.flatnonzero(heights >= heights.max() - within)
        if len(outer) < 2:
            return self
        ties = np.zeros((len(outer) - 1, 3 * len(heights)))
        for row, (a, b) in enumerate(pairwise(outer)):
            ties[row, 3 * a : 3 * a + 2] = normal
            ties[row, 3 * b : 3 * b + 2] = -np.asarray(normal)
        fit = self._settled(ties)
        joints = fit.chain.joints.copy()
        heights = joints[outer] @ normal
        # They are level already, up to the stiffness of the ties.
        joints[outer] += (heights.mean() - heights)[:, None] * np.asarray(normal)
        return replace(fit, chain=replace(fit.chain, joints=joints))

    def _settled(self, ties: Array | None = None) -> ChainFit:
        """The chain of least squares next to this one, by Gauss-Newton steps, where ``ties`` (m, 3k) times its
        parameters are zero.
        """
        start, chain = self.chain, self.chain
        free = np.stack([np.ones_like(chain.bulges)] * 2 + [chain.is_arc], axis=1).ravel() > 0.0
        trust = 1e-6
        cost, gram, slope = self._normal(chain, ties)
        for _ in range(_STEPS):
            damped = gram + trust * np.diag(np.diag(gram))
            step = np.zeros(len(free))
            step[free] = -np.linalg.solve(damped[np.ix_(free, free)], slope[free])
            moved = chain.moved(step.reshape(-1, 3))
            away = moved.joints - start.joints
            beyond = np.maximum(np.linalg.norm(away, axis=1) / start.reach, 1.0)
            moved = replace(moved, joints=start.joints + away / beyond[:, None])
            less, *rest = self._normal(moved, ties)
            if not less < cost:
                trust *= 10.0
                continue
            gained = cost - less
            chain, cost, (gram, slope) = moved, less, rest
            trust *= 0.1
            if gained < 1e-2:
                break
        covariance = np.zeros_like(gram)
        covariance[np.ix_(free, free)] = self.noise.share * np.linalg.inv(gram[np.ix_(free, free)])
        return replace(self, chain=chain, covariance=covariance)

    def _normal(self, chain: LineArcChain, ties: Array | None) -> tuple[float, Array, Array]:
        """Half the sum of squares, per variance of a point, and its Gauss-Newton matrix and slope by the parameters."""
        scatter, count = self.noise.scatter, len(chain.joints)
        rest = chain.distances(self.points, self.owner) / scatter
        slopes = slopes_of(chain, self.points, self.owner) / scatter
        size = np.abs(rest)
        weight = np.where(size <= _HUBER, 1.0, _HUBER / np.maximum(size, _HUBER))
        cost = float(np.where(size <= _HUBER, 0.5 * rest**2, _HUBER * (size - 0.5 * _HUBER)).sum())
        gram = np.zeros((3 * count, 3 * count))
        slope = np.zeros(3 * count)
        first = np.searchsorted(self.owner, np.arange(count + 1))
        for k in range(count):
            rows = slopes[first[k] : first[k + 1]]
            weighted = rows.T * weight[first[k] : first[k + 1]]
            after = 3 * ((k + 1) % count)
            at = [3 * k, 3 * k + 1, 3 * k + 2, after, after + 1]
            gram[np.ix_(at, at)] += weighted @ rows
            slope[at] += weighted @ rest[first[k] : first[k + 1]]
        for rows, off in self._beside(chain, ties):
            cost += 0.5 * float(off @ off)
            gram += rows.T @ rows
            slope += rows.T @ off
        return cost, gram, slope

    def _beside(self, chain: LineArcChain, ties: Array | None) -> list[tuple[Array, Array]]:
        """Return additional residuals and their derivatives, besides the distances of the points."""
        start, reach = self.chain, self.chain.reach
        places = np.eye(3 * len(reach)).reshape(len(reach), 3, -1)[:, :2]
        # A joint that slides along both its pieces stays within the length of the shorter one.
        stays = (places / reach[:, None, None]).reshape(2 * len(reach), -1)
        beside = [(stays, ((chain.joints - start.joints) / reach[:, None]).ravel())]
        if chain.smooth.any():
            stiff = (_STIFF / self.noise.scatter * reach)[chain.smooth]
            beside.append((turn_slopes_of(chain)[chain.smooth] * stiff[:, None], chain.turns[chain.smooth] * stiff))
        if ties is not None:
            rows = _STIFF / self.noise.scatter * ties
            beside.append((rows, rows @ np.column_stack([chain.joints, chain.bulges]).ravel()))
        return beside


def _without(every: list[_Entry], chosen: Array) -> list[_Entry]:
    return [one for one, out in zip(every, chosen, strict=True) if not out]


def _apart(chosen: Array) -> Array:
    """Return the chosen pieces without direct successors of chosen pieces."""
    apart = chosen.copy()
    for k in range(len(apart)):
        apart[k] &= not apart[k - 1]
    return apart


def _bulge(run: Array) -> float:
    """Height of an arc's middle over half its chord, by its points [1]."""
    chord = run[-1] - run[0]
    length = float(np.linalg.norm(chord))
    along, across = frames((run - 0.5 * (run[0] + run[-1]))[None], (chord / length)[None])
    # The area between chord and flat arc is 2/3 of height times chord.
    area = float(np.trapezoid(across[0], along[0]))
    flat = 1.5 * area / length
    middle = float(across[0][len(run) // 2])
    return 2.0 * (middle if abs(middle) > abs(flat) else flat) / length
