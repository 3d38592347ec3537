"""Missions as C: a run of Python replayed, other machines, letting go, and several fingers that tell each other."""

from __future__ import annotations

import json
import math
import re
import sys
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.control.controller import Controller
from continuum_grasp.control.status import Anomaly
from continuum_grasp.errors import InputError
from continuum_grasp.export import export_c
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.mission.assignment import assign
from continuum_grasp.mission.plan import Plan
from continuum_grasp.mission.plant import Timetable
from continuum_grasp.mission.run import MissionRunner
from continuum_grasp.scene.load import load
from tests.export.test_export_targets import ELSEWHERE, MACHINES
from tests.export_cases import SANITIZE, STRICT, WARNINGS, compile_programs, needs, run, shared_library
from tests.rods import ROOT

pytestmark = pytest.mark.deep

CONFIGS = Path(__file__).parents[2] / "configs/mission"
SHORT = "{approach: 0.4, squeeze: 0.6, lift: 0.2, hold: 0.3, pull: 0.16, rest: 0.06, lower: 0.2, release: 0.5}"
QUICK = ("plant.fidelity={family: clothoid, elements: 3}", f"phases={SHORT}", "grasp.solver.effort=quick")


@pytest.fixture(scope="module")
def carried():
    """Runs of missions in Python, by name of the configuration."""

    @lru_cache
    def found(name):
        mission = load(CONFIGS / f"{name}.yaml", QUICK)
        return MissionRunner(assign(mission, optimize_grasp(mission.grasp))).run()

    return found


@pytest.fixture(scope="module")
def package(carried, tmp_path_factory):
    folder = tmp_path_factory.mktemp("mug")
    export_c(carried("mug"), folder)
    return folder


def phases_of(run, t):
    """Name of the phase in which each command was given."""
    starts, names = zip(*run.events, strict=True)
    return [names[k - 1] for k in np.searchsorted(starts, t + 1e-9)]


@needs("cc")
def test_a_mission_of_python_is_replayed(carried, package, tmp_path):
    """By what was measured: the same phases, setpoints to the bit, commands to the rounding of another compiler."""
    mission, (of,) = carried("mug"), carried("mug").assignments
    done, period = mission.runs[0], mission.runs[0].period
    finger, library = shared_library(package, tmp_path)
    other, stages = finger.Mission(library), Controller(of.control).stages
    plan, controller, ahead = (
        Plan(Timetable(of), stages, np.zeros(0)),
        SimpleNamespace(change=lambda **_: None),
        stages.stage,
    )
    names, off = [phase.name for phase in plan.phases], []
    for k, y in enumerate(done.y):
        command = SimpleNamespace(contact_forces=SimpleNamespace(force=np.zeros(0)), trip=0, anomaly=Anomaly(0))
        plant = SimpleNamespace(command=done.u[k - 1] if k else of.rest)
        plan.advance(k * period, controller, plant, command) if k else plan.enter(0.0, controller, plant)
        found = other.step(finger.Measurement(*y))
        off.append(np.array([found.tension_1, found.tension_2]) - done.u[k])
        wanted = plan.rows(k * period + ahead * np.arange(stages.stages + 1))
        count = wanted.size
        sent = np.frombuffer(other._work, dtype=float)[-count - 1 :]
        assert any(np.array_equal(sent[at : at + count].reshape(wanted.T.shape), wanted.T) for at in (0, 1))
        assert wanted[0] == pytest.approx(done.r[k], abs=1e-10)
        assert names[other.phase()] == plan.phase.name
        assert plan.phase.name == phases_of(done, done.t[k : k + 1])[0]
    assert np.abs(off).max() < 1e-6
    assert (other.decision(), other.forces()) == (1, 1)


@MACHINES
def test_a_mission_to_the_bit_elsewhere(machine, package, tmp_path):
    compiler, emulator, flags = ELSEWHERE[machine]
    (program,) = compile_programs(compiler, package, tmp_path, "main", *STRICT, *flags, "-O1")
    assert len(re.findall(r" 0 of +\d+ cases failed", run(emulator, program))) == 2


@pytest.mark.parametrize("compiler", [pytest.param(name, marks=needs(name)) for name in ("gcc", "clang")])
def test_a_mission_to_the_bit_without_a_warning_and_any_bits_under_sanitizers(compiler, package, tmp_path):
    (program,) = compile_programs(compiler, package, tmp_path, "main", *STRICT, *WARNINGS, "-O1")
    assert re.search(r"^mission_step +0 of +\d+ cases failed", run(program), re.MULTILINE)
    # States far beyond any finger make a divisor underflow to zero: what is not finite then is refused, as is tested.
    divides = "-fno-sanitize=float-divide-by-zero"
    flags = (*STRICT, "-O1", "-g", SANITIZE, divides, "-fno-sanitize-recover=all")
    (fuzz,) = compile_programs(compiler, package, tmp_path, "fuzz", *flags)
    assert len(re.findall(r" 0 of \d+ rows failed", run(fuzz, 2000))) == 2


@needs("cc")
def test_a_mission_lets_go_when_asked(carried, package, tmp_path):
    """Lowered first where it was lifted, aborted at once, within the rate all the way."""
    finger, library = shared_library(package, tmp_path)
    header = (package / "include/finger.h").read_text()
    number = {name: int(k) for name, k in re.findall(r"FINGER_PHASE_(\w+) = (\d+)", header)}
    limits = json.loads((package / "MANIFEST.json").read_text())["functions"]["mission_step"]["memory_bytes"]
    assert 0 < limits["mission"] < 12_000
    for ends, then, last in (("release", "LOWER", 130), ("release", "RELEASE", 70), ("abort", "RELEASE", 130)):
        mission, passed, before = finger.Mission(library), [], None
        for k in range(260):
            if k == last:
                getattr(mission, ends)()
            u = mission.step(finger.Measurement(*carried("mug").runs[0].y[k]))
            passed.append(mission.phase())
            assert before is None or abs(u.tension_1 - before) <= 4.0 + 1e-9  # N, in 10 ms
            before = u.tension_1
        assert passed[last] == number[then]
        assert passed[last - 1] < number["LOWER"]
        assert passed[-1] == number["END"]


@needs("cc")
def test_a_mission_that_measures_nothing_lifts_nothing(package, tmp_path):
    finger, library = shared_library(package, tmp_path)
    header = (package / "include/finger.h").read_text()
    number = {name: int(k) for name, k in re.findall(r"FINGER_PHASE_(\w+) = (\d+)", header)}
    mission, passed = finger.Mission(library), set()
    for _ in range(1000):
        mission.step(finger.Measurement(*[math.nan] * len(finger.Measurement._fields_)))
        passed.add(mission.phase())
    assert number["CONFIRM"] in passed
    assert number["LIFT"] not in passed
    assert max(passed) == number["END"]


@needs("cc")
def test_fingers_lift_together_and_let_go_together(carried, tmp_path):
    """A package each; the first decides by what the other reported a period before, as in Python."""
    mission, libraries = carried("pinch"), []
    with pytest.raises(InputError, match="one of lower, upper, which have a package each"):
        export_c(mission, tmp_path / "none")
    for of in mission.assignments:
        export_c(mission, tmp_path / of.name, finger=of.name)
        libraries.append(shared_library(tmp_path / of.name, tmp_path / of.name))
    names, off = [phase.name for phase in Timetable(mission.assignments[0]).phases()], 0.0
    for lacks in (False, True):
        fingers = [finger.Mission(library) for finger, library in libraries]
        for k, measured in enumerate(zip(*(done.y for done in mission.runs), strict=True)):
            reported = 2 if lacks else fingers[1].forces()
            if reported:
                (fingers[0].others_bear if reported == 1 else fingers[0].others_lack)()
            for j, (one, y) in enumerate(zip(fingers, measured, strict=True)):
                if j and fingers[0].decision():
                    (one.lift if fingers[0].decision() == 1 else one.let_go)()
                found = one.step(libraries[j][0].Measurement(*y))
                if not lacks:
                    u = np.array([found.tension_1, found.tension_2])
                    off = max(off, np.abs(u - mission.runs[j].u[k]).max())
                    assert names[one.phase()] == phases_of(mission.runs[j], mission.runs[j].t[k : k + 1])[0]
            assert len({one.phase() for one in fingers}) == 1
        assert {one.decision() for one in fingers} == {2 if lacks else 1}
        assert names[fingers[0].phase()] == "end"
    assert off < 1e-6


@needs("cc")
def test_the_example_holds_the_mug_over_a_pipe(package, tmp_path):
    sources = [*(package / "src").glob("*.c"), package / "examples/mission_loop.c"]
    run("cc", *STRICT, "-O1", f"-I{package / 'include'}", *sources, "-o", tmp_path / "loop")
    said = run(sys.executable, "-m", "benchmarks.mission_pipe", tmp_path / "loop", *QUICK, cwd=ROOT)
    assert re.search(r"1\.00 s  lift\n.*2\.82 s  lower\n.*3\.02 s  release\n", said, re.DOTALL)
    assert float(re.search(r"sank by (\S+) mm", said)[1]) < 1.0
