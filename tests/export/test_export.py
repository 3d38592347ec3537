"""What a package holds, its numbers those of the model; from inside: the table of parts, and the test vectors.

What a package holds and refuses, and that its numbers are those of the model.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import json
import math
import os
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.core import Core, CReal
from continuum_grasp.export import Code, ModelFields, export_c
from continuum_grasp.export.parts import ASKED_FOR, OF_LOOPS, PARTS
from continuum_grasp.export.source import source_of
from continuum_grasp.export.subject import STABLE, Subject
from continuum_grasp.export.vectors import reach_of, split
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene import Finger, Scene, load
from tests.export_cases import (
    DISC,
    MUG,
    STRICT,
    TENDONS,
    WARNINGS,
    needs,
    run,
    scene,
    shared_library,
    two_arcs,
    values,
)
from tests.features import FEATURES, scene_of
from tests.finger_cases import ROD
from tests.marks import but
from tests.rods import ROOT, after, order

NAMES = ("friction", "contact", "tendons")
WOUND = ("winches", "motor")


# What is in the folder.


@pytest.mark.parametrize("real", CReal.KINDS)
@pytest.mark.parametrize("name", NAMES)
def test_the_manifest_says_what_is_there(name, real, packages):
    folder = packages(name, real)
    manifest = json.loads((folder / "MANIFEST.json").read_text())
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == {*manifest["sha256"], "MANIFEST.json"}
    for file, digest in manifest["sha256"].items():
        assert hashlib.sha256((folder / file).read_bytes()).hexdigest() == digest
    assert sum(f["test_cases"] for f in manifest["functions"].values()) >= 200
    assert manifest["real"] == real
    assert manifest["configuration"]["finger"]["rod"]["length"] > 0


@pytest.mark.deep
@pytest.mark.parametrize("target", ["host", "wasm"])
def test_made_again_every_byte_is_the_same(target, tmp_path):
    """In another process, folder and order of hashes, too."""
    code = f"from continuum_grasp.export import export_c; export_c({str(TENDONS)!r}, 'out', target={target!r})"
    for k in (1, 2):
        (tmp_path / str(k)).mkdir()
        environment = {**os.environ, "PYTHONHASHSEED": str(k), "PYTHONPATH": str(ROOT)}
        run("env", *[f"{n}={v}" for n, v in environment.items()], sys.executable, "-c", code, cwd=tmp_path / str(k))
    one, two = (sorted(path for path in (tmp_path / k / "out").rglob("*") if path.is_file()) for k in "12")
    assert [path.name for path in one] == [path.name for path in two]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(one, two, strict=True))
    assert not any(str(tmp_path) in path.read_text() for path in one)


def test_the_header_says_it_all(packages):
    header = (packages("friction", "float") / "include/finger.h").read_text()
    assert "casadi" not in header.lower()
    for struct in ("parameters", "state", "input", "rate", "section", "balance", "model"):
        assert f"}} finger_{struct};" in header
    for code in (c for c in Code if abs(c) < 3 or c < 0):
        assert re.search(rf"FINGER_{code.name}\s+= +{int(code)}\b", header)
    fields = re.findall(r"^  finger_real \w+(?:\[\d\])*; +/\* \[(.*?)\]", header, re.MULTILINE)
    assert len(fields) == 4 + 12 + 2 + 12 + 5 + 2  # parameters, state, input, rate, section, balance
    assert all(fields)


@pytest.mark.parametrize("name", sorted(set(PARTS) - set(OF_LOOPS)))
def test_each_part_stands_alone(name, tmp_path):
    given = DISC if name == "contact" else scene("arcs")
    manifest = export_c(given, tmp_path, what=[name]).manifest
    assert manifest["parts"] == [name]
    assert sum(f["test_cases"] for f in manifest["functions"].values()) >= 200


# Numbers.


@pytest.mark.deep
@needs("cc")
@pytest.mark.parametrize(
    ("name", "real"), but(itertools.product(WOUND, CReal.KINDS), itertools.product((*NAMES, *WOUND), CReal.KINDS))
)
def test_functions_are_those_of_the_model(name, real, packages, tmp_path):
    """Against CasADi's own evaluation of the model's functions, which shares no code with kernels and vectors."""
    finger, library = shared_library(packages(name, real), tmp_path)
    model = FingerModel(scene(name))
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.5, 0.5, model.n) * (1.0 if model.family == "arc" else 5.0)
    u = np.array([3.0, 1.0])[: model.nu] * (0.01 if name == "motor" else 0.1)  # N m, N
    w, p = rng.uniform(-0.05, 0.05, model.nw), model.p_nominal
    x = [*q, *rng.uniform(-1.0, 1.0, model.n)]
    states = rng.uniform(-0.9, 0.9, len(model.friction_names))
    if name == "winches":  # lengths with tensions in their range
        u = np.array(model.drives_at(q, u, states, pulled=6.0))[::2]
    # Tensions that lag are not those commanded, but for a matched tip.
    lag = np.array(model.drives_at(q, u, states)) * (1.0 if model.structure.matched else 1.1)
    x += [*lag, *states]
    # the cubic of a motion's friction state, of which a history has the value
    history = [np.append(1.5 * states - 0.5 * states**3, 0.0)] if states.size else []
    acting = [finger.State(*x), finger.Input(*u)]
    forced = acting + ([finger.Forces(*w)] if model.nw else [])
    rate = library.dynamics(*forced)
    s = 0.4 * sum(model.lengths)
    at, tip = library.section_at(*acting, s), library.tip(*acting)
    balance = library.statics(*forced)
    residual, stiffness = model.statics(q, u, w, p, *history)
    pairs = [
        (values(rate), model.forward_dynamics(x, u, w, p)),
        ([at.x, at.y], model.position(q, u, s, p)),
        ([at.angle], model.orientation(q, u, s, p)),
        ([list(at.dx), list(at.dy)], model.jacobian(q, u, s, p)),
        ([tip.x, tip.y], model.tip(q, u, p)),
        ([list(tip.dx), list(tip.dy)], model.jacobian(q, u, sum(model.lengths), p)),
        (list(balance.residual), residual),
        ([list(row) for row in balance.stiffness], stiffness),
    ]
    limit = 1e-4 if real == "float" else 1e-9
    for found, true in pairs:
        true = np.array(true)
        assert np.abs(np.reshape(found, true.shape) - true).max() <= limit * np.abs(true).max()


def calls_by_name(subject, *parts):
    """Functions of some parts."""
    return {call.name: call for part in parts for call in PARTS[part](subject).calls}


def test_the_bound_of_the_tip_is_in_the_header(packages):
    """From the curvature at which the last element bends by its range: EI over its length, times the range."""
    model = FingerModel(scene("tendons"))
    most = model.finger.rod.stiffness * model.ranges[-1] / model.lengths[-1]
    (state,) = re.findall(
        r"tip_moment; +/\* \[N m\], (.*?);", (packages("tendons", "double") / "include/finger.h").read_text()
    )
    assert [float(v) for v in state.split(" to ")] == pytest.approx([-most, most], rel=1e-5)
    direct = (packages("direct", "double") / "include/finger.h").read_text()
    slope = model.finger.tendons.offset / most
    said = re.search(r"tip must be in its range:\s+-1 <= (\S+)\s+tension_1 -(\S+)\s+tension_2 <= 1 with", direct)
    assert [float(v) for v in said.groups()] == pytest.approx([slope, slope], rel=1e-5)


@pytest.mark.deep
@pytest.mark.parametrize("name", [*NAMES, "arcs"])
def test_the_stated_rounding_errors_hold_on_other_rows(name, packages):
    """Of 40,000 fresh rows, half uniform and half crowded at the ends, none is off by more; none by much less."""
    stated = json.loads((packages(name, "float") / "MANIFEST.json").read_text())["functions"]
    subject = Subject.of(source_of(scene(name), CReal.KINDS["float"]).model, "finger", CReal.KINDS["float"], {})
    exact = replace(subject, real=CReal.KINDS["double"])
    rng = np.random.default_rng(20)
    parts = [part for part in PARTS if part not in (*OF_LOOPS, *ASKED_FOR)]
    calls = [calls_by_name(s, *parts).values() for s in (subject, exact)]
    for call, wide in zip(*calls, strict=True):
        arguments = subject.passed_to(call)
        low, high = reach_of(arguments)
        worst = np.zeros(call.output.size)
        for k in range(20):
            share = rng.uniform(size=(2000, len(low))) if k % 2 else rng.beta(0.1, 0.1, (2000, len(low)))
            rows = (low + (high - low) * share).astype(np.float32)
            found, codes = call.reference(split(rows, arguments))
            true, _ = wide.reference(split(rows.astype(float), arguments))
            good = (codes >= 0) & (codes != Code.WARN_LEFT_RANGE)
            worst = np.maximum(worst, np.abs(found - true)[good].max(axis=0))
        assert list(stated[call.name]["errors"]) == [field.name for field in call.output.fields]
        for field in call.output.fields:
            here, worst = worst[: field.size].max(), worst[field.size :]
            bound = stated[call.name]["errors"][field.name]["bound"]
            assert here <= bound, (call.name, field.name)
            # Where tendons turn from sliding to sticking, few rows are the worst, which only climbs find.
            assert bound <= 20.0 * here or name == "friction", (call.name, field.name)


@needs("cc")
def test_a_step_follows_the_motion_to_fourth_order(packages, tmp_path):
    finger, library = shared_library(packages("tendons", "double"), tmp_path)
    model = FingerModel(scene("tendons"))
    x0, u, span = np.array([2.0, 1.0, 0.0, 0.0, 0.0, 0.0]), np.array([8.0, 1.0]), 0.02
    core = Core(model, compiled=False)
    exact, errors = after(span, lambda x: core.forward_dynamics(x, u), x0), []
    for steps in (10, 20, 40):
        state = finger.State(*x0)
        for _ in range(steps):
            state = library.step(state, finger.Input(*u), span / steps)
        errors.append(np.abs(values(state) - exact).max())
    assert order(errors) == pytest.approx(4.0, abs=0.35)


@needs("cc")
def test_parameters_are_retuned_without_a_new_export(packages, tmp_path):
    finger, library = shared_library(packages("friction", "double"), tmp_path)
    model = FingerModel(scene("friction"))
    tuned = [0.7, 0.004, 0.3, 5e-3]
    library.model.parameters = finger.Parameters(*tuned)
    x, u = [0.3, -0.2, 1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 0.4, -0.2, 1.2, 0.9], [3.0, 1.0]
    rate = library.dynamics(finger.State(*x), finger.Input(*u))
    true = np.array(model.forward_dynamics(x, u, [], tuned)).ravel()
    found = values(rate)
    assert np.abs(found - true).max() <= 1e-9 * np.abs(true).max()
    library.model.parameters.tip_mass = -1.0
    with pytest.raises(finger.Error, match="out of its range"):
        library.dynamics(finger.State(*x), finger.Input(*u))


@pytest.mark.parametrize("name", but(WOUND, [*NAMES, *WOUND]))
def test_the_fastest_motion_is_found(name):
    """Against eigenvalues of the model's Jacobian at other shapes, at rest, over the ranges of the parameters.

    Tendons have any tension that they may have, and friction in any state.
    """
    model = FingerModel(scene(name))
    subject = Subject.of(model, "finger", CReal.KINDS["double"], {})
    rng = np.random.default_rng(5)
    reach = np.array([field.high for field in subject.state.fields[: model.n]])
    p_ranges = np.array(subject.parameters.bounded).T if subject.parameters else np.zeros((2, 0))
    fastest = 0.0
    for _ in range(100):
        p = rng.uniform(*p_ranges) if model.np else []
        x, u = np.zeros(model.nx), np.zeros(model.nu)
        x[: model.n] = rng.uniform(-1.0, 1.0, model.n) * reach
        if model.friction_names:
            states = rng.choice([0.0, 0.2, 1.2], len(model.friction_names))
            tension = rng.uniform(0.5, 1.0) * model.finger.tendons.max_tension
            u[:] = 0.0 if model.structure.winches else tension
            x[2 * model.n :] = [*model.drives_at(x[: model.n], u, states, pulled=tension, p=p), *states]
        jacobian = np.array(model.linearization(x, u, np.zeros(model.nw), p)[0])
        fastest = max(fastest, np.abs(np.linalg.eigvals(jacobian)).max())
    assert 0.3 * subject.radius < fastest <= 1.05 * subject.radius
    assert subject.longest_step * subject.radius == pytest.approx(STABLE, rel=0.01)


@needs("cc")
@pytest.mark.parametrize("beyond", [False, True])
def test_winches_that_pull_harder_than_they_may_are_refused(beyond, packages, tmp_path):
    """Straight, a tendon pulls as hard as its pretension and stiffness times what is wound up."""
    finger, library = shared_library(packages("winches", "double"), tmp_path)
    model = FingerModel(scene("winches"))
    (tendon, _), winch = model.finger.tendon_list, model.structure.winches[0]
    wound = (tendon.max_tension * (1.01 if beyond else 0.99) - tendon.drive.pretension) / winch.stiffness
    state = finger.State()
    state.length_1 = wound
    if beyond:
        with pytest.raises(finger.Error, match="out of its range"):
            library.dynamics(state, finger.Input())
    else:
        assert library.dynamics(state, finger.Input()).theta_1_rate != 0.0


@needs("cc")
@pytest.mark.parametrize("name", NAMES)
def test_at_the_longest_step_the_motion_dies_out(name, packages, tmp_path):
    finger, library = shared_library(packages(name, "double"), tmp_path)
    longest = json.loads((packages(name, "double") / "MANIFEST.json").read_text())["stability"]["longest_step_s"]
    acting = [finger.Input()] + ([finger.Forces()] if hasattr(finger, "Forces") else [])
    state, sizes = finger.State(), []
    first = finger.State._fields_[0][0]
    setattr(state, first, 0.2)
    for _ in range(4000):
        state = library.step(state, *acting, longest)
        sizes.append(abs(getattr(state, f"{first}_rate")))
    assert max(sizes[-400:]) < 0.1 * max(sizes[:400])


def test_sub_steps_are_steps():
    model = FingerModel(scene("arcs"))
    one, four = (Subject.of(model, "finger", CReal.KINDS["double"], {}, count=count) for count in (1, 4))
    assert four.longest_step == pytest.approx(4 * one.longest_step, rel=0.01)
    rows = {"p": np.zeros((1, 0)), "u": np.array([[5.0, 1.0]]), "w": np.zeros((1, 0))}
    x = np.array([[0.2, -0.1, 1.0, 2.0, 0.0, 0.0]])
    at, h = x, 2e-3
    for _ in range(4):
        at = PARTS["step"](one).calls[0].reference({**rows, "x": at, "h": np.array([[h / 4]])})[0]
    found = PARTS["step"](four).calls[0].reference({**rows, "x": x, "h": np.array([[h]])})[0]
    assert np.abs(found - at).max() <= 1e-14 * np.abs(at).max()


@needs("cc")
@pytest.mark.parametrize("what", [["step"], ["statics"], None])
def test_the_ten_lines_of_the_readme_compile(what, tmp_path):
    given = load(ROOT / "configs/simulate/swing_against_disc.yaml", {"fidelity.family": "arc"})
    export_c(given, tmp_path, what=what)
    text = (tmp_path / "README.md").read_text()
    include, *lines = re.search("```c\n(.*?)```", text, re.DOTALL)[1].strip().splitlines()
    body = "\n".join(lines)
    main = f"{include}\nextern void report(const char *text);\nint main(void) {{\n{body}\nreturn code;\n}}\n"
    (tmp_path / "main.c").write_text(main)
    run("cc", "-std=c99", "-Wall", "-Werror", "-fsyntax-only", f"-I{tmp_path / 'include'}", tmp_path / "main.c")


def test_an_earlier_package_is_replaced_and_nothing_else(tmp_path):
    """No source of it stays behind; what its user wrote or changed does."""
    export_c(scene("arcs"), tmp_path, what=["step"])
    (tmp_path / "notes.txt").write_text("mine")
    made = export_c(scene("arcs"), tmp_path, what=["kinematics"], prefix="tip")
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {*made.files, "notes.txt"}
    board = tmp_path / "examples/baremetal/board.ld"
    for changed in (board, tmp_path / "MANIFEST.json"):
        before = changed.read_text()
        changed.write_text("{}")
        with pytest.raises(InputError, match="has changed since its export"):
            export_c(scene("arcs"), tmp_path, what=["step"], prefix="tip")
        assert (changed.read_text(), (tmp_path / "README.md").stat().st_size > 1000) == ("{}", True)
        changed.write_text(before)
    assert not (tmp_path / "examples/loop.c").exists()


def test_the_configuration_hash_tells_apart_what_computes_differently(tmp_path):
    """Sub-steps, nominal values and ranges too, although the kernels are the same."""
    model = scene("arcs").model_copy(update={"parameters": ("tip_mass",)})
    tip = model.finger.masses[0]
    heavier = model.finger.model_copy(update={"masses": (tip.model_copy(update={"mass": 1.5 * tip.mass}),)})
    asked = [(model, {}), (model, {}), (model, {"substeps": 2}), (model, {"ranges": {"tip_mass": (0.0, 0.01)}})]
    asked.append((model.model_copy(update={"finger": heavier}), {"ranges": {"tip_mass": (0.0, 0.01)}}))
    hashes = [
        export_c(given, tmp_path, what=["step"], **keywords).manifest["configuration_hash"] for given, keywords in asked
    ]
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 4


def test_the_number_of_the_interface_changes_with_whatever_a_caller_sees(tmp_path):
    """The longest step, a range, a name; not with what is computed behind the same header."""
    made = {
        name: export_c(given, tmp_path, what=["step"], **more).manifest
        for name, (given, more) in {
            "one": (scene("arcs"), {}),
            "title": (scene("arcs").model_copy(update={"name": "another"}), {}),
            "substeps": (scene("arcs"), {"substeps": 2}),
            "gravity": (scene("arcs").model_copy(update={"gravity": (0.0, -9.0)}), {}),
            "kind": (scene("arcs"), {"real": "float"}),
        }.items()
    }
    assert made["one"]["abi"] == made["title"]["abi"]
    assert made["one"]["stability"]["longest_step_s"] != made["substeps"]["stability"]["longest_step_s"]
    assert len({made[name]["abi"] for name in ("one", "substeps", "kind")}) == 3
    steps = [
        [made[name]["stability"][f"{kind}_step_s"] for kind in ("longest", "accurate")] for name in ("one", "gravity")
    ]
    assert (made["one"]["abi"] == made["gravity"]["abi"]) == (steps[0] == steps[1])
    assert made["one"]["configuration_hash"] != made["gravity"]["configuration_hash"]


@needs("cc")
def test_another_configuration_is_reported_at_run_time(packages, tmp_path):
    finger, library = shared_library(packages("arcs", "double"), tmp_path)
    stated = json.loads((packages("arcs", "double") / "MANIFEST.json").read_text())["configuration_hash"]
    asked = {finger.CONFIGURATION: 0, "": -7, stated[:-1]: -7, f"{stated}0": -7, "0" * 16: -7}
    for configuration, code in asked.items():
        assert library._c.finger_check_built(ctypes.c_uint32(finger.ABI), configuration.encode()) == code
    assert library._c.finger_check_built(ctypes.c_uint32(finger.ABI ^ 1), stated.encode()) == Code.ERR_ABI
    assert library._c.finger_check_built(ctypes.c_uint32(finger.ABI), None) == Code.ERR_NULL
    with pytest.raises(finger.Error, match="another configuration"):
        finger.Library(str(tmp_path / "libfinger.so"), configuration="0" * 16)
    finger.Library(str(tmp_path / "libfinger.so"), configuration=None)
    (tmp_path / "main.c").write_text('#include "finger.h"\nint main(void) { return finger_check(); }\n')
    sources = (packages("arcs", "double") / "src").glob("*.c")
    run(
        "cc",
        *STRICT,
        f"-I{packages('arcs', 'double') / 'include'}",
        tmp_path / "main.c",
        *sources,
        "-o",
        tmp_path / "main",
    )
    run(tmp_path / "main")


@pytest.mark.parametrize("feature", FEATURES, ids=lambda one: one.name)
def test_every_number_has_a_name_that_c_takes(feature):
    scene = scene_of(Scene, feature, {"fidelity": {"family": "arc", "elements": 2}})
    moving = FingerModel(scene) if scene.object is None else System(scene)
    of = ModelFields(moving)
    fields = (*of.states(), *of.inputs(), *of.forces())
    assert [field.name for field in fields if not re.fullmatch(r"[A-Za-z]\w*", field.name)] == []
    assert {"", None}.isdisjoint(field.unit for field in fields)


@needs("cc")
def test_a_name_means_nothing_to_a_language(tmp_path):
    """What ends a comment, or is syntax of XML, pkg-config or CMake; letters of any script stay."""
    name = "**// doigt <é> & /* `id` ${HOME} @PROJECT_NAME@ #1 ??/ \\"
    export_c(scene("arcs").model_copy(update={"name": name}), tmp_path, what=["step"])
    header = tmp_path / "include/finger.h"
    run("cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-x", "c", "-fsyntax-only", header)
    assert header.read_text().startswith("/* // doigt é / id HOME PROJECT_NAME 1 /\n")
    assert "doigt é / id HOME" in (tmp_path / "finger.pc.in").read_text()
    assert json.loads((tmp_path / "MANIFEST.json").read_text())["configuration"]["name"] == name


# Refusals.


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"real": "half"}, "expected one of double, float"),
        ({"real": "double", "target": "cortex-m4f"}, "computes double in software"),
        ({"target": "avr"}, "expected one of host, cortex-m4f, cortex-m7, wasm"),
        ({"what": ["mpc2"]}, "expected some of dynamics, step, implicit_step, kinematics, statics"),
        ({"what": ["mpc"]}, "needs a closed loop"),
        ({"what": []}, "one part or more"),
        ({"what": ["step", "step"]}, "each once"),
        ({"prefix": "2f"}, "expected a C identifier"),
        ({"prefix": "double"}, "expected a C identifier"),
        ({"prefix": "Finger"}, "expected a C identifier"),
        ({"prefix": "string"}, "not a word, header"),
        ({"prefix": "test"}, "not a word, header"),
        ({"prefix": "board"}, "not a word, header"),
        ({"prefix": "lambda"}, "not a word, header"),
        ({"prefix": "a__b"}, "single underscores between"),
        ({"prefix": "finger_"}, "single underscores between"),
        ({"substeps": 0}, "whole number from 1 to 1000"),
        ({"step": 0.1, "substeps": 1}, r"needs \d+ sub-steps"),
        ({"step": 1e4}, r"would need 1.86e\+06 sub-steps: with 1000"),
        ({"step": 0.0}, "number above 0"),
        ({"step": float("nan")}, "expected a number"),
        ({"error": -1.0}, "number above 0"),
        ({"error": float("nan")}, "expected a number"),
        ({"ranges": {"tip_mass": (0.0, 1.0)}}, "not a run-time parameter"),
        ({"real": "float", "error": 1e-9}, "relative error of"),
        # Before anything is computed: else the error would come first.
        ({"measured": True, "real": "float", "error": 1e-9}, "no emulated board"),
        ({"given": 17}, "given: expected a FingerModel, a Scene, .* or the path of its file, got 17"),
        *[
            ({"given": scene("friction"), "ranges": {"tip_mass": values}}, message)
            for values, message in (
                ((0.01, 0.02), "leaves out the nominal value"),
                ((0.02, 0.01), "a least and a greatest value"),
                ((-0.01, 0.01), "cannot be negative"),
                ((0.0, float("inf")), "a least and a greatest value"),
            )
        ],
    ],
)
def test_what_cannot_be_made_is_refused(keywords, message, tmp_path):
    with pytest.raises(InputError, match=message):
        export_c(**{"given": scene("arcs"), "folder": tmp_path / "out", **keywords})
    assert not (tmp_path / "out").exists()


# The names of C that is no comment, no string and no member: functions, types, macros, variables.
_PROSE = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\])*"', re.DOTALL)
_DEFINED = re.compile(r"^(?:#define +(\w+)|\} (\w+);|(?!return\b)\w[\w *]*?\b(\w+)(?=\(|\[| = ))", re.MULTILINE)


@pytest.mark.parametrize("name", ["observed", "arcs", "seen", "implicit"])
def test_no_prefix_makes_a_name_that_the_package_has_already(name, packages):
    """A name without the prefix is none of those that have it with another word for it; ``board.h`` is refused."""
    own, behind = set(), set()
    for path in packages(name, "double").rglob("*.[ch]"):
        text = _PROSE.sub("", path.read_text())
        own |= {next(filter(None, found)) for found in _DEFINED.findall(text)}
        behind |= {found.lower() for found in re.findall(r"\bfinger_(\w+)", text, re.IGNORECASE)}
    own = {found.lower() for found in own if not found.lower().startswith("finger_")}
    assert {"board_h", "check_rows", "codes_agree"} <= own
    assert any(found.endswith("_read") for found in own)
    clashes = {(found, one) for found in own for one in behind if found.endswith(f"_{one}")}
    assert clashes <= {("board_h", "h")}


@needs("cc")
def test_a_prefix_may_be_the_first_word_of_names_in_the_controller(tmp_path):
    package = export_c(scene("given"), tmp_path, what=["mpc"], prefix="loop")
    for path in package.files:
        if path.endswith(".c") and path.startswith(("src/", "tests/ch", "examples/co")):
            places = [f"-I{tmp_path / place}" for place in ("include", "src", "tests")]
            run("cc", *STRICT, *WARNINGS, "-fsyntax-only", *places, tmp_path / path)


@pytest.mark.parametrize(("weight", "most"), [(9.81, 20.0), (15.0, 30.0)])
def test_a_finger_that_is_carried_along_may_turn_any_way_and_move(weight, most):
    """Gravity up to 20 m/s2 or twice the nominal one, both ways; the base by two lengths and a turn."""
    names = ("base_angle", "base_position", "gravity")
    fields = ModelFields(FingerModel(two_arcs().finger, gravity=(0.0, -weight), parameters=names)).parameters()
    found = {field.name: (field.low, field.high) for field in fields}
    length = two_arcs().finger.rod.length
    assert found == {
        "base_angle": pytest.approx((-2.0 * math.pi, 2.0 * math.pi)),
        **{f"base_position_{axis}": pytest.approx((-2.0 * length, 2.0 * length)) for axis in "xy"},
        "gravity_x": (-20.0, 20.0),
        "gravity_y": (-most, most),
    }


def test_a_step_does_not_matter_where_nothing_steps(tmp_path):
    """A stiff scene may still be asked where its tip is."""
    model = FingerModel(scene("tendons"))
    with pytest.raises(InputError, match="are too long"):
        export_c(model, tmp_path, what=["step"], step=1.0, substeps=1)
    assert "tip" in export_c(model, tmp_path, what=["kinematics"], step=1.0).manifest["functions"]


def test_steps_that_the_return_of_dry_friction_does_not_allow_are_refused(tmp_path):
    """Runge-Kutta steps beyond 2.79 ms diverge at the rate of 1000 1/s at which a state returns to its range."""
    given = scene("arcs").changed({"finger.damping.dry_friction": [{"stiffness": 0.02, "moment": 0.03}]})
    export_c(given, tmp_path / "short", what=["step"], step=0.002, substeps=1)
    with pytest.raises(InputError, match="too long"):
        export_c(given, tmp_path / "long", what=["step"], step=0.004, substeps=1)
    export_c(scene("arcs"), tmp_path / "without", what=["step"], step=0.004, substeps=1)


def test_steps_bear_the_quadratic_damping_of_a_finger_that_springs_back():
    """From half of its bending range, from which sub-steps for a finger at rest end in numbers that are not finite."""
    given = scene("arcs").changed({"finger.damping.quadratic": 1e-5})
    subject = Subject.of(FingerModel(given), "finger", CReal.KINDS["double"], {}, longest=1e-3)
    rows = {"p": np.zeros((1, 0)), "u": np.zeros((1, 2)), "w": np.zeros((1, 0)), "h": np.full((1, 1), 1e-3)}
    x = np.zeros((1, subject.model.nx))
    x[0, :2] = bend = 0.5 * np.array([field.high for field in subject.state.fields[:2]])
    for _ in range(3):
        x, codes = PARTS["step"](subject).calls[0].reference({**rows, "x": x})
        assert codes[0] >= 0
    assert 0.5 * bend.sum() < x[0, :2].sum() < bend.sum()


def test_a_parameter_of_zero_needs_its_range(tmp_path):
    model = FingerModel(scene("tendons").finger, family="arc", parameters=("per_arc_damping",))
    with pytest.raises(InputError, match="per_arc_damping: its nominal value is zero"):
        export_c(model, tmp_path)
    made = export_c(model, tmp_path, ranges={"per_arc_damping": (0.0, 1e-4)}).manifest
    assert made["structs"]["parameters"][0]["high"] == 1e-4


def test_a_range_that_single_precision_cannot_hold_is_refused(tmp_path):
    """The downward recursion multiplies rounding by powers of the bend."""
    for bend, holds in ((2.0, True), (6.0, False)):
        model = FingerModel(scene("tendons").finger, family="arc", elements=2, bending_range=bend, accuracy=1e-6)
        if holds:
            export_c(model, tmp_path, real="float", what=["kinematics"], error=1e-6)
            continue
        with pytest.raises(InputError, match=r"float gives \w+ a relative error of"):
            export_c(model, tmp_path, real="float", what=["kinematics"], error=1e-6)


def test_a_wider_parameter_shortens_the_step():
    """A lighter tip moves faster."""
    model = FingerModel(scene("friction"))
    light, heavy = (
        Subject.of(model, "finger", CReal.KINDS["double"], {"tip_mass": pair}) for pair in ((0.0, 2e-3), (2e-3, 5e-3))
    )
    assert light.longest_step < heavy.longest_step


def test_a_model_whose_accelerations_would_be_lost_says_so(tmp_path):
    slender = Finger(rod=ROD.model_copy(update={"rotary_inertia": 0.0}))
    with pytest.raises(InputError, match="fewer elements"):
        export_c(FingerModel(slender, family="arc", elements=32), tmp_path, what=["kinematics"], real="float")
    export_c(FingerModel(slender, family="arc", elements=8), tmp_path, what=["kinematics"], real="float")


@pytest.mark.parametrize("name", ["arcs", "friction", "winches", "motor", "contact", DISC, MUG], ids=str)
def test_every_argument_has_a_range(name):
    given = cg.load(name) if not isinstance(name, str) else scene(name)
    source = source_of(given, CReal.KINDS["double"])
    own = Subject.of(source.finger, "finger", CReal.KINDS["double"], {}, source.surroundings)
    touches = ["contact"] if isinstance(name, Path) else []
    calls = [call for part in ("dynamics", "kinematics", "shape", *touches) for call in PARTS[part](own).calls]
    fields = [field for call in calls for taken in own.passed_to(call) for field in taken.fields]
    assert [field.name for field in fields if not (np.isfinite(field.low) and field.low < field.high < np.inf)] == []
    for field in fields:  # usual values are well within it
        low, high = field.sampled
        assert field.low <= low < high <= field.high
