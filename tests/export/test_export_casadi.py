"""Plain CasADi C of named functions: compiles without a warning, computes what Python does."""

from __future__ import annotations

import json
import subprocess

import casadi as ca
import numpy as np
import pytest
from typer.testing import CliRunner

from continuum_grasp.cli import app
from continuum_grasp.errors import InputError
from continuum_grasp.export import export_c, export_casadi
from continuum_grasp.export.casadi_source import STEP
from continuum_grasp.model import FingerModel
from continuum_grasp.model.finger_model import FUNCTIONS
from continuum_grasp.results import begin_run
from continuum_grasp.scene.load import load
from continuum_grasp.simulation import simulate
from tests.export_cases import CONTACT, ROOT, TENDONS, needs

RELEASE = ROOT / "configs/simulate/nitinol_release_020g.yaml"
SMALL = ("fidelity.family=arc", "fidelity.elements=2")


def write(config, folder, *settings, names="all"):
    """The manifest of what the command line wrote."""
    changes = [part for setting in settings for part in ("--set", setting)]
    result = CliRunner().invoke(app, ["export-c", str(config), "--casadi", names, "--out", str(folder), *changes])
    assert result.exit_code == 0, result.output
    return json.loads((folder / "MANIFEST.json").read_text())


def compiled(folder, *flags):
    """The library of a folder."""
    line = ["cc", "-Wall", "-Werror", "-shared", "-fPIC", *flags, "finger.c", "-lm", "-o", "finger.so"]
    built = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return str(folder / "finger.so")


@needs("cc")
@pytest.mark.parametrize(
    ("config", "settings"),
    [
        (RELEASE, (*SMALL, "parameters=[tip_mass, gravity]")),
        (RELEASE, ()),
        (TENDONS, ()),
        (CONTACT, ()),
    ],
    ids=["arcs with parameters", "matched clothoids", "tendons with lag", "contact"],
)
def test_every_function_computes_what_the_model_does(config, settings, tmp_path):
    manifest = write(config, tmp_path, *settings)
    assert list(manifest["functions"]) == [*FUNCTIONS, STEP]
    library, model = compiled(tmp_path), FingerModel(load(config, list(settings)))
    rng = np.random.default_rng(1)
    for name, interface in manifest["functions"].items():
        called = ca.external(f"finger_{name}", library)
        given = [rng.uniform(0.01, 0.02, shape) for shape in interface["inputs"].values()]
        found = called.call([ca.DM(value) for value in given])
        assert {called.name_in(k): list(called.size_in(k)) for k in range(called.n_in())} == interface["inputs"]
        if name != STEP:
            for value, expected in zip(found, getattr(model, name).call([ca.DM(v) for v in given]), strict=True):
                np.testing.assert_allclose(np.array(value), np.array(expected), rtol=1e-9, atol=1e-9)


@needs("cc")
def test_the_step_moves_as_the_simulation_does(tmp_path):
    write(RELEASE, tmp_path, names=f"{STEP},tip")
    scene = load(RELEASE, {"time.method": "rk4", "time.duration": 0.05})
    moved, library = simulate(scene), compiled(tmp_path, "-O1")
    step, tip = (ca.external(f"finger_{name}", library) for name in (STEP, "tip"))
    x, h = moved.x[0], moved.t[1] - moved.t[0]
    for _ in moved.t[1:]:
        x = step(x, *[np.zeros(step.size_in(k)) for k in range(1, 7)], model_parameters(step), h)
    assert np.array(tip(x[: len(moved.q[0])], [], [])).ravel() == pytest.approx(moved.tip[-1], abs=1e-9)


def model_parameters(step):
    return np.zeros(step.size_in("p"))


def test_written_again_it_is_the_same(tmp_path):
    for folder in (one := tmp_path / "one", two := tmp_path / "two"):
        write(TENDONS, folder, names="tip,mass_matrix")
    for name in ("finger.c", "finger.h", "MANIFEST.json"):
        assert (one / name).read_bytes() == (two / name).read_bytes()


@needs("cc")
def test_two_prefixes_link_into_one_program(tmp_path):
    """No symbol of the two files is the same."""
    for prefix, family in (("one", "arc"), ("two", "matched_clothoid")):
        export_casadi(FingerModel(load(RELEASE), family=family), tmp_path / prefix, prefix=prefix)
    (tmp_path / "main.c").write_text(
        '#include "one/one.h"\n#include "two/two.h"\nint main(void) { return one_tip == two_tip; }\n'
    )
    line = ["cc", "-Wall", "main.c", "one/one.c", "two/two.c", "-lm", "-o", "both"]
    built = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    subprocess.run([tmp_path / "both"], check=True)


@pytest.mark.parametrize("prefix", ["", "2nd", "a-b", "finger.c", "größe"])
def test_a_prefix_that_is_no_identifier_is_refused(prefix, tmp_path):
    with pytest.raises(InputError, match="C identifier"):
        export_casadi(FingerModel(load(RELEASE)), tmp_path, prefix=prefix)


@pytest.mark.parametrize("names", [["tipp"], [], ["tip", "tip"]])
def test_names_that_are_no_functions_are_refused(names, tmp_path):
    with pytest.raises(InputError, match="functions: expected"):
        export_casadi(FingerModel(load(RELEASE)), tmp_path, functions=names)
    assert not list(tmp_path.iterdir())


def test_options_of_packages_are_refused(tmp_path):
    line = ["export-c", str(RELEASE), "--casadi", "tip", "--real", "float", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, line)
    assert result.exit_code == 2
    assert "--real: cannot be combined with --casadi" in result.output


def test_it_and_a_package_replace_each_other(tmp_path):
    """A folder holds one export: files of the earlier one are removed."""
    model = FingerModel(load(RELEASE, list(SMALL)))
    export_casadi(model, tmp_path, functions=["tip"])
    export_c(model, tmp_path, what=["kinematics"])
    assert not (tmp_path / "finger.c").exists()
    export_casadi(model, tmp_path, functions=["tip"])
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == [
        "MANIFEST.json",
        "finger.c",
        "finger.h",
    ]


def test_a_folder_of_another_run_is_refused(tmp_path):
    begin_run(tmp_path, "simulate")
    with pytest.raises(InputError, match="holds a run of simulate"):
        export_casadi(FingerModel(load(RELEASE)), tmp_path, functions=["tip"])
