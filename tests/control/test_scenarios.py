"""Scenarios: QPs of several plants with inputs in common, their nonlinear problems, controllers that plan for them."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy.linalg import block_diag

import continuum_grasp as cg
from benchmarks.real_time_iteration import RealTimeIteration
from continuum_grasp.base import InputError
from continuum_grasp.control import Stages, stages_of
from continuum_grasp.core import Compiler
from tests.control_cases import HAND, Reality, hand_scene, swing_scene
from tests.marks import few
from tests.rti_cases import QP, SIZES, PlanOf, by_ipopt, change_of_plan, disturb, qp_of, random_scenarios

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

PLANTS = ({"stiffness": 0.6, "weight": 2.0}, {}, {"stiffness": 1.7, "time_constant": 0.05, "tip_mass": 0.003})
TIP = np.array([-0.08, 0.12])
HORIZON = 5


@lru_cache
def stages(plants=2, order=None, weights=None) -> Stages:
    """Of the hand finger, whose state is known; scenarios in an order, with other weights."""
    chosen = [PLANTS[k] for k in (range(plants) if order is None else order)]
    if weights is not None:
        chosen = [{**one, "weight": weight} for one, weight in zip(chosen, weights, strict=True)]
    return stages_of(hand(chosen))


def hand(scenarios, **changes):
    """The hand finger with scenarios, as a mapping per plant; None: without."""
    asked = {
        "horizon": {"stages": HORIZON, "stage": 0.01},
        "cost": {"tip": {"running": 2e4, "terminal": 2e3}, "effort": 0.01, "input_rate": 1e-4},
        "input": {"rate_max": 3000.0},
        "scenarios": tuple(scenarios or ()),
    }
    return hand_scene(controller=asked, **{"estimator": None, **changes})


def joint(rti: RealTimeIteration, x0: np.ndarray) -> QP:
    """The QP of the last preparation as one of all scenarios, whose first inputs are equal by constraints."""
    s = rti.stages
    own = [qp_of(PlanOf(rti, b), x0) for b in range(s.plants)]
    size, nz, ties = len(own[0].g), s.nx + s.nu, []
    for b in range(1, s.plants):
        for at in range(s.nx, nz):
            tie = np.zeros(s.plants * size)
            tie[at], tie[b * size + at] = 1.0, -1.0
            ties.append(tie)

    def all_of(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for one in own])

    equal = np.vstack([block_diag(*[one.E for one in own]), *ties])
    vectors = [all_of(name) for name in ("low", "high")]
    rows = [all_of(name) for name in ("c_min", "c_max", "linear", "quadratic")]
    hessian, matrix = (block_diag(*[getattr(one, name) for one in own]) for name in "HC")
    return QP(hessian, all_of("g"), equal, np.r_[all_of("e"), np.zeros(len(ties))], *vectors, matrix, *rows)


QPS = [
    ((5, 2, 1, 1, 1), 2),
    ((4, 3, 2, 2, 1), 3),
    *[(size, plants) for size in SIZES for plants in (2, 5)],
]
"""Sizes of stages, number of plants."""


@pytest.mark.parametrize(("size", "plants"), few(QPS, 2))
def test_the_qp_is_that_of_all_scenarios_with_equal_first_inputs(size, plants):
    """By qpOASES; of random dynamics, bounds and penalties."""
    rng = np.random.default_rng(size[0] + plants)
    weights = rng.uniform(0.2, 2.0, plants)
    shift = rng.uniform(-0.3, 0.3, (plants, 1))
    rti = RealTimeIteration(random_scenarios(plants, size, weights, shift), lanes=bool(plants % 2))
    for _ in range(4):
        x0 = disturb(rti, rng)
        problem = joint(rti, x0)
        report = rti.feedback(x0)
        expected = problem.solve()
        found = np.concatenate([change_of_plan(PlanOf(rti, b)) for b in range(plants)])
        assert report.status in (0, 2)
        assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max()
        constant = rti.qp()["l"].sum()
        assert plants * report.cost - constant == pytest.approx(problem.cost(expected), rel=1e-5, abs=1e-5)


def converged(s: Stages, x0: np.ndarray, reference: np.ndarray, precision="double", count=25) -> RealTimeIteration:
    """Iterations from one state until nothing moves."""
    rti = RealTimeIteration(s, precision=precision)
    rti.settings.iterations = 200
    rti.reset(x0, x0[-s.nu :], rollout=True)
    for _ in range(count):
        report = rti.step(x0, reference)
        assert report.status in (0, 2)
    return rti


def begin(s: Stages) -> tuple[np.ndarray, np.ndarray]:
    """A state with some bend and speed, the input before; setpoints."""
    x0, reference = np.zeros(s.nx), np.zeros(s.nr)
    x0[:4], x0[-s.nu :] = (3.0, 1.0, 20.0, -10.0), (3.0, 1.0)
    reference[:2] = TIP
    return x0, reference


@pytest.mark.deep
@pytest.mark.parametrize("plants", few([2, 3], 1))
def test_iterations_converge_to_what_ipopt_finds(plants):
    s = stages(plants)
    x0, reference = begin(s)
    inputs = converged(s, x0, reference).plan[1].reshape(s.plants, s.stages, s.nu)
    expected = by_ipopt(s, x0, reference, tolerance=1e-10)[1].reshape(inputs.shape)
    assert np.abs(inputs - expected).max() <= 1e-4 * np.abs(expected).max()
    assert np.ptp(inputs[:, 0], axis=0).max() == 0.0
    assert s.u_min.min() + 0.1 < inputs[0, 0].max() < s.u_max.max() - 0.1
    # The plants differ, and so do their plans as soon as they may.
    assert np.ptp(inputs[:, 1], axis=0).max() > 0.1  # N


def test_the_order_of_scenarios_is_that_of_the_plans_alone():
    one, other = stages(3), stages(3, order=(2, 0, 1))
    x0, reference = begin(one)
    plans = [converged(s, x0, reference).plan[1].reshape(3, -1) for s in (one, other)]
    np.testing.assert_allclose(plans[1], plans[0][[2, 0, 1]], rtol=1e-7, atol=1e-7)


def commands(scene, steps=15) -> np.ndarray:
    """Of a closed loop on the model's own plant."""
    control = cg.Controller(scene, deadline=math.inf)
    plant = Reality(hand(None), control.first)
    found = []
    for _ in range(steps):
        y = plant.x if scene.estimator is None else [*plant.tip, *_tensions(plant)]
        found.append(control.step(y).u)
        plant.advance(found[-1], control.period)
    assert control.statistics["fallbacks"] == 0
    return np.array(found)


def _tensions(plant: Reality) -> tuple[float, float]:
    pull = plant.x[4] / 0.005  # moment per offset of the tendons [N]
    return 1.0 + max(pull, 0.0), 1.0 + max(-pull, 0.0)


@pytest.mark.deep
def test_equal_scenarios_command_what_one_does():
    """Also with an estimator of the stiffness, on which their factors act; whatever their weights."""
    estimator = {
        "measured": {"tip": 3e-4, "tension": 0.1},
        "disturbances": {"tip_moment": 0.02, "bending_stiffness": 0.1},
    }
    changes = {"estimator": estimator, "parameters": ("bending_stiffness",), "reference": {"tip": (-0.06, 0.15)}}
    alone = commands(hand(None, **changes))
    three = [{"stiffness": 1.0}, {"weight": 3.0}, {"tip_mass": 0.0}]
    np.testing.assert_allclose(commands(hand(three, **changes)), alone, rtol=1e-6, atol=1e-6)


def test_parameters_are_changed_as_scenarios_say():
    s = stages(3)
    names = [name.split(" ")[0] for name in s.p_names]
    p = {n: s.scenarios.scale[:, k] * s.p_nominal[k] + s.scenarios.shift[:, k] for k, n in enumerate(names)}
    nominal = dict(zip(names, s.p_nominal, strict=True))
    np.testing.assert_allclose(p["bending_stiffness"] / nominal["bending_stiffness"], [0.6, 1.0, 1.7])
    np.testing.assert_allclose(p["drive_time_constant"], [nominal["drive_time_constant"]] * 2 + [0.05])
    np.testing.assert_allclose(p["tip_mass"] - nominal["tip_mass"], [0.0, 0.0, 0.003])
    assert s.scenarios.weights == pytest.approx([1.5, 0.75, 0.75])


def test_a_stiffer_scenario_has_more_steps_if_it_needs_them():
    def steps(scenarios):
        return stages_of(hand(scenarios).changed({"controller.horizon.method": "rk4"})).substeps

    assert steps([{}, {"time_constant": 0.002}]) > steps(None)


@pytest.mark.parametrize(
    ("scenarios", "said"),
    [
        ([{}], "2 to 8"),
        ([{}, {"stiffnes": 2.0}], "stiffness"),
        ([{}, {"stiffness": -1.0}], "greater than 0"),
        ([{}, {"tendon_friction": 0.2}], r"scenarios\[1\].tendon_friction: needs finger.tendons.friction"),
        ([{}, {"series_stiffness": 1e4}], r"scenarios\[1\].series_stiffness: has no effect"),
    ],
)
def test_scenarios_that_cannot_be_are_refused(scenarios, said):
    with pytest.raises(InputError, match=said):
        hand(scenarios)


def test_what_a_finger_lacks_no_scenario_changes():
    with pytest.raises(InputError, match="time_constant: works only for commanded tensions"):
        swing_scene(controller={"scenarios": ({}, {"time_constant": 0.01})})
    undamped = HAND.replaced(damping={})
    with pytest.raises(InputError, match=r"finger\.damping\.material above 0"):
        hand([{}, {"damping": 2.0}], finger=undamped)
