"""What results declare: everything that is drawn or written of them exists, and files hold what was declared."""

from __future__ import annotations

import base64
import gc
import inspect
import json
import re
import sys
import weakref
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from continuum_grasp.addons.planning import MotionPlan
from continuum_grasp.base import InputError, named_value
from continuum_grasp.grasp import GraspStatus
from continuum_grasp.results import Dimension, File, Picture, Result, Stored, read_run
from continuum_grasp.simulation import Modes, Trajectory
from tests.declared import assert_declared
from tests.results_page import BEGIN, MADE_BY, PAGE, lists

CONFIGS = Path(__file__).parents[2] / "configs"
FILES = [
    (result, one) for result in MADE_BY for one in (*result.texts, *result.pages, *result.pictures, *result.on_request)
]


@dataclass(frozen=True)
class Case(Result):
    """One array that is there, one that is not, one that lies deeper, and words."""

    kind: ClassVar[str] = "case"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("force", "(time,)", "N", "pull"),
        Stored("absent", "(time,)", "N", "nothing"),
        Stored("first", "(xy,)", "N", "of another result", "inner.force"),
        Stored("labels", "(label,)", "text", "words"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (Dimension("time", "instants"),)
    force: np.ndarray
    inner: Case | None = None
    absent: None = None
    labels: tuple[str, ...] = ()
    scene: None = None
    status: str = "finished"
    warnings: tuple[str, ...] = ("a warning",)
    statistics: dict[str, Any] = field(default_factory=dict)

    def parts(self) -> dict[str, Result]:
        return {} if self.inner is None else {"inner": self.inner}


def test_a_folder_holds_what_is_declared(tmp_path: Path) -> None:
    inner = Case(np.array([1.0, 2.0]), labels=("a", "bc"))
    run = Case.read(Case(np.array([3.0]), inner).save(tmp_path / "run"))
    assert {name: value.tolist() for name, value in run.arrays.items()} == {
        "force": [3.0],
        "first": [1.0, 2.0],
        "labels": [],
    }
    assert run.arrays["labels"].dtype.kind == "U"  # also where there are none
    assert f"Run of case, finished, in {tmp_path / 'run'}".startswith(repr(run).splitlines()[0].removesuffix("..."))
    assert "  force   (1,) float64" in repr(run)
    assert (run.meta["kind"], run.meta["status"], run.meta["warnings"]) == ("case", "finished", ["a warning"])
    assert read_run(tmp_path / "run" / "inner").arrays["labels"].tolist() == ["a", "bc"]


def test_a_run_of_another_kind_is_refused(tmp_path: Path) -> None:
    Case(np.zeros(1)).save(tmp_path)
    with pytest.raises(InputError, match="expected the folder of a run of plan, got a run of case"):
        MotionPlan.load(tmp_path)


@pytest.mark.parametrize(("result", "one"), FILES, ids=[f"{r.__name__}-{f.name}" for r, f in FILES])
def test_what_makes_a_file_takes_the_result_and_axes(result: type[Result], one: File | Picture) -> None:
    signature = inspect.signature(named_value(one.maker))
    if not isinstance(one, Picture):
        signature.bind(object())
        return
    options = {"x": "a", "y": "b", "color": "c"} if one in result.on_request else {}
    signature.bind(object(), **options, **({} if one.panels else {"ax": object()}))
    assert hasattr(result, one.needs) or not one.needs
    assert re.fullmatch("[a-z_]+", one.name)


@pytest.mark.parametrize("result", MADE_BY)
def test_declared_arrays_have_a_name_dimensions_and_a_meaning(result: type[Result]) -> None:
    names = [one.name for one in result.stored]
    dimensions = [one.name for one in result.dimensions]
    assert len(set(names)) == len(names)
    assert len(set(dimensions)) == len(dimensions)
    assert not set(names) & set(dimensions)  # xarray has one name space
    for one in result.stored:
        assert set(one.dimensions) <= set(dimensions), one
        assert len(set(one.dimensions)) == len(one.dimensions), one
        assert one.shape == f"({', '.join(one.dimensions)}{',' * (len(one.dimensions) == 1)})"
        assert one.meaning


def test_the_lists_in_the_documentation_are_what_results_declare() -> None:
    """If not: ``python -m tests.results_page``."""
    assert PAGE.read_text(encoding="utf-8").split(BEGIN)[1] == f"\n{lists()}"


@pytest.mark.deep
def test_saved_results_have_the_declared_shapes(tmp_path: Path) -> None:
    import continuum_grasp as cg

    scene = cg.load(CONFIGS / "simulate" / "swing_against_disc.yaml", ["time.duration=0.02"])
    results: list[Result] = [
        cg.simulate(scene),
        cg.modes(CONFIGS / "simulate" / "standing.yaml"),
        cg.equilibrium(CONFIGS / "simulate" / "standing.yaml"),
        cg.optimize_grasp(CONFIGS / "grasp" / "mug_arcs.yaml"),
    ]
    # tensions, and further modes, are those of winches and of friction, of which this finger has none
    lacking = {
        "simulate": {"tensions"},
        "modes": {"stuck_frequencies_hz", "free_frequencies_hz"},
        "equilibrium": {"tensions", "commands"},
    }
    for result in results:
        arrays = type(result).read(result.save(tmp_path / type(result).__name__)).arrays
        assert set(arrays) == {one.name for one in result.declared()} - lacking.get(result.kind, set())
        assert_declared(result, arrays)
    pulley = cg.load(CONFIGS / "simulate" / "motor_pulley.yaml", ["time.duration=0.02", "initial.reached_by=pulling"])
    named = (
        (cg.simulate(pulley), "tensions"),
        (cg.modes(pulley), "free_frequencies_hz"),
        (cg.equilibrium(pulley), "tensions"),
        (cg.equilibrium(pulley), "commands"),
    )
    for wound, name in named:
        arrays = wound.read(wound.save(tmp_path / wound.kind)).arrays
        assert name in arrays
        assert_declared(wound, arrays)


# -- what users see -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    import continuum_grasp as cg

    return cg.simulate(cg.load(CONFIGS / "simulate" / "hanging.yaml", ["time.duration=0.05"]))


@pytest.fixture(scope="module")
def several(motion: Trajectory) -> list[Result]:
    import continuum_grasp as cg

    modes = cg.modes(CONFIGS / "simulate" / "standing.yaml")
    grasp = cg.optimize_grasp(CONFIGS / "grasp" / "mug_arcs.yaml")
    failed = replace(grasp, status=GraspStatus.INFEASIBLE, message="too heavy", advice="object.mass = 0.63 kg")
    return [motion, modes, modes.equilibrium, grasp, failed]


def test_a_result_is_shown_in_a_few_lines(several: list[Result]) -> None:
    for result in several:
        assert len(repr(result)) < 1000
        first, *rest = repr(result).splitlines()
        assert first == f'{type(result).__name__} "{result.name}": {result.outcome}'
        assert 2 <= len(rest) <= 8
    assert "tip at the end" in repr(several[0])
    assert "object.mass = 0.63" in repr(several[-1])


def test_what_stands_in_for_a_summary_that_fails() -> None:
    @dataclass(frozen=True)
    class Broken(Case):
        def pairs(self) -> dict[str, str]:
            raise ValueError("no such array")

    assert repr(Broken(np.zeros(1))).endswith("no summary  ValueError: no such array")


@pytest.mark.deep
def test_nothing_is_written_to_see_a_picture(
    several: list[Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    monkeypatch.chdir(tmp_path)
    for result in several:
        for picture in result.drawable():
            drawn = result.plot(picture=picture.name)
            assert isinstance(drawn, Figure if picture.panels else Axes)
            png, size = drawn._repr_png_()  # type: ignore[union-attr]
            assert png.startswith(b"\x89PNG")
            assert 200 < size["width"] < 1500
    assert list(tmp_path.iterdir()) == []
    figure = weakref.ref(several[0].plot().figure)
    gc.collect()
    assert figure() is None  # nothing else holds it


def test_pictures_are_drawn_where_and_as_asked_for(several: list[Result]) -> None:
    from matplotlib.figure import Figure

    for result in several:
        for picture in result.drawable():
            ax = Figure().add_subplot()
            if picture.panels:
                with pytest.raises(InputError, match=f"{picture.name} has panels"):
                    result.plot(ax, picture=picture.name)
            else:
                assert result.plot(ax, picture=picture.name) is ax
                assert ax.has_data()
    motion = several[0]
    assert len(motion.plot(times=[0.0, 0.05]).collections[0].get_segments()) == 2
    modes = next(result for result in several if isinstance(result, Modes))
    figure = Figure()
    assert modes.plot([figure.add_subplot()]) is figure


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("path", "'path'; there are snapshots, tip_path, coordinates, energy$"),
        ("contact_forces", "there are snapshots, tip_path, coordinates, energy$"),  # there is no object
        (None, "color: no such option; snapshots takes times"),
    ],
)
def test_pictures_that_there_are_not(motion: Trajectory, given: str | None, said: str) -> None:
    with pytest.raises(InputError, match=said):
        motion.plot(picture=given, **({} if given else {"color": "red"}))
    with pytest.raises(InputError, match="ax: expected matplotlib axes, got list"):
        motion.plot(ax=[])
    with pytest.raises(InputError, match="got str; write picture='energy'"):
        motion.plot("energy")
    with pytest.raises(InputError, match="there is nothing to draw"):
        Case(np.zeros(1)).plot()


def test_a_notebook_shows_values_and_the_picture(motion: Trajectory) -> None:
    named = replace(motion, scene=motion.scene.replaced(name="<b>&"), warnings=("a < b",))
    page = named._repr_html_()
    assert "<b>Trajectory &quot;&lt;b&gt;&amp;&quot;: finished</b>" in page
    assert ">a &lt; b</td>" in page
    encoded = re.search('src="data:image/png;base64,([^"]*)"', page)
    assert encoded is not None
    assert base64.b64decode(encoded[1]).startswith(b"\x89PNG")


def test_a_notebook_shows_values_where_the_picture_fails(monkeypatch: pytest.MonkeyPatch, motion: Trajectory) -> None:
    def fails(*arguments: Any, **options: Any) -> None:
        raise ValueError("<no> canvas")

    monkeypatch.setattr(Trajectory, "plot", fails)
    page = motion._repr_html_()
    assert "tip at the end" in page
    assert page.endswith("<p>no picture: ValueError: &lt;no&gt; canvas</p></div>")


# -- tables -------------------------------------------------------------------------------------------------------


def test_a_motion_as_a_data_frame(motion: Trajectory) -> None:
    frame = motion.to_pandas()
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame.index, motion.t)
    np.testing.assert_array_equal(frame[["tip.x", "tip.y"]], motion.tip)
    np.testing.assert_array_equal(frame["x.kappa_1"], motion.x[:, 1])
    assert list(frame.attrs["units"]) == list(frame.columns) == list(frame.attrs["descriptions"])
    assert [frame.attrs["units"][name] for name in ("kinetic", "tip.x", "x.kappa_1")] == ["J", "m", "1/m"]
    states = motion.to_pandas("state")
    assert states["unit"].to_list() == ["1/m", "1/m", "1/m/s", "1/m/s"]
    np.testing.assert_array_equal(states.loc["kappa_0", "x.0.05"], motion.x[-1, 0])
    with pytest.raises(InputError, match="expected one of time, state, input, force_component, xy, got 'tip'"):
        motion.to_pandas("tip")


def test_a_motion_as_a_data_set(motion: Trajectory) -> None:
    found = motion.to_xarray()
    np.testing.assert_array_equal(found["tip"].sel(xy="y", time=0.02), motion.tip[20, 1])
    np.testing.assert_array_equal(found["x"].sel(state="kappa_1"), motion.x[:, 1])
    assert found["kinetic"].attrs == {"units": "J", "long_name": "kinetic energy, with the object's"}
    assert found["time"].attrs["units"] == "s"
    assert found["state_unit"].values.tolist() == ["1/m", "1/m", "1/m/s", "1/m/s"]
    assert found.attrs["name"] == motion.name


def test_all_results_become_tables(several: list[Result]) -> None:
    for result in several:
        arrays, found = result.stored_arrays(), result.to_xarray()
        for name, array in arrays.items():
            labels = {"t": "time", "contact_names": "contact", "places": "place"}
            np.testing.assert_array_equal(found[labels.get(name, name)], array)
        json.dumps([found.attrs, *(one.attrs for one in found.variables.values())])
        frame = result.to_pandas()
        json.dumps(frame.attrs)
        assert len(frame) == len(arrays.get("contact_names", next(iter(arrays.values()))))
    grasp = several[3].to_pandas()
    assert grasp.index.to_list() == ["finger.middle", "finger.tip", "palm"]
    assert grasp.attrs["units"]["contact_forces.normal"] == "N"


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_a_missing_package_is_named(package: str, motion: Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"this needs {package}, .* 'continuum-grasp\[data\]'"):
        getattr(motion, f"to_{package}")()
