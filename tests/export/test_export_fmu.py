"""Functional mock-up units: valid by the standard's schemas, equal to C package and closed loop, and hard to misuse."""

from __future__ import annotations

import json
import os
import re
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.fmu import export_fmu
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.closed_loop import PlantModel, Sensors
from continuum_grasp.control import Outputs, Prediction, Setpoints
from continuum_grasp.export import export_c
from continuum_grasp.scene import load
from tests.export.test_export_touching import scene as touching_scene
from tests.export_cases import TENDONS, loop_scene, needs, run, shared_library, values
from tests.marks import few
from tests.rods import ROOT

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

from tests.fmu_cases import Instance  # noqa: E402

VERSIONS = ["2", "3"]
LOADED = {
    "fidelity.family": "arc",
    "fidelity.elements": 2,
    "parameters": ["bending_stiffness"],
    "loads": [{"kind": "force", "at": "180 mm", "force": {"times": [0.0, 1.0], "values": [[0.01, 0.0], [0.01, 0.0]]}}],
}
"""Two arcs with a run-time parameter and a force at the tip."""
HEADERS = Path(fmpy.__file__).parent / "c-code"


@lru_cache
def plant_scene():
    return load(TENDONS, LOADED)


@lru_cache
def closed_loop():
    plant = {"fidelity": {"family": "arc", "elements": 2}, "stiffness": 1.1, "noise": 1.0, "delay": 0.0137}
    return loop_scene(8).replaced(plant=plant, duration=0.5)


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """Units by what they are and version; of the controller with a preview."""
    folder = tmp_path_factory.mktemp("units")
    made = [("finger", unit) for unit in export_fmu(plant_scene(), folder, name="arcs")]
    made += [(unit.what, unit) for unit in export_fmu(closed_loop(), folder, name="loop", preview=True)]
    # Extracted once: a library that is loaded must not be written again.
    for _, unit in made:
        fmpy.extract(str(unit.file), str(unit.file.with_suffix("")))
    return {(kind, unit.fmi): unit for kind, unit in made}


@pytest.fixture
def opened(units):
    """Instances, freed at the end."""
    made = []

    def instance(what, fmi, **more):
        made.append(Instance(units[what, fmi], **more))
        return made[-1]

    yield instance
    for one in made:
        one.fmu.freeInstance()


def described(unit):
    """What a unit says that a master may do."""
    return fmpy.read_model_description(str(unit.file)).coSimulation


# The archive.


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("what", ["finger", "plant", "controller"])
def test_validation_finds_nothing(what, fmi, units):
    unit = units[what, fmi]
    assert validate_fmu(str(unit.file)) == []
    with zipfile.ZipFile(unit.file) as archive:
        names = archive.namelist()
        assert names[0] == "modelDescription.xml"
        binaries = [name for name in names if name.startswith("binaries/")]
        assert [name.split("/")[1] for name in binaries] == [unit.binary]
        assert unit.binary == (fmpy.platform if fmi == "2" else fmpy.platform_tuple)
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        sources = {
            name.removeprefix("sources/") for name in names if name.startswith("sources/") and name.endswith(".c")
        }
        if fmi == "2":
            assert {file.get("name") for file in root.iter("File")} == sources
        else:
            from lxml import etree

            schema = etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema/fmi3/fmi3BuildDescription.xsd"))
            build = etree.fromstring(archive.read("sources/buildDescription.xml"))
            schema.assertValid(build)
            assert {file.get("name") for file in build.iter("SourceFile")} == sources
    simulates = root.find("CoSimulation")
    assert simulates.get("canBeInstantiatedOnlyOncePerProcess") == "false"
    linear = simulates.get("providesDirectionalDerivative" + ("s" if fmi == "3" else ""))
    assert linear == ("true" if what == "finger" else "false")


def test_variables_have_units_ranges_and_nominal_values(units):
    described = fmpy.read_model_description(str(units["finger", "3"].file))
    found = {v.name: v for v in described.modelVariables}
    stiffness, tension = found["parameters.bending_stiffness"], found["input.tension_1"]
    nominal = plant_scene().finger.rod.stiffness
    assert (stiffness.causality, stiffness.variability, stiffness.unit) == ("parameter", "tunable", "N m2")
    assert float(stiffness.start) == nominal
    assert (float(stiffness.min), float(stiffness.max)) == pytest.approx((0.5 * nominal, 2.0 * nominal))
    assert (tension.min, tension.max, tension.start, tension.unit) == ("0.0", "60.0", "2.0", "N")
    assert float(tension.nominal) > 1.0
    units_of = {unit.name: unit.baseUnit for unit in described.unitDefinitions}
    assert (units_of["N m2"].kg, units_of["N m2"].m, units_of["N m2"].s) == (1, 3, -2)
    assert [u.variable.name for u in described.derivatives] == [n for n in found if n.startswith("rate.")]


def test_the_same_scene_gives_the_same_archive(units, tmp_path):
    (again,) = export_fmu(plant_scene(), tmp_path, name="arcs", fmi=["2"])
    assert again.file.read_bytes() == units["finger", "2"].file.read_bytes()


# Numbers.


@needs("cc")
@pytest.mark.parametrize(("fmi", "stride"), [("2", 1), ("3", 5)])
def test_a_thousand_steps_are_those_of_the_c_package_to_the_bit(fmi, stride, opened, tmp_path):
    export_c(plant_scene(), tmp_path / "package", real="double")
    finger, library = shared_library(tmp_path / "package", tmp_path, "-O1")
    one, h = opened("finger", fmi), plant_scene().time.step
    stiffness = 0.9 * plant_scene().finger.rod.stiffness
    library.model.parameters.bending_stiffness = stiffness
    one.set("parameters.", [stiffness])
    x, rng = finger.State(*one.get("state.")), np.random.default_rng(0)
    for k in range(0, 1000, stride):
        u, w = rng.uniform(0.0, 20.0, 2), rng.uniform(-0.05, 0.05, 2)
        one.set("input.", u)
        one.set("forces.", w)
        one.step(k * h, stride * h)
        for _ in range(stride):
            x = library.step(x, finger.Input(*u), finger.Forces(*w), h)
        assert one.get("state.").tolist() == values(x)
        tip = library.tip(x, finger.Input(*u))
        assert one.get("tip.").tolist() == [tip.x, tip.y, tip.angle]
    assert np.abs(one.get("tip.")).max() > 0.05
    one.step(1000 * h, 2.5 * h)  # no whole multiple: equal parts
    for _ in range(3):
        x = library.step(x, finger.Input(*u), finger.Forces(*w), 2.5 * h / 3.0)
    assert one.get("state.").tolist() == values(x)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_directional_derivatives_are_differences(fmi, opened):
    one = opened("finger", fmi, begin=False)
    x = np.array([0.4, -0.3, 2.0, 1.0, 0.02, 0.1])
    one.set("state.", x)
    one.set("input.", [5.0, 3.0])
    one.fmu.enterInitializationMode()
    unknowns = [*one.names("state."), *one.names("rate."), *one.names("tip.")]
    knowns = [*one.names("input."), *one.names("forces."), *one.names("state.")]
    seed = np.random.default_rng(1).standard_normal(len(knowns))
    numbers = [[one.number[name] for name in names] for names in (unknowns, knowns)]
    found = np.array(one.fmu.getDirectionalDerivative(*numbers, seed.tolist()))
    at, step = one.get("input.", "forces.", "state."), 1e-6
    ends = []
    for sign in (1.0, -1.0):
        moved = at + sign * step * seed
        for start, part in zip(("input.", "forces.", "state."), np.split(moved, [2, 4]), strict=True):
            one.set(start, part)
        ends.append(one.get("state.", "rate.", "tip."))
    expected = (ends[0] - ends[1]) / (2.0 * step)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_controller_and_plant_together_are_the_closed_loop(fmi, noise, opened):
    scene = closed_loop()
    scene = scene.replaced(plant=scene.plant.replaced(noise=noise))
    loop = cg.run_closed_loop(scene)
    control, plant, prediction = opened("controller", fmi), opened("plant", fmi), Prediction(scene)
    rows = Setpoints.of(Outputs.of(scene.controller.cost, prediction), scene.reference).rows
    rng, std = np.random.default_rng(scene.plant.seed), Sensors(scene, PlantModel(scene), prediction, None).std
    period = scene.controller.step
    ahead = scene.controller.horizon.stage * np.arange(scene.controller.horizon.stages + 1)
    for k in range(len(loop.u)):
        t = k * period
        plant.set("noise.", std * rng.standard_normal(len(std)))
        y = plant.get("measurement.")
        assert y == pytest.approx(loop.y[k], rel=1e-9, abs=1e-9)
        control.set("measurement.", y)
        control.set("reference.", rows(t + ahead).T)
        control.step(t, period)
        u = control.get("command.")
        assert u == pytest.approx(loop.u[k], rel=1e-8, abs=1e-8)
        plant.set("command.", u)
        plant.step(t, period)
        assert plant.get("state.") == pytest.approx(loop.x[k + 1], rel=1e-7, abs=1e-7)
    assert np.ptp(loop.u) > 2.0
    assert control.count("code") >= 0
    estimate = control.get("estimate.")[: loop.estimate.shape[1]]
    assert estimate == pytest.approx(loop.estimate[-1], rel=1e-6, abs=1e-6)


# States, instances, order of calls.


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("what", ["finger", "plant", "controller"])
def test_states_are_saved_restored_and_sent(what, fmi, opened):
    one, other = opened(what, fmi), opened(what, fmi)
    h = {"finger": 0.001, "plant": 0.01, "controller": 0.01}[what]
    inputs = {"finger": "input.", "plant": "command.", "controller": "measurement."}[what]
    results = {"finger": "state.", "plant": "measurement.", "controller": "command."}[what]
    rng = np.random.default_rng(2)
    given = 3.0 + rng.uniform(0.0, 3.0, (12, len(one.names(inputs))))
    if what == "controller":
        given = one.get(inputs) + 1e-3 * given

    def walk(of, begin):
        seen = []
        for k in range(begin, begin + 6):
            of.set(inputs, given[k])
            of.step(k * h, h)
            seen.append(of.get(results).tolist())
        return seen

    walk(one, 0)
    state = one.saved()
    after = walk(one, 6)
    one.restore(state)
    assert walk(one, 6) == after
    data = one.packed(state)
    received = other.unpacked(data)
    other.restore(received)  # the other one was at its start
    assert walk(other, 6) == after
    for of, held in ((one, state), (other, received)):
        of.fmu.freeFMUstate(held) if fmi == "2" else of.fmu.freeFMUState(held)
    with pytest.raises(FMICallException):
        other.unpacked(b"\x00" * len(data))
    assert "this is no serialized state of this FMU" in other.said
    for place in rng.integers(0, len(data), 40):  # any byte, the checksum's included
        damaged = bytearray(data)
        damaged[place] ^= 1 << int(rng.integers(0, 8))
        with pytest.raises(FMICallException):
            other.unpacked(bytes(damaged))
    assert "the serialized state was damaged: its checksum differs" in other.said
    one.fmu.terminate()
    with pytest.raises(FMICallException):
        one.step(12 * h, h)
    one.fmu.reset()
    if fmi == "2":
        one.fmu.setupExperiment(startTime=0.0)
    one.begin()
    first = walk(one, 0)
    fresh = opened(what, fmi)
    assert walk(fresh, 0) == first


@pytest.mark.parametrize("fmi", VERSIONS)
def test_reading_outputs_of_new_inputs_changes_nothing(fmi, opened):
    """The command of the inputs of now is read before the step, as a master does where it knows of feedthrough."""
    asked, plain = opened("controller", fmi), opened("controller", fmi)
    y = asked.get("measurement.")
    for k in range(8):
        for one in (asked, plain):
            one.set("measurement.", y + 1e-3 * k)
        before = asked.get("command.").tolist()
        asked.set("measurement.", y - 1e-3)
        assert asked.get("command.").tolist() != before
        asked.set("measurement.", y + 1e-3 * k)
        assert asked.get("command.").tolist() == before
        for one in (asked, plain):
            one.step(0.01 * k, 0.01)
        assert asked.get("command.").tolist() == plain.get("command.").tolist() == before


# Errors.


@pytest.mark.parametrize("fmi", VERSIONS)
def test_what_is_wrong_is_refused_in_words_and_changes_nothing(fmi, opened):
    one = opened("finger", fmi)
    one.step(0.0, 0.002)
    before = one.get("state.").tolist()

    def refused(call, words):
        one.said.clear()
        with pytest.raises(FMICallException) as error:
            call()
        assert error.value.status == 3  # an error: masters repeat what is discarded
        assert any(words in text for text in one.said), one.said
        assert one.get("state.").tolist() == before

    refused(lambda: one.step(0.002, -0.001), "expected a communication step size above zero")
    refused(lambda: one.step(0.002, float("nan")), "expected a communication step size above zero")
    refused(lambda: one.step(0.5, 0.001), "from 0.5 s, but this FMU is at 0.002 s")
    one.set("input.", [70.0, 2.0])
    refused(lambda: one.step(0.002, 0.001), "step: an input or a parameter is out of its range")
    assert "input.tension_1 is 70, expected 0 to 60 [N]" in one.said
    one.set("input.", [float("nan"), 2.0])
    refused(lambda: one.step(0.002, 0.001), "step: an input or a parameter is NaN or infinite")
    one.set("input.", [5.0, 2.0])
    one.set("parameters.", [1e-9])
    refused(lambda: one.step(0.002, 0.001), "out of its range")
    one.set("parameters.", [plant_scene().finger.rod.stiffness])
    refused(lambda: one.set("tip.", [0.0, 0.0, 0.0]), "set: tip.x is computed")
    refused(lambda: one.set("state.", before), "is given before the simulation alone")
    one.number["none"] = 12345
    refused(lambda: one.get("none"), "no real variable has the value reference 12345")
    one.step(0.002, 0.001)
    assert one.count("code") == 0


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_finger_takes_communication_steps_of_any_length(fmi, units):
    """By fmpy, whose steps end at its own points and at those of its inputs."""
    unit, times = units["finger", fmi], [0.0, 0.0333, 0.1]
    tensions = {"input.tension_1": [9.0, 9.0, 2.0], "input.tension_2": [2.0, 2.0, 2.0]}
    given = np.rec.fromarrays([times, *tensions.values()], names=["time", *tensions])
    assert described(unit).canHandleVariableCommunicationStepSize
    results = [
        fmpy.simulate_fmu(str(unit.file), input=given, output=["tip.x"], stop_time=0.1001, output_interval=h)
        for h in (0.001, 0.0007, 0.00423)
    ]
    wanted = np.interp(0.0846, results[0]["time"], results[0]["tip.x"])
    for found in results:
        assert found["time"][-1] == pytest.approx(0.1001)
        # fmpy holds inputs over its steps, so that results differ by the order of a step.
        assert np.interp(0.0846, found["time"], found["tip.x"]) == pytest.approx(wanted, abs=2e-3)
    assert np.ptp(results[0]["tip.x"]) > 0.02


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_step_that_fails_within_changes_nothing(fmi, opened):
    """A finger near the end of its range leaves it by the first internal step, and the second is refused."""
    one = opened("finger", fmi, begin=False)
    x = one.get("state.")
    x[:4] = [2.0, 2.0, 500.0, 500.0]
    one.set("state.", x)
    one.begin()
    before = one.get("state.").tolist()
    with pytest.raises(FMICallException):
        one.step(0.0, 0.02)
    assert any(text.startswith("DoStep: no step from 0 s to 0.02 s, nothing has changed") for text in one.said)
    assert one.get("state.").tolist() == before
    assert one.count("code") < 0
    one.step(0.0, 0.001)
    assert one.get("state.").tolist() != before


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("what", ["plant", "controller"])
def test_loops_take_whole_multiples_alone(fmi, what, units, opened):
    unit = units[what, fmi]
    assert not described(unit).canHandleVariableCommunicationStepSize
    with pytest.raises(FMICallException) as error:
        fmpy.simulate_fmu(str(unit.file), stop_time=0.1, output_interval=1.5 * unit.step, logger=lambda *_: None)
    assert error.value.status == 3
    one = opened(what, fmi)
    with pytest.raises(FMICallException):
        one.step(0.0, 1.5 * unit.step)
    step, length = f"{unit.step:.9g}", f"{1.5 * unit.step:.9g}"
    assert (
        f"DoStep: expected a communication step size that is a whole multiple of {step} s, got {length} s" in one.said
    )
    one.step(0.0, 2 * unit.step)
    found = fmpy.simulate_fmu(str(unit.file), stop_time=0.0999, logger=lambda *_: None)  # fmpy's own steps
    assert found["time"][-1] == pytest.approx(unit.step * round(0.0999 // unit.step))


def test_scenes_and_options_that_do_not_fit(tmp_path):
    scene, loop = plant_scene(), closed_loop()
    for given, options, words in (
        (scene, {"what": ["controller"]}, "a simulated scene has only a plant"),
        (scene, {"preview": True}, "is for a controller"),
        (scene, {"fmi": ["1"]}, "expected some of 2, 3"),
        (scene, {"name": "Not C"}, "C identifier"),
        (scene, {"step": 0.5, "substeps": 1}, "too long"),
        (scene, {"step": -1.0}, "above 0"),
        (scene, {"ranges": {"mass": (1.0, 2.0)}}, "not a run-time parameter"),
        (loop, {"step": 0.001}, "is for a simulated scene"),
        (loop, {"what": ["object"]}, "expected some of plant, controller"),
        (ROOT / "configs/grasp/mug.yaml", {}, r"expected a scene .* or a closed loop"),
    ):
        with pytest.raises(InputError, match=words):
            export_fmu(given, tmp_path, binary=False, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", few(["winches", "spirob", "motor_servo", "tip_steps"], 1))
def test_the_plants_of_shipped_loops_are_within_what_compilers_take(name, tmp_path):
    """Eight clothoids with 62,000 to 80,000 instructions in their linearization."""
    (unit,) = export_fmu(ROOT / f"configs/mpc/{name}.yaml", tmp_path, fmi=["2"], what=["plant"], binary=False)
    with zipfile.ZipFile(unit.file) as archive:
        (source,) = [file for file in archive.namelist() if file.endswith("plant_plant.c")]
        assert b"plant_plant_step" in archive.read(source)


def test_stiff_fingers_take_sub_steps(tmp_path):
    scene = load(ROOT / "configs/simulate/winch_loop.yaml")
    (unit,) = export_fmu(scene, tmp_path, fmi=["2"], binary=False)
    with zipfile.ZipFile(unit.file) as archive:
        steps = json.loads(archive.read("resources/MANIFEST.json"))["steps"]["step"]
    assert (unit.step, steps["substeps"]) == (0.002, 12)


# The sources.


@needs("gcc")
@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("what", few(["finger", "controller", "plant"], 2))
def test_sources_compile_strictly_and_are_of_the_types_of_the_standard(what, fmi, units, tmp_path):
    with zipfile.ZipFile(units[what, fmi].file) as archive:
        archive.extractall(tmp_path)
    flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wmissing-prototypes", "-Werror", "-O0", "-fsyntax-only"]
    sources = sorted((tmp_path / "sources").glob("*.c"))
    if what == "plant":  # CasADi's part has warnings of its own
        sources = [path for path in sources if path.name.startswith("fmi")]
    run("gcc", *flags, *sources)
    # The same functions once more behind the standard's own declarations: conflicting types would be errors.
    header = ["-include", HEADERS / f"fmi{fmi}Functions.h", f"-I{HEADERS}"]
    run("gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", *header, tmp_path / f"sources/fmi{fmi}.c")
    prefixed = f"-DFMI{fmi}_FUNCTION_PREFIX=one_"
    run("gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", prefixed, tmp_path / f"sources/fmi{fmi}.c")


@pytest.mark.deep
@needs("gcc", "nm")
@pytest.mark.parametrize("fmi", VERSIONS)
def test_an_importer_builds_the_sources_to_the_same_bits(fmi, units, tmp_path, monkeypatch):
    """By the build of fmpy, from the sources alone; every function of the standard is there, and no writable data."""
    from fmpy.build import build_platform_binary

    (plain,) = export_fmu(plant_scene(), tmp_path / "plain", name="arcs", fmi=[fmi], binary=False)
    assert plain.binary is None
    fmpy.extract(str(plain.file), str(tmp_path / "built"))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    build_platform_binary(tmp_path / "built")
    given = {"stop_time": 0.1, "start_values": {"input.tension_1": 9.0}, "output": ["tip.x", "tip.angle"]}
    results = [fmpy.simulate_fmu(str(f), **given) for f in (units["finger", fmi].file, tmp_path / "built")]
    assert results[0].tobytes() == results[1].tobytes()
    with zipfile.ZipFile(units["finger", fmi].file) as archive:
        archive.extractall(tmp_path / "files")
    (binary,) = (tmp_path / "files/binaries").glob("*/*")
    exported = {line.split()[-1] for line in run("nm", "-D", "--defined-only", binary).splitlines()}
    declared = (HEADERS / f"fmi{fmi}Functions.h").read_text()
    if fmi == "3":
        wanted = set(re.findall(r"FMI3_Export fmi3\w+TYPE +(fmi3\w+);", declared))
        assert wanted - exported == set()
    assert {name for name in exported if not name.startswith("fmi")} == set()


@pytest.mark.deep
@needs("gcc")
def test_random_calls_under_sanitizers(units, tmp_path):
    """Any order of calls with any numbers: no undefined behavior, no leak."""
    with zipfile.ZipFile(units["finger", "2"].file) as archive:
        archive.extractall(tmp_path)
    token = fmpy.read_model_description(str(units["finger", "2"].file)).guid
    program = Path(__file__).parent / "fmu_calls.c"
    flags = ["-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    sources = sorted((tmp_path / "sources").glob("*.c"))
    run("gcc", *flags, f'-DTOKEN="{token}"', f"-I{HEADERS}", program, *sources, "-lm", "-o", tmp_path / "calls")
    assert "done" in run(tmp_path / "calls")


# The command.


def test_the_command(tmp_path):
    config = tmp_path / "two arcs.yaml"
    config.write_text(json.dumps(plant_scene().model_dump(mode="json")))
    line = ["export", str(config), "--to", "fmu", "--out", str(tmp_path / "out"), "--no-binary", "--fmi", "3"]
    found = CliRunner().invoke(app, line)
    assert found.exit_code == 0, found.output
    assert "two_arcs_plant_fmi3.fmu" in found.output
    assert "4 inputs" in found.output
    said = json.loads(CliRunner().invoke(app, [*line, "--json", "--step", "0.002"]).stdout)
    assert said["units"][0]["step_s"] == 0.002
    assert validate_fmu(said["units"][0]["file"]) == []


# The object inside.


@pytest.mark.parametrize("name", few(["disc", "on_table", "fixed", "box"], 1))
def test_an_object_moves_as_by_steps_of_the_c_package_to_the_bit(name, tmp_path):
    """Its states, its contacts and their parameters; what a package does is compared with ``simulate`` elsewhere."""
    given = touching_scene(name).replaced(time={"duration": 0.2, "step": 0.001})
    (unit,) = export_fmu(given, tmp_path, fmi=["2"], name=name)
    assert validate_fmu(str(unit.file)) == []
    fmpy.extract(str(unit.file), str(unit.file.with_suffix("")))
    one, h = Instance(unit, begin=False), given.time.step
    fixed = [0.001, 0.0] if one.names("parameters.") else []
    one.set("parameters.", one.get("parameters.") + fixed)
    one.begin()
    export_c(given, tmp_path / "package", real="double", what=["step", "kinematics", "contact"])
    finger, library = shared_library(tmp_path / "package", tmp_path, "-O1")
    if fixed:
        library.model.parameters.object_x += fixed[0]
    x, u = finger.State(*one.get("state.")), finger.Input(*one.get("input."))
    forces = [finger.Forces(*one.get("forces."))] if one.names("forces.") else []
    pressed = 0.0
    for k in range(200):
        seen = library.touch(x, u, *(forces if "table" in one.names("contact.")[-1] else []))
        assert one.get("contact.").tolist() == [number for field in values(seen) for number in field]
        pressed = max(pressed, *seen.normal_force)
        one.step(k * h, h)
        x = library.step(x, u, *forces, h)
        assert one.get("state.").tolist() == values(x)
    assert pressed > 0.05
    one.fmu.terminate()
    one.fmu.freeInstance()
