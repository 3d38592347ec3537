"""Scenes built in Python: what is wrong is said as for files, with the class in place of the file."""

from __future__ import annotations

import copy
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError

ROD = {"length": 0.6, "diameter": 0.002, "density": 6450.0, "youngs_modulus": 60e9}
FINGER = cg.Finger(rod=cg.Rod(**ROD))
HUGE = 10**400

WRONG = {
    "wrong type": (
        lambda: cg.Rod(**{**ROD, "length": "0.6"}),
        "Rod: length: wrong type: expected a length [m] such as 0.012 or 12 mm, got text '0.6' (write",
    ),
    "an endless whole number": (lambda: cg.Rod(**{**ROD, "length": HUGE}), "Rod: length: "),
    "misspelt": (lambda: cg.Rod(**ROD, lenght=1.0), "Rod: lenght: unknown key; did you mean 'length'?"),
    "a nested mapping": (lambda: cg.Finger(rod={**ROD, "length": "x"}), "Finger: rod.length: wrong type"),
    "a nested value": (
        lambda: cg.Finger(rod=FINGER.rod, masses=[cg.PointMass(at=0.7, mass=0.1)]),
        "Finger: masses[0].at: 0.7 m is beyond",
    ),
    "an entry of a list": (
        lambda: cg.Finger(rod=FINGER.rod, masses=[{"at": 0.1}]),
        "Finger: masses[0].mass: missing; expected mass [kg]",
    ),
    "actuation": (
        lambda: cg.Actuation(),
        "Actuation: give exactly one of tip_moment, tensions, lengths, torques, angles and pressures",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said_with_its_key(name):
    make, words = WRONG[name]
    with pytest.raises(InputError) as caught:
        make()
    assert words in str(caught.value)
    assert caught.value.file == str(caught.value).split(":")[0]


def test_all_that_is_wrong_is_said_at_once():
    with pytest.raises(InputError) as caught:
        cg.Rod(length=-1.0, diameter="x", density=1.0)
    assert [line.split(": ")[1] for line in str(caught.value).splitlines()] == ["diameter", "length"]
    assert caught.value.key == "diameter"


def test_values_can_be_copied_and_stored():
    assert pickle.loads(pickle.dumps(FINGER)) == copy.deepcopy(FINGER) == FINGER
    assert FINGER.model_copy(update={"strain_limit": 0.01}).strain_limit == 0.01
    assert hash(copy.deepcopy(FINGER)) == hash(FINGER)


def test_equal_scenes_are_one_key():
    """With objects and supports by name too, as a cache needs it."""
    file = Path(__file__).parents[2] / "configs/simulate"
    scenes = [cg.load(each) for each in sorted(file.glob("*.yaml"))]
    assert any(scene.supports for scene in scenes)
    assert len({*scenes, *copy.deepcopy(scenes)}) == len(scenes)


@pytest.mark.parametrize("length", [1e-6, 1e4])
@pytest.mark.parametrize("stiffness", [1e-24, 1e15])
@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_the_bounds_are_within_what_the_equations_bear(family, length, stiffness):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rod = cg.Rod(length=length, linear_density=1e-15 if stiffness < 1 else 1e9, bending_stiffness=stiffness)
        model = cg.FingerModel(cg.Finger(rod=rod), family=family)
    unit = 1.0 if family == "arc" else 1.0 / length
    rate = model.forward_dynamics([0.3 * unit] * model.n + [unit] * model.n, [0.0], [0.0, 0.0], [])
    assert np.isfinite(np.array(rate)).all()


GRASPS = {
    "a range beyond a turn": (
        "fidelity.bending_range=7",
        "fidelity.bending_range: elements that bend by 7 rad are more",
    ),
    "friction at a matched tip": ("finger.tendons.friction=0.1", "fidelity.family: matched_clothoid"),
    "one tendon": (
        "finger.tendons=[{offset: 0.005, max_tension: 60}]",
        "finger.tendons: a grasp needs a pair",
    ),
    "an object without size": ("object.diameter=1e-300", "object.diameter: out of range"),
}


@pytest.mark.parametrize("name", GRASPS)
def test_what_no_grasp_can_be_is_said(name):
    change, words = GRASPS[name]
    with pytest.raises(InputError) as caught:
        cg.load(Path(__file__).parents[2] / "configs/grasp/mug.yaml", [change])
    assert words in str(caught.value)


@pytest.mark.parametrize(("excess", "taken"), [(0.999e-6, True), (1.001e-6, False), (1e-3, False)])
def test_a_duration_is_a_whole_number_of_steps_but_for_rounding(excess, taken):
    """By a share of the number of steps."""
    given = {"duration": 1.0, "step": 1.0 / (10.0 * (1.0 + excess))}
    if taken:
        cg.Timing(**given)
    else:
        with pytest.raises(InputError, match="whole number of steps"):
            cg.Timing(**given)


@pytest.mark.parametrize(
    ("gravity", "said"),
    [
        ({"mode": "out_of_plane", "magnitude": 9.81}, r"gravity: expected .*, not a mode.* out of it \[0, 0, -9.81\]"),
        ([0.0, -9.81], r"gravity: expected three components .* in the plane give \[x, y, 0\]"),
        (9.81, "gravity: wrong type: expected a list of 3"),
    ],
)
def test_gravity_of_a_grasp_is_a_vector_in_space(gravity, said):
    with pytest.raises(InputError, match=said):
        cg.load(Path(cg.__file__).parents[1] / "configs/grasp/mug.yaml").changed({"gravity": gravity})


def test_an_object_is_upright_only_where_something_could_tilt_it():
    with pytest.raises(InputError, match="upright: has no effect"):
        cg.load(Path(cg.__file__).parents[1] / "configs/grasp/mug_lying.yaml").changed({"upright": True})
