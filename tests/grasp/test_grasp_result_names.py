"""Results of planar grasps and of hands are read by the same names."""

from __future__ import annotations

import math

import pytest

import continuum_grasp as cg

NAMES = (
    *("solved", "status", "message", "fingers", "tensions", "tension", "total_tension", "contacts", "friction_margin"),
    *("greatest_normal_force", "certificate", "reasons", "advice", "contact_names"),
)


@pytest.mark.deep
@pytest.mark.parametrize("name", ["grasp/mug_arcs", "hand/ball"])
def test_both_kinds_have_the_same_names(name):
    """Sums, extremes and margins of their parts: friction per coefficient and normal force."""
    found = cg.optimize_grasp(f"configs/{name}.yaml")
    assert all(hasattr(found, each) for each in NAMES)
    assert found.solved
    assert found.tension == found.total_tension == sum(pair.sum() for pair in found.tensions.values())
    assert found.tension == sum(finger.tensions.sum() for finger in found.fingers.values())
    assert found.greatest_normal_force == max(contact.normal_force for contact in found.contacts)
    assert found.friction_margin == min(contact.friction_margin for contact in found.contacts)
    assert found.friction_margin == pytest.approx(found.certificate.friction_margin, abs=2e-3)


@pytest.mark.deep
def test_no_attempt_passes_for_a_grasp():
    failed = cg.optimize_grasp("configs/grasp/heavy_bottle.yaml", raise_on_failure=False)
    assert math.isnan(failed.tension)
    assert math.isnan(failed.friction_margin)
    assert failed.total_tension > 0.0  # of the first repair
    assert failed.reasons[0].name == "mass"
