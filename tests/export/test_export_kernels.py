"""Strict kernels, in C and in numpy to the last bit; from inside: the flags, and the numpy that C is compared with.

Strict kernels: the functions of their own, and the same arithmetic in C and in numpy, to the last bit.
"""

from __future__ import annotations

import ctypes
import re

import casadi as ca
import mpmath
import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.core import CReal
from continuum_grasp.export import Kernel
from continuum_grasp.export.build import FLAGS
from continuum_grasp.export.strict_math import reference
from continuum_grasp.export.swept import SweptKernel
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import ForceLoad
from tests.export_cases import MANY, STRICT, needs, run
from tests.model.test_many_elements import COUNT, model_of, state_of

HEADER = """
#include <stdint.h>
#define k_API
typedef {real} k_real;
static int k_is_finite(const k_real *number) {{ return *number - *number == 0; }}
"""
_FEW = np.concatenate([np.linspace(-7.0, 7.0, 301), [1e-12, 100.0, -1000.0]])
_SHARE = np.concatenate([np.linspace(-1.0, 1.0, 301), [1e-12, 1.0 - 1e-6, 1e-6 - 1.0]])
_WIDE = np.concatenate([np.linspace(-20.0, 20.0, 301), [1e-12, -1e-7, 1e-4, -87.0, 88.0]])
_SIZES = np.concatenate([np.linspace(1e-3, 9.0, 301), np.linspace(0.9, 1.1, 101), [1e-42, 1e-30, 1e30, 3.4e38]])
PLACES = {
    "acos": (_SHARE, 3),
    "asin": (_SHARE, 3),
    "atan": (np.concatenate([_FEW, [1e30, -1e30]]), 3),
    "cos": (_FEW, 2),
    "cosh": (_WIDE, 3),
    "exp": (_WIDE, 2),
    "expm1": (_WIDE, 3),
    "log": (_SIZES, 2),
    "log1p": (np.concatenate([_SIZES, _SHARE[1:-3]]), 3),
    "sin": (_FEW, 2),
    "sinh": (_WIDE, 5),
    "sqrt": (np.concatenate([[0.0], _SIZES]), 2),
    "tan": (_FEW, 5),
    "tanh": (_WIDE, 5),
}
"""Arguments of each function of one number, and the error that is stated of it, in roundings."""
PAIRS = {
    "atan2": (
        np.random.default_rng(3).normal(size=(300, 2)) * 10.0 ** np.random.default_rng(4).integers(-9, 9, (300, 1)),
        3,
    ),
    "pow": (np.random.default_rng(5).uniform((0.01, -3.0), (4.0, 3.0), (300, 2)), 2 + 2 * 3 * np.log(100.0)),
}
"""The same of two numbers."""
_OTHER = {"pow": "power"}
"""Names that CasADi and mpmath have for them."""


def in_c(kernel: Kernel, real, rows, folder):
    """What the C of a kernel with one input and one output gives."""
    source = HEADER.format(real=real.name) + Kernel.all_c_source([kernel], "k", real).replace("K_API ", "")
    (folder / "kernel.c").write_text(source)
    run("cc", *STRICT, "-O2", "-shared", "-fPIC", folder / "kernel.c", "-o", folder / "kernel.so")
    function = getattr(ctypes.CDLL(str(folder / "kernel.so")), f"k_kernel_{kernel.name}")
    (size,) = kernel.outputs.values()
    out = np.zeros((len(rows), size), dtype=real.dtype)
    for row, result in zip(np.ascontiguousarray(rows, dtype=real.dtype), out, strict=True):
        function(row.ctypes.data_as(ctypes.c_void_p), result.ctypes.data_as(ctypes.c_void_p))
    return out


@needs("gcc")
def test_nothing_is_fused_in_vectors(tmp_path):
    """By the flags of the manifest: -ffp-contract=off alone leaves gcc 12.2 a vfmaddsub in this kernel."""
    if not run("gcc", "-dumpmachine").startswith("x86_64"):
        pytest.skip("needs a compiler for x86-64")
    x = ca.SX.sym("x", 6)
    y = ca.vertcat(x[0] * x[2] - x[4], x[1] * x[3] + x[5])
    kernel = Kernel("pair", ca.Function("pair", [x], [y], ["x"], ["y"]), "Two products.")
    (tmp_path / "pair.c").write_text(HEADER.format(real="double") + kernel.c_source("k", CReal.KINDS["double"]))
    run("gcc", *FLAGS["strict"], *FLAGS["gcc"], "-O3", "-mavx2", "-mfma", "-S", "pair.c", cwd=tmp_path)
    assert re.findall(r"\bvfn?m\w+", (tmp_path / "pair.s").read_text()) == []


def arguments(name, real):
    """Columns of arguments of a function, and the error that is stated of it."""
    rows, roundings = (PLACES | PAIRS)[name]
    return [np.ascontiguousarray(column) for column in np.atleast_2d(rows.T).astype(real.dtype)], roundings


@pytest.mark.parametrize("real", CReal.KINDS.values(), ids=CReal.KINDS)
@pytest.mark.parametrize("name", [*PLACES, *PAIRS])
def test_own_functions_are_as_right_as_stated(name, real):
    """Against 40 digits; cosine and sine relative to one, since near their zeros the argument itself is rounded."""
    columns, roundings = arguments(name, real)
    found = reference(name, *columns, real=real)
    with mpmath.workdps(60):
        true = [
            getattr(mpmath, _OTHER.get(name, name))(*(mpmath.mpf(float(v)) for v in row))
            for row in zip(*columns, strict=True)
        ]
        off = [abs(mpmath.mpf(float(f)) - t) for f, t in zip(found, true, strict=True)]
    least = real.least_normal if name == "sqrt" else 1.0 if name in ("cos", "sin") else 0.0
    sizes = [max(abs(float(t)), least) for t in true]
    worst = max(float(o) / s for o, s in zip(off, sizes, strict=True) if s > 0.0)
    assert worst <= roundings * real.epsilon


@needs("cc")
@pytest.mark.parametrize("real", CReal.KINDS.values(), ids=CReal.KINDS)
@pytest.mark.parametrize("name", [*PLACES, *PAIRS])
def test_own_functions_are_their_references_to_the_bit(name, real, tmp_path):
    columns, _ = arguments(name, real)
    columns = [np.concatenate([column, _EXTREME.astype(real.dtype)]) for column in columns]
    x = ca.SX.sym("x", len(columns))
    value = getattr(ca, _OTHER.get(name, name))(*ca.vertsplit(x))
    kernel = Kernel("f", ca.Function("f", [x], [value], ["x"], ["y"]), "")
    found = in_c(kernel, real, np.stack(columns, axis=1), tmp_path)[:, 0]
    assert np.array_equal(found, reference(name, *columns, real=real), equal_nan=True)


_EXTREME = np.array([0.0, 1e38, -1e38, 1e-38, -1e-38, 1.0, -1.0, 0.5, 2.0, -2.0])
"""Finite numbers at which some function has no value, or none that is finite."""


def expressions():
    """Every operation that kernels have, in one function of three numbers."""
    x = ca.SX.sym("x", 3)
    a, b, c = x[0], x[1], x[2]
    terms = [
        a + b,
        a - b,
        a * b,
        a / b,
        -a,
        a * a,
        a + a,
        1 / c,
        ca.fabs(a),
        ca.sign(a),
        ca.fmin(a, b),
        ca.fmax(a, c),
        a < b,
    ]
    terms += [a <= b, ca.if_else(a < c, b, c), ca.logic_not(a), ca.sqrt(c), ca.exp(a), ca.sin(b), ca.cos(c), 0.0]
    terms += [ca.eq(a, b), ca.ne(a, b), ca.logic_and(a, b), ca.logic_or(a, b), ca.tanh(a), ca.atan2(a, b), c**1.3]
    return ca.Function("f", [x], [ca.vertcat(*terms)], ["x"], ["y"])


@needs("cc")
@pytest.mark.parametrize("real", CReal.KINDS.values(), ids=CReal.KINDS)
def test_every_operation_is_that_of_casadi(real, tmp_path):
    function = expressions()
    kernel = Kernel("f", function, "")
    rows = np.random.default_rng(0).uniform(-2.0, 2.0, (100, 3)).astype(real.dtype)
    rows[:, 2] = np.abs(rows[:, 2])
    rows[0] = (0.0, 1.0, 1.0)
    rows[1] = (0.5, 0.5, 0.5)
    found = kernel.evaluate(real, x=rows)["y"]
    true = np.array([np.array(function(row.astype(float))).ravel() for row in rows])
    assert np.abs(found - true).max() <= 4 * real.epsilon * np.abs(true).max(axis=0).clip(1.0).max()
    assert np.array_equal(in_c(kernel, real, rows, tmp_path), found)


def test_an_operation_without_strict_c_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(InputError, match="no strict C for the operation OP_ERF"):
        Kernel("f", ca.Function("f", [x], [ca.erf(x)], ["x"], ["y"]), "")


def test_single_precision_has_no_literal_in_double():
    """A literal without its suffix would make its expression double."""
    import re

    x = ca.SX.sym("x")
    terms = ca.vertcat(0.1 * x, x / 3, 1e-30 * x, 12345678.9 + x, ca.fmin(x, -2), ca.exp(x))
    text = Kernel("f", ca.Function("f", [x], [terms], ["x"], ["y"]), "").c_source("k", CReal.KINDS["float"])
    numbers = re.findall(r"(?<![\w.])\d+\.?\d*(?:e[-+]?\d+)?f?(?![\w\]])", re.sub(r"\[\d+\]", "", text))
    assert len(numbers) >= 5
    assert all(number.endswith("f") for number in numbers)


def test_a_constant_beyond_single_precision_is_refused():
    x = ca.SX.sym("x")
    kernel = Kernel("f", ca.Function("f", [x], [1e-50 * x], ["x"], ["y"]), "")
    with pytest.raises(InputError, match="single precision"):
        kernel.c_source("k", CReal.KINDS["float"])


@pytest.mark.parametrize(("family", "name"), MANY.values())
def test_the_reference_is_the_model(family, name):
    model = model_of(family, name)
    x, u, w, _ = state_of(model)
    driven = model.drive_rates if model._equations.drives_feel_motion else None
    kernel = SweptKernel("dynamics", model.kernels(), "", driven)
    rows = {"x": x[None], "u": u[None], "w": w[None], "p": np.zeros((1, 0))}
    found = kernel.evaluate(CReal.KINDS["double"], **rows)["xd"][0]
    true = np.array(model.forward_dynamics(x, u, w, [])).ravel()
    assert np.abs(found - true).max() <= 1e-8 * np.abs(true).max()


def test_code_does_not_grow_with_the_elements():
    def lines(count: int) -> int:
        finger = model_of("arc", "bare").finger
        model = FingerModel(finger, family="arc", elements=count, loads=(ForceLoad(at=0.6, force=(0.0, 0.0)),))
        kernel = SweptKernel("dynamics", model.kernels(), "")
        return kernel.c_source("finger", CReal.KINDS["float"]).count("\n")

    assert lines(4 * COUNT) <= lines(COUNT)
