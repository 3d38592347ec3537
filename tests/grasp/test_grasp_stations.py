"""Stations along a finger: which touch is found, and what presses there bends the finger as statics asks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.grasp_oracle.check import LIMITS, residuals
from continuum_grasp.base import InputError, SolverError
from continuum_grasp.grasp import GraspResult, GraspStatus, optimize_grasp
from continuum_grasp.scene import GraspScene, scene_of

PLACES = {"stations": 4, "middle_range": (0.06, 0.12)}


def _mug(name: str = "mug", mass: float | None = None, **contacts: Any) -> GraspScene:
    scene = scene_of(f"configs/grasp/{name}.yaml", GraspScene)
    whole = scene.contacts.replaced(reserve=0.0, **contacts)
    fidelity = scene.fidelity.replaced(elements=8)
    body = scene.object if mass is None else scene.object.replaced(mass=mass)
    return scene.replaced(object=body, contacts=whole, fidelity=fidelity, solver={"effort": "quick"})


COSTLY_FIXTURES = ("wrapped", "bent")


@pytest.fixture(scope="module")
def wrapped() -> GraspResult:
    return optimize_grasp(_mug(**PLACES))


@pytest.fixture(scope="module")
def bent() -> GraspResult:
    """By a finger with a rest curvature, with tendon friction as it is pulled, in the plane."""
    return optimize_grasp(_mug("preshaped", **PLACES).replaced(friction_states="pulled", stability="ignore"))


@pytest.mark.deep
@pytest.mark.parametrize("which", ["wrapped", "bent"])
def test_what_presses_bends_the_finger_as_statics_asks(which: str, request: pytest.FixtureRequest) -> None:
    """By code of another hand, of the elements that stand for the rod: they are as near to it as the result says."""
    result = request.getfixturevalue(which)
    assert result.certificate.passed
    (error,) = result.element_errors.values()
    assert error.is_close
    for name, value in residuals(result.scene, result.arrays).items():
        assert value < max(LIMITS[name], 5e-3), name


@pytest.mark.deep
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


@pytest.mark.deep
def test_a_first_station_within_the_palm_is_no_obstacle(wrapped: GraspResult) -> None:
    # The finger, 6 mm to either side, comes out of the palm; its second station is where the first of `wrapped` is.
    found = optimize_grasp(_mug(stations=5, middle_range=(0.004, 0.116)))
    # Stations 16 mm apart are not where those of `wrapped` are.
    assert found.tension == pytest.approx(wrapped.tension, rel=0.05)
    assert "finger.station_1" not in [c.name for c in found.contacts]


@pytest.mark.deep
def test_a_station_opposite_a_palm_presses_as_friction_asks() -> None:
    """N is the same at both and carries the weight across: mu N + mu N = m g."""
    contacts = {"friction": 0.5, "normal_force_max": 100.0, "stations": 2, "middle_range": (0.09, 0.13), "tip": "off"}
    finger = {
        "rod": {"length": 0.2, "linear_density": 1e-9, "bending_stiffness": 0.05},
        "half_thickness": 0.006,
        "tendons": {"offset": 0.005, "max_tension": 200.0},
        "base": {"position": (-0.1, -0.046), "angle": -0.5 * np.pi},
        "base_free": {"x": (-0.12, -0.08), "y": (-0.07, -0.02), "angle": (-0.5 * np.pi - 0.5, -0.5 * np.pi + 0.5)},
    }
    scene = GraspScene(
        finger=finger,  # type: ignore[arg-type]
        object={"shape": "circle", "diameter": 0.08, "mass": 0.3, "position": (0.0, 0.0)},  # type: ignore[arg-type]
        supports={"palm": {"type": "palm", "point": (0.0, 0.04), "normal_angle": -0.5 * np.pi}},  # type: ignore[dict-item]
        contacts=contacts,  # type: ignore[arg-type]
        gravity=[0.0, 0.0, -9.81],  # type: ignore[arg-type]
        fidelity={"family": "matched_clothoid", "elements": 4},  # type: ignore[arg-type]
        objective="least_normal_force",
        stability="ignore",
    )
    found = optimize_grasp(scene)
    assert [c.normal_force for c in found.contacts] == pytest.approx([0.3 * 9.81 / (2 * 0.5)] * 2, rel=1e-6)


@pytest.mark.deep
def test_the_greatest_mass_can_be_held_and_more_cannot() -> None:
    with pytest.raises(SolverError, match="too heavy") as raised:
        optimize_grasp(_mug(mass=1.5, **PLACES))
    result = raised.value.result
    assert isinstance(result, GraspResult)
    assert result.status is GraspStatus.NOT_SOLVED
    most = next(reason.needed for reason in result.reasons if reason.name == "mass")
    assert optimize_grasp(_mug(mass=0.995 * most, **PLACES)).certificate
    assert not optimize_grasp(_mug(mass=1.02 * most, **PLACES), raise_on_failure=False).solved


def test_stations_stand_in_place_of_middle_contacts() -> None:
    with pytest.raises(InputError, match="stations stand in place of"):
        _mug(middle="auto", **PLACES)


def test_there_is_an_element_between_every_two_stations() -> None:
    with pytest.raises(InputError, match=r"stations: 8 needs fidelity\.elements of at least 9, got 8"):
        _mug(stations=8, middle_range=(0.06, 0.12))
