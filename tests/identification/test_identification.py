"""Estimates from shapes at rest and vibrations, their uncertainty, and what the data cannot see."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate, Poses, Reading
from continuum_grasp.base import InputError, SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Fidelity
from tests.declared import assert_declared
from tests.identification_cases import (
    DENSITY,
    LENGTH,
    STIFFNESS,
    bare_scene,
    bent,
    block_for,
    coverage,
    elastica,
    frequency,
    loaded_scene,
    rung,
    weighed,
)
from tests.rods import rod_scene

LOADS = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def tip_data(noise=0.0, seed=0, **truth):
    """Positions of the tip under each load, from the exact rod."""
    tips = np.array([elastica(load, **truth) for load in LOADS])
    tips += noise * np.random.default_rng(seed).standard_normal(tips.shape)
    return tips


def poses(tips, **keys):
    return weighed(tips, LOADS, **keys)


# -- shapes at rest --------------------------------------------------------------------------------------------------


@pytest.mark.deep
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


PLANES = (0.2, 1.4, 2.9, -1.7)
MOMENTS = np.array([0.005, 0.01, 0.02])


def bent_in(plane: float, lean=(0.3, -0.2), shift=(0.004, 0.007), **keys) -> Poses:
    """Bends of the rod without weight under moments at its tip, which leans, before a camera that is shifted."""
    along = np.array([math.cos(plane), math.sin(plane)])
    curvature = MOMENTS / STIFFNESS + 0.05 + along @ lean
    y = along @ shift + (1.0 - np.cos(curvature * LENGTH)) / curvature
    readings = [Reading("bend", curvature * LENGTH), Reading("y", y)]
    return Poses(readings, {"tip_moment": MOMENTS}, name=f"at {plane:g}", plane=plane, **keys)


def test_a_lean_and_a_shift_across_the_finger_from_bends_in_several_planes():
    """An arc in closed form; what is found predicts a plane that was not fitted, and turned planes turn the vectors."""
    across = [Estimate(name="rest_curvature", per="plane"), Estimate(name="base_y", per="plane")]
    held = bent_in(1.0, fitted=[False] * 3)
    scene = bare_scene(1, "arc")
    fit = cg.identify(scene, [*map(bent_in, PLANES), held], parameters=["bending_stiffness", *across])
    names = ("bending_stiffness", "rest_curvature", "base_y", "rest_curvature at 0 deg", "rest_curvature at 90 deg")
    assert fit.names == (*names, "base_y at 0 deg", "base_y at 90 deg")
    assert fit.values == pytest.approx([STIFFNESS, 0.05, 0.0, 0.3, -0.2, 0.004, 0.007], rel=1e-6, abs=1e-9)
    assert np.abs(fit.residuals).max() < 1e-8
    assert fit.apply().finger.rest_curvature == pytest.approx(0.05)  # the lean is of no one plane
    with pytest.raises(InputError, match="rest_curvature is estimated per plane: state the plane of poses"):
        cg.identify(scene, bent([0.01], [0.1]), parameters=across)


def test_estimates_in_a_scene_are_those_of_its_model():
    """The scene with estimates in it has the nominal parameters that were estimated; a clamp angle is added."""
    rod = {"length": LENGTH, "diameter": 0.002, "density": 6000.0, "youngs_modulus": 60e9}
    masses = [{"at": 0.1, "mass": 0.01}, {"at": LENGTH, "mass": 0.02}]
    finger = {"masses": masses, "tip_body": {"mass": 0.01, "rotary_inertia": 1e-6}}
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
        "tip_body_across": 0.002,
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
    strip = {"thickness": 1e-3, "width": 0.012, "density": DENSITY / 1.2e-5, "youngs_modulus": 3e10}
    scene = loaded_scene().changed({"finger.rod": {"length": LENGTH, "rotary_inertia": 0.0, **strip}})
    fit = cg.identify(scene, poses(tip_data()), parameters=["youngs_modulus"])
    assert fit["youngs_modulus"] == pytest.approx(STIFFNESS / 1e-12, rel=1e-4)
    assert fit.units == ("Pa",)


def test_holdout_is_predicted_and_not_fitted():
    tips = tip_data()
    tips[2:4] += 0.01
    fitted = np.array([True, True, False, False, True, True, True])
    fit = cg.identify(loaded_scene(), poses(tips, fitted=fitted), parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-4)
    (error,) = fit.holdout_errors
    assert (error.count, error.rms) == (4, pytest.approx(0.01, rel=1e-2))
    assert_declared(fit)
    assert fit.to_pandas().loc["bending_stiffness", ["unit", "values"]].to_list() == ["N m2", fit.values[0]]
    assert fit.to_pandas("measurement")["fitted"].sum() == fit.fitted.sum()


@pytest.mark.deep
def test_known_deviations_weight_unlike_data():
    """Angles with a tenth of the weight change the estimate as weighted least squares of both estimates says."""
    tips = tip_data(noise=1e-3, seed=3)
    readings = [Reading("y", tips[:, 1], sigma=1e-3), Reading("bend", tips[:, 2] + 0.05, sigma=1.0)]
    conditions = {"load_1_y": -LOADS}
    both = cg.identify(loaded_scene(), Poses(readings, conditions), parameters=["bending_stiffness"])
    alone = cg.identify(loaded_scene(), Poses(readings[:1], conditions), parameters=["bending_stiffness"])
    assert both.values == pytest.approx(alone.values, rel=1e-3)


@pytest.mark.deep
def test_data_in_another_unit_are_refused():
    data = Poses([Reading("y", 1e3 * tip_data()[:, 1])], {"load_1_y": -LOADS})
    fit = cg.identify(loaded_scene(), data, parameters=["bending_stiffness"])
    assert fit.status == "implausible"
    assert any("positions are in mm, read as m" in cause for cause in fit.causes)


@pytest.mark.deep
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


@pytest.mark.deep
def test_one_wrong_reading_is_named_and_pulls_no_more_where_it_is_left_out():
    tips = tip_data(noise=5e-4, seed=1)
    tips[1, 1] += 0.06
    plain = cg.identify(loaded_scene(), poses(tips), parameters=["bending_stiffness"])
    rest = dataclasses.replace(poses(tips), fitted=np.arange(len(tips)) != 1)
    without = cg.identify(loaded_scene(), rest, parameters=["bending_stiffness"])
    assert abs(plain.values[0] / STIFFNESS - 1.0) > 0.02
    assert any("y at tip, row 2" in warning for warning in plain.warnings)
    assert without.values[0] == pytest.approx(STIFFNESS, rel=0.01)
    assert without.intervals[0, 0] < STIFFNESS < without.intervals[0, 1]


@pytest.mark.deep
def test_intervals_from_poses_cover_the_truth_at_their_rate():
    """120 noisy copies of exact poses; the bounds are 3.3 binomial standard deviations."""
    scene, repeats = loaded_scene(), 120
    unknowns, block = block_for(scene, poses(tip_data(clamp=0.02)), ["bending_stiffness", "clamp_angle"])
    hits = coverage([block], unknowns, [STIFFNESS, 0.02], 2e-3, repeats)
    assert np.abs(hits / repeats - 0.95).max() < 3.3 * math.sqrt(0.95 * 0.05 / repeats)


# -- vibrations ------------------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_stiffness_and_damping_from_closed_forms():
    """Kelvin-Voigt damping gives the decay rate eta omega^2 / (2 EI)."""
    eta = 3e-5
    pulsation = np.array([2.0 * math.pi * frequency(mode) for mode in (1, 2)])
    decay = 0.5 * eta * pulsation**2 / STIFFNESS
    damped = np.sqrt(pulsation**2 - decay**2) / (2.0 * math.pi)
    fit = cg.identify(
        bare_scene(),
        rung(*damped, decays=decay),
        parameters=[Estimate(name="bending_stiffness", start=0.01), "material_damping"],
    )
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=3e-3)
    assert fit["material_damping"] == pytest.approx(eta, rel=3e-3)


@pytest.mark.deep
def test_repeats_that_agree_better_than_their_sets_are_named():
    rng = np.random.default_rng(0)
    sets = [rung(frequency(1) + at + 1e-4 * rng.standard_normal(6)) for at in (-0.01, 0.0, 0.015)]
    fit = cg.identify(bare_scene(), sets, parameters=["bending_stiffness"])
    assert any("sets differ by more than their repeats" in warning for warning in fit.warnings)
    alike = [rung(frequency(1) + 1e-2 * rng.standard_normal(6)) for _ in range(3)]
    assert cg.identify(bare_scene(), alike, parameters=["bending_stiffness"]).warnings == ()


@pytest.mark.deep
def test_frequencies_tell_stiffness_over_density_only():
    data = rung(frequency(1) * np.array([1.001, 1.0]), frequency(2) * np.array([1.0, 0.998]))
    both = cg.identify(bare_scene(), data, parameters=["bending_stiffness", "linear_density"])
    assert np.all(np.isinf(both.deviations))
    assert np.all(np.isinf(both.intervals))
    assert any("only a combination of bending_stiffness and linear_density" in one for one in both.warnings)
    assert both.singular_values[1] < 1e-9 * both.singular_values[0]
    assert both.values[0] / both.values[1] == pytest.approx(STIFFNESS / DENSITY, rel=5e-3)
    one = cg.identify(bare_scene(), data, parameters=["bending_stiffness"])
    assert np.isfinite(one.deviations[0])
    assert one.warnings == ()


@pytest.mark.deep
def test_a_parameter_without_effect_is_said_so():
    fit = cg.identify(loaded_scene(), poses(tip_data(1e-3)), parameters=["bending_stiffness", "material_damping"])
    assert any("cannot see material_damping" in warning for warning in fit.warnings)
    assert np.isinf(fit.deviations[1])
    assert np.isfinite(fit.deviations[0])
    assert np.isnan(fit.correlation[0, 1])


@pytest.mark.deep
def test_as_many_numbers_as_parameters_leave_no_uncertainty_to_tell():
    fit = cg.identify(bare_scene(), rung(frequency(1)), parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert np.isinf(fit.deviations[0])
    assert any("too few to estimate" in warning for warning in fit.warnings)


@pytest.mark.deep
def test_a_bound_that_is_reached_is_named():
    limited = Estimate(name="bending_stiffness", max=0.9 * STIFFNESS)
    fit = cg.identify(loaded_scene(), poses(tip_data()), parameters=[limited])
    assert fit["bending_stiffness"] == pytest.approx(0.9 * STIFFNESS)
    assert any("at its bound" in warning for warning in fit.warnings)


def test_a_mode_that_does_not_ring_is_an_error():
    scene = bare_scene(2, finger={"damping": {"material": 1.0}})
    with pytest.raises(SolverError, match="does not ring") as caught:
        cg.identify(scene, rung(2.0), parameters=["bending_stiffness"])
    assert caught.value.status == "overdamped"


# -- wrong input -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([], "expected names of parameters"),
        ("bending_stiffness", "parameters: expected a list of Estimate or text"),
        ([3], "parameters: expected a list of Estimate or text"),
        (["youngs_modulus"], "given by its shape"),
        (["bending_stiffnes"], "did you mean 'bending_stiffness'"),
        (["gravity"], "2 entries"),
        (["drive_delay"], "needs finger.tendons"),
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
        (lambda: Poses([Reading("frequency", [1.0], of=0)]), "whole number, 1 or more"),
        (lambda: rung(-1.0), "above 0 Hz"),
        (lambda: Poses([Reading("x", [0.1], sigma=0.0)]), "above 0"),
    ],
)
def test_wrong_data_are_named(make, words):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (Poses([Reading("x", [0.3])], {"load_2_y": [0.1]}), "load_2_y"),
        (Poses([Reading("x", [0.3])], {"bending_stiffness": [0.1]}), "is both estimated and given"),
        (Poses([Reading("x", [0.3], at=2.0 * LENGTH)]), "not on the finger"),
        ([], "expected files with measurements"),
        (3, "data: expected a path or a Poses"),
        ("tip_drop.csv", "no such file"),
        (Poses([Reading("x", [0.3])], fitted=[False]), "there is no row to fit"),
    ],
)
def test_data_must_fit_the_model(data, words):
    with pytest.raises(InputError, match=words):
        cg.identify(loaded_scene(), data, parameters=["bending_stiffness"])


def test_frequencies_of_what_relaxes_are_refused():
    """A part of the stiffness follows with a lag, of which the model of small motions knows nothing."""
    law = {"finger.damping.relaxation": [{"share": 0.3, "time": 0.01}], "fidelity": {"family": "arc", "elements": 2}}
    relaxing = loaded_scene().changed(law)
    with pytest.raises(InputError, match="whose material relaxes are not predicted"):
        cg.identify(relaxing, rung(3.0), parameters=["bending_stiffness"])
