"""The grasp: solved, certified and equal to what solvers say that share nothing with the package."""

from __future__ import annotations

import math
from functools import partial

import pytest
from grasp_scenes import CONFIGS, INTO_PLANE, PLANAR, make_scene
from pydantic import ValidationError

from benchmarks.grasp_oracle.check import LIMITS, residuals
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.scenes import scene_of
from benchmarks.grasp_oracle.search import Search
from continuum_grasp.base import SolverError
from continuum_grasp.grasp import GraspStatus, certify, optimize_grasp
from continuum_grasp.results import read_run
from continuum_grasp.scene import Circle, GraspScene, GraspSolver, PointMass, load
from tests import certificate_cases as cases
from tests.marks import few


@pytest.fixture(scope="module")
def mug():
    return optimize_grasp(CONFIGS / "mug.yaml")


def holds(result):
    """Whether a grasp holds by the oracle's own equations."""
    found = residuals(result.scene, result.arrays)
    return all(found[name] <= limit for name, limit in LIMITS.items())


# -- against an independent solution ---------------------------------------------------------------------------


@pytest.mark.parametrize("gravity", [PLANAR, INTO_PLANE], ids=lambda g: "into_plane" if g[2] else "planar")
@pytest.mark.parametrize(
    ("family", "base_y"), few([("arc", -0.052), ("matched_clothoid", -0.055), ("arc", -0.060), ("clothoid", -0.055)], 2)
)
def test_mugs_against_linear_programming(family, gravity, base_y):
    scene = make_scene(family, gravity, base_y, max_tension=80.0)
    best = Search(numbers(scene)).best()
    result = optimize_grasp(scene)
    assert result.tension == pytest.approx(best.value, rel=2e-3)
    assert result.fingers["finger"].lengths == pytest.approx(best.posture.lengths, abs=5e-3 * 0.18)
    assert holds(result)


def test_a_flask_against_linear_programming():
    scene = load(CONFIGS / "oval_flask.yaml", {"fidelity.elements": 2})
    best = Search(numbers(scene)).best()
    result = optimize_grasp(scene)
    assert result.tension == pytest.approx(best.value, rel=2e-3)
    assert {contact.name for contact in result.contacts} == {"finger.middle", "finger.tip", "palm.1", "palm.2"}
    assert holds(result)


def test_a_stadium_without_straight_sides_is_a_disc(mug):
    """Its two contacts with the palm are as far apart as its sides are long, which is all the difference."""
    disc = mug.scene.object
    values = {**disc.model_dump(), "shape": "stadium", "length": 1e-5, "radius": disc.radius, "angle": math.pi / 2}
    del values["diameter"]
    scene = GraspScene.model_validate({**mug.scene.model_dump(), "object": values})
    assert optimize_grasp(scene).tension == pytest.approx(mug.tension, rel=1e-3)


RANDOM = [10, 21, 23, 24, 27, 29, 30, 40, 43, 52, 58, 60]
"""Seeds of scenes of all shapes and families that have a grasp."""


@pytest.mark.deep
@pytest.mark.parametrize("seed", few(RANDOM, 3))
def test_random_scenes_against_linear_programming(seed):
    scene = scene_of("one", seed)
    best = Search(numbers(scene)).best()
    result = optimize_grasp(scene)
    assert result.tension <= best.value * 1.005
    assert holds(result)


def test_two_arcs_can_only_wrap():
    """An arc tangent to a circle that meets it again lies on it; the first arc follows from the base alone."""
    _, exact = cases.wrapped_disc(PLANAR)
    finger = optimize_grasp(make_scene("arc", PLANAR)).fingers["finger"]
    assert finger.q == pytest.approx(exact["finger.q"], abs=1e-3)
    assert finger.q[0] == pytest.approx(exact["finger.q"][0], abs=1e-4)
    assert finger.lengths == pytest.approx(exact["finger.lengths"], abs=2e-5)


def test_masses_along_the_finger_stay_where_they_are():
    masses = (PointMass(at=0.05, mass=0.01), PointMass(at=0.12, mass=0.02))
    scene = make_scene("matched_clothoid", PLANAR, -0.048, finger={"masses": masses})
    result = optimize_grasp(scene)
    assert result.tension == pytest.approx(Search(numbers(scene)).best().value, rel=5e-3)
    assert holds(result)


# -- no grasp ------------------------------------------------------------------------------------------------


def test_weak_tendon_is_named_with_the_tension_needed():
    needed = Search(numbers(make_scene("arc", INTO_PLANE))).best("tension").value
    with pytest.raises(SolverError) as caught:
        optimize_grasp(make_scene("arc", INTO_PLANE, max_tension=0.8 * needed))
    result = caught.value.result
    assert result.status is GraspStatus.INFEASIBLE
    reason = next(r for r in result.reasons if r.name == "tension")
    assert "max_tension" in reason.key
    assert reason.needed == pytest.approx(needed, rel=1e-3)
    # What is drawn is the grasp of the first repair, which touches: the palm, and the finger by half of its thickness.
    assert result.answer == "first_repair"
    assert set(result.contact_names) == {"finger.middle", "finger.tip", "palm"}
    x, y = result.fingers["finger"].backbone[-1, 1:3]
    assert math.hypot(x - 0.04, y) == pytest.approx(0.046, abs=1e-6)
    assert result.contact("palm").position == pytest.approx([0.0, 0.0], abs=1e-6)


def least_friction(found):
    return Search(found).least_friction(found)


NEEDED = [
    # Of two arcs all postures are known; of clothoids the tension that a heavy object needs.
    ("friction", "friction", partial(make_scene, "arc", PLANAR, max_tension=36.5), least_friction, 0.6, (1.01, 0.98)),
    ("friction", "friction", partial(make_scene, "arc", max_tension=60.0), least_friction, 0.6, (1.01, 0.98)),
    ("mass", "mass", partial(make_scene, "arc"), lambda found: Search(found).best("mass").value, 1.7, (0.99, 1.01)),
    ("tension", "max_tension", partial(make_scene, mass=0.7),
     lambda found: Search(found).best("tension", found.limited(tension=1e4)).value, 0.9, ()),
]  # fmt: skip


@pytest.mark.deep
@pytest.mark.parametrize(("name", "key", "scene", "oracle", "given", "around"), NEEDED)
def test_a_limit_is_named_with_what_linear_programming_needs(name, key, scene, oracle, given, around):
    """Where it is given as a part of that; a little around it there is a grasp, and none."""
    needed = oracle(numbers(scene()))
    result = optimize_grasp(scene(**{key: given * needed}), raise_on_failure=False)
    assert result.status is GraspStatus.INFEASIBLE
    assert next(r for r in result.reasons if r.name == name).needed == pytest.approx(needed, rel=5e-3)
    solved = [optimize_grasp(scene(**{key: part * needed}), raise_on_failure=False).solved for part in around]
    assert solved == [True, False][: len(around)]


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
