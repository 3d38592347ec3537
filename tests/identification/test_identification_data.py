"""Files of measurements: what is read, and what is said of what cannot be."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.identification import IdentifyScene, read_data
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.results import read_run
from continuum_grasp.scene import DataTable
from tests.identification_cases import LENGTH, ROD, STIFFNESS, elastica, frequency

LOADS = (0.0, 0.1, 0.25, 0.4)


def config(*data, estimate=("bending_stiffness",), **keys) -> dict:
    """An identification of the rod; what is not given as in the files below."""
    return {
        "schema_version": 1,
        "finger": {"rod": ROD, "base": {"angle": -math.pi / 2}},
        "gravity": [0.0, -9.81],
        "fidelity": {"elements": 4},
        "loads": [{"kind": "force", "at": LENGTH, "force": [0.0, 0.0]}],
        "estimate": [{"name": name} for name in estimate],
        "data": list(data),
        **keys,
    }


STATIC = {
    "kind": "static",
    "file": "drops*.csv",
    "conditions": [{"name": "load_1_y", "column": "weight", "unit": "gf", "scale": -1}],
    "measured": [{"quantity": "y", "column": "drop", "scale": -1}],
}


def write_drops(folder, name="drops.csv", rows=None):
    """Drops of the exact rod [mm] under weights [gf]."""
    rows = rows or [f"{load / 9.80665e-3:.9f},{-1e3 * elastica(load)[1]:.6f},fine" for load in LOADS]
    path = folder / name
    path.write_text("\n".join(["# measured", "weight,drop [mm],remark", "", *rows]) + "\n")
    return path


def scene(*data, **keys) -> IdentifyScene:
    return IdentifyScene(**config(*data, **keys))


def test_poses_are_read_with_units_in_heading_and_configuration(tmp_path):
    write_drops(tmp_path)
    (data,) = read_data(scene({**STATIC, "holdout_rows": [2]}), [tmp_path])
    assert data.conditions["load_1_y"] == pytest.approx([-load for load in LOADS], rel=1e-6)
    assert data.measured[0].values == pytest.approx([elastica(load)[1] for load in LOADS], abs=1e-8)
    assert data.fitted.tolist() == [True, False, True, True]
    assert data.name == "drops"


def test_planes_are_read_in_degrees_too_and_many_radians_are_suspected(tmp_path):
    write_drops(tmp_path)
    (data,) = read_data(scene({**STATIC, "plane": "30 deg"}), [tmp_path])
    assert data.plane == pytest.approx(math.pi / 6.0)
    with pytest.warns(UserWarning, match="plane = 30 rad is beyond a full turn; is it in degrees?"):
        scene({**STATIC, "plane": 30})


def test_rows_are_chosen_and_columns_taken_off(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("pose,load,tip_y,base_y,base_x,tip_x\n1.0,0,5,1,0,0\n2,7,9,1.5,1,2\n3,0,0,0,0,0\n")
    wanted = {
        "kind": "static",
        "where": [{"column": "pose", "equals": ["1", "2.0"]}],
        "conditions": [{"name": "load_1_y", "column": "load"}],
        "measured": [{"quantity": "y", "column": "tip_y", "minus": "base_y", "unit": "cm", "scale": 2}],
    }
    (data,) = read_data(scene(wanted), [path])
    assert data.measured[0].values == pytest.approx([0.08, 0.15])
    assert data.conditions["load_1_y"].tolist() == [0.0, 7.0]


def test_sets_have_scenes_of_their_own(tmp_path):
    for name in ("up.csv", "down.csv"):
        (tmp_path / name).write_text("t,x,y\n0.1,0.2,0.3\n0.2,0.3,0.4\n0.9,1,1\n")
    up = {"kind": "trajectory", "file": "up.csv", "window": [0.0, 0.5], "set": ["finger.base.angle=0.0"]}
    up["measured"] = [{"quantity": "y", "column": "y"}]
    down = {"kind": "trajectory", "file": "down.csv", "use": "holdout"}
    first, second = read_data(scene(up, down), [tmp_path / "up.csv", tmp_path / "down.csv"])
    assert first.scene.finger.base.angle == 0.0
    assert second.scene.finger.base.angle == -math.pi / 2
    assert (first.t.tolist(), [(one.quantity, one.values.tolist()) for one in first.measured]) == (
        [0.1, 0.2],
        [("y", [0.3, 0.4])],
    )
    assert (first.fitted, second.fitted) == (True, False)


def test_ring_downs_become_frequencies(tmp_path):
    t = np.arange(-0.5, 4.0, 0.01)
    signals = [np.exp(-0.2 * t) * np.sin(2.0 * math.pi * f * t) for f in (2.0, 2.5)]
    rows = [
        f"{a:.6f},{b:.9f},{c:.9f}" if k % 7 else f"{a:.6f},{b:.9f},"
        for k, (a, b, c) in enumerate(zip(t, *signals, strict=True))
    ]
    (tmp_path / "ring.csv").write_text("\n".join(["t,one,two", *rows]) + "\n")
    wanted = {"kind": "ring_down", "signals": ["one", "two"], "window": [0.0, 4.0]}
    (data,) = read_data(scene(wanted), [tmp_path / "ring.csv"])
    assert data.measured[0].values == pytest.approx([2.0, 2.5], rel=1e-5)
    assert data.measured[1].values == pytest.approx([0.2, 0.2], rel=1e-4)


@pytest.mark.deep
def test_frequencies_are_read_by_mode(tmp_path):
    values = ",".join(f"{2.0 * math.pi * frequency(mode):.9f}" for mode in (1, 2))
    (tmp_path / "f.csv").write_text(f"first [rad/s],second [rad/s]\n{values}\n")
    measured = [{"quantity": "frequency", "of": k + 1, "column": name} for k, name in enumerate(("first", "second"))]
    wanted = scene({"kind": "static", "measured": measured}, gravity=[0.0, 0.0], fidelity={"elements": 6})
    fit = cg.identify(wanted, tmp_path / "f.csv")
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=3e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "headings and rows"),
        ("a,b\n", "headings and rows"),
        ("1,2\n3,4\n", "expected headings"),
        ("a,\n1,2\n", "column 2 has no heading"),
    ],
)
def test_files_that_are_no_tables(tmp_path, text, words):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        DataTable.read(tmp_path / "bad.csv")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("nan", "the cell is empty"),
        ("-inf", "expected a finite number"),
        ("1e300", "expected a number up to 1e+15, got '1e300'"),
        ("", "the cell is empty"),
    ],
)
def test_wrong_cells_are_named_with_their_place(tmp_path, cell, words):
    path = write_drops(tmp_path, rows=["0,1,x", f"10,{cell},x"])
    with pytest.raises(InputError) as caught:
        cg.identify(scene(STATIC), path)
    error = caught.value
    assert (error.file, error.line, error.column) == (str(path), 5, 4)
    assert words in error.message
    assert "drop" in error.message


def test_a_column_without_a_number_is_named(tmp_path):
    """A camera that lost one coordinate; of single cells the rows are read that have others."""
    path, of_x = tmp_path / "drops.csv", {"quantity": "x", "column": "x [mm]"}
    both = scene(STATIC | {"measured": [of_x, *STATIC["measured"]]})
    path.write_text("weight,x [mm],drop [mm]\n0,,10\n1,399,20\n")
    assert [len(of.measured) for of in read_data(both, [path])] == [1, 2]
    path.write_text("weight,x [mm],drop [mm]\n0,,10\n1,nan,20\n")
    with pytest.raises(InputError, match=r"drops.csv:1:8: column x \[mm\]: every cell is empty"):
        read_data(both, [path])


def test_cells_that_nothing_separates_are_named(tmp_path):
    path = tmp_path / "drops.csv"
    path.write_text("weight|drop\n0|1\n10|2\n")
    with pytest.raises(InputError, match="separate cells by commas, semicolons or tabs"):
        cg.identify(scene(STATIC), path)


def changed(**keys):
    return {**STATIC, **keys}


MEASURED = {"quantity": "y", "column": "drop"}
RING_DOWN = {"kind": "ring_down", "t": {"column": "weight", "unit": "s"}, "signals": ["drop"]}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (changed(measured=[{"quantity": "y", "column": "drops"}]), "no column 'drops'; did you mean 'drop'"),
        (changed(measured=[{**MEASURED, "unit": "cm"}]), "its heading says [mm], the configuration 'cm'"),
        (changed(measured=[{**MEASURED, "quantity": "angle"}]), "expected a unit like rad"),
        (changed(measured=[{**MEASURED, "at": 9.0}]), "data[0].measured[0].at: 9 m is not on the finger"),
        (changed(measured=[{**MEASURED, "sigma": 0.5}]), "data[0].measured[0].sigma: 0.5 m is more than the finger"),
        (changed(conditions=[{"name": "load_9", "column": "weight"}]), "data[0].conditions[0].name: no input or force"),
        (changed(holdout_rows=[9]), "data[0].holdout_rows: there is no row 9: the set has 4 rows"),
        (changed(file="nothing*.csv"), "data[0].file: no file nothing*.csv"),
        (changed(where=[{"column": "remark", "equals": ["rough"]}]), "no row in which remark is rough; it is fine"),
        (changed(set=["finger.rod.lenth=1"]), "data[0].set.finger.rod.lenth: unknown key; did you mean 'length'"),
        (changed(set=["finger"]), "expected key.path=value"),
        ({"kind": "trajectory", "file": "drops.csv", "t": {"column": "weight", "unit": "s"}}, "no column 'x'"),
        (
            {**RING_DOWN, "window": [500, 600]},
            "no sample between 500",
        ),
        (
            {**RING_DOWN, "window": [0, 60]},
            "12 samples or more",
        ),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, data, words):
    write_drops(tmp_path)
    with pytest.raises(InputError) as caught:
        cg.identify(scene(data), tmp_path)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"estimate": [{"name": "a"}, {"name": "a"}]}, "estimated twice"),
        ({"estimate": [{"name": "a", "min": 2.0, "max": 1.0}]}, "not below"),
        ({"data": [{**STATIC, "use": "holdout"}]}, "every set is a hold-out"),
        ({"data": [{"kind": "ring_down", "window": [2.0, 1.0]}]}, "window must increase"),
        ({"data": [{"kind": "trajectory", "x": "x"}]}, "write 'measured: "),
        ({"data": [{"kind": "trajectory", "measured": []}]}, "too short"),
        ({"data": [{"kind": "film"}]}, "not one of the choices"),
    ],
)
def test_configurations_that_make_no_sense(keys, words):
    with pytest.raises(InputError, match=words):
        IdentifyScene(**{**config(), **keys})


# -- the command -----------------------------------------------------------------------------------------------------


@pytest.fixture
def written(tmp_path):
    """Configuration and data as files."""
    path = tmp_path / "drops.yaml"
    path.write_text(json.dumps(config(STATIC)))  # JSON is YAML
    return path, write_drops(tmp_path)


def run(*arguments):
    return CliRunner().invoke(app, ["identify", *map(str, arguments)])


@pytest.mark.deep
def test_command_saves_draws_and_prints(written, tmp_path):
    file, data = written
    out = tmp_path / "run"
    done = run(file, "--data", data, "--out", out, "--json")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    (one,) = printed["parameters"]
    assert one["name"] == "bending_stiffness"
    assert one["value"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert one["interval"][0] < STIFFNESS < one["interval"][1] or one["deviation"] < 1e-3 * STIFFNESS
    stored = read_run(out)
    assert stored.arrays["values"] == pytest.approx([one["value"]])
    assert stored.meta["status"] == "converged"
    assert stored.meta["identified_finger"]["rod"]["bending_stiffness"] == pytest.approx(one["value"])
    assert {"residuals.png", "series.png"} <= {path.name for path in out.iterdir()}


def test_pictures_show_every_number(written):
    file, data = written
    fit = cg.identify(cg.load(file, ["data[0].holdout_rows=[2]"]), data)
    ax = fit.plot(picture="residuals")
    fitted, held = (points.get_offsets() for points in ax.collections)
    assert np.asarray(held)[:, 0].tolist() == [2.0]
    assert np.asarray(fitted)[:, 1] == pytest.approx(fit.residuals[fit.fitted] / fit.sigma[fit.fitted])
    above, _ = fit.plot(picture="series").axes
    shown = np.concatenate([np.asarray(points.get_offsets()) for points in above.collections])
    assert sorted(shown[:, 1]) == pytest.approx(sorted(1e3 * fit.measured))
    assert above.get_ylabel() == "y at tip [mm]"


def test_data_folder_is_found_by_its_variable(written, tmp_path, monkeypatch):
    file, data = written
    monkeypatch.setenv("CONTINUUM_GRASP_DATA", str(data.parent))
    monkeypatch.chdir("/")
    assert run(file, "--data", data.name, "--out", tmp_path / "run", "--no-pictures", "-q").exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ("--data nothing.csv", 2, "no such file"),
        ("--data drops.csv --set estimate[0].name=stiffness", 2, "estimate[0].name: unknown parameter"),
        (
            "--data drops.csv --set finger.rod.bending_stiffness=1e-9 --set fidelity.elements=2",
            1,
            "plausible",
        ),
        ("--data drops.csv --set loss=huber", 2, "holdout_rows or window"),
        # That would narrow the intervals.
        ("--data drops.csv --data drops.csv", 2, "given twice"),
        ("--data drops.csv --data .", 2, "given twice"),
    ],
)
def test_exit_codes(written, tmp_path, monkeypatch, arguments, code, words):
    monkeypatch.chdir(tmp_path)
    done = run(written[0], *arguments.split(), "--out", tmp_path / "run", "--no-pictures")
    assert done.exit_code == code
    assert words in done.stderr


def test_command_needs_something_to_estimate(written):
    scene_alone = Path(__file__).parents[2] / "configs/simulate/hanging.yaml"
    done = run(scene_alone, "--data", written[1])
    assert done.exit_code == 2
    assert "expected an identification (finger, estimate, ...)" in done.stderr


def test_errors_in_the_configuration_have_their_line(tmp_path):
    write_drops(tmp_path)
    text = json.dumps(config(STATIC), indent=1).replace('"bending_stiffness"\n', '"bending_stifness"\n')
    (tmp_path / "c.yaml").write_text(text)
    line = next(k for k, one in enumerate(text.splitlines(), 1) if '"bending_stifness"' in one)
    done = run(tmp_path / "c.yaml", "--data", tmp_path / "drops.csv")
    assert done.exit_code == 2
    assert f"c.yaml:{line}:" in done.stderr
    assert "did you mean 'bending_stiffness'" in done.stderr
