"""The package as others use it: CMake and pkg-config projects, examples, a GPU compiler."""

from __future__ import annotations

import math
import re
import shlex
import shutil
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from continuum_grasp.cli import app
from continuum_grasp.control import Controller
from continuum_grasp.core import Core, CReal
from continuum_grasp.model import FingerModel
from tests.export_cases import ROOT, STRICT, TENDONS, WARNINGS, needs, run, scene

PROJECT = ROOT / "examples/c_project"


@pytest.fixture(scope="module")
def installed(packages, tmp_path_factory):
    """Where a package was installed, its tests run."""
    build, place = tmp_path_factory.mktemp("build"), tmp_path_factory.mktemp("installed")
    run("cmake", "-S", packages("tendons", "double"), "-B", build, f"-DCMAKE_INSTALL_PREFIX={place}")
    run("cmake", "--build", build)
    said = run("ctest", "--test-dir", build)
    assert re.search("100% tests passed.* out of 3", said)  # newer versions of ctest say less
    run("cmake", "--install", build)
    return place


def rows_of(text: str):
    head, *lines = text.strip().splitlines()
    return head, np.array([[float(v) for v in line.split(",")] for line in lines])


@pytest.mark.deep
@needs("cmake", "make", "cc", "pkg-config")
def test_pkg_config_finds_it(installed, tmp_path):
    pc = next(installed.rglob("finger.pc"))
    line = ["env", f"PKG_CONFIG_PATH={pc.parent}", "pkg-config", "--cflags", "--libs", "finger"]
    flags = run(*line).split()
    (tmp_path / "main.c").write_text('#include "finger.h"\nint main(void) { return finger_abi() != FINGER_ABI; }\n')
    run("cc", *STRICT, tmp_path / "main.c", *flags, "-o", tmp_path / "main")
    run(tmp_path / "main")


@needs("cmake", "make", "cc")
def test_as_a_folder_of_another_project(packages, tmp_path):
    """Then the package's own tests are left to itself."""
    (tmp_path / "main.c").write_text('#include "finger.h"\nint main(void) { return finger_abi() != FINGER_ABI; }\n')
    (tmp_path / "CMakeLists.txt").write_text(f"""\
cmake_minimum_required(VERSION 3.15)
project(whole C)
add_subdirectory({packages("tendons", "float")} finger)
add_executable(whole main.c)
target_link_libraries(whole finger::finger)
""")
    run("cmake", "-S", tmp_path, "-B", tmp_path / "build")
    run("cmake", "--build", tmp_path / "build")
    run(tmp_path / "build/whole")
    assert not list(tmp_path.rglob("finger_test_vectors*"))


@pytest.mark.deep
@needs("cmake", "make", "cc")
def test_options_by_cmake(packages, tmp_path):
    run("cmake", "-S", packages("contact", "float"), "-B", tmp_path, "-DFINGER_FAST=ON", "-DBUILD_SHARED_LIBS=ON")
    run("cmake", "--build", tmp_path)
    assert "100% tests passed" in run("ctest", "--test-dir", tmp_path)


@needs("cmake", "make", "cc")
def test_what_is_gone_says_what_does_it_now(packages, tmp_path):
    line = ("cmake", "-S", packages("tendons", "double"), "-B", tmp_path, "-DFINGER_BATCH=ON")
    assert "call finger_step for each" in " ".join(run(*line, expect=1).split())


@needs("cc")
@pytest.mark.parametrize(("name", "real"), [("tendons", "double"), ("contact", "double"), ("contact", "float")])
def test_the_loop_moves_as_the_core_does(name, real, packages, tmp_path):
    package = packages(name, real)
    sources = [*(package / "src").glob("*.c"), package / "examples/loop.c"]
    run("cc", *STRICT, *WARNINGS, "-O1", f"-I{package / 'include'}", *sources, "-o", tmp_path / "loop")
    head, rows = rows_of(run(tmp_path / "loop"))
    model = FingerModel(scene(name))
    assert head.count(",") == model.nx + 1
    text = (package / "examples/loop.c").read_text()
    h, level = rows[1, 0], float(re.search(r"input\.\w+ = ([\d.e-]+)", text)[1])
    assert ("* (t < " in text) != model.structure.moment_is_constant  # where it may not change, it does not
    core, x = Core(model, compiled=False), np.zeros(model.nx)
    for row in rows[:100]:
        assert row[1:-1] == pytest.approx(x, rel=2e-3 if real == "float" else 1e-6, abs=1e-6)
        u = np.zeros(model.nu)
        u[0] = level * (1.0 if model.structure.moment_is_constant else min(row[0] / 0.1, 1.0))
        x = core.rollout(x, 1, h, u=u)[-1]


@pytest.mark.deep
@needs("cc")
def test_the_control_loop_commands_as_python_does(packages, tmp_path):
    """Line by line, some of which lack a number; the setpoints are those of the beginning."""
    package = packages("observed", "float")
    control = Controller(scene("observed"), precision="float", deadline=math.inf)
    sources = [*(package / "src").glob("*.c"), package / "examples/control_loop.c"]
    run("cc", *STRICT, *WARNINGS, "-O1", f"-I{package / 'include'}", *sources, "-o", tmp_path / "loop")
    measured = [-0.02, 0.177, 1.0, 1.0] + 1e-3 * np.random.default_rng(0).standard_normal((30, 4))
    measured[7, 1] = measured[12, :] = np.nan
    lines = "\n".join(",".join("" if math.isnan(v) else f"{v:.9g}" for v in row) for row in measured)
    (tmp_path / "measured.csv").write_text(lines + "\n")
    head, rows = rows_of(run("sh", "-c", f"{tmp_path / 'loop'} < {tmp_path / 'measured.csv'}"))
    assert head == "time [s],tension_1 [N],tension_2 [N],code,anomalies"
    assert rows[:, 0] == pytest.approx(0.01 * np.arange(30))
    assert rows[:, 1:3].max() > 1.5
    wanted = np.zeros(control.stages.nr)
    wanted[2:] = 1.0
    for row, y in zip(rows, measured, strict=True):
        command = control.step(y, np.tile(wanted, (control.stages.stages + 1, 1)))
        assert row[1:3] == pytest.approx(command.u, abs=2e-3)
        assert int(row[4]) == int(command.anomaly)


@needs("nvcc")
@pytest.mark.parametrize("real", CReal.KINDS)
def test_the_source_is_cuda_too(real, packages, tmp_path):
    package = packages("contact", real)
    options = ("-O1", "--fmad=false", "-Werror", "all-warnings", "-ptx", f"-I{package / 'include'}")
    run("nvcc", *options, package / "examples/cuda/batch.cu", "-o", tmp_path / "batch.ptx")
    text = (tmp_path / "batch.ptx").read_text()
    assert "step_many" in text
    assert ".f64" in text if real == "double" else "fma.rn.f64" not in text


def test_the_command_line(tmp_path):
    line = f"export {TENDONS} --to c --out {tmp_path / 'out'} --real float --what step --prefix arm --target cortex-m4f"
    result = CliRunner().invoke(
        app, [*shlex.split(line), "--set", "parameters=[tip_mass]", "--range", "tip_mass=0:0.01"]
    )
    assert result.exit_code == 0, result.output
    assert "start with README.md" in result.output
    assert "0 to 0.01" in (tmp_path / "out/include/arm.h").read_text()
    bad = CliRunner().invoke(
        app, ["export", str(TENDONS), "--to", "c", "--out", str(tmp_path / "two"), "--range", "tip_mass=1"]
    )
    assert bad.exit_code == 2
    assert not (tmp_path / "two").exists()


@pytest.mark.deep
@needs("sh", "cmake", "make")
def test_the_example_closes_the_loop_by_the_commands_of_its_readme(tmp_path):
    """In a copy of the folders that they name: the tip is where it is to be, whatever the controller does not know."""
    commands = re.findall(r"^    (.+)$", (PROJECT / "README.md").read_text(), re.MULTILINE)
    for folder in ("configs/fingers", "examples/c_project"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    for command in commands:
        line = command.replace("continuum-grasp", f"{sys.executable} -m continuum_grasp")
        line = re.sub("^python ", f"{sys.executable} ", line)
        run("env", f"PYTHONPATH={ROOT}", "sh", "-c", line, cwd=tmp_path)
    assert (tmp_path / "build/reach.png").stat().st_size > 10_000
    head, rows = rows_of((tmp_path / "build/reach.csv").read_text())
    assert head.startswith("time [s],tip x [m],tip y [m],target x [m]")
    for settled in (rows[70:90], rows[150:180], rows[260:]):
        assert np.abs(settled[:, 1:3] - settled[:, 3:5]).max() < 1e-3
    assert 1.0 <= rows[:, 5:7].min() <= rows[:, 5:7].max() <= 60.0
    assert np.abs(np.diff(rows[:, 5:7], axis=0)).max() <= 600.0 * 0.01 + 1e-9
    assert set(rows[40:45, 8]) == {1.0}
    assert rows[-1, 9] == 0


@needs("cmake", "make", "x86_64-w64-mingw32-gcc")
@pytest.mark.parametrize(
    ("name", "real"), [("tendons", "double"), pytest.param("observed", "float", marks=pytest.mark.deep)]
)
def test_a_library_of_windows_is_built(name, real, packages, tmp_path):
    """Library, tests and example; without a warning, as everywhere."""
    system = ("-DCMAKE_SYSTEM_NAME=Windows", "-DCMAKE_C_COMPILER=x86_64-w64-mingw32-gcc", "-DBUILD_SHARED_LIBS=ON")
    run("cmake", "-S", packages(name, real), "-B", tmp_path, *system, "-DCMAKE_C_FLAGS=-Wall -Werror")
    run("cmake", "--build", tmp_path)
    assert {"libfinger.dll", "finger_test_vectors.exe"} <= {file.name for file in tmp_path.iterdir()}


@needs("clang")
@pytest.mark.parametrize(
    ("name", "real"), [("tendons", "double"), pytest.param("observed", "float", marks=pytest.mark.deep)]
)
def test_the_library_is_c_of_microsofts_compiler(name, real, packages, tmp_path):
    """By clang in its place, which takes the same options and the same C; the flags are those of the package's CMake.

    Its sources include headers of the language alone, which clang and this machine have.
    """
    package = packages(name, real)
    text = (package / "CMakeLists.txt").read_text(encoding="utf-8")
    flags = re.findall(r"/fp:\w+", text.partition("if(MSVC)")[2])
    assert flags == ["/fp:fast", "/fp:precise"]
    (tmp_path / "math.h").write_text("double sqrt(double);\nfloat sqrtf(float);\n")
    (tmp_path / "string.h").write_text(
        "#include <stddef.h>\nvoid *memcpy(void *, const void *, size_t);\nvoid *memset(void *, int, size_t);\n"
        "void *memmove(void *, const void *, size_t);\nint memcmp(const void *, const void *, size_t);\n"
    )
    for flag in flags:
        for source in (package / "src").glob("*.c"):
            line = ["clang", "--driver-mode=cl", "--target=x86_64-pc-windows-msvc", "/c", "/O2", flag, "/W3", "/WX"]
            run(*line, "-imsvc", tmp_path, f"/I{package / 'include'}", source, f"/Fo{tmp_path / 'unit.obj'}")
