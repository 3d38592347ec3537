"""Contacts near sharp edges of a mesh are named."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.grasp import GraspStatus, HandResult
from tests import hand_cases as cases

trimesh = pytest.importorskip("trimesh")
HALF = 0.5 * cases.EXTENTS


def warnings_at(mesh, place, tmp_path):
    """Warnings of a grasp of a mesh [mm] whose left finger, of 6 mm radius, touches a place [m]."""
    mesh.export(tmp_path / "part.ply")
    scene, arrays = cases.squeezed_box()
    body = {"shape": "mesh", "file": str(tmp_path / "part.ply"), "scale": 1e-3, "mass": 0.05, "position": (0, 0, 0)}
    arrays["contact_positions"] = np.array([place, (HALF[0], 0.0, 0.0)])
    return HandResult(scene.changed({"object": body}), GraspStatus.FEASIBLE, "", arrays).warnings


@pytest.mark.parametrize(("beside", "named"), [(0.0, "0.00 mm"), (1.4e-3, "1.40 mm"), (1.6e-3, None), (0.02, None)])
def test_an_edge_within_a_quarter_of_the_radius_is_named(beside, named, tmp_path):
    found = warnings_at(trimesh.creation.box(1e3 * cases.EXTENTS), (-HALF[0], HALF[1] - beside, 0.01), tmp_path)
    assert len(found) == (named is not None)
    assert named is None or f"sharp edges of the mesh are near contacts: left.tip ({named});" in found[0]


def test_a_groove_is_no_edge_and_a_ball_has_none(tmp_path):
    # A groove across the face at x < 0, whose bottom is 8 mm deep; its own rims are 10 mm from there.
    corners = [(-20, -25), (20, -25), (20, 25), (-20, 25), (-20, 10), (-12, 0), (-20, -10)]
    count = len(corners)
    caps = [(0, 1, 6), (6, 1, 5), (5, 1, 2), (5, 2, 4), (4, 2, 3)]
    sides = [(k, (k + 1) % count) for k in range(count)]
    walls = [t for k, j in sides for t in ((k, j, j + count), (k, j + count, k + count))]
    faces = [*(c[::-1] for c in caps), *([k + count for k in c] for c in caps), *walls]
    groove = trimesh.Trimesh([(x, y, z) for z in (-30, 30) for x, y in corners], faces, process=False)
    assert groove.is_watertight
    assert groove.volume > 0.0
    groove.apply_translation(-groove.center_mass)
    bottom = 1e-3 * groove.vertices[5] * [1.0, 1.0, 0.0]
    assert not warnings_at(groove, tuple(bottom), tmp_path)
    assert not warnings_at(trimesh.creation.icosphere(3, radius=25.0), (-0.025, 0.0, 0.0), tmp_path)
