"""Exported steps of a finger that touches, as ``simulate`` moves it; from inside: test vectors and single calls.

Exported steps of a finger with its object, contacts and table: as ``simulate`` moves them, as far as contacts go.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.core import CReal
from continuum_grasp.export import Code, export_c
from continuum_grasp.export.parts import PARTS
from continuum_grasp.export.source import source_of
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.vectors import press, vectors_of
from continuum_grasp.scene import Scene
from tests.export_cases import STRICT, WARNINGS, compile_programs, needs, run, shared_library, values
from tests.marks import few

STIFFNESS = 800.0
LAW = {"stiffness": STIFFNESS, "friction": 0.4, "dissipation": 1.0, "rounding": 2e-4}
DISC = {"shape": "circle", "diameter": 0.04, "mass": 0.1}
TABLE = {"object_moves": True, "out_of_plane_gravity": 9.81, "table": {"friction": 0.2, "friction_radius": 0.013}}
PUSHER = {
    "finger": {
        "rod": {"length": 0.15, "linear_density": 0.03, "bending_stiffness": 0.01},
        "half_thickness": 0.005,
        "damping": {"material": 5e-5},
        "tendons": {"offset": 0.005, "max_tension": 40.0, "time_constant": 0.02},
    },
    "gravity": [0.0, 0.0],
    "contact_law": LAW,
    "fidelity": {"family": "arc", "elements": 1},
    "actuation": {"tensions": [15.0, 0.0]},
    "initial": {"pose": "straight"},
    "time": {"duration": 0.2, "step": 0.002},
}
"""A finger that bends to the left within 0.2 s, beside an object."""
LEFT = {"object": {**DISC, "position": [-0.04, 0.13]}}
RIGHT = {"object": {**DISC, "position": [0.04, 0.13]}, "actuation": {"tensions": [0.0, 15.0]}}
SLIPPERY = {"contact_law": {**LAW, "friction": 0.0}, "object_moves": True}
BOX = {"shape": "box", "width": 0.03, "height": 0.06, "mass": 0.1, "position": [-0.06, 0.1]}
SUPPORTS = {"palm": {"type": "palm", "point": [-0.09, 0.13], "normal_angle": 0.0}}
CASES = {
    "disc": {**LEFT, **SLIPPERY},
    "on_table": {**LEFT, **TABLE},
    "mirrored": {**RIGHT, **TABLE},
    "fixed": {**LEFT, "contacts": [0.075], "fidelity": {"family": "arc", "elements": 2}},
    "slip_speed": {**LEFT, **TABLE, "contact_law": {**LAW, "slip_speed": 0.05}},
    "box": {**SLIPPERY, "object": BOX, "contacts": [0.075], "fidelity": {"family": "arc", "elements": 2}},
    "against_a_wall": {
        **LEFT,
        "object_moves": True,
        "supports": SUPPORTS,
        "contacts": [0.075],
        "fidelity": {"family": "arc", "elements": 4},
    },
}


@lru_cache
def scene(name: str) -> Scene:
    return Scene.model_validate({"schema_version": 1, **PUSHER, **CASES[name]})


def subject_of(name: str, **more) -> Subject:
    source = source_of(scene(name), CReal.KINDS["double"])
    return Subject.of(
        source.finger, "finger", CReal.KINDS["double"], more.pop("ranges", {}), source.surroundings, **more
    )


@needs("cc")
@pytest.mark.parametrize("name", few(CASES, 1))
def test_steps_are_the_motion_of_simulate(name, tmp_path):
    """Against integration of variable order and step; tip and object, forces of contacts, and no warning."""
    given = scene(name)
    truth = cg.simulate(given.replaced(time={**given.time.model_dump(), "method": "reference"}))
    made = export_c(given, tmp_path / "package", what=["step", "kinematics", "contact"], real="double").manifest
    finger, library = shared_library(tmp_path / "package", tmp_path, "-O1")
    forces = [finger.Forces(*truth.w[0])] if hasattr(finger, "Forces") else []
    seen = forces if "forces" in made["functions"]["touch"]["inputs"] else []
    acting, x = finger.Input(*truth.u[0]), finger.State(*truth.x[0])
    poses = [k for k, one in enumerate(truth.system.x_names) if one.split(" ")[0] in ("object_x", "object_y")]
    for k in range(len(truth.t)):
        row = values(x)
        tip = library.tip(x, acting)
        assert math.hypot(tip.x - truth.tip[k, 0], tip.y - truth.tip[k, 1]) < 3e-6  # 2e-5 of the length
        assert np.take(row, poses) == pytest.approx(truth.x[k, poses], abs=3e-6)
        touched = library.touch(x, acting, *seen)
        assert list(touched.normal_force) == pytest.approx(truth.contacts.normal_force[k], abs=2e-3)
        x = library.step(x, acting, *forces, given.time.step)
        assert library.code == 0
    assert truth.contacts.normal_force.max() > 0.05


@pytest.mark.parametrize("name", ["disc", "fixed", "box"])
def test_contacts_are_taken_as_deep_as_they_may_be(name):
    """By placing the object: a gap of -depth, 0.999 and 1.001 of the limit."""
    force = 2.5
    subject = subject_of(name, ranges={"contact_force": (0.0, force)})
    assert subject.pressed == pytest.approx(force / STIFFNESS, rel=1e-12)
    system, (tip,) = subject.touching, [k for k, n in enumerate(subject.touching.touch_names) if n == "finger.tip"]
    x, p = np.array(system.state()), np.array(system.p_nominal)
    u, w = np.zeros(system.nu), np.zeros(system.nw)
    place = (p, slice(0, 2)) if name == "fixed" else (x, slice(subject.model.nx, subject.model.nx + 2))
    found = []
    for share in (0.999, 1.001):
        touch = system.touch(x, u, w, p)
        gap, normal = float(touch[0][tip]), np.array(touch[6])[:, tip]
        place[0][place[1]] += normal * (gap + share * subject.pressed)
        rows = {key: np.array([value]) for key, value in {"x": x, "u": u, "w": w, "p": p}.items()}
        codes = [PARTS[part](subject).calls[0].reference(rows)[1][0] for part in ("dynamics", "contact")]
        found.append(codes)
    assert found == [[Code.OK, Code.OK], [Code.ERR_RANGE, Code.WARN_LEFT_RANGE]]


@pytest.mark.parametrize(("name", "force"), [("fixed", 0.2 / 0.075), ("disc", 0.2 / 0.15)])
def test_contacts_bear_twice_what_drives_and_weight_press_with_at_rest(name, force):
    """The greatest moment is 40 N at 5 mm, at the first station or the tip; seen from above, nothing weighs."""
    assert subject_of(name).pressed == pytest.approx(2.0 * force / STIFFNESS, rel=1e-12)


@pytest.mark.parametrize("name", ["fixed", "on_table"])
def test_vectors_press_and_slide(name):
    """Over the whole range of depths, and a few beyond it; objects that are drawn at random would touch by chance."""
    subject = subject_of(name)
    vectors = vectors_of(subject, PARTS["contact"](subject).calls)[0]
    count, good = len(subject.touching.touch_names), vectors.codes == Code.OK
    gaps, forces = vectors.outputs[:, :count], vectors.outputs[:, count : 2 * count]
    stations = [k for k, at in enumerate(subject.touching.touch_names) if at.startswith("finger.")]
    assert (forces[good][:, stations] > 0.01).any(axis=1).mean() > 0.5
    deepest = -gaps[:, stations].min(axis=1) / subject.pressed
    assert 0.8 < deepest[good].max() <= 1.0
    assert 1.0 < deepest[vectors.codes == Code.WARN_LEFT_RANGE].max() < 2.0
    assert (np.abs(vectors.outputs[good, 2 * count : 3 * count]) > 0.01).any()


@pytest.mark.parametrize("name", ["disc", "on_table", "fixed", "slip_speed"])
def test_the_fastest_motion_is_that_of_pressed_contacts(name):
    """Against eigenvalues of the motion's Jacobian where the object really is pressed against the finger."""
    subject = subject_of(name)
    system, rng = subject.touching, np.random.default_rng(3)
    x = np.tile(system.state(), (60, 1))
    reach = [field.high for field in subject.state.fields[: system.n]]
    x[:, : system.n] = rng.uniform(-1.0, 1.0, (60, system.n)) * reach
    arguments = subject.passed_to(PARTS["dynamics"](subject).calls[0])
    sizes = {argument.array: argument.size for argument in arguments}
    zero = np.zeros((60, sum(sizes.values())))
    at = sizes.get("p", 0)
    zero[:, :at], zero[:, at : at + system.nx] = system.p_nominal, x
    fastest = 0.0
    for row in press(subject, arguments, zero, rng):
        own, state = row[:at], row[at : at + system.nx]
        depth = -float(system.touch(state, np.zeros(system.nu), np.zeros(system.nw), own)[0][0])
        if depth <= subject.pressed:
            slope = np.array(system.linearization(state, np.zeros(system.nu), np.zeros(system.nw), own)[0])
            fastest = max(fastest, np.abs(np.linalg.eigvals(slope)).max())
    assert 0.25 * subject.radius < fastest <= 1.05 * subject.radius


def test_what_lands_on_a_contact_is_resolved():
    """A sub-step times the fastest oscillation on the contact's spring, sqrt(k) |dr/dq| / sqrt(M), is 1/8."""
    subject, model = subject_of("disc", longest=0.002), source_of(scene("disc"), CReal.KINDS["double"]).finger
    fastest = 0.0
    for bend in np.linspace(-1.0, 1.0, 41) * subject.state.fields[0].high:
        jacobian = np.array(model.jacobian([bend], [0.0, 0.0], 0.15, [])).ravel()[:2]
        inertia = float(model.mass_matrix([bend], [0.0, 0.0], []))
        fastest = max(fastest, STIFFNESS * (jacobian @ jacobian / inertia + 1.0 / DISC["mass"]))
    assert subject.substeps == pytest.approx(0.002 * math.sqrt(fastest) / 0.125, rel=0.15)
    assert subject_of("disc", longest=0.002, count=subject.substeps // 3).substeps == subject.substeps // 3


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"contact_force": (1.0, 2.0)}, "expected 0 and a force above it, got 1:2"),
        ({"contact_force": (0.0, 0.0)}, "expected 0 and a force above it"),
        ({"object_x": (0.5, 0.6)}, "leaves out the nominal value"),
    ],
)
def test_ranges_of_objects_that_are_none_are_refused(ranges, message):
    with pytest.raises(InputError, match=message):
        subject_of("fixed", ranges=ranges)


@pytest.mark.deep
@needs("gcc")
@pytest.mark.parametrize("name", ["disc", "on_table", "fixed"])
def test_its_programs_run(name, tmp_path):
    """Vectors, and the loop of the examples, which begins with the object where the scene has it."""
    package = tmp_path / "package"
    export_c(scene(name), package, what=["step", "kinematics", "contact"], real="double")
    (vectors,) = compile_programs("gcc", package, tmp_path, "main", *STRICT, *WARNINGS, "-O1")
    assert " 0 of" in run(vectors)
    sources = sorted((package / "src").glob("*.c"))
    run("gcc", *STRICT, f"-I{package / 'include'}", package / "examples/loop.c", *sources, "-o", tmp_path / "loop")
    lines = run(tmp_path / "loop").splitlines()
    assert len(lines) > 100
    assert lines[-1].endswith(",0")
