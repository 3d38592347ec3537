"""Functions made of calls of straight-line functions: their C, plain and in lanes, and what is left out."""

from __future__ import annotations

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.core import (
    Compiler,
    CSource,
    call,
    straight_function,
)

needs_compiler = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")


def doubled_pendulum() -> ca.Function:
    """Two explicit Euler steps of a pendulum; of the second slope the Jacobian is not needed."""
    x, h = ca.SX.sym("x", 2), ca.SX.sym("h")
    rate = ca.vertcat(x[1], -ca.sin(x[0]))
    slope = straight_function("slope", {"x": x}, {"rate": rate, "jacobian": ca.jacobian(rate, x)})
    k, jacobian = ca.SX.sym("k", 2), ca.SX.sym("J", slope.sparsity_out(1))
    further = {"next": x + h * k, "by": ca.densify(ca.SX.eye(2) + h * jacobian)}
    move = straight_function("move", {"x": x, "h": h, "k": k, "J": jacobian}, further)
    last = straight_function("last", {"x": x, "h": h, "k": k}, {"next": x + h * k})
    start, step = ca.MX.sym("x", 2), ca.MX.sym("h")
    middle, by = call(move, start, step, *call(slope, start))
    (end,) = call(last, middle, ca.MX(0.25), call(slope, middle)[0])
    return ca.Function("two_steps", [start, step], [end, by], ["x", "h"], ["xn", "A"])


def euler(x, h):
    return x + h * np.array([x[1], -np.sin(x[0])])


@needs_compiler
@pytest.mark.parametrize("lanes", [False, True])
def test_calls_give_what_the_formula_gives(lanes, tmp_path):
    function = doubled_pendulum()
    if lanes:
        parts = [CSource([function]).lanes()]
        body = """
  cg_lanes x[2], h[1], xn[2], A[4]; const cg_lanes *in[] = {x, h}; cg_lanes *out[] = {xn, A};
  for (int l = 0; l < CG_LANES; ++l) { x[0][l] = given[0]; x[1][l] = given[1]; h[0][l] = given[2]; }
  two_steps_lanes(in, out);
  for (int k = 0; k < 6; ++k) found[k] = k < 2 ? xn[k][CG_LANES - 1] : A[k - 2][CG_LANES - 1];"""
    else:
        parts = [CSource([function]).plain("test")]
        body = """
  const double *in[] = {given, given + 2}; double *out[] = {found, found + 2};
  two_steps(in, out);"""
    source = tmp_path / "calls.c"
    source.write_text("\n".join([*parts, f"void run(const double *given, double *found)\n{{{body}\n}}\n"]))
    line = [
        *Compiler.find().command,
        "-std=gnu11",
        "-O1",
        "-w",
        "-shared",
        "-fPIC",
        source,
        "-o",
        tmp_path / "calls.so",
    ]
    subprocess.run([*line, "-lm"], check=True)
    given, found = np.array([0.4, -0.3, 0.1]), np.zeros(6)
    library = ctypes.CDLL(str(tmp_path / "calls.so"))
    library.run(ctypes.c_void_p(given.ctypes.data), ctypes.c_void_p(found.ctypes.data))
    x, h = given[:2], given[2]
    assert found[:2] == pytest.approx(euler(euler(x, h), 0.25), rel=1e-14)
    # By columns.
    assert found[2:] == pytest.approx([1.0, -h * np.cos(x[0]), h, 1.0], rel=1e-14)


def test_what_is_not_needed_is_not_computed():
    """The Jacobian of the second slope: its result is null, at which the slope returns."""
    text = CSource([doubled_pendulum()]).plain("test")
    assert text.count("slope(in, out)") == 2
    assert ", 0};" in text
    body = text[text.index("static int slope(") :]
    body = body[: body.index("\n}\n")]
    rate, jacobian = body.split("if (!res[1]) return 0;")
    assert "sin(" in rate
    assert "cos(" not in rate
    assert "cos(" in jacobian


def test_anything_but_calls_is_refused():
    x = ca.MX.sym("x", 2)
    slope = straight_function("f", {"x": ca.SX.sym("x", 2)}, {"y": ca.SX.ones(2)})
    with pytest.raises(InputError, match="g: expected a straight-line SX function, or calls of such functions"):
        _ = CSource([ca.Function("g", [x], [2.0 * call(slope, x)[0]])]).straight
