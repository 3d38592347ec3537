"""A scene and its image have the same grasps; from inside: searches alone, without reasons.

A scene and its image, mirrored, turned, shifted and scaled, have the same grasps; polygons whichever vertex comes
first.
"""

from __future__ import annotations

import numpy as np
import pytest
from grasp_scenes import HEXAGON

import continuum_grasp as cg
from benchmarks.grasp_images import STRONGER, drawn, mirrored, moved, rolled, scaled, scene_of
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.supports import object_poses
from continuum_grasp.grasp.values import tension_of
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene
from tests.marks import ROUNDING, few

SCENES = [("one", 5), ("one", 7), ("one", 1), ("one", 2), ("one", 6), ("one", 11)]
MORE = [
    *(("one", seed) for seed in range(50, 90)),
    *(("union", seed) for seed in (0, *range(50, 60))),
    *(("two", seed) for seed in (2, 8)),
    *(("three", seed) for seed in (0, 2, 9)),
    *(("wrap", seed) for seed in (2, 7, 9)),
]
NONE = 1e-6
"""Tension that is none, per the greatest."""


def image_of(data):
    data = rolled(data) if "vertices" in data["object"] else data
    return mirrored(moved(scaled(data)))


def least(scene):
    """The least tension that is found [N]; None where there is no grasp."""
    search = GraspSearch(scene, Budget.of(scene.solver))
    search.run()
    return None if search.best is None else tension_of(scene, search.best.arrays)


@pytest.mark.parametrize(("kind", "seed"), [*few(SCENES, 6), *few(MORE, 0)])
def test_a_scene_and_its_image_have_the_same_grasp(kind, seed):
    data = drawn(kind, seed)
    scene = scene_of(data, 8)
    own, other = least(scene), least(scene_of(image_of(data), 8))
    assert (own is None) == (other is None)
    if own is not None:
        none = NONE * sum(setup.max_tension for setup in scene.setups)
        assert other / STRONGER == pytest.approx(own, rel=1e-6, abs=none)


FOUND = [
    # Tensions of the most thorough search; exact rods need 15.54, 43.54 and 26.43 N of the others.
    pytest.param("one", 100, 4, 43.101215, marks=ROUNDING),
    ("one", 605, 8, 15.554284),
    ("one", 489, 8, 43.666507),
    ("one", 32, 8, 26.426475),
    # Nothing weighs: the solver's tolerance leaves forces more than their scale allows.
    ("one", 865, 4, 8.8851917),
]
FOUND_BY_MORE_WORK = [
    ("one", 86, 8, 26.201487),
    ("three", 8, 4, 0.0),  # straight rods that are bent between base and object press by themselves
    ("one", 354, 8, 15.147872),
    ("one", 683, 8, 17.229518),
]


@pytest.mark.parametrize(("kind", "seed", "elements", "tension"), [*FOUND, *few(FOUND_BY_MORE_WORK, 0)])
def test_the_least_tension_is_that_of_more_work(kind, seed, elements, tension):
    assert least(scene_of(drawn(kind, seed), elements)) == pytest.approx(tension, rel=1e-6, abs=1e-6)


def test_poses_that_are_tried_have_their_mirror_images():
    scene = cg.load("configs/grasp/mug.yaml").changed({"object.free": {"y": (-0.01, 0.03)}})
    image = GraspScene.model_validate(mirrored(scene.model_dump(exclude_unset=True)))
    palm = frozenset({"palm"})
    own, other = (np.array([pose[1] for pose in object_poses(one, palm)]) for one in (scene, image))
    assert len(own) == 7
    assert sorted(-own) == pytest.approx(sorted(other), abs=1e-12)
    # The first ones, too: an effort may take no more.
    assert sorted(-own[:5]) == pytest.approx(sorted(other[:5]), abs=1e-12)


FREED = [
    pytest.param(seed, where, marks=[ROUNDING] if seed == 100 else [])
    for seed in (7, 5, 100, 3, 4)
    for where in ("y", "angle", "base")
]


@pytest.mark.parametrize(("seed", "where"), few(FREED, 0))
def test_an_object_or_a_base_that_may_move_takes_no_more_than_one_that_is_fixed(seed, where):
    data = drawn("one", seed)
    fixed = least(scene_of(data, 4))
    assert fixed is not None
    span, base = 0.1 * data["finger"]["rod"]["length"], data["finger"]["base"]["angle"]
    if where == "base":
        data["finger"] |= {"base_free": {"angle": (base - 0.1, base + 0.1)}}
    else:
        at, most = (data["object"]["position"][1], span) if where == "y" else (data["object"].get("angle", 0.0), 0.1)
        data["object"] |= {"free": {where: (at - most, at + most)}}
    assert least(scene_of(data, 4)) <= (1.0 + 1e-6) * fixed + NONE * data["finger"]["tendons"]["max_tension"]


@pytest.mark.parametrize("bending_range", [6.28, *few([3.4], 0)])
def test_a_short_piece_is_found_whichever_vertex_comes_first(bending_range):
    """Also where exact rods bend by more than the finger may, whose elements bend otherwise."""
    data = HEXAGON | {"fidelity": HEXAGON["fidelity"] | {"bending_range": bending_range}}
    tensions = [least(scene_of(shown, 4)) for shown in (data, mirrored(data), rolled(data))]
    assert max(tensions) < 1.03 * min(tensions)  # without it 461 N, not 44 N, of every other one


@pytest.mark.deep
def test_a_short_piece_leads_to_the_grasp():
    """32.58 N with four elements, of many starts at random; with eight, which bend as far each, it takes less."""
    assert least(scene_of(HEXAGON, 4)) == pytest.approx(32.58, rel=1e-3)
    assert least(scene_of(HEXAGON, 8)) < 32.58


@pytest.mark.deep
@pytest.mark.parametrize(("seed", "tension"), [(2, 37.814885), (4, 4.1385696), (5, 50.963973), (9, 14.704362)])
def test_three_fingers_take_no_more_than_from_many_starts_of_few_elements(seed, tension):
    """Four elements take so much in a search with three times as many sampled starts, and exchanges of fingers."""
    assert least(scene_of(drawn("three", seed), 16)) < (1.0 + 1e-6) * tension


@pytest.mark.deep
def test_more_elements_take_up_all_that_few_lead_to():
    """Of 28 starts of four elements one led to 4.184 N, and eight once took 28 N; sixteen take 0.49 N."""
    eight, sixteen = (least(scene_of(drawn("three", 8), count)) for count in (8, 16))
    assert eight == pytest.approx(sixteen, rel=0.03)
    assert eight < 4.184


@pytest.mark.deep
def test_more_elements_stay_where_few_need_no_friction():
    """Normal forces alone balance the box; from four elements with all friction in reserve, five came to 36 %."""
    down = "disturbances.wrenches=[[-1, 0, 0], [1, 0, 0], [0, -1, 0]]"
    assert optimize_grasp(cg.load("configs/grasp/table_peg.yaml", [down])).quality.friction_margin == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        *few(
            [
                (
                    "oval_flask",
                    {"object.free": {"x": (0.024, 0.031), "y": (-0.005, 0.003), "angle": (1.3708, 1.6708)}},
                )
            ],
            0,
        ),
        *few([("table_peg", {"fidelity.family": "clothoid"}), ("egg", {"contacts.tip": "auto"})], 0),
    ],
)
def test_a_changed_example_and_its_image_have_the_same_grasp(name, changes):
    """Each of them differed: a face lifted off its support within the tolerance of its gaps; a start was left out since
    another was of its branch, which in the image had a direction of pi for -pi.
    """
    data = cg.load(f"configs/grasp/{name}.yaml").changed(changes).model_dump(exclude_unset=True)
    found = [optimize_grasp(GraspScene.model_validate(image(data))) for image in (dict, mirrored)]
    assert found[0].tension == pytest.approx(found[1].tension, rel=1e-6)
    if name == "oval_flask":
        assert found[0].arrays["object.pose"][2] == pytest.approx(0.5 * np.pi, abs=2e-6)


@pytest.mark.deep
def test_a_verdict_of_three_fingers_says_that_it_rests_on_samples():
    """Three times as many starts hold this scene with 74.5 N, the last but ten of them."""
    found = optimize_grasp(scene_of(drawn("three", 7), 4), raise_on_failure=False)
    assert found.solved or "samples were tried (solver.effort: thorough tries more)" in found.message
