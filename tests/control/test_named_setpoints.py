"""Setpoints and measurements of a controller by name."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.control import Anomaly
from continuum_grasp.core import Compiler
from tests.control_cases import rod_scene

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

TIP = np.array([0.1, 0.58])
COST = {"tip": 2e3, "speed": 0.1, "effort": 0.1}


def controller(**changes) -> cg.Controller:
    scene = rod_scene(
        controller={"horizon": {"stages": 15, "stage": 0.01}, "cost": COST, "input": {"moment_max": 0.3}}, **changes
    )
    return cg.Controller(scene, deadline=math.inf)


@pytest.fixture(scope="module")
def two() -> tuple[cg.Controller, cg.Controller]:
    """One is given setpoints by name, the other all rows in order."""
    return controller(), controller()


@pytest.fixture(autouse=True)
def anew(two):
    for one in two:
        one.reset()
        one.reference(tip=None, input=None)


def rows(named: cg.Controller, tips: np.ndarray) -> np.ndarray:
    """All setpoints: those of the tip in the places that ``r_names`` gives, and zeros."""
    found = np.zeros((16, named.stages.nr))
    found[:, [named.stages.r_names.index(f"tip_{axis} [m]") for axis in "xy"]] = tips
    return found


@pytest.mark.parametrize("kind", ["point", "function", "array"])
def test_only_the_tip_moves_by_name(two, kind):
    """Three steps before the change, three after: equal commands, to the last bit."""
    named, ordered = two
    nodes = 0.01 * np.arange(16.0)
    course = np.linspace(TIP, TIP + np.array([0.05, -0.02]), 16)
    for k in range(6):
        if k == 3:
            named.reference(tip={"point": TIP, "function": lambda t: TIP + np.array([t, 2 * t]), "array": course}[kind])
        t = 0.01 * k + nodes
        after = np.minimum(k - 3 + np.arange(16), 15)
        tips = {"point": np.tile(TIP, (16, 1)), "function": TIP + np.outer(t, [1, 2]), "array": course[after]}[kind]
        expected = rows(ordered, tips if k >= 3 else np.array([0.3, 0.4]))
        setpoint = named.current_setpoints
        np.testing.assert_allclose(setpoint["tip"], expected[0, :2], rtol=1e-14)
        assert setpoint["input"].tolist() == [0.0]
        measured = np.array(ordered.prediction.tip(ordered.first, 0.0, ordered.stages.p_nominal)).ravel()
        found = named.step(measured).u, ordered.step(measured, expected).u
        np.testing.assert_allclose(*found, rtol=1e-12)


def test_setpoints_of_one_step_leave_the_next_ones_alone(two):
    named, ordered = two
    for tip in ({"tip": TIP}, None):
        one = named.step([0.0, 0.6], tip).u
        other = ordered.step([0.0, 0.6], rows(ordered, TIP if tip else np.array([0.3, 0.4]))).u
        np.testing.assert_array_equal(one, other)


def test_a_reset_starts_the_course_again_and_a_copy_goes_on_with_it(two):
    named, _ = two
    named.step([0.0, 0.6])
    named.reference(tip=np.linspace(TIP, 0.5 * TIP, 16))
    np.testing.assert_allclose(named.current_setpoints["tip"], TIP)
    named.step([0.0, 0.6])
    copied = copy.deepcopy(named)
    np.testing.assert_allclose(copied.current_setpoints["tip"], TIP * (1 - 0.5 / 15))
    np.testing.assert_array_equal(copied.step([0.0, 0.6]).u, named.step([0.0, 0.6]).u)
    named.reset()
    np.testing.assert_allclose(named.current_setpoints["tip"], TIP)


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"top": TIP}, r"expected setpoints of weighted quantities \(tip, input\), got 'top'"),
        ({"bending": [0.0, 0.0]}, "bending"),
        ({"tip": 0.1}, r"tip: expected \(2,\)"),
        ({"tip": np.zeros((16, 3))}, r"got \(16, 3\)"),
        ({"tip": [0.1, math.nan]}, "finite"),
        ({"tip": 2 * TIP}, "tip: out of reach"),
        ({"tip": np.linspace(TIP, 2 * TIP, 16)}, r"tip.values\[1\]: out of reach"),
    ],
)
def test_wrong_setpoints_are_refused_and_change_nothing(two, given, match):
    named, _ = two
    named.reference(tip=TIP)
    with pytest.raises(InputError, match=match):
        named.reference(**given)
    np.testing.assert_array_equal(named.current_setpoints["tip"], TIP)
    assert named.current_setpoints["input"].tolist() == [0.0]


@pytest.mark.parametrize("tip", [[0.1, math.nan], [1e5, 0.0], lambda t: (math.nan, 0.1), lambda t: (0.0, math.inf)])
def test_numbers_of_a_setpoint_for_one_step_do_not_raise(two, tip):
    """By name as in the order of the entries: they are an anomaly, and the command goes on."""
    named, ordered = two
    values = tip(0.0) if callable(tip) else tip
    for control, given in ((named, {"tip": tip}), (ordered, rows(ordered, np.array(values)))):
        control.step([0.0, 0.6])
        command = control.step([0.0, 0.6], given)
        assert command.anomaly & Anomaly.BAD_SETPOINTS
        assert np.all(np.isfinite(command.u))


def test_functions_of_time_are_asked_as_far_as_the_horizon_when_it_is_due(two):
    """A course that is defined until the end of the last horizon is enough; a later gap is an anomaly when it comes."""
    named, _ = two
    asked = []

    def tip(t):
        asked.append(t)
        if t > 0.3:
            raise ValueError("beyond the course")
        return TIP if t < 0.25 else (math.nan, 0.0)

    named.reference(tip=tip)
    ahead, period = named.stages.stage * named.stages.stages, named.period
    for k in range(3):
        asked.clear()
        command = named.step([0.0, 0.6])
        assert (min(asked), max(asked)) == pytest.approx((k * period, k * period + ahead))
        assert bool(command.anomaly & Anomaly.BAD_SETPOINTS) == (k * period + ahead >= 0.25)


def test_a_setpoint_is_reported_where_it_is_farther_than_the_finger_is_long(two):
    """Of 60 tips about the base, 0.6 m from it at most can be met: in order, by name, over time, at one node alone."""
    _, ordered = two
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (60, 2))
    far = np.hypot(*points.T) > 0.6
    assert 10 < far.sum() < 50
    for point, beyond in zip(points, far, strict=True):
        one = rows(ordered, TIP)
        one[-1] = rows(ordered, point)[0]
        for given in (rows(ordered, point), {"tip": point}, {"tip": lambda t, at=point: at}, one):
            ordered.reset()
            command = ordered.step([0.0, 0.6], given)
            assert bool(command.anomaly & Anomaly.OUT_OF_REACH) == beyond
            assert not command.anomaly & Anomaly.BAD_SETPOINTS
            assert command.status.name == "SOLVED"
            assert ("reach" in str(command.anomalies)) == beyond
    ordered.reset()
    assert not ordered.step([0.0, 0.6], rows(ordered, [0.0, 0.6])).anomaly
    assert ordered.step([0.0, 0.6], rows(ordered, [0.0, 600.0])).anomaly == Anomaly.BAD_SETPOINTS


def test_masked_readings_are_missing(two):
    """As if they were NaN, to the last bit, whatever number is below the mask."""
    named, ordered = two
    masked = np.ma.array([0.01, 0.3], mask=[False, True])
    for given in (
        masked,
        np.ma.array([1, 0], mask=[False, True]),
        list(masked),
        {"tip_x": 0.01, "tip_y": np.ma.masked},
    ):
        values = [given["tip_x"], given["tip_y"]] if isinstance(given, dict) else given
        meant = [math.nan if x is np.ma.masked else x for x in values]
        commands = named.step(given), ordered.step(meant)
        assert commands[0].u == commands[1].u
        assert commands[0].anomaly == commands[1].anomaly
        assert commands[0].anomaly & Anomaly.MISSING
    estimators = [cg.Estimator(named.scene) for _ in range(2)]
    found = estimators[0].step(masked, [0.01]).z, estimators[1].step([0.01, math.nan], [0.01]).z
    np.testing.assert_array_equal(*found)
    with pytest.raises(InputError, match="finite"):
        named.reference(tip=np.ma.array(TIP, mask=[True, False]))


def test_weights_and_limits_change_by_name():
    named, ordered = controller(), controller()
    names = [name.split(" ")[0] for name in named.stages.r_names]
    weights = named.stages.weights.copy()
    weights[[names.index("tip_x"), names.index("tip_y")]] = 5e3, 100.0
    weights[[k for k, name in enumerate(names) if name.startswith("bending_rate")]] = 0.2
    named.change(weights={"tip": 5e3, "tip_y": 100.0})
    named.change(weights={"speed": 0.2}, u_max={"tip_moment": 0.2})
    ordered.change(weights=weights, u_max=[0.2])
    for _ in range(3):
        np.testing.assert_array_equal(named.step([0.0, 0.6]).u, ordered.step([0.0, 0.6]).u)
    for key, words in {"top": "there is no 'top': expected tip, speed, effort, tip_x, ", "tip": "number"}.items():
        with pytest.raises(InputError, match=f"weights.*{words}"):
            named.change(weights={key: "high"})
    with pytest.raises(InputError, match=r"u_max: there is no 'tip': expected tip_moment$"):
        named.change(u_max={"tip": 0.1})


def test_a_function_that_no_process_can_be_sent_is_named():
    named = controller()
    named.reference(tip=lambda t: TIP)
    assert copy.copy(named).step([0.0, 0.6]).u == copy.deepcopy(named).step([0.0, 0.6]).u
    with pytest.raises(InputError, match=r"reference\.tip: the function .*<lambda>.*top level of a module"):
        pickle.dumps(named)
    named.reference(tip=upright)
    sent = pickle.loads(pickle.dumps(named))
    assert sent.step([0.0, 0.6]).u == named.step([0.0, 0.6]).u


def upright(t):
    return (0.01 * t, 0.5)


def test_measurements_and_parameters_by_name(two):
    named, ordered = two
    assert named.step({"tip_y": 0.59, "tip_x": 0.01}).u == ordered.step([0.01, 0.59]).u
    half = named.step({"tip_x": 0.02}, applied={"tip_moment": 0.01})
    assert half.u == ordered.step([0.02, math.nan], applied=[0.01]).u
    assert half.anomaly & Anomaly.MISSING
    assert half.inputs == {"tip_moment": half.u[0]}
    with pytest.raises(InputError, match="there is no 'tip': expected tip_x, tip_y"):
        named.step({"tip": [0.0, 0.6]})
    with pytest.raises(InputError, match=r"measurement.tip_x: expected a number"):
        named.step({"tip_x": "left"})
