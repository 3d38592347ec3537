"""Numbers by which simulations decide, on either side of each; from inside: matrices, tensions and chunks made here."""

from __future__ import annotations

import math
import os
import signal

import numpy as np
import pytest

from continuum_grasp.base import Interrupted
from continuum_grasp.simulation import integrate, stepping
from continuum_grasp.simulation.slack import slack_times, tension_warnings
from continuum_grasp.simulation.vibration import _frequencies
from tests.rods import without_compiler  # noqa: F401
from tests.simulation.test_simulation import nitinol
from tests.simulation.test_winches import SERVO, finger

pytestmark = pytest.mark.usefixtures("without_compiler")


@pytest.mark.parametrize("seed", range(5))
def test_frequencies_of_rounding_are_zero_and_slow_ones_are_not(seed):
    """A body that nothing holds and a slow one beside a fast one, in mixed coordinates."""
    mixed = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    truth = np.array([0.0, 1e-6, 1.0]) / (2.0 * math.pi)
    found = _frequencies(mixed @ np.diag([1.0, 2.0, 3.0]) @ mixed.T, mixed @ np.diag([0.0, 2e-12, 3.0]) @ mixed.T)
    assert found == pytest.approx(truth, rel=1e-3, abs=0.0)


def test_times_without_tension_and_what_is_said_of_them():
    """Slack from the start on, twice in between, and to the end; the limit is passed at one sample."""
    t = np.arange(7) * 0.1
    tensions = np.array([[0.0, 2.0], [3.0, 3e-6], [0.0, 2e-5], [3.0, 0.0], [0.0, 60.2], [0.0, 60.5], [1.0, 0.0]])
    found = [(each.tendon, each.begins, each.ends) for each in slack_times(finger(SERVO), t, tensions)]
    ones = [(1, t[0], t[1]), (1, t[2], t[3]), (1, t[4], t[6])]
    twos = [(2, t[1], t[2]), (2, t[3], t[4]), (2, t[6], np.inf)]
    assert found == [*ones, *twos]
    first, high, second = tension_warnings(finger(SERVO), t, tensions)
    assert first == "tendon 1 goes slack at t = 0.2 s: nothing pulls there until t = 0.3 s (2 times in all)"
    assert high == "tendon 2 exceeds max_tension = 60 N at t = 0.4 s (greatest: 60.5 N)"
    assert second == "tendon 2 goes slack at t = 0.1 s: nothing pulls there until t = 0.2 s (3 times in all)"
    assert tension_warnings(finger(SERVO), t[5:], tensions[5:, [0, 1]])[-1].endswith("t = 0.6 s: nothing pulls there")


@pytest.mark.parametrize("method", ["rk4", "rodas", "reference"])
def test_an_interrupted_motion_comes_with_its_error(method, monkeypatch):
    monkeypatch.setattr(stepping, "_CHUNK", 10)
    scene = nitinol(duration=0.1, tip_mass=0.02, method=method)

    def stop(share: float) -> None:
        if share > 0.45:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted, match=r"interrupted after t = 0\.0\d+ s of 0\.1 s") as caught:
        integrate(scene, progress=stop)
    partial = caught.value.result
    assert partial.status == "stopped"
    assert 40 <= len(partial.t) <= 100
    assert np.array_equal(partial.x, integrate(scene).x[: len(partial.t)])
