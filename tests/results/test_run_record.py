"""A folder holds one run: what an earlier one wrote goes, what anybody else wrote stays; and full disks meanwhile."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.core import Compiler
from continuum_grasp.results import File, Result, begin_run, check_folder, read_run, replacing, write_run
from tests.commands import ROOT, environment, python, run, said
from tests.marks import but

RELEASE = ROOT / "configs/simulate/nitinol_release_020g.yaml"
SHORT = ("--set", "time.duration=0.02", "--set", "time.step=0.01")


def draw(folder: Path, name: str, text: str = "drawn") -> None:
    with replacing(folder / name) as temporary:
        temporary.write_text(text)


def names(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def save(folder: Path, value: float, kind: str | None = None) -> Path:
    return write_run(folder, {"a": np.full(3, value)}, {"kind": kind})


def kind(folder: Path) -> str:
    return json.loads((folder / ".run.json").read_text())["kind"]


RUN = [".run.json", "meta.json", "result.npz"]


def test_a_new_run_removes_what_the_old_one_wrote_and_nothing_else(tmp_path):
    (tmp_path / "notes.txt").write_text("of the user")
    save(tmp_path, 1.0)
    for name in ("picture.png", "report.html", "edited.png", "replaced.png"):
        draw(tmp_path, name)
    (tmp_path / "edited.png").write_text("drawn, and changed by the user")
    (tmp_path / "replaced.png").unlink()
    (tmp_path / "replaced.png").symlink_to(tmp_path / "notes.txt")
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "picture.png").write_text("drawn")
    save(tmp_path, 2.0)
    left = ["edited.png", "notes.txt", "own/picture.png", "replaced.png"]
    assert names(tmp_path) == sorted([*RUN, *left])
    assert read_run(tmp_path).arrays["a"][0] == 2.0


@pytest.mark.parametrize("name", ["result.npz", "meta.json", "picture.png"])
@pytest.mark.parametrize("before", [False, True])
def test_a_run_never_replaces_what_no_run_wrote(tmp_path, name, before):
    """Whether the folder has a run already or not; nothing else of that run changes."""
    if before:
        draw(save(tmp_path, 1.0), "picture.png")
    (tmp_path / name).write_text("of the user")
    old = {path.name: path.read_bytes() for path in tmp_path.iterdir() if name != "picture.png"}
    with pytest.raises(InputError, match="no run wrote this file, or it has changed since: move it away") as caught:
        draw(save(tmp_path, 2.0), "picture.png")
    assert caught.value.file == str(tmp_path / name)
    assert (tmp_path / name).read_text() == "of the user"
    assert {name: (tmp_path / name).read_bytes() for name in old} == old
    (tmp_path / name).rename(tmp_path / "moved")
    draw(save(tmp_path, 3.0), "picture.png")
    assert read_run(tmp_path).arrays["a"][0] == 3.0


def test_a_run_replaces_itself_and_runs_whose_record_is_lost(tmp_path):
    for value in (1.0, 2.0):
        draw(save(tmp_path, value), "picture.png")
        draw(tmp_path, "picture.png", "drawn again")
    for name in (".run.json", "picture.png"):
        (tmp_path / name).unlink()
    assert read_run(save(tmp_path, 3.0)).arrays["a"][0] == 3.0


def test_a_link_of_the_user_is_no_file_of_a_run(tmp_path):
    (tmp_path / "data.npz").write_bytes((save(tmp_path / "other", 1.0) / "result.npz").read_bytes())
    save(tmp_path, 1.0)
    (tmp_path / "result.npz").unlink()
    (tmp_path / "result.npz").symlink_to(tmp_path / "data.npz")
    with pytest.raises(InputError, match=r"result.npz: no run wrote this file"):
        save(tmp_path, 2.0)


def test_texts_of_a_result_are_checked_before_anything_is_written(tmp_path):
    (tmp_path / "report.txt").write_text("of the user")

    @dataclass(frozen=True)
    class Small(Result):
        kind = "small"
        texts = (File("report.txt", "json:dumps"),)
        scene: None = None
        status: str = "finished"
        warnings: tuple = ()
        statistics: dict = field(default_factory=dict)

    with pytest.raises(InputError, match=r"report\.txt: no run wrote this file"):
        Small().save(tmp_path)
    assert names(tmp_path) == ["report.txt"]
    with pytest.raises(InputError, match=r"report\.txt: no run wrote this file"):
        check_folder(tmp_path, "small")
    check_folder(tmp_path, "another")


TAKEN = {
    "result.npz": ("simulate", RELEASE, *SHORT),
    "snapshots.svg": ("simulate", RELEASE, *SHORT),
    "result.yaml": ("grasp", ROOT / "configs/grasp/mug.yaml"),
    "report.html": ("grasp", ROOT / "configs/hand/ball.yaml"),
    "log.csv": ("mpc", ROOT / "configs/mpc/steady_tip.yaml"),
    "report.txt": ("replay", ROOT / "configs/mpc/steady_tip.yaml", "missing.csv"),
    "identified_finger.yaml": ("identify", ROOT / "configs/identify/own_finger.yaml"),
    "series.pdf": ("compare", ROOT / "configs/identify/own_finger.yaml"),
    "accuracy.md": ("accuracy", RELEASE),
    "meta.json": ("plan", ROOT / "configs/plan/past_a_post.yaml"),
    "table.csv": ("sweep", ROOT / "configs/sweep/mug_size_friction.yaml"),
    "finger.json": ("schema",),
}


@pytest.mark.parametrize("name", but(["finger.json", "report.txt"], TAKEN))
def test_verbs_refuse_a_folder_with_such_a_file_before_any_work(tmp_path, name):
    (tmp_path / name).write_text("of the user")
    verb, *arguments = map(str, TAKEN[name])
    ended = CliRunner().invoke(app, [verb, *arguments, "--out", str(tmp_path)])
    assert ended.exit_code == 2
    assert f"{name}: no " in ended.output
    assert "wrote this file" in ended.output
    assert names(tmp_path) == [name]


def test_modes_refuse_a_folder_before_they_are_found(tmp_path):
    """In a process of its own: names of files are those of the classes that it has loaded."""
    (tmp_path / "modes.png").write_text("of the user")
    ended = python("-m", "continuum_grasp", "modes", ROOT / "configs/simulate/hanging.yaml", "--out", tmp_path)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "modes.png: no run wrote this file" in ended.stderr


def test_a_run_of_another_kind_leaves_nothing_behind(tmp_path):
    """A mission with its grasp, then a table."""
    save(tmp_path, 1.0, "mpc")
    record = json.loads((tmp_path / ".run.json").read_text())
    (tmp_path / ".run.json").write_text(json.dumps({**record, "parts": ["grasp"]}))
    save(tmp_path / "grasp", 1.0, "grasp")
    draw(tmp_path / "grasp", "grasp.png")
    assert (kind(tmp_path), kind(tmp_path / "grasp")) == ("mpc", "grasp")
    draw(begin_run(tmp_path, "accuracy"), "accuracy.md")
    assert names(tmp_path) == [".run.json", "accuracy.md"]
    assert not (tmp_path / "grasp").exists()
    assert kind(tmp_path) == "accuracy"


@pytest.mark.parametrize("record", ["", "[]", "{", '{"files": {"a": ["x"]}}', '{"kind": 1, "files": 3, "parts": 0}'])
def test_a_damaged_record_removes_nothing(tmp_path, record):
    (tmp_path / "a.txt").write_text("of the user")
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / ".run.json").write_text(record)
    (folder / "b.txt").write_text("of the user")
    save(folder, 1.0)
    assert names(tmp_path) == ["a.txt", "run/.run.json", "run/b.txt", "run/meta.json", "run/result.npz"]


@pytest.mark.skipif(os.name != "posix", reason="processes")
def test_what_killed_processes_left_is_removed(tmp_path):
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    dead, alive = (f".tmp-{pid}-0123456789ab-a.png" for pid in (ended.pid, os.getpid()))
    for name in (dead, alive, ".tmp-mine"):
        (tmp_path / name).touch()
    save(tmp_path, 1.0)
    assert names(tmp_path) == [".run.json", *sorted((alive, ".tmp-mine")), "meta.json", "result.npz"]


def test_without_pictures_none_of_an_earlier_run_stay(tmp_path):
    assert run("modes", RELEASE, "--out", tmp_path).exit_code == 0
    assert names(tmp_path) == [*RUN[:2], "modes.png", RUN[2]]
    draw(tmp_path, "report.html")
    assert run("modes", RELEASE, "--out", tmp_path).exit_code == 0
    assert "report.html" not in names(tmp_path)


COMMANDS = {
    "simulate": ("simulate", RELEASE, *SHORT),
    "modes": ("modes", RELEASE),
    "accuracy": ("accuracy", RELEASE),
    "grasp": ("grasp", ROOT / "configs/grasp/mug.yaml"),
    "plan": ("plan", ROOT / "configs/plan/tip_to_point.yaml"),
    "mpc": ("mpc", ROOT / "configs/mpc/pulse.yaml"),
    "sweep": ("sweep", ROOT / "configs/sweep/finger_design.yaml"),
    "identify": ("identify", ROOT / "configs/identify/belendez_strip.yaml", "--data", "x.csv"),
    "export": ("export", RELEASE, "--to", "c"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_of_another_command_is_refused_before_anything_is_computed(command, tmp_path):
    save(tmp_path, 1.0, "other")
    result = run(*COMMANDS[command], "--out", tmp_path)
    assert result.exit_code == 2
    assert result.stderr == (
        f"error: {tmp_path}: the folder holds results of other; choose another one, or remove it\n"
    )
    assert names(tmp_path) == RUN


# what cannot be read or written
def test_the_second_of_two_runs_in_a_folder_is_refused_while_the_first_is_alive(tmp_path):
    code = "import sys; from pathlib import Path; from continuum_grasp.results import hold_folder\n"
    code += "hold_folder(Path(sys.argv[1])); print('held', flush=True); input()"
    line, pipe = [sys.executable, "-c", code, str(tmp_path / "run")], subprocess.PIPE
    with subprocess.Popen(line, env=environment(), text=True, stdin=pipe, stdout=pipe) as other:
        assert other.stdout.readline() == "held\n"
        second = run("modes", RELEASE, "--out", tmp_path / "run")
        assert second.exit_code == 2
        assert second.stderr.startswith(f"error: {tmp_path / 'run'}: another run is using this folder")
        assert not (tmp_path / "run").exists()
        other.kill()
    for _ in range(2):  # one after another, also within a process
        assert run("modes", RELEASE, "--out", tmp_path / "run").exit_code == 0


@pytest.mark.parametrize("command", COMMANDS)
def test_an_empty_name_is_no_folder(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*COMMANDS[command], "--out", "")
    assert result.exit_code == 2
    assert "expected a path, got an empty text" in result.stderr
    assert not list(tmp_path.iterdir())


def test_an_empty_name_is_no_folder_in_python_either(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="got an empty one"):
        write_run("", {}, {})
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes")
@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "PIPE"),
        ("simulate", RELEASE, "--out", "PIPE"),
        ("identify", ROOT / "configs/identify/belendez_strip.yaml", "--data", "PIPE"),
        ("schema", "--out", "PIPE"),
        ("plan", ROOT / "configs/plan/tip_to_point.yaml", "--warm", "PIPE"),
        ("sweep", ROOT / "configs/sweep/finger_design.yaml", "--plot-only", "--out", "HOLDS sweep.json"),
        ("export", RELEASE, "--to", "c", "--what", "kinematics", "--out", "HOLDS README.md"),
    ],
)
def test_a_pipe_is_refused_and_not_waited_for(arguments, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "holds").mkdir()
    for name in ("sweep.json", "README.md"):
        if arguments[-1] == f"HOLDS {name}":
            os.mkfifo(tmp_path / "holds" / name)
    places = {"PIPE": tmp_path / "pipe"}
    given = [tmp_path / "holds" if str(a).startswith("HOLDS") else places.get(a, a) for a in arguments]
    done = python("-m", "continuum_grasp", *given, timeout=60)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert str(tmp_path) in done.stderr


@pytest.mark.parametrize(
    ("command", "limit"),
    [("simulate", 0), ("modes", 600), ("export", 0), ("export", 20_000), ("schema", 80_000)],
)
def test_a_full_disk_is_one_line_and_leaves_whole_files(command, limit, tmp_path):
    """Files that cannot grow beyond a size stand for the disk; the cache is elsewhere, and full too."""
    arguments = COMMANDS.get(command, (command,))
    code = "import sys; from continuum_grasp.__main__ import main; import resource as r\n"
    code += "import casadi, numpy, matplotlib\n"
    code += f"r.setrlimit(r.RLIMIT_FSIZE, ({limit}, {limit})); main()"
    more = {"CC": "", "PYTHONDONTWRITEBYTECODE": "1"}
    done = python("-c", code, *arguments, "--out", tmp_path / "run", more=more, timeout=120)
    assert done.returncode == 2, done.stderr
    lines = [line for line in said(done.stderr).splitlines() if not line.startswith("warning: ")]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    expected = (os.strerror(errno.EFBIG), os.strerror(errno.ENOSPC))
    assert lines[0].endswith(expected) or "No usable temporary directory" in lines[0]
    assert not list(tmp_path.rglob(".tmp-*"))
    for file in tmp_path.rglob("*.json"):
        assert file.read_text().endswith("}\n")


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fail_from(monkeypatch, count, error=FULL):
    """Let the count-th writing to the disk fail, and every later one, as on a full disk, or where Ctrl-C is held."""
    left = [count]

    def failing(real):
        def write(*arguments, **named):
            left[0] -= 1
            if left[0] < 0:
                raise type(error)(*error.args)
            return real(*arguments, **named)

        return write

    for owner, name in ((os, "fsync"), (os, "replace"), (Path, "write_bytes"), (Path, "write_text"), (Path, "mkdir")):
        monkeypatch.setattr(owner, name, failing(getattr(owner, name)))


@pytest.mark.parametrize("error", [FULL, KeyboardInterrupt()], ids=["full", "interrupted"])
@pytest.mark.parametrize("old", [False, True])
def test_every_writing_may_fail(tmp_path, monkeypatch, old, error):
    for count in range(40):
        folder = tmp_path / str(count)
        if old:
            draw(save(folder, 1.0), "picture.png")
        with monkeypatch.context() as patch:
            fail_from(patch, count, error)
            raised = None
            try:
                save(folder, 2.0)
            except (OSError, KeyboardInterrupt) as caught:
                raised = caught
        if raised is None:
            break
        assert type(raised) is type(error)
        if error is FULL:
            assert raised.errno == errno.ENOSPC
            assert str(raised.filename).startswith(str(folder))
        if (folder / "result.npz").exists():
            found = read_run(folder)
            assert found.arrays["a"][0] in ((1.0, 2.0) if old else (2.0,))
            if found.arrays["a"][0] == 2.0:
                assert not (folder / "picture.png").exists()
        else:
            assert not old
        assert not list(folder.glob(".tmp-*"))
    assert 10 <= count < 39


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "arguments",
    [
        ("schema", "finger"),
        ("modes", RELEASE),
        ("modes", RELEASE, "--json"),
        ("--help",),
        ("modes", "--help"),
        ("--version",),
    ],
)
def test_standard_output_that_takes_no_more(arguments):
    command = [sys.executable, "-m", "continuum_grasp", *map(str, arguments)]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, env=environment(), stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    where = "" if "--help" in arguments or "--version" in arguments else "standard output: "
    assert (done.returncode, said(done.stderr)) == (2, f"error: {where}No space left on device\n")


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_cannot_be_written_is_refused_at_once(tmp_path):
    tmp_path.chmod(0o500)
    result = run("simulate", RELEASE, "--out", tmp_path / "run")
    assert (result.exit_code, result.stderr) == (2, f"error: {tmp_path}: this folder cannot be written\n")


@pytest.mark.skipif(os.name != "posix", reason="limits")
def test_a_full_disk_while_compiling_is_an_error_of_the_system(tmp_path, monkeypatch):
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "cache"))
    compiler = tmp_path / "cc"
    compiler.write_text(
        '#!/bin/sh\ncase "$*" in *--version*) echo cc 1.0; exit;; esac\n'
        "echo 'fatal error: error writing to /tmp/x.s: No space left on device' >&2; exit 1\n"
    )
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(OSError, match="No space left") as caught:
        Compiler.find().library("int x;")
    assert caught.value.errno == errno.ENOSPC
