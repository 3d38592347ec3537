"""All measurements together: residuals, their weights, and the search for the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.blocks import MeasuredBlock
from continuum_grasp.addons.identification.inference import Inference, infer
from continuum_grasp.addons.identification.least_squares import Minimum, least_squares
from continuum_grasp.addons.identification.numbers import MeasuredNumbers
from continuum_grasp.addons.identification.unknowns import ALONG, DIRECTIONS, Unknown, prior
from continuum_grasp.base import Array, InputError, NumericalError, SolverError

Progress = Callable[[float], None]

_ROUNDS = 25
"""Most rounds of weights; standard deviations settle in two or three."""
_HORIZONS = (0.1, 0.25, 0.5)
"""Parts of free paths that are fitted before the whole, so that a wrong start does not end in a wrong period."""
_FIRST, _EVALUATIONS = 12, 200
"""Most evaluations of the search on a part of the data, which only has to lead near, and on all of them: the measured
rods take 54 or less in all searches together."""
_KINKED: dict[str, float] = {"decrease": 1e-6}
"""Relative decrease of the sum of squares where a search over kinks ends [1]: they keep it from getting to rounding,
and of the squares of 2000 numbers it is 4 % of a deviation. Releases of the hose trunk take 57 evaluations so, and more
than 200 to get to 1e-14."""


class Solution(NamedTuple):
    """The parameters (n,) at the minimum, with the weights that led there."""

    values: Array
    predictions: Array
    """(m,), of every number, fitted or not."""
    jacobian: Array
    sigma: Array
    """Standard deviation (m,) of every number, as known or found."""
    iterations: int
    evaluations: int


def with_sets(sought: Sequence[Unknown], blocks: Sequence[MeasuredBlock]) -> tuple[list[Unknown], list[Array]]:
    """Unknowns (n) of all sets, behind them the unknowns of single sets, and by which matrix (k, n) each set has its
    own.

    First are those that have one value, then the parts of their vectors across the finger.
    """
    common = [of for of in sought if of.per in ("all", "plane")]
    vectors = [of for of in sought if of.per == "plane"]
    free: dict[str, Any] = {"target": ALONG, "start": 0.0, "lower": -math.inf, "upper": math.inf, "per": "all"}
    parts = [of._replace(name=f"{of.name} at {at} deg", **free) for of in vectors for at in DIRECTIONS]
    unknowns = [*common, *parts]
    mixes = list[Array]()
    for block in blocks:
        mine = (*sought, *block.own)
        first = len(unknowns)
        if vectors and block.plane is None:
            raise InputError(f"{vectors[0].name} is estimated per plane: state the plane of {block.name}", key="data")
        unknowns += [of._replace(name=f"{of.name} of {block.name}") for of in mine if of.per == "set"]
        alone = np.array([of.per == "set" for of in mine], dtype=bool)
        across = np.array([of.per == "plane" for of in mine], dtype=bool)
        mix = np.zeros((len(mine), len(unknowns)))
        shares = np.cos((block.plane or 0.0) - np.radians(DIRECTIONS))
        mix[~alone, : len(common)] = np.eye(len(common))
        mix[alone, first:] = np.eye(len(unknowns) - first)
        mix[across, len(common) : len(common) + len(parts)] = np.kron(np.eye(len(vectors)), shares)
        mixes.append(mix)
    return unknowns, [np.pad(mix, ((0, 0), (0, len(unknowns) - mix.shape[1]))) for mix in mixes]


class Inferred(NamedTuple):
    """Unknowns, their values (n,), the Jacobian (rows, n) of what was fitted and is known beforehand, per standard
    deviation, and what follows.
    """

    unknowns: list[Unknown]
    values: Array
    jacobian: Array
    inference: Inference


class SetInProblem(NamedTuple):
    """A set of measurements, where its numbers stand in the order of all sets, and the matrix by which its unknowns
    follow from the common ones.
    """

    block: MeasuredBlock
    rows: slice
    mix: Array


class FitProblem(MeasuredNumbers):
    """Measurements of all sets and the model's predictions of them.

    The first ``shared`` unknowns belong to all sets, the others to one set each; ``sought`` are as given.
    """

    def __init__(self, blocks: Sequence[MeasuredBlock], unknowns: Sequence[Unknown]) -> None:
        self.blocks = list(blocks)
        self.sought = tuple(unknowns)
        self.unknowns, mixes = with_sets(unknowns, blocks)
        self.shared = sum(unknown.per != "set" for unknown in self.unknowns)
        self.sets = tuple(block.measured for block in blocks)
        self.parts = [SetInProblem(*part) for part in zip(blocks, self.slices, mixes, strict=True)]
        self._sought = np.ones(len(self.unknowns), dtype=bool)
        for part in self.parts:
            # what only a set that is not fitted has would drift in a search that does not see it
            self._sought[self._own(part)] = self.fitted[part.rows].any()
        self._known = np.array([np.nan if of.sigma is None else of.sigma for of in self.described])
        self._ends = _KINKED if any(block.kinked for block in blocks) else {}
        self._iterations = self._evaluations = 0
        self._begun = self.followed

    @property
    def series(self) -> list[NDArray[np.intp]]:
        """Numbers (T, readings) among the fitted ones of each set whose rows follow one another."""
        numbers = np.cumsum(self.fitted) - 1
        return [
            numbers[rows][self.fitted[rows]].reshape(-1, len(of.columns))
            for of, rows in zip(self.sets, self.slices, strict=True)
            if of.ordered and self.fitted[rows].any()
        ]

    @property
    def followed(self) -> list[Any]:
        """Shapes and steps of each set from which its next predictions are followed."""
        return [block.followed for block in self.blocks]

    @followed.setter
    def followed(self, followed: list[Any]) -> None:
        for block, its in zip(self.blocks, followed, strict=True):
            block.followed = its

    def begin(self) -> None:
        """Follow the next predictions from the scene again: start values may be far from where a search ended."""
        self.followed = self._begun

    def prior(self, values: Array) -> tuple[Array, Array]:
        """Prior of the values, without unknowns of sets that are not fitted."""
        unknowns = zip(self.unknowns, self._sought, strict=True)
        return prior([unknown if sought else unknown._replace(sigma=math.inf) for unknown, sought in unknowns], values)

    def predicted(self, values: Array, predictions: Array) -> dict[str, Any]:
        """Fields of `Predicted`, from a model at some values."""
        return {
            "sets": self.sets,
            "predictions": predictions,
            "drawn": tuple(block.drawn(mix @ values) for block, _, mix in self.parts),
        }

    def warnings(self, values: Array) -> list[str]:
        """Warnings of all sets about shapes beyond a limit."""
        return [f"{block.name}: {text}" for block, _, mix in self.parts for text in block.warnings(mix @ values)]

    def predict(self, values: Array, chosen: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
        """Predictions (m,) and their Jacobian (m, n) of all numbers, or of those that are chosen alone."""
        y = np.zeros(len(self.at))
        jacobian = np.zeros((len(self.at), len(values)))
        for block, rows, mix in self.parts:
            wanted = self.at[rows] if chosen is None else self.at[rows][chosen[rows]]
            if wanted.size:
                y[rows], slopes = block.predict(mix @ values, wanted.max())
                jacobian[rows] = slopes @ mix
        return y, jacobian

    def inferred(self, solution: Solution, *further: tuple[Unknown, Array]) -> Inferred:
        """Inference about the parameters of a solution.

        ``further`` parameters, each with the derivatives (m,) of all predictions by it, are none in the solution; a
        Gauss-Newton step finds them beside the others.
        """
        from scipy.optimize import lsq_linear

        unknowns = [*self.unknowns, *(of for of, _ in further)]
        more = [slope[:, None] for _, slope in further]
        missed, slopes = self.prior(solution.values)
        jacobian = (np.hstack([solution.jacobian, *more]) / solution.sigma[:, None])[self.fitted]
        jacobian = np.vstack([jacobian, np.pad(slopes, ((0, 0), (0, len(more))))])
        residuals = np.append(((solution.predictions - self.measured) / solution.sigma)[self.fitted], missed)
        values = np.pad(solution.values, (0, len(more)))
        if further:
            step: Array = np.asarray(np.linalg.lstsq(jacobian, -residuals, rcond=None)[0], dtype=float)
            own = [*self.unknowns, *(of._replace(lower=-math.inf, upper=math.inf) for of, _ in further)]
            lower, upper, sizes = np.array([(of.lower, of.upper, of.typical) for of in own]).T
            if np.any((values + step < lower) | (values + step > upper)):
                ends = (lower - values) / sizes, (upper - values) / sizes
                step = sizes * lsq_linear(jacobian * sizes, -residuals, ends, method="bvls").x
            values = np.clip(values + step, lower, upper)
            residuals = residuals + jacobian @ step
        return Inferred(unknowns, values, jacobian, infer(unknowns, values, jacobian, residuals, self.series))

    def misfit(self, values: Array, *, early: bool = False) -> float:
        """Sum of squares of fitted data and priors, by deviations that do not depend on a fit; infinite
        where the model has no predictions. Of free paths, the first part alone where it is to be ``early``.
        """
        chosen = self.fitted & self._early(_HORIZONS[0]) if early else self.fitted
        try:
            y = self.predict(values, chosen)[0]
        except (SolverError, NumericalError):
            return math.inf
        missed = ((y - self.measured) / self._first_sigma())[chosen]
        known = self.prior(values)[0]
        total = float(missed @ missed + known @ known)
        return total if math.isfinite(total) else math.inf

    def solve(self, progress: Progress, start: Array | None = None, below: float = math.inf) -> Solution:
        """Find the parameters from a start (n,), by default the start of the unknowns; unknown standard deviations
        are found by iteration.

        InputError if nothing is to be fitted, SolverError if the search fails, or begins not ``below`` a misfit.
        """
        if not self.fitted.any():
            raise InputError("there is no row to fit", key="data")
        values = np.array([unknown.start for unknown in self.unknowns]) if start is None else start
        sigma = self._first_sigma()
        for share in _HORIZONS if any(block.free for block in self.blocks) else (1.0,) * (below < math.inf):
            chosen = self.fitted & self._early(share)
            # 4: fitted numbers per parameter from which a part of the data is fitted at all
            if share == 1.0 or chosen.sum() >= 4 * len(values):
                values = self._search(values, chosen, 1.0 / sigma, self._sought, first=True).values
            progress(0.5 * share)
        if below < math.inf and self.misfit(values) >= below:
            raise SolverError("the first steps do not lower the residuals", status="given up")
        for round_ in range(_ROUNDS):
            minimum = self._search(values, self.fitted, 1.0 / sigma, self._sought)
            predictions, jacobian = self.predict(minimum.values, self.fitted)
            # each group by its own residuals (iteratively reweighted): meters and radians weigh as they scatter
            new_sigma = self._new_sigma(predictions, jacobian, sigma)
            settled = np.allclose(new_sigma, sigma, rtol=1e-3, atol=0.0)
            values = minimum.values
            sigma = new_sigma
            progress(0.5 + 0.5 * (round_ + 1) / _ROUNDS)
            # one weight for all does not move the minimum
            if settled or len(self.groups) == 1:
                break
        values = self._of_holdouts(values, sigma)
        predictions, jacobian = self.predict(values)
        return Solution(values, predictions, jacobian, sigma, self._iterations, self._evaluations)

    def _of_holdouts(self, values: Array, sigma: Array) -> Array:
        """The values with what sets that are not fitted have of their own, such as their start, sought in these sets.

        Everything common to all sets stays: a prediction is of the law, from a start estimated like any set's.
        """
        for part in self.parts:
            chosen = np.zeros(len(self.measured), dtype=bool)
            sought = self._own(part)
            chosen[part.rows] = True
            if sought.any() and not self.fitted[part.rows].any():
                values = self._search(values, chosen, 1.0 / sigma, sought).values
        return values

    def _own(self, part: SetInProblem) -> NDArray[np.bool_]:
        """Whether each unknown (n,) is of a set alone."""
        return np.asarray(part.mix.any(axis=0) & (np.arange(len(self.unknowns)) >= self.shared))

    def _search(
        self,
        start: Array,
        chosen: NDArray[np.bool_],
        weights: Array,
        free: NDArray[np.bool_],
        *,
        first: bool = False,
    ) -> Minimum:
        unknowns = [unknown for unknown, sought in zip(self.unknowns, free, strict=True) if sought]
        rows = [(unknown.lower, unknown.upper, max(abs(unknown.start), unknown.typical)) for unknown in unknowns]
        lower, upper, sizes = (np.array(column) for column in zip(*rows, strict=True))
        if first:
            # 2.0: greatest relative change of a parameter in a search on a part of the data, which may not see it yet
            reach = np.maximum(2.0 * np.abs(start[free]), sizes)
            lower = np.maximum(lower, start[free] - reach)
            upper = np.minimum(upper, start[free] + reach)

        def residuals(sought: Array) -> tuple[Array, Array]:
            values = start.copy()
            values[free] = sought
            y, jacobian = self.predict(values, chosen)
            scale = weights[chosen]
            known = prior(unknowns, sought)
            missed = scale * (y - self.measured)[chosen]
            slope = scale[:, None] * jacobian[chosen][:, free]
            return np.append(missed, known[0]), np.vstack([slope, known[1]])

        evaluations = _FIRST if first else _EVALUATIONS
        minimum = least_squares(residuals, start[free], lower, upper, sizes, evaluations=evaluations, **self._ends)
        self._iterations += minimum.iterations
        self._evaluations += minimum.evaluations
        # a hold-out whose start is found nearly is missed by more, no less
        if self.fitted[chosen].any() and not first and not minimum.converged:
            raise SolverError(
                "the parameters were not found",
                status=minimum.status,
                violated=[
                    f"{unknown.name} = {value:.6g} {unknown.unit}"
                    for unknown, value in zip(unknowns, minimum.values, strict=True)
                ],
                advice="check units and signs of the data, start nearer to the values, bound them, or estimate fewer",
                result=minimum,
            )
        values = start.copy()
        values[free] = minimum.values
        return minimum._replace(values=values)

    def _early(self, share: float) -> NDArray[np.bool_]:
        """Numbers in the first part of each path that is free; all of them elsewhere."""
        parts = []
        for block, rows, _ in self.parts:
            early = self.at[rows] <= self.at[rows].min() + share * np.ptp(self.at[rows])
            parts.append(early if block.free else np.ones(early.size, dtype=bool))
        return np.concatenate(parts)

    def _first_sigma(self) -> Array:
        """Known standard deviations; a hundredth of the spread of what was measured for the others."""
        sigma = self._known.copy()
        for members in self.groups.values():
            values = self.measured[members]
            spread = max(float(np.ptp(values)), float(np.abs(values).max()), 1e-12)
            sigma[members & np.isnan(self._known)] = 0.01 * spread
        return sigma

    def leverage(self, jacobian: Array, sigma: Array) -> Array:
        """Share (m,) of each fitted number in its own prediction: the variance that its residual lacks.

        Their sum is the number of parameters that the data see.
        """
        fitted = self.fitted
        leverage = np.zeros(len(sigma))
        slopes = [(jacobian / sigma[:, None])[fitted], self.prior(np.zeros(len(self.unknowns)))[1]]
        basis, singular, _ = np.linalg.svd(np.vstack(slopes), full_matrices=False)
        keep = singular > 1e-10 * max(float(singular.max(initial=0.0)), 1e-300)
        # diagonal of the projection onto the columns
        leverage[fitted] = np.sum(basis[: len(slopes[0]), keep] ** 2, axis=1)
        return leverage

    def _new_sigma(self, predictions: Array, jacobian: Array, sigma: Array) -> Array:
        """Standard deviations from the residuals of each group, allowing for the parameters that it pays for."""
        fitted = self.fitted
        residuals = predictions - self.measured
        leverage = self.leverage(jacobian, sigma)
        deviations, first = sigma.copy(), self._first_sigma()
        for group in self.groups.values():
            members = group & np.isnan(self._known)
            used = members & fitted
            freedom = float(np.sum(1.0 - leverage[used]))
            if freedom > 0.5:
                # exact data must not weigh infinitely
                deviations[members] = np.maximum(
                    np.linalg.norm(residuals[used]) / math.sqrt(freedom), 1e-6 * first[members]
                )
        return deviations
