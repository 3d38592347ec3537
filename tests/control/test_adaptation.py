"""Parameters estimated while running, against plants that have others, closed forms and statistics."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.control import Controller, Estimator
from continuum_grasp.scene import load
from tests.control_cases import hand_scene, rod_scene
from tests.marks import few
from tests.rods import ROOT
from tests.truth.differences import differences

NAMES = ("bending_stiffness", "tip_mass", "drive_time_constant")
NOISE = np.array([3e-4, 3e-4, 0.1, 0.1])
"""Of the tip [m] and the tensions [N]."""
NOT_ADAPTED = {"estimator.adapt": None, "parameters": []}
REST = np.array([1.0, 1.0])
"""Least tensions [N]."""


@lru_cache
def hand(spreads=(0.3, 0.003, 0.4), precision="double", forgetting=60.0, weight=False) -> Estimator:
    """Two arcs with tendons, in a horizontal plane or with their weight across; spreads are those of ``NAMES``."""
    asked = {
        "measured": {"tip": NOISE[0], "tension": NOISE[2]},
        "adapt": {**dict(zip(NAMES, spreads, strict=True)), "forgetting_time": forgetting},
        "acceleration_std": 1.0,
        "delay": 0.0,
    }
    arcs, scene = {"family": "arc", "elements": 2}, hand_scene()
    controller = {**dict(scene.controller), "horizon": {"stages": 15, "stage": 0.01, "method": "rk4"}}
    changes = {"fidelity": arcs, "parameters": NAMES, "estimator": asked, "controller": controller}
    gravity = (-9.81, 0.0) if weight else (0.0, 0.0)
    return Estimator(hand_scene(**changes, gravity=gravity), precision=precision)


class Finger:
    """The model of an estimator with parameters of its own, by Runge-Kutta steps of a millisecond."""

    def __init__(self, estimator: Estimator, p=None) -> None:
        self.model = estimator.prediction
        self.x, self.p = np.array(estimator.first), np.array(self.model.p_nominal if p is None else p)

    def rate(self, x, u):
        """Time derivative of the state."""
        return np.array(self.model.dynamics(x, u, self.p)).ravel()

    def step(self, x, u, h):
        """Make a step of Runge-Kutta."""
        k1 = self.rate(x, u)
        k2 = self.rate(x + h / 2 * k1, u)
        k3 = self.rate(x + h / 2 * k2, u)
        k4 = self.rate(x + h * k3, u)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def advance(self, u, time=0.01) -> None:
        """Hold an input for a time."""
        for _ in range(round(1e3 * time)):
            self.x = self.step(self.x, u, 1e-3)

    @property
    def measured(self):
        """Tip and tensions; of these the mean is taken to be 5 N, which no state has."""
        tip = np.array(self.model.tip(self.x, REST, self.p)).ravel()
        return np.array([*tip, 5.0 + self.x[4] / 0.005, 5.0])


def commands(periods: int) -> np.ndarray:
    """Tensions that bend the finger by up to 1.2 rad, at 1 and 2.3 Hz [N]."""
    t = 0.01 * np.arange(periods)
    pull = 4.0 * (1.0 - np.cos(2.0 * np.pi * t)) + 1.5 * np.sin(2.0 * np.pi * 2.3 * t)
    return np.stack([1.0 + np.maximum(pull, 0.0), 1.0 + np.maximum(-pull, 0.0)], axis=1)


def with_values(estimator: Estimator, **values: float) -> np.ndarray:
    """Parameters with factors of stiffness and lag, and a payload [kg]."""
    p = np.array(estimator.prediction.p_nominal)
    labels = [name.split(" ")[0] for name in estimator.prediction.p_names]
    for name, value in values.items():
        at = labels.index(name)
        p[at] = p[at] + value if name == "tip_mass" else p[at] * value
    return p


PLANTS = [
    {"bending_stiffness": 1.5, "tip_mass": 0.002, "drive_time_constant": 0.6},
    {"tip_mass": 0.004},
    {"drive_time_constant": 0.5},
    {},
]


@pytest.mark.parametrize("values", few(PLANTS, 1))
def test_what_a_plant_has_is_found_within_three_deviations(values):
    estimator = hand()
    truth, rng = with_values(estimator, **values), np.random.default_rng(0)
    plant = Finger(estimator, truth)
    estimator.reset()
    for u in commands(200):
        plant.advance(u)
        found = estimator.step(plant.measured + NOISE * rng.standard_normal(4), u)
    for name, value in zip(NAMES, truth, strict=True):
        one = found.adapted[name]
        assert abs(one.value - value) < 3.0 * one.std, (name, one, value)
    assert found.adapted["bending_stiffness"].observability.name == "OBSERVED"
    assert found.adapted["drive_time_constant"].observability.name == "DEAD_TIME"


@pytest.mark.parametrize("bent", [False, True])
def test_at_rest_noise_passes_for_no_motion(bent):
    """Straight, nothing shows; bent, the stiffness alone."""
    estimator, rng = hand(), np.random.default_rng(1)
    u, plant = REST + np.array([6.0 * bent, 0.0]), Finger(estimator)
    if bent:
        plant.advance(u, 3.0)
    estimator.reset(state=plant.x, u=u)
    y = plant.measured
    for _ in range(2000):
        found = estimator.step(y + NOISE * rng.standard_normal(4), u)
    seen = {name for name, one in found.adapted.items() if one.observability.name != "NOT_YET"}
    assert seen == ({"bending_stiffness"} if bent else set())
    nominal = dict(zip(NAMES, estimator.prediction.p_nominal, strict=True))
    for name in set(NAMES) - seen:
        one = found.adapted[name]
        assert one.std > 0.97 * one.initial_std
        assert abs(one.value - nominal[name]) < 0.1 * one.initial_std


def test_what_is_forgotten_returns_to_the_start_and_the_value_stays():
    """Where nothing is measured: d(variance)/dt = (initial - variance) / forgetting_time."""
    estimator = hand(forgetting=2.0)
    plant = Finger(estimator, with_values(estimator, bending_stiffness=1.3))
    estimator.reset()
    for u in commands(80):
        plant.advance(u)
        found = estimator.step(plant.measured, u)
    before = {name: (one.std / one.initial_std) ** 2 for name, one in found.adapted.items()}
    values = {name: one.value for name, one in found.adapted.items()}
    assert before["bending_stiffness"] < 0.1
    for _ in range(150):
        found = estimator.step(None, REST)
    for name, one in found.adapted.items():
        expected = 1.0 - (1.0 - before[name]) * math.exp(-1.5 / 2.0)
        assert (one.std / one.initial_std) ** 2 == pytest.approx(expected, rel=1e-3)
        assert one.value == pytest.approx(values[name], rel=1e-12)


def moment_scene(**changes):
    """The rod whose tip moment lags."""
    controller = {
        "horizon": {"stages": 15, "stage": 0.01, "method": "rk4"},
        "cost": {"tip": 2e3, "effort": 0.1},
        "input": {"moment_max": 0.3, "rate_max": 3.0, "time_constant": 0.03},
    }
    return rod_scene(controller=controller, **changes)


@pytest.mark.parametrize("lagging", ["tendons", "moment"])
def test_the_step_and_its_derivatives_are_those_of_the_changed_parameters(lagging):
    """Against Runge-Kutta steps of the dynamics with parameters set by hand, and their central differences."""
    if lagging == "tendons":
        estimator = hand()
    else:
        asked = {
            "measured": {"tip": 1e-3},
            "adapt": dict.fromkeys(NAMES, 0.1),
            "disturbances": {"tip_moment": 0.02},
            "delay": 0.0,
        }
        with pytest.warns(UserWarning, match="nothing tells them apart"):
            estimator = Estimator(moment_scene(parameters=NAMES, estimator=asked))
    model, estimation = estimator.prediction, estimator.estimation
    nx, nominal = model.nx, np.array(model.p_nominal)
    labels = [name.split(" ")[0] for name in model.p_names]
    behind = [name.split(" ")[0].removesuffix("_error") for name in estimation.z_names[nx:]]

    def moved(z, u, h):
        p = nominal.copy()
        for name, d in zip(behind, z[nx:], strict=True):
            at = labels.index(name)
            p[at] = p[at] * (1.0 + d) if name in ("bending_stiffness", "drive_time_constant") else p[at] + d
        return Finger(estimator, p).step(z[:nx], u, h)

    rng, h = np.random.default_rng(4), 2e-3
    scale = np.concatenate([np.sqrt(np.array(estimator.settings["initial"])[:nx]), np.full(len(behind), 0.2)])
    scale[nx + behind.index("tip_mass")] = 0.001
    z, u = scale * rng.uniform(0.2, 1.0, len(scale)), 0.05 * np.ones(model.nu)
    end, slope = (np.array(part) for part in estimation.step(z, u, nominal, h)[:2])
    assert end.ravel()[:nx] == pytest.approx(moved(z, u, h), rel=1e-10, abs=1e-12)
    expected = differences(lambda z: moved(z, u, h), z, 1e-4 * scale)
    assert slope[:nx] * scale == pytest.approx(expected * scale, rel=1e-5, abs=1e-7)


def test_values_stay_within_their_bounds_and_clipping_is_reported():
    estimator = hand()
    plant = Finger(estimator, with_values(estimator, drive_time_constant=0.05))
    estimator.reset()
    limited = False
    for u in commands(200):
        plant.advance(u)
        found = estimator.step(plant.measured, u)
        assert 0.005 <= found.adapted["drive_time_constant"].value <= 0.08 * (1 + 1e-12)
        assert found.adapted["tip_mass"].value >= 0.0
        assert found.adapted["bending_stiffness"].value > 0.0
        limited |= any("clipped" in text for text in found.anomalies)
    assert limited


CLOSED = [
    {"plant.tip_mass": 0.004},
    {"plant.time_constant": 0.04},
    {"plant.guides": 40, "plant.axial_stiffness": 1e4, "plant.stiffness": 1.3, "plant.time_constant": 0.03},
]


AS_KNOWN = {"plant": {"fidelity": {"family": "clothoid", "elements": 4}}}


@lru_cache
def controller(adapts=True) -> Controller:
    changes = {} if adapts else NOT_ADAPTED
    return Controller(load(ROOT / "configs/mpc/unknown_payload.yaml", changes), deadline=math.inf)


@pytest.mark.deep
@pytest.mark.parametrize("changes", CLOSED)
def test_in_closed_loop_fine_plants_are_found_and_followed(changes):
    """Four clothoids and a chain of 40 guides; the tip's error is at most 60 % of that without adaptation."""
    fine = {"plant": {}} if "plant.guides" in changes else AS_KNOWN
    scene = load(ROOT / "configs/mpc/unknown_payload.yaml", {**fine, **changes})
    run = run_closed_loop(scene, controller=controller())
    plain = run_closed_loop(scene.changed(NOT_ADAPTED), controller=controller(adapts=False))
    truth = {
        "bending_stiffness": changes.get("plant.stiffness", 1.0) * 6.11e-3,
        "tip_mass": 0.002 + changes.get("plant.tip_mass", 0.0),
        "drive_time_constant": changes.get("plant.time_constant", 0.02),
    }
    for name, value in truth.items():
        assert abs(run.adapted[name].value - value) < 3.0 * run.adapted[name].std, (name, run.adapted[name])
    errors = [np.mean((one.tracked[200:, :2] - one.r[200:, :2]) ** 2) for one in (run, plain)]
    assert errors[0] < 0.6**2 * errors[1]


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"parameters": ["tip_mass"]}, "bending_stiffness: needs parameters"),
        ({"estimator.adapt": {}}, "name a parameter"),
        ({"estimator.adapt.bending_stiffness": 3.0}, "bending_stiffness"),
        ({"estimator.disturbances": {"bending_stiffness": 0.1}}, "give one of both"),
        (
            {"finger.tendons.time_constant": None, "fidelity.family": "arc", "estimator.measured.tension": None},
            "needs a drive with a time_constant",
        ),
    ],
)
def test_what_cannot_be_adapted_is_refused(changes, key):
    with pytest.raises(InputError, match=key):
        load(ROOT / "configs/mpc/unknown_payload.yaml", changes)
