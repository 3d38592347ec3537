"""What ``new`` prints is typed as it stands, by a shell, where it was printed; and so is what messages name."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys

import pytest

from continuum_grasp.base import COMMAND
from tests.commands import ROOT, environment, run

pytestmark = pytest.mark.skipif(os.name == "nt", reason="lines are typed into a POSIX shell")
NEW = ("new", "my finger", "--example", "fingers/hand_finger")


@pytest.fixture
def clone(tmp_path):
    """A clone, in a folder with a blank, whose .venv is this Python."""
    folder = tmp_path / "my work" / "clone"
    (folder / ".venv/bin").mkdir(parents=True)
    for name in ("start.py", "pyproject.toml"):
        shutil.copy(ROOT / name, folder / name)
    script(folder / ".venv/bin/python", f'#!/bin/sh\nexec {shlex.quote(sys.executable)} "$@"\n')
    state = hashlib.sha256((folder / "pyproject.toml").read_bytes()).hexdigest()
    (folder / ".venv/installed.json").write_text(json.dumps({"extras": [], "project": state, "root": str(folder)}))
    return folder


def script(file, text):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    file.chmod(0o755)
    return file


def typed(lines, cwd, **more):
    """What a shell prints, into which these lines are typed."""
    text = "set -e\n" + lines
    done = subprocess.run(["sh", "-c", text], cwd=cwd, env=environment(**more), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def advice(printed):
    return printed.partition("Run it:\n")[2]


@pytest.mark.parametrize(("cwd", "start"), [(".", "start.py"), ("..", "./clone/start.py")])
def test_what_new_prints_works_as_it_was_started(cwd, start, clone):
    script(clone.parent / "bin/python3", f'#!/bin/sh\nexec {shlex.quote(sys.executable)} "$@"\n')
    path = f"{clone.parent / 'bin'}{os.pathsep}{os.environ['PATH']}"
    lines = advice(typed(f"python3 {shlex.join([start, *NEW])}", clone / cwd, PATH=path))
    assert "start.py validate" in lines
    assert typed(lines, clone / cwd, PATH=path) == "configs/fingers/hand_finger.yaml: valid (finger)\n"


def test_messages_name_the_command_as_it_was_started(clone):
    def said(*arguments):
        done = subprocess.run(
            [sys.executable, "start.py", *arguments], cwd=clone, env=environment(), capture_output=True, text=True
        )
        assert done.returncode == 2
        return done.stderr

    assert said("grasp").endswith("CONFIG'; see " + shlex.join([sys.executable, "start.py", "grasp", "--help"]) + "\n")
    wrong = said("grasp", str(ROOT / "configs/mpc/tip_arc.yaml"))
    assert wrong.endswith(f"got a closed loop ({shlex.join([sys.executable, 'start.py', 'mpc'])})\n")


def test_start_installs_extras_that_there_are(clone):
    for names in ([], ["gymm"]):
        done = subprocess.run(
            [sys.executable, "start.py", "install", *names], cwd=clone, capture_output=True, text=True, check=False
        )
        assert done.returncode == 2
        assert "expected extras to install, of: cluster, compiler, data, dev, " in done.stderr


@pytest.mark.parametrize("on_path", [True, False])
def test_an_installed_command_is_named_where_a_shell_finds_it(on_path, tmp_path):
    code = f"#!{sys.executable}\nfrom continuum_grasp.__main__ import main\nmain()\n"
    program = script(tmp_path / "its bin" / COMMAND, code)
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}" if on_path else os.environ["PATH"]
    first = shlex.join([COMMAND if on_path else f"its bin/{COMMAND}", *NEW])
    lines = advice(typed(first, tmp_path, PATH=path))
    assert shlex.split(lines)[2:] == [
        COMMAND if on_path else str(program),
        "validate",
        "configs/fingers/hand_finger.yaml",
    ]
    assert typed(lines, tmp_path, PATH=path) == "configs/fingers/hand_finger.yaml: valid (finger)\n"


def test_a_module_is_named_as_it_was_run(tmp_path):
    lines = advice(typed(f"{shlex.quote(sys.executable)} -m continuum_grasp {shlex.join(NEW)}", tmp_path))
    assert typed(lines, tmp_path) == "configs/fingers/hand_finger.yaml: valid (finger)\n"


def test_notebooks_are_opened_by_what_is_installed_before(tmp_path, monkeypatch):
    """Unless jupyterlab is there, the line before installs the extra that has it; start.py does so by itself."""
    monkeypatch.setitem(sys.modules, "jupyterlab", None)
    printed = run("new", str(tmp_path / "a"), "--notebooks").output.splitlines()
    assert [shlex.split(line)[-2:] for line in printed[-2:]] == [
        ["install", "continuum-grasp[notebook]"],
        ["jupyterlab", "notebooks"],
    ]
    monkeypatch.setenv("CONTINUUM_GRASP_STARTED_BY", json.dumps(["python3", str(tmp_path / "start.py")]))
    printed = run("new", str(tmp_path / "b"), "--notebooks").output.splitlines()
    assert printed[-2:] == [f"  cd {tmp_path / 'b'}", "  python3 ../start.py jupyterlab notebooks"]
