"""The controller in closed loop with plants of scipy, and with everything going wrong."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.real_time_iteration import RealTimeIteration
from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.control import Anomaly, CommandStatus, Controller, Health
from continuum_grasp.scene import load
from tests.control_cases import TARGET, Reality, swing_scene
from tests.marks import few
from tests.rods import ROOT
from tests.rti_cases import LOOSE

N = 15
MOST, RATE = 0.3, 3.0
REFERENCE = np.array([*TARGET, 0.0])
GIVEN = {"estimator": None, "parameters": ("bending_stiffness",)}
"""A controller that is given its state."""
USUAL = {"measurement": [0.1, 0.1, 0.0, 0.0], "reference": REFERENCE, "p": [0.0471], "applied": [0.0]}
ANOMALIES = {
    "measurement": Anomaly.ABSURD,
    "reference": Anomaly.BAD_SETPOINTS,
    "p": Anomaly.BAD_PARAMETERS,
    "applied": Anomaly.BAD_APPLIED,
}
"""What is said of a number that cannot be."""


@lru_cache
def estimating(precision="double", deadline=math.inf) -> Controller:
    return Controller(swing_scene(), precision=precision, deadline=deadline)


@lru_cache
def given(*flags: str) -> Controller:
    with pytest.MonkeyPatch.context() as patch:
        if flags:
            patch.setenv("CC", " ".join(["cc", *flags]))
        return Controller(swing_scene(**GIVEN), deadline=math.inf)


def loop(control, plant, steps, measure=lambda plant: plant.tip):
    """Commands of a closed loop."""
    found = []
    for _ in range(steps):
        found.append(control.step(measure(plant)))
        plant.advance(found[-1].u, control.period)
    return found


def state(plant):
    return plant.x


@pytest.mark.deep
@pytest.mark.parametrize("error", few([0.1, -0.1, 0.0], 1))
@pytest.mark.parametrize("make", [{}, {"controller": {"period": 0.005}}, {"estimator": {"delay": 0.02}}])
def test_the_tip_has_no_offset(make, error):
    asked = {"measured": {"tip": 1e-4}, "disturbances": {"tip_moment": 0.05}, **make.get("estimator", {})}
    control = Controller(swing_scene(controller=make.get("controller"), estimator=asked), deadline=math.inf)
    stiffer = swing_scene(rod={"bending_stiffness": 0.0471 * (1.0 + error)})
    plant, late = Reality(stiffer, control.first), round(asked.get("delay", 0.0) / control.period)
    seen = [plant.tip] * late
    for _ in range(round(3.0 / control.period)):
        seen.append(plant.tip)
        plant.advance(control.step(seen[-1 - late]).u, control.period)
    assert plant.tip == pytest.approx(TARGET, abs=0.6e-3)
    assert control.step(seen[-1 - late]).estimate.p[0] == pytest.approx(-error * 0.0471 * 1.2 / 0.6, abs=2e-4)


STATES = np.array([[0.3, 0.2, 0.5, -0.4], [0.1, 0.4, -0.3, 0.2], [-0.2, 0.3, 0.0, 0.1], [0.0, 0.3, 0.0, 0.1]])


@pytest.mark.parametrize(
    ("asked", "counts"),
    [
        ({}, (5, 1)),
        ({"start_iterations": 1}, (1, 1, 1)),
        ({"start_iterations": 2, "sqp_iterations": 3}, (2, 3, 3)),
        # Five iterations over three calls: one after the motion, then two and two, then one per call again.
        ({"start_iterations": 5, "start_calls": 3}, (1, 2, 2, 1)),
    ],
)
def test_a_command_is_that_of_as_many_real_time_iterations_as_are_set(asked, counts):
    control, u = Controller(swing_scene(controller=asked, **GIVEN), deadline=math.inf), [0.05]
    iteration = RealTimeIteration(control.stages)
    iteration.settings.iterations = 20
    for again in range(2):
        control.reset(u=u)
        for k, (x, count) in enumerate(zip(STATES, counts, strict=False)):
            command, whole = control.step(x, REFERENCE, applied=u), np.append(x, u)
            if k:
                iteration.shift()
            else:
                iteration.reset(whole, u, rollout=True)
            for _ in range(count):
                report = iteration.step(whole, REFERENCE)
            assert command.status == CommandStatus(report.status)
            assert command.plan.u == pytest.approx(iteration.plan[1], abs=1e-10), (again, k)
            assert command.u == pytest.approx(command.plan.u[0], abs=1e-12)
            u = command.u


def test_a_start_is_not_spread_over_more_calls_than_it_has_iterations():
    with pytest.raises(ValueError, match="start_calls = 6: expected start_iterations = 5 or less"):
        swing_scene(controller={"start_calls": 6}, **GIVEN)


def bad(control, **wrong):
    """A step in which all is well but for what is named."""
    usual = {name: USUAL[name] for name in ("measurement", "reference", "p")}
    return control.step(**{**usual, **wrong})


@pytest.mark.parametrize("flags", [(), LOOSE], ids=["as usual", "arithmetic that knows no NaN"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e9])
@pytest.mark.parametrize(("name", "anomaly"), ANOMALIES.items())
def test_what_is_implausible_is_reported_and_never_applied(name, anomaly, value, flags):
    control = given(*flags)
    control.reset()
    before = bad(control)
    command = bad(control, **{name: [*USUAL[name][:-1], value]})
    expected = Anomaly.MISSING if name == "measurement" and math.isnan(value) else anomaly
    assert command.anomaly == expected
    assert len(command.anomalies) == 1
    if name == "applied":
        assert command.status == CommandStatus.SOLVED
    else:
        assert command.status == CommandStatus.PREVIOUS_PLAN
        assert command.u == pytest.approx(before.plan.u[1], abs=1e-8)
    assert not bad(control).anomalies


def test_after_nonsense_that_looks_like_sense_it_plans_again():
    control = given()
    control.reset()
    bad(control)
    bad(control, measurement=[3.0, -3.0, 500.0, -500.0])
    assert bad(control).status <= CommandStatus.ROW_VIOLATED


ADAPTING = {
    "parameters": ("bending_stiffness", "tip_mass"),
    "estimator": {"measured": {"tip": 1e-4}, "adapt": {"bending_stiffness": 0.3, "tip_mass": 0.003}, "delay": 0.0},
}


def test_the_plan_goes_on_as_long_as_it_lasts_and_then_the_input_goes_down():
    control = given()
    control.reset(u=[0.28])
    plan = control.step([0.9, 0.9, 0.0, 0.0], REFERENCE).plan.u.ravel()
    commands = [control.step(None, REFERENCE) for _ in range(200)]
    kinds = [c.status for c in commands]
    assert kinds == [CommandStatus.PREVIOUS_PLAN] * (N - 1) + [CommandStatus.SAFE_RAMP] * (201 - N)
    inputs = np.array([c.u[0] for c in commands])
    assert inputs[: N - 1] == pytest.approx(plan[1:], abs=1e-8)  # the rate limit is satisfied to the last digit
    ramp = np.diff(inputs[N - 2 :])
    assert np.abs(ramp).max() == pytest.approx(2.0 * MOST / (6.5 * control.scene.finger.rod.natural_time) * 0.01)
    assert inputs[-1] == 0.0
    assert commands[N - 1].anomaly == Anomaly.MISSING
    assert Anomaly.BLIND in commands[N].anomaly
    assert control.step([0.0] * 4, REFERENCE).status == CommandStatus.SOLVED
    assert control.statistics["fallbacks"] == 200


def test_without_any_measurement_an_estimator_is_trusted_for_a_horizon():
    control = estimating()
    control.reset()
    kinds = [control.step(None).status for _ in range(N + 5)]
    assert set(kinds[:N]) <= {CommandStatus.SOLVED, CommandStatus.ITERATION_LIMIT, CommandStatus.ROW_VIOLATED}
    assert set(kinds[N:]) == {CommandStatus.SAFE_RAMP}
    assert control.step([0.0, 0.6]).status <= CommandStatus.ROW_VIOLATED


def test_a_late_command_is_followed_by_the_plan():
    control = given()
    control.reset()
    plan = bad(control).plan.u
    command = bad(control, late=True)
    assert (command.status, command.anomaly) == (CommandStatus.PREVIOUS_PLAN, Anomaly.LATE)
    assert command.u == pytest.approx(plan[1], abs=1e-8)
    assert bad(control).status == CommandStatus.SOLVED


def test_deadlines_are_watched():
    control = Controller(swing_scene(**GIVEN), deadline=1e-9)
    kinds = [bad(control).status for _ in range(4)]
    assert kinds[0] == CommandStatus.SOLVED
    assert set(kinds[1:]) == {CommandStatus.PREVIOUS_PLAN}
    assert control.statistics["late"] == 4


def test_what_was_applied_is_what_the_estimator_counts_with():
    control = estimating()
    plant = Reality(control.scene, control.first)
    control.reset()
    for _ in range(60):
        found = control.step(plant.tip, applied=[0.02])
        plant.advance([0.02], control.period)
    assert found.estimate.x[:2] == pytest.approx(plant.x[:2], abs=0.01)
    assert found.estimate.p == pytest.approx(0.0, abs=1e-3)


@pytest.mark.deep
def test_whatever_is_given_commands_stay_finite_and_within_their_limits():
    rng = np.random.default_rng(7)
    values = np.array([np.nan, np.inf, -np.inf, 1e308, -1e308, 1e12, 1e-320, 0.0])
    for control in (estimating(), estimating("float"), given()):
        control.reset()
        plant, last = Reality(swing_scene(), control.first), np.zeros(1)
        for k in range(400):
            y = np.array(plant.tip if control is not given() else plant.x)
            target = REFERENCE + rng.normal(0.0, 0.2, 3)
            p = np.array(control.stages.p_nominal)
            spoiled = [a for a in (y, target, p) if rng.random() < 0.15]
            for array in spoiled:
                array[rng.integers(array.size)] = rng.choice(values)
            command = control.step(y, target, p=p, late=bool(rng.random() < 0.05))
            assert np.all(np.isfinite(command.u))
            assert np.abs(command.u).max() <= MOST * (1 + 1e-6)
            assert np.abs(command.u - last).max() <= RATE * 0.01 * (1 + 1e-5)
            reported = command.anomaly != 0
            assert reported or all(np.all(np.isfinite(a)) and np.abs(a).max() < 1e12 for a in spoiled)
            assert not command.fallback or reported or command.health == Health.TRIPPED
            last = command.u
            if command.health == Health.TRIPPED:
                control.reset(u=last)
            if k % 4 == 0:
                plant.advance(command.u, control.period)


def test_a_saved_state_goes_on_bit_for_bit():
    control, other = estimating(), Controller(swing_scene(), deadline=math.inf)
    control.reset()
    plant = Reality(control.scene, control.first)
    loop(control, plant, 20)
    saved, seen = control.save_state(), [plant.tip + 0.001 * k for k in range(20)]
    first = [control.step(y).u for y in seen]
    other.restore(saved)
    control.restore(saved)
    for y, u in zip(seen, first, strict=True):
        assert np.array_equal(control.step(y).u, u)
        assert np.array_equal(other.step(y).u, u)


def test_two_controllers_do_not_mix():
    apart, together = [], []
    ends = [[0.0, 0.6], [-0.05, 0.59]]
    pair = [Controller(swing_scene(), deadline=math.inf) for _ in range(2)]
    for control, y in zip(pair, ends, strict=True):
        apart.append([control.step(y).u[0] for _ in range(20)])
        control.reset()
    for _ in range(20):
        together.append([control.step(y).u[0] for control, y in zip(pair, ends, strict=True)])
    assert np.array_equal(np.array(apart), np.array(together).T)


def test_single_precision_is_close():
    single, double = estimating("float"), estimating()
    single.reset()
    double.reset()
    plant = Reality(double.scene, double.first)
    for _ in range(50):
        y = plant.tip
        a, b = single.step(y), double.step(y)
        plant.advance(b.u, double.period)
        assert a.u == pytest.approx(b.u, abs=5e-3 * MOST)


def test_the_reference_of_the_scene_has_its_own_clock():
    circle = {"center": TARGET, "radius": 0.05, "frequency": 1.0}
    control = Controller(swing_scene(reference={"tip": circle}, **GIVEN), deadline=math.inf)
    other = Controller(control.scene, deadline=math.inf)
    for k in range(200):
        angle = 2.0 * np.pi * 0.01 * (k + np.arange(N + 1))
        around = np.stack([TARGET[0] + 0.05 * np.cos(angle), TARGET[1] + 0.05 * np.sin(angle), 0 * angle], axis=1)
        assert control.step(np.zeros(4)).u == pytest.approx(other.step(np.zeros(4), around).u, abs=1e-9)


def test_phases_are_timed_and_statuses_counted():
    control = given()
    control.reset()
    command = bad(control)
    bad(control, measurement=None)
    assert min(command.time) > 0.0
    found = control.statistics
    assert (found["steps"], found["status"]["solved"], found["status"]["previous_plan"]) == (2, 1, 1)
    assert found["anomalies"] == {"missing": 1}
    assert found["times"]["step"]["median"] >= found["times"]["feedback"]["median"]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda c: c.step([0.0]),
        lambda c: c.step(np.zeros(4), np.array(REFERENCE) + 0j),
        lambda c: c.step(np.zeros(4), REFERENCE, applied=np.zeros(c.stages.nu, complex)),
        lambda c: c.reset(state=np.zeros(4, complex)),
        lambda c: c.step(np.zeros(4), np.zeros(7)),
        lambda c: c.step(np.zeros(4), REFERENCE, p=np.zeros(9)),
        lambda c: c.step(np.zeros(4), REFERENCE, applied=np.zeros(2)),
        lambda c: c.reset(state=[np.nan] * 4),
        lambda c: c.restore(b""),
        lambda c: c.restore(estimating().save_state()),
        lambda c: Controller(c.scene, precision="half"),
        lambda c: Controller(c.scene, deadline=0.0),
        lambda c: Controller(swing_scene(controller={"period": 0.02})),
        lambda c: Controller(c.scene.finger),
        lambda c: swing_scene(controller={"cost": {"tip": 0.0, "speed": 0.1, "effort": 0.1}}),
        lambda c: swing_scene(controller={"cost": {"tip": 1.0, "effort": 0.0}}),
    ],
)
def test_what_does_not_fit_is_refused(wrong):
    with pytest.raises(InputError):
        wrong(given())


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"u_min": [0.2], "u_max": [0.1]}, "tip_moment"),
        ({"c_min": [-1.0, -1.0, 0.5], "c_max": [1.0, 1.0, -0.5]}, "c_min: .*tip_moment_rate: 0.5 > -0.5"),
        ({"c_max": [1.0, -1.5, 1.0]}, "c_max: .*curvature_2: -1 > -1.5"),
        ({"weights": [0.0] * 3, "terminal_weights": [0.0] * 3}, "weight above 0"),
        ({"weights": [1e4, 1e4, 0.0]}, "weight above 0"),
        ({"weights": [1e4, 1e4, 10**400]}, "finite"),
        ({"weights": [1e4, 1e4, 1j]}, "expected 3 numbers"),
    ],
)
def test_settings_that_do_not_go_together_are_refused_whole(settings, said):
    control = given()
    control.reset()
    first = bad(control).u
    with pytest.raises(InputError, match=said):
        control.change(**settings)
    control.reset()
    again = bad(control)
    assert again.status == CommandStatus.SOLVED
    assert np.array_equal(again.u, first)


def test_limits_cross_those_that_were_changed_before():
    control = Controller(swing_scene(**GIVEN), deadline=math.inf)
    control.change(u_max=[0.1])
    with pytest.raises(InputError, match="tip_moment"):
        control.change(u_min=[0.2])
    control.change(u_min=[0.1])  # one command alone is left
    assert [bad(control).u[0] for _ in range(8)][-1] == pytest.approx(0.1)


@pytest.mark.parametrize(
    "value", [10**400, -(10**5000), Fraction(10**400, 3), np.longdouble("1e4000")], ids=["int", "long", "ratio", "wide"]
)
def test_numbers_beyond_doubles_are_infinite(value):
    control = given()
    for name, anomaly in ANOMALIES.items():
        control.reset()
        bad(control)
        assert bad(control, **{name: [*USUAL[name][:-1], value]}).anomaly == anomaly


@pytest.mark.parametrize(
    "wrong",
    [10**5000, [1.0, [2.0, 3.0]], "1234", ["1"] * 4, [1j] * 4, np.zeros(4, complex)],
    ids=["scalar", "ragged", "text", "texts", "complex", "complex array"],
)
def test_what_is_no_array_of_numbers_is_refused(wrong):
    with pytest.raises(InputError, match="measurement: expected"):
        given().step(wrong, REFERENCE)


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ({"late": np.array([True, False])}, r"late: expected \(\), got \(2,\)"),
        ({"late": "no"}, r"late: expected \(\), got 'no'"),
        ({"time": [1.0, 2.0]}, r"time: expected \(\), got \(2,\)"),
        ({"p": ["0.0471"]}, r"p: expected \(1,\), got \['0.0471'\]"),
    ],
)
def test_a_step_blames_the_argument_that_is_wrong_and_no_other(wrong, expected):
    given().reset()
    with pytest.raises(InputError, match=f"^a step takes arrays of numbers; {expected}$"):
        given().step(np.zeros(4), REFERENCE, **wrong)
    given().step(np.zeros(4), REFERENCE)
    for late in (np.True_, 1, np.array([1])):  # a flag in other words
        assert Anomaly.LATE in given().step(np.zeros(4), REFERENCE, late=late).anomaly


def test_a_start_begins_with_inputs_as_far_as_drives_can_be():
    """Commands reach 0.3 N m, what acts twice as far: from there a command comes back at its rate."""
    control = estimating()
    for u in (2.0 * MOST, -2.0 * MOST):
        control.reset(u=[u])
        assert abs(control.step(None).u[0]) == pytest.approx(2.0 * MOST - RATE * 0.01)
    for u in (2.01 * MOST, -2.01 * MOST):
        with pytest.raises(InputError, match=r"u: tip_moment \[N m\]: .* outside the drive's range, -0.6 to 0.6"):
            control.reset(u=[u])


def test_a_limit_moved_past_the_command_is_approached_at_the_rate_and_said():
    control = Controller(swing_scene(**GIVEN), deadline=math.inf)
    control.reset(u=[0.28])
    u, target = [bad(control).u[0]], 0.1
    control.change(u_max=[target])
    for _ in range(20):
        command = bad(control, applied=[u[-1]])  # beyond the new limit, and believed all the same
        assert Anomaly.BAD_APPLIED not in command.anomaly
        assert (Anomaly.BEYOND_LIMIT in command.anomaly) == (command.u[0] > target + 1e-6)
        u.append(command.u[0])
    beyond = np.array(u) > target + 1e-6
    assert np.diff(u)[beyond[1:]] == pytest.approx(-RATE * 0.01)
    assert 3 < beyond.sum() < 8
    assert not beyond[8:].any()
    control.change(u_max=[MOST])
    control.reset(u=[0.28])
    control.change(u_max=[target])  # and on the safe ramp
    assert Anomaly.BEYOND_LIMIT in control.step(None, np.full(3, np.nan)).anomaly


@pytest.mark.parametrize("applied", [0.55, -0.55])
def test_no_command_follows_what_was_applied_beyond_the_limits(applied):
    control = Controller(swing_scene(**GIVEN), deadline=math.inf)
    for _ in range(6):
        command = bad(control, applied=[applied])
        assert Anomaly.BAD_APPLIED not in command.anomaly
        assert abs(command.u[0]) <= MOST


@pytest.mark.deep
def test_few_factorizations_command_as_well_as_many():
    """A QP that ends at its limit goes on from there at the next call: errors of the tip are those of solved ones."""

    def judged(iterations):
        found = run_closed_loop(
            load(ROOT / "configs/mpc/tip_arc.yaml", {"controller.iterations": iterations})
        ).metrics()
        return found.cost, found.statuses.get("iteration_limit", 0)

    (capped, limited), (solved, none) = judged(4), judged(40)
    assert limited > none == 0
    assert capped == pytest.approx(solved, rel=0.01)


@pytest.mark.deep
def test_a_finger_that_is_held_takes_few_factorizations():
    """The lower bound of the slack tendon holds in other parts of the horizon each period: 3.5 where as much is let go
    as its multipliers say, 4.5 where that is what has the wrong sign, 9 where sets may not grow.
    """
    control = Controller(ROOT / "configs/mpc/steady_tip.yaml", deadline=math.inf)
    counts, step = [], control.step

    def counted(*given, **named):
        command = step(*given, **named)
        counts.append(command.iterations)
        return command

    control.step = counted
    run_closed_loop(control.scene, controller=control)
    assert len(counts) == 300
    assert 3.0 < np.mean(counts) < 4.0
    assert max(counts) <= 15
