"""Grasps with dry friction in bending, by closed forms; from inside: responses to friction states that are given here.

Grasps of fingers with dry friction in bending: closed forms, histories by simulation, code of another hand.
"""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from continuum_grasp.grasp.certificate.model_error import model_error
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.robust.response import Responder

from benchmarks.grasp_oracle.check import LIMITS, residuals
from continuum_grasp.grasp import GraspStatus, certify, optimize_grasp
from continuum_grasp.grasp.robust.errors import OBJECT
from continuum_grasp.model import FingerModel
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import Damping, Finger, ForceLoad, MomentLoad, PointMass, Rod, Tendons, load
from continuum_grasp.simulation import equilibrium_under
from continuum_grasp.simulation.rest import EquilibriumSearch, LoadState
from tests import certificate_cases as cases
from tests.grasp_scenes import CONFIGS

L, EI, OFFSET = 0.18, 6.11e-3, 0.005
TWO = ((0.02, 0.008), (0.003, 0.015))
"""Stiffnesses [N m2] and moments [N m] of two branches: the one slides at 0.4 /m, the other at 5 /m."""


def damping(branches, cells=2):
    """Dry friction with these branches."""
    given = [{"stiffness": stiffness, "moment": moment} for stiffness, moment in branches]
    return Damping.model_validate({"dry_friction": given, "friction_cells": cells})


def mug(branches, **changes):
    """The mug of the shipped scene, by a finger whose bending sticks."""
    own = {"finger.damping": damping(branches).model_dump(), "fidelity.family": "clothoid"}
    return load(CONFIGS / "mug.yaml").changed({"contacts.reserve": 0.0, **own, **changes})


@cache
def held():
    """The grasp of a finger with two branches."""
    return optimize_grasp(mug(TWO))


# -- what a scene may say ---------------------------------------------------------------------------------------------


def test_without_branches_a_grasp_is_what_it_was_to_the_bit():
    few_elements = {"fidelity.elements": 2, "solver.effort": "quick", "contacts.reserve": 0.0}
    plain = optimize_grasp(load(CONFIGS / "mug.yaml").changed({**few_elements, "fidelity.family": "clothoid"}))
    found = optimize_grasp(mug((), **few_elements))
    assert plain.arrays.keys() == found.arrays.keys()
    assert all(np.array_equal(plain.arrays[key], found.arrays[key], equal_nan=key == "contact_stations")
               for key in plain.arrays)  # fmt: skip
    assert found.robustness is None
    assert found.certificate.states == 0


# -- closed form: a free rod under a constant moment ------------------------------------------------------------------


UNTOUCHED = {
    **{f"contact_{key}": np.zeros((0, size)) for key, size in (("positions", 2), ("normals", 2), ("forces", 3))},
    "contact_names": np.array([], dtype=str),
    "contact_stations": np.zeros(0),
    "contact_parts": np.zeros(0, dtype=int),
    "object.pose": np.array([9.0, 0.1, 0.0]),
}


@pytest.mark.parametrize("family", ["arc", "clothoid"])
@pytest.mark.parametrize(("tension", "rest"), [(20.0, 0.0), (2.0, 3.0), (-10.0, 0.0)])
def test_a_free_rod_bends_as_its_branches_let_it(family, tension, rest):
    """EI kappa + sum of min(k kappa, M) = e T as pulled; EI kappa + sum of z M = e T with states."""
    moment = OFFSET * tension
    tendons = Tendons(offset=OFFSET, max_tension=60.0)
    rod = Rod(length=L, linear_density=1e-9, bending_stiffness=EI)
    finger = cases.make_finger(rod=rod, tendons=tendons, damping=damping(TWO), rest_curvature=rest)
    scene, _ = cases.apart(finger, family=family, elements=4)
    pulls = (tension, 0.0) if tension > 0.0 else (0.0, -tension)

    def at(curvature, states=None):
        bent = np.full(4, curvature * L / 4) if family == "arc" else np.full(5, curvature)
        arrays = cases.finger_arrays(scene, "finger", bent, tensions=pulls, tip=curvature)
        if states is not None:
            arrays["finger.friction_states"] = states
        return RecomputedGrasp(scene, {**arrays, **UNTOUCHED})

    def off(*given):
        (bent,) = at(*given).fingers
        return np.abs(bent.virtual_work()).max() / bent.load_moment

    low, high = -50.0, 50.0
    for _ in range(80):
        kappa = 0.5 * (low + high)
        own = EI * kappa + sum(np.clip(k * kappa, -m, m) for k, m in TWO)
        low, high = (kappa, high) if own < moment else (low, kappa)
    assert off(kappa) < 1e-9
    assert off(1.001 * kappa) > 1e-4
    assert model_error(at(kappa)).greatest < 1e-8 * L  # the exact rod is an arc too
    cells = 4 * (1 if family == "arc" else 2)
    for z in ((1.0, 1.0), (-1.0, -1.0), (-1.0, 0.3)):
        kappa = (moment - sum(w * m for w, (_, m) in zip(z, TWO, strict=True))) / EI
        assert off(kappa, np.tile(z, cells)) < 1e-9
        assert off(kappa, np.tile(-np.array(z), cells)) > 1e-4


@pytest.mark.parametrize(("family", "q"), [("arc", (5.0, -6.0)), ("clothoid", (40.0, 10.0, -70.0))])
def test_virtual_work_is_the_slope_of_the_energy(family, q):
    """Of a finger that is bent as far as can be, under its weight and masses between its elements' ends, with friction
    states that differ from cell to cell: Gauss quadrature of many nodes and differences, made here.
    """
    masses = (PointMass(at=0.23 * L, mass=0.004), PointMass(at=0.81 * L, mass=0.003))
    rod = Rod(length=L, linear_density=0.03, bending_stiffness=EI)
    finger = cases.make_finger(
        rod=rod, masses=masses, damping=damping(TWO), tendons=Tendons(offset=OFFSET, max_tension=60.0)
    )
    scene, _ = cases.apart(finger, gravity=cases.PLANAR, family=family)
    lengths, tensions = np.array([0.4 * L, 0.6 * L]), (20.0, 3.0)
    cells = scene.setups[0].bending_cells
    ends = np.append(np.linspace(0.0, 0.4, cells + 1)[:-1], np.linspace(0.4, 1.0, cells + 1)) * L
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (2 * cells, len(TWO)))
    x, w = np.polynomial.legendre.leggauss(60)
    s = np.concatenate([a + 0.5 * n * (x + 1.0) for a, n in zip((0.0, lengths[0]), lengths, strict=True)])
    weights = np.concatenate([0.5 * n * w for n in lengths])

    def energy(q):
        curvatures = cases.ends_of(family, q, lengths, 0.0)
        both = cases.bent((0.0, 0.0, 0.0), curvatures, lengths, [*s, *ends, *(mass.at for mass in masses)])
        height, turns = both[:, 1], both[s.size : s.size + ends.size, 2]
        own = sum(EI * n * (a * a + a * b + b * b) / 6.0 for (a, b), n in zip(curvatures, lengths, strict=True))
        own += 9.81 * (0.03 * weights @ height[: s.size] + height[-2:] @ [0.004, 0.003])
        own -= OFFSET * (tensions[0] - tensions[1]) * turns[-1]
        return own + (states @ [moment for _, moment in TWO]) @ np.diff(turns), both[:, 2]

    arrays = cases.finger_arrays(scene, "finger", q, lengths, tensions=tensions)
    (bent,) = RecomputedGrasp(scene, {**arrays, **UNTOUCHED, "finger.friction_states": states.ravel()}).fingers
    for k, found in enumerate(bent.virtual_work()):
        step = 1e-4 * np.eye(len(q))[k]
        (more, after), (less, before) = energy(q + step), energy(q - step)
        greatest = np.abs(after - before).max()
        assert found == pytest.approx((more - less) / greatest, rel=1e-7, abs=1e-9)


# -- grasps -----------------------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_a_grasp_holds_whatever_the_friction_moments_and_names_the_worst():
    found = held()
    assert found.status is GraspStatus.OPTIMAL
    assert found.certificate.passed
    assert found.certificate.states >= 2
    robust, nominal = found.robustness.robust, found.robustness.nominal
    assert (robust.held, robust.margins.size) == (100, 100)
    assert nominal.held < 100
    assert robust.tension > nominal.tension
    # Pulled and released would not do: the worst is a state between them.
    pulled, released, *further = nominal.corner_margins
    assert min(further) < min(pulled, released)
    assert "friction states in bending" in robust.worst
    for name, value in residuals(found.scene, found.arrays).items():
        assert value < LIMITS[name], name
    # Friction of more moment takes more tension, or there is no grasp.
    assert found.arrays["held.finger.friction_states"].shape[1] == 4 * 2 * 2


@pytest.mark.deep
def test_no_vertex_of_all_states_is_worse_than_what_the_search_found():
    """Of a grasp whose pulled and released states lead to a vertex that is not the worst."""
    found = optimize_grasp(mug(((0.02, 0.005),)))
    own = {key: value for key, value in found.arrays.items() if not key.startswith("held.")}
    responder = Responder(found.scene, own, Budget.of(found.scene.solver))
    every = [responder.to(np.concatenate([np.zeros(OBJECT), z])) for z in product((-1.0, 1.0), repeat=8)]
    assert all(response.holds for response in every)
    assert found.robustness.robust.held == 100


@pytest.mark.deep
def test_what_is_stored_of_friction_states_is_verified():
    arrays = dict(held().arrays)
    for key, change in (
        ("held.finger.friction_states", 0.99),
        ("held.finger.q", 1.001),
        ("held.finger.tensions", 1.01),
    ):
        assert not certify(held().scene, {**arrays, key: change * arrays[key]}).passed
    twice = {**arrays, "held.finger.friction_states": 1.01 * arrays["held.finger.friction_states"]}
    assert "friction states within their range" in [check.name for check in certify(held().scene, twice).failed]


def simulated(scene, arrays):
    """Model of the grasp's finger under its contact forces, as a simulation has it, and these forces."""
    setup = scene.setups[0]
    finger, loads, values = setup.finger, [], []
    turn = finger.base.angle
    for k, name in enumerate(arrays["contact_names"]):
        if str(name).startswith("finger."):
            normal, (n, f, _) = arrays["contact_normals"][k], arrays["contact_forces"][k]
            at = min(float(arrays["contact_stations"][k]), finger.rod.length)
            loads += [ForceLoad(at=at, force=(0.0, 0.0)), MomentLoad(at=at, moment=0.0, input=True)]
            values.append((n * normal + f * np.array([-normal[1], normal[0]]), -finger.thickness_radius * f))
    shared = {key: getattr(finger, key) for key in ("rod", "masses", "tendons", "damping", "base", "rest_curvature")}
    model = FingerModel(
        Finger(**shared), loads=tuple(loads), family=setup.family, elements=tuple(arrays["finger.lengths"].tolist()),
        gravity=(0.0, 0.0), tip_force=False, bending_range=setup.bending_range, input_rates=False,
    )  # fmt: skip
    assert turn == model.finger.base.angle
    u = np.concatenate([arrays["finger.tensions"], [couple for _, couple in values]])
    return model, u, np.concatenate([force for force, _ in values])


@pytest.mark.deep
def test_histories_of_a_simulation_end_where_the_grasp_says():
    """Random ways of the tensions: what friction they leave is among the states for which the grasp holds."""
    found = held()
    scene = found.scene
    responder = Responder(scene, found.arrays, Budget.of(scene.solver))
    rng = np.random.default_rng(4)
    seen = []
    for _ in range(6):
        arrays = found.arrays
        shares = [*rng.uniform(0.6, 1.4, 3), 1.0]
        for _ in range(2):
            model, u, w = simulated(scene, arrays)
            sliding, q, states = np.zeros(16), np.zeros(model.n), np.zeros(16)
            # The last step is that to the tensions of the grasp, under the forces that it has there.
            for share in [0.3, 0.6, *shares]:
                # A stop follows the curvature from where it was.
                under = LoadState(share * u, share * w, np.array(model.p_nominal))
                at = EquilibriumSearch(model, under, np.append(states - sliding, 1.0)).find(q, True, 1)
                states, sliding, q = at.friction_states, bent(model, at.q, u), at.q
            response = responder.to(np.concatenate([np.zeros(OBJECT), states]))
            arrays = {**found.arrays, **response.arrays}
        assert response.holds
        seen.append(states)
        model, u, w = simulated(scene, arrays)
        at = equilibrium_under(model, u, w, guess=q, reached_by="state", friction_states=states)
        line = arrays["finger.backbone"]
        tip = np.array(model.tip(at.q, u, [])).ravel()
        assert np.linalg.norm(tip - line[-1, 1:3]) < 1e-6 * L
    assert np.ptp(seen, axis=0).max() > 0.5


def bent(model, q, u):
    """Curvatures per those at which branches slide."""
    return np.array(model.sliding()(q, u, [])).ravel()


@pytest.mark.deep
def test_errors_of_the_object_and_friction_states_together():
    errors = {"position": 0.0005, "friction": 0.05, "draws": 20}
    found = optimize_grasp(mug(((0.02, 0.004),), robust=errors, **{"fidelity.elements": 2}))
    robust = found.robustness.robust
    assert (robust.held, found.certificate.passed) == (20, True)
    assert "mm" in robust.worst
    assert "friction states in bending" in robust.worst
    responder = Responder(found.scene, found.arrays, Budget.of(found.scene.solver))
    own = {key: value for key, value in found.arrays.items() if not key.startswith("held.")}
    for error in found.robustness.errors[:6]:
        response = responder.to(error)
        assert response.holds
        off = residuals(response.scene, {**own, **response.arrays})
        assert max(off["equilibrium"], off["contact"]) < 1e-6
