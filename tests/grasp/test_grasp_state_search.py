"""The search for friction states: against all vertices, each with all of the certificate's checks."""

from __future__ import annotations

import pytest

from continuum_grasp.grasp import GraspStatus, certify, optimize_grasp
from continuum_grasp.scene import load
from tests.grasp_scenes import CONFIGS


@pytest.mark.deep
def test_a_search_that_stops_early_is_not_certified(monkeypatch):
    """The certificate asks for what is beside the worst."""
    monkeypatch.setattr("continuum_grasp.grasp.robust.search.descended", lambda *_: iter(()))
    found = optimize_grasp(sticking(), raise_on_failure=False)
    assert found.status is GraspStatus.NOT_SOLVED
    assert "untested neighbors of the worst friction state" in found.message


@pytest.mark.deep
def test_a_grasp_whose_worst_vertex_is_not_stored_fails():
    found = optimize_grasp(sticking())
    fewer = {key: value[:2] if key.startswith("held.") else value for key, value in found.arrays.items()}
    assert certify(found.scene, found.arrays).passed
    missing = certify(found.scene, fewer)["untested neighbors of the worst friction state"]
    assert missing.value > 0.0
    assert not missing.passed


STICKS = {"dry_friction": [{"stiffness": 0.02, "moment": 0.01}]}


WINCH = {"kind": "length", "time_constant": 0.02}


CABLE = {"axial_stiffness": 1e4, "series_stiffness": 3e4, "drive": WINCH, "time_constant": None, "min_tension": 0.0}


def mug(friction=0.0, elements=2, **changes):
    """The mug of the shipped scene, by a finger with four friction states."""
    own = {"finger.tendons.friction": friction, "fidelity.elements": elements, "fidelity.family": "clothoid"}
    return load(CONFIGS / "mug.yaml").changed({**own, "solver.effort": "quick", "contacts.reserve": 0.0, **changes})


def sticking(**changes):
    """The same by a finger whose bending sticks: neither pulled nor released is the worst."""
    return mug(**{"finger.damping": {**STICKS, "friction_cells": 2}, **changes})


def pinched():
    """A box between two fingers whose tendons have friction."""
    friction = {f"fingers.{name}.tendons.friction": 0.1 for name in ("lower", "upper")}
    fidelity = {"fidelity.elements": 2, "fidelity.family": "clothoid", "stability": "ignore"}
    return load(CONFIGS / "pinch_above.yaml").changed({**friction, **fidelity})


def wound():
    return mug(0.08, **{f"finger.tendons.{key}": value for key, value in CABLE.items()})
