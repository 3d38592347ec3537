"""The share of plants that a grasp would hold: against plants solved in full, linear programming, and its own image."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog

from benchmarks.grasp_images import drawn, mirrored, scene_of
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.grasp.quality.conic import FAR
from continuum_grasp.grasp.robust.response import HOLDS, Responder
from continuum_grasp.grasp.robust.share import USUAL, _Plants, drawn_evenly, greatest_last, plant_share
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.load import load
from tests.grasp_scenes import CONFIGS
from tests.made_up_grasps import held
from tests.marks import few


@pytest.mark.parametrize("size", [1, 2, 4])
def test_greatest_unknowns_are_those_of_linear_programming(size):
    random = np.random.default_rng(size)
    rows = np.concatenate([random.normal(size=(20, 12, size - 1)), np.ones((20, 12, 1))], axis=2)
    limits = random.uniform(-1.0, 1.0, (20, 12))
    found = greatest_last(rows, limits)
    for each, most, value in zip(rows, limits, found, strict=True):
        exact = linprog(np.append(np.zeros(size - 1), -1.0), each, most, bounds=[(-FAR, FAR)] * size)
        assert value == pytest.approx(-exact.fun, abs=1e-4)


def test_plants_are_drawn_evenly_and_alike_for_mirrored_errors():
    points = drawn_evenly(8)
    assert np.abs(points).max() <= 1.0
    assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    assert_allclose(points.T @ points / len(points), np.eye(8) / 3.0, atol=0.04)
    image = points * [1, -1, -1, 1, 1, 1, 1, 1]
    assert_allclose(image[np.lexsort(image.T)], points[np.lexsort(points.T)])


def test_a_mirrored_scene_has_the_same_share():
    shares = [optimize_grasp(scene_of(s, 2)).plants.share for s in (drawn("one", 5), mirrored(drawn("one", 5)))]
    assert 0.0 < shares[0] < 1.0
    assert shares[1] == pytest.approx(shares[0], abs=1e-3)


def test_what_cannot_be_computed_is_said():
    share = held("box_edge").plants
    assert np.isnan(share.share)
    assert "was not computed: the fingers have other elements" in str(share)
    assert share.data()["share"] is None


@pytest.mark.deep
def test_two_tips_are_a_hinge_about_which_what_lies_beside_it_tilts():
    """Solved in full, no plant holds whose tin lies off the line between the tips; others may."""
    grasp = optimize_grasp(load(CONFIGS / "pinch_above.yaml"))
    sides = usual_sides(grasp.scene)
    points = np.concatenate([0.5 * np.eye(len(sides)), -0.5 * np.eye(len(sides))])
    points = points[np.abs(points @ sides).any(axis=1)]
    near = _Plants(grasp.scene, grasp.arrays, sides).reserves(points) >= HOLDS
    assert near.tolist() == held_in_full(grasp, points @ sides).tolist()
    assert near[points[:, 0] != 0.0].tolist() == [False, False]
    assert near[points[:, 1] != 0.0].all()
    assert grasp.plants.share == 0.0
    assert "with an error of place its contacts cannot all stay" in str(grasp.plants)


@pytest.mark.deep
def test_errors_of_a_scene_take_the_place_of_usual_ones():
    scene = load(CONFIGS / "mug_arcs.yaml")
    arrays = optimize_grasp(scene).arrays
    own = plant_share(scene.changed({"robust": {"friction": 0.1, "radius": 0.01}}), arrays)
    assert own.errors == {"friction": 0.1, "size": 0.01, "stiffness": 0.1, "tension": 0.05}
    assert "size \N{PLUS-MINUS SIGN}1 %" in str(own)


def usual_sides(scene):
    """Usual errors of a scene: one per row, to one side."""
    place = USUAL["place"] * max(setup.finger.rod.length for setup in scene.setups)
    sides = [place, place, 0.0, 0.0, *(USUAL[key] for key in ("friction", "mass", "stiffness"))]
    return np.diag(sides + [USUAL["tension"]] * len(scene.setups))


def held_in_full(grasp, errors):
    """Whether plants with errors hold by all equations and limits of a grasp, with the tensions as they are."""
    auto = {f"contacts.{key}": "auto" for key in ("middle", "tip") if getattr(grasp.scene.contacts, key) == "on"}
    whole, found = grasp.scene.changed({"contacts.reserve": 0.0} | auto), []  # contacts part where the others hold
    fingers = {n: f.with_tendons(max_tension=2.0 * f.tendons.max_tension) for n, f in whole.named_fingers.items()}
    for error in errors:
        # A stiffer finger bends as one on which all other forces are less.
        softer, arrays, gravity = 1.0 / (1.0 + error[6]), dict(grasp.arrays), whole.gravity
        if gravity.mode == "planar":
            lighter = gravity.replaced(vector=tuple(softer * g for g in gravity.vector))
        else:
            lighter = gravity.replaced(magnitude=softer * gravity.magnitude)
        for setup, off in zip(whole.setups, error[7:], strict=True):
            arrays[f"{setup.name}.tensions"] = softer * (1.0 + off) * arrays[f"{setup.name}.tensions"]
        plant = whole.replaced(gravity=lighter).with_fingers(fingers)
        found.append(Responder(plant, arrays, Budget()).to(error[:6]).reserve >= HOLDS)
    return np.array(found)


def test_an_error_of_friction_is_that_of_a_scene_with_this_friction():
    grasp = optimize_grasp(CONFIGS / "mug_arcs.yaml")
    scene, sides = grasp.scene, usual_sides(grasp.scene)
    error = np.zeros((1, len(sides)))
    for share in (-1.0, 0.5):
        error[0, 4] = share
        other = scene.changed({"contacts.friction": (1.0 + 0.2 * share) * scene.contacts.friction})
        slippery = _Plants(other, grasp.arrays, sides).reserves(0.0 * error)
        assert_allclose(_Plants(scene, grasp.arrays, sides).reserves(error), slippery, rtol=1e-9)


def test_a_plant_with_one_error_holds_as_one_solved_in_full():
    grasp = optimize_grasp(CONFIGS / "mug_arcs.yaml")
    sides = usual_sides(grasp.scene)
    points = np.concatenate([np.diag(0.9 * sign * (np.diag(sides) > 0.0)) for sign in (1.0, -1.0)])
    points = points[np.abs(points[:, 1:]).any(axis=1)]  # the palm keeps the mug where it is along x
    near = _Plants(grasp.scene, grasp.arrays, sides).reserves(points) >= HOLDS
    assert near.tolist() == held_in_full(grasp, points @ sides).tolist()
    assert 3 <= near.sum() <= 7  # of ten: the grasp is at the edge of a cone


def test_a_plant_in_which_a_tip_that_bears_little_parts_holds_where_the_others_hold():
    """Gravity presses the mug into the palm, and the middle of the finger holds it there."""
    downhill = {"contacts.friction": 1.1, "gravity.vector": [-9.81, 0.0]}
    grasp = optimize_grasp(load(CONFIGS / "mug_lying.yaml").changed(downhill))
    assert grasp.contact("finger.tip").normal_force < 0.01 * grasp.scene.weight
    sides = usual_sides(grasp.scene)
    points = drawn_evenly(len(sides))[::211]
    plants = _Plants(grasp.scene, grasp.arrays, sides)
    solved = held_in_full(grasp, points @ sides)
    assert (plants.reserves(points) >= HOLDS).tolist() == solved.tolist() == [True] * len(points)
    touching = plants._with_open((), *plants._point(np.zeros(len(sides))))
    with_one = np.column_stack([points, np.ones(len(points))])
    assert 0.2 < np.mean(plants._reserves(touching, with_one) >= HOLDS) < 0.8
    assert grasp.plants.share == 1.0


SCENES = [("mug", 0.2), ("mug", 0.0), ("oval_flask", 0.0), ("box_edge", 0.0), ("pinch", 0.0), ("egg", 0.0)]


@pytest.mark.deep
@pytest.mark.parametrize(("name", "reserve"), few(SCENES, 2))
def test_plants_hold_as_those_that_are_solved_in_full(name, reserve):
    grasp = optimize_grasp(load(CONFIGS / f"{name}.yaml").changed({"contacts.reserve": reserve}))
    sides = usual_sides(grasp.scene)
    points = drawn_evenly(len(sides))[::31]
    near = _Plants(grasp.scene, grasp.arrays, sides).reserves(points) >= HOLDS
    solved = held_in_full(grasp, points @ sides)
    assert np.mean(near == solved) >= 0.9
    assert abs(near.mean() - solved.mean()) <= 0.1
