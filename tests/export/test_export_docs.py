"""The commands of docs/c_packages.md, as they are written there; those of docs/embedded.md run as a guide."""

from __future__ import annotations

import re
import shutil
import sys

import pytest

from tests.export_cases import ROOT, needs, run

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
