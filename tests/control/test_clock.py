"""Calls that are missed, samples of varying age, and clocks that mean nothing.

Truth: the model's dynamics by scipy, with each command for as long as it acted; and plants that move on while no call
comes.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import SimulatedBench
from continuum_grasp.control import Anomaly, Controller, Estimator, Health
from continuum_grasp.core import Compiler
from continuum_grasp.model import FingerModel
from tests.control_cases import hand_scene

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

SCENE = "configs/mpc/steady_tip.yaml"


def integrated(model, x, segments):
    """State behind segments (input, duration [s])."""
    p = np.array(model.p_nominal)
    for u, duration in segments:

        def rate(_, x, u=u):
            return np.array(model.dynamics(x, u, p)).ravel()

        x = solve_ivp(rate, (0.0, duration), x, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return x


@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_the_prediction_runs_over_the_time_that_passed(delay):
    """Missed calls, whole or not, calls too early, and samples older and younger than usual, none of them read."""
    scene = hand_scene(estimator={"measured": {"tip": 3e-4}, "delay": delay})
    estimator = Estimator(scene.changed({"controller.horizon.method": "rk4", "controller.horizon.substeps": 20}))
    model, period = estimator.prediction, estimator.period
    commands = [(np.array([1.0 + 8.0 * (k % 3), 1.0 + 4.0 * (k % 2)]), t) for k, t in enumerate(TIMES)]
    found = estimator.step(None, commands[0][0])
    acted = [(estimator.scene.rest_input, delay)] if delay else []
    for k, (u, passed) in enumerate(commands):
        found = estimator.step(None, u, elapsed=passed * period, age=AGES[k % len(AGES)] * period)
        acted.append((u, passed * period))
        expected = integrated(model, estimator.first, acted)
        size = np.abs(expected).max()
        assert found.z[: model.nx] == pytest.approx(expected, abs=1e-4 * size)


TIMES = (1.0, 1.0, 4.0, 1.0, 3.4, 0.3, 1.0, 12.0, 1.0)
"""Periods between calls."""
AGES = (2.0, 1.0, 0.0, 3.0, 1.7)
"""Of samples, in periods."""


def test_a_controller_knows_where_the_finger_went_in_a_stall():
    """Truth: the plant, which goes on with the last command for eight calls, and is not seen then."""
    control = Controller(SCENE, deadline=math.inf)
    bench, model = SimulatedBench(control.scene), FingerModel(control.scene)
    control.reference(tip=(-0.06, 0.15))
    now = 0.0
    for calls in (1, 1, 1, 1, 1, 9, 1):
        seen = np.array(bench.read())
        known = seen if now < 9 * control.period else np.full(seen.size, np.nan)
        command = control.step(known, time=now)
        bench.write(command)
        for _ in range(calls):
            bench.idle()
        now += calls * control.period
    assert command.missed == pytest.approx(8.0)
    tip = np.array(model.tip(command.estimate.x[: model.n], command.u, model.p_nominal)).ravel()
    # A camera shows where the tip was 10 ms before, which moves by 60 mm in the stall.
    assert np.hypot(*(tip - seen[:2])) < 0.015


def test_a_sample_that_is_no_younger_than_the_last_is_not_used():
    estimator = Estimator(SCENE)
    y, u = [0.0, 0.18, 1.0, 1.0], [1.0, 1.0]
    estimator.step(y, u)
    anomalies = [Anomaly.OLD in estimator.step(y, u, age=0.01 * age).anomaly for age in (1, 2, 3.5, 2, 1.5, 2, 0, 1)]
    #      instants of the samples, in periods:                            0  0   -0.5   2  3.5   4  7  7
    assert anomalies == [False, True, True, False, False, False, False, True]
    for wrong in ({"age": -1.0}, {"elapsed": math.nan}, {"elapsed": -0.01}, {"age": 1e7}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            estimator.step(y, u, **wrong)


def moving(stamps, seed=0, duration=4.0):
    """Commands of a loop whose tip moves, with stalls of 0.1 to 1 s, and periods since the last stall."""
    control = Controller(SCENE, deadline=math.inf)
    bench, rng = SimulatedBench(control.scene), np.random.default_rng(seed)

    def arc(t):
        bend = 1.0 + 0.4 * math.sin(2.0 * math.pi * t)
        return -0.18 * (1.0 - math.cos(bend)) / bend, 0.18 * math.sin(bend) / bend

    control.reference(tip=arc)
    commands, since, k = [], 1000, 0
    while k * control.period < duration:
        command = control.step(bench.read(), time=7.0 + k * control.period if stamps else None)
        bench.write(command)
        commands.append((command, since))
        stall = int(rng.integers(10, 100)) if since > 20 and rng.random() < 0.05 else 0
        for _ in range(1 + stall):
            bench.idle()
        k, since = k + 1 + stall, 0 if stall else since + 1
    return control, commands


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(3))
def test_health_is_what_it_was_after_a_stall(seed):
    control, commands = moving(True, seed)
    after = [command for command, since in commands if since == 0]
    assert len(after) > 2
    assert all(Anomaly.MISSED_CALLS in command.anomaly for command in after)
    assert all(10 <= command.missed < 100 for command in after)
    assert f"{round(after[0].missed)} calls were missed" in "; ".join(after[0].anomalies)
    assert all(command.health == Health.OK for command, since in commands if since > 3)
    assert control._now == pytest.approx(4.0, abs=1.0)  # setpoints keep pace with the clock
    # without stamps the model is blamed
    assert any(command.health != Health.OK for command, _ in moving(False, seed)[1])


@pytest.mark.deep
def test_stamps_of_a_steady_loop_change_nothing():
    """With the jitter of an ordinary system, a fifth of a period."""
    inputs = []
    for stamps in (False, True):
        control = Controller(SCENE, deadline=math.inf)
        bench = SimulatedBench(control.scene)
        for k in range(50):
            stamp = 3.0 + (k + 0.2 * math.sin(k)) * control.period
            command = control.step(bench.read(), time=stamp if stamps else None)
            bench.write(command)
            bench.idle()
            inputs.append(command.u)
    assert np.array_equal(inputs[:50], inputs[50:])


@pytest.mark.parametrize(
    ("times", "named"),
    [
        ((5.0, 5.01, 4.0, 4.01), (0, 0, 1, 0)),
        ((5.0, 5.0, 5.01), (0, 1, 0)),
        ((5.0, math.nan, 5.01, 5.02), (0, 1, 0, 0)),
        ((5.0, None, 3.0, 3.01), (0, 0, 0, 0)),
        ((5.0, -math.inf, math.inf), (0, 1, 1)),
    ],
)
def test_a_clock_that_stands_still_or_goes_back_is_named(times, named):
    control = Controller(SCENE, deadline=math.inf)
    for time, expected in zip(times, named, strict=True):
        command = control.step([0.0, 0.18, 1.0, 1.0], time=time)
        assert (Anomaly.CLOCK in command.anomaly) == bool(expected)
        assert any("clock" in text or "time of the call" in text for text in command.anomalies) == bool(expected)
        assert command.missed == 0.0


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_a_clock_of_another_unit_is_named(factor, unit):
    control = Controller(SCENE, deadline=math.inf)
    bench, commands = SimulatedBench(control.scene), []
    for k in range(20):
        commands.append(control.step(bench.read(), time=factor * k * control.period))
        bench.write(commands[-1])
        bench.idle()
    assert not commands[0].missed
    named = [k for k, command in enumerate(commands) if Anomaly.CLOCK in command.anomaly]
    assert named == [*range(4, 20)]
    assert unit in "; ".join(commands[-1].anomalies)
    assert commands[-1].suspect == "call rate"
    assert f"the clock counts {unit}" in commands[-1].health_text
