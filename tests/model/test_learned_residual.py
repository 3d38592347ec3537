"""Learned residuals in models: values by numpy, derivatives by differences, and what they cost where there are none."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.scene.learned_residual import LearnedResidual
from continuum_grasp.scene.load import load
from tests.grasp_scenes import CONFIGS as GRASPS

CONFIG = Path(__file__).parents[2] / "configs/mpc/learned_friction.yaml"


@pytest.fixture(scope="module")
def scene():
    return load(CONFIG)


def with_kernels(residual: LearnedResidual) -> LearnedResidual:
    """The same with two kernels."""
    weights = tuple((*row, 2e-5, -1e-5) for row in residual.weights)
    kernels = ((0.5, -0.2, 0.1, 0.3, 0.0), (-1.0, 0.4, 0.2, -0.5, 0.8))
    return residual.replaced(kernels=kernels, weights=weights)


def forces(residual: LearnedResidual, values: np.ndarray) -> np.ndarray:
    """The forces as the class describes them, by numpy alone; complex arguments too."""
    n, k = len(residual.coordinates), len(residual.drives)
    scale = np.array(residual.scale)
    z = (values - np.array(residual.center)) / scale
    v, pulls = values[n : 2 * n], values[2 * n :] / scale[2 * n :]
    s = v / np.sqrt(v**2 + (0.3 * scale[n : 2 * n]) ** 2)
    pulls = np.sqrt(pulls**2 + 0.2**2)
    y = np.concatenate([z[:n], s, z[2 * n :]])
    kernels = []
    for center in residual.kernels:
        inside = 1.0 - np.sum((y - np.array(center)) ** 2) / residual.width**2
        kernels.append(inside**3 if inside.real > 0.0 else 0.0)
    products = [s[i] * pulls[j] for i in range(n) for j in range(k)]
    own = np.array([1.0, *z[: 2 * n], *s, *products, *kernels])
    length = (np.array(residual.metric) @ z) / residual.radius
    share = (2.25 - np.sum(length**2)) / 1.25
    share = 0.0 if share.real <= 0.0 else 1.0 if share.real >= 1.0 else share
    return share * share * (3.0 - 2.0 * share) * (np.array(residual.weights) @ own)


def features_of(residual: LearnedResidual, reach: float, seed: int = 0) -> np.ndarray:
    """Features at a distance from the logs, per their radius."""
    direction = np.random.default_rng(seed).normal(size=len(residual.center))
    metric = np.array(residual.metric)
    z = np.linalg.solve(metric, direction / np.linalg.norm(direction)) * residual.radius * reach
    return np.array(residual.center) + z * np.array(residual.scale)


def symbolic(residual: LearnedResidual) -> ca.Function:
    from continuum_grasp.model.learned_residual import residual_force

    x = ca.SX.sym("x", len(residual.center))
    found = ca.vertcat(*residual_force(residual, ca.vertsplit(x)))
    return ca.Function("force", [x], [found, ca.jacobian(found, x)])


@pytest.mark.parametrize("reach", [0.02, 0.4, 0.95, 1.2, 1.4])
def test_forces_and_their_derivatives_are_those_of_complex_steps(scene, reach):
    residual = with_kernels(scene.fidelity.residual)
    function = symbolic(residual)
    for seed in range(5):
        at = features_of(residual, reach, seed)
        value, slope = (np.array(part) for part in function(at))
        assert value.ravel() == pytest.approx(forces(residual, at), rel=1e-10, abs=1e-18)
        for k in range(len(at)):
            step = 1e-30 * residual.scale[k]
            moved = at.astype(complex)
            moved[k] += 1j * step
            assert slope[:, k] == pytest.approx(forces(residual, moved).imag / step, rel=1e-8, abs=1e-18)


@pytest.mark.parametrize("reach", [1.5 + 1e-9, 2.0, 1e3, 1e100])
def test_it_is_exactly_zero_from_one_and_a_half_times_the_radius_on(scene, reach):
    residual = with_kernels(scene.fidelity.residual)
    value, slope = symbolic(residual)(features_of(residual, reach))
    assert not np.array(value).any()
    assert not np.array(slope).any()


def test_the_model_adds_it_to_its_generalized_forces(scene):
    with_residual, without = (Prediction(scene), Prediction(scene.changed({"fidelity.residual": None})))
    rng, residual = np.random.default_rng(3), scene.fidelity.residual
    for _ in range(5):
        x = rng.normal(size=6) * [3.0, 3.0, 30.0, 30.0, 0.02, 0.1]
        values = [np.array(one.dynamics(x, [5.0, 1.0], [0.0])).ravel() for one in (with_residual, without)]
        mass = np.array(without.system.internal(x, [5.0, 1.0, 0.0], [])[0])
        assert mass @ (values[0] - values[1])[2:4] == pytest.approx(forces(residual, x[:5]), rel=1e-6, abs=1e-14)
        assert np.delete(values[0] - values[1], [2, 3]).any() is np.False_


def test_the_distance_is_one_where_it_begins_to_fade(scene):
    model = Prediction(scene)
    residual = scene.fidelity.residual
    for reach in (0.5, 1.0, 3.0):
        x = np.append(features_of(residual, reach), 0.0)
        assert float(model.residual_distance(x, [1.0, 1.0])) == pytest.approx(reach**2, rel=1e-9)
    assert Prediction(scene.changed({"fidelity.residual": None})).residual_distance is None


def test_without_one_no_instruction_is_added(scene):
    plain = scene.changed({"fidelity.residual": None})
    empty = load(CONFIG.parent / "steady_tip.yaml")
    same = plain.replaced(fidelity=empty.fidelity, parameters=empty.parameters)
    counts = [Prediction(one).dynamics.n_instructions() for one in (plain, same)]
    assert counts[0] == counts[1] < Prediction(scene).dynamics.n_instructions() < 1.2 * counts[0]


def test_at_rest_it_is_that_of_zero_rates(scene):
    control = scene.replaced(parameters=())
    given = {"finger": control.finger, "gravity": control.gravity, "fidelity": control.fidelity}
    models = [
        FingerModel(Scene(**given | {"fidelity": f}))
        for f in (control.fidelity, control.fidelity.replaced(residual=None))
    ]
    q, u = np.array([2.0, 1.5]), np.array([4.0, 1.0])
    missing = [np.array(model.statics(q, u, [], [])[0]).ravel() for model in models]
    expected = forces(control.fidelity.residual, np.array([*q, 0.0, 0.0, 0.005 * (u[0] - u[1])]))
    assert missing[1] - missing[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fidelity.elements": 3}, "it was learned for elements 0.09, 0.09 m of family matched_clothoid"),
        ({"fidelity.family": "clothoid"}, "this model has 0.09, 0.09 m of family clothoid"),
        ({"fidelity.residual.drives": ["torque_1 [N m]"]}, "neither a state of a drive nor an input"),
        ({"fidelity.residual.coordinates": ["kappa_0 [1/m]", "bend [rad]"]}, "it was learned for coordinates"),
    ],
)
def test_a_residual_of_another_model_is_refused(scene, changes, message):
    with pytest.raises(InputError, match=message.replace("[", r"\[")) as caught:
        Prediction(scene.changed(changes))
    assert str(caught.value.key).startswith("residual")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"center": [0.0]}, "center must have one entry per coordinate, rate and drive"),
        ({"weights": [[0.0]]}, "weights must be 2 rows of 9 numbers"),
        ({"metric": [[1.0] * 5] * 5}, "metric must be zero below its diagonal"),
        ({"drives": ["kappa_0 [1/m]"]}, "must differ from each other"),
        ({"radius": 0.0}, "greater than 0"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(scene, change, message):
    with pytest.raises(InputError, match=message):
        scene.changed({f"fidelity.residual.{key}": value for key, value in change.items()})


def test_a_tolerance_and_grasps_take_none(scene):
    with pytest.raises(InputError, match="tolerance: is not for controllers"):
        scene.changed({"fidelity.tolerance": 0.01})
    grasp = load(GRASPS / "mug.yaml")
    with pytest.raises(InputError, match="not for grasps"):
        grasp.changed({"fidelity.residual": scene.fidelity.residual})


def test_it_may_stand_in_a_file_of_its_own(scene, tmp_path):
    from continuum_grasp.results.yaml_text import yaml_text

    own = {"schema_version": 1, **scene.fidelity.residual.model_dump(mode="json")}
    (tmp_path / "own.yaml").write_text(yaml_text(own, exact=True))
    plain = scene.changed({"fidelity.residual": None}).model_dump(mode="json", exclude_unset=True)
    plain["fidelity"]["residual"] = "own.yaml"
    (tmp_path / "loop.yaml").write_text(yaml_text({"schema_version": 1, **plain}, exact=True))
    assert load(tmp_path / "loop.yaml").fidelity.residual == scene.fidelity.residual
    (tmp_path / "own.yaml").write_text("schema_version: 1\nrod: {}\n")
    with pytest.raises(InputError, match="expected a learned residual"):
        load(tmp_path / "loop.yaml")
    (tmp_path / "own.yaml").unlink()
    with pytest.raises(InputError, match="no such file of a learned residual") as caught:
        load(tmp_path / "loop.yaml")
    assert caught.value.line
