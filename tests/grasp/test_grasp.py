"""The grasp: solved, certified, and equal to grasps of sixteen elements and of linear programs, which share nothing
with the search.
"""

from __future__ import annotations

import math
from functools import partial

import pytest
from grasp_scenes import CONFIGS, INTO_PLANE, PLANAR, make_scene
from pydantic import ValidationError

from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.scenes import scene_of
from benchmarks.grasp_oracle.search import Search
from continuum_grasp.base import SolverError
from continuum_grasp.grasp import GraspStatus, certify, optimize_grasp
from continuum_grasp.results import read_run
from continuum_grasp.scene import Circle, GraspScene, GraspSolver, PointMass, load
from tests.marks import few


@pytest.fixture(scope="module")
def mug():
    return optimize_grasp(CONFIGS / "mug.yaml")


# -- against an independent solution ---------------------------------------------------------------------------


@pytest.mark.parametrize("gravity", [PLANAR, INTO_PLANE], ids=lambda g: "into_plane" if g[2] else "planar")
@pytest.mark.parametrize("base_y", few([-0.052, -0.055, -0.060], 2))
def test_mugs_against_linear_programming(gravity, base_y):
    """Linear programs at all postures of a finger of two elements, which takes some percent less or more."""
    best = Search(numbers(make_scene("matched_clothoid", gravity, base_y, max_tension=80.0))).best()
    result = optimize_grasp(make_scene("matched_clothoid", gravity, base_y, max_tension=80.0))
    assert result.tension == pytest.approx(best.value, rel=0.1)
    assert result.certificate.passed


def test_a_flask_against_linear_programming():
    scene = load(CONFIGS / "oval_flask.yaml", {"fidelity.elements": 2})
    best = Search(numbers(scene)).best()
    result = optimize_grasp(scene)
    assert result.tension == pytest.approx(best.value, rel=0.1)
    assert {contact.name for contact in result.contacts} == {"finger.middle", "finger.tip", "palm.1", "palm.2"}
    assert result.certificate.passed


def test_a_stadium_without_straight_sides_is_a_disc(mug):
    """Its two contacts with the palm are as far apart as its sides are long, which is all the difference."""
    disc = mug.scene.object
    values = {**disc.model_dump(), "shape": "stadium", "length": 1e-5, "radius": disc.radius, "angle": math.pi / 2}
    del values["diameter"]
    scene = GraspScene.model_validate({**mug.scene.model_dump(), "object": values})
    assert optimize_grasp(scene).tension == pytest.approx(mug.tension, rel=1e-3)


BY_SIXTEEN_ELEMENTS = [
    (23, 23.983), (27, 53.926), (29, 106.559), (30, 40.544), (40, 7.517), (43, 31.647), (52, 14.314), (58, 27.092),
    (60, 13.643),
]  # fmt: skip
"""Random scenes and tensions [N] of a search with sixteen clothoids per finger (version 0.9, which is not here)."""


@pytest.mark.parametrize(("seed", "tension"), few(BY_SIXTEEN_ELEMENTS, 3))
def test_random_scenes_take_the_tension_of_sixteen_elements(seed, tension):
    result = optimize_grasp(scene_of("one", seed))
    assert result.tension == pytest.approx(tension, rel=1.5e-3)
    assert result.certificate.passed


@pytest.mark.deep
@pytest.mark.parametrize("seed", few([10, 21, 24], 1))
def test_random_scenes_that_sixteen_elements_do_not_hold_are_not_held(seed):
    result = optimize_grasp(scene_of("one", seed), raise_on_failure=False)
    assert not result.solved
    assert result.reasons


def test_masses_along_the_finger_stay_where_they_are():
    masses = (PointMass(at=0.05, mass=0.01), PointMass(at=0.12, mass=0.02))
    scene = make_scene("matched_clothoid", PLANAR, -0.048, finger={"masses": masses})
    result = optimize_grasp(scene)
    assert result.tension == pytest.approx(Search(numbers(scene)).best().value, rel=0.1)
    assert result.certificate.passed


# -- no grasp ------------------------------------------------------------------------------------------------


def test_a_weak_tendon_is_named_with_the_tension_needed():
    """The tension with which the scene is held where the limit is wide."""
    needed = optimize_grasp(make_scene("arc", INTO_PLANE, max_tension=80.0)).fingers["finger"].tensions.max()
    with pytest.raises(SolverError) as caught:
        optimize_grasp(make_scene("arc", INTO_PLANE, max_tension=0.8 * needed))
    result = caught.value.result
    reason = next(r for r in result.reasons if r.name == "tension")
    assert "max_tension" in reason.key
    assert reason.needed == pytest.approx(needed, rel=0.02)
    # What is drawn is the grasp of the first repair, which touches: the palm, and the finger by half of its thickness.
    assert result.answer == "first_repair"
    assert {"finger.middle", "palm"} <= set(result.contact_names)


NEEDED = [("friction", "friction", partial(make_scene, "arc", PLANAR, max_tension=36.5), 0.3, -1.0),
          ("mass", "mass", partial(make_scene, "arc"), 3.0, 1.0),
          ("tension", "max_tension", partial(make_scene, mass=0.7), 30.0, -1.0)]  # fmt: skip


@pytest.mark.deep
@pytest.mark.parametrize(("name", "key", "scene", "given", "way"), NEEDED)
def test_a_limit_is_named_with_what_is_needed(name, key, scene, given, way):
    """There is a grasp just beyond it, and none 3 % before."""
    result = optimize_grasp(scene(**{key: given}), raise_on_failure=False)
    assert not result.solved
    needed = next(r for r in result.reasons if r.name == name).needed
    solved = [
        optimize_grasp(scene(**{key: part * needed}), raise_on_failure=False).solved
        for part in (1.0 - 0.003 * way, 1.0 + 0.03 * way)
    ]
    assert solved == [True, False]


def test_out_of_reach_is_exact_and_needs_no_solver():
    far = Circle(shape="circle", diameter=0.08, mass=0.3, position=(0.5, 0.0))
    result = optimize_grasp(make_scene(object=far, supports={}), raise_on_failure=False)
    assert result.status is GraspStatus.INFEASIBLE
    assert [r.name for r in result.reasons] == ["reach"]
    assert result.statistics["solver_seconds"] == 0


@pytest.mark.parametrize("solver", few([GraspSolver(max_total_iterations=1), GraspSolver(max_iterations=1)], 1))
def test_an_interrupted_search_is_not_called_infeasible(solver):
    result = optimize_grasp(make_scene("matched_clothoid", INTO_PLANE, solver=solver), raise_on_failure=False)
    # The start may be so good that it holds as it is.
    assert result.status in (GraspStatus.NOT_SOLVED, GraspStatus.FEASIBLE)
    if not result.solved:
        assert result.advice
        with pytest.raises(SolverError, match="not_solved"):
            optimize_grasp(make_scene("matched_clothoid", INTO_PLANE, solver=solver))


# -- use -----------------------------------------------------------------------------------------------------


def test_saved_result_can_be_verified_again(mug, tmp_path):
    run = read_run(mug.save(tmp_path / "run"))
    assert run.meta["status"] == "optimal"
    assert certify(GraspScene.model_validate(run.meta["config"]), run.arrays).passed


@pytest.mark.parametrize(
    "change",
    [
        {"contacts": {"friction": 0.5, "normal_force_max": 10.0, "middle": "off", "tip": "off"}},
        {"object": {"shape": "circle", "diameter": 0.08, "mass": 0.3, "position": (0.02, 0.0)}},
        {"object": {"shape": "circle", "diameter": 0.08, "mass": 0.3, "position": (0.04, -0.05)}},
        {"fidelity": {"elements": 1}},
        {"fidelity": {"frequencies": 2}},
        {"fidelity": {"elements": (0.09, 0.09)}},
        {"solver": {"penetration_tolerance": 0.0}},
        {"supports": {"finger": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.0}}},
        {"fingers": {}},
    ],
)
def test_senseless_scenes_are_refused(change):
    with pytest.raises(ValidationError):
        GraspScene.model_validate(make_scene().model_dump() | change)
