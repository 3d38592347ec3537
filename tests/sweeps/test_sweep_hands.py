"""Sweeps of hands: the same table, resumed, as of planar grasps; rows agree with single grasps."""

from __future__ import annotations

import csv
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp import sweep
from continuum_grasp.addons.sweeps import SweepPlan
from continuum_grasp.base import InputError
from continuum_grasp.grasp import GraspStatus, HandResult, Reason
from continuum_grasp.results import read_run
from tests import hand_cases as cases
from tests.sweep_cases import ROOT

BALL, KNOB = ROOT / "configs/hand/ball.yaml", ROOT / "configs/hand/knob.yaml"
HEAVY = 0.2


def held(scene):
    """A box between straight fingers that press as hard as the object is heavy; none where it is too heavy."""
    mass = scene.object.mass
    if mass == HEAVY:
        reason = Reason("mass", "object.mass", "kg", mass, 0.1, "too heavy", "object.mass = 0.1 kg")
        return HandResult(scene, GraspStatus.INFEASIBLE, "too heavy", reasons=(reason,))
    own, arrays = cases.squeezed_box(9.81 * mass, mass)
    return HandResult(own, GraspStatus.FEASIBLE, "held", arrays, statistics={"iterations": 3})


def masses(*values):
    return {"scene": str(BALL), "vary": {"object.mass": {"values": list(values)}}}


def test_a_table_of_hands_has_forces_margins_and_reasons(tmp_path):
    """Normal forces m g, weight m g / 2 per contact: margin 1 - 1 / (2 mu), mu = 0.5."""
    with ThreadPoolExecutor(1) as executor:
        table = sweep(masses(0.05, 0.1, HEAVY), folder=tmp_path, executor=executor, evaluate=held)
    assert list(table["status"]) == ["feasible", "feasible", "infeasible"]
    np.testing.assert_allclose(table["normal_force_max"][:2], 9.81 * np.array([0.05, 0.1]), rtol=1e-9)
    np.testing.assert_allclose(table["friction_margin"][:2], 0.0, atol=1e-9)
    np.testing.assert_array_equal(table["contacts"][:2], 2)
    np.testing.assert_array_equal(table["tension_sum"][:2], 0.0)
    assert table["reason_needed"][2] == 0.1
    assert np.isnan(table["tension_max"][2])
    assert table.units["object.mass"] == "kg"
    rows = list(csv.DictReader((tmp_path / "table.csv").open(encoding="utf-8")))
    assert [row["status"] for row in rows] == list(table["status"])
    assert read_run(table.run_folder(0)).meta["config"]["hand"]


def test_keys_that_only_hands_have_take_units():
    ways = {"hand.ring.radius": {"values": ["44 mm", "45 mm"]}, "object.rotation[2]": {"min": "0 deg", "max": "90 deg"}}
    ways["object.rotation[2]"]["count"] = 2
    plan = SweepPlan.of({"scene": str(KNOB), "vary": ways})
    values = [point.values for point in plan]
    assert [value[0] for value in values] == pytest.approx([0.044, 0.044, 0.045, 0.045])
    assert [value[1] for value in values] == pytest.approx([0.0, np.pi / 2] * 2)


def test_a_key_that_hands_do_not_have_is_named():
    with pytest.raises(InputError, match="finger"):
        SweepPlan.of({"scene": str(BALL), "vary": {"finger.base.angle": {"values": [0.1]}}})


@pytest.mark.deep
def test_rows_are_those_of_single_grasps_and_a_sweep_resumes(tmp_path):
    config = {**masses(0.06, 0.08), "maps": [{"x": "object.mass", "y": "object.mass", "color": "tension_sum"}]}
    table = sweep(config, folder=tmp_path, workers=1)
    for mass, tension in zip(table["object.mass"], table["tension_sum"], strict=True):
        single = cg.optimize_grasp(cg.load(BALL).changed({"object.mass": float(mass)}))
        assert tension == pytest.approx(single.tension, rel=1e-6)
    again = sweep(config, folder=tmp_path, workers=1)
    assert again.statistics["new"] == 0
    assert [picture.name for picture in again.drawable()] == ["map_1_tension_sum"]
