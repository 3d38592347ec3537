"""Plans of fingers with winches: inputs are lengths; friction of tendons is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp.errors import InputError
from continuum_grasp.scene import Tendons
from continuum_grasp.scene.plan import PlanScene
from tests.control_cases import CABLE, DRIVES, HAND

AIM = (-0.0957, 0.1398)


def scene(friction):
    drive, limits = DRIVES["winches"]
    return PlanScene(
        finger=HAND.replaced(tendons=Tendons(**{**CABLE, "friction": friction, "drive": drive})),
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 2},
        initial={"pose": "straight"},
        input={**limits, "form": "linear"},
        goal={"tip": {"value": AIM, "weight": 1e6}, "end": "held"},
        objective="least_input_rate",
        duration=0.4,
        intervals=20,
        method="collocation",
    )


def test_lengths_of_a_plan_take_the_tip_to_its_goal():
    """Played to the model of the simulation by scipy."""
    found = cg.plan(scene(0.0))
    model = cg.System(found.scene.finger, family="clothoid", elements=2, gravity=(0, 0))

    def rate(t, x):
        u = [np.interp(t, found.t, column) for column in found.u.T]
        return np.array(model.forward_dynamics(x, u, [], [])).ravel()

    start = model.state(u=found.u[0].tolist())
    end = solve_ivp(rate, (0.0, 0.4), start, method="LSODA", rtol=1e-8, atol=1e-10).y[:, -1]
    tip = np.array(model.tip(end, found.u[-1], [])).ravel()
    assert np.linalg.norm(tip - AIM) < 1e-3
    assert np.abs(found.u).max() <= 0.012 + 1e-9


def test_friction_of_tendons_is_refused():
    with pytest.raises(InputError, match="plans have no friction"):
        scene(0.15)
