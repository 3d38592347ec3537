"""Residuals from logs of a controller: the algebra by numpy, a log of tendon friction, logs that do not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.control.log import ControlLog
from continuum_grasp.errors import InputError, NumericalError, SolverError
from continuum_grasp.identification import learn_residual
from continuum_grasp.identification.control_logs import read_logs, refuse_implausible
from continuum_grasp.identification.learning import ridge_weights
from continuum_grasp.scene.load import load
from tests.marks import few

FOLDER = Path(__file__).parents[2] / "configs/mpc"
U, Y = ("tension_1 [N]", "tension_2 [N]"), ("tip_x [m]", "tip_y [m]", "tension_1 [N]", "tension_2 [N]")


@pytest.fixture(scope="module")
def scene():
    return load(FOLDER / "learned_friction.yaml")


@pytest.fixture(scope="module")
def log() -> ControlLog:
    return read_logs([FOLDER / "learned_friction_log.csv"], U, Y, 0.01)[0]


def test_ridge_weights_are_those_of_a_least_squares_with_rows_for_the_ridge():
    rng = np.random.default_rng(0)
    factors, slopes, targets = rng.normal(size=(60, 4)), rng.normal(size=(60, 3, 2)), rng.normal(size=(60, 3))
    ridge = 0.03
    columns = np.einsum("kmn,ks->kmns", slopes, factors).reshape(180, 8)
    unit = np.sqrt(np.mean(columns**2, axis=0))

    a = np.vstack([columns / unit, np.sqrt(ridge * 180) * np.eye(8)])
    expected = np.linalg.lstsq(a, np.append(targets.ravel(), np.zeros(8)), rcond=None)[0] / unit
    assert ridge_weights(factors, slopes, targets, [ridge])[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.deep
def test_the_shipped_residual_is_what_its_log_gives_and_halves_one_step_errors_on_another_motion(scene):
    from continuum_grasp.closed_loop import run_closed_loop

    plain = scene.changed({"fidelity.residual": None, "duration": 1.5})
    fit = learn_residual(scene, [FOLDER / "learned_friction_log.csv"], holdout=[run_closed_loop(plain).log])
    assert fit.status == "learned"
    found, shipped = fit.residual, scene.fidelity.residual
    assert found.kernels == shipped.kernels
    assert found.training.ridge == shipped.training.ridge
    assert np.array(found.weights) == pytest.approx(np.array(shipped.weights), rel=1e-5, abs=1e-12)
    assert found.radius == pytest.approx(shipped.radius, rel=1e-6)
    held = fit.errors[1]
    assert held.holdout
    assert held.position_with < 0.5 * held.position
    assert held.velocity_with < 0.5 * held.velocity
    assert fit.scene.fidelity.residual is None
    assert fit.apply(scene).fidelity.residual == fit.residual
    rows = sum(one.steps for one in fit.errors)
    assert (fit.without.shape, fit.with_residual.shape, fit.distance.shape) == ((rows, 4), (rows, 4), (rows,))
    # None of what it was learned from is beyond it.
    assert fit.distance[: fit.errors[0].steps].max() == pytest.approx(1.0)


@pytest.mark.deep
def test_from_a_plant_that_is_the_model_nothing_is_learned(scene):
    from continuum_grasp.closed_loop import run_closed_loop

    own = {"fidelity": {"family": "matched_clothoid", "elements": 2}, "seed": 1}
    plain = scene.changed({"fidelity.residual": None, "duration": 6.0, "plant": own})
    fit = learn_residual(plain, [run_closed_loop(plain).log])
    assert fit.status == "nothing_learned"
    assert fit.residual is None
    assert any("nothing was learned" in text for text in fit.warnings)
    with pytest.raises(InputError, match="nothing was learned"):
        fit.apply()


def test_a_log_is_read_as_it_was_written(log, tmp_path):
    y = log.y.copy()
    y[3, :2] = np.nan
    gaps = ControlLog(log.t, log.u, y, log.u_names, log.y_names)
    (tmp_path / "log.csv").write_text(gaps.text())
    (found,) = read_logs([tmp_path / "log.csv"], U, Y, 0.01)
    assert np.array_equal(np.isnan(found.y), np.isnan(y))
    assert found.u == pytest.approx(log.u, rel=1e-6)
    assert found.t == pytest.approx(log.t)
    (tmp_path / "mm.csv").write_text(gaps.text().replace("tip_x [m]", "tip_x [mm]"))
    scaled = read_logs([tmp_path / "mm.csv"], U, Y, 0.01)[0]
    assert scaled.y[10, 0] == pytest.approx(1e-3 * log.y[10, 0], rel=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("commanded_tension_2", "tension_3"), "no column 'commanded_tension_2'"),
        (lambda text: "\n".join(text.splitlines()[::2]), "expected a row per control period of 0.01 s"),
        (lambda text: "\n".join(text.splitlines()[:300]), "expected 500 periods or more"),
        (lambda text: text.replace("\n0.05,", "\n0.053,"), "evenly spaced"),
    ],
)
def test_logs_that_do_not_fit_are_refused(scene, log, change, message, tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(change(log.text()))
    with pytest.raises(InputError, match=message):
        learn_residual(scene, [file])


def test_logs_of_nothing_or_of_another_finger_are_refused(scene, log):
    with pytest.raises(InputError, match="expected a log"):
        learn_residual(scene, [])
    with pytest.raises(InputError, match="finite commands"):
        ControlLog(log.t, np.full_like(log.u, np.nan), log.y, U, Y)
    with pytest.raises(InputError, match="u_names: expected tension_1"):
        learn_residual(scene, [ControlLog(log.t, log.u[:, :1], log.y, U[:1], Y)])
    grasped = scene.changed({"estimator": None})
    with pytest.raises(InputError, match="needs an `estimator:` section"):
        learn_residual(grasped, [log])


@pytest.mark.parametrize(
    ("change", "cause"),
    few(
        [
            (lambda u, y: (u, y * [1.0, -1.0, 1.0, 1.0]), "y points down"),
            (lambda u, y: (u, y * [1e3, 1e3, 1.0, 1.0]), "positions are in mm, read as m"),
            (lambda u, y: (u, y[:, [1, 0, 2, 3]]), "columns of x and y are swapped"),
            (lambda u, y: (u[:, ::-1], y), "swapped|numbered from the other side|x points to the other side"),
            (lambda u, y: (u, y), None),
        ],
        0,
    ),
)
def test_logs_with_a_slip_are_refused_and_the_slip_is_named(scene, log, change, cause):
    part = slice(300)
    u, y = change(log.u[part], log.y[part])
    changed = ControlLog(log.t[part], u, y, U, Y, "changed")
    if cause is None:
        refuse_implausible(scene, changed, 1)
        return
    with pytest.raises(SolverError, match=f"likely cause: .*({cause})") as caught:
        refuse_implausible(scene, changed, 1)
    assert caught.value.status == "implausible"


def test_a_log_that_the_model_cannot_follow_is_refused(scene, log):
    huge = ControlLog(log.t, 1e7 * log.u, log.y, U, Y, "newtons")
    with pytest.raises((NumericalError, SolverError), match=r"newtons: |the parameters were not found"):
        learn_residual(scene, [huge])
