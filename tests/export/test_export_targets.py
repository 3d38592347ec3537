"""The same bits elsewhere: ARM, big-endian machines, microcontrollers, WebAssembly; and what a step costs there."""

from __future__ import annotations

import json
import os
import re
import subprocess

import pytest

from continuum_grasp.base import SolverError
from continuum_grasp.core import CReal
from continuum_grasp.export import Code, export_c
from tests.export_cases import STRICT, TENDONS, compile_programs, needs, run, scene, two_arcs
from tests.rods import ROOT

pytestmark = pytest.mark.deep

ELSEWHERE = {
    "ARM": ("arm-linux-gnueabihf-gcc -static", "qemu-arm", ()),
    "big-endian POWER": ("powerpc-linux-gnu-gcc -static", "qemu-ppc", ()),
    "big-endian s390x": ("s390x-linux-gnu-gcc -static", "qemu-s390x", ("-fexcess-precision=fast",)),
}
COUNTED = {("float", "cortex-m4f"): 2324, ("double", "cortex-m7"): 2667}
"""Instructions of a step of two arcs, checks included."""
LIMITS = {"cortex-m4f": 5492, "cortex-m7": 6736}
"""What a trial with another formulation took."""
COMPILER = "12.2"
"""Version of the compiler that the counts are of."""


MACHINES = pytest.mark.parametrize(
    "machine",
    [pytest.param(k, marks=needs(compiler.split()[0], emulator)) for k, (compiler, emulator, _) in ELSEWHERE.items()],
)
LOOPS = {("given", "double"): 1, ("observed", "float"): 2}
"""Functions of packages with a controller."""
CONTROLLED = {("float", "cortex-m4f"): 204_320, ("double", "cortex-m7"): 220_000}
"""Instructions of a call of a controller that goes on from a plan: 8 stages, two tensions, curvature bounded."""
CONTROL_LIMITS = {"cortex-m4f": 568_000, "cortex-m7": 589_000}


@pytest.mark.parametrize("real", CReal.KINDS)
@MACHINES
def test_every_vector_to_the_bit_elsewhere(machine, real, packages, tmp_path):
    compiler, emulator, flags = ELSEWHERE[machine]
    (program,) = compile_programs(compiler, packages("friction", real), tmp_path, "main", *STRICT, *flags, "-O2")
    assert len(re.findall(r" 0 of +\d+ cases failed", run(emulator, program))) == 5


@pytest.mark.parametrize(("name", "real"), LOOPS)
@MACHINES
def test_a_controller_to_the_bit_elsewhere(machine, name, real, packages, tmp_path):
    compiler, emulator, flags = ELSEWHERE[machine]
    (program,) = compile_programs(compiler, packages(name, real), tmp_path, "main", *STRICT, *flags, "-O1")
    assert len(re.findall(r" 0 of +\d+ cases failed", run(emulator, program))) == LOOPS[name, real]


@needs("arm-none-eabi-gcc", "qemu-system-arm")
@pytest.mark.parametrize(("real", "target"), CONTROLLED)
def test_a_controller_on_a_microcontroller(real, target, tmp_path):
    """To the bit, and in no more instructions than it took; those without a plan and hard ones are counted apart."""
    made = export_c(scene("given"), tmp_path, real=real, target=target, measured=True).manifest["measured"]
    assert made["failures"] == 0
    assert all(size["data"] == size["bss"] == 0 for size in made["sizes"].values())
    assert set(made["functions"]) == {"mpc", "mpc_start", "mpc_hard"}
    most = made["functions"]["mpc"]["most_instructions"]
    assert most < CONTROL_LIMITS[target]
    if COMPILER in made["compiler"]:
        assert most <= 1.02 * CONTROLLED[real, target]
    assert made["functions"]["mpc"]["stack_bytes"] < 8000


@needs("arm-none-eabi-gcc")
def test_a_controller_of_clothoids_fits_into_100_kilobytes(tmp_path):
    """Two matched clothoids, 30 stages, estimator: most of it one slope with its Jacobian, which all steps call."""
    package = export_c(ROOT / "configs/mpc/steady_tip.yaml", tmp_path, prefix="control", target="cortex-m4f")
    toolchain = tmp_path / "cmake/cortex-m4f.cmake"
    flags = re.search(r'C_FLAGS_INIT "(.*)"', toolchain.read_text())[1].split()
    sources = [path for path in package.files if re.fullmatch(r"src/.*\.c", path)]
    objects = [tmp_path / f"{path.replace('/', '_')}.o" for path in sources]
    for source, built in zip(sources, objects, strict=True):
        line = ["arm-none-eabi-gcc", *flags, *STRICT, "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
        run(*line, f"-I{tmp_path / 'include'}", "-c", tmp_path / source, "-o", built)
    table = run("arm-none-eabi-size", *objects).splitlines()[1:]
    text, data, bss = (sum(int(row.split()[k]) for row in table) for k in range(3))
    assert text <= 100_000
    assert data == bss == 0


@needs("arm-none-eabi-gcc", "qemu-system-arm")
@pytest.mark.parametrize(("real", "target"), [*COUNTED, ("float", "cortex-m7")])
def test_every_vector_to_the_bit_on_a_microcontroller(real, target, tmp_path):
    made = export_c(scene("friction"), tmp_path, real=real, target=target, measured=True, substeps=12).manifest[
        "measured"
    ]
    assert made["failures"] == 0
    assert made["sizes"]["finger_kernels.o"]["data"] == made["sizes"]["finger.o"]["bss"] == 0
    assert set(made["functions"]) == {"dynamics", "step", "tip", "section_at", "statics"}


@needs("arm-none-eabi-gcc", "qemu-system-arm")
@pytest.mark.parametrize(("real", "target"), COUNTED)
def test_the_step_takes_no_more_instructions_than_it_did(real, target, tmp_path):
    made = export_c(two_arcs(), tmp_path, real=real, target=target, measured=True).manifest["measured"]
    most = made["functions"]["step"]["most_instructions"]
    assert most < LIMITS[target]
    if COMPILER in made["compiler"]:
        assert most <= 1.02 * COUNTED[real, target]
    least, mean = (made["functions"]["step"][f"{which}_instructions"] for which in ("least", "mean"))
    assert least <= mean <= most
    assert f"| step | {least} | {mean} | {most} |" in (tmp_path / "README.md").read_text()


@needs("arm-none-eabi-gcc", "cmake", "make")
@pytest.mark.parametrize("core", ["m4f", "m7"])
def test_toolchain_files(core, packages, tmp_path):
    package = packages("tendons", "float")
    options = (
        "-DFINGER_TESTS=OFF",
        "-DFINGER_EXAMPLES=OFF",
        f"-DCMAKE_TOOLCHAIN_FILE={package}/cmake/cortex-{core}.cmake",
    )
    run("cmake", "-S", package, "-B", tmp_path, *options)
    run("cmake", "--build", tmp_path)
    said = run("arm-none-eabi-readelf", "-A", *tmp_path.rglob("finger_kernels*.obj"))
    assert "Tag_ABI_VFP_args: VFP registers" in said
    assert {"m4f": "Tag_FP_arch: VFPv4-D16", "m7": "Tag_FP_arch: FPv5/FP-D16"}[core] in said


@needs("clang", "wasm-ld", "node")
@pytest.mark.parametrize("real", CReal.KINDS)
def test_every_vector_to_the_bit_in_webassembly(real, packages, tmp_path):
    package = packages("friction", real, "wasm")
    run("sh", package / "wasm/build.sh", tmp_path)
    said = run("node", tmp_path / "test.mjs")
    assert len(re.findall(r"^0 of \d+ cases", said, re.MULTILINE)) == 5
    assert (tmp_path / "finger.wasm").stat().st_size < 60_000


@needs("clang", "wasm-ld", "node")
@pytest.mark.parametrize(("name", "real"), LOOPS)
def test_a_controller_to_the_bit_in_webassembly(name, real, packages, tmp_path):
    run("sh", packages(name, real, "wasm") / "wasm/build.sh", tmp_path)
    (tmp_path / "use.mjs").write_text(
        """
import { readFile } from "node:fs/promises";
import { load } from "./finger.mjs";
const finger = await load(await readFile("finger.wasm"));
const one = finger.new_controller(), other = finger.new_controller();
const row = (value) => new Array(9).fill(value);
const wanted = { bending_1: row(0.5), bending_2: row(0.4), tension_1: row(1), tension_2: row(1) };
other.settings.most_tension_1 = 3;
const answers = [one, other].map((c) => c.step({ tip_y: 0.18, tension_1: 1, tension_2: 1 }, wanted).command);
let refused = "";
other.settings.most_tension_1 = 99;
try { other.step({}, wanted); } catch (error) { refused = error.message; }
let missing = "";
try { one.applied({ tension_1: 1 }); } catch (error) { missing = error.message; }
const short = finger.new_controller(), whole = finger.new_controller();
const expected = { tip_x: NaN, tip_y: 0.18, tension_1: NaN, tension_2: NaN };
const same = [];
for (let k = 0; k < 10; ++k) {
  const wish = { bending_1: row(0.5) };
  const commands = [short.step({ tip_y: 0.18 }, wish), whole.step(expected, { ...finger.begin("reference"), ...wish })];
  same.push(JSON.stringify(commands[0]) === JSON.stringify(commands[1]));
}
const io = finger.new_controller().direct(), plain = finger.new_controller(), equal = [];
for (let k = 0; k < 10; ++k) {
  const { at } = finger.layout("reference").bending_1;
  io.reference.fill(0.5, at, at + 9);
  io.measurement[finger.layout("measurement").tip_y.at] = 0.18 - 0.002 * k;
  const code = io.call(), other = plain.step({ tip_y: 0.18 - 0.002 * k }, { bending_1: row(0.5) });
  equal.push(code === other.code && Object.values(other.command).every((value, i) => value === io.command[i]));
}
short.late();
short.applied({ tension_1: 0, tension_2: 0 });
const late = short.step({ tip_y: 0.18 });
const beside = { code: late.code, diagnosis: short.diagnosis(), estimate: short.estimate() };
short.start({ ...finger.begin("estimate"), theta_1: 0.25 }, finger.begin("command"));
const filter = finger.new_estimator();
const estimate = filter.step({ tip_y: 0.18 }, { tension_1: 0, tension_2: 0 });
filter.start(beside.estimate, { tension_1: 0, tension_2: 0 });
const filtered = { code: estimate.code, variance: filter.variance(), anomalies: filter.anomalies() };
const begun = finger.begin("reference"), direct = { equal, moved: io.command[0] };
console.log(JSON.stringify({ answers, refused, missing, same, direct, beside, filtered, begin: begun }));
"""
    )
    said = run("node", tmp_path / "test.mjs")
    assert len(re.findall(r"^0 of \d+ cases", said, re.MULTILINE)) == LOOPS[name, real]
    if name == "observed":
        used = json.loads(run("node", "use.mjs", cwd=tmp_path))
        free, limited = (answer["tension_1"] for answer in used["answers"])
        assert free > 3.0
        assert 1.0 <= limited <= 3.0 + 1e-5
        assert "out of its range (-3)" in used["refused"]
        assert used["missing"] == "command: tension_2 missing"
        assert used["same"] == [True] * 10
        assert used["direct"]["equal"] == [True] * 10
        assert used["direct"]["moved"] > 3.0
        assert used["beside"]["code"] == Code.WARN_PREVIOUS_PLAN
        assert used["beside"]["diagnosis"]["anomalies"] == 1024 + 1
        assert used["beside"]["estimate"]["theta_1"] != 0.0
        assert used["filtered"]["code"] == 0
        assert used["filtered"]["anomalies"] == 0
        assert min(used["filtered"]["variance"].values()) > 0.0
        assert used["begin"] == {"bending_1": [0.0] * 9, "bending_2": [0.0] * 9} | {
            f"tension_{k}": [1.0] * 9 for k in (1, 2)
        }


@needs("clang", "wasm-ld", "node")
def test_the_javascript_wrapper_gives_the_numbers_of_the_model(packages, tmp_path):
    from continuum_grasp.model import FingerModel

    run("sh", packages("friction", "double", "wasm") / "wasm/build.sh", tmp_path)
    (tmp_path / "use.mjs").write_text(
        """
import { readFile } from "node:fs/promises";
import { load } from "./finger.mjs";
const finger = await load(await readFile("finger.wasm"));
finger.parameters.tip_mass = 0.004;
const state = { ...finger.begin("state"), theta_1: 0.3, theta_2: -0.2 }, input = { tension_1: 3, tension_2: 1 };
const tip = finger.section_at(state, input, 0.1).section, rate = finger.dynamics(state, input).rate;
let refused = "";
try { finger.dynamics({ ...state, theta_1: 99 }, input); } catch (error) { refused = error.message; }
let unknown = "";
try { finger.dynamics({ theta1: 0 }, input); } catch (error) { unknown = error.message; }
let missing = "";
try { finger.dynamics(state, { tension_1: 3 }); } catch (error) { missing = error.message; }
console.log(JSON.stringify({ tip, rate, refused, unknown, missing, parameters: finger.parameters }));
"""
    )
    said = json.loads(run("node", "use.mjs", cwd=tmp_path))
    model = FingerModel(scene("friction"))
    p = [said["parameters"][name.split(" ")[0]] for name in model.p_names]
    q, u = [0.3, -0.2], [3.0, 1.0]
    r = model.position(q, u, 0.1, p)
    assert [said["tip"]["x"], said["tip"]["y"]] == pytest.approx([float(r[0]), float(r[1])], rel=1e-12)
    xd = model.forward_dynamics([*q, *[0] * (model.nx - 2)], u, [], p)
    assert list(said["rate"].values()) == pytest.approx([float(v) for v in xd.full().ravel()], rel=1e-9)
    assert "out of its range (-3)" in said["refused"]
    assert "there is no theta1" in said["unknown"]
    assert said["missing"] == "input: tension_2 missing"


def test_a_measurement_that_does_not_end_says_so(tmp_path, monkeypatch):
    """On a board that is there by name alone."""
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        (tmp_path / tool).write_text("#!/bin/sh\n")
        (tmp_path / tool).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    ends = subprocess.run

    def hangs(line, **options):
        if str(line[1]).endswith("baremetal/run.sh"):
            raise subprocess.TimeoutExpired(line, 600.0)
        return ends(line, **options)

    monkeypatch.setattr(subprocess, "run", hangs)
    with pytest.raises(SolverError, match="did not end on cortex-m7 within 600 s"):
        export_c(TENDONS, tmp_path / "package", what=["kinematics"], target="cortex-m7", measured=True)
