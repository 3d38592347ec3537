"""from inside: the ranges of a unit's elements are in none of its files."""

from __future__ import annotations

from continuum_grasp.addons.fmu.plant import loop_plant_unit
from tests.export_cases import loop_scene


def test_the_plant_of_a_closed_loop_covers_what_its_controller_covers():
    """A setpoint beyond the ranges that a plant has without it."""
    plant = {"fidelity": {"family": "arc", "elements": 2}}
    loop = loop_scene(8).replaced(plant=plant, duration=0.5)
    turns = loop.replaced(reference={"bending": [2.5, 2.5]})
    plain, wide = (loop_plant_unit(each, "loop").words["model"].system.finger_model for each in (loop, turns))
    assert sum(plain.ranges) < 5.0 < sum(wide.ranges)
