"""What a fit says against its own intervals; from inside: each doubt alone, of residuals made here.

What a fit says against its own intervals, and the variance of a robust one.
"""

from __future__ import annotations

import re
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.stats
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import brentq

from continuum_grasp.addons.identification import doubts as evidence
from continuum_grasp.addons.identification import problem as module
from continuum_grasp.addons.identification.blocks import MeasuredBlock
from continuum_grasp.addons.identification.doubts import (
    _correlated,
    _missed,
    _outliers,
    _sets,
    _stated,
    doubts_of_elements,
)
from continuum_grasp.addons.identification.inference import FALSE_ALARMS, infer
from continuum_grasp.addons.identification.least_squares import Minimum, least_squares
from continuum_grasp.addons.identification.problem import FitProblem, Inferred, Solution
from continuum_grasp.addons.identification.unknowns import Unknown
from continuum_grasp.base import SolverError
from tests.identification_cases import level_set

ONE = Unknown("level", "m", "level", 1.0, False, 0.0, -np.inf, np.inf, 1.0)


class Level(MeasuredBlock):
    """Numbers that are predicted by one unknown, their mean."""

    def __init__(self, values: np.ndarray, name: str = "level", sigma: float | None = 1.0) -> None:
        self.measured = level_set(name, values, sigma)

    def predict(self, values, until=np.inf):
        count = len(self.measured.values)
        return np.full(count, values[0]), np.ones((count, 1))


@pytest.mark.parametrize("fitted", [True, False])
def test_what_a_hold_out_has_of_its_own_may_be_found_nearly(fitted, monkeypatch):
    """It is then missed by more; of what is fitted, a search that ends early is an error."""
    problem, every = FitProblem([Level(np.array([1.0, 2.0]))], [ONE]), np.ones(2, dtype=bool)
    problem.fitted[:] = fitted
    early = partial(Minimum._replace, status="iteration limit")
    monkeypatch.setattr(module, "least_squares", lambda *of, **ends: early(least_squares(*of, **ends)))
    with pytest.raises(SolverError) if fitted else nullcontext():
        minimum = problem._search(np.array([0.5]), every, np.ones(2), every[:1])
        assert minimum.values == pytest.approx([1.5])


@pytest.mark.parametrize(("share", "reported"), [(0.999, False), (1.001, True)])
def test_sets_that_differ_are_reported_by_the_analysis_of_variance(share, reported):
    """Three sets of unequal size, moved apart until scipy's ratio of variances is what two in a thousand exceed."""
    rng, ratio = np.random.default_rng(4), share * scipy.stats.f.isf(2e-3, 2, 16)
    noise = [rng.standard_normal(count) for count in (6, 9, 4)]
    shift = np.array([1.0, -0.3, 0.4])

    def moved(by: float) -> list[np.ndarray]:
        return [one + by * step for one, step in zip(noise, shift, strict=True)]

    by = brentq(lambda by: scipy.stats.f_oneway(*moved(by)).statistic - ratio, 0.5, 10.0)
    sets = moved(by)
    problem = FitProblem([Level(one, f"set {k}") for k, one in enumerate(sets)], [ONE])
    found = _sets(problem, np.concatenate(sets))
    assert len(found) == reported
    assert all(f"ratio of variances {ratio:.0f}" in one for one in found)


def test_what_a_finer_model_would_move_is_exact_of_a_linear_one(monkeypatch):
    """The same data are met by parameters that are so much greater, where predictions are so much smaller."""
    rng, moved = np.random.default_rng(7), np.array([0.3, -0.02, 0.5])
    jacobian, coarse = rng.standard_normal((12, 3)), rng.standard_normal(12)
    unknowns = [ONE._replace(name=name) for name in ("a", "b", "c")]
    block, finer = Level(coarse), Level(coarse)
    monkeypatch.setattr(finer, "predict", lambda values: (coarse - jacobian @ moved, None))
    monkeypatch.setattr(block, "again", lambda sought, scene, by: finer)
    block.scene = None
    monkeypatch.setattr(evidence, "FingerModel", lambda scene: SimpleNamespace(lengths=[0.1]))
    monkeypatch.setattr(evidence, "refined", lambda scene, model: scene)
    problem = FitProblem([block], unknowns)
    solution = Solution(np.zeros(3), coarse, jacobian, np.ones(12), 0, 0)
    for deviations, named in (([0.2, 0.1, np.inf], [("a", "0.3", "1.5")]), ([0.51, 0.51, 0.51], [])):
        inference = SimpleNamespace(deviations=np.array(deviations))
        texts = doubts_of_elements(problem, solution, Inferred(unknowns, np.zeros(3), jacobian, inference))
        assert re.findall(r"(\w) by (-?[\d.]+) \(([\d.]+) deviations\)", "".join(texts)) == named


def test_outliers_are_found_among_many_and_not_in_normal_noise():
    rng = np.random.default_rng(11)
    for count, most in ((12, 4), (400, 4)):  # of 200: 1 % beside 2 in a thousand
        noises = rng.standard_normal((200, count))
        assert sum(bool(_outliers(FitProblem([Level(one)], [ONE]), one, one.size)) for one in noises) <= most
    # A tenth of the readings far off must not hide each other, whatever the unit of the deviation.
    noise = 1e-3 * rng.standard_normal(400)
    noise[::10] += 8e-3 * rng.choice([-1.0, 1.0], 40)
    noise[70] = 0.1
    (found,) = _outliers(FitProblem([Level(noise)], [ONE]), noise, noise.size)
    assert int(found.split()[0]) >= 38
    assert found.endswith("worst: level, row 70")


def test_an_outlier_that_a_parameter_follows_is_found_by_what_it_has_left():
    """A line through eight points, the last one far beside the others, by Student's t of its own parameter."""
    at = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 2.0])
    columns = np.stack([np.ones(8), at], axis=1)
    leverage = np.diag(columns @ np.linalg.pinv(columns))
    problem = FitProblem([Level(at)], [ONE])
    assert leverage[-1] > 0.8
    rng, alarms = np.random.default_rng(3), 0
    for _ in range(500):
        y = rng.standard_normal(8)
        y[-1] += rng.choice([0.0, 50.0])
        missed = columns @ np.linalg.lstsq(columns, y)[0] - y
        # each point as a parameter of its own: its estimate over its deviation
        ratios = []
        for k in range(8):
            wider = np.column_stack([columns, np.eye(8)[k]])
            fit, left, *_ = np.linalg.lstsq(wider, y)
            ratios.append(abs(fit[2]) / np.sqrt(left[0] / 5 * np.linalg.inv(wider.T @ wider)[2, 2]))
        far = sum(ratio > scipy.stats.t.isf(0.5 * FALSE_ALARMS / 8, 5) for ratio in ratios)
        found = _outliers(problem, missed, 6, leverage)
        alarms += far > 0
        assert int(found[0].split()[0] if found else 0) == far
    assert alarms > 50


@pytest.mark.parametrize(("share", "warned"), [(0.999, False), (1.001, True)])
def test_parameters_are_hardly_seen_from_a_deviation_of_half_their_size_on(share, warned):
    """Of a mean of nine numbers that scatter by one, the deviation is a third."""
    residuals = np.sqrt(9.0 / 8.0) * np.array([1.0, -1.0] * 4 + [0.0])
    size = share * np.sqrt(9.0 / 8.0) * np.sqrt(8.0 / 8.0 / 9.0) / 0.5
    one = ONE._replace(typical=size / share**2)
    found = infer([one], np.array([size / share**2]), np.ones((9, 1)), residuals).warnings
    assert any("hardly see" in text for text in found) == warned


@pytest.mark.parametrize(("share", "warned"), [(0.9999, False), (1.0001, True)])
def test_parameters_are_hardly_distinguished_from_a_correlation_of_99_percent_on(share, warned):
    r = 0.99 * share
    jacobian = np.vstack([np.linalg.cholesky(np.array([[1.0, r], [r, 1.0]])).T, np.zeros((8, 2))])
    residuals = np.append(np.zeros(2), 1e-3 * np.array([1.0, -1.0] * 4))
    unknowns = [ONE, ONE._replace(name="other")]
    found = infer(unknowns, np.ones(2), jacobian, residuals).warnings
    assert any("can hardly be distinguished" in text for text in found) == warned


@pytest.mark.parametrize(("instants", "judged"), [(29, False), (30, True)])
def test_correlation_along_a_path_is_judged_from_thirty_instants_on(instants, judged):
    drift = np.linspace(-1.0, 1.0, instants)
    block = Level(drift)
    block.measured = replace(block.measured, moves=True, ordered=True)
    assert bool(_correlated(FitProblem([block], [ONE]), drift)) == judged


@pytest.mark.parametrize(("slow", "least", "most"), [(0.0, 0, 2), (0.4, 45, 50)])
def test_a_slow_part_that_is_small_beside_the_noise_is_seen(slow, least, most):
    """Beside white noise of 1: single lags show a correlation of 0.14, as noise does at some."""
    rng, warned, hits = np.random.default_rng(2), 0, []
    for _ in range(50):
        noise, bends = rng.standard_normal((500, 2)), gaussian_filter1d(rng.standard_normal((500, 12)), 20.0, axis=0)
        noise += slow * bends[:, :2] / bends[:, :2].std(axis=0)
        slopes = bends[:, 2:].reshape(1000, 5) / bends[:, 2:].std()
        values = np.linalg.lstsq(slopes, noise.ravel(), rcond=None)[0]
        left = slopes @ values - noise.ravel()
        block = Level(left)
        block.measured = replace(block.measured, moves=True, ordered=True)
        warned += bool(_correlated(FitProblem([block], [ONE]), left))
        found = infer([ONE] * 5, values, slopes, left, [np.arange(1000).reshape(500, 2)])
        hits.append(np.abs(values) < 0.5 * np.ptp(found.intervals, axis=1))
    assert least <= warned <= most
    assert np.mean(hits) > 0.85


class Line(MeasuredBlock):
    """Numbers that are predicted by a level and a slope of their places, some of them held out."""

    def __init__(self, places: np.ndarray, values: np.ndarray, fitted: np.ndarray) -> None:
        self.places = places
        self.measured = replace(level_set("line", values, None), fitted=fitted)

    def predict(self, values, until=np.inf):
        slopes = np.stack([np.ones(self.places.size), self.places], axis=1)
        return slopes @ values, slopes


@pytest.mark.parametrize(("bend", "least", "most"), [(0.0, 0, 1), (0.4, 98, 100)])
def test_hold_outs_that_are_missed_by_far_are_reported(bend, least, most):
    """Extrapolated by the law that the data have, and by another, which the fitted rows hardly show."""
    rng, reported = np.random.default_rng(5), 0
    places = np.append(np.linspace(0.0, 1.0, 15), [6.0, 6.5, 7.0])
    unknowns = [ONE, ONE._replace(name="slope")]
    for _ in range(100):
        values = 0.3 + 2.0 * places + bend * places**2 + 0.1 * rng.standard_normal(18)
        problem = FitProblem([Line(places, values, places < 2.0)], unknowns)
        solution = problem.solve(lambda share: None)
        texts = _missed(problem, solution, problem.inferred(solution).inference)
        assert all("line: level" in text for text in texts)
        reported += len(texts)
    assert least <= reported <= most


@pytest.mark.parametrize(("stated", "least", "most"), [(1.0, 0, 2), (3.0, 95, 100), (1.0 / 3.0, 95, 100)])
def test_a_deviation_that_is_stated_wrongly_is_reported(stated, least, most):
    """Of one of two sensors: the other one's is right."""
    rng, reported = np.random.default_rng(6), 0
    for _ in range(100):
        noise = rng.standard_normal((2, 25))
        blocks = [Level(noise[0], "camera", 1.0), Level(noise[1], "gyroscope", stated)]
        for block in blocks:
            own = block.measured.columns[0]._replace(group=block.measured.name)
            block.measured = replace(block.measured, columns=(own,))
        problem = FitProblem(blocks, [ONE])
        solution = problem.solve(lambda share: None)
        weighted = (solution.predictions - problem.measured) / solution.sigma
        texts = _stated(problem, weighted, problem.leverage(solution.jacobian, solution.sigma))
        assert all(text.startswith("gyroscope: residuals scatter by") for text in texts)
        reported += len(texts)
    assert least <= reported <= most


def test_a_further_parameter_leaves_the_others_between_their_bounds():
    """A step that would take a delay below zero, against the least squares of the others alone."""
    places = np.linspace(0.0, 1.0, 9)
    values = 1.0 - 0.5 * places + 0.01 * np.cos(40.0 * places)
    unknowns = [ONE, ONE._replace(name="delay", lower=0.0)]
    problem = FitProblem([Line(places, values, np.ones(9, dtype=bool))], unknowns)
    solution = problem.solve(lambda share: None)
    assert solution.values[1] == 0.0
    found = problem.inferred(solution, (ONE._replace(name="friction", lower=0.0), -(places**2)))
    level, bend = np.linalg.lstsq(np.stack([np.ones(9), -(places**2)], axis=1), values, rcond=None)[0]
    assert found.values == pytest.approx([level, 0.0, bend])
