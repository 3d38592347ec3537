"""Constants with units: each is there for a reason that is written here, and a new one needs another."""

from __future__ import annotations

from tests.similarity.constants import constants

TIMES = "still chosen on a hand of 180 mm: to become a share of the finger's natural time"
LEFT = {
    ("model/surfaces/offset_polygon.py", "SHARP"): "radius of an edge without one",
    ("model/surfaces/offset_polygon.py", "_SKIN"): "rounding of positions",
    ("simulation/statics.py", "1e12"): "beyond all numbers of a scene",
    ("control/c/contact_detector.h", "CONTACT_MOST"): "beyond all forces",
    ("control/estimation/contact_detector.py", "_MOST"): "the same",
    ("closed_loop/chain_system.py", "1e-9"): "no tension",
    ("control/c/ekf.h", "EKF_MEMORY"): TIMES,
    ("control/estimation/excitation.py", "_MEMORY"): TIMES,
    ("control/ocp/scene_problem.py", "_IMPLICIT_STEP"): TIMES,
    ("control/ocp/scene_problem.py", "_APPROACH"): "speed of shipped missions: to become one of the reference",
    ("control/ocp/setpoints.py", "_STOOD"): TIMES,
    ("control/parts.py", "_RAMP"): TIMES,
    ("control/parts.py", "_WINDOW"): TIMES,
    ("control/parts.py", "_CROSSING"): TIMES,
    ("control/prediction.py", "PRESSED"): "force of shipped missions: to become one of the grasp",
    ("closed_loop/hardware.py", "0.5"): TIMES,
}


def test_constants_with_units_have_a_reason():
    assert {(file, name) for file, name, _ in constants()} == LEFT.keys()
