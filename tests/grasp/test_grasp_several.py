"""Several fingers with middle contacts."""

from __future__ import annotations

import pytest

from continuum_grasp.grasp import Status, optimize_grasp
from continuum_grasp.scene.grasp import GraspScene

pytestmark = pytest.mark.filterwarnings("ignore:tendons.offset")


def finger(base, angle, length, stiffness, half, offset, most, **more):
    """A straight finger that weighs little."""
    return {
        "rod": {"length": length, "linear_density": 0.007, "bending_stiffness": stiffness},
        "half_thickness": half,
        "tendons": {"offset": offset, "max_tension": most},
        "base": {"position": base, "angle": angle},
        **more,
    }


def scene_of(fingers, body, friction, most, **more):
    return GraspScene.model_validate(
        {
            "fingers": fingers,
            "object": body,
            "contacts": {"friction": friction, "normal_force_max": most, "middle": "on", "tip": "on"},
            "gravity": {"mode": "out_of_plane", "magnitude": 9.81, "tilt": "balance"},
            "fidelity": {"family": "matched_clothoid", "elements": 4, "bending_range": 6.283},
            "stability": "ignore",
            **more,
        }
    )


@pytest.mark.deep
def test_fingers_may_wrap_from_either_side():
    """A multi-start of random postures, and of random changes of the best, found 181.2 N, with fingers that pass the
    object on their right; with both on their left the least is 231.7 N.
    """
    more = {"stiffness": 0.02559, "half": 0.007383, "offset": 0.005824, "most": 240.0}
    fingers = {
        "a": finger((-0.07857, 0.08783), -1.52, 0.2398, rest_curvature=-1.546, **more),
        "b": finger((0.07857, -0.08449), 1.597, 0.2398, **more),
    }
    body = {"shape": "ellipse", "width": 0.1332, "height": 0.1295, "position": (0.0, 0.0), "mass": 0.01782}
    result = optimize_grasp(scene_of(fingers, body, 0.5409, 78.72))
    assert result.tension <= 1.005 * 181.2
    assert result.status is Status.FEASIBLE
    assert result.exploration.sampled == 1
