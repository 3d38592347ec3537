"""Contact detection of a package: that of Python, to the bit where both compute by the same sine and exponential."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.control import Controller, Estimator, ResidualContact
from continuum_grasp.export import REALS
from tests.contact_cases import NOISE, RADIUS, STEP, plant, short_scene
from tests.export_cases import needs, shared_library

COSTLY_FIXTURES = ("made",)


@pytest.fixture(scope="module", params=REALS)
def made(request, packages, tmp_path_factory):
    """Precision, binding and library of the package."""
    return request.param, *shared_library(packages("detector", request.param), tmp_path_factory.mktemp("contact"))


@pytest.fixture(scope="module")
def readings():
    """Of a chain that is bent, pushed at its tip and let go, with sensors that fail in between."""
    rng, driven, rows = np.random.default_rng(3), plant(0.1, hinges=12, time_step=5e-4), []
    for k in range(1, 1201):
        t = 5e-4 * k
        driven.advance(0.8 * min(t / 0.2, 1.0), 1.5 * max(0.0, t - 0.3) if t < 0.5 else 0.0)
        if k % 10 == 0:
            rows.append(driven.readings(STEP, NOISE, rng))
    rows[20][1] = math.nan
    rows[25][0] = math.inf
    rows[30][0] = 50.0  # no finger's motor is there
    return rows


@pytest.mark.deep
@needs("cc")
def test_controller_and_estimator_feel_what_those_of_python_feel(made, readings):
    real, finger, library = made
    both = Controller(short_scene(), precision=real, deadline=math.inf), Estimator(short_scene(), precision=real)
    others, seen = (finger.Controller(library), finger.Estimator(library)), set()
    # Shares of the forces: their division by gains magnifies the rounding of tensions of 10 N.
    limit = {"double": 1e-6, "float": 0.02}[real]
    for y in readings:
        command = both[0].step(y)
        expected = [command.contact, both[1].step(y, command.u).contact]
        others[0].step(finger.Measurement(*y), finger.Reference())
        others[1].step(finger.Measurement(*y), finger.Command(*command.u))
        for wanted, other in zip(expected, others, strict=True):
            found = other.contact()
            assert ResidualContact(int(found.verdict)) is wanted.contact
            seen.add(wanted.contact)
            assert [*found.residual, *found.low, *found.high] == pytest.approx(
                [*wanted.residual, *wanted.bounds.T.ravel()], abs=limit
            )
            known = wanted.threshold < math.inf
            assert np.array(found.threshold)[known] == pytest.approx(wanted.threshold[known], rel=limit)
            finite = np.isfinite(wanted.forces)
            forces = np.transpose([found.force_low, found.force_high])
            assert forces[finite] == pytest.approx(wanted.forces[finite], rel=limit, abs=limit)
    assert seen == {ResidualContact.FREE, ResidualContact.UNCERTAIN, ResidualContact.DETECTED, ResidualContact.MISSING}


def test_what_moves_as_no_finger_is_lost_until_it_starts_again():
    """Rates of which no number is left: no contact is claimed, and no force excluded."""
    python = Estimator(short_scene())
    python.detector.start(np.full(python.prediction.nx, 1e200))
    for _ in range(2):
        found = python.step([0.0, 0.0], [0.1]).contact
        assert found.contact is ResidualContact.LOST
        assert found.threshold.tolist() == [math.inf] * 2
        assert not np.isfinite(found.forces).any()
    python.reset()
    assert python.step([0.0, 0.0], [0.1]).contact.contact is ResidualContact.FREE


def test_a_start_elsewhere_is_no_contact():
    """An estimator that starts at a bent state has a detector that starts there: what holds the finger is free."""
    python, torque = Estimator(short_scene()), 0.0
    for k in range(200):
        found = python.step([0.8 * min(1.0, k / 100), torque], [0.8])
        torque -= 0.2 * RADIUS * found.contact.residual[0]
    state = found.z[: python.prediction.nx].copy()
    state[3:6] = 0.0  # at rest
    python.reset(state)
    verdicts = {python.step([0.8, torque], [0.8]).contact.contact for _ in range(40)}
    assert verdicts == {ResidualContact.FREE}
    python.reset()
    assert ResidualContact.DETECTED in {python.step([0.8, torque], [0.8]).contact.contact for _ in range(40)}
