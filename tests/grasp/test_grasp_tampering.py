"""A stored result that was changed fails its certificate, as arrays and as a folder."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.grasp import GraspResult, HandResult, certify
from tests import certificate_cases as cases
from tests import hand_cases

MISSING = "missing or misshapen arrays"


def failed(scene, arrays):
    return {check.name for check in certify(scene, arrays).failed}


# -- arrays --------------------------------------------------------------------------------------------------------


def clothoids():
    return cases.squeezed_disc(family="clothoid")


CASES = {"plane": clothoids, "hand": lambda: hand_cases.three_straight(0.05)}
ARRAYS = [(kind, key) for kind, case in CASES.items() for key in case()[1] if not key.endswith("family")]


@pytest.mark.parametrize(("kind", "key"), ARRAYS)
def test_every_stored_array_is_needed_as_it_is(kind, key):
    scene, arrays = CASES[kind]()
    value = np.asarray(arrays[key])
    flat = np.ravel(value)[None, None]
    for other in ("words", flat, *([value[:-1]] if value.ndim and not key.endswith((".backbone", ".q")) else [])):
        assert MISSING in failed(scene, arrays | {key: other})
    assert MISSING in failed(scene, {one: value for one, value in arrays.items() if one != key})
    if value.dtype.kind == "f" and (kind, key) != ("plane", "contact_stations"):
        value = value.copy()
        value[(0,) * value.ndim] = np.nan
        assert "non-finite numbers" in failed(scene, arrays | {key: value})


@pytest.mark.parametrize("kind", CASES)
def test_elements_have_as_many_coordinates_as_shapes(kind):
    scene, arrays = CASES[kind]()
    name = scene.setups[0].name
    for other in (arrays[f"{name}.q"][:-1], np.append(arrays[f"{name}.q"], 0.0)):
        assert MISSING in failed(scene, arrays | {f"{name}.q": other})


def test_a_single_row_of_contacts_does_not_pass():
    scene, arrays = cases.squeezed_disc()
    first = {key: value[:1] if key.startswith("contact_") else value for key, value in arrays.items()}
    assert failed(scene, first)


@pytest.mark.parametrize("name", ["held", "contact_a"])
def test_fingers_may_have_names_with_which_arrays_begin(name):
    scene, arrays = clothoids()
    arrays["contact_names"] = np.array([f"{name}.tip", "palm"])
    arrays = {key.replace("finger.", f"{name}."): value for key, value in arrays.items()}
    scene = scene.replaced(finger=None, fingers={name: scene.finger})
    assert not failed(scene, arrays)
    assert failed(scene, {key: value for key, value in arrays.items() if key != f"{name}.q"}) == {MISSING}


# -- folders -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Folders with grasps, by the name of the scene."""
    made = {}

    def folder(name):
        if name not in made:
            made[name] = tmp_path_factory.mktemp("run")
            cg.optimize_grasp(f"configs/{name}.yaml").save(made[name], quality=False)
        return made[name]

    return folder


KINDS = {"grasp/mug": GraspResult, "hand/pinch": HandResult}
SAVED = ["grasp/mug", pytest.param("hand/pinch", marks=pytest.mark.deep)]


def changed(folder, to, key, change):
    """A copy of a run with an array changed."""
    shutil.copytree(folder, to)
    with np.load(to / "result.npz") as file:
        arrays = dict(file)
    arrays[key] = change(arrays[key])
    np.savez(to / "result.npz", **arrays)
    return to


@pytest.mark.parametrize("name", SAVED)
def test_a_grasp_is_read_as_it_was_saved(saved, name):
    again = KINDS[name].of_run(saved(name))
    assert again.solved
    assert again.certificate.passed
    own = json.loads((saved(name) / "meta.json").read_text(encoding="utf-8"))
    assert again.status == own["status"]
    assert again.message == own["message"]
    assert {key: vars(error) for key, error in again.element_errors.items()} == own["element_errors"]
    checks = {check["name"]: check["value"] for check in own["certificate"]["checks"]}
    for check in again.certificate.checks:
        if check.name in checks:
            assert check.value == pytest.approx(checks[check.name], rel=1e-6, abs=1e-15)


@pytest.mark.parametrize(
    ("name", "key", "change", "check"),
    [
        ("grasp/mug", "finger.tensions", lambda v: 0.99 * v, "finger equilibrium, finger"),
        ("grasp/mug", "contact_forces", lambda v: 1.001 * v, "object force balance"),
        ("grasp/mug", "finger.backbone", lambda v: v + 1e-4, "stored numbers, finger"),
        pytest.param(
            *("hand/pinch", "contact_deflections", lambda v: v + 1e-5, "stored numbers, finger_1.middle"),
            marks=pytest.mark.deep,
        ),
    ],
)
def test_what_was_changed_in_a_folder_is_no_grasp(saved, tmp_path, name, key, change, check):
    again = KINDS[name].of_run(changed(saved(name), tmp_path / "run", key, change))
    assert check in {each.name for each in again.certificate.failed}
    assert not again.solved
    assert again.status == "not_solved"
    assert again.message.startswith("the certificate refuses the stored numbers")
    assert np.isnan(again.tension)


def test_a_folder_of_another_kind_is_refused(saved):
    with pytest.raises(InputError, match="expected the grasp of a hand, got the grasp of a planar scene"):
        HandResult.of_run(saved("grasp/mug"))


@pytest.mark.deep
def test_a_folder_of_a_hand_is_no_planar_grasp(saved):
    with pytest.raises(InputError, match="expected the grasp of a planar scene, got the grasp of a hand"):
        GraspResult.of_run(saved("hand/pinch"))
