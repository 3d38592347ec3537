"""Ctrl-C during the search, in processes of their own."""

from __future__ import annotations

import signal
from textwrap import dedent

import pytest
from grasp_scenes import CONFIGS

from tests import test_interrupt as interrupted

PRESS = """
    from continuum_grasp.nlp import solver

    def press(run, iteration):
        "Ctrl-C inside the solver, at an iteration of a run (both from 1)."
        count, whole = [0, 0], solver.Solver.solve

        class Pressing(solver._Stop):
            def eval_buffer(self, *arguments):
                count[1] += 1
                if count == [run, iteration]:
                    os.kill(os.getpid(), signal.SIGINT)
                return super().eval_buffer(*arguments)

        def counted(self, *arguments, **options):
            count[:] = count[0] + 1, 0
            return whole(self, *arguments, **options)

        solver.Solver.solve = counted
        solver._Stop = Pressing
"""


def python(code, *arguments):
    return interrupted.python(dedent(PRESS) + dedent(code), *arguments)


CLI = """
    press(run={run}, iteration=3)
    from continuum_grasp.cli import main
    sys.argv = ["continuum-grasp", "grasp", *sys.argv[1:]]
    main()
"""


def test_before_any_grasp_the_command_says_so_and_exits_with_130(tmp_path):
    folder = tmp_path / "run"
    done = python(CLI.format(run=1), CONFIGS / "mug.yaml", "--out", folder)
    assert done.returncode == 130, done.stderr
    assert "interrupted before a grasp was found" in done.stderr
    assert "infeasible" not in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert not folder.exists()


@pytest.mark.deep
def test_after_a_grasp_that_is_the_result(tmp_path):
    thorough = ("--set", "solver.effort=thorough")
    done = python(CLI.format(run=2), CONFIGS / "mug.yaml", *thorough, "--out", tmp_path / "run")
    assert done.returncode == 130, done.stderr
    assert "interrupted" in done.stdout.splitlines()[0]
    assert done.stdout.startswith("feasible")
    assert "all checks passed" in done.stdout
    assert "warning: the search was interrupted" in done.stderr


def test_an_interrupted_start_does_not_count():
    code = """
        press(run=2, iteration=2)
        from continuum_grasp.grasp import optimize_grasp
        from continuum_grasp.scene.reading import load
        result = optimize_grasp(load(sys.argv[1], ["solver.effort=thorough"]))
        print(result.status.value, len(result.statistics["attempts"]), result.statistics["interrupted"])
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    """
    done = python(code, CONFIGS / "mug.yaml")
    assert done.stdout.split() == ["feasible", "1", "True"], done.stderr


def test_an_interrupted_diagnosis_is_no_verdict():
    """The tendon is too weak, and one start ends; Ctrl-C while the solver looks for the reason."""
    code = """
        press(run=5, iteration=2)
        from continuum_grasp.base import Interrupted
        from continuum_grasp.grasp import optimize_grasp
        from continuum_grasp.scene.reading import load
        scene = load(sys.argv[1], ["finger.tendons.max_tension=20"])
        try:
            optimize_grasp(scene, raise_on_failure=False)
        except Interrupted as error:
            print(error)
    """
    done = python(code, CONFIGS / "mug_arcs.yaml")
    assert "interrupted before a grasp was found" in done.stdout, done.stderr


def test_ctrl_c_from_outside():
    """The signal comes from another process while the second start is tried."""
    code = """
        import time
        from continuum_grasp.grasp import optimize_grasp
        from continuum_grasp.scene.reading import load
        run = solver.Solver.solve
        def reported(self, *arguments, **options):
            print("start", flush=True)
            time.sleep(0.3)
            return run(self, *arguments, **options)
        solver.Solver.solve = reported
        result = optimize_grasp(load(sys.argv[1], []))
        print(result.status.value, result.statistics["interrupted"])
    """
    with interrupted.begun(dedent(PRESS) + dedent(code), CONFIGS / "mug.yaml") as process:
        for _ in range(2):
            assert process.stdout.readline() == "start\n"
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate()
    assert process.returncode == 0, errors
    assert rest.splitlines()[-1] == "feasible True"
