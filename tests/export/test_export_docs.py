"""The commands of docs/c_packages.md, as they are written there; those of docs/embedded.md run as a guide."""

from __future__ import annotations

import re
import shutil
import sys

import pytest

from continuum_grasp.export import export_c
from tests.export_cases import ROOT, loop_scene, needs, run
from tests.mission_cases import carried

PAGE = (ROOT / "docs/c_packages.md").read_text()


@pytest.fixture(scope="module")
def after_all_commands(tmp_path_factory):
    """A copy of the configurations in which every command was run, and what they said."""
    place = tmp_path_factory.mktemp("reader")
    for folder in ("configs/simulate", "configs/fingers"):
        shutil.copytree(ROOT / folder, place / folder)
    said = {}
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL):
        for command in block.strip().splitlines():
            line = command.replace("continuum-grasp", f"{sys.executable} -m continuum_grasp")
            said[f"{len(said)} {command.split(' --')[0]}"] = run(
                "env", f"PYTHONPATH={ROOT}", "sh", "-c", line, cwd=place
            )
    return place, said


def functions_in(package):
    """What a program can call, by the header without its comments; not what stands behind a macro."""
    header = re.sub(r"/\*.*?\*/", "", (package / "include/finger.h").read_text(), flags=re.DOTALL)
    return {name for name in re.findall(r"\b(finger_\w+)\(", header) if not name.endswith(("_abi", "_built"))} | {
        "finger_abi"
    }


def table_in(package, heading):
    """First and other cells of the rows of a table of the README that has a heading."""
    rows = (package / "README.md").read_text().split(f"\n| {heading}", 1)[1].split("\n\n")[0].splitlines()[2:]
    return {
        cells[0].strip("`"): cells[1:] for cells in ([c.strip() for c in row.strip("|").split("|")] for row in rows)
    }


@pytest.mark.parametrize("name", ["arcs", "observed", pytest.param("mission", marks=pytest.mark.deep)])
def test_the_page_of_a_package_has_every_function(name, packages, tmp_path):
    if name == "mission":
        export_c(carried("mug"), package := tmp_path)
    else:
        package = packages(name, "double")
    functions = table_in(package, "function |")
    assert set(functions) == functions_in(package)
    assert all(text and "/*" not in text for text, _ in functions.values())
    codes = re.findall(r"FINGER_((?:WARN|ERR)_\w+|OK) += +(-?\d+)", (package / "include/finger.h").read_text())
    assert {(row[0], code) for code, row in table_in(package, "code |").items()} == {*codes}
    assert all(advice for *_, advice in table_in(package, "code |").values())
    if name == "mission":
        numbers = {int(k) for row in table_in(package, "number |") for k in row.split(",")}
        phases = re.findall(r"FINGER_PHASE_\w+ = (\d+)", (package / "include/finger.h").read_text())
        assert numbers == {int(k) for k in phases}
        assert "examples/mission_loop.c" in (package / "README.md").read_text()
    if name != "arcs":
        health = re.findall(r"FINGER_HEALTH_(\w+) = (\d+)", (package / "include/finger.h").read_text())
        assert set(table_in(package, "`health`")) == {f"{number} {state}" for state, number in health}
        sizes = re.findall(r"FINGER_(\w+)_BYTES (\d+)", (package / "include/finger.h").read_text())
        memory = {row.removeprefix("finger_").upper(): cells[0] for row, cells in table_in(package, "memory |").items()}
        assert memory == dict(sizes)


def test_an_export_says_how_far_it_is(tmp_path):
    said = []
    export_c(loop_scene(8), tmp_path, progress=lambda share, text: said.append((share, text)))
    shares, texts = zip(*said, strict=True)
    assert shares == tuple(sorted(shares))
    assert (shares[0], texts[0], texts[-1]) == (0.0, "writing the code", "writing the files")
    assert "computing test vectors of mpc" in texts


@pytest.mark.deep
@needs("cmake", "make", "arm-none-eabi-gcc", "qemu-system-arm")
def test_every_command_runs(after_all_commands):
    place, said = after_all_commands
    assert (place / "build/finger/m4f/libfinger.a").exists()
    board = next(text for command, text in said.items() if "finger/examples/baremetal" in command)
    assert "0 failures" in board
    assert len(re.findall(r"^\w+( \d+){4}$", board, re.MULTILINE)) >= 5


@pytest.mark.deep
@needs("cmake", "make", "arm-none-eabi-gcc", "qemu-system-arm")
@pytest.mark.parametrize(
    ("k", "name", "main"),
    [
        (0, "finger", "control_start(); return control_tick(3.0f, 1.0f) < 0;"),
        (
            1,
            "touch",
            "finger_model m; finger_state s = {0}; finger_input u = {0}; finger_init(&m); "
            "return !(tip_force(&m, &s, &u, 0.18, 0.04) > 0) || tip_force(&m, &s, &u, 0.4, 0.4) != 0;",
        ),
    ],
)
def test_its_c_compiles_and_runs(k, name, main, after_all_commands, tmp_path):
    place, _ = after_all_commands
    code = re.findall(r"```c\n(.*?)```", PAGE, re.DOTALL)[k]
    (tmp_path / "main.c").write_text(f"void control_start(void);\n{code}\nint main(void) {{ {main} }}\n")
    package = place / "build" / name
    flags = ("-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{package / 'include'}")
    run("cc", *flags, tmp_path / "main.c", *(package / "src").glob("*.c"), "-o", tmp_path / "main")
    run(tmp_path / "main")
