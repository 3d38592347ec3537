"""The implicit midpoint rule: symplectic, symmetric, of bounded energy, and honest where its iterations fail."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp.core import Core
from continuum_grasp.errors import NumericalError
from continuum_grasp.scene import Finger, PointMass
from continuum_grasp.scene.integrators import INTEGRATORS
from tests.finger_cases import ROD

METHOD = "implicit_midpoint"
START = np.array([0.5, 0.8, 0.0, 0.0])


@lru_cache
def undamped():
    """Two arcs with a tip mass in gravity: conservative, with a mass matrix that varies with the shape."""
    finger = Finger(rod=ROD.model_copy(update={"bending_stiffness": 0.5}), masses=(PointMass(at=0.6, mass=0.02),))
    model = cg.FingerModel(finger, gravity=(0.0, -9.81), family="arc", elements=2)
    return model, Core(model)


def energy(states: np.ndarray) -> np.ndarray:
    model, core = undamped()
    kinetic, potential = core.batch("energy", states, np.zeros(model.nu), None)
    return (kinetic + potential).ravel()


def test_the_error_against_an_independent_integrator_is_of_order_two():
    model, core = undamped()
    none = [0.0] * model.nu, [0.0] * model.nw, model.p_nominal
    truth = solve_ivp(
        lambda t, x: np.array(model.forward_dynamics(x, *none)).ravel(),
        (0.0, 0.4),
        START,
        "DOP853",
        rtol=1e-11,
        atol=1e-12,
    ).y[:, -1]
    errors = [np.abs(core.rollout(START, n, 0.4 / n, method=METHOD)[-1] - truth).max() for n in (200, 400, 800)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("method", [name for name, method in INTEGRATORS.items() if method.symplectic])
def test_a_step_of_a_symplectic_method_preserves_the_symplectic_form(method):
    model, core = undamped()
    n, h, rng = model.n, 5e-3, np.random.default_rng(0)
    x = ca.SX.sym("x", model.nx)
    u, p = ca.SX.zeros(model.nu), ca.DM(model.p_nominal)
    canonical = ca.vertcat(x[:n], ca.mtimes(model.mass_matrix(x[:n], u, p), x[n:]))
    slope = ca.Function("slope", [x], [ca.jacobian(canonical, x)])
    form = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    for at in rng.uniform(-1.0, 1.0, (3, model.nx)) * [1.0, 1.0, 8.0, 8.0]:
        spread = 1e-5 * np.vstack([np.eye(model.nx), -np.eye(model.nx)])
        ends = core.rollout(at + spread, 1, h, method=method)[:, 1]
        by_x = (ends[: model.nx] - ends[model.nx :]).T / 2e-5
        end = core.rollout(at, 1, h, method=method)[-1]
        moved = np.array(slope(end)) @ by_x @ np.linalg.inv(np.array(slope(at)))
        assert moved.T @ form @ moved == pytest.approx(form, abs=2e-6)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_step_too_long_to_converge_is_reported(compiled):
    core = Core(undamped()[0], compiled=compiled)
    with pytest.raises(NumericalError, match=r"Newton's method did not converge within a step after t = .* s"):
        core.rollout([1.5, -1.5, 40.0, -90.0], 20, 0.2, method=METHOD)
