"""Stations along a finger: which touch is found, and what presses there bends the finger as statics asks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.grasp import GraspResult, certify, optimize_grasp
from continuum_grasp.scene import GraspScene
from continuum_grasp.scene.load import scene_of

Array = NDArray[Any]
PLACES = {"stations": 4, "middle_range": (0.06, 0.12)}


def _mug(name: str = "mug", **contacts: Any) -> GraspScene:
    scene = scene_of(f"configs/grasp/{name}.yaml", GraspScene)
    whole = scene.contacts.replaced(**contacts)
    fidelity = scene.fidelity.replaced(elements=8)
    return scene.replaced(contacts=whole, fidelity=fidelity, solver={"effort": "quick"})


@pytest.fixture(scope="module")
def wrapped() -> GraspResult:
    return optimize_grasp(_mug(**PLACES))


def _statics(result: GraspResult) -> tuple[Array, Array]:
    """Bending moment at the middles of the elements, by the shape, and by all forces beyond them [N m]."""
    a, setup = result.arrays, result.scene.setups[0]
    ends = np.concatenate([[0.0], np.cumsum(a["finger.lengths"])])
    middles = 0.5 * (ends[1:] + ends[:-1])
    line = a["finger.backbone"]
    x, y = (np.interp(middles, line[:, 0], line[:, c]) for c in (1, 2))
    step = 1e-3
    turn = np.interp(middles + step, line[:, 0], line[:, 3]) - np.interp(middles - step, line[:, 0], line[:, 3])
    left, right = a["finger.tensions"]
    by_shape = setup.finger.profile.mean_stiffness * turn / (2 * step) - (left - right) * setup.tendons.offset
    by_forces = np.zeros(middles.size)
    for k, name in enumerate(a["contact_names"]):
        if not str(name).startswith("finger."):
            continue
        normal, point = a["contact_normals"][k], a["contact_positions"][k]
        n, f, _ = a["contact_forces"][k]
        force = n * normal + f * np.array([-normal[1], normal[0]])  # at the skin, where it acts
        moment = (point[0] - x) * force[1] - (point[1] - y) * force[0]
        by_forces += np.where(middles < a["contact_stations"][k], moment, 0.0)
    return by_shape, by_forces


def test_the_bending_moment_is_that_of_the_forces_beyond(wrapped: GraspResult) -> None:
    by_shape, by_forces = _statics(wrapped)
    # Between the ends of elements the model's curvature is linear, the moment nearly so.
    assert np.abs(by_forces).max() > 0.01
    assert by_shape == pytest.approx(by_forces, abs=0.02 * np.abs(by_forces).max())


def test_stations_take_no_more_tension_than_one_contact_among_them(wrapped: GraspResult) -> None:
    alone = optimize_grasp(_mug())
    place = next(c.station for c in alone.contacts if c.name == "finger.middle")
    assert place is not None
    assert 0.06 < place < 0.12  # where the stations are, too
    assert sum("station" in c.name for c in wrapped.contacts) >= 2
    assert 0.9 * alone.tension < wrapped.tension < alone.tension


def test_stations_touch_near_where_they_are(wrapped: GraspResult) -> None:
    found = {c.name: c.station for c in wrapped.contacts if "station" in c.name}
    for name, station in found.items():
        at = 0.06 + 0.02 * (int(name[-1]) - 1)
        assert station == pytest.approx(at, abs=0.01 + 1e-9)


@pytest.mark.parametrize("what", ["contact_forces", "contact_stations", "finger.q"])
def test_the_certificate_refuses_what_is_changed(wrapped: GraspResult, what: str) -> None:
    assert wrapped.certificate is not None
    assert wrapped.certificate.passed
    arrays = {key: np.array(value) for key, value in wrapped.arrays.items()}
    row = next(k for k, name in enumerate(arrays["contact_names"]) if "station" in str(name))
    arrays[what][row if what != "finger.q" else 2] *= 1.001
    assert not certify(wrapped.scene, arrays).passed


def test_stations_stand_in_place_of_middle_contacts() -> None:
    with pytest.raises(InputError, match="stations stands in place of"):
        _mug(middle="auto", **PLACES)
