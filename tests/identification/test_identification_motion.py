"""Estimates from paths of the tip; from inside: slopes of predictions, and the C that paths have in common.

Estimates from paths of the tip: the paper's release with four tip masses, simulated with known parameters.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate, Reading, TipPath
from continuum_grasp.addons.identification.path_block import PathBlock, of_one_code
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.base import InputError, NumericalError
from continuum_grasp.core.source import rollout_source
from continuum_grasp.scene import Fidelity, Scene, Timing
from tests.identification_cases import (
    LENGTH,
    ROD,
    STIFFNESS,
    at_tip,
    bare_scene,
    coverage,
    path_of,
    release,
    slope_error,
)
from tests.rods import rod_scene

CONFIGS = Path(__file__).parents[2] / "configs/simulate"
GRAMS = (0, 10, 20, 50)
TRUTH = {"stiffer": 55e9, "damping": 1.3e-4, "turned": 0.01}
NAMES = ["youngs_modulus", "material_damping", "clamp_angle"]


def scene_of(grams: int, elements: int = 2, family: str = "matched_clothoid") -> Scene:
    """A release, with the nominal parameters."""
    scene = cg.load(CONFIGS / f"nitinol_release_{grams:03d}g.yaml")
    return scene.model_copy(update={"fidelity": Fidelity(family=family, elements=elements, bending_range=2.5)})


@cache
def motion(grams: int, elements: int, family: str):
    """The true motion: variable steps with error control, not the steps of the identification."""
    scene = release(scene_of(grams, elements, family), **TRUTH)
    timed = scene.model_copy(update={"time": Timing(duration=0.8, step=0.02, method="reference")})
    return cg.simulate(timed)


def paths(elements: int, noise: float, truth: tuple[int, str], grams=GRAMS) -> list[TipPath]:
    rng = np.random.default_rng(3)
    return [path_of(motion(g, *truth), scene_of(g, elements), noise, rng) for g in grams]


@pytest.mark.parametrize("instants", ["even", "uneven"])
def test_derivatives_of_paths(instants):
    scene = scene_of(20)
    t = np.linspace(0.01, 0.3, 30) if instants == "even" else np.sort(np.random.default_rng(0).uniform(0.0, 0.3, 30))
    names = [*NAMES, "tip_mass", "rest_curvature", "linear_density"]
    unknowns = read_unknowns(scene, names)
    block = PathBlock(scene, TipPath(t, at_tip(0 * t, 0 * t)), unknowns)
    values = np.array([55e9, 1.3e-4, 0.01, 0.018, 0.1, 0.021])
    assert slope_error(block, values, np.array([one.typical for one in unknowns])).max() < 1e-7


def test_sets_that_differ_in_a_mass_share_their_code():
    t = np.linspace(0.01, 0.1, 10)
    path, masses = TipPath(t, at_tip(0 * t, 0 * t)), (0, 10, 50)
    unknowns = read_unknowns(scene_of(0), NAMES)
    pairs = [(scene_of(grams), path) for grams in masses]
    blocks = [PathBlock(scene, path, unknowns, by=[1]) for scene in of_one_code(pairs, unknowns)]
    assert len({rollout_source(block._run._step) for block in blocks}) == 1
    values = np.array([55e9, 1.3e-4, 0.01])
    for (scene, _), block in zip(pairs, blocks, strict=True):
        predictions, slopes = PathBlock(scene, path, unknowns).predict(values)
        own, by_damping = block.predict(values)
        np.testing.assert_allclose(own, predictions, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(by_damping[:, 0], slopes[:, 1], rtol=1e-7, atol=1e-9 * abs(slopes[:, 1]).max())


@pytest.mark.parametrize(
    ("family", "input_", "tendons", "pose", "names"),
    [
        ("clothoid", "tensions", 0.03, "equilibrium", ["bending_stiffness", "tendon_offset"]),
        ("matched_clothoid", "tip_moment", None, "rest", ["bending_stiffness", "rest_curvature"]),
    ],
)
def test_driven_paths_are_those_of_a_simulation(family, input_, tendons, pose, names):
    """A lagged tendon, and a matched tip that moves with its moment: path and derivatives."""
    pull = {"times": [0.0, 0.1, 0.2], "values": [0.0, 1.0 if tendons else 0.02, 0.0]}
    finger = {"tendons": {"offset": 0.02, "max_tension": 9.0, "time_constant": tendons}} if tendons else {}
    scene = rod_scene(
        ROD,
        family,
        finger=finger,
        actuation={input_: [pull, 0.0] if tendons else pull},
        initial={"pose": pose},
        time={"duration": 0.3, "step": 0.001},
    )
    unknowns = read_unknowns(scene, names)
    true = cg.simulate(scene)
    t, tip = true.t[10::10], true.tip[10::10]
    block = PathBlock(scene, TipPath(t, at_tip(*tip.T)), unknowns)
    values = np.array([one.start for one in unknowns])
    assert np.abs(block.predict(values)[0].reshape(-1, 2) - tip).max() < 2e-5
    assert slope_error(block, values, np.array([one.typical for one in unknowns])).max() < 1e-7


def test_prediction_at_uneven_instants_is_the_simulated_path():
    true = motion(20, 2, "matched_clothoid")
    chosen = [3, 4, 9, 17, 18, 30]
    t, tip = true.t[chosen] + 0.0, true.tip[chosen]
    t[0] += 1e-6  # no longer on a grid
    unknowns = read_unknowns(scene_of(20), NAMES)
    block = PathBlock(scene_of(20), TipPath(t, at_tip(*tip.T)), unknowns)
    predicted = block.predict(np.array([TRUTH["stiffer"], TRUTH["damping"], TRUTH["turned"]]))[0].reshape(-1, 2)
    assert np.abs(predicted - tip).max() < 2e-5


@pytest.mark.deep
def test_finer_truth_is_recovered_from_a_far_start():
    """Truth of four free clothoids; two matched ones are 0.3 % off in stiffness, and said to miss something."""
    start = [Estimate(name="youngs_modulus", start=110e9), Estimate(name="material_damping", start=0.0), "clamp_angle"]
    fit = cg.identify(scene_of(0), paths(2, 0.0, (4, "clothoid"), (0, 20)), parameters=start)
    assert fit["youngs_modulus"] == pytest.approx(TRUTH["stiffer"], rel=0.006)
    assert fit["material_damping"] == pytest.approx(TRUTH["damping"], rel=0.08)
    assert fit["clamp_angle"] == pytest.approx(TRUTH["turned"], abs=2e-3)
    assert any("are correlated in time" in warning for warning in fit.warnings)


@pytest.mark.deep
@pytest.mark.parametrize(("elements", "said"), [(2, True), (3, False)])
def test_an_error_of_the_model_below_the_noise_is_said(elements, said):
    """Two matched clothoids move the modulus by several deviations, though noise of 1 mm hides what they miss."""
    fit = cg.identify(scene_of(20, elements), paths(elements, 1e-3, (4, "clothoid"), (20,)), parameters=NAMES)
    off = abs(fit["youngs_modulus"] - TRUTH["stiffer"]) / fit.deviations[fit.names.index("youngs_modulus")]
    assert (off > 3.0) == said
    assert any("take more elements" in warning for warning in fit.warnings) == said


@pytest.mark.deep
def test_two_arcs_pay_for_their_stiffness_with_a_wrong_modulus():
    arcs = [
        path.__class__(**{**vars(path), "scene": scene_of(g, 2, "arc")})
        for g, path in zip(GRAMS, paths(2, 0.0, (4, "clothoid")), strict=True)
    ]
    fit = cg.identify(scene_of(0, 2, "arc"), arcs, parameters=NAMES[:2])
    assert 0.85 < fit["youngs_modulus"] / TRUTH["stiffer"] < 0.95


@pytest.mark.deep
def test_intervals_cover_the_truth_at_their_rate():
    """40 noisy repeats of the four releases; the bounds are 3.3 binomial standard deviations."""
    repeats, unknowns = 40, read_unknowns(scene_of(0), NAMES)
    data = paths(2, 0.0, (2, "matched_clothoid"))
    blocks = [PathBlock(path.scene, path, unknowns) for path in data]
    hits = coverage(blocks, unknowns, [TRUTH["stiffer"], TRUTH["damping"], TRUTH["turned"]], 2e-3, repeats)
    assert np.abs(hits / repeats - 0.95).max() < 3.3 * math.sqrt(0.95 * 0.05 / repeats)


@pytest.mark.deep
def test_a_mass_that_was_not_fitted_is_predicted_within_the_noise():
    data = paths(2, 2e-3, (2, "matched_clothoid"))
    data[3] = TipPath(**{**vars(data[3]), "fitted": False})
    fit = cg.identify(scene_of(0), data, parameters=NAMES)
    (error,) = fit.holdout_errors
    assert error.rms == pytest.approx(2e-3, rel=0.25)
    assert error.count == 80
    assert fit.sigma[0] == pytest.approx(2e-3, rel=0.1)


@pytest.mark.deep
def test_tip_mass_and_stiffness_from_one_path():
    (data,) = paths(2, 1e-3, (2, "matched_clothoid"), grams=(20,))
    fit = cg.identify(scene_of(0), data, parameters=[*NAMES, Estimate(name="tip_mass", start=0.01)])
    assert fit.intervals[3, 0] < 0.020 < fit.intervals[3, 1]
    assert fit.deviations[3] < 1e-3


@pytest.mark.deep
def test_a_motion_that_is_too_stiff_is_refused():
    data = paths(2, 0.0, (2, "matched_clothoid"), grams=(0,))
    stiff = ["youngs_modulus", Estimate(name="material_damping", start=10.0)]
    scene = scene_of(0, 3, "arc")
    with pytest.raises(NumericalError, match=r"from 0 to .* s needs .* steps at these"):
        cg.identify(scene, TipPath(data[0].t, data[0].measured), parameters=stiff)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: TipPath([0.1, 0.1], at_tip(*2 * [[0.0, 0.0]])), "increase"),
        (lambda: TipPath([-0.1, 0.1], at_tip(*2 * [[0.0, 0.0]])), "increase from 0"),
        (lambda: TipPath([0.1, 0.2], []), "expected at least one reading"),
        (lambda: TipPath([0.1, 0.2], [0.0, 0.0]), "such as Reading"),
        (lambda: TipPath([0.1, 0.2], [Reading("x", [0.0, math.inf])]), "finite"),
        (lambda: TipPath([0.1, 0.2], [Reading("x", [0.0])]), "2 numbers"),
    ],
)
def test_wrong_paths_are_named(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_ranges_grow_with_the_shapes_of_a_motion():
    """A rod that a moment at its tip holds in an arc of 1.9 turns, and lets go, is predicted as it is simulated."""
    moment = {"kind": "moment", "at": LENGTH, "moment": 12.0 * STIFFNESS / LENGTH}
    initial, time = {"pose": "equilibrium", "held_by": [moment]}, {"duration": 0.05, "step": 0.005, "tolerance": 1e-6}
    scene = bare_scene(2, "clothoid", initial=initial, time=time, finger={"damping": {"material": 1e-3}})
    true = cg.simulate(scene)
    unknowns = read_unknowns(scene, ["material_damping"])
    block = PathBlock(scene, TipPath(true.t[1:], at_tip(*true.tip[1:].T)), unknowns)
    start = np.array([one.start for one in unknowns])
    assert np.abs(block.predict(start)[0].reshape(-1, 2) - true.tip[1:]).max() < 1e-4 * LENGTH
    assert not block.warnings(start)
    assert min(block.model.ranges) > max(cg.FingerModel(scene).ranges)
