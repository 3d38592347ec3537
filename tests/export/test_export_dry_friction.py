"""Packages of fingers with dry friction in bending: steps that its states allow."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.errors import InputError
from continuum_grasp.export import export_c
from continuum_grasp.scene import Scene

SCENE = {
    "finger": {
        "rod": {"length": 0.3, "linear_density": 0.2, "bending_stiffness": 0.15},
        "damping": {"material": 0.003, "dry_friction": [{"stiffness": 0.2, "moment": 0.3}]},
        "tip_body": {"mass": 0.2, "rotary_inertia": 1e-4},
        "base": {"angle": np.pi},
    },
    "gravity": (0.0, -9.81),
    "fidelity": {"family": "arc", "elements": 2},
    "initial": {"pose": "rest", "reached_by": "pulling"},
}


def test_steps_that_the_return_of_its_states_does_not_allow_are_refused(tmp_path):
    """Runge-Kutta steps beyond 2.79 ms diverge at the rate of 1000 1/s at which a state returns to its range."""
    export_c(Scene.model_validate(SCENE), tmp_path / "short", step=0.002, substeps=1)
    with pytest.raises(InputError, match="too long"):
        export_c(Scene.model_validate(SCENE), tmp_path / "long", step=0.004, substeps=1)
