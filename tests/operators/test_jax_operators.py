"""Operators on JAX arrays: JAX's own check of gradients, transformations, shapes, types and errors."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.learning import JaxOperators
from tests.marks import optional
from tests.operators.operator_cases import FINGER, MODEL, SCALE, start

jax, jnp, test_util = optional("jax"), optional("jax.numpy"), optional("jax.test_util")

COSTLY_FIXTURES = ("operators",)


@pytest.fixture(autouse=True)
def doubles():
    """As of JAX itself, single precision is what is left when a test is over."""
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.fixture(scope="module")
def operators():
    return JaxOperators(MODEL)


def given():
    return [jnp.array(value) for value in start()]


@pytest.mark.deep
def test_gradients(operators):
    x, u, p = given()
    test_util.check_grads(operators.tip, (x[:, :2], u[0], p), order=2, modes=("fwd", "rev"))
    test_util.check_grads(lambda x, p: 1e-4 * operators.forward_dynamics(x, p=p), (x, p), order=1, eps=1e-6)
    test_util.check_grads(
        lambda x, u: SCALE * operators.rollout(x, 8, 1e-5, u=u, substeps=2), (x, u), order=1, eps=1e-6, rtol=1e-5
    )


@pytest.mark.deep
def test_second_derivatives_of_rollouts(operators):
    x, u, p = given()
    end = lambda x, u, p: SCALE * operators.rollout(x, 8, 1e-5, u=u, p=p)[:, -1]  # noqa: E731
    test_util.check_grads(end, (x, u, p), order=2, eps=1e-5, atol=1e-3, rtol=1e-3)


@pytest.mark.deep
def test_transformations_agree(operators):
    x, u, p = given()

    def loss(x, u):
        return ((SCALE * operators.rollout(x, 4, 1e-4, u=u, p=p)) ** 2).sum()

    each = jnp.stack([jax.grad(loss)(row, u) for row in x])
    assert np.array_equal(jax.vmap(jax.grad(loss), in_axes=(0, None))(x, u), each)
    assert np.allclose(jax.jit(jax.vmap(jax.grad(loss), in_axes=(0, None)))(x, u), each, rtol=1e-13)
    both = [jax.jit(way(lambda q: operators.position(q, s=0.1)))(x[0, :2]) for way in (jax.jacfwd, jax.jacrev)]
    assert np.allclose(*both, rtol=1e-13)
    assert np.allclose(both[0], np.array(MODEL.jacobian(x[0, :2], 0.0, 0.1, p)), rtol=1e-12)
    hessian = jax.hessian(lambda q: operators.tip(q)[0])(x[0, :2])
    assert np.allclose(hessian, hessian.T, rtol=1e-13)


def test_types(operators):
    x, _, p = (value.astype(jnp.float32) for value in given())
    found = operators.forward_dynamics(x, p=p)
    assert found.dtype == jnp.float32
    exact = operators.forward_dynamics(x.astype(jnp.float64), p=p)
    assert np.array_equal(found, exact.astype(jnp.float32))
    assert operators.tip(np.zeros(2, np.float32), np.zeros(1)).dtype == jnp.float64


def test_an_input_of_one_entry_may_be_a_number(operators):
    x, _, p = given()
    for motion in (
        lambda u: operators.rollout(x, 2, 1e-5, u=u, p=p),
        lambda u: operators.step(x, 1e-5, u=u, p=p),
        lambda u: operators.forward_dynamics(x, u, p=p),
    ):
        assert np.array_equal(motion(0.01), motion(jnp.array([0.01])))
        assert not np.array_equal(motion(0.01), motion(jnp.array([0.02])))


def test_no_rows_are_mapped_to_none(operators):
    x = given()[0][:0]
    assert jax.vmap(operators.tip)(x[:, :2]).shape == (0, 2)
    assert jax.vmap(lambda x: operators.rollout(x, 3, 1e-5))(x).shape == (0, 4, 4)


def test_what_does_not_fit_is_refused(operators):
    x, u, _ = given()
    for wrong, said in [
        (
            lambda: operators.forward_dynamics(x[:, :3]),
            "forward_dynamics: x has 4 entries, got an array of shape (3, 3)",
        ),
        (lambda: operators.forward_dynamics(x, jnp.zeros((2, 1))), "leading dimensions do not match"),
        (lambda: operators.forward_dynamics(x.astype(int)), "x: expected an array of float64 or float32, got int64"),
        (lambda: operators.forward_dynamics("x"), "x: expected an array of numbers"),
        (lambda: operators.tip(x[:, :2], v=u), "tip: unknown input 'v', expected q, u, p"),
        (lambda: operators.tip(x[:, :2], q=x), "tip: q is given twice"),
        (lambda: operators.position(x[:, :2], s=0.2), "position: s: expected a position from 0 to the length 0.18 m"),
        (lambda: operators.rollout(x, 4, 1e-4, u=jnp.zeros((3, 1))), "divides the 4 steps"),
        (lambda: operators.step(x, 1e-4, w=0.1), "w: expected (..., rows, 2)"),
        (lambda: operators.rollout(x, 4, -1.0), "step: expected a finite number above 0"),
        (lambda: operators.rollout(x, 4, 1e-4, method="euler"), "method: expected one of rk4"),
        (lambda: operators.rollout(x.at[1, 2].set(jnp.nan), 4, 1e-4), "x0[1, 2]: expected a finite number, got nan"),
    ]:
        with pytest.raises(cg.InputError) as caught:
            wrong()
        assert said in str(caught.value)
    with pytest.raises(AttributeError, match="no operator 'grip': expected one of"):
        _ = operators.grip


def test_what_is_not_finite(operators):
    x, _, _ = given()
    with pytest.raises(cg.NumericalError, match="in 3 of 3 rollouts"):
        operators.rollout(1e3 * x, 20, 1e-1)
    with pytest.raises(Exception, match="in 3 of 3 rollouts"):
        jax.jit(lambda x: operators.rollout(x, 20, 1e-1))(1e3 * x).block_until_ready()
    lenient = JaxOperators(MODEL, nonfinite="nan")
    found = lenient.rollout(x.at[1, 2].set(jnp.nan), 4, 1e-4)
    assert np.isnan(found[1, 1:]).any()
    assert np.array_equal(found[2], operators.rollout(x[2], 4, 1e-4))
    assert np.isnan(operators.forward_dynamics(x.at[1, 2].set(jnp.nan))[1]).any()


def test_a_moment_that_must_not_vary_is_refused():
    model = cg.FingerModel(FINGER, family="matched_clothoid", elements=1)
    with pytest.raises(cg.InputError, match="u: the tip moment varies"):
        JaxOperators(model).rollout(jnp.zeros(model.nx), 2, 1e-5, u=jnp.array([[0.0], [1e-3]]))
