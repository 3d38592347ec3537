"""Estimates from shapes at rest and vibrations, their uncertainty, and what the data cannot see."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import scipy.stats

import continuum_grasp as cg
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.identification import Estimate, Frequencies, Poses, Reading, fit_damped_sine
from continuum_grasp.identification.blocks import PosesBlock, VibrationBlock
from continuum_grasp.identification.inference import infer
from continuum_grasp.identification.levenberg import least_squares
from continuum_grasp.identification.student import t_quantile
from continuum_grasp.identification.unknowns import read_unknowns
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Fidelity
from tests.identification_cases import (
    DENSITY,
    LENGTH,
    ROD,
    STIFFNESS,
    bare_scene,
    coverage,
    elastica,
    frequency,
    loaded_scene,
    slope_error,
)
from tests.rods import rod_scene

LOADS = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def tip_data(noise=0.0, seed=0, **truth):
    """Positions of the tip under each load, from the exact rod."""
    tips = np.array([elastica(load, **truth) for load in LOADS])
    tips += noise * np.random.default_rng(seed).standard_normal(tips.shape)
    return tips


def poses(tips, **keys):
    return Poses([Reading("x", tips[:, 0]), Reading("y", tips[:, 1])], {"load_1_y": -LOADS}, **keys)


# -- the search ------------------------------------------------------------------------------------------------------


def rosenbrock(v):
    residuals = np.array([10.0 * (v[1] - v[0] ** 2), 1.0 - v[0]])
    return residuals, np.array([[-20.0 * v[0], 10.0], [-1.0, 0.0]])


def search(function, start, lower=-np.inf, upper=np.inf):
    start = np.array(start, dtype=float)
    bounds = np.broadcast_to(lower, start.shape).astype(float), np.broadcast_to(upper, start.shape).astype(float)
    return least_squares(function, start, *bounds, np.ones(start.size), iterations=300)


def test_search_finds_the_minimum_of_a_valley():
    found = search(rosenbrock, [-1.2, 1.0])
    assert found.converged
    assert found.values == pytest.approx([1.0, 1.0], abs=1e-7)


def test_search_stops_at_a_bound_with_the_best_of_the_rest():
    found = search(rosenbrock, [0.2, 0.3], upper=[0.5, np.inf])
    assert found.converged
    assert found.values == pytest.approx([0.5, 0.25], abs=1e-7)


def test_search_takes_shorter_steps_where_the_model_fails():
    def fails(v):
        if v[0] > 2.0:
            raise SolverError("beyond", status="beyond")
        return np.array([v[0] ** 2 - 3.9]), np.array([[2.0 * v[0]]])

    assert search(fails, [0.1]).values == pytest.approx([math.sqrt(3.9)])


def test_search_of_unseen_directions_leaves_them():
    found = search(
        lambda v: (np.array([v[0] + v[1] - 2.0, 0.0]), np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])), [0, 0, 7]
    )
    assert found.converged
    assert found.values.sum() == pytest.approx(9.0)
    assert found.values[2] == 7.0


@pytest.mark.parametrize("freedom", [1, 2, 3, 7, 30, 1000])
@pytest.mark.parametrize("probability", [0.025, 0.6, 0.975, 0.9995])
def test_quantiles_of_student(freedom, probability):
    assert t_quantile(probability, freedom) == pytest.approx(scipy.stats.t.ppf(probability, freedom), rel=1e-9)


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
    block = VibrationBlock(scene, Frequencies([1, 2], [2.0, 20.0], [0.1, 1.0], {"load_1_y": [-0.1, 0.1]}), unknowns)
    values = np.array([STIFFNESS, DENSITY, 0.004, 0.3, 0.02, 2e-4])
    assert slope_error(block, values, np.array([one.typical for one in unknowns])).max() < 1e-7


def test_derivatives_behind_friction_and_deadband():
    tendons = {"tendons": {"offset": 0.02, "max_tension": 10.0, "friction": 0.1}}
    scene = rod_scene(ROD, "clothoid", finger=tendons, gravity=(0.0, 0.0))
    unknowns = read_unknowns(scene, ["bending_stiffness", "tendon_friction", "tension_deadband", "tendon_offset"])
    conditions = {"tension_1": [3.0, 0.5, 0.5], "tension_2": [0.5, 4.0, 0.7]}
    block = PosesBlock(scene, Poses([Reading("bend", [0.5, -0.5, 0.0])], conditions), unknowns)
    values = np.array([0.03, 0.12, 0.4, 0.02])
    assert slope_error(block, values, np.array([0.03, 0.1, 0.1, 0.02])).max() < 1e-5


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_base_angle_at_run_time_is_the_folded_one(family):
    scene = loaded_scene(2, fidelity={"family": family})
    runtime = FingerModel(scene, parameters=("base_angle",))
    base = scene.finger.base.model_copy(update={"angle": 0.7})
    folded = FingerModel(scene.model_copy(update={"finger": scene.finger.model_copy(update={"base": base})}))
    q, w = np.linspace(0.4, -0.3, runtime.n), np.array([0.1, -0.2])
    x = np.concatenate([q, 0.5 * q])
    for name, given in (("forward_dynamics", (x, 0.0, w)), ("position", (q, 0.0, 0.3)), ("orientation", (q, 0.0, 0.3))):
        ours, expected = getattr(runtime, name)(*given, 0.7), getattr(folded, name)(*given, [])
        assert np.array(ours) == pytest.approx(np.array(expected), rel=1e-12, abs=1e-14)


# -- shapes at rest --------------------------------------------------------------------------------------------------


def test_stiffness_clamp_and_rest_curvature_from_the_exact_rod():
    tips = tip_data(clamp=0.03, rest=0.2)
    fit = cg.identify(
        loaded_scene(),
        poses(tips),
        parameters=[Estimate(name="bending_stiffness", start=0.05), "clamp_angle", "rest_curvature"],
    )
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert fit["clamp_angle"] == pytest.approx(0.03, abs=1e-3)
    assert fit["rest_curvature"] == pytest.approx(0.2, abs=0.01)
    assert fit.status == "converged"
    assert np.abs(fit.residuals).max() < 2e-5


def test_estimates_in_a_scene_are_those_of_its_model():
    """The scene with estimates in it has the nominal parameters that were estimated; a clamp angle is added."""
    rod = {"length": LENGTH, "diameter": 0.002, "density": 6000.0, "youngs_modulus": 60e9}
    finger = {"masses": [{"at": 0.1, "mass": 0.01}, {"at": LENGTH, "mass": 0.02}]}
    scene = rod_scene(rod, "clothoid", finger=finger)
    fit = cg.identify(loaded_scene(), poses(tip_data()), parameters=["bending_stiffness"])
    targets = {
        "bending_stiffness": 0.05,
        "linear_density": 0.02,
        "material_damping": 2e-4,
        "per_arc_damping": 1e-4,
        "rest_curvature": 0.3,
        "tip_mass": 0.03,
        "mass_0": 0.005,
        "base_angle": 0.1,
    }
    given = tuple((name, 1.0, name == "base_angle") for name in targets)
    fit = dataclasses.replace(fit, targets=given, values=np.array(list(targets.values())), names=tuple(targets))
    changed = FingerModel(fit.apply(scene), parameters=(*targets, "rotary_inertia"))
    expected = {**targets, "base_angle": scene.finger.base.angle + 0.1}
    assert changed.p_nominal[:-1] == pytest.approx(list(expected.values()))
    assert changed.p_nominal[-1] == pytest.approx(scene.finger.rod.inertia_per_length)


def test_a_tolerance_chooses_the_model():
    scene = loaded_scene().model_copy(update={"fidelity": Fidelity(tolerance=1e-3)})
    fit = cg.identify(scene, poses(tip_data()), parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=5e-3)


def test_youngs_modulus_is_stiffness_over_second_moment():
    fit = cg.identify(
        loaded_scene(), poses(tip_data()), parameters=[Estimate(name="youngs_modulus", second_moment=1e-13)]
    )
    assert fit["youngs_modulus"] == pytest.approx(STIFFNESS / 1e-13, rel=1e-4)
    assert fit.units == ("Pa",)


def test_holdout_is_predicted_and_not_fitted():
    tips = tip_data()
    tips[2:4] += 0.01
    fitted = np.array([True, True, False, False, True, True, True])
    fit = cg.identify(loaded_scene(), poses(tips, fitted=fitted), parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-4)
    (error,) = fit.holdout_errors
    assert (error.count, error.rms) == (4, pytest.approx(0.01, rel=1e-2))


def test_known_deviations_weight_unlike_data():
    """Angles with a tenth of the weight change the estimate as weighted least squares of both estimates says."""
    tips = tip_data(noise=1e-3, seed=3)
    readings = [Reading("y", tips[:, 1], sigma=1e-3), Reading("bend", tips[:, 2] + 0.05, sigma=1.0)]
    conditions = {"load_1_y": -LOADS}
    both = cg.identify(loaded_scene(), Poses(readings, conditions), parameters=["bending_stiffness"])
    alone = cg.identify(loaded_scene(), Poses(readings[:1], conditions), parameters=["bending_stiffness"])
    assert both.values == pytest.approx(alone.values, rel=1e-3)


def test_data_in_another_unit_are_doubted():
    data = Poses([Reading("y", 1e3 * tip_data()[:, 1])], {"load_1_y": -LOADS})
    fit = cg.identify(loaded_scene(), data, parameters=["bending_stiffness"])
    assert any("check units, signs and conditions" in warning for warning in fit.warnings)


def test_unknown_deviations_come_from_the_residuals():
    tips = np.array([elastica(load) for load in np.linspace(0.0, 0.6, 40)])
    rng = np.random.default_rng(5)
    readings = [
        Reading("y", tips[:, 1] + 2e-3 * rng.standard_normal(40)),
        Reading("bend", tips[:, 2] + 5e-2 * rng.standard_normal(40)),
    ]
    data = Poses(readings, {"load_1_y": -np.linspace(0.0, 0.6, 40)})
    fit = cg.identify(loaded_scene(), data, parameters=["bending_stiffness"])
    assert fit.sigma[0] == pytest.approx(2e-3, rel=0.35)
    assert fit.sigma[1] == pytest.approx(5e-2, rel=0.35)


def test_one_wrong_reading_is_named_and_does_not_pull_a_robust_fit():
    tips = tip_data(noise=5e-4, seed=1)
    tips[1, 1] += 0.06
    plain = cg.identify(loaded_scene(), poses(tips), parameters=["bending_stiffness"])
    robust = cg.identify(loaded_scene(), poses(tips), parameters=["bending_stiffness"], loss="huber")
    assert abs(plain.values[0] / STIFFNESS - 1.0) > 0.02
    assert robust.values[0] == pytest.approx(STIFFNESS, rel=0.01)
    assert robust.intervals[0, 0] < STIFFNESS < robust.intervals[0, 1]
    assert any("y at tip, row 2" in warning for warning in robust.warnings)


def test_intervals_from_poses_cover_the_truth_at_their_rate():
    """200 noisy copies of exact poses; the bounds are 3.3 binomial standard deviations."""
    scene, repeats = loaded_scene(), 200
    unknowns = read_unknowns(scene, ["bending_stiffness", "clamp_angle"])
    blocks = [PosesBlock(scene, poses(tip_data(clamp=0.02)), unknowns)]
    hits = coverage(blocks, unknowns, [STIFFNESS, 0.02], 2e-3, repeats)
    assert np.abs(hits / repeats - 0.95).max() < 3.3 * math.sqrt(0.95 * 0.05 / repeats)


# -- vibrations ------------------------------------------------------------------------------------------------------


def test_stiffness_and_damping_from_closed_forms():
    """Kelvin-Voigt damping gives the decay rate eta omega^2 / (2 EI)."""
    eta = 3e-5
    pulsation = np.array([2.0 * math.pi * frequency(mode) for mode in (1, 2)])
    decay = 0.5 * eta * pulsation**2 / STIFFNESS
    damped = np.sqrt(pulsation**2 - decay**2) / (2.0 * math.pi)
    fit = cg.identify(
        bare_scene(),
        Frequencies([1, 2], damped, decay),
        parameters=[Estimate(name="bending_stiffness", start=0.01), "material_damping"],
    )
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=3e-3)
    assert fit["material_damping"] == pytest.approx(eta, rel=3e-3)


def test_repeats_that_agree_better_than_their_sets_are_named():
    rng = np.random.default_rng(0)
    sets = [Frequencies([1] * 6, frequency(1) + at + 1e-4 * rng.standard_normal(6)) for at in (-0.01, 0.0, 0.015)]
    fit = cg.identify(bare_scene(), sets, parameters=["bending_stiffness"])
    assert any("sets differ by more than their repeats" in warning for warning in fit.warnings)
    alike = [Frequencies([1] * 6, frequency(1) + 1e-2 * rng.standard_normal(6)) for _ in range(3)]
    assert cg.identify(bare_scene(), alike, parameters=["bending_stiffness"]).warnings == ()


def test_frequencies_tell_stiffness_over_density_only():
    data = Frequencies([1, 2, 1, 2], [1.001 * frequency(1), frequency(2), frequency(1), 0.998 * frequency(2)])
    both = cg.identify(bare_scene(), data, parameters=["bending_stiffness", "linear_density"])
    assert np.all(np.isinf(both.deviations))
    assert np.all(np.isinf(both.intervals))
    assert any("only a combination of bending_stiffness and linear_density" in one for one in both.warnings)
    assert both.singular_values[1] < 1e-9 * both.singular_values[0]
    assert both.values[0] / both.values[1] == pytest.approx(STIFFNESS / DENSITY, rel=5e-3)
    one = cg.identify(bare_scene(), data, parameters=["bending_stiffness"])
    assert np.isfinite(one.deviations[0])
    assert one.warnings == ()


def test_a_parameter_without_effect_is_said_so():
    fit = cg.identify(loaded_scene(), poses(tip_data(1e-3)), parameters=["bending_stiffness", "material_damping"])
    assert any("cannot see material_damping" in warning for warning in fit.warnings)
    assert np.isinf(fit.deviations[1])
    assert np.isfinite(fit.deviations[0])
    assert np.isnan(fit.correlation[0, 1])


def test_as_many_numbers_as_parameters_leave_no_uncertainty_to_tell():
    fit = cg.identify(bare_scene(), Frequencies([1], [frequency(1)]), parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert np.isinf(fit.deviations[0])
    assert any("nothing is left" in warning for warning in fit.warnings)


def test_a_bound_that_is_reached_is_named():
    limited = Estimate(name="bending_stiffness", max=0.9 * STIFFNESS)
    fit = cg.identify(loaded_scene(), poses(tip_data()), parameters=[limited])
    assert fit["bending_stiffness"] == pytest.approx(0.9 * STIFFNESS)
    assert any("at its bound" in warning for warning in fit.warnings)


def test_a_mode_that_does_not_ring_is_an_error():
    scene = rod_scene(ROD, elements=2, gravity=(0.0, 0.0), finger={"damping": {"material": 1.0}})
    with pytest.raises(SolverError, match="does not ring") as caught:
        cg.identify(scene, Frequencies([1], [2.0]), parameters=["bending_stiffness"])
    assert caught.value.status == "overdamped"


# -- ring-downs ------------------------------------------------------------------------------------------------------


def test_damped_sine_is_recovered_within_its_deviations():
    t = np.arange(0.0, 6.0, 0.01)
    clean = 0.4 * np.exp(-0.3 * t) * np.cos(2.0 * math.pi * 3.05 * t + 0.7) + 0.2 - 0.03 * t
    rng, scores = np.random.default_rng(2), []
    for _ in range(60):
        found = fit_damped_sine(t, clean + 0.02 * rng.standard_normal(t.size))
        scores.append([(found.frequency - 3.05) / found.deviations[0], (found.decay_rate - 0.3) / found.deviations[1]])
    assert np.abs(np.mean(scores, axis=0)).max() < 4.0 / math.sqrt(60)
    assert np.abs(np.std(scores, axis=0) - 1.0).max() < 4.0 / math.sqrt(120)
    exact = fit_damped_sine(t + 2.0, clean)
    assert (exact.frequency, exact.decay_rate) == pytest.approx((3.05, 0.3), rel=1e-8)
    assert exact.damping_ratio == pytest.approx(0.3 / math.hypot(0.3, 2.0 * math.pi * 3.05))


def test_noise_alone_is_no_vibration():
    t = np.arange(0.0, 5.0, 0.01)
    with pytest.raises(SolverError, match="no damped vibration"):
        fit_damped_sine(t, np.random.default_rng(0).standard_normal(t.size))


# -- wrong input -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([], "expected the names"),
        ("bending_stiffness", "expected a list of names"),
        ([3], "expected a name or an Estimate"),
        (["youngs_modulus"], "second_moment"),
        (["bending_stiffnes"], "did you mean bending_stiffness"),
        (["gravity"], "2 entries"),
        (["tension_deadband"], "needs finger.tendons"),
        (["clamp_angle", "base_angle"], "same parameter"),
        ([Estimate(name="bending_stiffness", start=1.0, max=0.5)], "outside"),
    ],
)
def test_wrong_parameters_are_named(names, words):
    with pytest.raises(InputError, match=words):
        cg.identify(loaded_scene(), poses(tip_data()), parameters=names)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Poses([]), "at least one"),
        (lambda: Poses([Reading("z", [0.1])]), "expected one of x, y, angle, bend"),
        (lambda: Poses([Reading("x", [0.1, math.nan])]), "finite"),
        (lambda: Poses([Reading("x", [0.1, 0.2])], {"load_1_y": [0.1]}), "2 numbers"),
        (lambda: Frequencies([0], [1.0]), "whole numbers from 1"),
        (lambda: Frequencies([1], [-1.0]), "above 0 Hz"),
        (lambda: Poses([Reading("x", [0.1], sigma=0.0)]), "positive"),
    ],
)
def test_wrong_data_are_named(make, words):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (Poses([Reading("x", [0.3])], {"load_2_y": [0.1]}), "load_2_y"),
        (Poses([Reading("x", [0.3])], {"bending_stiffness": [0.1]}), "is to be estimated, and given"),
        (Poses([Reading("x", [0.3], at=2.0 * LENGTH)]), "not on the finger"),
        ([], "expected measurements"),
        (3, "expected Poses"),
        ("tip_drop.csv", "give arrays for a scene"),
        (Poses([Reading("x", [0.3])], fitted=[False]), "no row is to be fitted"),
    ],
)
def test_data_must_fit_the_model(data, words):
    with pytest.raises(InputError, match=words):
        cg.identify(loaded_scene(), data, parameters=["bending_stiffness"])
