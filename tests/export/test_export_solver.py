"""Packages of solvers: the commands of Python, and what they say."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.export import Code
from tests.export_cases import needs, shared_library
from tests.rti_problems import cart_pole


@pytest.fixture
def package(packages):
    """Package of the cart-pole."""
    return packages("cart-pole", "double")


@needs("cc")
def test_the_solver_in_c_is_that_of_python(package, tmp_path):
    """In closed loop with itself from far away, with parameters that change, over states that are not finite."""
    built, library = shared_library(package, tmp_path)
    solver, other = cg.rti(cart_pole()), built.Controller(library)
    assert [name for name, _ in built.Measurement._fields_] == ["position", "angle", "speed", "rate"]
    rng, x, codes = np.random.default_rng(0), np.array([0.3, 0.9, 0.0, 0.0]), set()
    nodes = solver.stages.stages + 1
    for k in range(60):
        rows = np.tile([0.2 * (k > 30), 0.0, 0.0, 0.0, 0.0], (nodes, 1))
        other.head.known.gravity = gravity = 9.81 + 0.5 * (k > 10)
        seen = np.where(rng.random(4) < 0.03, np.nan, x)
        command = solver.step(seen, rows, [gravity])
        columns = [(built.Real * nodes)(*column) for column in rows.T]
        found = other.step(built.Measurement(*seen), built.Reference(*columns))
        assert found.force == pytest.approx(command.u[0], rel=1e-7, abs=1e-7)
        codes.add(other.code)
        x = command.plan.x[1] if command.status < 3 else x
    assert {int(Code.OK), int(Code.WARN_PREVIOUS_PLAN)} <= codes


def test_what_a_package_of_a_solver_says_and_what_it_cannot_have(package, tmp_path):
    made = json.loads((package / "MANIFEST.json").read_text())
    assert made["parts"] == ["mpc"]
    assert made["model"] is None
    header = (package / "include/finger.h").read_text()
    assert "C99 of a predictive controller" in header
    assert re.findall(r"\b(?:inf|nan)\b", header) == []  # no words of C: limits that are none are the greatest number
    assert "finger," not in (package / "README.md").read_text().split("## Cost")[0]
    solver = cg.rti(cart_pole())
    with pytest.raises(InputError, match="has only mpc"):
        cg.export_c(solver, tmp_path, what=["dynamics"])
    with pytest.raises(InputError, match="no ranges"):
        cg.export_c(solver, tmp_path, ranges={"gravity": (9.0, 10.0)})
