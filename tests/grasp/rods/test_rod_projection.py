"""Grasps of rods on elements, from inside: no door leads to them yet.

Truth are the certificate of elements, which tests their equilibrium by virtual work with numpy alone; the order of the
families; and the certificate of rods, for what has been stored.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.certificate.certificate import equilibrium_checks
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.judge.certificate import certify_rods, rods_of
from continuum_grasp.grasp.rods.arrays import RodArrays
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.projection import CLOSE, on_elements, projected
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
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
    return scene, held, rods_of(scene, held)


@pytest.mark.parametrize("name", few(["mug", "pinch", "mug_motor", "spirob_cup", "mug_arcs", "preshaped"], 3))
def test_elements_are_in_equilibrium_with_the_forces_that_close_their_gaps(name):
    scene, held, rods = held_by(f"grasp/{name}")
    scene, found = on_elements(scene, held, rods)
    arrays = {**RodArrays.of(scene).stored(held, rods), **found.arrays}
    names = arrays["contact_names"].tolist()
    each = zip(names, arrays["contact_forces"][:, 0], strict=True)
    normal = [found.normal_forces.get(contact, force) for contact, force in each]
    arrays["contact_forces"] = np.column_stack([normal, arrays["contact_forces"][:, 1:]])
    grasp = RecomputedGrasp(scene, arrays)
    for contact in grasp.contacts:
        if contact.finger is not None:
            assert contact.gap < 1e-6 * contact.length
            # Elements of a middle contact, whose place stays, are not exactly along the surface.
            center = contact.finger.points[contact.finger.joint_edges[contact.joint]]
            contact.normal = grasp.object.nearest(center[None], grasp.object.parts[contact.part]).normal[0]
    for finger in grasp.fingers:
        for check in equilibrium_checks(finger):
            assert check.value < 1e-5, check


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
    certificate = certify_rods(scene, arrays.held(arrays.stored(held, rods)))
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
