"""Stations that part and close as friction changes; from inside: the response at each friction state, one by one.

Stations that part and close as friction changes: each state has contacts of its own, and is verified with them.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from continuum_grasp.grasp.robust.response import Responder
from continuum_grasp.grasp.robust.search import find_robust, tried_states, with_postures
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.stations import _on_nearest, without_stations
from tests.grasp.test_grasp_state_search import pinched, sticking, wound

from benchmarks.grasp_oracle.check import LIMITS, residuals
from continuum_grasp.grasp import certify, optimize_grasp
from continuum_grasp.grasp.robust.errors import OBJECT
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene, Robust, load, scene_of
from tests.grasp.test_grasp_histories import at_rest
from tests.marks import few

ANY = Robust.model_construct(draws=0)


@pytest.fixture(scope="module")
def scene():
    """A bent finger with tendon friction and four stations."""
    shipped = scene_of("configs/grasp/preshaped.yaml", GraspScene)
    contacts = shipped.contacts.replaced(stations=4, middle_range=(0.06, 0.12))
    return shipped.replaced(
        contacts=contacts, fidelity=shipped.fidelity.replaced(elements=8), solver={"effort": "quick"}
    )


def for_any_friction(scene):
    """The grasp for any friction next to that with one station to which the grasp with one middle contact leads."""
    before = GraspSearch(without_stations(scene), Budget.of(scene.solver))
    before.run()
    search = GraspSearch(scene, Budget.of(scene.solver))
    search.attempt(_on_nearest(scene, before.scene, before.best.arrays), options_at=0)
    found = find_robust(scene, ANY, search.best.arrays, Budget.of(scene.solver))
    return found, with_postures(scene, found.arrays, found.responses, Budget())


@pytest.fixture(scope="module")
def both(scene):
    return for_any_friction(scene)


@pytest.fixture(scope="module")
def found(both):
    return both[0]


@pytest.fixture(scope="module")
def arrays(both):
    return both[1]


@pytest.mark.deep
def test_a_chain_of_guides_rests_on_the_station_that_closes():
    """Of a finger straight at rest and without weight: a chain of hinges with the exact law bears a state's forces."""
    changes = {"stations": 8, "middle_range": [0.04, 0.15]}
    scene = load("configs/grasp/mug.yaml").changed(
        {
            "finger.tendons.friction": 0.05,
            "fidelity": {"family": "clothoid", "elements": 12},
            "stability": "ignore",
            "solver.effort": "quick",
            "contacts.reserve": 0.0,
            **{f"contacts.{key}": value for key, value in changes.items()},
        }
    )
    found, arrays = for_any_friction(scene)
    assert found.holds
    assert certify(scene, arrays).passed
    closed = []
    for k, released in enumerate((False, True)):
        held = {key.removeprefix("held."): value[k] for key, value in arrays.items() if key.startswith("held.")}
        on = held["contact_names"] != ""
        held |= {key: value[on] for key, value in held.items() if key.startswith("contact_")}
        touching, places = at_rest(scene, {**found.arrays, **held}, "finger", released, False)
        closed.append(len(touching))
        line = held["finger.backbone"]
        for contact, place in zip(touching, places, strict=True):
            at = held["contact_stations"][contact]
            there = [np.interp(at, line[:, 0], line[:, column]) for column in (1, 2)]
            assert np.linalg.norm(place - there) < 5e-4 * scene.finger.rod.length
    assert closed == [3, 2]  # with the tip


@pytest.mark.deep
def test_a_station_closes_in_a_state_and_is_clear_in_others(found):
    sets = {frozenset(response.begin.contacts) for response in found.responses}
    assert found.holds
    assert len(sets) > 1
    assert set(found.arrays["contact_names"]) in sets
    for response in found.responses:
        forces = response.arrays["contact_forces"][:, 0]
        assert forces.min() >= -1e-4 * forces.max()


@pytest.mark.deep
def test_with_the_contacts_of_the_grasp_alone_a_state_has_no_posture(scene, found):
    """Unless the station closes, the finger lies in the object."""
    responder = Responder(scene, found.arrays, Budget.of(scene.solver))
    other = next(one for one in found.responses if len(one.begin.contacts) > len(found.arrays["contact_names"]))
    assert not responder._with(responder.start, other.error).holds
    assert responder.to(other.error).holds


@pytest.mark.deep
def test_each_state_is_verified_with_its_contacts(scene, arrays):
    certificate = certify(scene, arrays)
    assert certificate.passed
    assert certificate.states == len(arrays["held.object.pose"])
    names = arrays["held.contact_names"]
    assert (names[:, : len(arrays["contact_names"])] == arrays["contact_names"]).any(axis=1).all()
    assert np.isnan(arrays["held.contact_forces"][names == ""]).all()
    # By code of another hand, which asks for tangent contacts; stations need not be tangent.
    for name, value in residuals(scene, arrays).items():
        assert value < LIMITS[name] or name == "contact", name


@pytest.mark.parametrize("change", ["left out", "moved", "pulls", "gone", "unknown"])
def test_the_certificate_refuses_states_with_other_contacts(scene, arrays, change):
    names = arrays["held.contact_names"].copy()
    forces = arrays["held.contact_forces"].copy()
    extra = names.shape[1] - 1
    state = int(np.flatnonzero(names[:, extra] != "")[0])
    if change == "left out":  # it presses, so that nothing balances without it
        names[state, extra] = ""
    elif change == "moved":  # into a state in which it is clear, without numbers
        clear = int(np.flatnonzero(names[:, extra] == "")[0])
        names[clear, extra] = names[state, extra]
    elif change == "pulls":
        forces[state, extra, 0] = -1.0
    elif change == "gone":  # the tip is on in all states
        names[state][names[state] == "finger.tip"] = ""
    else:
        names[state, extra] = "finger.station_9"
    changed = {**arrays, "held.contact_names": names, "held.contact_forces": forces}
    failed = {check.name for check in certify(scene, changed).failed}
    # What pulls, or has no forces, is the worst of all, beside which none was tried.
    failed -= {"untested neighbors of the worst friction state"} if change in ("moved", "pulls") else set()
    assert failed
    assert all(name.startswith("held with friction states") for name in failed)


def test_friction_states_drawn_at_random_hold(scene, found):
    responder = Responder(scene, found.arrays, Budget.of(scene.solver))
    rng = np.random.default_rng(7)
    for _ in range(10):
        states = np.clip(rng.uniform(-2.0, 2.0, 16), -1.0, 1.0)
        assert responder.to(np.concatenate([np.zeros(OBJECT), states])).holds


@pytest.mark.deep
def test_less_tension_is_found_for_any_friction_with_stations_than_with_one_middle_contact(scene):
    plain = optimize_grasp("configs/grasp/preshaped.yaml")
    result = optimize_grasp(scene)
    assert result.solved
    assert result.robustness.robust.holds
    assert result.tension < 0.9 * plain.tension
    assert certify(scene, result.arrays).passed


@pytest.mark.deep
@pytest.mark.parametrize("case", few([sticking, wound, pinched], 1))
def test_no_vertex_is_worse_than_the_search_says(case):
    """By brute force, for the grasp as found, and for the one that is best where nothing sticks."""
    found = optimize_grasp(case())
    robust = {key: value for key, value in found.arrays.items() if not key.startswith("held.")}
    for arrays in (robust, found.robustness.nominal_arrays):
        worst = min(tried_states(found.scene, arrays, Budget()), key=lambda one: one.reserve)
        responder = Responder(found.scene, arrays, Budget())
        size = worst.error.size - OBJECT
        every = [responder.to(np.concatenate([np.zeros(OBJECT), z])) for z in product((1.0, -1.0), repeat=size)]
        assert worst.reserve == pytest.approx(min(one.reserve for one in every), abs=1e-5)
