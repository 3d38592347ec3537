"""Estimator and controller of a package; from inside: identifiers and units of names, and noise of test vectors.

Estimator and controller of a package: the numbers of the Python ones, and everything that may be given to them.
"""

from __future__ import annotations

import ctypes
import json
import math
import warnings
from functools import lru_cache

import numpy as np
import pytest

from continuum_grasp.addons.fmu.description import base_unit
from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import SimulatedBench
from continuum_grasp.control import CommandStatus, Controller, Estimator
from continuum_grasp.core import CReal
from continuum_grasp.export import Code, Library, export_c, package
from continuum_grasp.export.control import replay
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import identifiers, unit_of
from continuum_grasp.export.source import source_of
from tests.control_cases import Reality, hand_scene
from tests.export_cases import (
    DRIVES,
    STRICT,
    WARNINGS,
    compile_programs,
    needs,
    run,
    scene,
    shared_library,
    values,
)
from tests.marks import few

CODES = {
    0: CommandStatus.SOLVED,
    3: CommandStatus.ITERATION_LIMIT,
    4: CommandStatus.ROW_VIOLATED,
    5: CommandStatus.PREVIOUS_PLAN,
    6: CommandStatus.SAFE_RAMP,
    8: CommandStatus.SOLVED,
}


@pytest.fixture(scope="module")
def libraries(packages, tmp_path_factory):
    """Python binding and library of packages by scene and type, compiled once."""

    @lru_cache
    def made(name: str, real: str):
        return shared_library(packages(name, real), tmp_path_factory.mktemp(f"{name}_{real}"))

    return made


def reference(finger, rows):
    """Setpoints (nodes, nr) as the struct."""
    columns = [(ctypes.c_double * len(rows))(*column) for column in np.transpose(rows)]
    if finger.Real is ctypes.c_float:
        columns = [(ctypes.c_float * len(rows))(*column) for column in columns]
    return finger.Reference(*columns)


# Numbers, against the Python controller and estimator, whose C comes from CasADi and uses vector lanes.


@pytest.mark.deep
@needs("cc")
@pytest.mark.parametrize(("name", "real"), few([("observed", "double"), ("given", "float"), ("given", "double")], 1))
def test_the_controller_is_that_of_python(name, real, libraries):
    """In closed loop, over setpoints that saturate tension and curvature; measurements and calls are missing."""
    finger, library = libraries(name, real)
    control = Controller(scene(name), precision=real, deadline=math.inf)
    other = finger.Controller(library)
    plant = Reality(scene(name), control.first)
    u, seen = np.array([1.0, 1.0]), set()
    outputs = None if name == "given" else Estimator(scene(name)).estimation.outputs
    late, passed, now = [], 1, 3.0
    for k in range(70):
        y = plant.x.copy()
        if outputs is not None:
            z = np.append(plant.x, 0.0)
            tip_x, tip_y, difference = np.array(outputs(z, u, control.stages.p_nominal)[0]).ravel()
            late = [*late[-1:], np.array([tip_x, tip_y, 1.0 + max(difference, 0.0), 1.0 + max(-difference, 0.0)])]
            y = late[0].copy()
        if k % 13 == 7:
            y[k % len(y)] = np.nan
        if k % 29 == 20:
            y[0] = np.inf
        rows = control.nominal_setpoints.rows(k * control.period + 0.01 * np.arange(9))
        # Now and then calls are missed, and a sample is older or younger.
        age = 0.01 * (k % 4) if k % 11 == 5 else None
        command = control.step(y, rows, time=now, age=age)
        if k:
            other.elapsed(passed * control.period)
        if age is not None:
            other.age(age)
        found = other.step(finger.Measurement(*y), reference(finger, rows))
        limit = 2e-3 if real == "float" else 1e-7
        assert values(found) == pytest.approx(command.u, rel=limit, abs=20 * limit)
        seen.add(CODES[other.code])
        u, passed = command.u, 4 if k % 23 == 15 else 1
        now += passed * control.period
        plant.advance(u, passed * control.period)
        assert other.diagnosis().missed == pytest.approx(command.missed, rel=1e-6)
    assert CommandStatus.SOLVED in seen
    assert CommandStatus.PREVIOUS_PLAN in seen or name == "observed"


@pytest.mark.deep
@needs("cc")
def test_a_tip_that_stays_off_its_setpoint_is_reported_as_by_python(packages, tmp_path):
    """In closed loop with a camera that is 2 mm off: by each, off from the same call on."""
    given, camera, off = scene("held"), np.array([0.0, 0.002, 0.0, 0.0]), []
    finger, library = shared_library(packages("held", "double"), tmp_path)
    control, other, plant = Controller(given, deadline=math.inf), finger.Controller(library), SimulatedBench(given)
    rows = np.tile(control.nominal_setpoints.rows([0.0])[0], (control.stages.stages + 1, 1))
    rows[:, :2] = (-0.0827, 0.1515)
    for _ in range(400):
        y = np.array(plant.read()) + camera
        command = control.step(y, rows)
        other.step(finger.Measurement(*y), reference(finger, rows))
        said = other.diagnosis()
        assert (said.health, said.cause) == (command.health, command.offset_cause)
        assert said.offset == pytest.approx(command.offset, rel=1e-6)
        plant.write(command)
        plant.idle()
        off.append(command.offset)
    assert off[0] == 0.0
    assert max(off) > 2e-3


@pytest.mark.deep
@needs("cc")
@pytest.mark.parametrize("name", few(["scenarios", *DRIVES], 2))
def test_a_controller_of_drives_or_scenarios_is_that_of_python(name, packages, tmp_path):
    """In closed loop from rest to a bend and back, on a finger whose tendons have friction, or on a fourth plant."""
    given, p = scene(name), 1.3 if name == "scenarios" else 1.0
    finger, library = shared_library(packages(name, "double"), tmp_path)
    control, other = Controller(given, deadline=math.inf), finger.Controller(library)
    plant, moved = Reality(given, control.first, [p * v for v in control.stages.p_nominal]), []
    for k in range(30):
        row = np.tile(control.nominal_setpoints.rows([0.0])[0], (control.stages.stages + 1, 1))
        row[:, :2] = (-0.06, 0.16) if k < 15 else (0.0, 0.18)
        command, found = control.step(plant.x, row), other.step(finger.Measurement(*plant.x), reference(finger, row))
        assert values(found) == pytest.approx(command.u, rel=1e-6, abs=1e-9)
        assert CODES[other.code] == command.status
        plant.advance(command.u, control.period)
        moved.append(plant.tip[0])
    assert min(moved) < -0.01


@pytest.mark.deep
@needs("cc")
@pytest.mark.parametrize(
    ("name", "real"), [*(("observed", real) for real in CReal.KINDS), *few([("adapting", "double")], 0)]
)
def test_the_estimator_is_that_of_python(name, real, libraries):
    finger, library = libraries(name, real)
    python, other = Estimator(scene(name), precision=real), finger.Estimator(library)
    rng = np.random.default_rng(2)
    for k in range(60):
        y = np.array([0.01 * np.sin(0.1 * k), 0.18, 1.0 + 0.02 * k, 1.0]) + 1e-4 * rng.standard_normal(4)
        if k % 11 == 4:
            y[k % 4] = np.nan
        u = np.array([1.0 + 0.02 * k, 1.0])
        expected, found = python.step(y, u), other.step(finger.Measurement(*y), finger.Command(*u))
        limit = 2e-3 if real == "float" else 1e-9
        assert np.allclose(values(found), expected.z, rtol=limit, atol=limit * np.abs(expected.z).max())


@pytest.mark.deep
@needs("cc")
def test_settings_that_are_changed_are_those_of_python(libraries):
    finger, library = libraries("given", "double")
    control, other = Controller(scene("given"), deadline=math.inf), finger.Controller(library)
    rows = np.tile([0.8, 0.6, 1.0, 1.0], (9, 1))
    control.change(weights=[300.0, 50.0, 2e-3, 1e-3], u_max=[6.0, 60.0])
    settings = other.head.settings
    settings.weight_bending_1, settings.weight_bending_2, settings.weight_tension_1 = 300.0, 50.0, 2e-3
    settings.most_tension_1 = 6.0
    x = np.array([0.2, 0.1, 1.0, -1.0])
    for k in range(5):
        command, found = (
            control.step(x + 0.01 * k, rows),
            other.step(finger.Measurement(*(x + 0.01 * k)), reference(finger, rows)),
        )
        assert values(found) == pytest.approx(command.u, rel=1e-8)
    assert found.tension_1 <= 6.0


@pytest.mark.deep
@needs("cc")
def test_scratch_needs_no_beginning_and_may_be_shared(libraries):
    finger, library = libraries("observed", "double")
    clean, dirty = finger.Controller(library), finger.Controller(library)
    rows = np.tile([0.8, 0.9, 1.0, 1.0], (9, 1))
    for k in range(12):
        y = finger.Measurement(-0.002 * k, 0.18, 1.0, 1.0)
        dirty._work.raw = np.random.default_rng(k).bytes(len(dirty._work))
        assert values(clean.step(y, reference(finger, rows))) == values(dirty.step(y, reference(finger, rows)))


@pytest.mark.deep
@needs("cc")
def test_a_library_with_scratch_of_its_own_needs_none(packages, libraries, tmp_path):
    flags = "-DFINGER_OWN_SCRATCH", *WARNINGS
    own, own_library = shared_library(packages("observed", "double"), tmp_path, *flags)
    finger, library = libraries("observed", "double")
    without, usual = own.Controller(own_library), finger.Controller(library)
    without._own[1] = None
    rows = np.tile([0.8, 0.9, 1.0, 1.0], (9, 1))
    for k in range(12):
        y = -0.002 * k, 0.18, 1.0, 1.0
        found = without.step(own.Measurement(*y), reference(own, rows))
        assert values(found) == values(usual.step(finger.Measurement(*y), reference(finger, rows)))
    usual._own[1] = None
    with pytest.raises(finger.Error) as refused:
        usual.step(finger.Measurement(*y), reference(finger, rows))
    assert refused.value.code == Code.ERR_NULL


# Refusals.


@needs("cc")
@pytest.mark.parametrize(
    ("field", "value", "code"),
    [
        ("weight_bending_1", math.nan, Code.ERR_NON_FINITE),
        ("weight_bending_1", -1.0, Code.ERR_RANGE),
        ("most_tension_2", 61.0, Code.ERR_RANGE),
        ("least_tension_1", 0.5, Code.ERR_RANGE),
        ("least_curvature_1", 2.0, Code.ERR_RANGE),
        ("penalty_curvature_1", math.inf, Code.ERR_NON_FINITE),
    ],
)
def test_settings_that_cannot_be_used_are_refused_and_nothing_changes(field, value, code, libraries):
    finger, library = libraries("given", "double")
    control = finger.Controller(library)
    rows, x = reference(finger, np.tile([0.5, 0.5, 1.0, 1.0], (9, 1))), finger.Measurement(0.1, 0.0, 0.0, 0.0)
    control.step(x, rows)
    before = control._memory.raw
    usual = getattr(control.head.settings, field)
    setattr(control.head.settings, field, value)
    with pytest.raises(finger.Error) as caught:
        control.step(x, rows)
    assert caught.value.code == code
    setattr(control.head.settings, field, usual)
    assert control._memory.raw == before


@needs("cc")
def test_what_goes_beside_measurements(libraries):
    """Begin anew at a state, say what was applied, that a command was late; ask for estimate and diagnosis."""
    finger, library = libraries("given", "double")
    c, control = library._c, finger.Controller(library)
    rows = reference(finger, np.tile([0.5, 0.5, 1.0, 1.0], (9, 1)))
    state, before = finger.Measurement(0.4, 0.3, 0.0, 0.0), finger.Command(5.0, 2.0)
    control.start(state, before)
    control.step(state, rows)
    control.late()
    control.step(state, rows)
    assert control.code == Code.WARN_PREVIOUS_PLAN
    said = control.diagnosis()
    assert said.anomalies == 1024
    assert said.missed == 0.0
    control.elapsed(0.0)
    control.step(state, rows)
    assert finger.ANOMALIES[control.diagnosis().anomalies].startswith("the time of the call is ignored")
    for function in (control.elapsed, control.age):
        for wrong in (-1.0, math.nan, math.inf):
            with pytest.raises(finger.Error):
                function(wrong)
    assert finger.ANOMALIES[said.anomalies] == "the last command was late"
    for beyond in (-31.0, 121.0, math.nan):
        with pytest.raises(finger.Error):
            control.applied(finger.Command(beyond, 1.0))
    for applied in (before, finger.Command(0.0, 0.0), finger.Command(-0.01, 60.5)):
        control.applied(applied)
    control.step(finger.Measurement(), rows)
    assert values(control.estimate()) == values(state)
    with pytest.raises(finger.Error) as caught:
        control.start(finger.Measurement(0.0, 99.0, 0.0, 0.0), before)
    assert caught.value.code == Code.ERR_RANGE
    for function, count in (
        ("start", 3),
        ("applied", 2),
        ("late", 1),
        ("elapsed", 1),
        ("age", 1),
        ("estimate", 2),
        ("diagnosis", 2),
    ):
        assert getattr(c, f"finger_controller_{function}")(*[None] * count) == Code.ERR_NULL
    assert c.finger_controller_init_abi(control._memory, ctypes.c_uint32(1)) == Code.ERR_ABI
    for name in ("measurement", "reference", "command"):
        assert getattr(c, f"finger_{name}_init_abi")(None, ctypes.c_uint32(finger.ABI)) == Code.ERR_NULL
        assert getattr(c, f"finger_{name}_init_abi")(control._memory, ctypes.c_uint32(1)) == Code.ERR_ABI


@needs("cc")
@pytest.mark.parametrize("applied", [(-25.0, 1.0), (1.0, 115.0), (-25.0, 115.0)])
def test_no_command_follows_what_was_applied_beyond_the_limits(applied, libraries):
    """Slack drives, and one that overshoots, for the estimator alone: in C as in Python."""
    finger, library = libraries("limited", "double")
    control, other = Controller(scene("limited"), deadline=math.inf), finger.Controller(library)
    rows = np.tile([0.5, 0.5, 1.0, 1.0], (9, 1))
    for k in range(6):
        x = np.array([0.2, 0.1, 0.0, 0.0]) + 0.01 * k
        if k % 2:
            other.applied(finger.Command(*applied))
        found = values(other.step(finger.Measurement(*x), reference(finger, rows)))
        assert other.code in (Code.OK, Code.WARN_BOUND_LEFT)  # what was applied is beyond the rate's bound
        assert min(found) >= 1.0 - 1e-6
        assert max(found) <= 60.0 + 1e-6
        assert found == pytest.approx(control.step(x, rows, applied=applied if k % 2 else None).u, rel=1e-7)


@pytest.mark.deep
@needs("cc")
def test_what_is_left_out_is_not_measured_and_the_reference_is_that_of_the_scene(libraries):
    finger, library = libraries("observed", "double")
    rows = Controller(scene("observed")).nominal_setpoints.rows(np.zeros(9))
    short, whole = finger.Controller(library), finger.Controller(library)
    for k in range(12):
        tip = {"tip_x": -0.002 * k, "tip_y": 0.18}
        found = short.step(finger.Measurement(**tip), finger.Reference())
        expected = whole.step(finger.Measurement(*tip.values(), math.nan, math.nan), reference(finger, rows))
        assert values(found) == values(expected)
        assert short.diagnosis().anomalies == 1
    assert values(finger.Command()) == [1.0, 1.0]
    with pytest.raises(TypeError, match="Command: tension_2 missing"):
        finger.Command(tension_1=1.0)
    with pytest.raises(TypeError, match="has tip_x, tip_y"):
        finger.Measurement(tip_z=1.0)


@pytest.mark.parametrize(
    ("name", "what", "message"),
    [
        ("arcs", ["mpc"], "what: needs a closed loop"),
        ("given", ["estimator"], "has no estimator"),
        ("given", ["mission"], "needs a mission"),
    ],
)
def test_parts_that_a_scene_does_not_have_are_refused(name, what, message, tmp_path):
    with pytest.raises(InputError, match="finger: is for a mission of several fingers"):
        export_c(scene(name), tmp_path, finger="left")
    with pytest.raises(InputError, match=message):
        export_c(scene(name), tmp_path / "out", what=what)
    assert not (tmp_path / "out").exists()


@needs("cc")
@pytest.mark.parametrize("what", few([["estimator"], ["kinematics", "mpc"]], 1))
def test_parts_may_be_chosen(what, tmp_path):
    package = export_c(scene("observed"), tmp_path, what=what, prefix="controller", real="float")
    assert package.manifest["parts"] == what
    (program,) = compile_programs("cc", tmp_path, tmp_path, "main", *STRICT, *WARNINGS, "-O1")
    assert " 0 of" in run(program)
    assert "finger_" not in "".join(path.read_text() for path in (tmp_path / "src").iterdir())


FAULTS = {
    "a constant": ("kernels", "0.09f * ", "0.1f * "),
    "a term": ("control", "memcpy(z[k + 1], o->defect[at],", "memset(z[k + 1], 0,"),
}
"""What is wrong in single precision: the file, what stands there, and what instead."""


@needs("cc")
@pytest.mark.parametrize("fault", few([*FAULTS], 1))
def test_a_build_in_single_precision_that_is_wrong_is_refused(fault, monkeypatch, tmp_path):
    file, was, instead = FAULTS[fault]
    library_files = package.library_files

    def broken(contents):
        files = library_files(contents)
        assert was in files[f"src/finger_{file}.c"]
        return files | {f"src/finger_{file}.c": files[f"src/finger_{file}.c"].replace(was, instead)}

    monkeypatch.setattr(package, "library_files", broken)
    with pytest.raises(InputError, match="float gives mpc a relative error of"):
        export_c(scene("given"), tmp_path, real="float")


@pytest.mark.deep
@needs("cc")
def test_calls_from_the_same_memory_agree(packages):
    """Also of a controller for which rounding may decide whether a tendon sticks, from where on runs part."""
    functions = json.loads((packages("servo", "float") / "MANIFEST.json").read_text())["functions"]
    (command,) = functions["mpc"]["errors"].values()
    assert command["usual_call"] < 1e-5 * command["greatest_value"]
    for error in functions["estimator_step"]["errors"].values():
        assert error["over_the_run"] < 1e-3 * error["greatest_value"]


@pytest.mark.deep
@needs("cc")
def test_all_memory_is_copied_from_build_to_build():
    """Every byte but those of interface, settings and parameters, which rows set, and at most three that pad."""
    library = Library.of(scene("observed"), real="float")
    contents = library.contents
    one, other = (replay._Host(contents, library.files) for _ in range(2))
    ctypes.memset(one._memory, 1, len(one._memory))
    other.copy_memory(one)
    loop, owners = contents.subject.loop, ("estimator", "controller")
    count = sum(int(contents.words[f"{name}_bytes"]) - 4 - 4 * loop.known.size for name in owners)
    count -= 4 * loop.settings.size
    assert count - 3 <= bytes(other._memory).count(1) <= count


def test_measurements_of_the_vectors_have_noise():
    """Of 0.1 mm and 1e-2 of other units, so that an estimator has something to do."""
    loop = Loop.of(hand_scene(), CReal.KINDS["double"], ["estimator", "mpc"])
    finger = replay.ReplayedFinger(loop, np.random.default_rng(0))
    readings = np.array([finger.measured(loop.before) for _ in range(400)])
    deviations = [1e-4 if "[m]" in name else 1e-2 for name in loop.measurement_names]
    assert readings.std(axis=0) == pytest.approx(deviations, rel=0.15)


def test_a_package_whose_readings_can_not_freeze_says_so():
    """Those of a plant without noise rest together, so that controllers of such a scene do not look for frozen ones."""
    ideal = hand_scene().changed({"plant.noise": 0.0})
    with pytest.warns(UserWarning, match=r"plant\.noise is 0"):
        source_of(ideal, CReal.KINDS["double"], None)
    meant = hand_scene(), ideal.changed({"estimator.frozen": False})
    with warnings.catch_warnings(record=True) as said:
        for scene in meant:
            source_of(scene, CReal.KINDS["double"], None)
    assert not [one for one in said if "plant.noise" in str(one.message)]


# Noise of the test vectors and names of a scene.


def test_names_of_a_scene_become_identifiers():
    """Of the basic character set, each once, whatever a zone is called; no unit ends a comment."""
    names = ["wall 1", "wall-1", "Ünter */", "1", "", "x [*/ y]", "tip_x [m]", "rate [N m/s]", "k [1/m/s]"]
    assert identifiers(names) == ["wall_1", "wall_1_2", "nter", "_1", "unnamed", "x", "tip_x", "rate", "k"]
    assert [unit_of(name) for name in names] == ["1"] * 6 + ["m", "N m/s", "1/m/s"]


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("N m2", {"kg": 1, "m": 3, "s": -2}),
        ("1/m/s2", {"m": -1, "s": -2}),
        ("1/(rad/s)2", {"rad": -2, "s": 2}),
        ("1", {}),
        ("N m s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("N/", None),
        ("m per unit of the coordinate", None),
        ("", None),
    ],
)
def test_units_as_exponents(unit, powers):
    assert base_unit(unit) == powers
