"""The functions of a stage against finite differences and scipy."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from continuum_grasp import Fidelity, load
from continuum_grasp.base import InputError
from continuum_grasp.control import Prediction, stages_of
from continuum_grasp.scene import ControlScene
from tests.rods import after, order
from tests.truth.differences import differences

ROOT = Path(__file__).parents[2]
ROD, HAND = (load(ROOT / "configs/fingers" / name) for name in ("nitinol_60cm.yaml", "hand_finger.yaml"))
MOMENT = {"moment_max": 0.3}


def scene(finger, *, family=None, elements=2, cost=None, **controller):
    given = {"cost": {"bending": 100.0, "effort": 1.0} if cost is None else cost, **controller}
    return ControlScene(
        finger=finger,
        gravity=(0.0, -9.81),
        fidelity=Fidelity(family=family, elements=elements),
        controller=given,
    )


CASES = {
    "arcs": scene(ROD, family="arc", input=MOMENT),
    "arcs, rate limited": scene(ROD, family="arc", input={**MOMENT, "rate_max": 2.0}),
    "matched, own lag": scene(ROD, input={**MOMENT, "time_constant": 0.02}),
    "clothoids, tendons": scene(HAND, family="clothoid", elements=1),
    "matched, tendons, rates": scene(
        HAND, cost={"bending": 100.0, "effort": 1.0, "input_rate": 0.1}, input={"rate_max": 400.0}
    ),
}


def a_state(stages, rng):
    x = rng.normal(size=stages.nx) * 0.3
    x[: stages.nd] *= np.array([30.0 if "kappa" in name and "rate" not in name else 1.0 for name in stages.x_names])[
        : stages.nd
    ]
    return x, rng.uniform(stages.u_min, stages.u_max)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("method", ["rk4", "sdirk2", "sdirk2_contact"])
def test_shapes_and_derivatives_of_a_step(name, method):
    stages = stages_of(CASES[name].changed({"controller.horizon.method": method}))
    step = stages.step
    assert [step.size_out(k) for k in range(3)] == [(stages.nx, 1), (stages.nx, stages.nx), (stages.nx, stages.nu)]
    x, u = a_state(stages, np.random.default_rng(1))
    h = 1e-4 if method == "rk4" else 1e-3
    _, a, b = (np.array(v) for v in step(x, u, stages.p_nominal, h))
    for slope, at, of in ((a, x, lambda v: (v, u)), (b, u, lambda v: (x, v))):
        end = lambda v, of=of: step(*of(v), stages.p_nominal, h)[0]  # noqa: E731
        expected = differences(end, at, 1e-6 * np.maximum(1.0, np.abs(at)))
        # The implicit step leaves out the derivative of its last Newton correction.
        allowed = (1e-6 if method == "rk4" else 2e-3) * np.maximum(1.0, np.abs(expected).max(axis=0))
        assert np.all(np.abs(slope - expected) <= allowed)


@pytest.mark.parametrize(("method", "expected"), [("rk4", 4), ("sdirk2", 2), ("sdirk2_contact", 2)])
def test_order_of_a_step(method, expected):
    stages = stages_of(CASES["arcs"].changed({"controller.horizon.method": method}))
    step = stages.step
    x0, u, span = np.array([0.4, 0.3, 0.5, 0.2]), np.array([0.1]), 0.02
    exact = after(span, lambda x: stages.dynamics(x, u, stages.p_nominal), x0)
    errors = []
    for count in (32, 64, 128):
        x = x0
        for _ in range(count):
            x = np.array(step(x, u, stages.p_nominal, span / count)[0]).ravel()
        errors.append(np.abs(x - exact)[:2].max())
    assert order(errors) == pytest.approx(expected, abs=0.4)


def test_the_implicit_step_is_stable_where_the_explicit_one_is_not():
    x = np.array(Prediction(scene(HAND, family="clothoid", elements=3)).at_rest([3.0] * 4, [5.0, 1.0]))
    ends = {}
    for method in ("rk4", "sdirk2"):
        stages, state = stages_of(scene(HAND, family="clothoid", elements=3, horizon={"method": method})), x
        for _ in range(50):
            state = np.array(stages.step(state, stages.u_min, stages.p_nominal, 0.01)[0]).ravel()
        ends[method] = state
    assert not np.all(np.isfinite(ends["rk4"]))
    assert np.abs(ends["sdirk2"][:4]).max() < 3.0


@pytest.mark.parametrize("name", CASES)
def test_cost_gradient_and_rows(name):
    stages = stages_of(CASES[name])
    rng = np.random.default_rng(2)
    x, u = a_state(stages, rng)
    r, p = rng.normal(size=stages.nr), stages.p_nominal

    def cost(z):
        return float(stages.cost(z[: stages.nx], z[stages.nx :], p, r, stages.weights)[0])

    value, g, h, c, jac = (np.array(v) for v in stages.cost(x, u, p, r, stages.weights))
    y = np.array(stages.outputs(x, u, p)).ravel()
    assert value.item() == pytest.approx(0.5 * stages.stage * float(stages.weights @ (y - r) ** 2))
    (expected,) = differences(cost, np.concatenate([x, u]))
    assert g.ravel() == pytest.approx(expected, rel=1e-5, abs=1e-5 * np.abs(expected).max())
    assert np.linalg.eigvalsh(h).min() > -1e-9 * np.abs(h).max()
    assert c.ravel() == pytest.approx(np.array(stages.rows(x, u, p)).ravel())
    assert jac.shape == (stages.nc, stages.nx + stages.nu)


def test_a_matched_tip_needs_a_lag():
    with pytest.raises(InputError, match="needs a continuous tip moment"):
        stages_of(scene(ROD, family="matched_clothoid", input=MOMENT))


def test_zones_hold_off_the_fingers_surface():
    zone = {"wall": {"type": "half_plane", "point": (0.0, 0.1), "normal_angle": -np.pi / 2, "clearance": 0.01}}
    made = scene(HAND, bounds={"keep_out": zone}, input={})
    stages = stages_of(made)
    row = stages.c_names.index("wall")
    x = Prediction(made).at_rest([0.0, 0.0], [1.0, 1.0])
    c = np.array(stages.rows(x, stages.u_min, stages.p_nominal)).ravel()[row]
    # The straight finger ends 0.18 m along Y, 0.08 m behind the wall; 6 mm of half thickness and 10 mm to keep.
    assert c * 0.18 == pytest.approx(0.1 - 0.18 - 0.006 - 0.01)


def test_what_follows_the_input_at_once_ends_under_the_input_before():
    """Of a rod that its tendons shorten; setpoints keep the order of the terms."""
    tendons = HAND.tendons.replaced(time_constant=None)
    short = HAND.replaced(tendons=tendons, gyration_radius=3e-3)
    cost, target = {"tip": {"running": 1.0, "terminal": 5.0}, "speed": 0.02, "effort": 1e-3}, (0.05, 0.1)
    given = scene(short, family="clothoid").changed({"controller.cost": cost, "reference": {"tip": target}})
    model = Prediction(given)
    stages = stages_of(given, model)
    assert stages.r_names[:2] == ("tip_x [m]", "tip_y [m]")
    rng = np.random.default_rng(5)
    x, held = rng.normal(size=stages.nd), rng.uniform(1.0, 60.0, stages.nu)

    def end(z):
        r = np.append(target, np.zeros(stages.nr - 2))
        return [np.array(v) for v in stages.terminal(z, stages.p_nominal, r, stages.terminal_weights)]

    z = np.append(x, held)
    tip = np.array(model.tip(x, held, stages.p_nominal)).ravel()
    assert end(z)[0].item() == pytest.approx(2.5 * np.sum((tip - target) ** 2), rel=1e-12)
    assert end(z)[1].ravel() == pytest.approx(differences(lambda z: end(z)[0], z)[0], abs=1e-7)


@pytest.mark.parametrize("quadratic", [1e-3, 1e-2])
def test_fastest_rate_bounds_that_of_a_finger_springing_back_against_quadratic_damping(quadratic):
    """From half the bending range, by CVODES."""
    damped = ROD.replaced(damping=ROD.damping.replaced(quadratic=quadratic))
    given = {"family": "arc", "elements": 1, "input": {**MOMENT, "time_constant": 0.1}}
    made = scene(damped, **given).replaced(gravity=(0.0, 0.0))
    model, limits = Prediction(made), np.array(made.input_limits)
    found, at_rest = model.fastest_rate(*limits), Prediction(scene(ROD, **given)).fastest_rate(*limits)
    slope = ca.jacobian(model.dynamics(model.x, model.u, model.p), model.x)
    slope = ca.Function("slope", [model.x, model.u, model.p], [slope])
    given = {"x": model.x, "p": model.u, "ode": model.dynamics(model.x, model.u, model.p_nominal)}
    exact, rest = ca.integrator("exact", "cvodes", given, 0.0, 0.02), np.array(made.rest_input)
    x, fastest = model.at_rest(0.5 * np.array(model.system.structure.coordinate_limits()), rest), 0.0
    for _ in range(25):
        x = np.array(exact(x0=x, p=rest)["xf"]).ravel()
        fastest = max(fastest, np.abs(np.linalg.eigvals(np.array(slope(x, rest, model.p_nominal)))).max())
    assert 2.0 * at_rest < fastest
    assert 0.7 * fastest < found < 5.0 * fastest
