"""The plants of the robustness benchmark differ as they say, and runs are judged by what they did."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.bench_robustness import NEAR, SWINGS, Outcome
from benchmarks.wrong_plants import FAULT, Bench, Wrong, wrongs
from continuum_grasp.scene import PointMass
from tests.control_cases import HAND, hand_scene

PERIOD = 0.01
PULL = np.array([12.0, 3.0])


@cache
def bench() -> Bench:
    return Bench(hand_scene(finger=HAND.model_copy(update={"masses": (PointMass(at=0.18, mass=0.002),)})))


def named(name, scene=None):
    return next(wrong for wrong in wrongs(scene or bench().scene) if wrong.name == name)


def measured(wrong, steps, seed=0):
    """Measurements (steps, ny) of a plant that is pulled."""
    plant = bench().plant(wrong, seed)
    found = []
    for _ in range(steps):
        found.append(plant.measure())
        plant.advance(PULL)
    return np.array(found), plant


@cache
def usual():
    return measured(named("as shipped"), 130)


def test_values_are_factors_of_what_the_controller_knows():
    finger = bench().scene.finger
    names = ("bending_stiffness", "material_damping", "tip_mass", "tendon_friction")

    def values(wrong):
        return dict(zip(names, bench().plant(wrong, 0).model.p, strict=True))

    assert values(named("x 0.5"))["bending_stiffness"] == pytest.approx(0.5 * finger.rod.stiffness)
    assert values(named("x 0.1"))["material_damping"] == pytest.approx(0.1 * finger.damping.material)
    assert values(named("0.3"))["tendon_friction"] == 0.3
    mass = sum(m.mass for m in finger.masses)
    assert values(Wrong("", "", {"tip_masses": 1.5}))["tip_mass"] == pytest.approx(1.5 * mass)
    assert values(named("as shipped"))["bending_stiffness"] == pytest.approx(finger.rod.stiffness)


@pytest.mark.deep
def test_wires_and_sensors_fail_as_they_say():
    right, plant = usual()
    names = [name.split(" ")[0] for name in plant.sensors.names]
    at = {name: k for k, name in enumerate(names)}
    tip, tensions = [at["tip_x"], at["tip_y"]], [at["tension_1"], at["tension_2"]]
    for name, columns in (("tip x and y swapped", tip), ("readings of the drives swapped", tensions)):
        wrong, _ = measured(named(name), 20)
        assert np.array_equal(wrong[:, columns], right[:20, columns[::-1]])
        others = [k for k in range(right.shape[1]) if k not in columns]
        assert np.array_equal(wrong[:, others], right[:20, others])
    fails = round(FAULT / PERIOD)
    stuck, _ = measured(named("tip_x, tip_y stuck"), 130)
    assert np.array_equal(stuck[:fails], right[:fails])
    assert np.array_equal(stuck[fails:, tip], np.tile(right[fails, tip], (130 - fails, 1)))
    drifting, _ = measured(named("tip_x drifts"), 130)
    since = PERIOD * np.maximum(np.arange(130) - fails, 0)
    assert drifting[:, tip[0]] - right[:, tip[0]] == pytest.approx(0.055 * 0.18 * since, abs=1e-12)
    assert np.array_equal(drifting[:, tip[1]], right[:, tip[1]])
    away, _ = measured(named("camera away for 50 periods"), 160)
    missing = np.isnan(away[:, tip[0]])
    assert np.flatnonzero(missing).tolist() == list(range(fails, fails + 50))


GOOD = Outcome("loop", Wrong("group", "name"), 0, 1e-3, 1e-3, 0.18, 0.02, 0.03, math.nan, math.nan, "", False)
FAR = 1e-3 + 1.01 * NEAR * 0.18


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "near"),
        ({"reported": 0.3}, "near, reported"),
        ({"error": FAR}, "SILENT"),
        ({"swing": 1.01 * SWINGS}, "SILENT"),
        ({"lost": True}, "SILENT"),
        ({"error": FAR, "reported": 0.3}, "far, reported"),
        ({"swing": 1.01 * SWINGS, "reported": 0.3}, "swings, reported"),
        ({"error": FAR, "reported": 0.3, "tripped": 1.0}, "safe state"),
        ({"lost": True, "reported": 0.3, "tripped": 1.0}, "swings, reported"),
    ],
)
def test_verdicts(changes, verdict):
    assert replace(GOOD, **changes).verdict == verdict
