"""Packages of many elements, whose dynamics are a loop over the links."""

from __future__ import annotations

import re
import shutil
from functools import lru_cache

import numpy as np
import pytest

from continuum_grasp.export import export_c
from continuum_grasp.export.fields import REALS
from continuum_grasp.export.swept import SweptKernel
from continuum_grasp.model import FingerModel
from continuum_grasp.model.sweep import Builder
from continuum_grasp.scene import ForceLoad
from tests.export_cases import STRICT, WARNINGS, compile_programs, needs, run
from tests.model.test_many_elements import COUNT, model_of, state_of

CASES = [
    ("arc", "lag", "float"),
    ("matched_clothoid", "everything", "double"),
    ("clothoid", "friction", "double"),
    ("arc", "winches", "double"),
]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The folder of a package, by its case."""

    @lru_cache
    def made(family: str, name: str, real: str):
        path = tmp_path_factory.mktemp("swept")
        export_c(model_of(family, name), path, what=["dynamics", "step"], real=real, step=1e-7)
        return path

    return made


@pytest.mark.deep
@pytest.mark.parametrize(("case", "compiler"), [(0, "gcc"), (0, "clang"), (1, "gcc"), (2, "clang"), (3, "gcc")])
def test_every_vector_to_the_bit_without_a_warning(compiler, case, package, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"not installed: {compiler}")
    (program,) = compile_programs(compiler, package(*CASES[case]), tmp_path, "main", *STRICT, *WARNINGS, "-O2")
    assert re.findall(r" 0 of +\d+ cases failed", run(program))


@pytest.mark.deep
@needs("gcc", "nm")
def test_nothing_is_called_and_nothing_is_stored(package, tmp_path):
    made = package(*CASES[1])
    run("gcc", *STRICT, "-O2", f"-I{made / 'include'}", "-c", *(made / "src").glob("*.c"), cwd=tmp_path)
    kinds = re.findall(r" ([A-Za-z]) \w+$", run("nm", *tmp_path.glob("*.o")), re.MULTILINE)
    assert set(kinds) <= {"T", "t", "U", "r", "R"}


@pytest.mark.deep
@needs("gcc")
def test_many_states_at_once_have_the_same_bits(package, tmp_path):
    (program,) = compile_programs("gcc", package(*CASES[1]), tmp_path, "batch", *STRICT, "-O2", "-DFINGER_BATCH")
    assert run(program).startswith("0 states")


@pytest.mark.parametrize(("family", "name"), [case[:2] for case in CASES])
def test_the_reference_is_the_model(family, name):
    model = model_of(family, name)
    x, u, w, _ = state_of(model)
    driven = model.drive_rates if model._equations.drives_feel_motion else None
    kernel = SweptKernel("dynamics", Builder(model._equations).kernels(), "", driven)
    rows = {"x": x[None], "u": u[None], "w": w[None], "p": np.zeros((1, 0))}
    found = kernel.evaluate(REALS["double"], **rows)["xd"][0]
    true = np.array(model.forward_dynamics(x, u, w, [])).ravel()
    assert np.abs(found - true).max() <= 1e-8 * np.abs(true).max()


def test_code_does_not_grow_with_the_elements():
    def lines(count: int) -> int:
        finger = model_of("arc", "bare").finger
        model = FingerModel(finger, family="arc", elements=count, loads=(ForceLoad(at=0.6, force=(0.0, 0.0)),))
        kernel = SweptKernel("dynamics", Builder(model._equations).kernels(), "")
        return kernel.c_source("finger", REALS["float"]).count("\n")

    assert lines(4 * COUNT) <= lines(COUNT)
