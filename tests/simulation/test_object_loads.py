"""An object that is pulled and whose table moves, beside a finger that does not touch it: by closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.scene import load
from continuum_grasp.simulation import simulate
from tests.rods import ROOT

MASS, INERTIA, WEIGHT = 0.3, 2e-4, 9.81  # kg, kg m2, m/s2
STIFFNESS = 5.0e3  # N/m
FAR = {
    "object.position": [1.0, 1.0],
    "supports": {},
    "moment_of_inertia": INERTIA,
    "actuation": None,
    "table.friction": 0.0,
    "time.duration": 0.4,
}
"""The mug of the scene on a smooth table, out of reach."""


def motion(**changes):
    return simulate(load(ROOT / "configs/simulate/close_on_mug.yaml", {**FAR, **changes}))


def test_on_its_table_an_object_stays_and_moves_by_what_pulls_at_it():
    """Newton and Euler: s = F t^2 / 2 m; the weight presses it into the table by m g / k from the start."""
    pulled = motion(object_load={"force": [0.06, -0.03], "moment": 1e-4})
    t, pose = pulled.t, pulled.object_pose
    assert np.abs(pose[:, 3] + MASS * WEIGHT / STIFFNESS).max() < 1e-9
    for column, (start, rate) in enumerate([(1.0, 0.06 / MASS), (1.0, -0.03 / MASS), (0.0, 1e-4 / INERTIA)]):
        assert pose[:, column] == pytest.approx(start + 0.5 * rate * t**2, abs=1e-7)


def test_a_pull_that_grows_is_integrated_twice():
    """F = a t: s = a t^3 / 6 m."""
    grows = {"times": [0.0, 1.0], "values": [[0.0, 0.0], [0.6, 0.0]], "interpolation": "linear"}
    pulled = motion(object_load={"force": grows})
    assert pulled.object_pose[:, 0] - 1.0 == pytest.approx(0.6 * pulled.t**3 / (6.0 * MASS), abs=1e-6)


def test_an_object_follows_a_table_that_sinks_and_falls_from_one_that_is_taken_away():
    sunk = MASS * WEIGHT / STIFFNESS
    slow = motion(table_height={"times": [0.05, 0.35], "values": [0.0, -0.01]}, **{"time.duration": 0.5})
    assert slow.object_pose[-1, 3] == pytest.approx(-0.01 - sunk, abs=2e-6)
    # It is not pulled down faster than it falls.
    gone = motion(table_height={"times": [0.0, 1e-6], "values": [0.0, -1.0], "interpolation": "hold"})
    assert gone.object_pose[:, 3] == pytest.approx(-sunk - 0.5 * WEIGHT * gone.t**2, abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"object_moves": False, "out_of_plane_gravity": 0.0, "table": None, "moment_of_inertia": None}, "object_load"),
        ({"table": None}, "table_height"),
        ({"table.stays": True}, "table_height"),
    ],
)
def test_what_has_no_object_or_table_to_move_is_refused(changes, key):
    with pytest.raises(InputError) as refused:
        motion(**{key: {"moment": 1e-4} if key == "object_load" else -0.01, **changes})
    assert refused.value.key == key


def test_a_given_plant_has_them_too():
    scene = load(ROOT / "configs/simulate/close_on_mug.yaml", {**FAR, "table_height": -0.02})
    scene = scene.replaced(
        object_load=load(ROOT / "configs/simulate/close_on_mug.yaml", {"object_load.moment": 1e-4}).object_load
    )
    control = load(ROOT / "configs/mpc/steady_tip.yaml")
    plant = PlantModel(control, scene)
    w = dict(zip(plant.w_names, plant.forces(0.0)[0], strict=True))
    assert (w["table_height [m]"], w["object_moment [N m]"]) == (-0.02, 1e-4)
