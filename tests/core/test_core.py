"""The compiled core against CasADi's virtual machine; from inside: files of the cache, and which warnings were given.

The compiled core against CasADi's virtual machine and plain numpy; its cache, its fallback and its errors.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError, NumericalError
from continuum_grasp.core import (
    CompileError,
    Compiler,
    cache,
    code,
    core,
    step_function,
)
from continuum_grasp.core.batches import Scan
from continuum_grasp.core.cache import cache_folder
from continuum_grasp.core.code import Backend
from continuum_grasp.core.integrators.derivatives import solve
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import INTEGRATORS, Finger, PointMass, Tendons
from tests.finger_cases import FAMILIES, LOADS, ROD, Case, evaluate, relative_error, state
from tests.marks import few

needs_compiler = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")


@lru_cache
def full(family: str):
    """A finger with everything, its compiled core and a state."""
    case = Case(loads=LOADS, contacts=(0.25,), options={"parameters": ("gravity", "tip_mass")})
    model = case.model(family)
    return model, cg.compile(model, ()), state(model, 1.2)


@lru_cache
def small(family: str = "arc"):
    """A light finger for rollouts, with tendons and tip force."""
    finger = Finger(
        rod=ROD.model_copy(update={"bending_stiffness": 2.0}),
        masses=(PointMass(at=0.6, mass=0.3),),
        tendons=Tendons(offset=0.02, max_tension=50.0),
    )
    rates = True if family == "matched_clothoid" else None  # its tip moves with the moment
    model = cg.FingerModel(finger, family=family, elements=2, input_rates=rates)
    return model, cg.compile(model)


def inputs_of(model, name: str, at) -> list:
    values = {"x": at.x, "q": at.q, "qd": at.qd, "qdd": 3 * at.qd, "u": at.u, "w": at.w, "s": 0.41}
    values["p"] = 1.1 * np.array(model.p_nominal)
    return [values[key] for key in getattr(model, name).name_in()]


# Functions.


@pytest.mark.parametrize("name", cg.FingerModel.function_names())
@pytest.mark.parametrize("family", few(sorted(FAMILIES, reverse=True), 1))
def test_compiled_functions_are_those_of_the_virtual_machine(family, name):
    model, compiled, at = full(family)
    arguments = inputs_of(model, name, at)
    expected = getattr(model, name).call(arguments)
    values = getattr(compiled, name)(*arguments)
    values = values if isinstance(values, tuple) else (values,)
    for output, value, true in zip(getattr(model, name).name_out(), values, expected, strict=True):
        assert value.shape == (true.shape if f"{name}.{output}" in FingerModel.MATRICES else (true.shape[0],))
        assert relative_error(value, np.array(true).reshape(value.shape)) <= 1e-12


def test_arguments_by_place_and_by_name():
    model, compiled, at = full("arc")
    by_place = compiled.forward_dynamics(at.x, at.u, at.w, model.p_nominal)
    assert compiled.forward_dynamics(at.x, w=at.w, u=list(at.u)) == pytest.approx(by_place, abs=0)
    nothing = compiled.forward_dynamics(at.x)
    zeros = compiled.forward_dynamics(at.x, 0 * at.u, 0 * at.w, model.p_nominal)
    assert nothing == pytest.approx(zeros, abs=0)
    assert compiled.position(at.q, s=0.3) == pytest.approx(
        evaluate(model.position, at.q, 0 * at.u, 0.3, model.p_nominal)
    )
    kinetic, potential = compiled.energy(at.x, at.u)
    assert kinetic.shape == potential.shape == (1,)


# Batches.


@pytest.mark.parametrize("count", [1, 7, 8, 9, 4097])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_batch_is_its_states_one_by_one(family, count):
    model, compiled, at = full(family)
    rng = np.random.default_rng(count)
    x = at.x * rng.uniform(0.5, 1.2, (count, model.nx))
    w = rng.uniform(-1, 1, (count, model.nw))
    rows = compiled.batch("forward_dynamics", x, at.u, w)
    assert rows.shape == (count, model.nx)
    for k in {*range(min(count, 20)), *range(0, count, 97), count - 1}:
        assert relative_error(rows[k], compiled.forward_dynamics(x[k], at.u, w[k])) <= 1e-12, k


@pytest.mark.parametrize("name", cg.FingerModel.function_names())
def test_every_function_batches(name):
    model, compiled, at = full("arc")
    arguments = inputs_of(model, name, at)
    many = [np.outer(np.linspace(0.5, 1.0, 9), a) if k == 0 else a for k, a in enumerate(arguments)]
    rows = compiled.batch(name, *many)
    for k in (0, 4, 8):
        one = getattr(compiled, name)(many[0][k], *many[1:])
        pairs = zip(rows, one, strict=True) if isinstance(one, tuple) else [(rows, one)]
        for row, value in pairs:
            assert row[k].shape == value.shape
            assert relative_error(row[k], value) <= 1e-12


def test_any_input_may_be_one_row_for_all():
    model, compiled, at = full("arc")
    x, u, w, p = at.x, at.u, at.w, np.array(model.p_nominal)
    expected = compiled.forward_dynamics(x, u, w, p)
    for which in range(4):
        rows = [np.tile(v, (9, 1)) if k == which else v for k, v in enumerate((x, u, w, p))]
        assert compiled.batch("forward_dynamics", *rows) == pytest.approx(np.tile(expected, (9, 1)), rel=1e-12)


def test_rows_may_be_strided_views_and_other_types():
    _, compiled, at = full("arc")
    wide = np.tile(at.x, (9, 2)).astype(float)[:, : len(at.x)]
    expected = compiled.forward_dynamics(at.x)
    assert compiled.batch("forward_dynamics", wide)[8] == pytest.approx(expected, rel=1e-12)
    assert compiled.batch("forward_dynamics", wide.tolist())[8] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["statics", "inverse_dynamics", "actuation"])
def test_the_history_of_friction_is_never_supposed(name):
    """Friction that acts in neither way is a history too, which must be stated."""
    model = cg.FingerModel(Finger(rod=ROD, tendons=Tendons(offset=0.01, max_tension=50.0, friction=0.3)), family="arc")
    own, at = core.Core(model, compiled=False), state(model, 1.0)
    given = {"q": at.x[: model.n], "u": [30.0, 4.0]}
    count = len(model.friction_names)
    for call in (lambda: getattr(own, name)(**given), lambda: own.batch(name, np.tile(given["q"], (3, 1)))):
        with pytest.raises(InputError, match=f"{name}: the finger has friction.*give history \\({count + 1} entries"):
            call()
    histories = ([*np.full(count, way), 0.0] for way in (1.0, -1.0, 0.0))
    found = [getattr(own, name)(**given, history=history) for history in histories]
    pulled, released, free = (np.array(one[0] if isinstance(one, tuple) else one) for one in found)
    assert min(np.abs(one - free).max() for one in (pulled, released)) > 0.01 * np.abs(free).max()


# Rollouts.


def rk4(model, x, steps: int, h: float, u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """The classical method in plain numpy; inputs at half steps."""

    def f(x, row):
        return evaluate(model.forward_dynamics, x, u[row], w[row], model.p_nominal)

    states = [x]
    for k in range(steps):
        k1 = f(x, 2 * k)
        k2 = f(x + h / 2 * k1, 2 * k + 1)
        k3 = f(x + h / 2 * k2, 2 * k + 1)
        k4 = f(x + h * k3, 2 * k + 2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(x)
    return np.array(states)


def signals(model, rows: int, span: float) -> tuple[np.ndarray, np.ndarray]:
    """Smooth inputs and forces at equal instants."""
    t = np.linspace(0.0, span, rows)[:, None]
    u = 10.0 + 8.0 * np.sin(2.0 * t + np.arange(model.nu))
    return u, 0.5 * np.cos(5.0 * t + np.arange(model.nw))


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_rollout_is_the_method_written_by_hand(family, substeps):
    model, compiled = small(family)
    steps, h = 20, 2e-3
    u, w = signals(model, 2 * steps * substeps + 1, steps * h)
    x0 = state(model, 0.3).x
    found = compiled.rollout(x0, steps, h, u=u, w=w, substeps=substeps)
    expected = rk4(model, x0, steps * substeps, h / substeps, u, w)[::substeps]
    assert relative_error(found, expected) <= 1e-10
    assert found[0] == pytest.approx(x0, abs=0)


@pytest.mark.parametrize("inputs", ["one row", "a row each", "a signal for all", "a signal each"])
@pytest.mark.parametrize("method", [name for name, each in INTEGRATORS.items() if each.simulates])
def test_many_rollouts_are_single_ones(method, inputs):
    model, compiled = small()
    count, steps, rng = 9, 12, np.random.default_rng(2)
    x0 = np.outer(np.linspace(-1.0, 1.0, count), state(model, 0.3).x)
    signal, _ = signals(model, 4 * steps + 1, 0.1)
    each = rng.uniform(0.0, 5.0, (count, 2))
    u = {"one row": each[0], "a row each": each, "a signal for all": signal}.get(inputs, signal * each[:, None, :])
    many = compiled.rollout(x0, steps, 2e-3, u=u, w=[0.1, 0.0], substeps=2, method=method)
    assert many.shape == (count, steps + 1, model.nx)
    for k in range(count):
        own = u[k] if "each" in inputs else u
        single = compiled.rollout(x0[k], steps, 2e-3, u=own, w=[0.1, 0.0], substeps=2, method=method)
        assert relative_error(many[k], single) <= 1e-11


@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("method", [name for name, each in INTEGRATORS.items() if each.simulates])
@pytest.mark.parametrize("family", ["arc", "matched_clothoid"])
def test_methods_have_the_order_of_their_table(family, method, varying):
    model, compiled = small(family)
    x0, span = 0.3 * state(model, 0.5).x, 0.16

    def end(steps: int, how: str) -> np.ndarray:
        u, w = signals(model, 2 * steps + 1, span)
        u, w = (u, w) if varying else (u[0], w[0])
        return compiled.rollout(x0, steps, span / steps, u=u, w=w, method=how)[-1]

    reference = end(2560, "rk4")
    errors = [np.abs(end(steps, method) - reference).max() for steps in (160, 320)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(INTEGRATORS[method].order, abs=0.3)
    assert errors[1] < {4: 1e-3, 2: 1e-2}[INTEGRATORS[method].order] * np.abs(reference).max()


def test_the_step_of_plants_with_contacts_has_its_order():
    model = small()[0]
    x0, inputs = 0.3 * state(model, 0.5).x, [*3 * [[5.0, 1.0]], *3 * [np.zeros(model.nw)], []]

    def end(method: str, steps: int) -> np.ndarray:
        x, step = x0, step_function(model, method)
        for _ in range(steps):
            x = step(x, *inputs, 0.08 / steps)
        return np.array(x).ravel()

    reference = end("rk4", 640)
    errors = [np.abs(end("ros2", steps) - reference).max() for steps in (80, 160)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(INTEGRATORS["ros2"].order, abs=0.3)


@pytest.mark.parametrize("back", [False, True])
def test_a_recursion_without_a_compiler_is_that_of_its_steps(back):
    """Three rows of a signal hold for two steps each, two rows of a result are sums over three."""
    carry, signal = ca.SX.sym("carry"), ca.SX.sym("signal")
    function = ca.Function("f", [carry, signal], [carry + signal, carry * signal])
    scan, given = Scan(function, Backend(compiled=False)), np.array([1.0, 2.0, 4.0])
    found, sums = scan(6, [np.array([[0.5]]), given.reshape(1, 3, 1)], [2], back)
    way = -1 if back else 1
    each = np.repeat(given, 2)[::way]
    path = 0.5 + np.append(0.0, np.cumsum(each))
    assert found[0, :, 0] == pytest.approx(path[::way])
    assert sums[0, :, 0] == pytest.approx((path[:-1] * each)[::way].reshape(2, 3).sum(axis=1))


def test_every_method_is_documented():
    page = (Path(__file__).parents[2] / "docs" / "accuracy.md").read_text(encoding="utf-8")
    for name, method in INTEGRATORS.items():
        assert f"| `{name}` | {method.order} | {'any' if method.stable is None else method.stable}" in page
        assert f"| {method.text} |" in page


def test_divergence_stops_with_what_was_computed():
    model, compiled = small()
    x0 = state(model, 0.3).x
    with pytest.raises(NumericalError, match="step") as caught:
        compiled.rollout(x0, 200, 0.2)
    error = caught.value
    count = len(error.result)
    assert 1 <= count < 200
    assert np.isfinite(error.result).all()
    assert error.time == pytest.approx((count - 1) * 0.2)
    assert error.state == pytest.approx(error.result[-1], abs=0)
    assert error.result[0] == pytest.approx(x0, abs=0)


def test_divergence_of_some_of_many_keeps_the_others():
    model, compiled = small()
    x0 = np.tile(state(model, 0.3).x, (9, 1))
    x0[5] = 1e200
    with pytest.raises(NumericalError, match="1 of 9 rollouts, first in 5") as caught:
        compiled.rollout(x0, 10, 1e-3)
    states, single = caught.value.result, compiled.rollout(x0[0], 10, 1e-3)
    assert states.shape == (9, 11, model.nx)
    for k in (0, 4, 6, 8):
        assert relative_error(states[k], single) <= 1e-11


@pytest.mark.parametrize("method", ["rk4", "rodas"])
def test_what_was_not_computed_is_not_a_number(method):
    model, compiled = small()
    x0 = np.tile(state(model, 0.3).x, (3, 1))
    x0[1] = 1e200
    for _ in range(3):
        with pytest.raises(NumericalError) as caught:
            compiled.rollout(x0, 500, 1e-4, method=method)
        assert np.isnan(caught.value.result[1, 1:]).all()


def test_the_implicit_method_takes_stiff_steps():
    finger = Finger(rod=ROD, damping={"material": 0.5})
    model = cg.FingerModel(finger, family="arc", elements=(0.57, 0.03), gravity=(0.0, -9.81))
    compiled = cg.compile(model)
    x0 = np.concatenate([[0.4, 0.0], np.zeros(2)])
    with pytest.raises(NumericalError):
        compiled.rollout(x0, 100, 0.01)
    states = compiled.rollout(x0, 100, 0.01, method="rodas")
    fine = compiled.rollout(x0, 200, 0.005, method="rodas")[::2]
    assert relative_error(states[-1][:2], fine[-1][:2]) <= 1e-3


# Wrong calls.


CALLS = {
    "unknown function": (lambda c, x: cg.compile(c.model, ("mass",)), "unknown function 'mass'"),
    "batch of an unknown function": (lambda c, x: c.batch("mass", x), "unknown function"),
    "too few entries": (lambda c, x: c.forward_dynamics(x[:-1]), "x has 4 entries"),
    "too many inputs": (lambda c, x: c.forward_dynamics(x, None, None, None, None), "4 inputs expected, got 5"),
    "unknown input": (lambda c, x: c.forward_dynamics(x, force=1.0), "unknown input 'force'"),
    "many states in a single call": (lambda c, x: c.forward_dynamics([x, x]), "use batch"),
    "one state in a batch": (lambda c, x: c.batch("forward_dynamics", x), "one number of states"),
    "two numbers of states": (lambda c, x: c.batch("forward_dynamics", [x, x], [[0, 0]] * 3), "one number of states"),
    "wrong rows in a batch": (lambda c, x: c.batch("forward_dynamics", [x[:2]] * 3), "x has 4 entries"),
    "initial state": (lambda c, x: c.rollout(x[:-1], 5, 0.1), r"x0: expected \(4,\) or \(count, 4\), got shape \(3,\)"),
    "no steps": (lambda c, x: c.rollout(x, 0, 0.1), "steps: expected a whole number, 1 or more, got 0"),
    "negative step": (lambda c, x: c.rollout(x, 5, -0.1), "step: expected a finite number above 0, got -0.1"),
    "no substeps": (lambda c, x: c.rollout(x, 5, 0.1, substeps=0), "substeps: expected a whole number"),
    "state that is not a number": (
        lambda c, x: c.rollout(x + np.nan, 5, 0.1),
        r"x0\[0\]: expected a finite number, got nan",
    ),
    "one state of many": (lambda c, x: c.rollout([x, x - np.inf], 5, 0.1), r"x0\[1, 0\]: expected .* got -inf"),
    "a scalar state": (lambda c, x: c.rollout(1.0, 5, 0.1), r"x0: expected \(4,\) .* got shape \(1,\)"),
    "no state at all": (lambda c, x: c.rollout(np.zeros((0, 4)), 5, 0.1), r"x0: expected \(4,\) .* got shape \(0, 4\)"),
    "state as a text": (lambda c, x: c.rollout(["1", "2", "3", "4"], 5, 0.1), "x0: expected an array of numbers"),
    "symbols": (lambda c, x: c.forward_dynamics(ca.SX.sym("x", 4)), "x: expected an array of numbers"),
    "input that is not a number": (
        lambda c, x: c.rollout(x, 5, 0.1, u=[np.nan, 0]),
        r"u\[0\]: expected a finite number",
    ),
    "forces that are infinite": (
        lambda c, x: c.rollout(x, 1, 0.1, w=[[0, 0], [0, np.inf], [0, 0]]),
        r"w\[1, 1\]: expected a finite number, got inf",
    ),
    "method that is no word": (lambda c, x: c.rollout(x, 5, 0.1, method=["rk4"]), "unknown method"),
    "section beyond": (
        lambda c, x: c.position(x[:2], s=0.7),
        "position: s: expected a position from 0 to .* 0.6 m, got 0.7",
    ),
    "section before": (lambda c, x: c.orientation(x[:2], s=-0.1), "orientation: s: expected .* got -0.1"),
    "a section of many": (
        lambda c, x: c.batch("position", x[:2], None, [[0.1], [0.6], [0.9]]),
        "position: s: .* got 0.9",
    ),
    "input rows": (lambda c, x: c.rollout(x, 5, 0.1, u=np.zeros((5, 2))), r"u: expected \(2,\) or \(11, 2\)"),
    "input entries": (lambda c, x: c.rollout(x, 5, 0.1, u=[1.0]), "u: expected 2 entries, got 1"),
    "force rows": (lambda c, x: c.rollout(x, 5, 0.1, w=np.zeros((11, 3))), r"w: expected \(2,\) or \(11, 2\)"),
    "parameters": (lambda c, x: c.rollout(x, 5, 0.1, p=[1.0]), "p: expected 0 entries"),
    "method": (
        lambda c, x: c.rollout(x, 5, 0.1, method="euler"),
        "unknown method 'euler': expected one of rk4, rodas, implicit_midpoint",
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_calls_are_explained(name):
    call, message = CALLS[name]
    with pytest.raises(InputError, match=message):
        call(small()[1], np.zeros(4))


def test_sections_of_a_finger_whose_lengths_are_arguments():
    model = cg.FingerModel(Finger(rod=ROD), family="arc", parameters=("gravity", "element_lengths"))
    compiled, q, longer = cg.compile(model, ()), [0.0, 0.0], [0.0, 0.0, 0.5, 0.6]
    assert compiled.position(q, s=1.1, p=longer) == pytest.approx([0.0, 1.1])
    assert compiled.position(q, s=0.6) == pytest.approx([0.0, 0.6])
    rows = compiled.batch("position", q, None, [[0.6], [1.1]], [model.p_nominal, longer])
    assert rows == pytest.approx(np.array([[0.0, 0.6], [0.0, 1.1]]))
    for s, p in ((1.2, longer), (0.7, None)):
        with pytest.raises(InputError, match=f"got {s}"):
            compiled.position(q, s=s, p=p)
    with pytest.raises(InputError, match=r"length 0\.6 m, got 1\.1"):
        compiled.batch("position", q, None, [[0.6], [1.1]], [longer, model.p_nominal])


# Without a compiler.


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


MISSING = {
    "CC names nothing": lambda patch, path: patch.setenv("CC", "no-such-compiler"),
    "CC is empty": lambda patch, path: patch.setenv("CC", ""),
    "empty PATH": lambda patch, path: (patch.delenv("CC", raising=False), patch.setenv("PATH", "")),
    "CC says nothing": lambda patch, path: patch.setenv("CC", script(path / "mute", "exit 0")),
    "CC fails": lambda patch, path: patch.setenv("CC", script(path / "fail", "exit 1")),
    "CC fails to compile": lambda patch, path: patch.setenv(
        "CC",
        script(path / "broken", '[ "$1" = --version ] && echo broken 1.0 && exit 0; echo "no disk left" >&2; exit 1'),
    ),
    "CC makes rubbish": lambda patch, path: patch.setenv(
        "CC",
        script(
            path / "liar", 'echo liar 1.0; while [ $# -gt 1 ]; do [ "$1" = -o ] && echo rubbish > "$2"; shift; done'
        ),
    ),
}


@pytest.mark.parametrize("name", MISSING)
def test_without_a_compiler_all_runs_on_the_virtual_machine(name, monkeypatch, tmp_path):
    model, compiled = small()
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(code, "_WARNED", set())
    MISSING[name](monkeypatch, tmp_path)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    x0, steps = state(model, 0.3).x, 6
    u, w = signals(model, 2 * steps * 2 + 1, 0.01)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        slow = cg.compile(model)
        again = cg.compile(model)
        value = slow.forward_dynamics(x0, u[0], w[0])
        assert again.forward_dynamics(x0, u[0], w[0]) == pytest.approx(value, abs=0)
    assert len(caught) == 1
    assert "\n" not in str(caught[0].message)
    assert "virtual machine" in str(caught[0].message)
    assert "slower" in str(caught[0].message)
    assert not slow.compiled
    assert value == pytest.approx(compiled.forward_dynamics(x0, u[0], w[0]), rel=1e-11)
    rows = np.outer(np.linspace(0.1, 1.0, 9), x0)
    assert slow.batch("forward_dynamics", rows, u[0]) == pytest.approx(
        compiled.batch("forward_dynamics", rows, u[0]), rel=1e-11
    )
    assert slow.jacobian(x0[:2], s=0.3) == pytest.approx(compiled.jacobian(x0[:2], s=0.3), rel=1e-11)
    for method in ("rk4", "rodas"):
        found, expected = (c.rollout(x0, steps, 2e-3, u=u, w=w, substeps=2, method=method) for c in (slow, compiled))
        assert found == pytest.approx(expected, rel=1e-9)
        many = [c.rollout(np.outer([1.0, 0.5], x0), steps, 2e-3, u=u[:2], method=method) for c in (slow, compiled)]
        assert many[0] == pytest.approx(many[1], rel=1e-9)
        constant = [c.rollout(x0, steps, 2e-3, u=u[0], method=method) for c in (slow, compiled)]
        assert constant[0] == pytest.approx(constant[1], rel=1e-9)


REASONS = {
    "no such program": (
        "no-such-compiler",
        "no C compiler: CC=no-such-compiler: no such program (nothing else is tried",
    ),
    "a path": ("/nonexistent/cc -O1", "no C compiler: CC=/nonexistent/cc -O1: no such program"),
    "empty": ("", "no C compiler: CC is set and empty (unset it"),
    "unfinished": ("'gcc", "cannot be read as a command (No closing quotation)"),
    "failing": ("false", "CC=false: false --version exits with 1 and says nothing"),
    "not set": (None, "no C compiler found (cc: no such program; gcc: no such program; clang: no such program)"),
}


@pytest.mark.parametrize("name", REASONS)
def test_why_there_is_no_compiler(name, monkeypatch):
    named, words = REASONS[name]
    if named is None:
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", "")
        monkeypatch.setitem(sys.modules, "ziglang", None)
        with pytest.raises(InputError, match=r"a controller needs a C compiler: .*install .*compiler"):
            Compiler.load("int one(void) { return 1; }\n", "a controller")
    else:
        monkeypatch.setenv("CC", named)
    assert Compiler.find() is None
    assert words in Compiler.why_none()
    monkeypatch.setattr(code, "_WARNED", set())
    with pytest.warns(RuntimeWarning, match="virtual machine") as caught:
        cg.compile(small()[0], ())
    assert words in str(caught[0].message)


@pytest.mark.deep
def test_a_loop_costs_the_same_with_the_compiler_of_the_extra(monkeypatch):
    pytest.importorskip("ziglang", reason="100 MB; in the extra 'compiler'")
    scene = cg.load("configs/mpc/steady_tip.yaml", ["duration=0.5"])
    monkeypatch.delenv("CC", raising=False)
    usual = cg.run_closed_loop(scene)
    monkeypatch.setenv("PATH", "")
    compiler = Compiler.find()
    assert "ziglang" in compiler.command
    assert "clang" in compiler.version
    run = cg.run_closed_loop(scene)
    assert run.metrics().cost == pytest.approx(usual.metrics().cost, rel=1e-12)
    assert np.abs(run.u - usual.u).max() < 1e-6  # N


def test_divergence_without_a_compiler(monkeypatch):
    model, compiled = small()
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(code, "_WARNED", {Compiler.why_none()})
    results = []
    for c in (cg.compile(model), compiled):
        with pytest.raises(NumericalError) as caught:
            c.rollout(state(model, 0.3).x, 200, 0.2)
        results.append(caught.value)
    assert results[0].time == results[1].time
    assert len(results[0].result) == len(results[1].result)


@needs_compiler
def test_with_a_compiler_nothing_is_said(monkeypatch):
    monkeypatch.setattr(code, "_WARNED", set())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cg.compile(small()[0]).compiled


# The cache.


SOURCE = "double answer(void) { return 42.0; }\n"


@pytest.fixture
def builds(monkeypatch, tmp_path):
    """An empty cache of its own; the list of builds made in it."""
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "cache"))
    made: list[Path] = []
    build = Compiler.build

    def counted(self, source, library, what, *, quick):
        made.append(library)
        return build(self, source, library, what, quick=quick)

    monkeypatch.setattr(Compiler, "build", counted)
    return made


def sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def replaced(path: Path, content: bytes) -> None:
    """Another file under the name; never the bytes of one that may be loaded."""
    path.unlink()
    path.write_bytes(content)


@needs_compiler
def test_cold_then_warm(builds):
    model, _ = small()
    first = cg.compile(model, ("gravity", "energy"))
    files = sorted(p.suffix for p in cache_folder().iterdir())
    assert len(builds) == 2
    assert files == [".json", ".json", ".so", ".so"]
    stamps = {p: p.stat().st_mtime_ns for p in cache_folder().iterdir()}
    second = cg.compile(cg.FingerModel(model.finger, family="arc", elements=2), ("gravity", "energy"))
    assert len(builds) == 2
    assert {p: p.stat().st_mtime_ns for p in cache_folder().iterdir()} == stamps
    assert second.gravity([0.1, 0.2]) == pytest.approx(first.gravity([0.1, 0.2]), abs=0)


@needs_compiler
def test_another_model_is_another_entry(builds):
    for mass in (0.1, 0.2):
        finger = Finger(rod=ROD, masses=(PointMass(at=0.6, mass=mass),))
        cg.compile(cg.FingerModel(finger, family="arc"), ("gravity",))
    assert len(builds) == 2


@needs_compiler
def test_another_compiler_or_machine_is_another_entry(builds):
    here = Compiler.find()
    others = [
        here,
        *(
            Compiler(*parts)
            for parts in (
                (here.command, "cc 99", here.machine),
                (here.command, here.version, "another processor"),
                ((*here.command, "-DNDEBUG"), here.version, here.machine),
            )
        ),
    ]
    assert len({compiler.library(SOURCE) for compiler in others}) == 4
    assert len(builds) == 4


SPOILT = {
    "truncated": lambda so, record, other: replaced(so, so.read_bytes()[:100]),
    "empty": lambda so, record, other: replaced(so, b""),
    "one bit flipped": lambda so, record, other: replaced(so, so.read_bytes()[:-1] + b"\x01"),
    "foreign library": lambda so, record, other: replaced(so, other.read_bytes()),
    "foreign library with its record": lambda so, record, other: (
        replaced(so, other.read_bytes()),
        replaced(record, other.with_suffix(".json").read_bytes()),
    ),
    "no library": lambda so, record, other: so.unlink(),
    "no record": lambda so, record, other: record.unlink(),
    "record cut off": lambda so, record, other: replaced(record, record.read_bytes()[:20]),
    "record of another shape": lambda so, record, other: replaced(record, b"[1, 2]"),
    "record that is not text": lambda so, record, other: replaced(record, b"\xff\xfe\x00"),
}


@needs_compiler
@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_entry_is_built_again(name, builds):
    compiler = Compiler.find()
    library = compiler.library(SOURCE)
    other = compiler.library(SOURCE.replace("42", "43"))
    record = library.with_suffix(".json")
    SPOILT[name](library, record, other)
    assert compiler.library(SOURCE) == library
    assert len(builds) == 3
    assert json.loads(record.read_text())["sha256"] == sha(library)
    assert sha(library) != sha(other)
    assert compiler.library(SOURCE) == library
    assert len(builds) == 3


@needs_compiler
def test_the_cache_is_private(builds):
    library = Compiler.find().library(SOURCE)
    folder = cache_folder()
    modes = {path.suffix: path.stat().st_mode & 0o777 for path in (folder, library, library.with_suffix(".json"))}
    assert modes == {"": 0o700, ".so": 0o700, ".json": 0o600}


@needs_compiler
@pytest.mark.parametrize("mode", [0o720, 0o702])
@pytest.mark.parametrize("suffix", [".so", ".json"])
def test_an_entry_that_others_could_have_written_is_built_again(suffix, mode, builds):
    library = Compiler.find().library(SOURCE)
    library.with_suffix(suffix).chmod(mode)
    assert Compiler.find().library(SOURCE) == library
    assert len(builds) == 2
    assert library.with_suffix(suffix).stat().st_mode & 0o077 == 0


@needs_compiler
@pytest.mark.parametrize("why", ["a file in its place", "another user's", "open to others", "a link"])
def test_an_unusable_folder_is_left_alone(why, builds, monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cache._temporary_folder.cache_clear()
    folder = cache_folder()
    folder.parent.mkdir(parents=True, exist_ok=True)
    if why == "a file in its place":
        folder.write_text("mine")
    elif why == "a link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "elsewhere")
    else:
        folder.mkdir(mode=0o700)
        if why == "open to others":
            folder.chmod(0o777)
        else:
            owner = os.getuid()
            monkeypatch.setattr(cache.os, "getuid", lambda: owner + 1)
    with pytest.warns(RuntimeWarning, match="stored for this process only"):
        library = Compiler.find().library(SOURCE)
    assert library.exists()
    assert library.parent != folder
    assert library.parent.stat().st_mode & 0o077 == 0
    if why == "open to others":
        assert folder.stat().st_mode & 0o777 == 0o777
        assert Compiler.find().library(SOURCE) == library
        assert len(builds) == 1
    cache._temporary_folder.cache_clear()


@needs_compiler
def test_a_refused_source_leaves_nothing(builds):
    with pytest.raises(CompileError, match="error"):
        Compiler.find().library("this is not C")
    assert list(cache_folder().iterdir()) == []


@pytest.mark.deep
@needs_compiler
def test_processes_may_build_the_same_at_once(builds):
    program = (
        "import ctypes;"
        "from continuum_grasp.core import Compiler;"
        f"path = Compiler.find().library({SOURCE!r});"
        "f = ctypes.CDLL(str(path)).answer; f.restype = ctypes.c_double; print(path, f())"
    )
    running = [
        subprocess.Popen(
            [sys.executable, "-c", program],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        for _ in range(4)
    ]
    said = [process.communicate(timeout=60) for process in running]
    assert [process.returncode for process in running] == [0] * 4, said
    assert len({out for out, _ in said}) == 1
    assert said[0][0].split()[1] == "42.0"
    assert sorted(p.suffix for p in cache_folder().iterdir()) == [".json", ".so"]
    library = next(cache_folder().glob("*.so"))
    assert Compiler.find().library(SOURCE) == library
    assert builds == []


def test_where_the_cache_is(monkeypatch, tmp_path):
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "named"))
    assert cache_folder() == tmp_path / "named" / "compiled"
    monkeypatch.delenv("CONTINUUM_GRASP_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "continuum_grasp" / "compiled"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path(os.path.expanduser("~")) / ".cache" / "continuum_grasp" / "compiled"


@pytest.mark.parametrize("density", [0.15, 0.4, 1.0])
def test_elimination_solves_as_lapack_does(density):
    """Arrow matrices, whose natural order fills in, are among them."""
    rng = np.random.default_rng(1)
    for n in (1, 2, 7, 14):
        pattern = rng.uniform(size=(n, n)) < density
        pattern[0], pattern[:, 0] = True, True
        matrix = np.eye(n) + 0.4 / n * rng.normal(size=(n, n)) * pattern
        right = rng.normal(size=(n, 3)) * (rng.uniform(size=(n, 3)) < 0.6)
        found = np.array(ca.DM(ca.evalf(solve(ca.sparsify(ca.SX(matrix)), ca.sparsify(ca.SX(right))))))
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-11, atol=1e-13)


def test_an_arrow_is_eliminated_without_filling_in():
    """2 n + 1 products and as many sums solve an arrow whose tip is eliminated last; the natural order takes n^3."""
    n = 20
    arrow = ca.diagcat(1, ca.SX.sym("d", n - 1)) * ca.SX.eye(n)
    arrow[0, :], arrow[:, 0] = ca.SX.sym("r", 1, n), ca.SX.sym("c", n)
    right = ca.SX.sym("b", n)
    symbols = ca.symvar(ca.vertcat(ca.vec(arrow), right))
    assert ca.Function("arrow", symbols, [solve(arrow, right)]).n_instructions() < 15 * n
