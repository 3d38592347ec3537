"""The core in single precision against the same in double, and that nothing of it is left in double."""

from __future__ import annotations

import platform
import re
import subprocess
from functools import lru_cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.core import core
from continuum_grasp.core.compiler import Compiler, find_compiler, why_no_compiler
from continuum_grasp.core.precision import single
from continuum_grasp.core.source import batch_source, entry, function_source, rollout_source, rollouts_source
from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.model.finger_model import FUNCTIONS
from continuum_grasp.scene import Finger, PointMass, Tendons
from tests.core.test_core import MISSING, full, inputs_of, signals, small
from tests.finger_cases import FAMILIES, ROD, relative_error, state
from tests.marks import few

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler here")
pytestmark = needs_compiler

ROUNDING = 2.0**-24
"""Of single precision, relative."""
SOLVED = ("forward_dynamics", "linearization")
"""Functions in which rounding is multiplied by the condition of the mass matrix."""


@lru_cache
def both(family: str):
    """The finger for rollouts in double and in single precision."""
    model, double = small(family)
    return model, double, cg.compile(model, precision="float")


def condition(compiled, at) -> float:
    return float(np.linalg.cond(compiled.mass_matrix(at.q, at.u)))


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("family", few(sorted(FAMILIES, reverse=True), 1))
def test_functions_are_those_in_double_to_rounding(family, name):
    """Terms of one size, some hundred operations: a hundred roundings are never reached, let alone a double's."""
    model, double, at = full(family)
    arguments = inputs_of(model, name, at)
    expected, found = (getattr(c, name)(*arguments) for c in (double, cg.compile(model, (), precision="float")))
    limit = 100 * ROUNDING * (condition(double, at) if name in SOLVED else 1.0)
    pairs = zip(expected, found, strict=True) if isinstance(expected, tuple) else [(expected, found)]
    for true, value in pairs:
        assert value.dtype == np.float64
        assert value.shape == true.shape
        assert np.array_equal(value, value.astype(np.float32))
        assert relative_error(value, true) <= limit


@pytest.mark.parametrize("count", [1, 15, 16, 17, 1000])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_batch_is_its_states_one_by_one(family, count):
    model, _, at = full(family)
    compiled = cg.compile(model, precision="float")
    rng = np.random.default_rng(count)
    x, w = at.x * rng.uniform(0.5, 1.2, (count, model.nx)), rng.uniform(-1, 1, (count, model.nw))
    rows = compiled.batch("forward_dynamics", x, at.u, w)
    limit = 100 * ROUNDING * condition(full(family)[1], at)
    for k in {*range(min(count, 20)), *range(0, count, 97), count - 1}:
        assert relative_error(rows[k], compiled.forward_dynamics(x[k], at.u, w[k])) <= limit


@pytest.mark.parametrize("method", ["rk4", "rodas"])
@pytest.mark.parametrize("family", FAMILIES)
def test_rollouts_are_those_in_double_to_rounding(family, method):
    """Roundings of a smooth motion add up like a random walk; 1e-5 is some 170 of them, over 100 steps."""
    model, double, narrow = both(family)
    steps, h = 100, 1e-3
    u, w = signals(model, 2 * steps + 1, steps * h)
    x0 = state(model, 0.3).x * np.array([1.0] * model.n + [0.1] * model.n)
    expected, found = (c.rollout(x0, steps, h, u=u, w=w, method=method) for c in (double, narrow))
    scale = np.abs(expected).max(axis=0)
    limit = 1e-5 * max(1.0, 0.01 * condition(double, state(model, 0.3)))
    assert (np.abs(found - expected) / scale).max() <= limit
    assert not np.array_equal(found, expected)


@pytest.mark.parametrize("method", ["rk4", "rodas"])
def test_many_rollouts_are_single_ones(method):
    model, _, narrow = both("arc")
    count, steps = 19, 12
    x0 = np.outer(np.linspace(-1.0, 1.0, count), state(model, 0.3).x)
    u, w = signals(model, 4 * steps + 1, 0.1)
    many = narrow.rollout(x0, steps, 2e-3, u=u, w=w, substeps=2, method=method)
    for k in (0, 3, 15, 16, 18):
        one = narrow.rollout(x0[k], steps, 2e-3, u=u, w=w, substeps=2, method=method)
        assert relative_error(many[k], one) <= 1e-5


@pytest.mark.parametrize("single_one", [True, False])
def test_the_state_of_a_rollout_stays_single(single_one):
    """Every stored state is a number of single precision, and so starts the same motion again to the last bit."""
    model, _, narrow = both("matched_clothoid")
    x0 = state(model, 0.3).x
    start = x0 if single_one else np.tile(x0, (3, 1))
    whole = narrow.rollout(start, 20, 1e-3)
    half = narrow.rollout(whole[..., 10, :], 10, 1e-3)
    assert np.array_equal(whole, whole.astype(np.float32))
    assert np.array_equal(whole[..., 10:, :], half)


# Nothing in double.


@lru_cache
def with_tendon_friction():
    """Tendon friction: with exponentials and roots."""
    finger = Finger(rod=ROD, tendons=Tendons(offset=0.01, max_tension=50.0, friction=0.3))
    return cg.FingerModel(finger, family="clothoid", parameters=("tip_mass", "bending_stiffness", "base_angle"))


def compiler_says(source: str, *flags: str) -> subprocess.CompletedProcess:
    line = [*find_compiler().command, "-std=gnu11", "-O2", "-x", "c", "-", "-o", "-", *flags]
    return subprocess.run(line, input=source, capture_output=True, text=True, check=False)


STRICT = ("-fsyntax-only", "-Werror=double-promotion", "-Werror=float-conversion")


def test_the_compiler_finds_no_promotion_to_double():
    model = with_tendon_friction()
    step, rodas = (cg.compile(model, ()).step_function(method) for method in ("rk4", "rodas"))
    sources = {name: function_source(getattr(model, name), "float") for name in FUNCTIONS}
    sources |= {
        f"{name}, batch": batch_source(getattr(model, name), "float") for name in ("forward_dynamics", "range_use")
    }
    sources |= {"rollout": rollout_source(step, "float"), "rollouts": rollouts_source(step, "float")}
    sources |= {"rodas": rollout_source(rodas, "float"), "rodas, many": rollouts_source(rodas, "float")}
    said = {name: compiler_says(source, *STRICT).stderr[:2000] for name, source in sources.items()}
    assert {name: text for name, text in said.items() if text} == {}


def test_a_typedef_alone_would_leave_doubles():
    source = "#define casadi_real float\n" + function_source(with_tendon_friction().forward_dynamics)
    assert compiler_says(source, *STRICT).returncode != 0


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="instructions of x86")
def test_the_processor_computes_nothing_in_double():
    """Instructions that end in sd or pd work on doubles; single precision needs none of them within the function."""
    model = with_tendon_friction()
    for real, expected in (("float", False), ("double", True)):
        done = compiler_says(function_source(model.forward_dynamics, real), "-S", "-march=x86-64-v3")
        assert done.returncode == 0, done.stderr[:2000]
        inner = re.split(rf"^{entry(model.forward_dynamics, 'float')}:", done.stdout, flags=re.MULTILINE)[0]
        arithmetic = re.findall(r"\bv?(?:add|sub|mul|div|sqrt|fn?m\w+|cvt\w+)[sp]d\b", inner)
        assert bool(arithmetic) is expected
        assert ("expf" in inner) is not expected


def test_literals_are_rewritten_by_tokens():
    source = (
        '#include <math.h>\n/* 1.5 */ // 2.5\nreal a1e5 = 3.5, b = .5e-3 + 1. - 2e+4;\nchar *s = "4.5"; '
        "int n = 7, m = 0x1e5; float f = 1.25f; long k = 199901L;"
    )
    assert single(source).splitlines()[1:] == [
        "#include <tgmath.h>",
        "/* 1.5 */ // 2.5",
        "real a1e5 = 3.5f, b = .5e-3f + 1.f - 2e+4f;",
        'char *s = "4.5"; int n = 7, m = 0x1e5; float f = 1.25f; long k = 199901L;',
    ]


# Refusals.


@pytest.mark.parametrize("number", ["1e39", "1e-39", "-4e+50"])
def test_constants_beyond_single_precision_are_refused(number):
    with pytest.raises(InputError, match="beyond single precision"):
        single(f"a = {number};")


def test_a_model_with_such_constants_says_so():
    finger = Finger(rod=ROD, masses=(PointMass(at=0.6, mass=0.1),))
    wide = cg.FingerModel(finger, family="arc", bending_range=7.0)
    with pytest.raises(InputError, match=r"constant of .* coarser accuracy"):
        cg.compile(wide, precision="float")
    coarse = cg.FingerModel(finger, family="arc", bending_range=7.0, accuracy=1e-8)
    q = np.array([2.5, -3.5])
    assert cg.compile(coarse, precision="float").tip(q) == pytest.approx(cg.compile(wide).tip(q), abs=1e-5)


def test_a_model_whose_accelerations_would_be_lost_says_so():
    slender = Finger(rod=ROD.model_copy(update={"rotary_inertia": 0.0}))
    with pytest.raises(InputError, match="fewer elements"):
        cg.compile(cg.FingerModel(slender, family="arc", elements=32), precision="float")
    assert cg.compile(cg.FingerModel(slender, family="arc", elements=8), (), precision="float").compiled


def test_stiff_steps_keep_their_digits():
    """Rows of the implicit step differ by 1e8 here; rounding of the largest must not reach the smallest."""
    finger = Finger(rod=ROD.model_copy(update={"rotary_inertia": 0.0}))
    model = cg.FingerModel(finger, family="clothoid", elements=(0.59, 0.01))
    double, narrow = cg.compile(model), cg.compile(model, precision="float")
    x0 = np.concatenate([[1.0, 0.5, 0.5], np.zeros(3)])
    expected, found = (c.rollout(x0, 50, 2e-3, method="rodas")[:, :3] for c in (double, narrow))
    tips = [double.batch("tip", np.ascontiguousarray(q)) for q in (expected, found)]
    assert np.abs(tips[0] - tips[1]).max() <= 1e-5 * ROD.length


CALLS = {
    "precision": (lambda c, x: cg.compile(c.model, precision="half"), "precision: expected one of double, float"),
    "precision that is no word": (lambda c, x: core.Core(c.model, precision=32), "precision: expected .* got 32"),
    "virtual machine": (lambda c, x: core.Core(c.model, compiled=False, precision="float"), "virtual machine"),
    "state": (lambda c, x: c.forward_dynamics(x + 1e39), r"forward_dynamics: x: .* single precision.* got 1e\+39"),
    "batch": (lambda c, x: c.batch("tip", np.full((3, len(x) // 2), -1e40)), r"tip: q: .* got -1e\+40"),
    "rollout": (lambda c, x: c.rollout(x + 1e39, 5, 1e-3), r"rollout: x0: expected .* got 1e\+39"),
    "input": (lambda c, x: c.rollout(x, 5, 1e-3, u=[1e39, 0.0]), r"rollout: u: expected .* got 1e\+39"),
    "not a number": (lambda c, x: c.rollout(x + np.nan, 5, 1e-3), r"x0\[0\]: expected a finite number"),
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_calls_are_explained(name):
    call, message = CALLS[name]
    with pytest.raises(InputError, match=message):
        call(both("arc")[2], np.zeros(4))


def test_divergence_stops_with_what_was_computed():
    model, _, narrow = both("arc")
    with pytest.raises(NumericalError, match="not finite") as caught:
        narrow.rollout(state(model, 0.3).x, 200, 0.2)
    assert np.isfinite(caught.value.result).all()


@pytest.mark.parametrize("name", MISSING)
def test_without_a_compiler_it_is_refused(name, monkeypatch, tmp_path):
    model = small()[0]
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "cache"))
    MISSING[name](monkeypatch, tmp_path)
    with pytest.raises(InputError, match=r"precision: 'float' needs compiled code.*expected a C compiler"):
        cg.compile(model, precision="float")
    if find_compiler() is None:
        with pytest.raises(InputError, match=re.escape(why_no_compiler())):
            core.Core(model, precision="float")


def test_both_precisions_do_not_mix(monkeypatch, tmp_path):
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "cache"))
    builds, build = [], Compiler.build
    monkeypatch.setattr(Compiler, "build", lambda *a: (builds.append(a), build(*a)))
    model, q = small()[0], [0.3, 0.2]
    for _ in range(2):
        found = [cg.compile(model, precision=p).elastic(q) for p in ("double", "float", "double")]
        assert found[0] == pytest.approx(found[2], abs=0)
        assert found[0] != pytest.approx(found[1], abs=0)
    assert len(builds) == 4  # two functions, in two precisions
