"""Contact forces as an estimator knows them: their slope, and the covariance that a controller hands out."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.control import Controller, ControlParts, Estimator, Prediction
from continuum_grasp.scene import ControlScene
from tests.control_cases import hand_scene
from tests.truth.differences import differences

TOUCHING = {
    "contacts": (0.09,),
    "object": {"shape": "circle", "diameter": 0.06, "mass": 0.1, "position": (-0.035, 0.1)},
    "contact_law": {"stiffness": 500.0, "friction": 0.5},
    "fidelity": {"family": "arc", "elements": 2},
    "parameters": ("bending_stiffness",),
}
MEASURED = {"tip": 5e-4, "tension": 0.2, "bending": {"at": (0.05, 0.09, 0.14, 0.18), "std": 0.003}}
DRIFTS = {"object_position": 0.002, "contact_friction": 0.5, "bending_stiffness": 0.01}


def scene(**changes) -> ControlScene:
    estimator = {"measured": MEASURED, "disturbances": DRIFTS, "delay": 0.0}
    estimator |= {key: changes.pop(key) for key in ("spread", "disturbances") if key in changes}
    return hand_scene(**TOUCHING | changes, estimator=estimator)


def test_forces_have_the_slope_of_states_and_disturbances():
    given, u = scene(), [8.0, 1.0]
    free = Prediction(given)
    x = free.at_rest([0.5, 0.6], u)
    # Where the middle and the tip press on the disc's outline by 2 mm, to be moved by the errors of its position.
    places = np.array(free.sections((0.09, 0.18))(x, u, free.p_nominal)[0])
    chord = places[:, 1] - places[:, 0]
    half, across = 0.5 * np.hypot(*chord), np.array([-chord[1], chord[0]]) / np.hypot(*chord)
    radius = 0.06
    center = places.mean(axis=1) + across * math.sqrt(radius**2 - half**2)
    disc = {"shape": "circle", "diameter": 2.0 * (radius + 0.002), "mass": 0.1, "position": tuple(center)}
    given = scene(object=disc)
    model = Prediction(given)
    estimation = ControlParts.of_scene(given, model).observed
    z = np.concatenate([model.at_rest([0.5, 0.6], u), [0.3, -0.2, -0.001, 0.0005, 0.05]])
    z[model.system.n : 2 * model.system.n] = 0.1, -0.2
    assert estimation.z_names[model.nx :] == (
        "unknown_contact_friction_1 [1]",
        "unknown_contact_friction_tip [1]",
        "object_x_error [m]",
        "object_y_error [m]",
        "bending_stiffness_error [1]",
    )
    nominal = model.p_nominal

    def forces(at):
        full = np.array(estimation.parameters(at, nominal)).ravel()
        return np.array(model.contact_force(at[: model.nx], u, full)).ravel()

    force, slope = (np.array(v) for v in estimation.contact_forces(z, u, estimation.parameters(z, nominal)))
    assert force.ravel() == pytest.approx(forces(z))
    assert force.min() > 0.2
    assert slope == pytest.approx(differences(forces, z), rel=1e-5, abs=1e-5)


def test_unknowns_start_with_their_spread():
    spread = {"object_position": 0.0015, "bending_stiffness": 0.12}
    given = scene(spread=spread)
    model = Prediction(given)
    parts = ControlParts.of_scene(given, model)
    estimation, process, initial = parts.observed, parts.filter["noise"], parts.filter["initial"]
    of = {name.split(" ")[0]: (process[k], initial[k]) for k, name in enumerate(estimation.z_names)}
    assert of["object_x_error"] == pytest.approx((0.002**2, 0.0015**2))
    assert of["bending_stiffness_error"] == pytest.approx((0.01**2, 0.12**2))
    # A share of the cone is anywhere between -1 and 1.
    assert of["unknown_contact_friction_1"] == pytest.approx((0.5**2, 1.0 / 3.0))


def test_the_controller_hands_out_the_covariance_of_its_filter():
    given = scene()
    controller, estimator = Controller(given, deadline=math.inf), Estimator(given)
    straight = [0.0, 0.18, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    u = np.array(given.rest_input)
    controller.reset(u=u)
    estimator.reset(u=u)
    for _ in range(4):
        found, command = estimator.step(straight, u), controller.step(straight, applied=u)
        assert command.estimate.covariance == pytest.approx(found.covariance, rel=1e-9, abs=1e-15)
        assert command.estimate.std == pytest.approx(found.std)
    of = command.contact_forces
    _, slope = (np.array(v) for v in estimator.estimation.contact_forces(found.z, u, found.p))
    assert of.covariance == pytest.approx(slope @ found.covariance @ slope.T, rel=1e-6, abs=1e-12)
    assert of.std**2 == pytest.approx(np.diag(of.covariance))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"contact_law": {"stiffness": 500.0, "friction": 0.0}}, "contact_friction: needs contact_law.friction"),
        ({"spread": {"tendon_friction": 0.4}}, "spread.tendon_friction: needs its drift"),
        ({"disturbances": {"tip_force": 0.1}, "spread": {"object_position": 0.001}}, "spread.object_position"),
    ],
)
def test_what_cannot_drift_or_has_no_spread_is_refused(changes, message):
    with pytest.raises((InputError, ValueError), match=re.escape(message)):
        scene(**changes)
