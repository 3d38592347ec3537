"""The search for friction states, against all vertices; from inside: the response at every vertex.

The search for friction states: against all vertices, each with all of the certificate's checks.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from continuum_grasp.grasp import GraspStatus, certify, optimize_grasp
from continuum_grasp.grasp.robust.errors import OBJECT
from continuum_grasp.grasp.robust.response import Responder
from continuum_grasp.grasp.robust.search import tried_states
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import load
from tests.grasp_scenes import CONFIGS
from tests.marks import few

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


@pytest.mark.deep
def test_a_search_that_stops_early_is_not_certified(monkeypatch):
    """The certificate asks for what is beside the worst."""
    monkeypatch.setattr("continuum_grasp.grasp.robust.search.descended", lambda *_: iter(()))
    found = optimize_grasp(sticking(), raise_on_failure=False)
    assert found.status is GraspStatus.NOT_SOLVED
    assert "friction states next to the worst that are missing" in found.message


@pytest.mark.deep
def test_a_grasp_whose_worst_vertex_is_not_stored_fails():
    found = optimize_grasp(sticking())
    fewer = {key: value[:2] if key.startswith("held.") else value for key, value in found.arrays.items()}
    assert certify(found.scene, found.arrays).passed
    missing = certify(found.scene, fewer)["friction states next to the worst that are missing"]
    assert missing.value > 0.0
    assert not missing.passed
