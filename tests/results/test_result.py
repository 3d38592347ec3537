"""What results declare: everything that is drawn or written of them exists, and files hold what was declared."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from continuum_grasp.accuracy.report import AccuracyReport
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.errors import InputError
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.identification.fit import Fit
from continuum_grasp.mission.result import MissionRun
from continuum_grasp.planning import Plan
from continuum_grasp.results import File, Result, Stored, read_run
from continuum_grasp.results.result import maker_of
from continuum_grasp.simulation import Modes, Trajectory

RESULTS = (AccuracyReport, ControlRun, Fit, GraspResult, MissionRun, Modes, Plan, Trajectory)
FILES = [(result, file) for result in RESULTS for file in (*result.texts, *result.pictures)]


def a_text(result: Result) -> str:
    return f"{result.status} of 5 \N{GREEK SMALL LETTER MU}s"


@dataclass(frozen=True)
class Case(Result):
    """One array that is there, one that is not, one that lies deeper, and words."""

    kind: ClassVar[str] = "case"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("force", "(T,)", "N", "pull"),
        Stored("absent", "(T,)", "N", "nothing"),
        Stored("first", "(2,)", "N", "of another result", "inner.force"),
        Stored("words", "(K,)", "text", "words"),
    )
    force: np.ndarray
    inner: Case | None = None
    absent: None = None
    words: tuple[str, ...] = ()
    scene: None = None
    status: str = "finished"
    warnings: tuple[str, ...] = ("a warning",)
    statistics: dict[str, Any] = field(default_factory=dict)

    def parts(self) -> dict[str, Result]:
        return {} if self.inner is None else {"inner": self.inner}


def test_a_folder_holds_what_is_declared(tmp_path: Path) -> None:
    inner = Case(np.array([1.0, 2.0]), words=("a", "bc"))
    run = Case.read(Case(np.array([3.0]), inner).save(tmp_path / "run"))
    assert {name: value.tolist() for name, value in run.arrays.items()} == {
        "force": [3.0],
        "first": [1.0, 2.0],
        "words": [],
    }
    assert run.arrays["words"].dtype.kind == "U"  # also where there are none
    assert (run.meta["kind"], run.meta["status"], run.meta["warnings"]) == ("case", "finished", ["a warning"])
    assert read_run(tmp_path / "run" / "inner").arrays["words"].tolist() == ["a", "bc"]


def test_a_run_of_another_kind_is_refused(tmp_path: Path) -> None:
    Case(np.zeros(1)).save(tmp_path)
    with pytest.raises(InputError, match="expected the folder of a run of plan, got that of case"):
        Plan.load(tmp_path)


def test_texts_are_written_and_what_is_not_there_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("continuum_grasp.results.result.a_text", a_text, raising=False)
    here = "results.result:a_text"
    monkeypatch.setattr(
        Case, "pictures", (File("a.txt", here), File("b.txt", here, "absent"), File("c.txt", here, "words"))
    )
    assert [path.name for path in Case(np.zeros(1)).plot(tmp_path / "new")] == ["a.txt"]
    assert (tmp_path / "new" / "a.txt").read_text(encoding="utf-8") == "finished of 5 \N{GREEK SMALL LETTER MU}s"


@pytest.mark.parametrize(("result", "file"), FILES, ids=[f"{r.__name__}-{f.name}" for r, f in FILES])
def test_what_makes_a_file_takes_the_result_alone(result: type[Result], file: File) -> None:
    signature = inspect.signature(maker_of(file.maker))
    signature.bind(object())
    assert hasattr(result, file.needs) or not file.needs


@pytest.mark.parametrize("result", [ControlRun, MissionRun, Plan, Trajectory])
def test_what_draws_frames_takes_result_indices_and_width(result: type) -> None:
    inspect.signature(maker_of(result.frames)).bind(object(), [0], 640)


@pytest.mark.parametrize("result", RESULTS)
def test_declared_arrays_have_a_name_a_shape_and_a_meaning(result: type[Result]) -> None:
    names = [one.name for one in result.stored]
    assert len(set(names)) == len(names)
    for one in result.stored:
        assert re.fullmatch(r"\((\w+,|\w+(, \w+)+)\)", one.shape), one
        assert one.meaning


def shapes_fit(result: type[Result], arrays: dict[str, np.ndarray]) -> None:
    """Assert that arrays have their declared shapes, where one letter is one number."""
    sizes: dict[str, int] = {}
    for one in result.stored:
        if one.name in arrays:
            letters = re.findall(r"\w+", one.shape)
            assert len(letters) == arrays[one.name].ndim, one
            for letter, size in zip(letters, arrays[one.name].shape, strict=True):
                assert sizes.setdefault(letter, int(letter) if letter.isdigit() else size) == size, (one, letter)


def test_saved_motions_have_the_declared_shapes(tmp_path: Path) -> None:
    import continuum_grasp as cg

    root = Path(__file__).parents[2] / "configs" / "simulate"
    scene = cg.load(root / "swing_against_disc.yaml", ["time.duration=0.02"])
    arrays = Trajectory.read(cg.simulate(scene).save(tmp_path / "motion")).arrays
    assert set(arrays) == {one.name for one in Trajectory.stored}
    shapes_fit(Trajectory, arrays)
    arrays = Modes.read(cg.modes(root / "standing.yaml").save(tmp_path / "modes")).arrays
    assert set(arrays) == {one.name for one in Modes.stored}
    shapes_fit(Modes, arrays)
