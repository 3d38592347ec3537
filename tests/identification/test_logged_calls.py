"""Calls of a controller in logs with late or missing rows; from inside: calls are found from instants alone.

Calls of a controller in logs whose rows are late, missing, or there twice, against those that were made so.
"""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.addons.identification.calls import calls_of

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
