"""How a grasp is shown and saved; from inside: texts and pictures of results whose figures are made here.

How a grasp is shown and saved: text, YAML, web page, picture, files, exit codes.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Text

import continuum_grasp.grasp
import continuum_grasp.plotting
from continuum_grasp.grasp import GraspResult, GraspStatus, Reason, certify, optimize_grasp
from continuum_grasp.grasp.page import page as page_of
from continuum_grasp.grasp.text import further_advice, result_text, result_yaml
from continuum_grasp.grasp.values import OutlineError, force_text, force_units
from continuum_grasp.plotting import plot_grasp
from continuum_grasp.plotting.grasp.margins import plot_friction, plot_resistance, resistance_extremes, resistance_words
from continuum_grasp.plotting.grasp.view import GraspView
from continuum_grasp.results import read_run, yaml_text
from continuum_grasp.scene import GraspScene, load, to_si
from tests.commands import run
from tests.made_up_grasps import REASON, bent, failed, held, made_up, scene_of
from tests.marks import few

ROOT = Path(__file__).parents[2]
SCENES = sorted(path.stem for path in (ROOT / "configs" / "grasp").glob("*.yaml"))
NASTY = "<script>alert('&')</script>: \"quoted\" # not a comment"


# -- YAML ----------------------------------------------------------------------------------------------------

numbers = st.floats(allow_nan=False)
leaves = st.none() | st.booleans() | st.integers(-(2**53), 2**53) | numbers | st.text(max_size=20)
trees = st.recursive(leaves, lambda t: st.lists(t, max_size=4) | st.dictionaries(st.text(max_size=8), t, max_size=4))


@given(trees)
def test_yaml_reads_back(tree):
    assert yaml.safe_load(yaml_text(tree, exact=True)) == tree


def test_yaml_takes_arrays_and_what_is_not_finite():
    assert yaml_text({"a": [0.1 + 0.2, 1e-7]}) == "a: [0.3, 1.0e-07]\n"
    data = yaml.safe_load(yaml_text({"a": np.eye(2), "b": np.float64("nan"), "c": -math.inf, "d": ()}))
    assert data["a"] == [[1.0, 0.0], [0.0, 1.0]]
    assert math.isnan(data["b"])
    assert data["c"] == -math.inf
    assert data["d"] == []


def test_result_yaml_holds_the_figures():
    data = yaml.safe_load(result_yaml(held()))
    assert data["status"] == "optimal"
    assert data["grasp"]["fingers"]["finger"]["tensions"][0] == 12.25
    assert data["grasp"]["tension"] == 13.25
    contact = data["grasp"]["contacts"][0]
    assert (contact["normal_force"], contact["friction_force"], contact["lift"]) == (2.5, -0.75, 0.5)
    assert contact["friction_margin"] == pytest.approx(1 - math.hypot(0.75, 0.5) / (0.5 * 2.5))
    assert "station" not in data["grasp"]["contacts"][-1]  # the palm's


# -- text ----------------------------------------------------------------------------------------------------


def test_the_error_of_an_outline_is_reported():
    result = replace(held(), outline=OutlineError(8e-5, 0.04, 64))
    for text in (result_text(result), Page(page_of(result)).text):
        assert "of 64 corners is within 0.08 mm of the drawing (0.20% of the object's size)" in " ".join(text.split())
    assert yaml.safe_load(result_yaml(result))["outline"]["deviation"] == 8e-5
    assert result.pairs()["outline error"] == "0.08 mm"


@pytest.mark.parametrize("name", SCENES)
def test_text_tells_the_figures(name):
    result = held(name)
    text = result_text(result)
    assert "12.25" in text
    assert all(contact.name in text for contact in result.contacts)
    assert ("Lift [N]" in text) is (result.scene.gravity[2] != 0.0)
    assert max(map(len, text.splitlines())) < 120


def test_repairs_are_said_once():
    result = replace(failed(), advice="Any one of these repairs it: lower object.mass to 0.46 kg. Use two.")
    assert further_advice(result) == "Use two."
    assert result_text(result).count("0.46 kg") == 1


# -- page ----------------------------------------------------------------------------------------------------


class Page(HTMLParser):
    """What a page holds; every element is closed in order."""

    EMPTY = frozenset({"meta", "br", "img", "link", "hr", "input"})

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.ids, self.links, self.text = [], [], [], [], ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        values = dict(attrs)
        if "id" in values:
            self.ids.append(values["id"])
        self.links += [values[key] for key in ("href", "src", "xlink:href", "data", "srcset") if key in values]
        self.links += re.findall(r"url\(([^)]*)\)", " ".join(v or "" for v in values.values()))
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.EMPTY:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


CIRCLE = np.stack([2 * np.cos(np.arange(24) * math.tau / 24), 2 * np.sin(np.arange(24) * math.tau / 24)], axis=1)


def drawn_page(result):
    return page_of(result, pictures={"grasp": plot_grasp(result, resisted=CIRCLE if result.solved else False)})


@pytest.mark.parametrize("result", [held(), failed(), failed(arrays=False)], ids=["held", "closest", "none"])
def test_page_is_whole_and_refers_to_nothing_else(result):
    text = drawn_page(result)
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert page.tags.count("svg") == (3 if result.solved else 1)  # the grasp, friction, resisted forces
    assert len(page.ids) == len(set(page.ids))
    assert page.links
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)
    assert not re.search(r"https?:|@import|<script|<link|<iframe", text)
    assert result.message in page.text
    assert "viewport" in text


def test_page_tells_the_figures():
    page = Page(drawn_page(held()))
    assert "12.25" in page.text
    assert "finger.tip" in page.text
    assert "Resisted force: 2 N in any direction" in page.text
    assert "mass: 0.3" in page.text  # of the scene
    assert "0.25" in page.text  # of the statistics


def test_why_there_is_no_grasp_is_said_everywhere():
    result, data = failed(), yaml.safe_load(result_yaml(failed()))
    assert data["reasons"][0]["needed"] == 0.46
    assert data["reasons"][0]["key"] == "object.mass"
    assert "grasp" not in data
    assert len(data["closest_attempt"]["contacts"]) == 3
    assert "closest_attempt" not in yaml.safe_load(result_yaml(failed(arrays=False)))
    text, page = result_text(result), Page(page_of(result)).text
    assert "lower object.mass to 0.46 kg   (object.mass, now 1.5 kg)" in text
    assert "Why there is no grasp" in page
    for said in ("0.46 kg", "lift: 3.2 N", "Use two."):
        assert said in text
        assert said in page


def test_page_has_a_row_for_each_of_two_limits_at_once():
    (one,) = failed().reasons
    other = Reason("tension", "finger.tendons.max_tension", "N", 12.0, 34.5, "too weak", "stronger")
    text = page_of(replace(failed(), reasons=(replace(one, also=(other,)),)))
    rows = [re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in re.findall(r"<tr>.*?</tr>", text)]
    numbers = {row[1]: (row[2], row[3]) for row in rows if len(row) == 5 and row[1] in (one.key, other.key)}
    assert numbers == {"object.mass": ("1.5 kg", "0.46 kg"), "finger.tendons.max_tension": ("12 N", "34.5 N")}


def test_page_escapes_what_the_user_wrote():
    result = GraspResult(
        scene_of("mug", name=NASTY), GraspStatus.NOT_SOLVED, NASTY, {}, advice=NASTY, violated=(NASTY,)
    )
    text = page_of(result)
    assert "<script" not in text
    assert Page(text).text.count(NASTY) >= 4


@pytest.mark.parametrize("name", few(SCENES, 8))
def test_page_holds_a_scene_that_can_be_read_again(name):
    scene = scene_of(name)
    page = Page(page_of(GraspResult(scene, GraspStatus.NOT_SOLVED, "")))
    given = page.text[page.text.index("schema_version:") :]
    assert GraspScene.model_validate(yaml.safe_load(given)) == scene


# -- pictures ------------------------------------------------------------------------------------------------


def labels_of(ax):
    return [text for text in ax.texts if text.get_text() and text.get_zorder() == 8]


def background(ax):
    """The picture without labels and grid, as (height, width, 3), and where the labels were [pixels]."""
    figure = ax.figure
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in labels_of(ax)]
    for text in labels_of(ax):
        text.set_visible(False)
    for line in ax.lines:
        if line.get_zorder() == 5.5:  # from a label to what it names
            line.set_visible(False)
    ax.grid(False)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3], boxes


@pytest.mark.parametrize("name", few(SCENES, 8))
@pytest.mark.parametrize("shown", [held, lambda name: failed(name, arrays=False)], ids=["held", "start"])
def test_labels_lie_on_nothing(name, shown):
    ax = plot_grasp(shown(name), resisted=False)
    pixels, boxes = background(ax)
    assert boxes
    height = pixels.shape[0]
    for k, box in enumerate(boxes):
        under = pixels[height - math.ceil(box.y1) : height - math.floor(box.y0), math.floor(box.x0) : math.ceil(box.x1)]
        assert (under == under[0, 0]).all(), labels_of(ax)[k].get_text()  # one color: paper, or the object's body
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_a_force_is_written_alike_everywhere():
    scene = scene_of("mug")
    arrays = {**made_up(scene), "finger.tensions": np.array([37.6123, 0.99])}
    result = GraspResult(scene, GraspStatus.OPTIMAL, "held", arrays)
    texts = (
        result_text(result),
        Page(page_of(result).replace("</td>", " </td>")).text,
        " ".join(result.pairs().values()),
        " ".join(text.get_text() for ax in plot_grasp(result, resisted=False).figure.axes for text in ax.texts),
    )
    for text in texts:
        assert re.findall(r"37\.6\d*", text) in ([], ["37.61"])
        assert set(re.findall(r"38\.6\d*", text)) <= {"38.60"}  # their sum
        assert "2.50" in text  # normal forces
    assert sum("38.60" in text for text in texts) == 3
    assert sum("37.61" in text for text in texts) == 3


@pytest.mark.parametrize(
    ("most", "force", "text"),
    [
        (38.604, 38.604, "38.60"),
        (38.604, -0.004, "0.00"),
        (9.9996, 1.0, "1.000"),
        (0.0123, 0.0123, "0.01230"),
        (12345.0, 2.25, "2.25"),
        (0.0, 0.0, "0.00"),
        (2e-9, 2e-9, "0.000000002"),
        (2e-12, 2e-12, "0.000000000"),
    ],
)
def test_the_greatest_force_has_four_digits(most, force, text):
    assert force_text({"finger.tensions": np.array([most, 0.0])}, force) == text
    assert force_text({"contact_forces": np.array([[0.0, -most, 0.0]])}, force) == text


def test_contact_forces_have_two_digits_beside_tensions_unless_nothing_presses():
    """Of a gripper of millimeters, whose tensions bend its fingers; and of an attempt that touches nothing."""
    tensions = {"left.tensions": np.array([0.0193, 0.005]), "right.tensions": np.array([0.005, 0.0193])}
    pressed = {**tensions, "contact_forces": np.array([[0.0368, 1.5e-5, 0.0]])}
    assert force_text(pressed, 0.0368, "mN") == "36.80"
    weakly = {**tensions, "finger.tensions": np.array([38.6, 0.0]), "contact_forces": np.array([[0.123, 0.0, 0.0]])}
    assert force_units(weakly) == ("N", "N")
    assert (force_text(weakly, 0.123), force_text(weakly, 38.6)) == ("0.12", "38.60")
    idle = {**tensions, "contact_forces": np.array([[2e-9, 0.0, 0.0]])}
    assert (force_text(idle, 2e-9), force_text(idle, 0.0193)) == ("0.00000", "0.01930")


def test_forces_of_a_gripper_of_millimeters_are_in_millinewtons_and_micronewtons():
    """In report, summary and picture alike: units by the greatest tension and contact force."""
    scene = scene_of("micro_pinch")
    arrays = made_up(scene)
    arrays |= {f"{name}.tensions": np.array([0.0193, 0.005]) for name in ("left", "right")}
    rows = len(arrays["contact_forces"])
    arrays["contact_forces"] = np.tile([3.68e-5, 1.47e-5, 0.0], (rows, 1))
    result = GraspResult(scene, GraspStatus.OPTIMAL, "held", arrays)
    assert result.force_units == ("mN", "µN")
    drawn = plot_grasp(result, resisted=False).figure.axes
    pictured = " ".join(text.get_text() for ax in drawn for text in ax.texts)
    for text in (result_text(result), pictured):
        assert "19.30" in text
        assert "36.8" in text
        assert "14.7" in text
        assert re.search(r"(Normal|contact) \[µN\]", text)
        assert re.search(r"(Left tendon|tendons) \[mN\]", text)
        assert "[N]" not in text
        assert "e-05" not in text
    assert "weight 29.4 µN" in pictured  # 3 mg x 9.81 m/s2
    assert result.pairs()["sum of tensions"] == "48.60 mN"
    assert result.pairs()["greatest normal force"] == "36.8 µN"


def test_lift_is_drawn_beside_friction_in_the_plane():
    scene = scene_of("mug")  # its friction coefficient is 0.5
    arrays = made_up(scene)
    arrays["contact_forces"] = np.array([[2.0, 0.6, 0.8], [2.0, -0.6, 0.0], [2.0, 0.0, 0.5]])  # 0 %, 40 %, 50 % left
    result = GraspResult(scene, GraspStatus.OPTIMAL, "held", arrays)
    drawn = plot_friction(result)
    rims = [patch.center for patch in drawn.patches[::2]]
    dots = [line.get_xydata()[0] for line in drawn.lines if line.get_marker() == "o"]
    assert [1.0 - math.dist(*pair) for pair in zip(rims, dots, strict=True)] == pytest.approx([0.0, 0.4, 0.5])
    assert dots[0] - rims[0] == pytest.approx([0.6, 0.8])
    ax = plot_grasp(result, resisted=False)
    wedges = [patch.get_xy() for patch in ax.patches if patch.get_zorder() == 1.4]
    left = []
    for outer, inner in zip(wedges[::2], wedges[1::2], strict=True):
        angles = [np.subtract(*np.unwrap([math.atan2(*(w[k] - w[0])[::-1]) for k in (1, -2)])) for w in (outer, inner)]
        assert math.tan(0.5 * abs(angles[0])) == pytest.approx(0.5)
        left.append(2.0 * math.tan(0.5 * abs(angles[1])))  # N
    # at the first contact all that lift leaves is used, as friction in the plane: 0.6 N
    assert left == pytest.approx([0.6, 1.0, math.sqrt(0.75)])


def test_what_does_not_hold_is_not_drawn_as_held():
    ax = plot_grasp(failed("mug_lying"))
    assert len(ax.collections) == 2  # arrows of the weight, and of the scale
    assert not [patch for patch in ax.patches if patch.get_zorder() == 1.4]  # friction cones
    assert not any("2.5" in text.get_text() for other in ax.figure.axes for text in other.texts)
    assert "Too heavy." in ax.get_title("left")
    assert "closest attempt" in " ".join(ax.get_title("left").split())
    assert any("0.46 kg" in text.get_text() for other in ax.figure.axes for text in other.texts)
    body = next(patch for patch in ax.patches if patch.get_zorder() == 1.5)
    red, green, blue, _ = body.get_facecolor()
    assert red == green == blue


def test_the_grasp_of_the_first_repair_is_said_to_be_one():
    arrays = made_up(scene_of("heavy_bottle"))
    result = replace(failed(), arrays=arrays, reasons=(replace(REASON, arrays=arrays),), violated=())
    assert result.answer == "first_repair"
    assert "first repair" in " ".join(plot_grasp(result).get_title("left").split())
    text, page, data = result_text(result), Page(page_of(result)).text, yaml.safe_load(result_yaml(result))
    for said in (text, page):
        assert "The grasp with the first repair (lower object.mass to 0.46 kg)" in said
        assert "closest" not in said
    assert len(data["first_repair"]["contacts"]) == 3
    assert "arrays" not in data["reasons"][0]


@pytest.mark.parametrize(("apart", "count"), [(1e-5, 3), (0.02, 4)])
def test_two_contacts_with_a_face_too_short_to_be_seen_are_drawn_as_one(apart, count):
    """The two of a palm, 10 um apart as on an outline that was cut into chords: one dot, one arrow of both forces."""
    result = held("mug_lying")
    palm = {name: value[[-1]] for name, value in result.arrays.items() if name.startswith("contact_")}
    palm["contact_positions"] = palm["contact_positions"] + [0.0, apart]
    arrays = {name: np.concatenate([v, palm[name]]) if name in palm else v for name, v in result.arrays.items()}
    arrays["contact_names"] = np.array(["finger.middle", "finger.tip", "palm.1", "palm.2"])
    arrays["contact_forces"] = np.array([[2.5, -0.75, 0.0], [2.5, -0.75, 0.0], [1.0, 0.5, 0.0], [0.5, -0.5, 0.0]])
    result = replace(result, arrays=arrays)
    ax = plot_grasp(result, resisted=False)
    arrows = [np.hypot(*quiver.U, *quiver.V) for quiver in ax.collections]
    assert len(arrows) == count + 2  # with the weight and the scale
    if count == 3:
        assert "palm.1\npalm.2" in [text.get_text() for text in ax.texts]
        assert arrows[2] == pytest.approx(1.5 * GraspView(result).force_scale)


def test_forces_are_to_scale():
    view = GraspView(held("mug_lying"))
    assert view.greatest_force == pytest.approx(0.30 * 9.81)  # the weight: contacts have sqrt(2.5^2 + 0.75^2)
    assert view.force_scale * view.greatest_force == pytest.approx(0.36 * 0.08)


def test_unloaded_fingers_are_straight_or_as_bent_as_at_rest():
    line = GraspView(failed("mug", arrays=False)).backbones["finger"]
    assert line[-1, 1:3] == pytest.approx([0.18, -0.055])
    line = GraspView(failed("preshaped", arrays=False)).backbones["finger"]
    truth = bent((0.0, -0.048, -0.5 * math.pi), 0.18, 8.0)[-1]
    assert line[-1, 1:] == pytest.approx(truth[1:], abs=2e-5)


def test_resisted_forces_are_drawn():
    assert resistance_extremes(CIRCLE) == pytest.approx((2.0, 2.0))
    assert resistance_extremes(np.full((4, 2), np.nan)) == (0.0, 0.0)
    assert resistance_extremes([[3.0, 0.0], [0.0, 1.0], [-2.0, 0.0], [np.nan, 1.0]]) == pytest.approx((1.0, 3.0))
    assert resistance_words(CIRCLE) == "resisted force: 2 N in any direction,\nup to 2 N in the best"
    assert resistance_words([[2.0, 0.0], [-np.inf, np.nan]]).endswith("without limit in the best")
    ax = plot_resistance(CIRCLE)
    assert ax.get_xlabel() == "force x [N]"
    assert ax.patches[0].get_xy()[0] == pytest.approx([2.0, 0.0])


@pytest.mark.parametrize(("size", "unit"), [(1e-5, "µN"), (1e-3, "mN"), (0.1, "N"), (2.0, "N"), (300.0, "N")])
def test_axes_of_resisted_forces_count_what_they_say(size, unit):
    """Ticks say where they are, in the unit of the label, times what matplotlib writes beside the axis."""
    ax = plot_resistance(size * CIRCLE)
    ax.figure.canvas.draw()
    for axis in (ax.xaxis, ax.yaxis):
        written = [
            float(text.replace("\N{MINUS SIGN}", "-")) for text in map(Text.get_text, axis.get_ticklabels()) if text
        ]
        factor = float(axis.get_offset_text().get_text() or 1.0) * to_si(f"1 {unit}", "N")
        assert axis.get_label_text() == f"force {'x' if axis is ax.xaxis else 'y'} [{unit}]"
        assert factor * np.array(written) == pytest.approx(axis.get_majorticklocs(), abs=1e-9 * size)


def test_a_small_scene_fills_its_picture():
    """A finger of 2 mm is not a dot between margins that are meant for fingers of 20 cm."""
    lengths = ("finger.rod.length", "finger.half_thickness", "object.diameter", "finger.base.position[1]")
    lengths += ("finger.rod.diameter", "finger.tendons.offset", "finger.masses[0].at", "object.position[0]")
    path = ROOT / "configs" / "grasp" / "mug.yaml"
    values = {key: 0.01 * float(eval(key, {}, dict(load(path)))) for key in lengths}
    view = GraspView(replace(failed("mug", arrays=False), scene=load(path, values)))
    left, right, bottom, top = view.box
    drawn = np.ptp(np.concatenate([view.body("finger"), *view.outlines]), axis=0).max()
    assert 1.8e-3 < drawn < 2e-3
    assert drawn < max(right - left, top - bottom) < 1.5 * drawn


# -- files and command line ----------------------------------------------------------------------------------


@pytest.mark.parametrize("status", [GraspStatus.INFEASIBLE, GraspStatus.NOT_SOLVED])
def test_command_saves_a_failure_and_says_so(tmp_path, monkeypatch, status):
    result = failed()
    result = GraspResult(result.scene, status, "too heavy", result.arrays, None, (REASON,), "Use two.")
    monkeypatch.setattr(continuum_grasp.grasp, "optimize_grasp", lambda scene, **options: result)
    done = run("grasp", ROOT / "configs" / "grasp" / "heavy_bottle.yaml", "--out", tmp_path)
    assert done.exit_code == 1
    assert f"too heavy (status: {status})" in done.output
    assert "0.46 kg" in done.output
    found = {path.name for path in tmp_path.iterdir()}
    assert found == {".run.json", "result.npz", "meta.json", "result.yaml", "grasp.png", "report.html"}
    assert read_run(tmp_path).meta["status"] == status
    assert "Why there is no grasp" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_command_says_that_a_grasp_is_unstable_and_ends_with_its_own_status(tmp_path, monkeypatch):
    result = held()
    certificate = certify(result.scene, result.arrays)
    result = replace(
        result, status=GraspStatus.UNSTABLE, message="in balance", certificate=certificate, advice="Stiffen."
    )
    monkeypatch.setattr(continuum_grasp.grasp, "optimize_grasp", lambda scene, **options: result)
    done = run("grasp", ROOT / "configs" / "grasp" / "mug.yaml", "--out", tmp_path)
    assert done.exit_code == 3
    assert "UNSTABLE: in balance\n" in done.output
    for word in ("disturbance", "would hold", "Why there is no grasp", "no grasp"):
        assert word not in done.output
    assert "finger.tip" in done.output
    assert read_run(tmp_path).meta["status"] == "unstable"
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    assert "UNSTABLE" in page
    assert "Why there is no grasp" not in page
    assert "unstable_grasp" in yaml.safe_load((tmp_path / "result.yaml").read_text(encoding="utf-8"))
    assert "UNSTABLE: in balance" in plot_grasp(result).get_title("left")


def test_command_begins_with_the_verdict(tmp_path, monkeypatch):
    result = held()
    result = replace(result, statistics={"cut_short": "iterations"}, certificate=certify(result.scene, result.arrays))
    monkeypatch.setattr(continuum_grasp.grasp, "optimize_grasp", lambda scene, **options: result)
    done = run("grasp", ROOT / "configs" / "grasp" / "mug.yaml", "--out", tmp_path, "--no-pictures")
    assert done.output.startswith("optimal: held\n")
    assert "warning: the search was cut short" in done.output


def test_a_contact_that_is_on_and_carries_nothing_is_reported():
    result = optimize_grasp("configs/grasp/mug_arcs.yaml")
    forces = result.arrays["contact_forces"].copy()
    assert not any("without a force" in warning for warning in result.warnings)
    middle = [contact.name for contact in result.contacts].index("finger.middle")
    forces[middle] = 1e-9
    idle = replace(result, arrays={**result.arrays, "contact_forces": forces})
    assert any(warning.startswith("finger.middle on, but without a force") for warning in idle.warnings)
    auto = result.scene.changed({"contacts.middle": "auto"})
    assert not any("without a force" in warning for warning in replace(idle, scene=auto).warnings)
