"""Plants that are chains of guides: against chains of the tests, closed forms, balances and plants of elements."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.closed_loop.chain_integration import ChainIntegration
from continuum_grasp.closed_loop.plant import Plant
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.scene.control import ControlScene
from tests.truth.tendon_motion import MovingFinger

LENGTH, STIFFNESS, OFFSET = 0.18, 6.11e-3, 0.005
STILL = {"rod": {"length": LENGTH, "linear_density": 1e-9, "bending_stiffness": STIFFNESS}}
MOVING = {
    "rod": {"length": LENGTH, "linear_density": 0.034, "bending_stiffness": STIFFNESS},
    "damping": {"material": 3e-5},
    "masses": [{"at": LENGTH, "mass": 0.002}],
}
PAIR = {"offset": OFFSET, "max_tension": 60.0}


def scene(finger, plant, **further):
    given = {
        "finger": finger,
        "gravity": [0.0, 0.0],
        "controller": {"horizon": {"stages": 5}, "cost": {"tip": {"running": 1.0}, "effort": 1e-3}},
        "reference": {"tip": [0.1, 0.1]},
        "plant": plant,
        "initial": {"pose": "straight"},
        **further,
    }
    return ControlScene.model_validate(given)


class Chain:
    """A plant of guides, on which inputs act step by step."""

    def __init__(self, finger, guides, **further):
        self.model = PlantModel(scene(finger, {"guides": guides, "axial_stiffness": 1e4}, **further))
        self.steps, self.x, self.n = ChainIntegration(self.model), self.model.start, guides

    def go(self, u, step=1.0, count=1):
        self.x = self.steps.advance(self.x, np.asarray(u, dtype=float), 0.0, step, count)[-1]
        return self.angle

    @property
    def angle(self):
        return float(self.x[: self.n].sum())


def at_rest(guides, friction, tendons):
    return Chain({**STILL, "damping": {"material": 1e-12}, "tendons": tendons(friction)}, guides)


def single(friction):
    return [PAIR | {"friction": friction}]


def pair(friction):
    return PAIR | {"friction": friction}


def of_closed_forms(guides):
    """Errors of bends by closed forms [rad]: pulled, let out to 12 N and to 0.3 N, and one of two tendons pulled."""
    one = at_rest(guides, 0.1, single)
    for tension in np.linspace(0.5, 20.0, 40):
        pulled = one.go([tension])
    for tension in np.linspace(19.5, 12.0, 16):
        let_out = one.go([tension])
    for tension in np.linspace(11.5, 0.3, 23):
        released = one.go([tension])
    two = at_rest(guides, 0.1, pair)
    for tension in np.linspace(6.0, 20.0, 30):
        both = two.go([tension, 6.0])
    found = np.array([pulled, let_out, released, both])
    return np.abs(found - [2.58201009, 1.94506789, 0.04428778, 1.72252137])


def test_bends_at_rest_are_those_of_closed_forms_with_the_square_of_the_number_of_guides():
    few, more = of_closed_forms(10), of_closed_forms(20)
    assert np.all(few < 3e-4)
    assert few[[0, 1, 3]] / more[[0, 1, 3]] == pytest.approx(4.0, rel=0.02)
    assert few[2] < 1e-8


def test_it_moves_as_the_chain_of_the_tests_does_but_for_its_steps():
    chain = Chain({**MOVING, "tendons": pair(0.15)}, 16)
    pulls = [(1.0 + 9.0 * np.sin(0.04 * k) ** 2, 2.0) for k in range(80)]
    angles = np.array([chain.go(u, 1e-3, 8) for u in pulls])
    errors = []
    for parts in (2, 4):
        truth = MovingFinger(LENGTH, STIFFNESS, OFFSET, 0.15, hinges=16, time_step=1e-3 / parts)
        found = []
        for u in pulls:
            for _ in range(parts):
                truth.advance([("tension", u[0]), ("tension", u[1])])
            found.append(truth.angle)
        errors.append(np.abs(np.array(found) - angles).max())
    # What is left is of the truth's steps, which decide sliding by differences of first order.
    assert errors[1] < 4e-3 < np.ptp(angles) / 50.0
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.3)


def test_nothing_creeps_at_rest_and_a_slack_tendon_forgets():
    chain = Chain({**MOVING, "tendons": single(0.3)}, 16)
    for tension in (*np.linspace(0.0, 15.0, 30), *np.linspace(15.0, 9.0, 12)):
        chain.go([tension], 0.02, 20)
    angle = chain.go([9.0], 2.0, 400)
    assert chain.go([9.0], 10.0, 2000) == pytest.approx(angle, abs=1e-7)
    chain.go([0.0], 20.0, 4000)
    n = chain.n
    assert np.all(chain.x[2 * n : 3 * n + 1] == 0.0)
    assert abs(chain.angle) < 1e-6
    assert chain.go([5.0], 1.0, 1000) > 0.3


def test_mirrored_fingers_move_alike():
    found = [Chain({**MOVING, "tendons": pair(0.2)}, 12) for _ in range(2)]
    for k in range(40):
        u = 6.0 + 5.0 * np.sin(0.15 * k), 4.0 + 3.0 * np.cos(0.2 * k)
        angles = found[0].go(u, 2e-3, 2), found[1].go(u[::-1], 2e-3, 2)
        assert angles[0] == pytest.approx(-angles[1], abs=1e-9)


def test_a_conduit_takes_its_share_before_the_finger():
    own = [PAIR | {"friction": 0.1, "conduit_bend": 3.0}]
    chain = Chain({**STILL, "damping": {"material": 1e-12}, "tendons": own}, 20)
    for tension in np.linspace(0.5, 20.0, 40):
        angle = chain.go([tension])
    arriving = 20.0 * np.exp(-0.3)
    assert angle == pytest.approx(np.log(1.0 + 0.1 * OFFSET / STIFFNESS * arriving * LENGTH) / 0.1, rel=1e-4)


def test_it_presses_an_object_as_a_plant_of_elements_does():
    """Without friction of tendons, under gravity in the plane; both come to rest."""
    around = {
        "gravity": [0.0, -9.81],
        "contacts": [0.09],
        "object": {"shape": "circle", "diameter": 0.06, "mass": 0.05, "position": [-0.045, 0.09]},
        "contact_law": {"stiffness": 2000.0, "friction": 0.4, "dissipation": 0.2, "rounding": 2e-4},
    }
    finger = {**MOVING, "tendons": PAIR | {"time_constant": 0.02}, "half_thickness": 0.006}
    forces = []
    for plant in ({"guides": 60, "axial_stiffness": 1e5}, {"fidelity": {"family": "clothoid", "elements": 6}}):
        tried = Plant(scene(finger, plant, **around))
        for _ in range(60):
            tried.advance([20.0, 0.0])
        touch = tried.model.function("touch", force=tried.model.touch["force"], gap=tried.model.touch["gap"])
        force, gap = touch(tried.x, [20.0, 0.0], tried.model.forces(0.0)[0])
        assert np.array(gap).min() < 0.0
        forces.append(np.array(force))
    assert np.abs(forces[0]).max() > 0.5
    assert forces[0] == pytest.approx(forces[1], abs=0.02 * np.abs(forces[1]).max())


@pytest.mark.parametrize(
    ("finger", "plant", "key", "words"),
    [
        (MOVING, {"guides": 20}, "plant.guides", "tip_moment"),
        ({**MOVING, "tendons": PAIR}, {"guides": 20}, "plant.axial_stiffness", "elastic"),
        (
            {**MOVING, "tendons": PAIR, "stops": {"curvature": 30.0, "stiffness_ratio": 20.0}},
            {"guides": 20, "axial_stiffness": 1e4},
            "plant.guides",
            "stops",
        ),
        ({**MOVING, "tendons": PAIR}, {"axial_stiffness": 1e4}, "plant.axial_stiffness", "commanded"),
    ],
)
def test_what_a_chain_does_not_cover_is_refused(finger, plant, key, words):
    moment = {} if "tendons" in finger else {"moment_max": 0.1}
    control = {"horizon": {"stages": 5}, "cost": {"tip": {"running": 1.0}, "effort": 1e-3}, "input": moment}
    with pytest.raises(cg.InputError, match=words if "tendons" in finger else "tendons") as error:
        PlantModel(scene(finger, plant, controller=control))
    assert error.value.key == key


def test_guides_have_no_elements_and_no_presliding():
    for other in ({"fidelity": {"elements": 4}}, {"presliding": 1e-5}):
        with pytest.raises(ValueError, match="guides"):
            scene({**MOVING, "tendons": PAIR}, {"guides": 20, **other})
