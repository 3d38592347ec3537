"""The written C: compiles without a warning, moves as Python does, and is the same when written again."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess

import pytest
from typer.testing import CliRunner

from continuum_grasp.cli import app
from continuum_grasp.core import codegen
from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.model.finger_model import FUNCTIONS
from continuum_grasp.scene.load import load
from continuum_grasp.simulation import simulate
from tests.rods import ROOT, without_compiler  # noqa: F401

RELEASE = ROOT / "configs/simulate/nitinol_release_020g.yaml"
STEP = ROOT / "configs/simulate/tendon_step.yaml"
CONTACT = ROOT / "configs/simulate/midpoint_contact.yaml"
NUMBER = r"(-?\d[-+.\de]*)"

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


def write(config, folder, *settings):
    """Write the C of a configuration by the command line."""
    changes = [part for setting in settings for part in ("--set", setting)]
    result = CliRunner().invoke(app, ["codegen", str(config), "--out", str(folder), *changes])
    assert result.exit_code == 0, result.output
    return sorted(path.name for path in folder.iterdir() if path.name[0] != ".")


def build_and_run(folder, *flags):
    """The tip that the example prints and the one that it expects [m]."""
    line = re.search(r"^ \*   (cc .*?) && (\S+)$", (folder / "main.c").read_text(), re.MULTILINE)
    compiler, *arguments = shlex.split(line.group(1))
    built = subprocess.run([compiler, *arguments, *flags], cwd=folder, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert built.stderr == ""
    said = subprocess.run([line.group(2)], cwd=folder, capture_output=True, text=True, check=True).stdout
    found = re.fullmatch(rf"tip after 1 s: {NUMBER} {NUMBER} m\nexpected: +{NUMBER} {NUMBER} m\n", said)
    values = [float(v) for v in found.groups()]
    return values[:2], values[2:]


@needs_compiler
@pytest.mark.parametrize(
    ("config", "settings"),
    [
        (RELEASE, ()),
        (RELEASE, ("fidelity.family=arc", "fidelity.elements=2", "parameters=[tip_mass, gravity]")),
        (RELEASE, ("fidelity.family=clothoid", "fidelity.elements=2")),
        (STEP, ()),
        (CONTACT, ()),
    ],
    ids=["release", "arcs with parameters", "clothoids", "tendons with lag", "contact"],
)
def test_the_example_prints_what_it_expects(config, settings, tmp_path):
    assert write(config, tmp_path, *settings) == ["finger.c", "finger.h", "main.c"]
    tip, expected = build_and_run(tmp_path, "-Wall")
    assert tip == pytest.approx(expected, abs=1e-9)


@needs_compiler
def test_the_example_moves_as_the_simulation_does(tmp_path):
    write(RELEASE, tmp_path)
    scene = load(RELEASE, {"time.method": "rk4"})
    assert build_and_run(tmp_path, "-Wall", "-O1")[0] == pytest.approx(simulate(scene).tip[-1], abs=1e-9)


@needs_compiler
def test_a_large_model_needs_work_space_and_gets_it(tmp_path):
    """A step that is too long to be written out calls the dynamics and uses the caller's arrays."""
    write(RELEASE, tmp_path, "fidelity.accuracy=1e-13", "fidelity.bending_range=6.0")
    example = (tmp_path / "main.c").read_text()
    assert int(re.search(r"double work\[(\d+)\]", example).group(1)) > 1
    text = example.replace("cc -O3", "cc -O0 -g -fsanitize=address,undefined -fno-sanitize-recover")
    (tmp_path / "main.c").write_text(text)
    tip, expected = build_and_run(tmp_path, "-Wall")
    assert tip == pytest.approx(expected, abs=1e-9)


@needs_compiler
def test_a_stiff_scene_gets_an_example_that_runs(tmp_path):
    """With 6 clothoids explicit steps of 1 ms diverge."""
    write(RELEASE, tmp_path, "fidelity.family=clothoid", "fidelity.elements=6")
    tip, expected = build_and_run(tmp_path, "-Wall", "-O0")
    assert tip == pytest.approx(expected, abs=1e-9)


def test_written_again_it_is_the_same(tmp_path, without_compiler):  # noqa: F811
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        names = write(STEP, folder)
    for name in names:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_every_function_is_declared_under_the_prefix(tmp_path, without_compiler):  # noqa: F811
    model = FingerModel(load(RELEASE))
    files = codegen(model, tmp_path / "new" / "folder", x0=[0.1, 0.2, 0.0, 0.0], prefix="rod_2")
    assert [file.name for file in files] == ["rod_2.c", "rod_2.h", "main.c"]
    header = files[1].read_text()
    for name in (*FUNCTIONS, "rk4_step"):
        assert f"int rod_2_{name}(" in header
    example = files[2].read_text()
    assert '#include "rod_2.h"' in example
    assert "The tip moment must not change during a motion" in example
    free = codegen(FingerModel(load(RELEASE), family="clothoid"), tmp_path / "free")[2].read_text()
    assert "must not change" not in free


@needs_compiler
def test_two_prefixes_link_into_one_program(tmp_path, without_compiler):  # noqa: F811
    """No symbol of the two files is the same."""
    for prefix, family in (("a", "arc"), ("b", "matched_clothoid")):
        codegen(FingerModel(load(RELEASE), family=family), tmp_path, prefix=prefix)
    (tmp_path / "main.c").write_text('#include "a.h"\n#include "b.h"\nint main(void) { return a_tip == b_tip; }\n')
    line = ["cc", "-Wall", "main.c", "a.c", "b.c", "-lm", "-o", "both"]
    built = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    subprocess.run([tmp_path / "both"], check=True)


@pytest.mark.parametrize("prefix", ["", "2nd", "a-b", "finger.c", "größe"])
def test_a_prefix_that_is_no_identifier_is_refused(prefix, tmp_path):
    with pytest.raises(InputError, match="C identifier"):
        codegen(FingerModel(load(RELEASE)), tmp_path, prefix=prefix)


def test_a_state_of_the_wrong_size_is_refused(tmp_path):
    model = FingerModel(load(RELEASE))
    for name in ("x0", "u", "w"):
        with pytest.raises(InputError, match=f"{name}: expected"):
            codegen(model, tmp_path, **{name: [0.0] * 9})
