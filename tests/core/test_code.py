"""Which code runs a function; from inside: `FunctionCode`, `Caller` and the sizes that decide, which no door has."""

from __future__ import annotations

from functools import partial

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.core import (
    CodeKind,
    Compiler,
    CSource,
    Rollouts,
)
from continuum_grasp.core.batches import Batch
from continuum_grasp.core.caller import Caller
from continuum_grasp.core.code import Backend, FunctionCode, Size
from continuum_grasp.core.source import batch_source

needs_compiler = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler")


@pytest.fixture(autouse=True)
def _by_the_rule(monkeypatch, tmp_path):
    """An empty cache, and nothing in the environment that decides instead of the rule."""
    monkeypatch.delenv("CONTINUUM_GRASP_QUICK_COMPILE", raising=False)
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path))


def polynomial(degree: int, name: str = "polynomial") -> ca.Function:
    """Horner's scheme: two instructions per degree."""
    x = ca.SX.sym("x")
    y = ca.SX(1.0)
    for k in range(degree):
        y = y * x + 1.0 / (k + 2.0)
    return ca.Function(name, [x], [y])


def code(function: ca.Function) -> FunctionCode:
    return FunctionCode(function, lambda: batch_source(function), Backend())


def test_a_function_that_is_called_twice_is_written_once_and_runs_twice():
    inner, x = polynomial(50), ca.MX.sym("x")
    one, two = inner(x), inner(inner(x))
    once, twice = Size.of(ca.Function("f", [x], [one])), Size.of(ca.Function("f", [x], [two]))
    plain = Size.of(inner)
    assert once.instructions >= plain.instructions == plain.lines >= 100
    assert twice.instructions == 2 * once.instructions
    assert twice.lines < 1.1 * once.lines


@needs_compiler
def test_few_calls_are_interpreted_and_many_compiled():
    few, many = (code(polynomial(200)) for _ in range(2))
    assert few.library(10) is None
    assert few.kind is CodeKind.INTERPRETED
    assert many.library(1e8) is not None
    assert many.kind is CodeKind.OPTIMIZED


@needs_compiler
def test_calls_add_up():
    """Whatever comes one by one is compiled when it has taken as long as compiling, and not again."""
    one, counted = code(polynomial(200)), 0
    while one.library(10_000) is None:
        counted += 10_000
        assert counted < 1e8
    assert counted > 10_000
    first = one.library(1)
    assert one.library(1e9) is first


@needs_compiler
def test_calls_that_are_announced_are_counted_once():
    limit = code(polynomial(200))._pays_from[1]
    announced = code(polynomial(200)).expect(0.6 * limit)
    assert announced.library(0.6 * limit) is None
    assert announced.library(0.3 * limit) is None
    assert announced.library(0.2 * limit) is not None


@needs_compiler
def test_runs_that_were_announced_before_count_too():
    """Each process has an object of its own: three that run 0.4 of what pays compile once, in the third."""
    calls = 0.4 * code(polynomial(200))._pays_from[1]
    kinds = [code(polynomial(200)).expect(calls).kind for _ in range(3)]
    assert kinds == [CodeKind.INTERPRETED, CodeKind.INTERPRETED, CodeKind.OPTIMIZED]
    assert code(polynomial(201)).expect(calls).kind is CodeKind.INTERPRETED


@needs_compiler
def test_what_is_in_the_cache_needs_fewer_calls():
    seen, pays = code(polynomial(200))._pays_from
    between = 0.5 * (seen + pays)
    assert code(polynomial(200)).library(between) is None
    code(polynomial(200)).expect(np.inf)
    assert code(polynomial(200)).library(between) is not None
    assert code(polynomial(200)).library(0.5 * seen) is None


@needs_compiler
@pytest.mark.parametrize(("value", "kind"), [("0", CodeKind.OPTIMIZED), ("1", CodeKind.QUICK)])
def test_the_environment_decides_where_it_is_set(value, kind, monkeypatch):
    monkeypatch.setenv("CONTINUUM_GRASP_QUICK_COMPILE", value)
    one = code(polynomial(20))
    assert one.library() is not None
    assert one.kind is kind
    assert CodeKind.of_source("int x;", 1.0) is kind


@needs_compiler
def test_c_that_cannot_be_interpreted_is_compiled_quickly_for_few_instructions():
    source = "int answer(void)\n{\n  return 42;\n}\n" + "/* a line */\n" * 5000
    assert CodeKind.of_source(source) is CodeKind.OPTIMIZED
    assert CodeKind.of_source(source, 1e15) is CodeKind.OPTIMIZED
    assert CodeKind.of_source(source, 1e6) is CodeKind.QUICK
    Compiler.find().library(source, quick=False)
    assert CodeKind.of_source(source, 1e6) is CodeKind.OPTIMIZED  # it costs nothing any more


@needs_compiler
def test_c_that_runs_again_and_again_is_optimized_by_one_of_its_runs():
    source = "int answer(void)\n{\n  return 42;\n}\n" + "/* a line */\n" * 5000
    kinds = [CodeKind.of_source(source, 0.6e8) for _ in range(5)]
    assert kinds[0] is CodeKind.QUICK
    assert kinds[-1] is CodeKind.OPTIMIZED


@needs_compiler
@pytest.mark.parametrize("name", ["pendulum", "step"])
def test_interpreted_and_compiled_rollouts_are_equal_to_rounding(name):
    """Of a step with the name of a function of libc, too, which a call within the library would reach first."""
    x, p, h = (ca.SX.sym(n, k) for n, k in (("x", 2), ("p", 1), ("h", 1)))
    three = [ca.SX.sym(f"{n}{k}") for n in "uw" for k in range(3)]
    following = x + h * ca.vertcat(x[1], -ca.sin(x[0]) + three[0])
    step = ca.Function(name, [x, *three, p, h], [following])
    start = np.array([[0.3, 0.1]])
    signals = np.array([0.2]), np.zeros(1)
    kinds, states = [], []
    for calls in (0.0, np.inf):
        rollouts = Rollouts(step)
        rollouts.code.expect(calls)
        states.append(rollouts(start, 50, 2, 0.01, *signals, np.zeros(1))[0])
        kinds.append(rollouts.code.kind)
    assert kinds == [CodeKind.INTERPRETED, CodeKind.OPTIMIZED]
    np.testing.assert_allclose(states[0], states[1], rtol=1e-13)


@needs_compiler
@pytest.mark.parametrize("name", ["step", "index", "exp", "y0", "main", "cg_exp"])
def test_a_function_may_have_the_name_of_one_of_the_c_library(name):
    """Calls and batches, of straight-line functions and of those that call others."""
    x = ca.SX.sym("x", 2)
    straight = ca.Function(name, [x], [2.0 * x + 1.0], ["x"], ["y"])
    many = ca.MX.sym("x", 2)
    calling = ca.Function(name, [many], [ca.solve(4.0 * ca.MX.eye(2), 2.0 * many + 1.0)], ["x"], ["y"])
    for function, factor in ((straight, 1.0), (calling, 4.0)):
        source = partial(CSource([function]).of_core, name)
        caller = Caller(function, FunctionCode(function, source, Backend(), from_python=True), np.zeros(0)).prepare()
        batch = Batch(function, Backend())
        batch.code.expect(np.inf)
        assert (caller.code.kind, batch.code.kind) == (CodeKind.OPTIMIZED, CodeKind.OPTIMIZED)
        assert factor * caller(np.array([1.0, 3.0])) == pytest.approx([3.0, 7.0])
        (found,) = batch(1, [np.array([[1.0, 3.0]])])
        assert factor * found == pytest.approx(np.array([[3.0, 7.0]]))
