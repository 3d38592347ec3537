"""Replayed logs: what was done to them is found; from inside: periods as they are read, and inputs as they lag.

Replayed logs: those of the package's own loops are reproduced; what was done to them is found.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.identification import replay
from continuum_grasp.addons.identification.calls import calls_of
from continuum_grasp.addons.identification.periods import Periods, _lagged, columns_of
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.scene import ControlScene
from tests.control_cases import ARCS_ESTIMATOR, ARCS_LOOP
from tests.declared import assert_declared
from tests.identification.test_comparison import HEADINGS, table
from tests.marks import few

TIME = 0.02  # s, of the drives
SCENE = {**ARCS_LOOP, "reference": {"tip": (-0.045, 0.172)}, "estimator": ARCS_ESTIMATOR, "duration": 1.5}
PLANT = {"fidelity": {"family": "clothoid", "elements": 3}}
NAMES = ["tip_x", "tip_y", "tension_1", "tension_2", "angle_1", "angle_2"]


def scene(**plant):
    return ControlScene(**SCENE, plant={**PLANT, **plant})


@cache
def run(**plant):
    """A loop whose tip goes from side to side."""
    side = {"tip": lambda t: (-0.045, 0.172) if int(t / 0.3) % 2 else (0.045, 0.172)}
    return run_closed_loop(scene(**plant), functions=side)


def changed(log, **channels):
    """A log with other readings of some channels, each a function of all (K, ny)."""
    y = log.y.copy()
    for name, reading in channels.items():
        y[:, NAMES.index(name)] = reading(log.y)
    return replace(log, y=y)


def column(name):
    return lambda y: y[:, NAMES.index(name)]


@pytest.mark.deep
def test_a_log_of_the_loop_itself_gives_its_estimates_and_commands(tmp_path):
    """To the bit by the arrays; by the file, which has seven digits, to these."""
    steady = run_closed_loop(scene())
    found = replay(scene(), steady.log)
    for name in ("u", "estimate", "std"):
        assert np.abs(getattr(found, name) - getattr(steady, name)).max() < 1e-12, name
    assert found.health == steady.health
    assert np.array_equal(found.logged, steady.u)
    assert_declared(found)
    (tmp_path / "log.csv").write_text(steady.log.text())
    written = replay(scene(), tmp_path / "log.csv")
    assert written.estimate == pytest.approx(steady.estimate, abs=1e-4)
    assert written.u == pytest.approx(steady.u, abs=1e-3)
    assert (written.status, written.suspects, written.warnings) == ("consistent", (), ())


def test_what_acts_until_an_instant_is_the_command_before():
    periods = Periods(scene(), run().log)
    assert np.isnan(periods._applied[0]).all()
    assert np.array_equal(periods._applied[1:], periods.logged[:-1])
    assert np.ptp(periods.logged, axis=0).min() > 1.0  # N


STAMPS = {
    "even": lambda t, rng: t,
    "half a millisecond": lambda t, rng: t + rng.uniform(-5e-4, 5e-4, t.size),
    "four milliseconds": lambda t, rng: t + rng.uniform(-4e-3, 4e-3, t.size),
    "a slow clock": lambda t, rng: 1.005 * t + rng.uniform(-2e-3, 2e-3, t.size),
}


def written(path, log, rows, t):
    """Some rows of a log at other instants, as a file."""
    lines = log.text().splitlines()
    cells = [f"{t[k]:.7g},{lines[k + 1].partition(',')[2]}" for k in rows]
    path.write_text("\n".join([lines[0], *cells, ""]))
    return path


@pytest.mark.parametrize("stamps", list(STAMPS)[1:])
def test_rows_whose_stamps_scatter_are_those_of_even_ones(tmp_path, stamps):
    log, rng = run().log, np.random.default_rng(4)
    t = STAMPS[stamps](log.t + 3.0, rng)
    made = Periods(scene(), written(tmp_path / "log.csv", log, range(t.size), t))
    even = Periods(scene(), log)
    assert made.measured() == pytest.approx(even.measured(), abs=1e-5)
    assert made.logged == pytest.approx(even.logged, abs=1e-5)
    assert made.t == pytest.approx(t, abs=1e-5)
    assert made.warnings == ()


def test_what_a_log_lacks_and_what_is_not_used_is_counted(tmp_path):
    """Rows that are there twice, with the same stamp and with one of the same period, and rows that are lost."""
    log = run().log
    rows = [k for k in range(log.t.size) if k not in (50, 51, 90)]
    rows = sorted([*rows, 10, 11, 12, 30])
    t = log.t.copy()
    lines = written(tmp_path / "log.csv", log, rows, t).read_text().splitlines()
    at = rows.index(30) + 2
    lines[at] = f"{t[30] + 0.003:.7g},{lines[at].partition(',')[2]}"
    (tmp_path / "log.csv").write_text("\n".join(lines))
    twice, shared, lost = Periods(scene(), tmp_path / "log.csv").warnings
    assert twice.startswith("3 rows repeat the time")
    assert shared.startswith("1 of 148 samples of tip_x share their period")
    assert lost.startswith("3 of 150 periods have no row")


@pytest.mark.deep
@pytest.mark.parametrize("stamps", STAMPS)
@pytest.mark.parametrize("delay", [0.0, 0.004, 0.01, 0.016, 0.03])
def test_the_interval_of_the_delay_has_the_plant_s(tmp_path, stamps, delay):
    """However the stamps scatter; a log of every seventh row shows neither delay nor lag."""
    log, rng = run(delay=delay).log, np.random.default_rng(7)
    path = written(tmp_path / "log.csv", log, range(log.t.size), STAMPS[stamps](log.t, rng))
    periods = Periods(scene(), path)
    found, (lag,) = periods.delay(), periods.lag()
    assert found.low - 1e-9 <= delay <= found.high + 1e-9
    assert found.high - found.low < 0.025
    assert lag.low <= TIME <= lag.high
    thin = Periods(scene(), written(tmp_path / "thin.csv", log, range(0, log.t.size, 7), log.t))
    assert all(np.isnan(one.logged) for one in (thin.delay(), *thin.lag()))
    assert "not shown by the log" in str(thin.delay())


def test_a_lag_answers_as_its_equation_does():
    """Y'' = (u - y) / time^2 - 2 y' / time, integrated from command to command."""
    rng = np.random.default_rng(0)
    u, period, time = rng.normal(size=12), 0.01, 0.017
    at, state, true = np.sort(rng.uniform(0.0, 12 * period, 40)), np.zeros(2), []
    for k, held in enumerate(u):
        inside = at[(at >= k * period) & (at < (k + 1) * period)] - k * period
        motion = solve_ivp(
            lambda _, y, held=held: [y[1], (held - y[0]) / time**2 - 2.0 * y[1] / time],
            (0.0, period),
            state,
            t_eval=[*inside, period],
            rtol=1e-11,
            atol=1e-13,
        )
        true += motion.y[0, :-1].tolist()
        state = motion.y[:, -1]
    assert _lagged(u, period, time, at) == pytest.approx(np.array(true), abs=1e-10)
    assert not _lagged(u, period, time, np.array([-0.004])).any()


TAMPERED = [
    ({"tip_x": lambda y: column("tip_x")(y) + 0.005}, ("tip_x",)),
    ({"tip_x": column("tip_y"), "tip_y": column("tip_x")}, ("tip_x and tip_y swapped",)),
    ({"tip_y": lambda y: column("tip_y")(y) - 0.003}, ("tip_y",)),
    ({"angle_2": lambda y: column("angle_2")(y) + 0.05}, ("angle_2",)),
    ({"tension_1": column("tension_2"), "tension_2": column("tension_1")}, ("tension_1 and tension_2 swapped",)),
    ({"tip_x": lambda y: np.full(len(y), y[3, 0])}, ("tip_x",)),
    ({"angle_1": lambda y: np.where(np.arange(len(y)) < 70, y[:, 4], y[70, 4])}, ("angle_1",)),
    ({}, ()),
]


@pytest.mark.parametrize(("channels", "suspects"), few(TAMPERED, 2))
def test_the_sensor_that_was_tampered_with_is_named(channels, suspects):
    found = replay(scene(), changed(run().log, **channels))
    assert found.suspects == suspects
    assert found.status == ("sensor" if suspects else "consistent")


@pytest.mark.deep
@pytest.mark.parametrize(("plant", "status"), [({"time_constant": 0.05}, "consistent"), ({"delay": 0.03}, "mismatch")])
def test_what_is_wrong_of_the_drive_is_no_fault_of_a_sensor(plant, status):
    found = replay(scene(), run(**plant).log)
    assert (found.status, found.suspects) == (status, ())


@pytest.mark.deep
@pytest.mark.parametrize(
    ("plant", "name", "wanted", "off"),
    [
        ({}, "lag", TIME, 0.1),
        ({"time_constant": 0.05}, "lag", 0.05, 0.1),
        ({}, "delay", 0.01, 0.25),
        ({"delay": 0.03}, "delay", 0.03, 0.1),
        ({"noise": 3.0}, "noise of tension_1", 0.3, 0.2),
        ({"noise": 3.0}, "noise of angle_2", 0.009, 0.2),
    ],
)
def test_noise_lag_and_delay_of_the_plant_are_found(plant, name, wanted, off):
    numbers = {one.name: one for one in replay(scene(), run(**plant).log).retuned}
    assert numbers[name].logged == pytest.approx(wanted, rel=off)
    assert numbers[name].configured == pytest.approx({"lag": TIME, "delay": 0.01}.get(name, wanted / 3.0))
    assert f"{numbers[name].logged:.3g}" in str(numbers[name])


@pytest.mark.deep
def test_uneven_stamps_gaps_and_other_units_are_read(tmp_path):
    """Samples up to 4 ms early, in mm, a quarter of the tips lost, nothing at all for 0.1 s."""
    rng, log = np.random.default_rng(1), run().log
    t, lost = log.t - 0.004 * rng.random(log.t.size), rng.random(log.t.size) < 0.25
    t[[0, -1]] = log.t[[0, -1]]
    lines = ["time [ms],commanded_tension_1,commanded_tension_2,tip_x [mm],tip_y [mm]"]
    for k in np.flatnonzero((log.t < 0.5) | (log.t > 0.6)):
        tip = ["", ""] if lost[k] else [f"{1e3 * log.y[k, j]:.6g}" for j in (0, 1)]
        lines.append(",".join([f"{1e3 * (3.0 + t[k]):.4f}", *(f"{u:.7g}" for u in log.u[k]), *tip]))
    (tmp_path / "odd.csv").write_text("\n".join(lines))
    found = replay(scene(), tmp_path / "odd.csv")
    assert found.status == "consistent"
    assert "tension_1, tension_2, angle_1, angle_2" in found.warnings[0]
    assert len(found.t) == len(log.t)
    assert np.isnan(found.innovation_std[:, 2:]).all()
    seen = np.isfinite(found.innovation_std[:, 0])
    assert not seen[51:60].any()
    assert 0.6 < seen.mean() < 0.75
    late = found.t - 3.0 > 0.8  # s: the gap is over
    assert np.abs(found.estimate - run().estimate)[late, :2].max() < 0.1


@pytest.mark.deep
def test_the_verb_saves_draws_and_says_it(tmp_path):
    config, log = tmp_path / "loop.yaml", tmp_path / "log.csv"
    config.write_text(json.dumps({"schema_version": 1, **scene().model_dump(mode="json", exclude_unset=True)}))
    for k, (channels, status) in enumerate([({}, 0), ({"tip_x": lambda y: column("tip_x")(y) + 0.005}, 1)]):
        log.write_text(changed(run().log, **channels).text())
        out = tmp_path / f"run{k}"
        done = CliRunner().invoke(app, ["replay", str(config), str(log), "--out", str(out)])
        assert done.exit_code == status, done.output
        assert ("suspect: tip_x" in done.output) == bool(status)
        assert "configured" in done.output
        assert {file.name for file in out.iterdir()} >= {"result.npz", "report.txt", "series.png", "innovations.png"}


def test_a_log_without_what_is_measured_is_refused(tmp_path):
    (tmp_path / "log.csv").write_text("t,force\n0,1\n0.01,1\n")
    with pytest.raises(InputError, match="estimator"):
        cg.replay(scene().replaced(estimator=None), tmp_path / "log.csv")
    with pytest.raises(InputError, match="none of tip_x"):
        cg.replay(scene(), tmp_path / "log.csv")


# -- calls by their instants ---------------------------------------------------------------------------------------

PERIOD = 0.01  # s


COUNT = 1000


SCATTER = {
    "none": lambda rng: np.zeros(COUNT),
    "uniform": lambda rng: rng.uniform(-0.4, 0.4, COUNT),
    "early": lambda rng: -0.4 * rng.random(COUNT),
    "normal": lambda rng: np.clip(rng.normal(0.0, 0.15, COUNT), -0.45, 0.45),
}


@pytest.mark.parametrize("clock", [1.0, 1.02, 0.996])
@pytest.mark.parametrize("lost", [0.0, 0.3])
@pytest.mark.parametrize("scatter", SCATTER)
def test_every_row_is_that_of_its_call(scatter, lost, clock):
    """Stamps up to 0.4 periods off, by a clock that is wrong, without some of the rows."""
    rng = np.random.default_rng(3)
    made = np.flatnonzero(rng.random(COUNT) >= lost)
    stamps = 7.0 + PERIOD * (clock * np.arange(COUNT) + SCATTER[scatter](rng))[made]
    calls = calls_of(stamps, stamps, PERIOD)
    assert np.array_equal(np.flatnonzero(calls.seen), made - made[0])
    assert np.array_equal(calls.t[calls.seen], stamps)
    assert calls.step == pytest.approx(clock * PERIOD, rel=1e-4)
    assert np.array_equal(calls.last(stamps, made.astype(float))[calls.seen], made)


def test_two_rows_of_one_period_have_two_calls_only_where_one_is_free():
    even = PERIOD * np.arange(100.0)
    late = np.delete(even, 50)
    late[50] = even[51] - 0.6 * PERIOD  # comes before its time, where there is none at 50
    assert calls_of(late, late, PERIOD).seen.sum() == 99
    twice = np.sort(np.append(even, even[40] + 0.2 * PERIOD))
    calls = calls_of(twice, twice, PERIOD)
    assert len(calls.t) == 100
    assert np.isfinite(calls.last(twice, np.arange(101.0))).sum() == 100


def test_a_sample_between_commands_is_that_of_the_next_call():
    commanded, camera = PERIOD * np.arange(50.0), 0.003 + 0.033 * np.arange(14.0)
    calls = calls_of(np.unique(np.concatenate([commanded, camera])), commanded, PERIOD)
    assert calls.t == pytest.approx(commanded)
    taken = calls.last(camera, camera)
    assert np.array_equal(np.flatnonzero(np.isfinite(taken)), np.ceil(camera / PERIOD - 1e-9).astype(int))


def test_a_logger_that_is_faster_than_the_controller_gives_the_last_of_each_period():
    t = 1e-3 * np.arange(500.0)
    calls = calls_of(t, t, PERIOD)
    assert calls.t == pytest.approx(PERIOD * np.arange(50.0))
    assert calls.last(t, t) == pytest.approx(calls.t)


def test_times_may_be_dates_and_headings_have_units_behind_an_underscore(tmp_path):
    text = "time,x_mm\n2026-03-10T16:09:57.5,1\n2026-03-10T16:09:57.51,2\n2026-03-10 16:09:58.5,3\n"
    read = columns_of(table(tmp_path, text), ["x [m]"], 0.01)
    t, x = read.channels["x [m]"]
    assert t == pytest.approx([0.0, 0.01, 1.0], abs=1e-9)
    assert x == pytest.approx([0.001, 0.002, 0.003])
    assert read.repeated == 0
    with pytest.raises(InputError, match=r"points.csv:3:1: column time: expected a date with a time .* got '3'"):
        columns_of(table(tmp_path, "time,x\n2026-03-10T16:09:57.5,1\n3,2\n"), ["x [m]"])


def test_a_second_run_in_a_log_is_named_by_its_line(tmp_path):
    text = "t [s],x,y\n" + "".join(f"{0.01 * k:.2f},0.2,0\n" for k in (*range(20), *range(3, 20)))
    with pytest.raises(InputError, match=r"points.csv:22:1: column t: a second run begins at number 21 of 37 rows"):
        columns_of(table(tmp_path, text), ["x [m]"])


@pytest.mark.parametrize(("heading", "apart", "likely"), HEADINGS)
def test_times_of_a_log_without_a_unit_are_asked_for_where_they_are_no_seconds(tmp_path, heading, apart, likely):
    file = table(tmp_path, f"{heading},x,y\n" + "".join(f"{apart * k:.6g},0.2,{(-0.01) ** k}\n" for k in range(20)))
    if likely is None:
        assert len(columns_of(file, ["x [m]"], 0.01).channels["x [m]"][0]) == 20
        return
    with pytest.raises(InputError, match=rf"points.csv:1:1: column t: .*is t in {likely}\? Write t \[{likely}\]"):
        columns_of(file, ["x [m]"], 0.01)


def test_units_of_a_log_are_those_of_the_periods_of_its_controller(tmp_path):
    slow = table(tmp_path, "t [s],x,y\n" + "".join(f"{10.0 * k:.6g},0.2,0\n" for k in range(20)))
    with pytest.raises(InputError, match=r"rows are 10 s apart, read in s, and periods of the controller 0.01 s"):
        columns_of(slow, ["x [m]"], 0.01)
    with pytest.raises(InputError, match=r"is t in s\? Write t \[s\]"):
        columns_of(table(tmp_path, "t [ms],x\n0,1\n0.01,2\n0.02,3\n"), ["x [m]"], 0.01)
