"""Pictures: what is drawn is what was given, axes carry units, and nothing global changes."""

from __future__ import annotations

import os
import re
import shutil
import stat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.text import Text
from PIL import Image

import continuum_grasp as cg
from continuum_grasp.base import InputError, SolverError
from continuum_grasp.plotting import StyledAxes, Z
from continuum_grasp.results import MotionResult, save_picture
from continuum_grasp.scene import Finger, Rod
from continuum_grasp.simulation import Modes, Trajectory
from tests.commands import python

LENGTH = 0.6
ROD = Rod(length=LENGTH, linear_density=0.02, bending_stiffness=0.05)


class Motion(MotionResult):
    """A finger that stays one circular arc: everything about it is known in closed form."""

    pictures = Trajectory.pictures
    frames = Trajectory.frames
    length = LENGTH
    n = 2
    name = "one arc"
    status = "finished"
    object_pose = contacts = tensions = None
    x_names = ("theta_1 [rad]", "theta_2 [rad]", "theta_1 rate [rad/s]", "theta_2 rate [rad/s]")

    def __init__(self, count: int = 101, forces: bool = True, mass: float = 0.02) -> None:
        self.t = np.linspace(0.0, 1.0, count)
        self.bend = 0.8 * np.cos(7.0 * self.t) + 0.1
        self.x = np.column_stack([self.bend / 2, self.bend / 2, -2.8 * np.sin(7.0 * self.t), self.t])
        self.kinetic = 0.1 * self.t
        self.potential = 0.3 - 0.2 * self.t
        self.tip = self.backbone(range(count))[:, -1]
        self.forces = forces
        masses = [{"at": LENGTH / 2, "mass": mass}, {"at": LENGTH, "mass": mass}]
        self.scene = SimpleNamespace(finger=Finger(rod=ROD, masses=masses), object=None, supports={})

    def backbone(self, indices: object, points: int = 50) -> np.ndarray:
        s = np.linspace(0.0, 1.0, points)
        theta = self.bend[np.asarray(indices, dtype=int)][:, None]
        # clamped along world +X: base angle -pi/2
        return LENGTH / theta[..., None] * np.stack([np.sin(theta * s), 1 - np.cos(theta * s)], axis=-1)

    def loads_at(self, index: int) -> list[tuple[np.ndarray, np.ndarray, str]]:
        if not self.forces:
            return []
        shape = self.backbone([index], 3)[0]
        return [(shape[1], np.array([0.0, 0.2]), "contact"), (shape[2], np.array([0.4, 0.0]), "load")]


def some_modes(count: int = 3, stable: bool = True) -> Modes:
    s = np.linspace(0.0, 1.0, 40)
    bend = np.stack([np.sin((k + 0.5) * np.pi * s) * s for k in range(count)])
    shapes = np.stack([0 * bend, bend / np.abs(bend).max(axis=1, keepdims=True)], axis=-1)
    made = Modes.__new__(Modes)
    made.__dict__.update(
        frequencies_hz=2.5 * (1 + np.arange(count)) ** 2,
        damping_ratios=np.where(np.arange(count) == 1, np.nan, 0.01),
        backbone=np.column_stack([LENGTH * s, 0 * s]),
        shapes=shapes,
        equilibrium=SimpleNamespace(stable=stable),
        scene=SimpleNamespace(finger=Finger(rod=ROD)),
    )
    return made


def new_axes(count: int = 1) -> list:
    from matplotlib.figure import Figure

    return list(Figure().subplots(1, count, squeeze=False)[0])


@pytest.fixture(scope="module")
def motion() -> Motion:
    return Motion()


PLOTS = {
    "tip_path": ("x [mm]", "y [mm]"),
    "coordinates": ("time [s]", "bending angle [rad]"),
    "energy": ("time [s]", "energy [J]"),
    "snapshots": ("x [mm]", "y [mm]"),
}


@pytest.mark.parametrize("name", PLOTS)
def test_axes_are_labeled_with_units_and_used_where_given(motion: Motion, name: str) -> None:
    given = new_axes()[0]
    for ax in (motion.plot(picture=name), motion.plot(given, picture=name)):
        assert (ax.get_xlabel(), ax.get_ylabel()) == PLOTS[name]
        assert ax.get_title("left") == "one arc"
    assert ax is given


def test_a_title_given_by_the_user_stays(motion: Motion) -> None:
    ax = new_axes()[0]
    ax.set_title("mine")
    motion.plot(picture="energy", ax=ax)
    assert (ax.get_title(), ax.get_title("left")) == ("mine", "")


def test_tip_path_is_the_tip(motion: Motion) -> None:
    path = motion.plot(picture="tip_path").collections[0]
    segments = np.array(path.get_segments())
    np.testing.assert_allclose(segments[:, 0], motion.tip[:-1], atol=1e-15)
    np.testing.assert_allclose(segments[:, 1], motion.tip[1:], atol=1e-15)
    np.testing.assert_allclose(path.get_array(), (motion.t[1:] + motion.t[:-1]) / 2)


def test_coordinates_are_drawn_with_their_names(motion: Motion) -> None:
    ax = motion.plot(picture="coordinates")
    np.testing.assert_array_equal([line.get_ydata() for line in ax.lines], motion.x[:, :2].T)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [r"$\theta_{1}$", r"$\theta_{2}$"]


def test_energies_and_their_sum(motion: Motion) -> None:
    ax = motion.plot(picture="energy")
    drawn = {line.get_label(): line.get_ydata() for line in ax.lines}
    np.testing.assert_array_equal(drawn["kinetic"], motion.kinetic)
    np.testing.assert_array_equal(drawn["potential"], motion.potential)
    np.testing.assert_allclose(drawn["total"], 0.3 - 0.1 * motion.t)


def quivers(ax: object) -> list:
    from matplotlib.quiver import Quiver

    return [one for one in ax.collections if isinstance(one, Quiver)]  # type: ignore[attr-defined]


@pytest.mark.parametrize(("size", "unit", "factor"), [(1.0, "J", 1.0), (1e-3, "mJ", 1e3), (1e-6, "µJ", 1e6)])
def test_an_axis_counts_in_the_unit_of_its_label(motion: Motion, size: float, unit: str, factor: float) -> None:
    motion.kinetic, motion.potential = size * motion.kinetic, size * motion.potential
    ax = motion.plot(picture="energy")
    assert ax.get_ylabel() == f"energy [{unit}]"
    ax.figure.canvas.draw()
    assert not ax.yaxis.get_offset_text().get_text()
    for tick, label in zip(ax.get_yticks(), ax.get_yticklabels(), strict=True):
        assert float(label.get_text().replace("\N{MINUS SIGN}", "-")) == pytest.approx(factor * tick)
    lines = {line.get_label(): line for line in ax.lines}
    np.testing.assert_array_equal(lines["kinetic"].get_ydata(), motion.kinetic)


def test_snapshots_draw_finger_forces_masses_and_clamp(motion: Motion) -> None:
    ax = motion.plot(picture="snapshots", times=[0.0, 0.25, 1.0])
    lines = ax.collections[0]
    np.testing.assert_allclose(lines.get_array(), [0.0, 0.25, 1.0])
    np.testing.assert_allclose(np.array(lines.get_segments()), motion.backbone([0, 25, 100], 60), atol=1e-15)

    contact, load = quivers(ax)
    np.testing.assert_allclose(contact.get_offsets(), motion.backbone([100], 3)[:, 1])  # the last alone
    # the greatest force, 0.4 N, is a quarter of the finger long; the other is half of that: one scale for all
    np.testing.assert_allclose([load.U, load.V], [[0.25 * LENGTH], [0.0]])
    np.testing.assert_allclose([contact.U, contact.V], [[0.0], [0.125 * LENGTH]])
    assert load.scale == 1.0
    assert load.angles == "xy"
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["20 g", r"contact at 1 s $\leq$ 0.2 N", r"load at 1 s $\leq$ 0.4 N"]

    spots = ax.collections[1].get_offsets()
    expected = motion.backbone([0, 25, 100], 3)[:, 1:].reshape(-1, 2)
    np.testing.assert_allclose(spots, expected, atol=1e-4 * LENGTH)  # chords of 59 pieces

    corners = ax.patches[0].get_xy()[:4]  # behind the base, across its direction (world +X)
    np.testing.assert_allclose(corners[:, 0].max(), 0.0, atol=1e-4 * LENGTH)
    assert corners[:, 0].min() < -0.02 * LENGTH
    for points in (
        np.concatenate([q.get_offsets() + np.column_stack([q.U, q.V]) for q in quivers(ax)]),
        motion.tip[[0, 25, 100]],
    ):
        assert np.all(points[:, 0] < ax.get_xlim()[1])
        assert np.all(points[:, 1] > ax.get_ylim()[0])
    assert ax.get_aspect() == 1.0


def test_snapshots_without_forces_and_masses() -> None:
    ax = Motion(forces=False, mass=0.0).plot(picture="snapshots", times=5)
    assert quivers(ax) == []
    assert ax.get_legend() is None
    assert len(ax.collections[0].get_array()) == 5


def test_snapshots_are_equally_far_along_the_way_of_the_tip() -> None:
    """A finger that bends within a fifth of the time, back by a half, and stays."""
    motion = Motion(count=1001, forces=False, mass=0.0)
    motion.bend = np.interp(motion.t, [0.0, 0.15, 0.2], [0.02, 0.6, 0.3])
    drawn = motion.plot(picture="snapshots", times=7).collections[0].get_array()
    assert (drawn[0], drawn[-1]) == (0.0, 1.0)
    assert (drawn[:-1] < 0.2).all()
    # The way of the tip is its integrated speed; where the finger rests, it is at the end of it.
    gone = np.cumsum(np.hypot(*np.diff(motion.backbone(range(1001))[:, -1], axis=0).T))
    ways = np.append(0.0, gone)[(1000 * drawn).round().astype(int)]
    np.testing.assert_allclose(np.diff(ways), gone[-1] / 6, rtol=0.1)  # to the nearest instants


def test_a_load_that_has_faded_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = Motion()
    loads = motion.loads_at
    monkeypatch.setattr(
        motion, "loads_at", lambda k: [(p, f * (1e-16 if k == 100 else 1.0), w) for p, f, w in loads(k)]
    )
    assert quivers(motion.plot(picture="snapshots")) == []


def test_a_finger_that_rests_is_drawn_at_both_ends() -> None:
    motion = Motion(forces=False, mass=0.0)
    motion.bend = np.full_like(motion.t, 0.4)
    np.testing.assert_array_equal(motion.plot(picture="snapshots").collections[0].get_array(), [0.0, 1.0])


@pytest.mark.parametrize("times", [[], [2.0], [-0.1], [float("nan")], 0])
def test_instants_outside_are_refused(motion: Motion, times: object) -> None:
    with pytest.raises(InputError):
        motion.plot(picture="snapshots", times=times)


def test_modes_swing_about_the_equilibrium() -> None:
    modes = some_modes()
    axes = modes.plot(amplitude=0.1).axes
    assert len(axes) == 3
    for k, ax in enumerate(axes):
        rest, plus, minus = (np.column_stack(line.get_data()) for line in ax.lines[:3])
        np.testing.assert_allclose(rest, modes.backbone)
        np.testing.assert_allclose(plus - rest, 0.1 * LENGTH * modes.shapes[k])
        np.testing.assert_allclose(plus + minus, 2 * rest)
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [mm]", "y [mm]")
    titles = [ax.get_title() for ax in axes]
    assert titles == [r"mode 1: 2.5 Hz, $\zeta$ = 0.01", "mode 2: 10 Hz", r"mode 3: 22.5 Hz, $\zeta$ = 0.01"]
    assert axes[0].figure.get_suptitle() == ""
    assert "unstable" in some_modes(stable=False).plot().get_suptitle()


def test_modes_in_given_axes() -> None:
    given = new_axes(2)
    some_modes().plot(given)
    assert [ax.get_title().partition(":")[0] for ax in given] == ["mode 1", "mode 2"]
    for wrong in ({"ax": given, "count": 3}, {"count": 0}, {"count": 4}):
        with pytest.raises(InputError):
            some_modes().plot(**wrong)


def test_files_of_a_simulation(motion: Motion, tmp_path: Path) -> None:
    files = motion.save_pictures(tmp_path / "run")
    assert [f.name for f in files] == ["snapshots.png", "tip_path.png", "coordinates.png", "energy.png"]
    assert sorted(tmp_path.joinpath("run").iterdir()) == sorted(files)
    for file in files:
        with Image.open(file) as picture:
            picture.load()
            gray = np.asarray(picture.convert("L"))
        assert min(gray.shape) > 300
        assert 0.005 < np.mean(gray < 250) < 0.5


@pytest.mark.parametrize("suffix", ["pdf", "svg"])
def test_other_formats(motion: Motion, tmp_path: Path, suffix: str) -> None:
    file = save_picture(motion.plot(picture="energy"), tmp_path / f"energy.{suffix}")
    assert file.stat().st_size > 1000


def test_one_instant_and_a_run_that_ended_in_nan(tmp_path: Path) -> None:
    Motion(count=1).save_pictures(tmp_path)
    broken = Motion()
    for name in ("bend", "x", "tip", "kinetic", "potential"):
        getattr(broken, name)[60:] = np.nan
    broken.save_pictures(tmp_path)
    broken.animate(tmp_path / "a.gif", fps=5, width=200)


def gif(path: Path) -> tuple[list[int], list[np.ndarray]]:
    durations, pictures = [], []
    with Image.open(path) as animation:
        for k in range(animation.n_frames):
            animation.seek(k)
            pictures.append(np.asarray(animation.convert("RGB")))
            durations.append(animation.info["duration"])
    return durations, pictures


def test_animation_plays_at_the_right_speed(motion: Motion, tmp_path: Path) -> None:
    for fps, speed, count in ((30.0, 1.0, 31), (12.0, 0.5, 25)):
        durations, pictures = gif(motion.animate(tmp_path / "a.gif", fps, speed=speed, width=240))
        assert len(durations) == count
        assert abs(sum(durations[:-1]) - 1000.0 / speed) <= 5.0  # to the half of a hundredth of a second
        assert max(durations[:-1]) - min(durations[:-1]) <= 10
        assert pictures[0].shape[1] == 240
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


def test_animation_shows_the_finger_where_it_is(tmp_path: Path) -> None:
    """Blue pixels of the backbone: highest at the start, where the bend is greatest, and mirrored later."""
    motion = Motion(forces=False, mass=0.0)
    _, pictures = gif(motion.animate(tmp_path / "a.gif", 10.0, width=300))
    heights = []
    for picture in pictures:
        rows, columns = np.nonzero((picture[..., 2] > 130) & (picture[..., 0] < 60))
        heights.append(rows[columns == columns.max()].mean())
    tips = motion.tip[[np.argmin(abs(motion.t - k / 10)) for k in range(11)], 1]
    slope, offset = np.polyfit(tips, heights, 1)
    assert slope < 0
    np.testing.assert_allclose(heights, slope * tips + offset, atol=3.0)
    assert (pictures[0][2, 2] == 255).all()


@pytest.mark.parametrize(
    ("name", "settings", "key"),
    [
        ("a.avi", {}, "path"),
        ("a.gif", {"fps": 0.0}, "fps"),
        ("a.gif", {"fps": 60.0}, "fps"),
        ("a.gif", {"speed": -1.0}, "speed"),
        ("a.gif", {"width": 40}, "width"),
        ("a.gif", {"fps": float("nan")}, "fps"),
    ],
)
def test_animation_refuses(motion: Motion, tmp_path: Path, name: str, settings: dict, key: str) -> None:
    with pytest.raises(InputError) as caught:
        motion.animate(tmp_path / name, **settings)
    assert caught.value.key == key
    assert list(tmp_path.iterdir()) == []


def test_mp4_without_ffmpeg_says_what_to_do(motion: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"use \.gif"):
        motion.animate(tmp_path / "a.mp4")


@pytest.mark.skipif(os.name != "posix", reason="needs a shell script on the path")
@pytest.mark.parametrize("works", [True, False])
def test_mp4_gives_ffmpeg_every_frame(
    motion: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, works: bool
) -> None:
    tools = tmp_path / "bin"
    tools.mkdir()
    script = tools / "ffmpeg"
    last = 'for last; do :; done; cat > "$last"; echo "$@" > "$0.said"' if works else "echo no coder >&2; exit 3"
    script.write_text(f"#!/bin/sh\n{last}\n")
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tools}{os.pathsep}{os.environ['PATH']}")
    path = tmp_path / "out" / "a.mp4"
    if not works:
        with pytest.raises(SolverError, match="no coder"):
            motion.animate(path, 10.0, width=161)
        assert list(path.parent.iterdir()) == []
        return
    motion.animate(path, 10.0, width=161)
    said = (tools / "ffmpeg.said").read_text().split()
    width, height = (int(v) for v in said[said.index("-s") + 1].split("x"))
    assert width == 160
    assert height % 2 == 0
    assert said[said.index("-r") + 1] == "10"
    assert path.stat().st_size == 11 * 3 * width * height


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_mp4(motion: Motion, tmp_path: Path) -> None:
    content = motion.animate(tmp_path / "a.mp4", width=160).read_bytes()
    assert content[4:8] == b"ftyp"


GLOBAL_STATE = """
import sys
import continuum_grasp.plotting
assert "matplotlib" not in sys.modules, "matplotlib is imported before a picture is drawn"
assert "PIL" not in sys.modules
import matplotlib
# reading the backend would import pyplot
state = lambda: {k: matplotlib.rcParams[k] for k in matplotlib.rcParams if k != "backend"}
before = state()
sys.path.insert(0, sys.argv[1])
import test_plotting as given
from pathlib import Path
given.Motion().save_pictures(Path(sys.argv[2]))
given.Motion().plot(picture="energy")
given.some_modes().plot()
given.Motion().animate(Path(sys.argv[2]) / "a.gif", fps=5, width=160)
assert "matplotlib.pyplot" not in sys.modules, "pyplot keeps global figures"
assert state() == before, "the global style changed"
"""


@pytest.mark.deep
def test_nothing_global_is_touched(tmp_path: Path) -> None:
    done = python("-c", GLOBAL_STATE, Path(__file__).parent, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


def test_pictures_for_paper_are_as_wide_as_a_column(tmp_path: Path) -> None:
    run = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.05"]))
    files = run.save_pictures(tmp_path, format="pdf", style="paper")
    assert {file.suffix for file in files} == {".pdf"}
    for file in files:
        width = float(re.search(rb"/MediaBox \[ ?0 0 ([\d.]+)", file.read_bytes())[1])
        assert width / 72.0 == pytest.approx(3.46, abs=0.01)
    for wrong in ({"format": "jpg"}, {"style": "poster"}):
        with pytest.raises(InputError, match="expected"):
            run.save_pictures(tmp_path, **wrong)


def test_a_finger_wider_than_a_line_is_drawn_as_thick_as_it_is() -> None:
    run = cg.simulate(cg.load("configs/simulate/tendon_step.yaml", ["time.duration=0.02", "time.step=0.01"]))
    finger = run.scene.finger
    patches = run.plot(picture="snapshots", times=[0.0]).patches
    (body,) = (patch.get_xy() for patch in patches if patch.get_zorder() == Z.BODY)
    # The straight finger points along +Y.
    assert np.ptp(body[:, 0]) == pytest.approx(2.0 * finger.half_thickness, rel=1e-6)


@pytest.mark.parametrize("box", [(-0.13, 0.13, 0.0, 0.21), (-0.15, 0.15, 0.0, 0.1), (-0.05, 0.05, 0.0, 0.3)])
def test_a_saved_picture_of_equal_scales_shows_its_title_whole(box: tuple[float, ...], tmp_path: Path) -> None:
    styled = StyledAxes.plane(None, box)
    ax = styled.ax
    styled.draw_timed([np.array([box[::2], box[1::2]])], np.zeros(1), np.array([0.0, 1.0]))
    styled.head("Three tendons")
    save_picture(ax, tmp_path / "title.png")
    title = next(text for text in ax.findobj(Text) if text.get_text() == "Three tendons").get_window_extent()
    assert title.y1 < ax.figure.bbox.y1


@pytest.mark.parametrize("name", ["between 5 $ and 6 $", "$x^{$", "one $"])
def test_dollar_signs_of_a_name_are_drawn_as_they_are(name: str, tmp_path: Path) -> None:
    """Matplotlib without its formulas draws the same pixels."""
    pictures = []
    for words in (name, "another"):
        ax = new_axes()[0]
        StyledAxes(ax).head(words)
        if words != name:
            title = next(text for text in ax.findobj(Text) if text.get_text() == words)
            title.set(text=name, parse_math=False)
        pictures.append(np.array(Image.open(save_picture(ax, tmp_path / "title.png"))))
    np.testing.assert_array_equal(*pictures)


def test_a_long_name_leaves_the_drawing_its_place(tmp_path: Path) -> None:
    """Axes are as large as under a short name but for its lines, and nothing of it is cut off."""
    shapes = []
    for name in ("short", "a name that is a sentence of its own, longer than the picture is wide, and then some"):
        styled = StyledAxes.plane(None, (-0.1, 0.2, -0.6, 0.0))
        ax = styled.ax
        styled.draw_timed([np.array([[0.0, 0.0], [0.1, -0.6]])], np.zeros(1), np.array([0.0, 1.0]))
        styled.head(name)
        save_picture(ax, tmp_path / "name.png")
        title = next(text for text in ax.findobj(Text) if text.get_text().startswith(name[:5]))
        assert title.get_window_extent().x1 < ax.figure.bbox.x1
        shapes.append(ax.get_window_extent().height)
    assert shapes[1] > 0.75 * shapes[0]
