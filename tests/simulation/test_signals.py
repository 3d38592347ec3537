"""Sampled inputs: through the samples, monotone, twice continuously differentiable."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.scene import Samples, VectorSamples
from continuum_grasp.simulation import interpolate

RNG = np.random.default_rng(0)


def samples(count, interpolation="smooth"):
    times = np.cumsum(RNG.uniform(0.05, 1.0, count))
    return Samples(
        times=times.tolist(), values=np.round(RNG.normal(size=count), 2).tolist(), interpolation=interpolation
    )


@pytest.mark.parametrize("interpolation", ["smooth", "linear", "hold"])
def test_through_the_samples_and_held_outside(interpolation):
    given = samples(7, interpolation)
    assert interpolate(given, given.times)[0] == pytest.approx(given.values)
    value, rate, acceleration = interpolate(given, [given.times[0] - 1.0, given.times[-1] + 1.0])
    assert value == pytest.approx([given.values[0], given.values[-1]])
    assert not np.any(rate)
    assert not np.any(acceleration)


def test_what_holds_has_each_value_until_the_next_instant():
    given = Samples(times=(0.0, 0.1, 0.3), values=(1.0, 5.0, 2.0), interpolation="hold")
    # 0.1 + 0.2 is beyond 0.3 by rounding, three times 0.1 as well, and 0.3 less an ulp counts as 0.3.
    value, rate, acceleration = interpolate(given, [-1.0, 0.0, 0.0999, 0.1, 0.2999, np.nextafter(0.3, 0.0), 0.1 + 0.2])
    assert value.tolist() == [1.0, 1.0, 1.0, 5.0, 5.0, 2.0, 2.0]
    assert not np.any([rate, acceleration])


@pytest.mark.parametrize("count", [2, 3, 5, 20])
def test_smooth_stays_between_neighboring_samples(count):
    for _ in range(50):
        given = samples(count)
        for k in range(count - 1):
            t = np.linspace(given.times[k], given.times[k + 1], 201)
            change = np.diff(interpolate(given, t)[0])
            assert np.all(change * np.sign(given.values[k + 1] - given.values[k]) >= -1e-12)


def test_rate_and_acceleration_are_derivatives_and_continuous():
    given = samples(9)
    t = np.linspace(given.times[0] - 0.2, given.times[-1] + 0.2, 4001)
    h = 1e-6
    for order in (0, 1):
        ahead, behind = interpolate(given, t + h)[order], interpolate(given, t - h)[order]
        exact = interpolate(given, t)[order + 1]
        assert (ahead - behind) / (2 * h) == pytest.approx(exact, abs=1e-3 * (1 + np.abs(exact).max()))
    knots = np.array(given.times)
    for part in (1, 2):
        before, after = interpolate(given, knots - 1e-9)[part], interpolate(given, knots + 1e-9)[part]
        assert before == pytest.approx(after, abs=1e-4)


def test_vectors_are_interpolated_by_component():
    given = VectorSamples(times=(0.0, 1.0, 2.0), values=((0.0, 1.0), (1.0, -1.0), (3.0, 0.0)))
    t = np.linspace(-0.5, 2.5, 31)
    for k in (0, 1):
        single = Samples(times=given.times, values=tuple(v[k] for v in given.values))
        for both, one in zip(interpolate(given, t), interpolate(single, t), strict=True):
            assert both[:, k] == pytest.approx(one)
