"""Plans of graded rods."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.planning import plan
from continuum_grasp.scene.load import load
from continuum_grasp.scene.plan import PlanScene

SPIROB = Path(__file__).parents[2] / "configs/mpc/spirob.yaml"


@pytest.mark.deep
def test_the_last_tensions_of_a_taper_hold_it_where_they_bend_it():
    """At rest and without weight the angle along the finger is int T e / EI ds, by a quadrature of its own here."""
    goal = {"end": "held", "tip": {"value": (-0.0371, 0.2389), "weight": 1e6}}
    found = plan(
        PlanScene(
            finger=load(SPIROB).finger,
            gravity=(0.0, 0.0),
            fidelity={"family": "matched_clothoid", "elements": 3, "bending_range": 6.0},
            goal=goal,
            duration=0.6,
            intervals=20,
        )
    )
    net = float(found.u[-1] @ [1.0, -1.0])
    s = np.linspace(0.0, 0.25, 20001)
    share = 1.0 - 0.875 * s / 0.25  # thickness, and the tendon's distance, per that at the base
    stiffness = 12e6 * 0.04 * (0.3 * 0.04) ** 3 / 12.0
    cosine = 1.0 / np.hypot(1.0, 0.014 / 0.25)
    curvature = net * cosine * 0.016 / stiffness * share**-3
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    tip = [-np.trapezoid(np.sin(angle), s), np.trapezoid(np.cos(angle), s)]
    assert found.tip[-1] == pytest.approx(tip, abs=2e-5)
    assert net == pytest.approx(0.7, abs=2e-3)
