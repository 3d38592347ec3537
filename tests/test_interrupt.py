"""Ctrl-C at chosen moments: in type checks of CasADi, in imports, at the end of files, in solvers, in every command."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from typing import Any

import pytest

from continuum_grasp.results import read_run
from tests.commands import ROOT, environment, said

RELEASE = ROOT / "configs/simulate/nitinol_release_020g.yaml"
pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")

READY = """
    import os, signal, sys
    signal.signal(signal.SIGINT, signal.default_int_handler)
    from continuum_grasp.base import interrupt

    def press(*_):
        os.kill(os.getpid(), signal.SIGINT)
"""


def begun(code: str, *arguments: object, **options: Any) -> subprocess.Popen[str]:
    """Code at work in a new interpreter in which Ctrl-C is alive."""
    command = [sys.executable, "-c", textwrap.dedent(READY) + textwrap.dedent(code), *map(str, arguments)]
    options |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=environment(), **options)


def python(code: str, *arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run such code to its end."""
    with begun(code, *arguments, **options) as process:
        try:
            said = process.communicate(timeout=120)
        finally:
            process.kill()  # one that has ended is not concerned
    return subprocess.CompletedProcess(process.args, process.returncode, *said)


TYPE_CHECK = """
    import casadi
    class Number:
        def __SX__(self):
            press()
            return casadi.SX(1)
    def work():
        for k in range(3):
            casadi.plus(casadi.SX.sym("x"), Number())
            print("went on")
"""


def test_in_a_type_check_of_casadi_it_is_raised_and_not_lost():
    lost = python(TYPE_CHECK + "    work()")
    assert lost.stdout.count("went on") == 3  # what this is about: Python's own handler, and CasADi drops it
    code = """
    with interrupt.listening_for_interrupts():
        try:
            work()
        except KeyboardInterrupt:
            print("raised")
    """
    assert python(TYPE_CHECK + code).stdout.split() == ["raised"]


def test_an_import_is_finished_first(tmp_path):
    (tmp_path / "half.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nwhole = True\n")
    code = """
        sys.path.insert(0, sys.argv[1])
        with interrupt.listening_for_interrupts():
            try:
                import half
                print("went on")
            except KeyboardInterrupt:
                print("raised", sys.modules["half"].whole)
    """
    assert python(code, tmp_path).stdout.split() == ["raised", "True"]


@pytest.mark.parametrize("name", ["fsync", "replace"])
def test_a_file_that_is_complete_gets_its_name_first(tmp_path, name):
    code = """
        from continuum_grasp.results.atomic import replacing
        real = getattr(os, sys.argv[2])
        def pressing(*arguments):
            press()
            return real(*arguments)
        setattr(os, sys.argv[2], pressing)
        with interrupt.listening_for_interrupts():
            try:
                with replacing(sys.argv[1]) as temporary:
                    temporary.write_text("whole")
                print("went on")
            except KeyboardInterrupt:
                print("raised")
    """
    assert python(code, tmp_path / "a.txt", name).stdout.split() == ["raised"]
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.txt", "whole")]


def test_a_file_that_is_not_complete_is_not_there(tmp_path):
    code = """
        from continuum_grasp.results.atomic import replacing
        with interrupt.listening_for_interrupts():
            try:
                with replacing(sys.argv[1]) as temporary:
                    temporary.write_text("half")
                    press()
            except KeyboardInterrupt:
                print("raised")
    """
    assert python(code, tmp_path / "a.txt").stdout.split() == ["raised"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("listening", [True, False])
def test_held_until_the_end_of_a_block(listening):
    code = """
        from contextlib import nullcontext
        with interrupt.listening_for_interrupts() if sys.argv[1] == "True" else nullcontext():
            with interrupt.interrupts_held(quietly=True) as pressed:
                press()
                print(pressed())
            print(pressed(), interrupt.interrupt_pressed())
            try:
                with interrupt.interrupts_held():
                    press()
                    print("within")
                print("went on")
            except KeyboardInterrupt:
                print("raised", interrupt.interrupt_pressed())
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    """
    done = python(code, listening)
    assert done.stdout.split() == ["True", "True", "False", "within", "raised", "False"], done.stderr


def test_pressed_again_before_it_could_be_raised_ends_a_command_at_once():
    code = """
        import time
        with interrupt.listening_for_interrupts(command=True):
            with interrupt.interrupts_held():
                press(), press()
                print("one press", flush=True)
                time.sleep(0.6)
                press()
                print("went on", flush=True)
    """
    done = python(code)
    assert (done.returncode, done.stdout, done.stderr) == (130, "one press\n", "interrupted\n")


def test_processes_that_are_started_never_see_it():
    """A terminal sends Ctrl-C to the whole group, also to workers that have not begun."""
    code = """
        import subprocess
        child = "import time; print('here', flush=True); time.sleep(1.0); print('done')"
        with interrupt.listening_for_interrupts():
            with interrupt.interrupts_ignored_by_children():
                process = subprocess.Popen([sys.executable, "-c", child], stdout=subprocess.PIPE, text=True)
            process.stdout.readline()
            try:
                os.killpg(0, signal.SIGINT)
                process.wait()
            except KeyboardInterrupt:
                print("raised", process.communicate()[0], process.returncode)
    """
    assert python(code, start_new_session=True).stdout.split() == ["raised", "done", "0"]


COMMAND = """
    from importlib import import_module
    from continuum_grasp.__main__ import main

    def at(place, count):
        "Press with the call of a function, counted from 1."
        module, name = place.rsplit(".", 1)
        owner = import_module(module)
        real, calls = getattr(owner, name), [0]
        def pressing(*arguments, **named):
            calls[0] += 1
            if calls[0] == count:
                press()
            return real(*arguments, **named)
        setattr(owner, name, pressing)

    at(sys.argv[1], int(sys.argv[2]))
    del sys.argv[1:3]
    main()
"""
MOMENTS = {
    "arguments": ("typer.main.get_command", 1, ["schema", "finger"]),
    "scene": ("continuum_grasp.scene.yaml_loader.read_yaml", 1, ["validate", RELEASE]),
    "compiler": ("subprocess.run", 1, ["simulate", RELEASE]),
    "code": ("continuum_grasp.core.rollouts.rollout_source", 1, ["simulate", RELEASE]),
    "written": ("os.fsync", 2, ["export", RELEASE, "--to", "c", "--what", "kinematics"]),
    "package": (
        "continuum_grasp.export.package.write_package",
        1,
        ["export", RELEASE, "--to", "c", "--what", "kinematics"],
    ),
}


@pytest.mark.parametrize("moment", MOMENTS)
def test_every_command_ends_with_130(moment, tmp_path):
    place, count, arguments = MOMENTS[moment]
    out = [] if arguments[0] == "validate" or arguments[-1] == "finger" else ["--out", tmp_path / "run"]
    done = python(COMMAND, place, count, *arguments, *out, cwd=tmp_path)
    assert done.returncode == 130, done.stderr
    assert said(done.stderr) == "interrupted\n"
    assert not list(tmp_path.rglob(".tmp-*"))


@pytest.mark.parametrize(
    "place", ["continuum_grasp.results.animation.save_picture", "matplotlib.figure.Figure.savefig"]
)
def test_what_was_computed_is_saved_when_drawing_is_stopped(place, tmp_path):
    code = COMMAND.replace(
        "owner = import_module(module)",
        "owner = import_module(module) if module[-1] != 'e' else import_module(module[:-7]).Figure",
    )
    done = python(code, place, 1, "simulate", RELEASE, "--out", tmp_path / "run", "--set", "time.duration=0.05")
    assert (done.returncode, done.stdout) == (130, ""), done.stderr
    assert said(done.stderr) == f"interrupted; the result is saved in {tmp_path / 'run'}\n"
    assert read_run(tmp_path / "run").meta["status"] == "finished"
    assert not list(tmp_path.rglob(".tmp-*"))


def test_the_compiler_leaves_nothing_behind(tmp_path):
    """Ctrl-C while the C compiler runs."""
    compiler = tmp_path / "cc"
    compiler.write_text(
        '#!/bin/sh\ncase "$*" in *--version*) echo cc 1.0; exit;; esac\nkill -INT $PPID\nexec sleep 60\n'
    )
    compiler.chmod(0o755)
    code = """
        os.environ.update(CC=sys.argv.pop(1), CONTINUUM_GRASP_CACHE=sys.argv.pop(1))
        from continuum_grasp.__main__ import main
        main()
    """
    done = python(code, compiler, tmp_path / "cache", "simulate", RELEASE, "--out", tmp_path / "run")
    assert (done.returncode, said(done.stderr)) == (130, "interrupted\n")
    assert list((tmp_path / "cache" / "compiled").iterdir()) == []
    assert not (tmp_path / "run").exists()


def test_the_starter_lets_the_command_end(tmp_path):
    """``start.py`` outlives Ctrl-C, and gives the command's own status."""
    code = """
        import importlib.util, threading
        spec = importlib.util.spec_from_file_location("start", sys.argv[1])
        start = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(start)
        child = "import time\\ntry: print('here', flush=True), time.sleep(60)\\n"
        child += "except KeyboardInterrupt: time.sleep(0.5), print('saved'), exit(7)"
        read, write = os.pipe()
        os.dup2(write, 1)
        threading.Thread(target=lambda: (os.read(read, 99), press()), daemon=True).start()
        status = start.run([sys.executable, "-c", child])
        print(status, b"saved" in os.read(read, 99), file=sys.stderr)
    """
    assert python(code, ROOT / "start.py").stderr == "7 True\n"
