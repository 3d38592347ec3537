"""Stiffness that exact rods give the object, from inside: maps have no door; beside the certificate's own second-order
test, which divides fingers into pieces.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space

import continuum_grasp as cg
from benchmarks.grasp_populations import document
from continuum_grasp.core import Compiler
from continuum_grasp.grasp.certificate import stability as truth
from continuum_grasp.grasp.finger_map import SceneMaps, balance, places_of, settled, stability
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="the map is compiled")


def stiffness_by_pieces(grasp, cells=160):
    """Stiffness of the object by shifts per its size and its turn, where pieces of the fingers give way."""
    chains = [truth._Chain(finger, cells) for finger in grasp.fingers]
    starts = np.cumsum([0, *(chain.nodes.size for chain in chains)])
    hessian, rows = np.zeros((starts[-1] + 3, starts[-1] + 3)), []
    for chain, start in zip(chains, starts, strict=False):
        span = slice(start, start + chain.nodes.size)
        hessian[span, span] = chain.hessian()
    for contact in grasp.contacts:
        if contact.finger is not None:
            k = grasp.fingers.index(contact.finger)
            rows.append(truth._add_contact(hessian, grasp, contact, (chains[k], int(starts[k]))))
    of_fingers, of_object = np.split(np.concatenate(rows), [starts[-1]], axis=1)
    carried = np.vstack([-np.linalg.lstsq(of_fingers, of_object, rcond=None)[0], np.eye(3)])
    free = null_space(of_fingers)
    free = np.vstack([free, np.zeros((3, free.shape[1]))])
    mixed = free.T @ hessian @ carried
    stiffness = carried.T @ hessian @ carried - mixed.T @ np.linalg.solve(free.T @ hessian @ free, mixed)
    scale = np.array([grasp.size, grasp.size, 1.0])
    return stiffness * np.outer(scale, scale)


def drawn(population, k):
    return GraspScene.model_validate(document(population, k, elements=8) | {"stability": "ignore"})


def least_settled(scene):
    """Balance of a scene, and its settled combination with the least tension."""
    (mode, *_) = contact_modes(scene)
    pose, bases = places_of(scene, mode)[0]
    held = SceneMaps(scene)
    maps = [held.map_of(setup.name, base, pose, mode) for setup, base in zip(scene.setups, bases, strict=True)]
    whole = balance.ObjectBalance(scene, mode, [one.finger for one in maps], pose)
    found = whole.settle(whole.candidates(maps))
    best = whole.refined(found.x[found.holding(scene.object.size)])
    return whole, best, best.holding(scene.object.size)[0]


# Two fingers that hold by their tips, stable and not; one with a middle contact beside a palm.
@pytest.mark.parametrize(("population", "k"), [("two", 1), ("two", 0), ("one", 6)])
def test_rods_give_the_object_the_stiffness_of_the_grasp(population, k):
    scene = drawn(population, k)
    whole, best, row = least_settled(scene)
    x = best.x[row : row + 1]
    spans = zip(whole.fingers, whole.at[:-1], whole.at[1:], strict=True)
    parts = [stability.finger_stiffness(f, x[:, a:b], whole.center, whole.size)[0] for f, a, b in spans]
    polished = GraspSearch(scene, Budget()).attempt(settled._as_start(whole, best, row), options_at=0)
    expected = stiffness_by_pieces(polished.certificate.grasp)
    assert polished.verified
    # Elements bend a little otherwise than exact rods.
    assert sum(parts) == pytest.approx(expected, abs=0.03 * np.abs(expected).max())
    (least,) = stability.least_eigenvalues(whole, x)
    assert bool(least > 0.0) is polished.certificate.stability.stable


def test_the_stiffness_is_one_of_an_energy():
    """It is symmetric, without being made so."""
    whole, best, row = least_settled(cg.load("configs/grasp/mug.yaml"))
    (finger,) = whole.fingers
    asymmetric = stability.wrench_slopes(finger, best.x[row : row + 1, : finger.numbers], whole.center, whole.size)[0]
    assert asymmetric == pytest.approx(asymmetric.T, abs=2e-3 * np.abs(asymmetric).max())


def test_clearly_unstable_combinations_are_pruned_where_stability_is_required():
    scene = GraspScene.model_validate(document("two", 1, elements=8) | {"stability": "require"})
    whole, best, _ = least_settled(scene)
    rows = best.holding(scene.object.size)
    left = stability.not_unstable(whole, best, rows)
    search = GraspSearch(scene, Budget())
    verdicts = {}
    for row in (left[0], next(row for row in reversed(rows) if row not in left)):
        verdicts[row in left] = search.attempt(settled._as_start(whole, best, row), options_at=0).certificate.stability
    assert verdicts[True].stable
    assert not verdicts[False].stable
    whole.scene = scene.replaced(stability="ignore")
    assert stability.not_unstable(whole, best, rows) == rows
