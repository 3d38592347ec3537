"""Grasps of hands as exact rods, from inside: no door lets the search through yet.

Truths are the present search, which shares no equations, the certificate of rods, mirror images, and a planar grasp.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import continuum_grasp as cg
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.nlp import Budget
from tests.grasp.rods.test_spatial_rods import pinch_in_a_plane

CONFIGS = Path(cg.__file__).parents[1] / "configs/hand"
pytestmark = pytest.mark.deep


def hand(name, **changes):
    return cg.load(CONFIGS / f"{name}.yaml").changed(changes)


def found(scene, kind=HandRodSearch):
    search = kind(scene.replaced(stability="ignore"), Budget.of(scene.solver))
    search.run()
    return search.best


@pytest.mark.parametrize(
    ("name", "tension"), [("ball", 17.4573), ("pinch", 13.5480), ("can", 35.6147), ("palm", 23.1013)]
)
def test_shipped_hands_need_what_elements_need(name, tension):
    """The present search with elements and side shifts of first order finds these tensions."""
    grasp = found(hand(name))
    assert grasp.tension == pytest.approx(tension, rel=1e-3)
    assert certify_held(hand(name), held_rods(grasp)).passed


def test_mixed_contacts_hold_a_lying_can_with_less_than_half():
    """The present search stops at 41.45 N; its own solver holds the can with 18.93 N from a mixed start."""
    scene = hand("lying_can")
    grasp = found(scene)
    assert grasp.tension < 18.93
    assert certify_held(scene, held_rods(grasp)).passed


def bases_as(scene, image):
    """The hand with bases one by one, seen through an orthogonal matrix."""
    return {
        name: {
            key: (image @ np.array(getattr(base, key))).tolist() for key in ("position", "direction", "bends_toward")
        }
        for name, base in scene.hand.named_bases.items()
    }


@pytest.mark.parametrize("image", [Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix(), np.diag([-1.0, 1.0, 1.0])])
def test_images_of_a_hand_need_the_same_tension(image):
    """An egg that is as it was, turned and mirrored."""
    scene = hand("pinch")
    turn = image if np.linalg.det(image) > 0.0 else np.eye(3)
    changes = {
        "hand.ring": None,
        "hand.bases": bases_as(scene, image),
        "object.position": (image @ np.array(scene.object.position)).tolist(),
        "object.rotation": Rotation.from_matrix(turn).as_rotvec().tolist(),
        "gravity": (image @ np.array(scene.gravity)).tolist(),
    }
    assert found(scene.changed(changes)).tension == pytest.approx(found(scene).tension, rel=1e-4)


def test_a_hand_whose_planes_coincide_needs_what_a_planar_grasp_needs():
    planar, spatial = pinch_in_a_plane()
    expected = found(planar, RodSearch)
    grasp = found(spatial)
    assert grasp.tension == pytest.approx(expected.tension, rel=1e-4)
