"""Data that cannot be the finger's are refused; from inside: misfits on either side of each threshold are put in.

Data that cannot be those of the finger are refused, and the slip is named; thresholds; good data pass.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Poses, Reading, plausibility
from continuum_grasp.addons.identification.blocks import MeasuredBlock, PosesBlock
from continuum_grasp.addons.identification.numbers import MeasuredColumn, MeasuredSet
from continuum_grasp.addons.identification.plausibility import Misfit, _refitted, judge, misfits
from continuum_grasp.addons.identification.problem import FitProblem, Solution
from continuum_grasp.addons.identification.slips import slips_of, undone
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.base import InputError, SolverError
from tests.identification.test_identification_doubts import ONE
from tests.identification_cases import LENGTH, ROD, bare_scene, bent, elastica, loaded_scene, weighed
from tests.marks import few
from tests.rods import rod_scene

LOADS = np.array([0.0, 0.05, 0.1, 0.2])
SCENE = rod_scene(ROD, "arc", 1)


def tips() -> np.ndarray:
    """Tip x and y of the exact rod, and its bend."""
    return np.array([elastica(load) for load in LOADS])


class Missed(MeasuredBlock):
    """A set whose predictions are given, of readings of the scene."""

    def __init__(self, poses: Poses, sigma: float | None = None) -> None:
        self.data, self.scene = poses, SCENE
        rows = np.stack([np.asarray(one.values) for one in poses.measured], axis=1)
        columns = (
            MeasuredColumn(one.what, one.kind, "m", sigma, one.quantity, LENGTH if one.at is None else one.at)
            for one in poses.measured
        )
        self.measured = MeasuredSet(
            poses.name, tuple(columns), np.arange(1, len(rows) + 1), rows, np.ones(len(rows), bool)
        )

    def predict(self, values, until=np.inf):
        return np.full(self.measured.values.size, np.nan), np.ones((self.measured.values.size, 1))

    def again(self, unknowns, **other):
        raise SolverError("no search here", status="none")


def reason_of(poses: Poses, off: float, sigma: float | None = None) -> str:
    """Why readings are refused whose predictions are off by so much."""
    problem = FitProblem([Missed(poses, sigma)], [ONE])
    predictions, noise = problem.measured + off, np.full(problem.measured.size, 1e-6 if sigma is None else sigma)
    solution = Solution(np.ones(1), predictions, np.ones((noise.size, 1)), noise, 0, 0)
    return judge(problem, solution).reason


@pytest.mark.parametrize(
    ("sigma", "limit"),
    [(None, 0.05 * LENGTH), (0.004 * LENGTH, 0.02 * LENGTH), (1e-5, 0.01 * LENGTH)],
    ids=["a twentieth of the length", "five stated deviations", "a hundredth of the length"],
)
def test_misfits_are_refused_from_a_share_of_the_length_on(sigma, limit):
    poses = Poses([Reading("x", 0.5 * LENGTH * np.array([0.2, 0.6, 1.0]))])
    assert not reason_of(poses, 0.999 * limit, sigma)
    assert "is plausible" in reason_of(poses, 1.001 * limit, sigma)


@pytest.mark.parametrize("at", [None, 0.1])
@pytest.mark.parametrize("way", [(1.0, 0.0), (-0.6, 0.8)])
def test_points_beyond_the_reach_are_refused(at, way):
    reach = (LENGTH if at is None else at) + 0.05 * LENGTH
    for share, refused in ((0.999, False), (1.001, True)):
        points = np.outer([0.3, 0.2, share], way) * reach
        poses = Poses([Reading("x", points[:, 0], at), Reading("y", points[:, 1], at)])
        found = reason_of(poses, 0.0)
        assert bool(found) == refused
        assert not refused or "row 3" in found


@pytest.mark.parametrize(
    ("quantity", "values", "limit"),
    [
        ("bend", [0.2, 0.5, 1.0], 0.1),
        ("bend", [0.0, 1.0, 4.0], 0.2),
        ("frequency", [3.0, 4.0], 0.05 * np.sqrt(12.5)),
        ("torque", [3.0, 4.0], np.sqrt(12.5)),
        ("decay_rate", [3.0, 4.0], np.inf),
    ],
)
def test_other_quantities_are_refused_from_a_share_of_their_range_or_size_on(quantity, values, limit):
    block = Missed(Poses([Reading("x", values)]))
    columns = tuple(one._replace(quantity=quantity) for one in block.measured.columns)
    block.measured = replace(block.measured, columns=columns)
    (found,) = misfits(FitProblem([block], [ONE]), np.zeros(len(values)))
    assert found.limit == pytest.approx(limit)


class Fixed(Missed):
    """A set that is missed by a millimeter to either side of a level."""

    def predict(self, values, until=np.inf):
        known = self.measured.values.ravel()
        return known + 1e-3 * (-1.0) ** np.arange(known.size) + values[0], np.ones((known.size, 1))

    def again(self, unknowns, *, data=None, scene=None):
        return Fixed(data or self.data)


@pytest.mark.parametrize(("share", "named"), [(0.999, False), (1.001, True)])
def test_a_slip_explains_what_it_leaves_a_third_of(share, named):
    problem = FitProblem([Fixed(Poses([Reading("x", 0.1 * np.arange(4))]))], [ONE])
    before = 3.0 * 1e-3 / (0.05 * LENGTH)  # per what is plausible
    assert bool(_refitted("a slip", problem, share * before)) == named


@pytest.mark.parametrize(
    ("limit", "scatter"), [(1.0, 2e-3), (1e-3, 1.0)], ids=["half of the scatter", "what is refused"]
)
@pytest.mark.parametrize(("share", "named"), [(0.999, True), (1.001, False)])
def test_a_slip_that_leaves_too_much_explains_nothing(limit, scatter, share, named, monkeypatch):
    problem = FitProblem([Fixed(Poses([Reading("x", 0.1 * np.arange(4))]))], [ONE])
    left = Misfit("set", "positions", "m", share * 1e-3, limit, scatter)
    monkeypatch.setattr(plausibility, "misfits", lambda *_: [left])
    assert bool(_refitted("a slip", problem, np.inf)) == named


@pytest.mark.parametrize(("share", "warned"), [(0.999, False), (1.001, True)])
@pytest.mark.parametrize("times", [10.0, 0.1])
def test_stiffnesses_ten_times_the_scene_s_are_doubted(share, warned, times):
    poses = Poses([Reading("x", 0.1 * np.arange(4))])
    problem = FitProblem([Missed(poses)], [ONE._replace(target="bending_stiffness")])
    value = times ** (1.0 + np.log10(share))
    solution = Solution(np.array([value]), problem.measured, np.ones((4, 1)), np.ones(4), 0, 0)
    found = judge(problem, solution).warnings
    assert bool(found) == warned


def test_few_slips_are_fitted_anew(monkeypatch):
    """Those that are least off at the start: of readings of zero all are off alike."""
    tried = []
    monkeypatch.setattr(plausibility, "_refitted", lambda words, *_: tried.append(words) or [])
    poses = Poses([Reading("x", [0.0, 1e-9]), Reading("y", [1e-9, 0.0])])
    problem = FitProblem([Fixed(poses)], [ONE])
    assert plausibility.explain(problem) == ()
    assert len(tried) == 5
    assert tried[-1] == "the base is elsewhere"


def test_slips_are_tried_from_half_the_scatter_on():
    small = Misfit("set", "positions", "m", 0.999e-3, 4e-3, 2e-3)
    assert not small.is_unexplained
    assert small._replace(rms=1.001e-3).is_unexplained
    # and from a fifth of what is refused on, where the measurements hardly differ
    repeats = small._replace(limit=5e-3, scatter=0.0)
    assert not repeats.is_unexplained
    assert repeats._replace(rms=1.001e-3).is_unexplained


@pytest.mark.parametrize(
    ("change", "words"),
    few(
        [
            (lambda x, y, load: (x, -y, load), "y points down"),
            (lambda x, y, load: (1e3 * x, 1e3 * y, load), "positions are in mm, read as m"),
            (lambda x, y, load: (y, x, load), "columns of x and y are swapped"),
            (lambda x, y, load: (x + 0.1, y - 0.15, load), "the base is elsewhere"),
            (lambda x, y, load: (x, y, -load), "load_y has the other sign"),
        ],
        0,
    ),
)
def test_slips_are_named(change, words):
    x, y, load = change(*tips()[:, :2].T, -LOADS)
    scene = loaded_scene(2, finger={"base": {"angle": -np.pi / 2}})
    fit = cg.identify(
        scene, Poses([Reading("x", x), Reading("y", y)], {"load_1_y": load}), parameters=["bending_stiffness"]
    )
    assert fit.status == "implausible"
    assert any(cause.startswith(words) for cause in fit.causes)
    with pytest.raises(InputError, match="implausible"):
        fit.apply()


@pytest.mark.parametrize(
    ("quantity", "offset", "words"), [("angle", 0.0, "angle counts from the base"), ("bend", -np.pi / 2, "bend counts")]
)
def test_angles_that_count_from_elsewhere_are_named(quantity, offset, words):
    """Of a rod that is clamped at an angle of its own, bends as angles and the other way round."""
    scene = loaded_scene(2, finger={"base": {"angle": -np.pi / 2}})
    rows = Poses([Reading(quantity, tips()[:, 2] + offset)], {"load_1_y": -LOADS})
    fit = cg.identify(scene, rows, parameters=["bending_stiffness"])
    assert fit.status == "implausible"
    assert any(cause.startswith(words) for cause in fit.causes)


def test_slips_are_named_where_the_search_ended_at_a_rigid_finger():
    """From there no shape is followed back to the start values, which other slips are tried at."""
    loads = np.array([0.0, 0.1, 0.2, 0.4, 0.6])
    x, y, _ = np.transpose([elastica(load, 0.022) for load in loads])
    scene = loaded_scene(1, finger={"base": {"angle": -np.pi / 2}})
    fit = cg.identify(scene, weighed(np.stack([x, -y], axis=1), loads), parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] > 1e3
    assert fit.status == "implausible"
    assert any(cause.startswith("y points down") for cause in fit.causes)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_bends_of_the_other_sign_are_named_and_written_only_when_asked_for(side, tmp_path):
    """Bends M L / EI of a rod under moments at its tip, and of its mirror image."""
    moments = side * np.array([0.01, 0.02, 0.03])
    scene = bare_scene(1, "arc")
    data = bent(moments, -moments * LENGTH / ROD["bending_stiffness"])
    fit = cg.identify(scene, data, parameters=["bending_stiffness"], accept_implausible=True)
    assert fit.status == "implausible"
    expected = {"bend has the other sign in the data", "tip_moment has the other sign in the data"}
    assert {cause.split(":")[0] for cause in fit.causes} == expected
    for accepted in (True, False):  # what the first run wrote does not stay
        replace(fit, accepted=accepted).save(tmp_path)
        assert (tmp_path / "identified_finger.yaml").exists() == accepted


@pytest.mark.parametrize("seeds", few([3, 300], 1))
def test_good_data_are_not_refused(seeds):
    """Noise of a hundredth of the length, far more than a camera has."""
    clean, scene = tips()[:, :2], rod_scene(ROD, "clothoid", 1, loads=loaded_scene(1).loads)
    unknowns = read_unknowns(scene, ["bending_stiffness"])
    # The model is built once; predictions do not depend on what was measured.
    model = PosesBlock(scene, Poses([Reading("x", LOADS), Reading("y", LOADS)], {"load_1_y": -LOADS}), unknowns)
    for seed in range(seeds):
        noisy = clean + 0.01 * LENGTH * np.random.default_rng(seed).standard_normal(clean.shape)
        data = weighed(noisy, LOADS)
        block = copy(model)
        block.data, block.again = data, Missed(data).again
        block.measured = replace(model.measured, values=noisy)
        problem = FitProblem([block], unknowns)
        assert not judge(problem, problem.solve(lambda share: None)).reason


@pytest.mark.parametrize(
    ("angle", "moment", "words"),
    [(1.0, 1.0, None), (180.0 / np.pi, 1.0, "bend is in deg, read as rad"), (1.0, 1e3, "tip_moment is in")],
)
def test_slips_of_scale_leave_no_misfit_and_are_named_by_the_scene_s_stiffness(angle, moment, words):
    """Bends M L / EI, in other units than stated."""
    moments = np.array([0.01, 0.02, 0.03])
    scene = bare_scene(1, "arc")
    bends = angle * moments * LENGTH / ROD["bending_stiffness"]
    fit = cg.identify(scene, bent(moment * moments, bends), parameters=["bending_stiffness"])
    found = [one for one in fit.warnings if "times the scene's" in one]
    assert fit.status == "converged"
    assert bool(found) == (words is not None)
    assert all(words in one for one in found)


def test_an_undone_slip_done_twice_is_the_data():
    """Signs, swaps and turns by 180 degrees are their own inverses."""
    poses = Poses([Reading("x", [0.1, 0.2]), Reading("y", [0.3, -0.1])], {"load_1_y": [1.0, 2.0]})
    scene = loaded_scene(1)
    for slip in slips_of([(poses, scene)]):
        if any(word in slip.words for word in ("other sign", "swapped", "180", "points")):
            twice = undone(slip, *undone(slip, poses, scene))
            assert [list(one.values) for one in twice[0].measured] == [list(one.values) for one in poses.measured]
            assert list(twice[0].conditions["load_1_y"]) == [1.0, 2.0]
