"""Missions with gravity in the plane; from inside: how far pulls lower the object, and records made by hand.

Missions with gravity in the plane: table, height, and what the certificate says of the weight.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.addons.mission import PlantVariation
from continuum_grasp.addons.mission.budget import lowered_by_pulls
from continuum_grasp.addons.mission.causes import find_drop
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.plant import Timetable
from continuum_grasp.addons.mission.precheck import exceeded
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.addons.mission.run import MissionRunner
from continuum_grasp.base import InputError
from continuum_grasp.core import Core
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene import Circle, ContactLaw, Surroundings, Table, load
from continuum_grasp.simulation import equilibrium_under
from tests.mission_cases import COARSE, CUP, PINCH, pressed


@pytest.fixture(scope="module")
def grasp():
    return optimize_grasp(load(CUP).grasp)


@pytest.fixture(scope="module")
def assignment(grasp):
    return assign(load(CUP, [COARSE]), grasp)[0]


@pytest.mark.deep
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


@pytest.mark.deep
def test_weight_in_the_plane_is_compared_with_what_the_grasp_carries(grasp):
    """A weight that is added in the plane is a pull downwards: the same as the certificate resists along it."""
    assert exceeded(assign(load(CUP), grasp), PlantVariation()) == ()
    down = grasp.quality.resistance
    (row,) = [k for k, wrench in enumerate(down.wrenches) if tuple(wrench) == (0.0, -1.0, 0.0)]
    carried = 0.11 + down.factors[row] / 9.81
    found = {one.name: one for one in exceeded(assign(load(CUP, ["object_mass=0.4"]), grasp), PlantVariation())}
    assert (found["mass"].given, found["mass"].certified) == (0.4, pytest.approx(0.11))
    rough = {
        one.name: one
        for one in exceeded(
            assign(load(CUP, ["object_mass=0.4", "contact_law.friction=0.45"]), grasp), PlantVariation()
        )
    }
    assert rough["mass"].resisted == pytest.approx(carried, rel=1e-6)


def test_gravity_decides_which_table_there_can_be():
    with pytest.raises(InputError, match="point and normal_angle belong together"):
        Table(friction=0.3, normal_angle=1.0)
    disc = Circle(shape="circle", diameter=0.06, mass=0.1, position=(0.0, 0.0))
    law = ContactLaw(stiffness=900.0, friction=0.3)
    wall = Table(friction=0.3, point=(0.0, 0.0), normal_angle=1.5)
    for table, gravity in ((Table(friction=0.3), 0.0), (wall, 9.81)):
        with pytest.raises(InputError, match="out_of_plane_gravity"):
            Surroundings(object=disc, object_moves=True, contact_law=law, table=table, out_of_plane_gravity=gravity)


# -- two fingers, one below the other ---------------------------------------------------------------------------------

DOWN = "grasp.gravity=[0.0, -9.81, 0.0]"
WINCHES = (
    "tendons={offset: 0.005, max_tension: 120.0, axial_stiffness: 10e3, series_stiffness: 33 N/mm, "
    "drive: {kind: length, arrangement: one_pulley, time_constant: 20 ms, rate_max: 0.2 m/s, pretension: 2 N}}",
    "controller.input={lengths: [-0.025, 0.025], rate_max: 0.05}",
    "controller.effort=1e7",
    "controller.input_rate=300",
    "estimator.measured.length=5e-5",
)
"""Winches that keep their position in place of drives that keep their tension."""


@pytest.fixture(scope="module")
def stacked():
    return optimize_grasp(load(PINCH, [DOWN]).grasp)


def tip_stiffness(one, grasp):
    """Force along y per shift of a fingertip [N/m] with the tensions of a grasp, by equilibria of a fine model."""
    contact = grasp.contact(f"{one.name}.tip")
    across = np.array([-contact.normal[1], contact.normal[0]])
    force = contact.normal_force * np.array(contact.normal) + contact.friction_force * across
    finger = one.control.finger.with_tendons(time_constant=None)
    model = FingerModel(finger, gravity=(0.0, -9.81), family="clothoid", elements=8)
    core, u, step = Core(model, compiled=False), np.array(grasp.fingers[one.name].tensions), 0.02

    def tip(push):
        w = np.zeros(model.nw)
        w[[model.w_names.index(f"tip_{axis} [N]") for axis in "xy"]] = np.add(force, [0.0, push])
        return np.ravel(core.batch("tip", equilibrium_under(model, u, w).q[None], u))[1]

    return 2.0 * step / (tip(step) - tip(-step))


def lowered(fingers, pulls, pad, mass=1.0):
    """How far pulls lower an object of a multiple of its certified mass on pads: there, and as certified."""
    own, certified = fingers[0].mission, fingers[0].grasp.scene.object.mass
    mission = own.replaced(contact_law=own.contact_law.replaced(stiffness=pad), object_mass=certified)
    first = replace(fingers[0], pulls=np.array(pulls), mission=mission)
    found = lowered_by_pulls([first, *fingers[1:]], PlantVariation(mass=mass))
    return np.array([(one.distance, one.certified) for one in found]).T


@pytest.mark.deep
def test_how_far_a_pull_lowers_an_object_between_two_fingertips(stacked):
    """As two springs at the tensions of the grasp, each in series with its pad."""
    fingers = assign(load(PINCH, [DOWN, COARSE]), stacked)
    stiff = [tip_stiffness(one, stacked) for one in fingers]
    pulls = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]
    for pad in (2000.0, 1e9):
        down, up = lowered(fingers, pulls, pad)[0]
        assert down == pytest.approx(1.0 / sum(1.0 / (1.0 / k + 1.0 / pad) for k in stiff), rel=0.01)
        assert up == pytest.approx(-down, rel=1e-9)
    # A heavier object is lowered as by a pull.
    heavier = lowered(fingers, np.zeros((1, 3)), 2000.0, 1.0 + 1.0 / 9.81 / stacked.scene.object.mass)[0]
    assert heavier == pytest.approx(lowered(fingers, pulls[:1], 2000.0)[0])


@pytest.mark.deep
def test_winches_hold_as_firmly_as_their_cables(stacked):
    """Next to rigid cables hold as the certificate has it; the spring of both, 2 k of one pulley, is in between."""
    pull, given = [[0.0, -1.0, 0.0]], []
    for series in ("1e12", "33e3", "1e-3"):
        change = WINCHES[0].replace("33 N/mm", series).replace("10e3", "1e12")
        wound = assign(load(PINCH, [DOWN, COARSE, change, *WINCHES[1:]]), stacked)
        given.append(float(lowered(wound, pull, 1e9)[0][0]))
        assert all(one.control.finger.drives_keep_position for one in wound)
    pulled = assign(load(PINCH, [DOWN, COARSE]), stacked)
    assert not any(one.control.finger.drives_keep_position for one in pulled)
    away, certified = (float(value[0]) for value in lowered(pulled, pull, 1e9))
    assert given[0] == pytest.approx(certified, rel=1e-3)
    assert given[2] == pytest.approx(away, rel=1e-3)
    assert certified < 0.5 * given[1] + 0.5 * certified < given[1] < away


@pytest.mark.deep
def test_a_pull_that_lowers_the_object_too_far_is_said_before_the_run_and_after_it(stacked):
    (warned,) = exceeded(assign(load(PINCH, [DOWN]), stacked), PlantVariation())
    assert (warned.name, warned.key, warned.resisted) == ("sinking", "pull_share", 0.005)
    assert warned.given > 0.005 > warned.certified
    assert f"pull 4 lowers it by {1e3 * warned.given:.3g} mm at least" in warned.text
    assert f"the certificate has {1e3 * warned.certified:.3g} mm" in warned.text
    assert exceeded(assign(load(PINCH, [DOWN, "pull_share=0.3"]), stacked), PlantVariation()) == ()
    assert exceeded(assign(load(PINCH, [DOWN, *WINCHES]), stacked), PlantVariation()) == ()
    fingers = assign(load(PINCH, [DOWN, COARSE]), stacked)
    table = Timetable(fingers[0])
    t, span = np.arange(0.0, table.duration, 0.01), table.span("pull 4")
    one = np.ones((len(t), 2))
    held = pressed(("lower.tip", "upper.tip"), 4.0 * one, one)
    sunk = 0.006 * ((t > span.start + 0.2) & (t < span.end))
    record = MissionRecord(fingers, table, PlantVariation(), (SimpleNamespace(t=t),), held)
    drop = find_drop(record, sunk)
    assert drop.slips == ()
    assert drop.lowered.distance == pytest.approx(warned.given)
    assert drop.text.endswith(f"with all contacts in their cones; {drop.lowered.text}")
    # What falls while nothing pulls has no such number.
    assert find_drop(record, 0.006 * (t > table.span("hold").start)).lowered is None


@pytest.mark.deep
def test_what_pulls_lower_is_no_slip(grasp):
    """Where slip is watched; it was, and the cup was set down."""
    fingers = assign(load(CUP, ["slip={height: 0.1 mm}"]), grasp)
    lowered = [one.distance for one in lowered_by_pulls(fingers, PlantVariation())]
    assert fingers[0].gives == max(lowered) > 3e-4


@pytest.mark.deep
@pytest.mark.xfail(reason="the tip of the rods' grasp lies elsewhere in the loop: the cup is not lifted", strict=False)
def test_a_cup_is_lifted_in_the_plane_and_put_down(grasp):
    found = MissionRunner(assign(load(CUP), grasp)).run()
    assert found.verdict.succeeded
    assert found.verdict.fallbacks <= 2  # rounding decides whether an iteration fails while the cup is squeezed
    contacts, hold = found.contacts, found.timetable.span("hold")
    during = (found.run.t > hold.start + 0.5) & (found.run.t < hold.end)
    bearing = [k for k, name in enumerate(contacts.names) if name != "table"]
    carried = contacts.force[during][:, 1][:, bearing].sum(axis=1).mean()
    assert carried == pytest.approx(0.1 * 9.81, rel=0.03)
