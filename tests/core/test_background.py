"""Functions that are compiled beside a process, against the functions themselves."""

import time

import casadi as ca
import pytest

from continuum_grasp.core import Compiler, CSource


@pytest.fixture
def functions(monkeypatch, tmp_path):
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path))
    x = ca.SX.sym("x", 2)
    return CSource([ca.Function("beside", [x], [ca.sin(x[0]) * x[1] ** 3])])


def test_functions_are_compiled_beside_a_process_that_goes_on(functions):
    assert functions.loaded_or_begun("a test") is None
    # A minute: the compiler of a busy machine
    until = time.monotonic() + 60.0
    while Compiler.find().known(functions.externals()) is None and time.monotonic() < until:
        time.sleep(0.05)
    (loaded,) = functions.loaded_or_begun("a test")
    assert loaded.is_a("External")
    (own,) = functions.functions
    assert float(loaded([0.3, 2.0])) == pytest.approx(float(own([0.3, 2.0])), rel=1e-14)


def test_without_a_compiler_nothing_is_begun(functions, monkeypatch):
    monkeypatch.setenv("CC", "")
    assert functions.loaded_or_begun("a test") is None
