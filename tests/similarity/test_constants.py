"""Constants with units: each is there for a reason that is written here, and a new one needs another."""

from __future__ import annotations

from tests.similarity.constants import constants

LEFT = {
    ("model/surfaces/polygon_outline.py", "SHARP"): "radius of an edge without one",
    ("model/surfaces/offset_polygon.py", "_SKIN"): "rounding of positions",
    ("simulation/accuracy/space.py", "_LONG"): "patience of a user, which changes no result",
    ("simulation/accuracy/motion.py", "1.0"): "motions of users, whose durations are theirs",
    ("simulation/stepping.py", "_BESIDE"): "rounding of instants",
    ("simulation/replay.py", "_AFTER"): "rounding of instants",
    ("grasp/rods/answers.py", "STEADY"): "how users move their hands",
}


def test_constants_with_units_have_a_reason():
    assert {(file, name) for file, name, _ in constants()} == LEFT.keys()
