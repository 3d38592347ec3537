"""A stored result that was weakened fails its certificate: what its scene asks for cannot be taken out of it."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.grasp import certify
from tests import certificate_cases as cases
from tests.grasp.test_grasp_limits import MOTOR, ONE, SERVO, WINCH, held

MISSING = "missing or misshapen arrays"
STATES = "missing or misshapen arrays of friction states"
WAYS = "pulled and released fingers missing from the friction states"
BESIDE = "untested neighbors of the worst friction state"


def failed(scene, arrays):
    return {check.name for check in certify(scene, arrays).failed}


def two_frictional():
    """Two fingers with friction, pulled and released together and apart."""
    scene, arrays = held(case=cases.pinched_box)()
    both = {key: value for key, value in arrays.items() if key.startswith("held.")}
    apart = {key: -value if key == "held.b.friction_states" else value for key, value in both.items()}
    return scene, arrays | {key: np.concatenate([value[:2], apart[key][:2], value[2:]]) for key, value in both.items()}


ROWS = len(two_frictional()[1]["held.object.pose"])


def without(*keys):
    return lambda arrays: {key: value for key, value in arrays.items() if not key.startswith(keys)}


def with_rows(rows, *keys):
    return lambda arrays: {key: value[rows] if key.startswith(keys) else value for key, value in arrays.items()}


def changed(**more):
    return lambda arrays: arrays | {key.replace("__", "."): value for key, value in more.items()}


def shaped_alike(arrays):
    """A posture with two coordinates that are one."""
    shapes = arrays["held.a.curvature_shapes"].copy()
    shapes[0, ..., 1] = shapes[0, ..., 0]
    return arrays | {"held.a.curvature_shapes": shapes}


@pytest.mark.parametrize(
    "case",
    [
        held(),
        held(MOTOR),
        held(MOTOR.replaced(**ONE)),
        two_frictional,
        # A winch lets a slack tendon out, however the finger bends.
        held(WINCH, tensions=(0.0, 0.0)),
        held(SERVO, tensions=(0.0, 0.0)),
    ],
)
def test_what_is_whole_passes(case):
    scene, arrays = case()
    assert not failed(scene, arrays)
    assert certify(scene, arrays).states == len(arrays["held.object.pose"])


@pytest.mark.parametrize(
    ("weaken", "check"),
    [
        (without("held."), STATES),
        (without("held.object.pose"), STATES),
        (without("held.contact_names"), STATES),
        (without("held.a.friction_states"), STATES),
        (without("held.b.tensions"), STATES),
        (with_rows(slice(0, 0), "held."), STATES),
        # Less postures than friction states, or the other way round.
        (with_rows(slice(0, 1), "held.object.pose"), STATES),
        (with_rows(slice(0, 1), "held.contact_forces"), STATES),
        (with_rows(slice(0, 1), "held.a.friction_states"), STATES),
        (with_rows((slice(None), slice(0, 1)), "held.contact_names"), STATES),
        (with_rows((slice(None), slice(0, 3)), "held.a.friction_states"), STATES),
        (changed(held__a__other=np.zeros(4)), STATES),
        (changed(held__object__pose=np.full(ROWS, "a")), STATES),
        (with_rows((slice(None), 0), "held.contact_names"), STATES),
        (changed(held__a__q=np.full((ROWS, 3), np.nan)), "held with friction states, 1"),
        (shaped_alike, "held with friction states, 1"),
        # A finger that bends to and fro was pulled otherwise along its parts.
        (changed(a__q=np.array([9.0, 9.0, -4.0, -4.0])), WAYS),
        # One way in which two fingers were pulled and released.
        *((with_rows([k for k in range(ROWS) if k != gone], "held."), WAYS) for gone in range(4)),
        *((with_rows([k for k in range(ROWS) if k != gone], "held."), BESIDE) for gone in range(4, 16)),
        # Friction states of fingers that were pulled follow from their shape.
        (changed(a__friction_states=np.zeros(6)), MISSING),
        (without("b.lengths"), MISSING),
        (without("contact_stations"), MISSING),
        (with_rows(slice(0, 1), "contact_"), MISSING + "|object force balance"),
    ],
)
def test_what_friction_states_need_is_there(weaken, check):
    scene, arrays = two_frictional()
    assert set(check.split("|")) & failed(scene, weaken(arrays))


REACHED = [key for key in cases.squeezed_disc()[1] if key != "finger.family"]


@pytest.mark.parametrize("key", REACHED)
def test_every_stored_array_is_needed_as_it_is(key):
    scene, arrays = cases.squeezed_disc(family="clothoid")
    value = np.asarray(arrays[key])
    shorter = value[..., :-1] if value.ndim else np.zeros(1)
    flat = value[:1] if key == "finger.backbone" else np.ravel(value)[None]
    fewer = flat if key == "finger.backbone" or not value.ndim else value[:-1]
    for other in ("words", shorter, flat, fewer):
        assert MISSING in failed(scene, arrays | {key: other})
    assert MISSING in failed(scene, {one: value for one, value in arrays.items() if one != key})
    if value.dtype.kind == "f" and key != "contact_stations":
        value = value.copy()
        value[(0,) * value.ndim] = np.nan
        assert "non-finite numbers" in failed(scene, arrays | {key: value})


@pytest.mark.parametrize(("part", "missing"), [(0.999, 0.0), (1.001, 12.0)])
def test_only_states_beside_the_worst_are_needed(part, missing):
    """Those beside pulled fingers are there; released ones, beside which none are, have less reserve by a tolerance."""
    scene, arrays = held(case=cases.pinched_box)()
    forces = arrays["held.contact_forces"].copy()
    forces[1, :, 0] -= part * 1e-4 * np.abs(arrays["contact_forces"]).max() / scene.contacts.friction
    assert certify(scene, arrays | {"held.contact_forces": forces})[BESIDE].value == missing


def test_a_straight_part_counts_as_pulled():
    scene, arrays = two_frictional()
    assert WAYS not in failed(scene, arrays | {"a.q": np.array([9.0, 9.0, 0.0, 0.0])})


@pytest.mark.parametrize("order", [[1, 0, *range(2, ROWS)], slice(None, None, -1)])
def test_the_order_of_friction_states_does_not_matter(order):
    scene, arrays = two_frictional()
    assert not failed(scene, with_rows(order, "held.")(arrays))


def test_postures_of_friction_states_where_there_is_no_friction_are_refused():
    scene, arrays = cases.squeezed_disc()
    assert failed(scene, arrays | {"held.object.pose": np.zeros((2, 3))}) == {STATES}


def test_a_grasp_that_need_only_hold_as_it_is_reached_has_no_other_postures():
    scene, arrays = held()()
    reached = without("held.")(arrays)
    assert certify(scene.replaced(friction_states="pulled"), reached).passed


@pytest.mark.parametrize("name", ["held", "contact_a"])
def test_fingers_may_have_names_with_which_arrays_begin(name):
    def renamed():
        scene, arrays = cases.squeezed_disc(family="arc")
        arrays["contact_names"] = np.array([f"{name}.tip", "palm"])
        arrays = {key.replace("finger.", f"{name}."): value for key, value in arrays.items()}
        return scene.replaced(finger=None, fingers={name: scene.finger}), arrays

    scene, arrays = held(case=renamed)()
    assert not failed(scene, arrays)
    assert failed(scene, without(f"held.{name}.q")(arrays)) == {STATES}


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_all_coordinates_of_a_family_are_balanced(family):
    """With one coordinate, the bend as it is, a finger would be balanced along that bend alone."""
    scene, arrays = cases.squeezed_disc(family=family)
    name = "incomplete curvature shapes, finger"
    assert certify(scene, arrays)[name].passed
    shapes, tip = arrays["finger.curvature_shapes"], family == "matched_clothoid"
    for columns in ([0, *range(2, shapes.shape[2])], [0, 0, *range(2, shapes.shape[2])]):
        fewer = arrays | {
            "finger.curvature_shapes": shapes[..., columns],
            "finger.q": np.zeros(len(columns) - tip),
        }
        assert name in failed(scene, fewer)
    twice = {"arc": "clothoid", "clothoid": "arc", "matched_clothoid": "arc"}[family]
    coarse = cases.shapes_of(twice, arrays["finger.lengths"])
    other = arrays | {"finger.curvature_shapes": coarse, "finger.q": np.zeros(coarse.shape[2] - tip)}
    assert name in failed(scene, other)
