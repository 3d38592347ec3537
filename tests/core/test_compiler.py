"""Translation units: the same numbers from all of them; from inside: how source is divided, by limits that are lowered.

Translation units: long functions apart from the rest, and the same numbers from all of them.
"""

from __future__ import annotations

import ctypes
import logging
import re
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.core import (
    CompileError,
    Compiler,
    CSource,
    cache,
    compiler,
)
from continuum_grasp.core.compiler import longest_function, translation_units
from continuum_grasp.core.precision import single
from continuum_grasp.core.source import batch_source, rollout_source, symbol_of
from continuum_grasp.scene import Finger
from tests.finger_cases import ROD

needs_compiler = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler")


def chain(length: int, name: str = "chain") -> ca.Function:
    """A straight-line function: repeated products and sums of two numbers, which a sine keeps bounded."""
    x = ca.SX.sym("x", 2)
    a, b = x[0], x[1]
    for _ in range(length):
        a, b = ca.sin(a * b + x[0]), b - 0.3 * a
    return ca.Function(name, [x], [ca.vertcat(a, b), a * b], ["x"], ["y", "z"])


def reference(x: np.ndarray, length: int) -> np.ndarray:
    a, b = x
    for _ in range(length):
        a, b = np.sin(a * b + x[0]), b - 0.3 * a
    return np.array([a, b, a * b])


def called(library, name: str, x: np.ndarray) -> np.ndarray:
    y, z = np.zeros(2), np.zeros(1)
    arg = (ctypes.c_void_p * 1)(x.ctypes.data)
    res = (ctypes.c_void_p * 2)(y.ctypes.data, z.ctypes.data)
    work = np.zeros(10_000)
    getattr(library, name)(arg, res, None, ctypes.c_void_p(work.ctypes.data), 0)
    return np.concatenate([y, z])


@pytest.fixture
def levels(monkeypatch) -> list[tuple[int, str]]:
    """Lines of the longest function and level of every translation unit that is compiled."""
    seen: list[tuple[int, str]] = []
    plain = Compiler.run

    def run(self, arguments):
        for name in (one for one in arguments if one.endswith(".c")):
            level = next(flag for flag in arguments if re.fullmatch("-O.", flag))
            with open(name) as file:
                seen.append((longest_function(file.read()), level))
        plain(self, arguments)

    monkeypatch.setattr(Compiler, "run", run)
    monkeypatch.setattr(compiler, "LONG", 300)
    monkeypatch.delenv("CONTINUUM_GRASP_QUICK_COMPILE", raising=False)
    return seen


@needs_compiler
@pytest.mark.parametrize("command", ["gcc", "clang"])
def test_each_function_has_the_level_of_its_own_length(command, levels, monkeypatch, tmp_path):
    """A long function beside short ones: only it is compiled at the lower level, and nothing without optimization."""
    if shutil.which(command) is None:
        pytest.skip(f"no {command}")
    monkeypatch.setenv("CC", command)
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path))
    code = CSource([chain(20, "brief"), chain(400, "long_one"), chain(30, "after")]).externals()
    library = ctypes.CDLL(str(Compiler.find().library(code)))
    assert sorted(level for _, level in levels) == ["-O1", "-O3"]
    assert all((level == "-O3") == (lines <= 300) for lines, level in levels)
    x = np.array([0.4, -0.7])
    for name, length in (("brief", 20), ("long_one", 400), ("after", 30)):
        assert called(library, name, x) == pytest.approx(reference(x, length), rel=1e-12)


@pytest.mark.deep
@needs_compiler
def test_units_export_what_the_source_exports(levels, tmp_path):
    """By the system's linker: the same names; those of vector lanes too."""
    if shutil.which("nm") is None:
        pytest.skip("no nm")
    x, p, h = (ca.SX.sym(n, k) for n, k in (("x", 2), ("p", 1), ("h", 1)))
    three = [ca.SX.sym(f"{n}{k}") for n in "uw" for k in range(3)]
    step = ca.Function("step", [x, *three, p, h], [x + h * chain(400)(x)[0]])
    for source in (batch_source(chain(400)), rollout_source(step)):
        assert len(translation_units(source, 300)) == 2
        names = []
        for limit in (300, 10**9):
            compiler.LONG = limit
            code, library = tmp_path / f"code{limit}.c", tmp_path / f"code{limit}.so"
            code.write_text(source)
            Compiler.find().build(code, library)
            listed = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True)
            names.append([line.split()[2] for line in listed.stdout.splitlines()])
        assert names[0] == names[1]
        assert len(names[0]) > 0


def test_source_without_long_functions_stays_one_unit():
    source = CSource([chain(20)]).of_core("chain")
    assert translation_units(source, 300) == [source]


def test_optimized_units_have_a_variable_per_assignment(monkeypatch):
    """Variables that are used again and again take clang's SROA a time in the square of the length."""
    monkeypatch.setenv("CONTINUUM_GRASP_QUICK_COMPILE", "0")
    _, unit = translation_units(CSource([chain(400)]).of_core("chain"), 300)
    assigned = re.findall(r"^  (?:const casadi_real )?(\w+)=", unit, re.MULTILINE)
    assert len(assigned) > 1000
    assert len(set(assigned)) == len(assigned)


@needs_compiler
def test_quick_builds_do_not_optimize_long_functions(levels, monkeypatch, tmp_path):
    """And give the same numbers."""
    monkeypatch.setenv("CONTINUUM_GRASP_QUICK_COMPILE", "1")
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path))
    for length, level in ((20, "-O1"), (400, "-O0")):
        levels.clear()
        library = ctypes.CDLL(str(Compiler.find().library(CSource([chain(length)]).of_core("chain"))))
        assert {found for lines, found in levels if lines > 300 or length == 20} == {level}
        x = np.array([0.4, -0.7])
        assert called(library, symbol_of(chain(length)), x) == pytest.approx(reference(x, length), rel=1e-12)


@needs_compiler
def test_what_takes_long_is_logged_and_nothing_is_printed(monkeypatch, tmp_path, caplog, capfd):
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path))
    source = "int answer(void)\n{\n  return 42;\n}\n"
    with caplog.at_level(logging.INFO, "continuum_grasp"):
        Compiler.find().library(source, "the model")
        assert not caplog.messages
        monkeypatch.setattr(compiler, "_ANNOUNCED", 0.0)
        for _ in range(2):  # the second time it is in the cache
            Compiler.find().library(f"{source}/* long */\n", "the model")
    begun, ended = caplog.messages
    assert re.fullmatch(r"compiling the model, about \S+ s the first time; cached afterwards", begun)
    assert re.fullmatch(r"compiled the model in \S+ s", ended)
    assert capfd.readouterr() == ("", "")


def stand_in(folder, name: str, script: str):
    """A compiler of this name that is a script of the shell."""
    file = folder / name
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o755)
    return file


@needs_compiler
def test_a_compiler_that_knows_no_march_native_is_asked_without(tmp_path, monkeypatch):
    """As clang before 15 on Apple's processors: the library is built, for the processor that the compiler takes."""
    refuses = 'case " $* " in *" -march=native "*) echo "unsupported argument: native" >&2; exit 1;; esac'
    file = stand_in(tmp_path, "apple cc", f'{refuses}\nexec {Compiler.find().command[0]} "$@"')
    monkeypatch.setenv("CC", f"'{file}'")
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "cache"))
    assert "-march=native" not in Compiler.find().flags("")
    x = np.array([0.4, -0.7])
    library = ctypes.CDLL(str(Compiler.find().library(CSource([chain(20)]).of_core("chain"))))
    assert called(library, symbol_of(chain(20)), x) == pytest.approx(reference(x, 20), rel=1e-12)
    monkeypatch.delenv("CC")
    assert "-march=native" in Compiler.find().flags("")


def test_messages_of_a_compiler_may_be_in_any_encoding(tmp_path, monkeypatch):
    file = stand_in(
        tmp_path, "cc", r'if [ "$1" = --version ]; then echo 1.0; else printf "Fehler \374ber" >&2; exit 1; fi'
    )
    monkeypatch.setenv("CC", str(file))
    with pytest.raises(CompileError, match=r"Fehler .ber"):
        Compiler.find().run(["-c", "a.c"])


def test_a_path_of_windows_is_one_word_of_a_command(monkeypatch):
    monkeypatch.setattr(compiler.os, "name", "nt")
    assert compiler.split(r'"C:\Program Files\mingw64\bin\gcc.exe" -m64') == [
        r"C:\Program Files\mingw64\bin\gcc.exe",
        "-m64",
    ]


@needs_compiler
def test_a_library_that_another_process_has_loaded_serves(tmp_path, monkeypatch):
    """Windows refuses to replace it; where it is none of this content, the error is reported."""
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path))
    entry = Compiler.find().library(CSource([chain(20)]).of_core("chain"))
    whole = entry.read_bytes()

    def refused(source, target):
        raise PermissionError(13, "in use", str(target))

    sound, known = cache._sound, [False, True]
    monkeypatch.setattr(cache.os, "replace", refused)
    monkeypatch.setattr(cache, "_sound", lambda *names: known.pop(0) and sound(*names))
    assert Compiler.find().library(CSource([chain(20)]).of_core("chain")) == entry
    assert entry.read_bytes() == whole
    known[:] = [False, False]
    with pytest.raises(PermissionError):
        Compiler.find().library(CSource([chain(20)]).of_core("chain"))


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


@pytest.mark.parametrize("number", ["1e39", "1e-39", "-4e+50"])
def test_constants_beyond_single_precision_are_refused(number):
    with pytest.raises(InputError, match=r"beyond single precision.*coarser accuracy"):
        single(f"a = {number};")


def test_models_compute_in_double_alone():
    model = cg.FingerModel(Finger(rod=ROD), family="arc", elements=2)
    with pytest.raises(InputError, match=r"precision: models compute in double precision; take export_c"):
        cg.compile(model, precision="float")
