"""The C of packages on this machine: warnings, sanitizers, symbols, stack, fast flags, threads, any input."""

from __future__ import annotations

import ctypes
import json
import re
import shutil

import numpy as np
import pytest

from continuum_grasp.export import Code
from tests.export_cases import SANITIZE, STRICT, WARNINGS, compile_programs, needs, run, shared_library
from tests.marks import few

FINGER, LOOP, MOTION, SEEN = (
    ("dynamics", "step", "tip", "section_at", "statics"),
    ("estimator_step", "mpc"),
    ("dynamics", "step"),
    ("shape", "velocities", "touch"),
)
PACKAGES = {
    ("friction", "float"): FINGER,
    ("contact", "double"): FINGER,
    ("winches", "double"): FINGER,
    ("motor", "float"): FINGER,
    ("observed", "float"): LOOP,
    ("given", "double"): ("mpc",),
    ("adapting", "double"): LOOP,
    ("scenarios", "double"): ("mpc",),
    ("servo", "float"): LOOP,
    ("servo", "double"): LOOP,
    ("cart-pole", "double"): ("mpc",),
    ("implicit", "double"): ("implicit_step",),
    ("implicit", "float"): ("implicit_step",),
    ("many elements, lag", "float"): MOTION,
    ("many elements, everything", "double"): MOTION,
    ("many elements, friction", "double"): MOTION,
    ("many elements, winches", "double"): MOTION,
    ("seen", "float"): SEEN,
    ("seen", "double"): SEEN,
}
"""Packages of ``export_cases`` by name and type, with the functions of which they have test vectors."""
COMPILERS = [pytest.param(name, marks=needs(name)) for name in ("gcc", "clang")]
TURNS = [(*case, ("gcc", "clang")[k % 2]) for k, case in enumerate(PACKAGES)]
"""Both compilers in turns."""
MAY_NEED = {"memcpy", "memset"}
"""What compiled code may call beyond its own."""
STACK = {("friction", "float"): 1200, ("friction", "double"): 2000, ("many elements, everything", "double"): 7000}
"""Bytes of the largest frame of a function on x86-64; of others 6000."""
START = {"friction": "finger_model m; int main() { return finger_init(&m); }"}
START["observed"] = "static finger_controller c; int main() { return finger_controller_init(&c); }"


@pytest.mark.deep
@pytest.mark.parametrize(
    ("name", "real", "compiler"), [*TURNS, ("friction", "float", "clang"), ("observed", "float", "clang")]
)
def test_every_vector_to_the_bit_without_a_warning(name, real, compiler, packages, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"not installed: {compiler}")
    level = "-O2" if PACKAGES[name, real] in (FINGER, MOTION) else "-O1"
    (program,) = compile_programs(compiler, packages(name, real), tmp_path, "main", *STRICT, *WARNINGS, level)
    found = dict(re.findall(r"^(\w+) +0 of +(\d+) cases failed", run(program), re.MULTILINE))
    assert sorted(found) == sorted(PACKAGES[name, real])
    assert all(int(cases) >= 200 for function, cases in found.items() if function in LOOP)


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    ("name", "real"), few([("friction", "float"), ("friction", "double"), ("observed", "float")], 2)
)
def test_with_fast_flags_to_rounding_and_nothing_gets_past_the_checks(name, real, compiler, packages, tmp_path):
    """NaN and infinity, of which vectors are full, are found although the compiler may assume that there are none."""
    tolerance = {"float": "2e-3", "double": "1e-11"}[real]
    fast = ("-std=c99", "-O3", "-ffast-math", "-march=native")
    vectors, fuzz = compile_programs(compiler, packages(name, real), tmp_path, "main fuzz", *fast)
    run(vectors, tolerance)
    run(fuzz, 5000)


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    ("name", "real"),
    few([(name, "float") for name in ("friction", "seen", "limited", "observed")] + [("servo", "double")], 2),
)
def test_any_bits_under_sanitizers(name, real, compiler, packages, tmp_path):
    flags = (*STRICT, "-O1", "-g", SANITIZE, "-fno-sanitize-recover=all")
    vectors, fuzz = compile_programs(compiler, packages(name, real), tmp_path, "main fuzz", *flags)
    run(vectors)
    run(fuzz, 3000)


@needs("gcc")
@pytest.mark.parametrize("name", few(["friction", "given"], 1))
def test_threads_do_not_meet(name, packages, tmp_path):
    flags = (*STRICT, "-O1", "-g", "-fsanitize=thread", "-pthread")
    (program,) = compile_programs("gcc", packages(name, "double"), tmp_path, "threads", *flags)
    assert "0 cases failed" in run(program)


@needs("gcc", "nm")
@pytest.mark.parametrize(("name", "real"), few([*STACK, *list(PACKAGES)[1:6]], 2))
def test_nothing_is_called_or_stored_and_the_stack_is_bounded(name, real, packages, tmp_path):
    package = packages(name, real)
    flags = (*STRICT, "-O2", "-fstack-usage", f"-I{package / 'include'}")
    run("gcc", *flags, "-c", *(package / "src").glob("*.c"), cwd=tmp_path)
    symbols = re.findall(r"([A-Za-z]) (\w+)$", run("nm", *tmp_path.glob("*.o")), re.MULTILINE)
    own = {symbol for kind, symbol in symbols if kind == "T"}
    assert {symbol for kind, symbol in symbols if kind == "U"} - own <= MAY_NEED
    assert {kind for kind, _ in symbols} <= {"T", "t", "U", "r", "R"}
    assert all(symbol.startswith("finger_") for symbol in own)
    rows = [line.split("\t") for path in tmp_path.glob("*.su") for line in path.read_text().splitlines()]
    assert rows
    assert {kind for *_, kind in rows} <= {"static"} | ({"dynamic,bounded"} if name != "friction" else set())
    assert max(int(size) for _, size, _ in rows) <= STACK.get((name, real), 6000)


@pytest.mark.deep
@needs("cppcheck")
@pytest.mark.parametrize(("name", "real"), [("friction", "float"), ("contact", "double"), ("observed", "float")])
def test_cppcheck_finds_nothing(name, real, packages):
    package = packages(name, real)
    flags = ("--enable=warning,style,performance,portability", "--std=c99", "--suppress=missingIncludeSystem", "-q")
    own = [package / "src/finger_control.c"] if name == "observed" else [package / "src"]
    assert run("cppcheck", *flags, "--error-exitcode=3", f"-I{package / 'include'}", *own) == ""


@needs("c++", "cc")
@pytest.mark.parametrize("name", few(START, 1))
def test_the_header_is_one_of_cpp_too(name, packages, tmp_path):
    package = packages(name, "double")
    (tmp_path / "main.cpp").write_text(f'#include "finger.h"\n{START[name]}\n')
    include = f"-I{package / 'include'}"
    run("cc", *STRICT, include, "-c", *(package / "src").glob("*.c"), cwd=tmp_path)
    run("c++", "-Wall", "-Wextra", "-Werror", include, "main.cpp", *tmp_path.glob("*.o"), cwd=tmp_path)
    run(tmp_path / "a.out")


@needs("cc")
def test_a_vector_that_is_changed_fails(packages, tmp_path):
    """The check program does see the last bit: one literal of the kernels is changed by one part in 1e16."""
    package = tmp_path / "package"
    shutil.copytree(packages("tendons", "double"), package)
    kernels = package / "src/finger_kernels.c"
    text = kernels.read_text()
    number = next(n for n in re.findall(r"(?<=[ (])0\.\d{15,}", text))
    changed = number[:-1] + ("1" if number[-1] != "1" else "3")
    kernels.write_text(text.replace(number, changed))
    (program,) = compile_programs("cc", package, tmp_path, "main", *STRICT, "-O1")
    said = run(program, expect=1)
    assert re.search(r" [1-9]\d* of +\d+ cases failed", said)


@needs("cc")
@pytest.mark.parametrize("name", ["tendons", "contact", "direct", "arcs"])
def test_a_state_that_no_step_takes_was_warned_about_and_can_be_drawn(name, packages, tmp_path):
    """Of 20,000 steps up to every limit, those with the warning and no others end where the next one is refused."""
    module, library = shared_library(packages(name, "double"), tmp_path)
    limits = json.loads((packages(name, "double") / "MANIFEST.json").read_text())["structs"]
    rng, count, h = np.random.default_rng(5), 20_000, 1e-3
    usual = {"tip_moment": 0.1, "tip_moment_rate": 1.0}
    reach = {
        part: [min(field["high"], usual.get(field["name"], 300.0)) for field in limits[part]]
        for part in ("state", "input")
    }
    states = rng.uniform(-1.02, 1.02, (count, len(reach["state"]))) * reach["state"]
    inputs = rng.uniform(0.0, 1.02, (count, len(reach["input"]))) * reach["input"]
    forces = [np.zeros((count, len(limits["forces"])))] if "forces" in limits else []

    def steps(given):
        following, codes = np.zeros_like(given), np.zeros(count, dtype=np.intc)
        rows = [
            array.ctypes.data + array.strides[0] * np.arange(count) for array in (given, inputs, *forces, following)
        ]
        for k, (*arrays, out) in enumerate(zip(*(map(ctypes.c_void_p, at.tolist()) for at in rows), strict=True)):
            codes[k] = library._c.finger_step(ctypes.byref(library.model), *arrays, module.Real(h), out)
        return following, codes

    following, codes = steps(states)
    again = steps(following)[1]
    done, warned = codes >= 0, codes == Code.WARN_LEFT_RANGE
    assert done.sum() > 5000
    assert warned.sum() > 20
    assert np.array_equal((again == Code.ERR_RANGE)[done], warned[done])
    for k in [*np.flatnonzero(warned)[:200], *range(200)]:
        acting = module.Input(*inputs[k])
        more = [module.Forces(*f[k]) for f in forces]
        if codes[k] < 0:
            with pytest.raises(module.Error, match=rf"\({codes[k]}\)"):
                library.step(module.State(*states[k]), acting, *more, h)
            continue
        single = library.step(module.State(*states[k]), acting, *more, h)
        assert (bytes(single), library.code) == (following[k].tobytes(), codes[k])
        assert np.isfinite([library.tip(single, acting).x, library.section_at(single, acting, 0.05).y]).all()
        assert library.code == (Code.WARN_LEFT_RANGE if warned[k] else Code.OK)
