"""Fingers of many kinds reach the setpoint at which a motion of their own, integrated by SciPy, has come to rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.control import Controller, Prediction
from continuum_grasp.core import Compiler
from continuum_grasp.scene import ControlScene
from tests.features import FEATURES, scene_of

pytestmark = [pytest.mark.deep, pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")]

SHARE = 0.2
"""Of the range of the first input, at which the finger comes to rest."""
TRIED = (
    *("tendons at several places", "no tendons", "pressure chambers", "a muscle beside tendons", "winches", "motors"),
    *("relaxation", "softening", "stops", "tendons that shorten the rod", "a stepped rod", "curvature at rest"),
    *("a body aside of the tip", "a fixed object", "an object that moves", "known contacts"),
)


@pytest.mark.parametrize("name", TRIED)
def test_the_tip_reaches_where_the_finger_can_rest(name):
    (feature,) = (one for one in FEATURES if one.name == name)
    scene = scene_of(ControlScene, feature, {"duration": 1.5, "reference": {"tip": [0.0, 0.18]}})
    least, most = map(np.array, scene.input_limits)
    weights = {"tip": {"running": 2e5, "terminal": 2e4}, "speed": 0.02}
    # Of a change by the whole range in a stage, as much for every drive.
    weights["input_rate"] = 3e-3 / np.max(most - least).item() ** 2
    model = Prediction(scene)
    first = np.array(model.first_state()).ravel()
    u = np.where(least < 0.0, 0.0, least)
    u[0] += SHARE * (most[0] - u[0])
    if "winches" in name or "motors" in name:
        u[1] = -u[0]  # the tendon behind pays out what the other takes up

    def rate(t, x):
        return np.array(model.dynamics(x, u, model.p_nominal)).ravel()

    rest = solve_ivp(rate, (0.0, 4.0), first, method="BDF", rtol=1e-7, atol=1e-9).y[:, -1]
    tip, start = (np.array(model.tip(x, u, model.p_nominal)).ravel() for x in (rest, first))
    scene = scene.changed({"reference.tip": tip.tolist(), "controller.cost": weights})
    run = run_closed_loop(scene, controller=Controller(scene, deadline=math.inf))
    assert np.linalg.norm(run.tip[-1] - tip) < 0.01 * np.linalg.norm(tip - start)
