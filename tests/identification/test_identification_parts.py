"""The parts of identification; from inside: search, intervals and predictions, each without the others.

The parts of identification: search, uncertainty, derivatives, damped sines.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest
import scipy.stats

from continuum_grasp.addons.identification import Poses, Reading, fit_damped_sine
from continuum_grasp.addons.identification.blocks import PosesBlock
from continuum_grasp.addons.identification.inference import allotted, infer, information
from continuum_grasp.addons.identification.least_squares import least_squares
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.base import NumericalError, SolverError
from continuum_grasp.model import FingerModel
from tests.identification_cases import DENSITY, STIFFNESS, bare_scene, loaded_scene, rung, slope_error

# -- the search ------------------------------------------------------------------------------------------------------


def rosenbrock(v):
    residuals = np.array([10.0 * (v[1] - v[0] ** 2), 1.0 - v[0]])
    return residuals, np.array([[-20.0 * v[0], 10.0], [-1.0, 0.0]])


def search(function, start, lower=-np.inf, upper=np.inf):
    start = np.array(start, dtype=float)
    bounds = np.broadcast_to(lower, start.shape).astype(float), np.broadcast_to(upper, start.shape).astype(float)
    return least_squares(function, start, *bounds, np.ones(start.size), evaluations=300)


def test_search_finds_the_minimum_of_a_valley():
    found = search(rosenbrock, [-1.2, 1.0])
    assert found.converged
    assert found.values == pytest.approx([1.0, 1.0], abs=1e-7)


def test_search_stops_at_a_bound_with_the_best_of_the_rest():
    found = search(rosenbrock, [0.2, 0.3], upper=[0.5, np.inf])
    assert found.converged
    assert found.values == pytest.approx([0.5, 0.25], abs=1e-7)


def test_search_does_not_follow_a_column_of_rounding():
    """Of y = (a, b, a c) at a = 1e-17 nothing shows c; a rod that hangs straight shows no stiffness either."""

    def straight(v):
        a, b, c = v
        return np.array([a - 0.02, b - 3.0, a * c - 0.02]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [c, 0.0, a]])

    found = search(straight, [1e-17, 0.0, 2.0], lower=[-1.0, -9.0, 0.0])
    assert found.converged
    assert found.values == pytest.approx([0.02, 3.0, 1.0], abs=1e-7)


def test_search_takes_shorter_steps_where_the_model_fails():
    def fails(v):
        if v[0] > 2.0:
            raise SolverError("beyond", status="beyond")
        return np.array([v[0] ** 2 - 3.9]), np.array([[2.0 * v[0]]])

    assert search(fails, [0.1]).values == pytest.approx([math.sqrt(3.9)])


@pytest.mark.parametrize("seed", [42, 243, 375, 806, 1066, 1130, 1154, 1318, 1335, 1481])
def test_search_along_bounds_ends_where_the_gradient_leads_outwards(seed):
    """Curved residuals whose steps bounds cut off, so that the quadratic model predicts no decrease or hardly any.

    Each of these draws ended in an OverflowError. The conditions of optimality are checked by central differences.
    """
    draw = np.random.default_rng(seed)
    slopes, levels, steepness = draw.normal(size=(3, 2)), 3.0 * draw.normal(size=3), draw.uniform(0.5, 4.0)

    def residuals(v):
        y = slopes @ v
        return np.tanh(steepness * y) - levels, (steepness / np.cosh(steepness * y) ** 2)[:, None] * slopes

    found = search(residuals, draw.uniform(-1.0, 1.0, 2), -1.0, 1.0)
    assert found.converged
    cost = [[np.sum(residuals(found.values + h * e)[0] ** 2) for h in (-1e-5, 1e-5)] for e in np.eye(2)]
    gradient = np.diff(cost, axis=1).ravel() / 2e-5
    inside = np.where(
        found.values >= 1.0,
        np.maximum(gradient, 0.0),
        np.where(found.values <= -1.0, np.minimum(gradient, 0.0), gradient),
    )
    assert inside == pytest.approx(0.0, abs=1e-5)


def test_search_takes_shorter_steps_where_derivatives_are_not_finite():
    def residuals(v):
        return np.array([v[0] - 2.0]), np.array([[1.0 if v[0] < 1.2 else np.inf]])

    found = search(residuals, [0.9])
    assert found.values[0] == pytest.approx(1.2, abs=1e-6)
    with pytest.raises(NumericalError, match="start values"):
        search(residuals, [1.5])


def test_search_of_unseen_directions_leaves_them():
    found = search(
        lambda v: (np.array([v[0] + v[1] - 2.0, 0.0]), np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])), [0, 0, 7]
    )
    assert found.converged
    assert found.values.sum() == pytest.approx(9.0)
    assert found.values[2] == 7.0


def test_intervals_of_a_straight_line_are_those_of_regression():
    x = np.array([0.0, 1.0, 2.0, 4.0, 7.0])
    y = np.array([1.1, 2.9, 5.2, 8.8, 15.3])
    known = scipy.stats.linregress(x, y)
    unknowns = read_unknowns(loaded_scene(), ["bending_stiffness", "linear_density"])
    jacobian = np.stack([x, np.ones_like(x)], axis=1)
    values = np.array([known.slope, known.intercept])
    found = infer(unknowns, values, jacobian, jacobian @ values - y)
    assert found.deviations == pytest.approx([known.stderr, known.intercept_stderr])
    half = scipy.stats.t.ppf(0.975, 3) * known.stderr
    assert found.intervals[0] == pytest.approx([known.slope - half, known.slope + half])
    assert found.correlation[0, 1] == pytest.approx(-x.mean() / math.sqrt(np.mean(x**2)))


# -- derivatives -----------------------------------------------------------------------------------------------------

NAMES = ["bending_stiffness", "linear_density", "tip_mass", "rest_curvature", "clamp_angle"]


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_derivatives_of_poses(family):
    scene = loaded_scene(2, fidelity={"family": family})
    readings = [Reading(one, [0.1], at) for one, at in (("x", 0.17), ("y", None), ("angle", 0.3), ("bend", None))]
    unknowns = read_unknowns(scene, NAMES)
    block = PosesBlock(scene, Poses(readings, {"load_1_y": [-0.2]}), unknowns)
    values = np.array([STIFFNESS, DENSITY, 0.004, 0.3, 0.02])
    assert slope_error(block, values, np.array([one.typical for one in unknowns])).max() < 1e-8


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_derivatives_of_vibrations(family):
    scene = loaded_scene(2, fidelity={"family": family})
    unknowns = read_unknowns(scene, [*NAMES, "material_damping"])
    both = rung([2.0, 2.0], [20.0, 20.0], decays=([0.1, 0.1], [1.0, 1.0]), conditions={"load_1_y": [-0.1, 0.1]})
    data = replace(both, measured=[both.measured[0], Reading("x", [0.1, 0.2], 0.17), *both.measured[1:]])
    block = PosesBlock(scene, data, unknowns)
    values = np.array([STIFFNESS, DENSITY, 0.004, 0.3, 0.02, 2e-4])
    assert slope_error(block, values, np.array([one.typical for one in unknowns])).max() < 1e-7


def test_derivatives_behind_friction_of_tendons_and_bending():
    tendons = {"tendons": {"offset": 0.02, "max_tension": 10.0, "friction": 0.1}}
    tendons["damping"] = {"dry_friction": [{"stiffness": 1.0, "moment": 0.01}]}
    scene = bare_scene(2, "clothoid", finger=tendons)
    unknowns = read_unknowns(scene, ["bending_stiffness", "tendon_friction", "dry_friction_1_moment", "tendon_offset"])
    conditions = {"tension_1": [3.0, 0.5, 0.5], "tension_2": [0.5, 4.0, 0.7]}
    block = PosesBlock(scene, Poses([Reading("bend", [0.5, -0.5, 0.0])], conditions), unknowns)
    values = np.array([0.03, 0.12, 0.008, 0.02])
    assert slope_error(block, values, np.array([0.03, 0.1, 0.01, 0.02])).max() < 1e-5


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_base_pose_at_run_time_is_the_folded_one(family):
    scene = loaded_scene(2, fidelity={"family": family})
    runtime = FingerModel(scene, parameters=("base_angle", "base_position"))
    assert tuple(runtime.p_names) == ("base_angle [rad]", "base_position_x [m]", "base_position_y [m]")
    base = scene.finger.base.model_copy(update={"angle": 0.7, "position": (0.03, -0.2)})
    folded = FingerModel(scene.model_copy(update={"finger": scene.finger.model_copy(update={"base": base})}))
    q, w = np.linspace(0.4, -0.3, runtime.n), np.array([0.1, -0.2])
    x = np.concatenate([q, 0.5 * q])
    for name, given in (("forward_dynamics", (x, 0.0, w)), ("position", (q, 0.0, 0.3)), ("orientation", (q, 0.0, 0.3))):
        ours, expected = getattr(runtime, name)(*given, [0.7, 0.03, -0.2]), getattr(folded, name)(*given, [])
        assert np.array(ours) == pytest.approx(np.array(expected), rel=1e-12, abs=1e-14)


# -- ring-downs ------------------------------------------------------------------------------------------------------


def test_a_damped_sine_is_recovered_as_well_as_noise_allows():
    """To the bound of Cramer and Rao, of six unknowns whose derivatives are written by hand."""
    t, noise = np.arange(0.0, 6.0, 0.01), 0.02
    envelope, phase = 0.4 * np.exp(-0.3 * t), 2.0 * math.pi * 3.05 * t + 0.7
    clean = envelope * np.cos(phase) + 0.2 - 0.03 * t
    by = [-2.0 * math.pi * t * envelope * np.sin(phase), -t * envelope * np.cos(phase)]
    by += [envelope * np.cos(phase), envelope * np.sin(phase), np.ones_like(t), t]
    least = noise * np.sqrt(np.diag(np.linalg.inv(np.array(by) @ np.array(by).T)))[:2]
    rng = np.random.default_rng(2)
    found = [fit_damped_sine(t, clean + noise * rng.standard_normal(t.size)) for _ in range(60)]
    scores = (np.array(found) - [3.05, 0.3]) / least
    assert np.abs(np.mean(scores, axis=0)).max() < 4.0 / math.sqrt(60)
    assert np.abs(np.std(scores, axis=0) - 1.0).max() < 4.0 / math.sqrt(120)
    exact = fit_damped_sine(t + 2.0, clean)
    assert (exact.frequency, exact.decay_rate) == pytest.approx((3.05, 0.3), rel=1e-8)


def test_noise_alone_is_no_vibration():
    t = np.arange(0.0, 5.0, 0.01)
    with pytest.raises(SolverError, match="no damped vibration"):
        fit_damped_sine(t, np.random.default_rng(0).standard_normal(t.size))


@pytest.mark.parametrize("seed", range(6))
def test_experiments_with_the_least_variances_are_chosen(seed):
    """Against all ways to make four of six experiments on three unknowns, of which the first two count."""
    rng = np.random.default_rng(seed)
    each, sizes = rng.standard_normal((6, 2, 3)), np.array([1.0, 0.3, 2.0])
    known = np.diag([0.1, 0.0, 0.2])
    found = allotted(information(each, sizes), known, 2, [(np.arange(6), 4)])

    def variance(numbers) -> float:
        rows = np.concatenate([each[k] for k in numbers]) * sizes
        return float(np.trace(np.linalg.inv(known + rows.T @ rows + 1e-6 * np.eye(3))[:2, :2]))

    least = min(map(variance, combinations_with_replacement(range(6), 4)))
    # Exchanges of one experiment end in a minimum of such exchanges: of 2000 random problems 97 % in the least of all.
    assert variance(np.repeat(np.arange(6), found)) == pytest.approx(least, rel=0.02)


def test_a_line_is_measured_at_its_ends():
    """The A-optimal design of intercept and slope over [-1, 1]: half at either end (A. Atkinson, A. Donev, 1992)."""
    x = np.linspace(-1.0, 1.0, 21)
    each = information(np.stack([np.ones(21), x], axis=1)[:, None], np.ones(2))
    found = allotted(each, np.zeros((2, 2)), 2, [(np.arange(21), 8)])
    assert found[[0, -1]].tolist() == [4, 4]


@pytest.mark.parametrize("slopes", [(1.0, 3.0), (2.0, 2.0), (5.0, 1.0)])
def test_repeats_make_the_sum_of_variances_least(slopes):
    """Two experiments that show one unknown each: the sum of 1 / (w m^2) is least for w as the inverse of m."""
    each = np.array([np.diag([slopes[0] ** 2, 0.0]), np.diag([0.0, slopes[1] ** 2])])
    found = allotted(each, np.zeros((2, 2)), 2, [(np.arange(2), 120)])
    inverse = 1.0 / np.array(slopes)
    assert found / 120 == pytest.approx(inverse / inverse.sum(), abs=1 / 120)
