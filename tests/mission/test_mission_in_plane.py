"""Missions with gravity in the plane: table, height, and what the certificate says of the weight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.errors import InputError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.mission.assignment import assign
from continuum_grasp.mission.certified import object_height
from continuum_grasp.mission.plant import mission_plant_model
from continuum_grasp.mission.precheck import check_mission
from continuum_grasp.mission.run import MissionRunner
from continuum_grasp.model import System
from continuum_grasp.scene.load import load
from continuum_grasp.scene.objects import Circle
from continuum_grasp.scene.surroundings import ContactLaw, Surroundings, Table

CUP = Path(__file__).parents[2] / "configs/mission/cup_lying.yaml"
QUICK = ("plant.fidelity={family: clothoid, elements: 3}",)


@pytest.fixture(scope="module")
def grasp():
    return optimize_grasp(load(CUP).grasp)


@pytest.fixture(scope="module")
def assignment(grasp):
    return assign(load(CUP, QUICK), grasp)[0]


def test_a_table_in_the_plane_presses_along_its_normal_and_moves_along_it(assignment):
    """A disc 2 mm deep in a slope of 30 degrees: k d along the normal; the table lower by 5 mm: nothing."""
    angle, radius, law = np.radians(60.0), 0.03, ContactLaw(stiffness=900.0, friction=0.0, rounding=1e-6)
    normal = np.array([np.cos(angle), np.sin(angle)])
    disc = Circle(shape="circle", diameter=2.0 * radius, mass=0.1, position=tuple((radius - 0.002) * normal))
    table = Table(friction=0.0, point=(0.0, 0.0), normal_angle=angle)
    around = Surroundings(object=disc, object_moves=True, contact_law=law, table=table)
    system = System(assignment.control.finger, surroundings=around, family="arc", elements=2, gravity=(0.0, -9.81))
    k, free = system.touch_names.index("table"), np.array(system.state())
    away = np.zeros(system.nw)
    lowered = away.copy()
    lowered[system.w_names.index("table_height [m]")] = -0.005
    u = np.zeros(system.nu)
    for w, depth in ((away, 0.002), (lowered, 0.0)):
        found = dict(zip(system.touch.name_out(), system.touch(free, u, w, []), strict=True))
        assert float(found["normal_force"][k]) == pytest.approx(900.0 * depth, abs=1e-9)
        rates = np.array(system.forward_dynamics(free, u, w, [])).ravel()
        at = system.object_states
        moved = rates[at.stop : at.stop + 2]
        assert moved == pytest.approx(900.0 * depth / 0.1 * normal + [0.0, -9.81], abs=1e-9)


def test_the_object_stands_on_the_table_where_the_grasp_has_it(assignment):
    """Weight, and the table's force on what is pressed in by it, balance at the start."""
    model = mission_plant_model(assignment)
    system = model.system
    w, x = np.zeros(system.nw), model.start[: system.nx]
    touch = dict(zip(system.touch.name_out(), system.touch(x, [1.0, 1.0], w, model.p), strict=True))
    assert float(touch["normal_force"][system.touch_names.index("table")]) == pytest.approx(0.1 * 9.81, rel=1e-6)
    assert x[system.object_states] == pytest.approx(assignment.grasp.object_pose)


def test_height_is_measured_against_gravity(assignment):
    pose = np.array([[0.1, 0.2, 0.0], [0.3, 0.15, 1.0]])
    assert object_height(assignment.mission, pose) == pytest.approx([0.2, 0.15])


def test_weight_in_the_plane_is_compared_with_what_the_grasp_carries(grasp):
    """A weight that is added in the plane is a pull downwards: the same as the certificate resists along it."""
    assert check_mission(load(CUP), grasp=grasp) == ()
    down = grasp.quality.resistance
    (row,) = [k for k, wrench in enumerate(down.wrenches) if tuple(wrench) == (0.0, -1.0, 0.0)]
    carried = 0.11 + down.factors[row] / 9.81
    found = {one.name: one for one in check_mission(load(CUP, ["object_mass=0.4"]), grasp=grasp)}
    assert (found["mass"].given, found["mass"].certified) == (0.4, pytest.approx(0.11))
    rough = {
        one.name: one for one in check_mission(load(CUP, ["object_mass=0.4", "contact_law.friction=0.45"]), grasp=grasp)
    }
    assert rough["mass"].resisted == pytest.approx(carried, rel=1e-6)


def test_gravity_decides_which_table_there_can_be():
    with pytest.raises(InputError, match="point and normal_angle belong together"):
        Table(friction=0.3, normal_angle=1.0)
    disc = Circle(shape="circle", diameter=0.06, mass=0.1, position=(0.0, 0.0))
    law = ContactLaw(stiffness=900.0, friction=0.3)
    wall = Table(friction=0.3, point=(0.0, 0.0), normal_angle=1.5)
    for table, gravity in ((Table(friction=0.3), 0.0), (wall, 9.81)):
        with pytest.raises(InputError, match="table needs out_of_plane_gravity"):
            Surroundings(object=disc, object_moves=True, contact_law=law, table=table, out_of_plane_gravity=gravity)


@pytest.mark.slow
def test_a_cup_is_lifted_in_the_plane_and_put_down(grasp):
    found = MissionRunner(assign(load(CUP), grasp)).run()
    assert found.verdict.succeeded
    assert found.verdict.fallbacks <= 2  # rounding decides whether an iteration fails while the cup is squeezed
    contacts, hold = found.contacts, found.timetable.span("hold")
    during = (found.run.t > hold.start + 0.5) & (found.run.t < hold.end)
    bearing = [k for k, name in enumerate(contacts.names) if name != "table"]
    carried = contacts.force[during][:, 1][:, bearing].sum(axis=1).mean()
    assert carried == pytest.approx(0.1 * 9.81, rel=0.03)
