"""An object that is pulled and whose table moves, beside a finger that does not touch it: by closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.addons.web import export_web
from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.export import export_c
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


RADIUS, PEG, DEEP = 0.04, 1.0, 1e-3  # m
NO_TABLE = {key: value for key, value in FAR.items() if key != "table.friction"}
SQUEEZED = {
    "out_of_plane_gravity": 0.0,
    "table": None,
    "contact_law": {"stiffness": STIFFNESS, "friction": 0.5},
    "supports": {
        side: {"type": "point", "position": [1.0 + sign * (RADIUS + PEG - DEEP), 1.0], "radius": PEG}
        for side, sign in (("left", -1.0), ("right", 1.0))
    },
    "time.step": 2e-4,
}
"""The mug between two great pegs that press it with 5 N each."""


def squeezed(**changes):
    return simulate(load(ROOT / "configs/simulate/close_on_mug.yaml", {**NO_TABLE, **SQUEEZED, **changes}))


def test_an_object_between_supports_that_shake_swings_as_on_springs():
    """M x" = 2 k (X - x) with X = A (1 - cos w t), from rest."""
    w, size, t = 60.0, 2e-4, np.linspace(0.0, 0.2, 401)
    shift = {"times": t.tolist(), "values": [[x, 0.0] for x in size * (1.0 - np.cos(w * t))]}
    smooth = {"contact_law.friction": 0.0, "contact_law.dissipation": 0.0, "time.duration": 0.2}
    found = squeezed(support_motion={side: {"shift": shift} for side in ("left", "right")}, **smooth)
    own = np.sqrt(2.0 * STIFFNESS / MASS)
    answer = 1.0 / (1.0 - (w / own) ** 2)
    exact = size * (1.0 - answer * np.cos(w * found.t) + (answer - 1.0) * np.cos(own * found.t))
    assert found.object_pose[:, 0] - 1.0 == pytest.approx(exact, abs=0.005 * size)
    assert found.contacts.normal_force.max() > 2.0


@pytest.mark.parametrize(("rate", "accelerates"), [(1.0, True), (0.0, False)])
def test_supports_that_turn_drag_an_object_with_the_friction_of_their_force(rate, accelerates):
    """A = 2 mu k d / m while they slide, the same without a turn: nothing."""
    turns = {
        side: {"turn": {"times": [0.0, 1.0], "values": [0.0, sign * rate], "interpolation": "linear"}}
        for side, sign in (("left", 1.0), ("right", -1.0))
    }
    found = squeezed(support_motion=turns, **{"time.duration": 0.02})
    exact = 0.5 * accelerates * (2.0 * 0.5 * STIFFNESS * DEEP / MASS) * found.t**2
    assert found.object_pose[:, 1] - 1.0 == pytest.approx(exact, abs=0.02 * max(exact.max(), 1e-6))


def test_a_support_that_shifts_slowly_carries_the_object_along():
    """By friction, up and to the side: below the acceleration at which it slips, 17 m/s2."""
    shift = {"times": [0.0, 0.2], "values": [[0.0, 0.0], [0.01, 0.02]]}
    found = squeezed(support_motion={side: {"shift": shift} for side in ("left", "right")}, **{"time.duration": 0.3})
    moved = found.object_pose[-1, :3] - found.object_pose[0, :3]
    assert moved == pytest.approx([0.01, 0.02, 0.0], abs=2e-4)
    drawn = {tuple(np.round(p.center, 6)) for p in found.plot(picture="snapshots").patches if hasattr(p, "radius")}
    starts = [np.array(support["position"]) for support in SQUEEZED["supports"].values()]
    assert drawn == {tuple(np.round(start + np.array([0.01, 0.02]), 6)) for start in starts}


def test_exports_take_motions_of_supports_as_arguments_and_pages_refuse_them(tmp_path):
    shift = {"times": [0.0, 1.0], "values": [[0.0, 0.0], [0.01, 0.0]], "interpolation": "linear"}
    changes = {**NO_TABLE, **SQUEEZED, "support_motion": {"left": {"shift": shift}}}
    scene = load(ROOT / "configs/simulate/close_on_mug.yaml", changes)
    export_c(scene, tmp_path / "package", what=["dynamics"])
    assert "left_shift_x_rate" in (tmp_path / "package/MANIFEST.json").read_text()
    with pytest.raises(InputError, match="support_motion: supports of a page stay"):
        export_web(scene, tmp_path / "page")


@pytest.mark.parametrize(
    ("motion", "text"),
    [
        ({"palm": {}}, "support_motion.palm: expected a support of type: point"),
        ({"left": {"shift": {"times": [0, 1], "values": [[0, 0], [0, 1]], "interpolation": "hold"}}}, "jumps"),
    ],
)
def test_a_support_that_cannot_move_so_is_refused(motion, text):
    with pytest.raises(InputError, match=text):
        squeezed(support_motion=motion)


@pytest.mark.parametrize("name", ["a b", "*/", "\u00e9", "1", "{0}", ""])
def test_supports_have_names_as_in_grasps(name):
    """They become names of states, of contacts and of fields in C."""
    with pytest.raises(InputError, match="is not a valid name: use letters, digits and _"):
        load(ROOT / "configs/simulate/close_on_mug.yaml", {"supports": {name: SQUEEZED["supports"]["left"]}})


@pytest.mark.parametrize("name", ["table", "finger"])
def test_a_support_has_no_name_of_other_contacts(name):
    supports = {"supports": {name: SQUEEZED["supports"]["left"]}}
    with pytest.raises(InputError, match=rf"supports\.{name}: contacts of the {name} have this name: use another"):
        load(ROOT / "configs/simulate/close_on_mug.yaml", supports)
    supports = {"supports": {"table": SQUEEZED["supports"]["left"]}}
    assert "table" in load(ROOT / "configs/simulate/close_on_mug.yaml", {**NO_TABLE, **SQUEEZED, **supports}).supports
