"""Grasps of rods on elements, from inside: the projection.

Truth are virtual work along the stored shape, by numpy alone; the order of the families; and the certificate of rods,
for what has been stored.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import continuum_grasp as cg
from continuum_grasp.grasp.judge.arrays import RodArrays
from continuum_grasp.grasp.judge.certificate import certify_held, shapes_of
from continuum_grasp.grasp.judge.surfaces import PlacedObject
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.projection import CLOSE, on_elements, projected
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.nlp import Budget
from tests.marks import few
from tests.rods import order


def with_elements(scene, per_segment):
    """The scene whose fingers have so many elements between contacts."""
    counts = {setup.name: per_segment * (len(setup.middles) + 1) for setup in scene.setups}
    fingers = {
        setup.name: setup.finger.replaced(
            fidelity=scene.fidelity.replaced(elements=counts[setup.name], family=setup.family, tolerance=None)
        )
        for setup in scene.setups
    }
    return scene.with_fingers(fingers)


@cache
def held_by(name):
    """A scene, a grasp of it, and the shapes of the fingers."""
    scene = cg.load(f"configs/{name}.yaml")
    search = (RodSearch if name.startswith("grasp/") else HandRodSearch)(scene, Budget())
    search.run(1)
    held = held_rods(search.best)
    return scene, held, shapes_of(scene, held)


@pytest.mark.parametrize("name", few(["mug", "pinch", "mug_arcs", "wrap"], 3))
def test_elements_are_in_equilibrium_with_the_forces_that_close_their_gaps(name):
    scene, held, rods = held_by(f"grasp/{name}")
    scene, found = on_elements(scene, held, rods)
    arrays = {**RodArrays.of(scene).stored(held, rods), **found.arrays}
    names = arrays["contact_names"].tolist()
    each = zip(names, arrays["contact_forces"][:, 0], strict=True)
    normal = [found.normal_forces.get(contact, force) for contact, force in each]
    arrays["contact_forces"] = np.column_stack([normal, arrays["contact_forces"][:, 1:]])
    for setup in scene.setups:
        for left in missing_work(setup, scene, arrays):
            assert left < 1e-5


def missing_work(setup, scene, arrays):
    """Work that is missing per coordinate of a finger without friction, per greatest part of it: of bending, tendons,
    contacts and weight, by quadrature along the stored shape.
    """
    shape, finger = FingerShape(setup, arrays), setup.finger
    x, w = np.polynomial.legendre.leggauss(40)
    ends = np.unique([*shape.joints, *finger.profile.breaks])
    half, middle = 0.5 * np.diff(ends)[:, None], 0.5 * (ends[1:] + ends[:-1])[:, None]
    s, weights = (middle + half * x).ravel(), (half * w).ravel()
    line = arrays[f"{setup.name}.base"]
    dense = np.linspace(0.0, shape.joints[-1], 20_001)
    bent = np.concatenate([[0.0], cumulative_trapezoid(shape.curvature(dense), dense)])
    along = np.exp(1j * (line[2] + bent)) * 1j
    places = line[0] + 1j * line[1] + np.concatenate([[0.0], cumulative_trapezoid(along, dense)])
    at, moment = np.interp(s, dense, places), np.zeros(s.size)
    gravity = complex(*scene.gravity[:2])

    def bears(place, force, couple=0.0, reach=np.inf):
        moment[s < reach] += ((np.conj(place - at) * force).imag + couple)[s < reach]

    body = PlacedObject(scene.object, arrays["object.pose"])
    for contact, (n, f, _), station, part in zip(
        *(arrays[f"contact_{key}"] for key in ("names", "forces", "stations", "parts")), strict=True
    ):
        if str(contact).startswith(f"{setup.name}."):
            place = np.interp(station, dense, places)
            near = body.nearest(np.array([[place.real, place.imag]]), body.parts[part])
            half = float(finger.profile.half_thickness(station))
            assert abs(float(near.distance[0]) - half) < 1e-5 * dense[-1]
            # Elements end at contacts.
            bears(place, (n + 1j * f) * complex(*near.normal[0]), -half * f, station)
    for mass in finger.masses:
        bears(np.interp(mass.at, dense, places), mass.mass * gravity, reach=mass.at)
    density = finger.profile.linear_density(dense)
    beyond = [np.trapezoid(np.where(dense > k, density * places, 0.0), dense) for k in s]
    mass = np.array([np.trapezoid(np.where(dense > k, density, 0.0), dense) for k in s])
    moment += (np.conj(np.array(beyond) - mass * at) * gravity).imag
    stiffness = finger.profile.bending_stiffness(s)
    parts = [stiffness * shape.elastic(s), -shape.actuation(s), -moment]
    for step in np.eye(shape.q.size):
        bend = shape.elastic(s, shape.q + step) - shape.elastic(s)
        works = [float((weights * bend) @ part) for part in parts]
        yield abs(sum(works)) / max(map(abs, works))


@pytest.mark.parametrize(("name", "expected"), [("pinch", 4), ("mug_arcs", 2)])
def test_elements_come_closer_to_the_rod_by_the_order_of_their_family(name, expected):
    scene, held, rods = held_by(f"grasp/{name}")
    errors = [projected(with_elements(scene, n), held, rods).error.displacement for n in (2, 4, 8)]
    assert order(errors)[-1] == pytest.approx(expected, abs=0.5)


def test_elements_that_the_user_states_stay_and_their_error_is_known():
    scene, held, rods = held_by("grasp/mug")
    two = with_elements(scene, 1)
    found, projection = on_elements(two, held, rods)
    assert found is two
    assert projection.error.elements == 2
    assert projection.error.normal_force > CLOSE


def test_elements_that_are_not_stated_are_doubled_until_forces_agree():
    scene, held, rods = held_by("grasp/mug")
    open_ = scene.replaced(fidelity={"tolerance": 1e-4})
    found, projection = on_elements(open_, held, rods)
    assert projection.error.displacement <= 1e-4
    assert projection.error.normal_force <= CLOSE
    fewer = projected(with_elements(found, found.setups[0].elements // 4), held, rods)
    assert fewer.error.displacement > 1e-4


@pytest.mark.parametrize("name", ["grasp/mug", "grasp/pinch", "hand/can"])
def test_a_grasp_is_read_from_its_arrays_as_it_was(name):
    scene, held, rods = held_by(name)
    arrays = RodArrays.of(scene)
    certificate = certify_held(scene, arrays.held(arrays.stored(held, rods)))
    assert certificate.passed
    for rod, same in zip(certificate.rods, rods, strict=True):
        s = np.linspace(0.0, rod.length, 7)
        assert np.abs(rod.at(s).points - same.at(s).points).max() < 1e-9 * rod.length


def test_fingers_of_a_hand_lie_in_their_planes_but_for_the_shift_that_is_stored():
    scene, held, rods = held_by("hand/can")
    found = on_elements(scene, held, rods)[1]
    arrays = RodArrays.of(scene).stored(held, rods)
    assert found.error.normal_force < 5e-3
    for finger, contact in zip(held.fingers, arrays["contact_deflections"], strict=True):
        assert 0.0 < abs(contact) < 0.02
        assert arrays[f"{finger.name}.backbone"][0] == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-12)
