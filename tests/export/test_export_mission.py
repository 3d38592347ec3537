"""Missions as C, against runs of Python; from inside: heights as the phases take them, step by step.

Missions as C: a run of Python replayed, other machines, letting go, and several fingers that tell each other.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.addons.fmu import export_fmu
from continuum_grasp.addons.mission import PlantVariation
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.plan import PhasePlan
from continuum_grasp.addons.mission.plant import Timetable
from continuum_grasp.addons.mission.run import MissionRunner
from continuum_grasp.base import InputError
from continuum_grasp.control import Controller, Sight
from continuum_grasp.export import export_c
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from tests.export.test_export_targets import ELSEWHERE, MACHINES
from tests.export_cases import SANITIZE, STRICT, WARNINGS, compile_programs, needs, run, shared_library
from tests.mission_cases import QUICK, carried
from tests.rods import ROOT

pytestmark = pytest.mark.deep

CONFIGS = ROOT / "configs/mission"
CONVERGES = "phases.squeeze=0.5"
"""With it each solve of the short mission converges; one that does not would depend on the rounding of a compiler."""


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mug")
    export_c(carried("mug", CONVERGES), folder)
    return folder


def phases_of(run, t):
    """Name of the phase in which each command was given."""
    starts, names = zip(*run.events, strict=True)
    return [names[k - 1] for k in np.searchsorted(starts, t + 1e-9)]


def phase_numbers(package):
    header = (package / "include/finger.h").read_text()
    return {name: int(k) for name, k in re.findall(r"FINGER_PHASE_(\w+) = (\d+)", header)}


@needs("cc")
@pytest.mark.xfail(reason="the mug's loop to the rods' grasp has steps with violated rows", strict=False)
def test_a_mission_of_python_is_replayed(tmp_path):
    """By what was measured: the same phases, setpoints to the bit, commands to the rounding of another compiler."""
    mission = carried("mug", CONVERGES)
    (of,), (done,) = mission.assignments, mission.runs
    period = done.period
    assert set(done.status) == {"solved"}
    export_c(mission, tmp_path / "package")
    finger, library = shared_library(tmp_path / "package", tmp_path)
    other, stages = finger.Mission(library), Controller(of.control).stages
    plan, controller, ahead = (
        PhasePlan(Timetable(of), stages, np.zeros(0)),
        SimpleNamespace(change=lambda **_: None),
        stages.stage,
    )
    names, off = plan.names, []
    command = SimpleNamespace(contact_forces=SimpleNamespace(force=np.zeros(0)), sight=Sight.SEES)
    for k, y in enumerate(done.y):
        plant = SimpleNamespace(command=done.u[k - 1] if k else of.rest)
        plan.advance(k * period, controller, plant, command) if k else plan.enter(0.0, controller, plant)
        found = other.step(finger.Measurement(*y))
        off.append(np.array([found.tension_1, found.tension_2]) - done.u[k])
        wanted = plan.rows(k * period + ahead * np.arange(stages.stages + 1))
        count = wanted.size
        sent = np.frombuffer(other._work, dtype=float)[-count - 1 :]
        assert any(np.array_equal(sent[at : at + count].reshape(wanted.T.shape), wanted.T) for at in (0, 1))
        assert wanted[0] == pytest.approx(done.r[k], abs=1e-10)
        assert names[other.phase()] == plan.phase
        assert plan.phase == phases_of(done, done.t[k : k + 1])[0]
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
def test_a_mission_lets_go_when_asked(package, tmp_path):
    """Lowered first where it was lifted, aborted at once, within the rate all the way."""
    finger, library = shared_library(package, tmp_path)
    number = phase_numbers(package)
    limits = json.loads((package / "MANIFEST.json").read_text())["functions"]["mission_step"]["memory_bytes"]
    assert 0 < limits["mission"] < 12_000
    for ends, then, last in (("release", "LOWER", 130), ("release", "RELEASE", 70), ("abort", "RELEASE", 130)):
        mission, passed, before = finger.Mission(library), [], None
        for k in range(260):
            if k == last:
                getattr(mission, ends)()
            u = mission.step(finger.Measurement(*carried("mug", CONVERGES).runs[0].y[k]))
            passed.append(mission.phase())
            assert before is None or abs(u.tension_1 - before) <= 4.0 + 1e-9  # N, in 10 ms
            before = u.tension_1
        assert passed[last] == number[then]
        assert passed[last - 1] < number["LOWER"]
        assert passed[-1] == number["END"]


@needs("cc")
def test_fingers_lift_together_and_let_go_together(tmp_path):
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
                (fingers[0].others_bear, fingers[0].others_lack, fingers[0].others_doubt)[reported - 1]()
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
def test_the_example_holds_the_mug_over_a_pipe(tmp_path):
    package = tmp_path / "package"
    export_c(carried("mug", CONVERGES), package)
    sources = [*(package / "src").glob("*.c"), package / "examples/mission_loop.c"]
    run("cc", *STRICT, "-O1", f"-I{package / 'include'}", *sources, "-o", tmp_path / "loop")
    said = run(sys.executable, "-m", "benchmarks.mission_pipe", tmp_path / "loop", *QUICK, CONVERGES, cwd=ROOT)
    assert re.search(r"0\.90 s  lift\n.*2\.72 s  lower\n.*2\.92 s  release\n", said, re.DOTALL)
    assert float(re.search(r"sank by (\S+) mm", said)[1]) < 1.0


@needs("cc")
@pytest.mark.parametrize("fmi", ["2", "3"])
def test_a_functional_mock_up_unit_is_the_package_to_the_bit(fmi, package, tmp_path):
    """Command and phase of every step, with the object let go before the plan does."""
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    from tests.fmu_cases import Instance

    mission, last = carried("mug", CONVERGES), 130
    (unit,) = export_fmu(mission, tmp_path, name="mug", fmi=[fmi])
    assert validate_fmu(str(unit.file)) == []
    assert unit.inputs[-2:] == ("release", "abort")
    fmpy.extract(str(unit.file), str(unit.file.with_suffix("")))
    finger, library = shared_library(package, tmp_path / "package")
    one, other = Instance(unit), finger.Mission(library)
    for k, y in enumerate(mission.runs[0].y):
        if k == last:
            other.release()
        wanted = other.step(finger.Measurement(*y))
        one.set("measurement.", y)
        one.set("release", float(k >= last))
        # Outputs are those of the inputs of now, and asking for them twice takes no step.
        found = [one.get("command.") for _ in range(2)]
        assert np.array_equal(found, [[wanted.tension_1, wanted.tension_2]] * 2)
        assert [one.count(name) for name in ("phase", "decision", "forces")] == [
            other.phase(),
            other.decision(),
            other.forces(),
        ]
        one.step(k * unit.step, unit.step)
    assert other.decision() == 1


@needs("cc")
def test_slip_is_answered_as_in_python(tmp_path, monkeypatch):
    """By the same heights: squeezed in the same period, with the same commands; when asked to; set down."""
    scene = load(CONFIGS / "mug.yaml", [*QUICK, CONVERGES, "slip={height: 0.1 mm, down: 4 mm}"])
    heights, measured = [], PhasePlan._height
    monkeypatch.setattr(PhasePlan, "_height", lambda plan, plant: heights.append(measured(plan, plant)) or heights[-1])
    mission = MissionRunner(assign(scene, optimize_grasp(scene.grasp))).run(PlantVariation(friction_fall=0.4))
    done, noticed = mission.runs[0], mission.verdict.slipped
    assert set(done.status) == {"solved"}
    package = tmp_path / "package"
    export_c(mission, package)
    finger, library = shared_library(package, tmp_path)
    number = phase_numbers(package)
    usual, asked, sinks = (finger.Mission(library) for _ in range(3))
    for k, y in enumerate(done.y):
        usual.height(heights[k])
        found = usual.step(finger.Measurement(*y))
        assert np.abs(np.array([found.tension_1, found.tension_2]) - done.u[k]).max() < 1e-6
        assert usual.grip() == sum(done.t[k] > at - 1e-9 for at in (noticed.time, noticed.down))
        if k == 140:
            asked.squeeze()
        asked.step(finger.Measurement(*y))
        assert asked.grip() == (k >= 140)
        sinks.height(-0.01 * (k >= 140))
        sinks.step(finger.Measurement(*y))
        # One height alone might be a glitch.
        assert sinks.grip() == (k > 140) + (k > 142)
        assert sinks.phase() >= number["LOWER"] if k > 142 else sinks.phase() < number["LOWER"]
    (program,) = compile_programs("cc", package, tmp_path, "main", *STRICT, "-O1")
    assert re.search(r"^mission_step +0 of +\d+ cases failed", run(program), re.MULTILINE)
    (unit,) = export_fmu(mission, tmp_path, binary=False, fmi=["3"])
    assert unit.inputs[-4:] == ("release", "abort", "squeeze", "height")


@needs("cc")
def test_an_object_is_held_until_it_is_asked_for(package, tmp_path):
    """With the commands of the plan as long as the horizon does not see its end, then with those of the last rest."""
    mission = carried("mug", CONVERGES)
    of, number = mission.assignments[0], phase_numbers(package)
    waiting = of.mission.replaced(phases=of.mission.phases.replaced(hold_until_release=True))
    export_c(replace(mission, assignments=(replace(of, mission=waiting),)), tmp_path / "waits")
    planned, waits = (
        shared_library(folder, tmp_path / name) for folder, name in ((package, "p"), (tmp_path / "waits", "w"))
    )
    one, other = (finger.Mission(library) for finger, library in (planned, waits))
    lowered = round(mission.timetable.span("lower").start / mission.runs[0].period)
    seen, last, passed, tensions = lowered - 20, lowered + 300, [], []
    for k in range(last + 200):
        measured = mission.runs[0].y[min(k, lowered)]
        if k == last:
            other.release()
        found = other.step(waits[0].Measurement(*measured))
        passed.append(other.phase())
        tensions.append([found.tension_1, found.tension_2])
        if k < seen:
            wanted = one.step(planned[0].Measurement(*measured))
            assert tensions[-1] == [wanted.tension_1, wanted.tension_2]
    assert set(passed[lowered:last]) == {number["LOWER"] - 1}
    assert np.ptp(tensions[lowered + 100 : last], axis=0).max() < 0.01 * max(tensions[lowered])
    spent = {name: passed.count(number[name]) for name in ("LOWER", "RELEASE")}
    assert spent == {"LOWER": 20, "RELEASE": 50}
    assert passed[-1] == number["END"]
