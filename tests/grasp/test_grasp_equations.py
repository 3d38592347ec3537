"""Compiled equations of a grasp problem; from inside: the expressions they are compared with, and when they load.

Compiled equations of a grasp problem: the same numbers as those of its expressions, and when they are used.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from grasp_scenes import CONFIGS, make_scene

import continuum_grasp
from continuum_grasp.core import Cache, Compiler
from continuum_grasp.core.cache import cache_folder
from continuum_grasp.grasp.problem import equations as problem
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import _shared_by
from continuum_grasp.scene import Box
from tests.grasp.test_grasp_problem_limits import first_start

needs_compiler = pytest.mark.skipif(Compiler.find() is None, reason="needs a C compiler")
BOX = Box(shape="box", width=0.08, height=0.06, mass=0.3, position=(0.04, 0.0))
SOLVE = """
import json, sys
from continuum_grasp.grasp.problem import equations
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene.reading import load
loaded = []
whole = equations._loaded if sys.argv[2] == "compiled" else lambda spec, library: equations._built(spec)
equations._loaded = lambda *given: loaded.append(given) or whole(*given)
found = optimize_grasp(load(sys.argv[1]).changed({"fidelity.elements": 4}))
print(json.dumps([len(loaded), {name: values.tolist() for name, values in found.arrays.items()}]))
"""


@cache
def small():
    """The structure of a finger of arcs at a mug, with all its contacts."""
    scene = make_scene(family="arc", tendon_friction=0.2)
    return ProblemSpec.of(scene, first_start(scene).contacts)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of its own."""
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path))
    return cache_folder(problem.KIND)


@pytest.fixture
def loads(monkeypatch):
    """Structures whose equations were loaded."""
    seen, whole = [], problem._loaded
    monkeypatch.setattr(problem, "_loaded", lambda spec, library: seen.append(spec) or whole(spec, library))
    return seen


def outputs(made):
    """Values of all functions at a random point."""
    rng, numbers = np.random.default_rng(0), made.layout.numbers.size
    x, p = rng.uniform(0.4, 0.6, made.layout.x.size), rng.uniform(0.4, 0.6, numbers)
    force = rng.normal(size=made.layout.rows.count)
    slopes = [made.nlp.functions[key](x, p) for key in ("grad_f", "jac_g")]
    bends = made.nlp.functions["hess_lag"](x, p, 1.0, force), made.nlp.slope(x, p, 1.0, force)
    return [*made.nlp.values(x, p), *sum(slopes, ()), *bends, *made.read.call([x, p]), *made.places.call([x, p])]


@needs_compiler
def test_compiled_equations_are_those_of_the_expressions_to_the_last_bit(folder, loads):
    spec = small()
    plain = problem.equations(spec)
    assert not loads
    problem.compile_equations([spec])
    compiled = problem.equations(spec)
    assert loads == [spec]
    for one, other in zip(outputs(plain), outputs(compiled), strict=True):
        assert one.sparsity() == other.sparsity()
        np.testing.assert_array_equal(one.nonzeros(), other.nonzeros())
    layouts = plain.layout, compiled.layout
    assert len({repr((of.x.sizes, of.numbers.sizes, of.rows.blocks, of.fingers)) for of in layouts}) == 1
    (library,) = folder.glob("*.so")
    spoilt = library.with_suffix(".spoilt")  # the library itself is in use
    spoilt.write_bytes(library.read_bytes()[:-1])
    os.replace(spoilt, library)
    problem.equations(spec)
    assert loads == [spec]  # built anew


def test_a_layout_is_that_of_the_expressions():
    layout, whole = problem.equations(small()).layout, problem.expressions(small())
    for one, other in ((layout.x, whole.x), (layout.numbers, whole.numbers)):
        assert (one.at, one.size) == (other.at, int(other.symbol.numel()))
    np.testing.assert_array_equal(layout.rows.bounds(), whole.rows.bounds())
    assert [(b.name, b.key, b.unit) for b in layout.rows.blocks] == [(b.name, b.key, b.unit) for b in whole.rows.blocks]
    assert layout.rows.count == int(whole.rows.g.numel())


def test_structures_differ_by_every_key(monkeypatch):
    """Also by the surfaces that are touched, which are objects."""
    spec, compiler = small(), Compiler.find() or Compiler(("cc",), "1", "here")
    finger = replace(spec.fingers[0], weighs=not spec.fingers[0].weighs)
    boxed = ProblemSpec.of(make_scene(object=BOX), {}).surfaces
    others = [spec, replace(spec, steadied=True), replace(spec, fingers=(finger,)), replace(spec, surfaces=boxed)]
    assert len({problem._identity(each, compiler) for each in others}) == 4
    assert problem._identity(pickle.loads(pickle.dumps(spec)), compiler) == problem._identity(spec, compiler)
    before = problem._identity(spec, compiler)
    monkeypatch.setattr(Cache, "hash_of_code", lambda *_: "other code")
    assert problem._identity(spec, compiler) != before


def test_all_code_that_decides_on_equations_is_part_of_their_identity():
    """What runs while they are built lies in the packages whose files are hashed, or only checks arguments."""
    package, ran = Path(continuum_grasp.__file__).parent, set()
    for built in (problem.expressions, _shared_by):
        built.cache_clear()
    sys.setprofile(lambda frame, event, _: ran.add(frame.f_code.co_filename) if event == "call" else None)
    try:
        problem._built(small())
    finally:
        sys.setprofile(None)
    inside = {Path(file).relative_to(package) for file in ran if Path(file).is_relative_to(package)}
    assert len(inside) > 20
    beside = {file.as_posix() for file in inside if not any(file.is_relative_to(each) for each in problem._CODE)}
    assert beside <= {f"base/{name}.py" for name in ("__init__", "arguments", "errors", "labels")}


@needs_compiler
def test_one_process_at_a_time_compiles(folder):
    folder.mkdir(mode=0o700)
    (folder / "build-of-another").mkdir()
    problem.compile_equations([small()])
    assert [file.name for file in folder.iterdir()] == ["build-of-another"]


def test_without_a_compiler_equations_are_built(folder, loads, monkeypatch):
    monkeypatch.setenv("CC", "")
    problem.compile_equations([small()])
    assert problem.equations(small()).layout.x.size == problem.expressions(small()).x.size
    assert not loads
    assert not list(folder.glob("*"))


@needs_compiler
def test_only_where_optimized_code_is_asked_for_are_equations_compiled(folder, loads, monkeypatch):
    """And at once, in the process that asks."""
    monkeypatch.delenv("CONTINUUM_GRASP_QUICK_COMPILE", raising=False)
    problem.equations(small())
    assert not list(folder.glob("*.so"))
    monkeypatch.setenv("CONTINUUM_GRASP_QUICK_COMPILE", "0")
    problem.equations(small())
    assert len(list(folder.glob("*.so"))) == 1
    assert loads == [small()]


def test_libraries_used_last_stay(folder):
    folder.mkdir(mode=0o700)
    for age in range(5):
        for suffix in (".so", ".json"):
            file = folder / f"{age}{suffix}"
            file.write_text("")
            os.utime(file, (100 - age, 100 - age))
    Cache(problem.KIND).forget_oldest(2)
    assert sorted(file.name for file in folder.iterdir()) == ["0.json", "0.so", "1.json", "1.so"]


@pytest.mark.deep
@needs_compiler
def test_compiled_equations_find_the_same_grasp(tmp_path):
    env = {**os.environ, "CONTINUUM_GRASP_CACHE": str(tmp_path)}

    def solved(code):
        command = [sys.executable, "-c", SOLVE, str(CONFIGS / "mug.yaml"), code]
        done = subprocess.run(command, capture_output=True, text=True, env=env, check=True, timeout=600)
        return json.loads(done.stdout)

    assert not solved("compiled")[0]
    env["CONTINUUM_GRASP_QUICK_COMPILE"] = "0"
    # Both start from the same map of the finger: one that is compiled otherwise differs by rounding, and a search that
    # starts so ends elsewhere within the solver's tolerance.
    plain = solved("interpreted")[1]
    for _ in range(2):  # compiled, then from the cache
        loaded, compiled = solved("compiled")
        assert loaded
        assert compiled.keys() == plain.keys()
        for name, values in plain.items():
            if np.asarray(values).dtype.kind == "U":
                assert compiled[name] == values
            else:
                np.testing.assert_allclose(compiled[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
