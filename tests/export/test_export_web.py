"""Pages: their plant against the models; from inside: the plant and the records of a page, run outside of a browser.

Pages: their plant against the models of the package and, to the bit, against another compiler; their texts.
"""

from __future__ import annotations

import base64
import ctypes
import dataclasses
import gzip
import html
import json
import re
import subprocess

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.web.page import plant_exports
from continuum_grasp.addons.web.plant import PUSHED, plant_of_loop, plant_of_scene
from continuum_grasp.addons.web.record import loop_record, trajectory_record
from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import Plant
from continuum_grasp.control import Prediction, stages_of
from continuum_grasp.export import WebAssembly
from continuum_grasp.results import MotionResult
from tests.export_cases import loop_scene, needs

pytestmark = needs("clang", "wasm-ld", "node", "gcc")

RELEASE = {"finger.masses": [{"at": 0.6, "mass": 0.02}], "parameters": ["tip_mass"]}


def native(plant, folder):
    """Its C as a library of this machine, and its arrays."""
    source = folder / "native.c"
    source.write_text(plant.source)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-O1"]
    subprocess.run(["gcc", *strict, "-shared", "-fPIC", source, "-o", folder / "native.so"], check=True)
    library = ctypes.CDLL(str(folder / "native.so"))
    library.advance.argtypes = [ctypes.c_double, ctypes.c_int]
    arrays = {}
    for name, size in plant.arrays.items():
        at = getattr(library, f"at_{name}")
        at.restype = ctypes.POINTER(ctypes.c_double)
        arrays[name] = np.ctypeslib.as_array(at(), (max(size, 1),))[:size]
    arrays["x"][:], arrays["u"][:], arrays["p"][:] = plant.start, plant.rest, plant.system.p_nominal
    forces = plant.signals.w(0.0)[0]
    arrays["w"][: len(forces)] = forces
    return library, arrays


def tip_of(arrays):
    return np.array([arrays["section_x"][-1], arrays["section_y"][-1]])


@pytest.fixture(scope="module")
def release():
    return cg.load("configs/simulate/nitinol_release_020g.yaml")


@pytest.mark.deep
@pytest.mark.parametrize("factor", [1, 2])
def test_a_release_is_that_of_simulate_to_the_order_of_the_method(release, factor, tmp_path):
    plant = plant_of_scene(release.changed({"fidelity": {"family": "clothoid", "elements": 3}}))
    library, arrays = native(plant, tmp_path)
    assert library.advance(plant.step / factor, 300 * factor) == 0
    library.look()
    exact = cg.simulate(
        release.changed({"fidelity": {"family": "clothoid", "elements": 3}, "time": {"duration": 0.3, "step": 1e-4}})
    )
    away = np.linalg.norm(tip_of(arrays) - exact.tip[-1])
    # 2.4 mm would be a step of order 1; halved steps leave a quarter.
    assert away < 2.0e-4 / factor**2 * 1.3


@pytest.mark.parametrize("quadratic", [1e-6, 1e-3])
def test_damping_that_rises_with_the_rate_is_solved(quadratic, tmp_path):
    """At rest there is none of it, in a fast motion much: slopes from rest lead Newton's method away."""
    bent = {"fidelity": {"family": "clothoid", "elements": 2}, "initial": {"pose": "straight"}}
    scene = cg.load(
        "configs/simulate/tendon_step.yaml",
        {**bent, "actuation.tensions": [12.0, 2.0], "finger.damping.quadratic": quadratic, "time.duration": 0.05},
    )
    plant = plant_of_scene(scene)
    library, arrays = native(plant, tmp_path)
    assert library.advance(plant.step, 50) == 0
    library.look()
    assert np.linalg.norm(tip_of(arrays) - cg.simulate(scene).tip[-1]) < 1e-4 * scene.finger.rod.length


def test_what_is_seen_is_what_the_model_says(release, tmp_path):
    scene = cg.load("configs/simulate/close_on_mug.yaml")
    plant = plant_of_scene(scene)
    library, arrays = native(plant, tmp_path)
    arrays["u"][0] = 40.0
    assert library.advance(plant.step, 1600) == 0
    library.look()
    system, x, u, w = plant.system, arrays["x"], arrays["u"], arrays["w"]
    length = scene.finger.rod.length
    r, angle = (np.array(v) for v in system.sections(plant.at.tolist())(x, u, arrays["p"]))
    np.testing.assert_allclose([arrays["section_x"], arrays["section_y"]], r, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(arrays["section_angle"], angle.ravel(), rtol=1e-12)
    names = system.touch.name_out()
    for name, value in zip(names, system.touch(x, u, w, arrays["p"]), strict=True):
        found = [arrays[f"{name}_x"], arrays[f"{name}_y"]] if name in ("force", "point", "normal") else arrays[name]
        np.testing.assert_allclose(found, np.array(value).reshape(np.shape(found)), rtol=1e-9, atol=1e-9)
    assert arrays["normal_force"].max() > 1.0
    assert arrays["slip"][:3] == pytest.approx(slips(scene, system, arrays), rel=1e-6, abs=1e-12)
    assert plant.at[plant.pushed] == pytest.approx([share * length for share in PUSHED])


def slips(scene, system, arrays):
    """Speeds along the surface, of rigid bodies: the mug, which may climb, and the section at each contact."""
    x, u, p = arrays["x"], arrays["u"], arrays["p"]
    stations = [*scene.contacts, scene.finger.rod.length]
    r, v = (np.array(of(stations)(x, u, p)[0]).T for of in (system.sections, system.section_velocities))
    spin = np.array(system.section_velocities(stations)(x, u, p)[1]).ravel()
    at = [name.partition(" ")[0] for name in system.x_names].index("object_x")
    (place, _, _), (rate, turn, climb) = ((x[k : k + 2], x[k + 2], x[k + 3]) for k in (at, at + 4))
    found = []
    for k in range(len(stations)):
        point, normal = (np.array([arrays[f"{name}_x"][k], arrays[f"{name}_y"][k]]) for name in ("point", "normal"))
        moving = rate + turn * across(point - place) - v[k] - spin[k] * across(point - r[k])
        found.append(np.hypot(across(normal) @ moving, climb))
    return found


def across(vector):
    return np.array([-vector[1], vector[0]])


def test_a_hand_pushes_where_it_is(release, tmp_path):
    plant = plant_of_scene(
        release.changed({"finger.masses": [], "gravity": [0.0, 0.0], "initial": {"pose": "straight"}})
    )
    library, arrays = native(plant, tmp_path)
    arrays["w"][plant.pushes + 2 * PUSHED.index(1.0) + 1] = 0.02
    library.advance(plant.step, 20000)
    library.look()
    rod = release.finger.rod
    # A cantilever with a small force at its tip bends by F L^3 / 3 E I.
    assert tip_of(arrays)[1] == pytest.approx(0.02 * rod.length**3 / 3.0 / rod.stiffness, rel=2e-2)


@pytest.mark.deep
def test_the_same_bits_in_webassembly(tmp_path):
    plant = plant_of_scene(cg.load("configs/simulate/close_on_mug.yaml"))
    library, arrays = native(plant, tmp_path)
    (tmp_path / "plant.wasm").write_bytes(WebAssembly.module({"plant.c": plant.source}, plant_exports(plant)))
    (tmp_path / "run.mjs").write_text(
        """
import { readFile } from "node:fs/promises";
const { x, u, p, w, sizes, step } = JSON.parse(await readFile("start.json"));
const c = (await WebAssembly.instantiate(await readFile("plant.wasm"))).instance.exports;
const of = (name) => new Float64Array(c.memory.buffer, c[`at_${name}`](), sizes[name]);
of("x").set(x); of("u").set(u); of("p").set(p); of("w").set(w);
const codes = [];
for (let k = 0; k < 300; ++k) {
  of("u")[0] = 1 + 0.1 * k;
  codes.push(c.advance(step, 4));
}
c.look();
const bits = {};
for (const name of Object.keys(sizes)) bits[name] = [...new BigUint64Array(of(name).slice().buffer)].map(String);
console.log(JSON.stringify({ codes, bits }));
"""
    )
    start = {name: arrays[name].tolist() for name in "xupw"}
    (tmp_path / "start.json").write_text(json.dumps({**start, "sizes": plant.arrays, "step": plant.step}))
    done = subprocess.run(["node", "run.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    codes = []
    for k in range(300):
        arrays["u"][0] = 1 + 0.1 * k
        codes.append(library.advance(plant.step, 4))
    library.look()
    assert found["codes"] == codes
    for name, array in arrays.items():
        assert [int(v) for v in found["bits"][name]] == array.view(np.uint64).tolist(), name


@pytest.mark.deep
def test_the_controller_of_a_page_is_that_of_a_package(tmp_path):
    scene = loop_scene(6)
    cg.export_c(scene, tmp_path, what=["mpc"], target="wasm")
    subprocess.run(["sh", tmp_path / "wasm/build.sh", tmp_path / "wasm", "library"], check=True)
    page = cg.export_web(scene, tmp_path / "page.html")
    modules = json.loads(re.search(r'id="modules">(.*?)</script>', page.text)[1])
    assert gzip.decompress(base64.b64decode(modules["controller"])) == (tmp_path / "wasm/finger.wasm").read_bytes()
    # Its interface too, with the bytes of its memory; only what follows from parts that a page has not may differ.
    interface = re.compile(r"^const INTERFACE = (.*);$", re.MULTILINE)
    texts = page.text, (tmp_path / "wasm/finger.mjs").read_text()
    own, packaged = (json.loads(interface.search(text)[1]) for text in texts)
    assert own == packaged


@pytest.mark.deep
def test_the_plant_of_a_loop_is_that_of_closed_loops(tmp_path):
    scene = cg.load("configs/mpc/steady_tip.yaml", ["plant.noise=0"])
    plant, sensors = plant_of_loop(scene, stages_of(scene, Prediction(scene)))
    library, arrays = native(plant, tmp_path)
    other = Plant(scene)
    periods = 20
    for k in range(periods):
        arrays["u"][:] = [1.0 + 0.3 * k, 1.0]
        assert library.advance(plant.step, round(scene.controller.step / plant.step)) == 0
        other.advance(arrays["u"])
    library.sense()
    read = sensors.value(other.x, arrays["u"], other.model.forces(0.0)[0])
    np.testing.assert_allclose(arrays["sensed"], np.array(read).ravel(), atol=2e-4 * scene.finger.rod.length)


def test_a_page_is_one_file_whose_texts_end_no_script(release, tmp_path):
    name = "</script><b>&"
    page = cg.export_web(release.changed({"name": name, **RELEASE}), tmp_path / "made" / "page.html")
    text = page.file.read_text()
    assert page.size == len(text.encode())
    assert "<b>" not in text
    assert not re.search(r"(src|href)=|https?://|import\s", text.partition("<script")[2].replace("import {", ""))
    known = json.loads(re.search(r'id="known">(.*?)</script>', text)[1])
    assert [slider["name"] for slider in known["plant"]["parameters"]] == ["tip_mass"]
    # The same page every time.
    again = cg.export_web(release.changed({"name": name, **RELEASE}), tmp_path / "again.html")
    assert again.file.read_bytes() == page.file.read_bytes()


def record_of(page):
    return json.loads(re.search(r'id="known">(.*?)</script>', page.text)[1])


@pytest.mark.parametrize(
    ("config", "changes"),
    [
        # The tip of matched clothoids is no state of the run, but one of the page.
        ("nitinol_release_020g", ["time.duration=0.2"]),
        ("swing_against_disc", ["time.duration=0.3"]),
    ],
)
def test_a_run_is_played_back_as_it_was(config, changes, tmp_path):
    run = cg.simulate(cg.load(f"configs/simulate/{config}.yaml", changes))
    plant = plant_of_scene(run.scene)
    found = trajectory_record(run, plant).frames()
    library, arrays = native(plant, tmp_path)
    assert found["t"][0] == run.t[0]
    assert found["t"][-1] == pytest.approx(run.t[-1])
    for k in range(0, len(found["t"]), 4):
        arrays["x"][:], arrays["u"][:], arrays["w"][:] = found["x"][k], found["u"][k], found["w"][k]
        library.look()
        at = int(np.argmin(abs(run.t - found["t"][k])))
        assert run.t[at] == pytest.approx(found["t"][k], abs=1e-6)  # an instant of the run, not one between
        np.testing.assert_allclose(tip_of(arrays), run.tip[at], atol=1e-7)
        if run.contacts is not None:
            np.testing.assert_allclose(arrays["normal_force"], run.contacts.normal_force[at], atol=1e-3)


def test_a_notebook_shows_a_run_without_a_file(tmp_path):
    run = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.1"]))
    page = run.show()
    assert page.file is None
    assert record_of(page)["record"]["t"][-1] == pytest.approx(0.1)
    assert "0.1 s. From where you take over" in page.text
    assert html.unescape(page._repr_html_()).count(page.text) == 1
    assert page.save(tmp_path / "deep" / "page.html").file.read_text() == page.text


@pytest.mark.deep
def test_a_loop_is_played_back_with_what_its_controller_knew():
    scene = cg.load("configs/mpc/unknown_payload.yaml", ["duration=0.2", "controller.horizon.stages=8"])
    run = cg.run_closed_loop(scene)
    stages = stages_of(scene, Prediction(scene))
    record = dataclasses.asdict(loop_record(run, plant_of_loop(scene, stages, run.readings.plant)[0]))
    periods = np.array([int(np.argmin(abs(run.t - t))) for t in record["t"]])
    np.testing.assert_allclose(record["x"], run.x[periods], rtol=1e-6, atol=1e-9)
    at = np.minimum(periods, len(run.u) - 1)
    np.testing.assert_allclose(record["u"], run.u[at], rtol=1e-6)
    nx = run.estimate.shape[1]
    np.testing.assert_allclose(np.array(record["z"])[:, :nx], run.estimate[at], rtol=1e-6, atol=1e-9)
    assert run.disturbance_names == run.estimated_names[nx:]
    np.testing.assert_allclose(np.array(record["z"])[:, nx:], run.disturbance[at], rtol=1e-6, atol=1e-9)
    assert np.abs(run.disturbance[-1]).min() > 0.0
    np.testing.assert_allclose(record["reference"][0], run.r[0], rtol=1e-6)


def test_what_no_page_plays_back_says_why():
    run = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.01", "time.step=0.01"]))
    with pytest.raises(InputError, match="a Other has no page"):
        type("Other", (MotionResult,), {"t": run.t})().show()
    one = dataclasses.replace(run, **{name: getattr(run, name)[:1] for name in "txuw"})
    with pytest.raises(InputError, match="one instant only"):
        one.show()


@pytest.mark.parametrize(
    ("config", "changes", "message"),
    [
        ("grasp/mug", [], "expected a Scene or a ControlScene or a MissionScene"),
        ("mpc/steady_tip", ["plant.guides=12"], "plant.guides"),
        ("mission/pinch", [], "a page shows one finger, not 2"),
        ("mission/mug", [], "the grasp of this mission is not optimized yet"),
        ("simulate/spirob_units", [], "fidelity.elements: a page has no sweeps along the chain"),
    ],
)
def test_scenes_that_no_page_shows_are_refused(config, changes, message, tmp_path):
    with pytest.raises(InputError, match=message):
        cg.export_web(cg.load(f"configs/{config}.yaml", changes), tmp_path / "page.html")


def test_without_a_compiler_it_says_what_is_missing(release, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="clang and wasm-ld"):
        cg.export_web(release, tmp_path / "page.html")
