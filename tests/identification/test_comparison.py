"""Comparisons with measurements written by hand: circles, an arc with a mass by scipy, foreign tables."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.identification import IdentifyScene, Poses, Reading, TipPath, read_data
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.scene import DataTable

LENGTH, STIFFNESS = 0.2, 0.005
ROD = {
    "finger": {
        "rod": {"length": LENGTH, "linear_density": 0.03, "bending_stiffness": STIFFNESS},
        "base": {"angle": -math.pi / 2},
    },
    "gravity": (0.0, 0.0),
    "actuation": {"tip_moment": 0.0},
}
TEXT = """schema_version: 1
finger:
  rod: {length: 0.2, linear_density: 0.03, bending_stiffness: 0.005}
  base: {angle: -90 deg}
gravity: [0.0, 0.0]
actuation: {tip_moment: 0.0}
"""
MOMENTS, PLACES = (0.005, 0.01, 0.02), (0.08, 0.14, 0.2)


def on_arc(moment: float, s: float, offset: float = 0.0) -> tuple[float, float]:
    """Point of a rod that lies along x and is bent by a moment at its tip, M = E I kappa; ``offset`` to its right."""
    kappa = moment / STIFFNESS
    normal = offset * math.sin(kappa * s), -offset * math.cos(kappa * s)
    return math.sin(kappa * s) / kappa + normal[0], (1.0 - math.cos(kappa * s)) / kappa + normal[1]


def table(tmp_path, text: str, name: str = "points.csv"):
    file = tmp_path / name
    file.write_text(text)
    return file


def long_table(tmp_path, write):
    rows = [write(k, m, s) for k, m in enumerate(MOMENTS) for s in PLACES]
    return "\n".join(rows) + "\n"


def described(*data) -> IdentifyScene:
    return IdentifyScene(**ROD, data=data)


LONG = {
    "kind": "static",
    "pose": "pose",
    "conditions": [{"name": "tip_moment", "column": "M"}],
    "measured": [{"quantity": axis, "column": axis, "at": {"column": "s"}} for axis in ("x", "y")],
}


def test_a_table_with_units_semicolons_and_commas_needs_no_configuration(tmp_path):
    def write(k, moment, s):
        x, y = on_arc(moment, s)
        return f"p{k};{1e3 * moment:.3f};{1e3 * s:.0f};{1e3 * x:.5f};{1e3 * y:.5f}".replace(".", ",")

    text = "pose;tip_moment [N mm];at [mm];x [mm];y [mm]\n" + long_table(tmp_path, write)
    found = cg.compare(cg.Scene(**ROD), table(tmp_path, text))
    assert found.measured.size == 18
    assert np.abs(found.residuals).max() < 1e-7
    assert {one.count for one in found.channels} == {3}
    assert sorted(one.name.split(": ")[1] for one in found.channels if "distance" in one.name) == [
        f"distance at {s:g} m" for s in PLACES
    ]


def test_errors_are_those_of_the_shift_that_was_written(tmp_path):
    rows = "".join(f"{m},{on_arc(m, LENGTH)[0] + 0.003},{on_arc(m, LENGTH)[1] - 0.004}\n" for m in MOMENTS)
    found = cg.compare(cg.Scene(**ROD), table(tmp_path, "tip_moment,x,y\n" + rows))
    x, y, distance = found.channels
    assert (x.mean, y.mean) == pytest.approx((-0.003, 0.004), abs=1e-7)
    assert (distance.rms, distance.largest) == pytest.approx((0.005, 0.005), abs=1e-7)
    assert distance.share == pytest.approx(0.025, abs=1e-6)
    assert distance.texts[1:6] == ("5", "5", "5", "mm", "2.5 %")


def test_points_that_no_finger_reaches_are_warned_of(tmp_path):
    """Millimeters without their unit, or an image whose origin is 0.3 m away; on the finger there is no warning."""
    for scale, shift, words in ((1.0, 0.0, None), (1e3, 0.0, "is 200 m from the base"), (1.0, 0.3, "is 0.5 m from")):
        x, y = (scale * one for one in on_arc(1e-9, LENGTH))
        found = cg.compare(cg.Scene(**ROD), table(tmp_path, f"x,y\n{x + shift},{y}\n"))
        assert bool(found.warnings) == (words is not None)
        assert all(words in one and "check units and axes" in one for one in found.warnings[:1])
        slips = [one.split("likely cause: ")[1] for one in found.warnings[1:]]
        assert [one.split(":")[0] for one in slips] == (
            ["positions are in mm, read as m"] if scale > 1.0 else [one.split(":")[0] for one in slips]
        )


def test_grams_are_weights_where_forces_are_meant(tmp_path):
    text = "t [s],M,load [g],pull [kg]\n0,1,2,3\n"
    one = DataTable.read(table(tmp_path, text))
    assert one.in_si("load", "N")[0] == pytest.approx(2e-3 * 9.80665, rel=1e-12)
    assert one.in_si("load", "N", "g")[0] == one.in_si("load", "N", "gf")[0] == one.in_si("load", "N")[0]
    assert one.in_si("pull", "N")[0] == pytest.approx(3 * 9.80665, rel=1e-12)
    assert one.in_si("pull", "kg")[0] == 3.0
    with pytest.raises(InputError, match=r"points.csv:1:9: its heading says \[g\], the configuration 'kg'"):
        one.in_si("load", "N", "kg")


@pytest.mark.parametrize("moves", [False, True])
def test_two_markers_of_one_section_are_two_points(moves):
    """At the tip, 20 mm to either side: on the arc, and not twice as far from the base as the finger is long."""
    sides, bends = (0.02, -0.02), np.array(MOMENTS) if not moves else np.full(40, 0.01)
    points = np.array([[on_arc(moment, LENGTH, side) for moment in bends] for side in sides])
    readings = [
        Reading(axis, points[k, :, j], offset=side) for k, side in enumerate(sides) for j, axis in enumerate("xy")
    ]
    scene = cg.Scene(**{**ROD, "actuation": {"tip_moment": 0.01}}, initial={"pose": "equilibrium"})
    data = TipPath(0.01 * np.arange(1.0, 41.0), readings) if moves else Poses(readings, {"tip_moment": bends})
    found = cg.compare(scene, data)
    assert np.abs(found.residuals).max() < 1e-6
    assert found.warnings == ()
    assert len(found.series) == 4
    assert len(found.points) == 2 * bends.size
    names = [one.name for one in found.channels if "distance" in one.name]
    assert [name.rpartition(": ")[2] for name in names] == [
        "distance at 0.2 m, +0.02 m beside",
        "distance at 0.2 m, -0.02 m beside",
    ]
    assert [len(one.lines) for one in found.plot(picture="shapes").axes] == [len(found.drawn[0].at) + 2 + 2 * moves]


def test_image_coordinates_a_shifted_origin_and_markers_beside_the_backbone(tmp_path):
    def write(k, moment, s):
        x, y = on_arc(moment, s, 0.01 * (k + 1))
        return f"p{k},{moment},{s},{x - 0.05},{0.3 - y},{0.01 * (k + 1)}"

    file = table(tmp_path, "pose,M,s,x,y,beside\n" + long_table(tmp_path, write))
    measured = [{**one, "offset": {"column": "beside"}} for one in LONG["measured"]]
    scene = described({**LONG, "measured": measured, "axes": ["x", "-y"], "origin": (0.05, 0.3)})
    assert np.abs(cg.compare(scene, file).residuals).max() < 1e-7
    bare = described({**LONG, "axes": ["x", "-y"], "origin": (0.05, 0.3)})
    assert np.abs(cg.compare(bare, file).residuals).max() > 0.02


def test_a_frame_that_is_shifted_and_turned_is_estimated(tmp_path):
    turn, shift = 0.07, np.array([0.012, -0.008])
    c, s = math.cos(turn), math.sin(turn)

    def write(k, moment, place):
        x, y = np.array([[c, -s], [s, c]]) @ on_arc(moment, place) + shift
        return f"p{k},{moment},{place},{x},{y}"

    file = table(tmp_path, "pose,M,s,x,y\n" + long_table(tmp_path, write))
    fit = cg.identify(described(LONG), file, parameters=["bending_stiffness", "base_x", "base_y", "clamp_angle"])
    assert [fit[name] for name in fit.names] == pytest.approx([STIFFNESS, *shift, turn], abs=1e-6)
    base = fit.apply().finger.base
    assert (*base.position, base.angle) == pytest.approx((*shift, turn - math.pi / 2), abs=1e-6)


def test_poses_that_lack_points_are_read_by_what_they_have(tmp_path):
    def write(k, moment, s):
        x, y = on_arc(moment, s)
        return f"p{k},{moment},{s},{x},{'' if k == 1 and s < 0.1 else y}"

    file = table(tmp_path, "pose,M,s,x,y\n" + long_table(tmp_path, write))
    first, second = read_data(described(LONG), [file])
    assert (first.rows, len(first.measured), second.rows, len(second.measured)) == (2, 6, 1, 5)
    assert np.abs(cg.compare(described(LONG), file).residuals).max() < 1e-7


def test_a_track_with_gaps_is_that_of_one_arc_with_a_mass(tmp_path):
    """Truth: m g(a) a'' + m g'(a) a'^2 / 2 = -E I a / L for the bend a of a light arc, g = |dr / da|^2."""
    mass, start = 0.1, 0.4

    def tip(a):
        return np.array([-LENGTH * (1.0 - np.cos(a)) / a, LENGTH * np.sin(a) / a])

    def inertia(a, step=1e-4):
        return mass * np.sum((tip(a + step) - tip(a - step)) ** 2) / (2 * step) ** 2

    def rate(_, z):
        slope = (inertia(z[0] + 1e-3) - inertia(z[0] - 1e-3)) / 2e-3
        return [z[1], (-STIFFNESS / LENGTH * z[0] - 0.5 * slope * z[1] ** 2) / inertia(z[0])]

    t = np.linspace(0.0, 0.3, 31)
    bends = solve_ivp(rate, (0.0, 0.3), [start, 0.0], t_eval=t, rtol=1e-10, atol=1e-12).y[0]
    lines = [f"{at:.4f},{x:.8f},{y:.8f}" for at, (x, y) in zip(t, (tip(a) for a in bends), strict=True)]
    lines[5], lines[9] = f"{t[5]},,0.1", f"{t[9]},,"
    scene = cg.Scene(
        finger={
            "rod": {"length": LENGTH, "linear_density": 1e-6, "bending_stiffness": STIFFNESS},
            "masses": [{"at": LENGTH, "mass": mass}],
        },
        gravity=(0.0, 0.0),
        fidelity={"family": "arc", "elements": 1},
        initial={"q": [start]},
    )
    found = cg.compare(scene, table(tmp_path, "t,x,y\n" + "\n".join(lines)))
    assert found.measured.size == 2 * 29
    assert [of.moves for of in found.sets if of.name == "points"] == [True]
    assert np.abs(found.residuals).max() < 1e-5


DEEPLABCUT = """scorer,net,net,net,net,net,net
bodyparts,mid,mid,mid,tip,tip,tip
coords,x,y,likelihood,x,y,likelihood
0,1.5,2.5,0.99,3.5,4.5,0.98
1,1.6,2.6,0.10,3.6,4.6,0.97
"""


def test_tables_of_deeplabcut_and_tracker(tmp_path):
    one = DataTable.read(table(tmp_path, DEEPLABCUT))
    assert one.headings == ("frame", "mid_x", "mid_y", "mid_likelihood", "tip_x", "tip_y", "tip_likelihood")
    assert one.numbers("tip_y").tolist() == [4.5, 4.6]
    assert np.isnan(one.numbers("mid_x", gaps=True)).tolist() == [False, True]
    assert one.lines == (4, 5)
    two = DataTable.read(table(tmp_path, "\tmass A\t\tmass B\t\nt\tx\ty\tx\ty\n0,0\t1,5\t2\t3\t4E-1\n"))
    assert two.headings == ("t", "mass A_x", "mass A_y", "mass B_x", "mass B_y")
    assert [two.numbers(name)[0] for name in two.headings] == [0.0, 1.5, 2.0, 3.0, 0.4]
    single = DataTable.read(table(tmp_path, "mass A\nt,x,y\n0.0,1.5,2\n"))
    assert (single.headings, single.numbers("x")[0]) == (("t", "x", "y"), 1.5)


PLAIN = "tip_moment [N m],x [mm],y [mm]\n0,1,-2\n0.001,,-3.5\n"


@pytest.mark.parametrize(
    "text",
    [
        "tip_moment [N m];x [mm];y [mm]\n0;1;-2\n0,001;;-3,5\n",
        "tip_moment,x,y\nN m,mm,mm\n0,1,-2\n0.001,,-3.5\n",
        "tip_moment,x,y\n[N m],[mm],[mm]\n0,1,-2\n0.001,,-3.5\n",
        "Tip_moment [N m],X / mm,Y in mm\n0,1,-2\n0.001,n/a,\u22123.5\n",
        "tip_moment [N m],x [mm],y [mm],\n0,1,-2,\n0.001,-,-3.5,\n",
        "tip_moment [N m],x [mm],y [mm]\n0,1,-2\ntip_moment [N m],x [mm],y [mm]\n0.001,NaN,-3.5\n",
        "; made by a logger\n; rate: 100 Hz\ntip_moment [N m],x [mm],y [mm]\n0,1,-2\n0.001,,-3.5\n",
        "; made by a logger\ntip_moment [N m];x [mm];y [mm]\n0;1;-2\n0,001;;-3,5\n",
        "% made by\n% tip_moment [N m], x [mm], y [mm]\n0,1,-2\n0.001,,-3.5\n",
        "# tip_moment [N m] x [mm] y [mm]\n0 1 -2\n0.001 nan -3.5\n",
        "// made by\ntip_moment [N m] x [mm] y [mm]\n0 1 -2\n0,001 nan -3,5\n",
        "sep=;\ntip_moment [N m];x [mm];y [mm]\n0;1;-2\n0,001;;-3,5\n",
        '"tip_moment [N m]","x [mm]","y [mm]"\n"0","1","-2"\n"0,001","","-3,5"\n',
        "tip_moment [N m],x [mm],y [mm]\n0,1,-2,\n0.001,,-3.5,\n",
        "tip_moment [N m]\tx [mm]\ty [mm]\t\t\n0\t1\t-2\n0,001\t\t-3,5\n",
        "\ufefftip_moment [N m],x [mm],y [mm]\r\n0,1,-2\r\n0.001,,-3.5\r\n",
    ],
)
@pytest.mark.deep
def test_tables_as_people_have_them_are_those_with_units_in_brackets(tmp_path, text):
    expected, read = (cg.compare(cg.Scene(**ROD), table(tmp_path, each)) for each in (PLAIN, text))
    assert read.measured.tolist() == expected.measured.tolist()
    assert [of.name for of in read.described] == [of.name for of in expected.described]


HEAD = "pose,M,s,x,y\np0,0.01,0.1,0.1,0\n"
REFUSED = {
    HEAD + "p0,0.02,0.2,0.2,0\n": "points.csv:3:1: tip_moment differs from the first row",
    HEAD + "p0,0.01,0.1,0.2,0\n": "points.csv:3:1: 2 rows of one pose at one place",
    HEAD + "p0,0.01,0.3,0.2,0\n": "0.3 m is not on the finger of 0.2 m",
    "pose;M;s;x;y\np0;0.01;0.1;0,1;0\n": "expected a number, got '0,1' (write a decimal point, not a comma)",
    "pose,M,s,x,y\np0,0.01,-0.1,0.1,0\n": "points.csv:2:9: -0.1 m is not on the finger of 0.2 m",
    "pose,M,s,x,y\np0,0.01,0.1,0.1_5,0\n": "points.csv:2:13: column x: expected a number, got '0.1_5'",
    "x [m],tip_x [m]\n0.2,0.2\n": "points.measured[1]: x of tip is given twice",
    "x [mm],x_m\n200,0.2\n": "points.csv:1:8: two columns are called 'x'",
    "x,y\n0,199,1\n": "csv:2: expected 2 cells, got 3; write decimal points, or semicolons between cells",
    "Trial 3\nx,y\n1,2\n": "csv:2: expected 1 cells, got 2; begin lines above the headings with #, as 'Trial 3'",
    "x,y,z\n1,2,3\n4,5\n": "csv:3: expected 3 cells, got 2; the last line is cut off: delete it",
    "x,y\n1,2 mm\n": "csv:2:3: column y: expected a number, got '2 mm' (write units in the heading: y [mm])",
    "x [mm],y,x [mm]\n1,2,3\n": "csv:1:10: two columns are called 'x': rename one",
    "a,b\n1,2\n": "points.csv:1: the headings (a, b) do not say what was measured",
    "x,y,tip_momnt\n0.2,0,1\n": "points.csv:1:5: nothing reads the column 'tip_momnt'",
    "x,y,load [g]\n0.2,0,1\n": "points.csv:1:5: nothing reads the column 'load",
    "x,y,frame\n0.2,0,1\n": "points.csv:1:5: nothing reads the column 'frame",
}


@pytest.mark.parametrize("text", REFUSED)
def test_tables_that_are_refused_say_where_and_what_to_write(tmp_path, text):
    """With a description of what is in them, and by their headings alone."""
    scene = described(LONG) if text.startswith("pose") else cg.Scene(**ROD)
    with pytest.raises(InputError) as refused:
        cg.compare(scene, table(tmp_path, text))
    assert REFUSED[text] in str(refused.value)
    assert "tip_momnt" not in text or "; did you mean tip_moment?" in str(refused.value)


def test_a_place_that_is_rounded_beyond_the_tip_is_the_tip(tmp_path):
    text = "pose,M,s,x,y\np0,0.01,{},0.2,0\n"
    tip, rounded = (cg.compare(described(LONG), table(tmp_path, text.format(s))) for s in (0.2, 0.20000019))
    assert rounded.residuals.tolist() == tip.residuals.tolist()
    with pytest.raises(InputError, match="is not on the finger"):
        cg.compare(described(LONG), table(tmp_path, text.format(0.20000021)))


def test_remarks_are_not_measured_and_axes_along_one_line_are_refused(tmp_path):
    assert cg.compare(cg.Scene(**ROD), table(tmp_path, "x,y,remark,trial\n0.2,0,good,1\n")).measured.size == 2
    with pytest.raises(InputError, match="both are along x"):
        described({**LONG, "axes": ["x", "-x"]})


@pytest.mark.parametrize(("cell", "words"), [("", "column o: the cell is empty"), ("20", "20 m from the backbone")])
def test_a_marker_whose_offset_is_missing_or_in_mm_is_refused(tmp_path, cell, words):
    """Without a unit it would lie 20 m beside the finger, and without a number on its backbone."""
    beside = [{**one, "at": 0.1, "offset": {"column": "o"}} for one in LONG["measured"]]
    text = f"M,x,y,o\n0.01,0.1,0,0.02\n0.01,0.1,0,{cell}\n"
    with pytest.raises(InputError) as refused:
        cg.compare(described({"kind": "static", "measured": beside}), table(tmp_path, text))
    assert words in str(refused.value)
    assert "points.csv:3:12" in str(refused.value)


@pytest.mark.parametrize("kind", ["trajectory", "ring_down"])
def test_two_runs_in_one_table_are_refused_at_the_line_of_the_second(tmp_path, kind):
    """Sorted by time their samples would be mixed."""
    text = "t [s],x,y\n" + "".join(f"{0.01 * k:.2f},0.2,0\n" for k in (*range(20), *range(3, 20)))
    file, further = table(tmp_path, text), {"ring_down": {"signals": ["x"], "window": [0.0, 1.0]}}.get(kind, {})
    with pytest.raises(InputError, match=r"points.csv:22:1: column t: a second run begins at number 21 of 37 rows"):
        cg.compare(described({"kind": kind, **further}), file)


HEADINGS = [("t", 10.0, "ms"), ("t", 1e4, "us"), ("t", 0.01, None)]
"""Heading, period, and the unit that is likely."""


@pytest.mark.parametrize("kind", ["trajectory", "ring_down", "headings"])
@pytest.mark.parametrize(("heading", "apart", "likely"), HEADINGS)
def test_times_without_a_unit_are_asked_for_where_they_are_no_seconds(tmp_path, kind, heading, apart, likely):
    """Before anything is simulated; in every reader of a table with times, with the headings that answer."""
    rows = "".join(f"{apart * k:.6g},0.2,{0.01 * (-1.0) ** k}\n" for k in range(20))
    file = table(tmp_path, f"{heading},x,y\n" + rows)
    further = {"ring_down": {"signals": ["y"], "window": [0.0, 1e9]}}.get(kind, {})
    asked = cg.Scene(**ROD) if kind == "headings" else described({"kind": kind, **further})
    read = partial(read_data, asked, [file])
    if likely is None:
        read()
        return
    with pytest.raises(InputError, match=rf"points.csv:1:1: column t: .*is t in {likely}\? Write t \[{likely}\]"):
        read()


def test_units_that_are_stated_are_believed(tmp_path):
    rows = "".join(f"{10.0 * k:.6g},0.2,0\n" for k in range(20))
    slow = table(tmp_path, "t [s],x,y\n" + rows)
    assert read_data(cg.Scene(**ROD), [slow])[0].t[-1] == 190.0


def test_units_stand_in_parentheses_too_but_words_do_not(tmp_path):
    one = DataTable.read(table(tmp_path, "t (ms),x (mm),y (left),y (right)\n1,2,3,4\n"))
    assert (one.headings, one.units) == (("t", "x", "y (left)", "y (right)"), ("ms", "mm", None, None))
    assert [one.index("x (mm)"), one.index("x"), one.index("y (left)")] == [1, 1, 2]


def test_a_comparison_is_drawn_with_points_on_the_finger():
    from continuum_grasp.plotting import StyledAxes

    tip = np.array([on_arc(m, LENGTH) for m in MOMENTS]).T
    poses = Poses([Reading("x", tip[0]), Reading("y", tip[1] + 0.01)], {"tip_moment": MOMENTS}, [True, True, False])
    found = cg.compare(cg.Scene(**ROD), poses)
    (ax,) = found.plot(picture="shapes").axes
    dots = [one.get_offsets() for one in ax.collections if one.get_label() in ("measured", "measured, hold-out")]
    assert np.array(np.vstack(dots)) == pytest.approx(tip.T + np.array([0.0, 0.01]), abs=1e-9)
    ends = [line.get_xydata()[-1] for line in ax.lines if len(line.get_xydata()) > 2]
    assert np.array(ends[:3]) == pytest.approx(tip.T, abs=1e-7)
    labels = [ax.get_ylabel() for ax in found.plot(picture="series").axes]
    assert labels == ["x at tip [mm]", "error [mm]", "y at tip [mm]", "error [mm]"]  # in the order of the table
    given = StyledAxes.figure().subplots(2, 1)
    found.plot(given, picture="series")
    assert given[0].get_ylabel() == "y at tip [mm]"


def test_the_command_compares_and_identify_without_parameters_does_the_same(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rod.yaml").write_text(TEXT)
    rows = "".join(f"{m},{on_arc(m, LENGTH)[0]},{on_arc(m, LENGTH)[1]}\n" for m in MOMENTS)
    table(tmp_path, "tip_moment,x,y\n" + rows)
    shown = CliRunner().invoke(app, ["compare", "rod.yaml", "points.csv", "--no-pictures"]).stdout
    assert "points: distance at 0.2 m" in shown
    data = "data: [{kind: static, file: points.csv, conditions: [{name: tip_moment, column: tip_moment}], measured: "
    data += "[{quantity: x, column: x}, {quantity: y, column: y}]}]\n"
    (tmp_path / "same.yaml").write_text(TEXT + "estimate: []\n" + data)
    same = CliRunner().invoke(app, ["identify", "same.yaml", "--no-pictures"]).stdout
    assert same.partition("saved in")[0] == shown.partition("saved in")[0]
    assert (tmp_path / "runs/compare/same/result.npz").is_file()


def test_the_log_of_a_controller_is_replayed_by_its_commands(tmp_path):
    finger = {**ROD["finger"], "tendons": {"offset": 0.01, "max_tension": 10.0, "time_constant": 0.02}}
    scene = cg.Scene(
        finger=finger, gravity=(0.0, 0.0), fidelity={"family": "arc", "elements": 1}, initial={"pose": "rest"}
    )
    head = "t [s],commanded_tension_1 [N],commanded_tension_2 [N],tip_x [m],tip_y [m],tension_1 [N],tension_2 [N]\n"
    found = cg.compare(scene, table(tmp_path, head + "".join(f"{0.01 * k:.2f},1,1,0.2,0.0,7,8\n" for k in range(4))))
    assert np.abs(found.residuals).max() < 1e-12
    assert found.measured.size == 8
