"""Derivatives of functions and rollouts of many rows; from inside: operators in numpy, without torch or jax.

Derivatives of functions and rollouts of many rows, against finite differences and by the adjoint identity.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.learning.operators.derivatives import METHODS, Recursion, RowFunction, held_step
from continuum_grasp.core import Core
from continuum_grasp.scene import Circle, ContactLaw, Surroundings
from tests.marks import few

ROD = cg.Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01)
PARAMETERS = ["bending_stiffness", "material_damping"]


def plain(**options):
    """A finger of few elements."""
    options = {"family": "arc", "elements": 2, "parameters": PARAMETERS} | options
    return cg.FingerModel(cg.Finger(rod=ROD, damping=cg.Damping(material=1e-5)), **options)


def with_tendon_friction():
    """Friction states behind the coordinates and rates."""
    tendons = cg.Tendons(offset=0.005, max_tension=20.0, friction=0.2, presliding=2e-4)
    return cg.FingerModel(
        cg.Finger(rod=ROD, damping=cg.Damping(material=1e-5), tendons=tendons), family="arc", elements=2
    )


def in_contact(stiffness=20_000.0):
    """The tip is pressed into a disc."""
    disc = Circle(shape="circle", diameter=0.06, mass=0.1, position=(0.0325, 0.18))
    around = Surroundings(object=disc, contact_law=ContactLaw(stiffness=stiffness, friction=0.5))
    finger = cg.Finger(rod=ROD, damping=cg.Damping(material=1e-5), half_thickness=0.003)
    return cg.System(finger, surroundings=around, family="arc", elements=2)


def rows_of(model, count, straight=False):
    """Random states, inputs, forces and parameters."""
    rng = np.random.default_rng(3)
    x = 0.0 * rng.normal(size=(count, model.nx)) if straight else 0.1 * rng.normal(size=(count, model.nx))
    if isinstance(model, cg.System):
        x = x * 1e-2 + np.array(model.state())
    u, w = (rng.uniform(0.5, 1.0, (count, size)) for size in (model.nu, model.nw))
    return [x, u, 0.1 * w, np.tile(np.array(model.p_nominal), (count, 1))]


def differences(operator, arrays, tangents, size=1e-6):
    """Central differences of all outputs along tangents."""
    ahead, back = (operator([a + sign * size * t for a, t in zip(arrays, tangents, strict=True)]) for sign in (1, -1))
    return [(a - b) / (2.0 * size) for a, b in zip(ahead, back, strict=True)]


def tangents_of(arrays, seed=5):
    rng = np.random.default_rng(seed)
    return [rng.normal(size=a.shape) * np.maximum(np.abs(a), 1e-3) for a in arrays]


def check(operator, arrays, tolerance):
    """Push against differences, pull against push, and one row alone against all, to the bit."""
    outputs = operator(arrays)
    tangents, rng = tangents_of(arrays), np.random.default_rng(7)
    pushed, given = operator.push(operator.residuals(arrays, outputs), tangents)
    forward = pushed(given)
    for found, expected in zip(forward, differences(operator, arrays, tangents), strict=True):
        assert np.abs(found - expected).max(initial=0.0) <= tolerance * np.abs(expected).max(initial=1e-300)
    cotangents = [rng.normal(size=out.shape) for out in outputs]
    pulled, needed, pick = operator.pull(operator.residuals(arrays, outputs), cotangents)
    back = pick(pulled(needed))
    there = sum(float((a * b).sum()) for a, b in zip(cotangents, forward, strict=True))
    here = sum(float((a * b).sum()) for a, b in zip(back, tangents, strict=True))
    terms = sum(float(np.abs(a * b).sum()) for a, b in zip(cotangents, forward, strict=True))
    terms += sum(float(np.abs(a * b).sum()) for a, b in zip(back, tangents, strict=True))
    assert abs(there - here) <= 1e-12 * terms
    for one, args in ((operator, arrays), (pushed, given), (pulled, needed)):
        alone, together = one([a[2:3] for a in args]), one(args)
        assert all(np.array_equal(a[0], b[2]) for a, b in zip(alone, together, strict=True))
    return pulled, needed


@pytest.mark.parametrize(
    "name", few(["forward_dynamics", "tip", "joints", "energy", "inverse_dynamics", "mass_matrix", "statics"], 4)
)
def test_functions(name):
    model = plain()
    function = getattr(model, name)
    x, u, w, p = rows_of(model, 11)
    values = {"x": x, "u": u, "w": w, "p": p, "q": x[:, :2], "qd": x[:, 2:], "qdd": x[:, 2:]}
    check(RowFunction(function, Core(model)), [values[key] for key in function.name_in()], 1e-7)


CASES = {
    "straight": (plain, True, 1e-7),
    "tendon friction": (with_tendon_friction, False, 1e-6),
    "contact of 20 kN/m": (in_contact, False, 1e-6),
    "clothoids": (lambda: plain(family="clothoid"), False, 1e-7),
    "many elements": (lambda: plain(elements=16, parameters=["bending_stiffness"]), False, 1e-6),
}


@pytest.mark.parametrize("case", few(CASES, 3))
def test_dynamics_of_hard_cases(case):
    build, straight, tolerance = CASES[case]
    model = build()
    check(RowFunction(model.forward_dynamics, Core(model)), rows_of(model, 11, straight), tolerance)


def rollout_rows(model, count, step, rows=(2, 1)):
    x, u, w, p = rows_of(model, count)
    u = np.stack([(1.0 + k) * u for k in range(rows[0])], axis=1)
    w = np.stack([(1.0 - k) * w for k in range(rows[1])], axis=1)
    return [x, u, w, p[:, None], np.full((count, 1, 1), step)]


@pytest.mark.deep
@pytest.mark.parametrize("method", few(["rk4", "sdirk2", *(m for m in METHODS if m not in ("rk4", "sdirk2"))], 2))
def test_rollouts(method):
    """With inputs that hold for two steps, by every method; and the derivatives of the derivatives."""
    model = plain()
    operator = Recursion(held_step(model, method), Core(model)).over(4)
    pulled, needed = check(operator, rollout_rows(model, 5, 1e-4), 1e-6)
    check(pulled, needed, 1e-6)


@pytest.mark.deep
@pytest.mark.parametrize("case", CASES)
def test_rollouts_of_hard_cases(case):
    build, _, tolerance = CASES[case]
    model = build()
    # Sixteen elements have motions that an explicit step of this length does not resolve, and second derivatives of
    # their dynamics, which those of rodas need, compile for minutes.
    methods = ["extrapolated_euler"] if case == "many elements" else ["rk4", "sdirk2", "rodas"]
    for method in methods:
        operator = Recursion(held_step(model, method), Core(model)).over(6)
        check(operator, rollout_rows(model, 5, 1e-5), 10.0 * tolerance)


@pytest.mark.parametrize("method", few(["rk4", "rodas", "implicit_midpoint"], 1))
def test_rollouts_are_those_of_the_core(method):
    model = plain()
    core = Core(model)
    rows = rollout_rows(model, 3, 1e-4, (1, 1))
    found = Recursion(held_step(model, method), core).over(10)(rows)[0]
    expected = core.rollout(rows[0], 10, 1e-4, u=rows[1][:, 0], w=rows[2][:, 0], p=model.p_nominal, method=method)
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()


def test_the_virtual_machine_gives_the_same():
    model = plain()
    rows = rollout_rows(model, 3, 1e-4)
    results = []
    for compiled in (True, False):
        operator = Recursion(held_step(model, "rk4"), Core(model, compiled=compiled)).over(4)
        outputs = operator(rows)
        pulled, needed, pick = operator.pull(operator.residuals(rows, outputs), [np.ones_like(outputs[0])])
        results.append([*outputs, *pick(pulled(needed))])
    for one, other in zip(*results, strict=True):
        assert np.abs(one - other).max() <= 1e-11 * np.abs(one).max()


def test_a_recursion_by_hand():
    """X' = a x + u over three steps back and forth, whose derivatives are known."""
    x, u, a = (ca.SX.sym(name) for name in "xua")
    function = ca.Function("linear", [x, u, a], [a * x + u], ["x", "u", "a"], ["xn"])
    operator = Recursion(function, Core(plain())).over(3)
    rows = [np.array([[2.0]]), np.array([[[1.0], [2.0], [3.0]]]), np.array([[[0.5]]])]
    (states,) = operator(rows)
    assert states.ravel().tolist() == [2.0, 2.0, 3.0, 4.5]
    last = np.zeros((1, 4, 1))
    last[0, 3] = 1.0
    pulled, needed, pick = operator.pull(operator.residuals(rows, [states]), [last])
    by_start, by_input, by_factor = pick(pulled(needed))
    assert by_start.ravel().tolist() == [0.125]
    assert by_input.ravel().tolist() == [0.25, 0.5, 1.0]
    # d/da of a^3 x + a^2 u0 + a u1 + u2
    assert by_factor.ravel().tolist() == [3 * 0.25 * 2.0 + 2 * 0.5 * 1.0 + 2.0]
    along = [np.zeros((1, 1)), np.zeros((1, 3, 1)), np.ones((1, 1, 1))]
    pushed, given = operator.push(operator.residuals(rows, [states]), along)
    assert pushed(given)[0].ravel().tolist() == [0.0, 2.0, 2 * 0.5 * 2.0 + 1.0, by_factor.item()]
    # Cotangents are linear in those of the last state, which are all there are: pushed along themselves they stay.
    found = pulled(needed)
    along = [needed[0], *map(np.zeros_like, needed[1:])]
    pushed, given = pulled.push(pulled.residuals(needed, found), along)
    assert [out.tolist() for out in pushed(given)] == [out.tolist() for out in found]


def test_no_rows_give_none():
    model = plain()
    operator = Recursion(held_step(model, "rk4"), Core(model)).over(4)
    assert operator([row[:0] for row in rollout_rows(model, 3, 1e-4)])[0].shape == (0, 5, 4)
    assert RowFunction(model.tip, Core(model))([np.zeros((0, n)) for n in (2, 1, 2)])[0].shape == (0, 2)
