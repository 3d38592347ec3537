"""The estimator against filters, Riccati solutions and statistics that are not its own."""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from scipy.stats import chi2

from continuum_grasp.base import InputError
from continuum_grasp.control import Anomaly, Estimator, MeasurementVerdict
from tests.control_cases import Reality, hand_scene, sensed_rod_scene
from tests.marks import few


@lru_cache
def rod(precision="double", delay=0.0, substeps=None) -> Estimator:
    scene = sensed_rod_scene({"delay": delay})
    return Estimator(explicit(scene, substeps), precision=precision)


@lru_cache
def hand() -> Estimator:
    asked = {"measured": {"tip": 3e-4, "tension": 0.1}, "disturbances": {"tip_moment": 0.02}, "delay": 0.02}
    return Estimator(explicit(hand_scene(estimator=asked)))


def explicit(scene, substeps=None):
    """With the steps that ``Textbook`` takes."""
    return scene.changed({"controller.horizon.method": "rk4", "controller.horizon.substeps": substeps})


class Textbook:
    """An extended Kalman filter in numpy: Runge-Kutta steps, derivatives by differences, all measurements at once."""

    def __init__(self, estimator: Estimator, rate, outputs) -> None:
        s = estimator.settings
        self.rate, self.outputs, self.s = rate, outputs, s
        self.h = estimator.period / s["substeps"]
        self.z = np.concatenate([estimator.first, np.zeros(len(estimator.names) - len(estimator.first))])
        self.P = np.diag(s["initial"])

    def move(self, z, u, half=False):
        """A Runge-Kutta step, or its continuous extension half-way."""
        f, h = self.rate, self.h
        k1 = f(z, u)
        k2 = f(z + h / 2 * k1, u)
        k3 = f(z + h / 2 * k2, u)
        k4 = f(z + h * k3, u)
        if half:
            return z + h * (5 * k1 + 4 * k2 + 4 * k3 - k4) / 24
        return z + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6

    def predict(self, u):
        noise = np.diag(self.s["noise"])
        for _ in range(self.s["substeps"]):
            f = slope(lambda z: self.move(z, u), self.z)
            g = slope(lambda z: self.move(z, u, half=True), self.z)
            added = self.h / 6 * (f @ noise @ f.T + 4 * g @ noise @ g.T + noise)
            self.z, self.P = self.move(self.z, u), f @ self.P @ f.T + added

    def update(self, y):
        h = slope(lambda z: self.outputs(z), self.z)
        s = h @ self.P @ h.T + np.diag(self.s["variance"])
        gain = self.P @ h.T @ np.linalg.inv(s)
        self.z = self.z + gain @ (self.s["mixing"] @ y - self.outputs(self.z))
        rest = np.eye(len(self.z)) - gain @ h
        self.P = rest @ self.P @ rest.T + gain @ np.diag(self.s["variance"]) @ gain.T


def slope(function, z, step=2e-3):
    """Derivative by central differences of order 6, per entry on the scale of one."""
    weights = ((1, 45 / 60), (2, -9 / 60), (3, 1 / 60))
    columns = []
    for e in np.eye(len(z)):
        columns.append(sum(w * (function(z + k * step * e) - function(z - k * step * e)) for k, w in weights) / step)
    return np.stack(columns, axis=1)


def numbers(function: ca.Function):
    return lambda *given: np.array(function(*given)).ravel()


def rod_truth():
    """Motion and measurements of the rod, with disturbances put into the parameters by hand."""
    model = rod().prediction
    dynamics, tip = numbers(model.dynamics), numbers(model.tip)
    nominal = np.array(model.p_nominal)
    names = list(model.p_names)

    def full(z):
        p = nominal.copy()
        p[names.index("tip_x [N]")] += z[4]
        p[names.index("tip_y [N]")] += z[5]
        p[names.index("bending_stiffness [N m2]")] *= 1 + z[6]
        return p

    sections = model.sections((0.3, 0.6))
    return (
        lambda z, u: np.concatenate([dynamics(z[:4], u, full(z)), np.zeros(3)]),
        lambda z: np.concatenate([tip(z[:4], 0.0, full(z)), np.array(sections(z[:4], 0.0, full(z))[1]).ravel()]),
    )


def hand_truth():
    model = hand().prediction
    dynamics, tip = numbers(model.dynamics), numbers(model.tip)
    return (
        lambda z, u: np.append(dynamics(z[:6], u, z[6:]), 0.0),
        lambda z: np.append(tip(z[:6], [0.0, 0.0], z[6:]), z[4] / 0.005),
    )


@pytest.mark.parametrize(("make", "truth", "delay"), [(rod, rod_truth, 0), (hand, hand_truth, 2)])
def test_it_is_the_extended_kalman_filter(make, truth, delay):
    estimator = make()
    book, rng = Textbook(estimator, *truth()), np.random.default_rng(1)
    applied = rng.uniform(1.0, 4.0, (8, estimator.prediction.nu)) / (1.0 if delay else 40.0)
    estimator.reset(u=applied[0])
    scale = np.sqrt(estimator.settings["initial"])
    for k in range(8):
        if k:
            book.predict(applied[max(k - delay, 0)])
        compared = book.outputs(book.z) + rng.standard_normal(len(book.s["variance"])) * np.sqrt(book.s["variance"])
        y = compared if make is rod else np.array([*compared[:2], 5.0 + compared[2], 5.0])
        book.update(y)
        found = estimator.step(y, applied[k])
        assert (found.then - book.z) / scale == pytest.approx(0.0, abs=1e-9)
        assert (found.covariance - book.P) / np.outer(scale, scale) == pytest.approx(0.0, abs=1e-9)


def record(estimator, periods, seed, split=20):
    """States, measurements and inputs of a motion with the noise that the estimator reckons with."""
    rate, outputs = rod_truth()
    rng, s = np.random.default_rng(seed), estimator.settings
    z = np.sqrt(s["initial"]) * rng.standard_normal(7) * [1, 1, 1, 1, 0, 0, 0]
    inputs = 0.05 * np.sin(0.3 * np.arange(periods))[:, None]
    states, measured, h = [], [], estimator.period / split
    for k in range(periods):
        states.append(z)
        measured.append(outputs(z) + np.sqrt(s["variance"]) * rng.standard_normal(4))
        for _ in range(split):
            k1 = rate(z, inputs[k])
            z = z + h * rate(z + h / 2 * k1, inputs[k]) + np.sqrt(h * s["noise"]) * rng.standard_normal(7)
    return np.array(states), np.array(measured), inputs


@lru_cache
def motion():
    return record(rod(), 60, seed=5)


def run(estimator, measured, inputs):
    estimator.reset(u=inputs[0])
    return [estimator.step(y, inputs[max(k - 1, 0)]) for k, y in enumerate(measured)]


def test_its_errors_are_as_large_as_it_says():
    states, measured, inputs = motion()
    found = run(rod(), measured, inputs)
    innovations = sum(float(np.sum(f.innovation**2 / f.innovation_variance)) for f in found)
    assert chi2.ppf(0.001, 4 * 60) < innovations < chi2.ppf(0.999, 4 * 60)
    errors = [(f.z - z) @ np.linalg.solve(f.covariance, f.z - z) for f, z in zip(found, states, strict=True)]
    # Errors follow one another; every tenth is as good as independent.
    assert chi2.ppf(0.001, 7 * 6) < sum(errors[9::10]) < chi2.ppf(0.999, 7 * 6)


def test_a_known_delay_is_made_up_for():
    late, prompt = rod(delay=0.02, substeps=8), rod(substeps=8)
    plant = Reality(prompt.scene, prompt.first)
    rng = np.random.default_rng(3)
    inputs = np.repeat(rng.uniform(-0.1, 0.1, 20), 3)[:, None]
    states, measured = [], []
    for u in inputs:
        states.append(plant.x)
        measured.append(seen(plant))
        plant.advance(u, prompt.period)
    by_prompt = run(prompt, measured, inputs)
    late.reset(u=[0.0])
    delayed = [measured[0]] * 2 + measured
    # The late estimator's own past, two periods of no input at the start, is at rest too.
    for k in range(60):
        found = late.step(delayed[k], inputs[max(k - 1, 0)])
        if k >= 2:
            assert found.z[:4] == pytest.approx(states[k], abs=2e-3)
    assert found.then[:4] == pytest.approx(by_prompt[57].z[:4], abs=1e-6)


def seen(plant):
    angles = plant.model.sections((0.3, 0.6))(plant.x, np.zeros(1), plant.p)[1]
    return np.array([*plant.tip, *np.array(angles).ravel()])


@pytest.mark.deep
@pytest.mark.parametrize("error", few([-0.1, 0.1], 1))
def test_an_unknown_tip_force_and_stiffness_are_found(error):
    estimator = rod()
    names = list(estimator.prediction.p_names)
    p = np.array(estimator.prediction.p_nominal)
    p[names.index("tip_x [N]")], p[names.index("tip_y [N]")] = 0.04, -0.03
    p[names.index("bending_stiffness [N m2]")] *= 1 + error
    plant = Reality(estimator.scene, estimator.first, p)
    estimator.reset()
    for k in range(300):
        u = np.array([0.15 * math.sin(0.05 * k) if k < 200 else 0.1])
        plant.advance(u, estimator.period)
        found = estimator.step(seen(plant), u)
    assert found.p == pytest.approx(p, rel=0.05)


def test_a_measurement_that_is_implausible_is_rejected_and_reported():
    estimator, same = rod(), rod().save_state()
    _, measured, inputs = motion()
    run(estimator, measured, inputs)
    state = estimator.save_state()
    y = measured[-1]
    expected = {
        (np.nan, MeasurementVerdict.MISSING, Anomaly.MISSING),
        (np.inf, MeasurementVerdict.ABSURD, Anomaly.ABSURD),
        (-np.inf, MeasurementVerdict.ABSURD, Anomaly.ABSURD),
        (1e30, MeasurementVerdict.ABSURD, Anomaly.ABSURD),
        (0.7, MeasurementVerdict.OUTLIER, Anomaly.OUTLIER),
    }
    for value, verdict, anomaly in sorted(expected, key=str):
        # An outlier of one axis of the camera rejects the other one too.
        rejected = verdict == MeasurementVerdict.OUTLIER
        estimator.restore(state)
        without = estimator.step([np.nan, np.nan if rejected else y[1], *y[2:]], inputs[-1]).z
        estimator.restore(state)
        found = estimator.step([value, *y[1:]], inputs[-1])
        assert (found.verdict, found.anomaly) == ((verdict, MeasurementVerdict.ALONE if rejected else 0, 0, 0), anomaly)
        assert found.anomalies[0].startswith("tip_x: ")
        assert np.array_equal(found.z, without)
    estimator.restore(same)


def test_nothing_measured_is_a_prediction():
    estimator = rod()
    estimator.reset()
    spread = [estimator.step(None, [0.0]).std for _ in range(200)]
    assert np.all(np.isfinite(spread))
    assert spread[-1][4] == pytest.approx(0.1 * math.sqrt(1.0 + 1.99))  # its drift, from one second of it


def test_a_row_that_is_used_though_far_off_moves_the_estimate_by_five_deviations():
    """However far it is: P h 5 / sqrt(h P h' + R), by the covariance of the prediction."""
    estimator = rod()
    estimator.reset()
    for _ in range(20):
        estimator.step([0.0, 0.6, 0.0, 0.0], [0.0])
    for _ in range(4):  # the gate of the tip opens
        estimator.step([0.4, np.nan, 0.0, 0.0], [0.0])
    state = estimator.save_state()
    before = estimator.step(None, [0.0])
    moves = []
    for far in (0.3, 0.8):
        estimator.restore(state)
        found = estimator.step([far, np.nan, np.nan, np.nan], [0.0])
        assert found.verdict[0] == MeasurementVerdict.REOPENED
        moves.append(found.z - before.z)
    h = slope(rod_truth()[1], before.z)[0]
    spread = before.covariance @ h
    expected = 5.0 * spread / math.sqrt(h @ spread + estimator.settings["variance"][0])
    scale = np.sqrt(np.diag(before.covariance))
    for move in moves:
        assert (move - expected) / scale == pytest.approx(0.0, abs=1e-6)


def test_single_precision_is_close_and_stays_positive():
    _, measured, inputs = motion()
    single, double = run(rod("float"), measured, inputs), run(rod(), measured, inputs)
    scale = double[-1].std
    assert (single[-1].z - double[-1].z) / scale == pytest.approx(0.0, abs=2e-3)
    rod("float").reset()
    for _ in range(5000):
        found = rod("float").step([0.0, 0.6, 0.0, 0.0], [0.0])
    assert np.all(np.linalg.eigvalsh(found.covariance / np.outer(found.std, found.std)) > 0.0)


def test_a_saved_state_goes_on_bit_for_bit_and_two_estimators_do_not_mix():
    _, measured, inputs = motion()
    estimator, other = rod(), Estimator(rod().scene)
    whole = [f.z for f in run(estimator, measured, inputs)]
    first = run(estimator, measured[:30], inputs)[-1]
    assert np.array_equal(first.z, whole[29])
    other.restore(estimator.save_state())
    for k in range(30, 60):
        estimator.step([0.1, 0.5, 0.2, 0.2], [0.1])
        assert np.array_equal(other.step(measured[k], inputs[k - 1]).z, whole[k])


@pytest.mark.parametrize(
    "wrong",
    [
        lambda e: e.step([0.0, 1.0], [0.0]),
        lambda e: e.step(None, [np.nan]),
        lambda e: e.step(None, [0.0], p=np.full(5, np.inf)),
        lambda e: e.step(None, np.zeros(1, complex)),
        lambda e: e.reset(state=[0.0]),
        lambda e: e.restore(e.save_state()[:-1]),
        lambda e: e.restore(rod("float").save_state()),
    ],
)
def test_what_does_not_fit_is_refused(wrong):
    with pytest.raises(InputError):
        wrong(rod())


def test_an_estimate_that_is_lost_restarts_from_its_last_sound_prediction():
    """A load that no model survives for one period; twice in a row, and the filter begins at its first state."""
    estimator = rod()
    estimator.reset()
    bent = np.zeros(len(estimator.names))
    bent[:2] = 0.5, 0.4
    expected = estimator.estimation.outputs(bent, [0.1], estimator.prediction.p_nominal)[0]
    y = np.linalg.pinv(estimator.settings["mixing"]) @ np.array(expected).ravel()
    for _ in range(300):
        sound = estimator.step(y, [0.1])
    np.testing.assert_allclose(sound.then[:2], bent[:2], atol=0.05)
    lost = estimator.step(y, [1e12])
    assert Anomaly.ESTIMATE_RESTARTED in lost.anomaly
    np.testing.assert_allclose(lost.then[:2], sound.then[:2], atol=0.05)
    np.testing.assert_allclose(lost.std, np.sqrt(estimator.settings["initial"]))
    again = estimator.step(y, [1e12])
    assert Anomaly.ESTIMATE_RESTARTED in again.anomaly
    np.testing.assert_array_equal(again.then[: len(estimator.first)], estimator.first)
    for _ in range(300):
        found = estimator.step(y, [0.1])
    np.testing.assert_allclose(found.then[:2], sound.then[:2], atol=0.05)
