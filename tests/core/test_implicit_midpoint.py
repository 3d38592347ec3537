"""The implicit midpoint rule: symplectic, symmetric, of bounded energy, and honest where its iterations fail."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import NumericalError
from continuum_grasp.core import Core
from continuum_grasp.scene import INTEGRATORS, Finger, PointMass
from tests.finger_cases import ROD
from tests.rods import after, order

METHOD = "implicit_midpoint"
START = np.array([0.5, 0.8, 0.0, 0.0])


PERIOD = 0.5


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
    truth = after(0.4, lambda x: model.forward_dynamics(x, *none), START)
    errors = [np.abs(core.rollout(START, n, 0.4 / n, method=METHOD)[-1] - truth).max() for n in (200, 400, 800)]
    assert order(errors) == pytest.approx(2.0, abs=0.05)


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


def test_a_step_back_undoes_a_step():
    model, core = undamped()
    at = np.array([0.5, 0.8, 3.0, -5.0])
    step, none = core.step_function(METHOD), [[0.0] * model.nu] * 3 + [[0.0] * model.nw] * 3 + [model.p_nominal]
    there = step(at, *none, 4e-3)
    assert np.array(step(there, *none, -4e-3)).ravel() == pytest.approx(at, abs=1e-8)


def test_the_energy_stays_within_a_bound_where_that_of_rk4_drifts():
    h, periods = 4e-3, 150
    steps = round(periods * PERIOD / h)
    found = {m: energy(undamped()[1].rollout(START, steps, h, method=m)) for m in (METHOD, "rk4")}
    early, late = slice(0, steps // 5), slice(-(steps // 5), None)
    swing = np.ptp(
        undamped()[1].batch("energy", undamped()[1].rollout(START, 200, h), np.zeros(undamped()[0].nu), None)[1]
    )
    off = {m: (e - e[0]) / swing for m, e in found.items()}
    assert np.abs(off[METHOD]).max() < 5e-3
    assert np.abs(off[METHOD][late]).max() < 1.1 * np.abs(off[METHOD][early]).max()
    assert abs(off[METHOD][late].mean() - off[METHOD][early].mean()) < 1e-5
    assert off["rk4"][late].mean() < 4.0 * off["rk4"][early].mean() < 0.0


@pytest.mark.parametrize("compiled", [True, False])
def test_a_step_too_long_to_converge_is_reported(compiled):
    core = Core(undamped()[0], compiled=compiled)
    with pytest.raises(NumericalError, match=r"Newton's method did not converge within a step after t = .* s"):
        core.rollout([1.5, -1.5, 40.0, -90.0], 20, 0.2, method=METHOD)
