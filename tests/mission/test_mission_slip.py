"""What slips while it is held: noticed by its height or by contacts that part, squeezed, and set down."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.addons.mission import PlantVariation
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.control import Sight
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from tests.mission_cases import CERTIFIED, MUG, QUICK, STEP, carried_out, fingers, plan_by_hand, runner_of
from tests.rods import ROOT

BEGINS = 2.4  # s: sinks or parts from then on, in the hold (1.9 s to 2.9 s)


def watched(height, *, slip, force=lambda t: CERTIFIED, names=("finger",), **more):
    """Phases that are given heights and forces by instant: check, timetable, setpoints of each finger, events."""
    of = fingers(*names, slip=slip, **more)
    run = carried_out(of, lambda t: [force(t), *[CERTIFIED] * (len(of) - 1)], height=height)
    return run.check, run.table, run.wanted, run.events


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper")])
def test_what_sinks_is_squeezed_within_50_ms(names):
    """As far as drives have more, by all fingers, until the release; what sank before the lift does not count."""
    slip = {"height": 1e-4}
    check, table, wanted, _ = watched(
        lambda t: 0.3 - 2e-3 * min(max(t - BEGINS, 0.0) / 0.1, 1.0) - 5e-3 * (t < 1.0), slip=slip, names=names
    )
    found = check.slipped
    assert BEGINS < found.time <= BEGINS + 0.05 + 1e-9  # 1 mm at 20 mm/s is lost after 50 ms
    assert (found.noticed, found.firmer, found.down) == ("sinks", pytest.approx(0.2), math.inf)
    assert 5e-4 < found.lost < 1e-3
    for t, forces in wanted.items():
        if found.time + STEP / 2 < t < table.span("release").start:
            assert forces == pytest.approx([1.2 * CERTIFIED] * len(names))
        elif 1.7 < t < found.time - STEP / 2:
            assert forces == pytest.approx([CERTIFIED] * len(names))
    assert [*wanted.values()][-1] == pytest.approx([0.0] * len(names), abs=1e-9)
    assert "squeezed 20 % harder, which held it" in found.text


def test_contacts_are_pressed_no_harder_than_they_may_be():
    check, _, wanted, _ = watched(lambda t: -1e-3 * (t > BEGINS), slip={"height": 1e-4}, most=1.1 * CERTIFIED)
    assert max(forces[0] for forces in wanted.values()) == pytest.approx(1.1 * CERTIFIED)
    assert check.slipped.firmer == pytest.approx(0.1)


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper")])
def test_a_standing_reserve_presses_from_the_lift_on(names):
    """Until the release; what sinks then is set down at once, since there is no more force."""
    check, table, wanted, _ = watched(lambda t: 0.3, slip={"height": 1e-4}, names=names, standing=0.2)
    assert check.slipped is None
    for t, forces in wanted.items():
        if table.span("lift").end < t < table.span("release").start:
            assert forces == pytest.approx([1.2 * CERTIFIED] * len(names))
        elif table.span("squeeze").end < t < table.span("lift").start:
            assert forces == pytest.approx([CERTIFIED] * len(names))
    assert [*wanted.values()][-1] == pytest.approx([0.0] * len(names), abs=1e-9)
    check, *_ = watched(lambda t: -0.02 * max(t - BEGINS, 0.0), slip={"height": 1e-4}, names=names, standing=0.2)
    found = check.slipped
    assert (found.noticed, found.firmer) == ("sinks", 0.0)
    assert BEGINS < found.time == found.down <= BEGINS + 0.05
    assert "set down, since the fingers have no more force" in found.text


@pytest.mark.parametrize("noise", [1e-4, 5e-4])
@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_is_no_slip(noise, seed):
    """White noise of the declared size in 300 readings, with what contacts give way in the lift, half of the noise."""
    rng = np.random.default_rng(seed)
    check, *_ = watched(lambda t: noise * rng.standard_normal() - 0.5 * noise * (t > 1.65), slip={"height": noise})
    assert check.slipped is None


@pytest.mark.parametrize(("lost", "seed"), [(1e-4, 0), (1e-4, 1), (1e-4, 2), (2e-4, 3)])
def test_what_creeps_within_the_noise_is_noticed(lost, seed):
    """As much as the noise is large in a second: long before it would sink by 0.5 mm."""
    rng = np.random.default_rng(seed)
    check, *_ = watched(
        lambda t: 1e-4 * rng.standard_normal() - lost * min(max(t - BEGINS, 0.0), 1.0), slip={"height": 1e-4}
    )
    assert (check.slipped.noticed, check.slipped.down) == ("sinks", math.inf)
    assert BEGINS < check.slipped.time < BEGINS + 1.5


@pytest.mark.parametrize(("glitches", "noticed"), [(1, False), (2, True)])
def test_a_single_height_that_is_far_off_is_no_slip(glitches, noticed):
    check, *_ = watched(lambda t: -0.1 * (BEGINS + 0.005 < t < BEGINS + 0.005 + glitches * STEP), slip={"height": 1e-4})
    assert (check.slipped is not None) == noticed


@pytest.mark.parametrize(("further", "later", "down"), [(2.4e-4, 0.6, True), (1.5e-4, 0.6, False), (1e-3, 0.2, False)])
def test_what_goes_on_creeping_in_a_firm_grip_is_set_down(further, later, down):
    """A fourth of a millimeter once the grip is firm; what it takes to become firm does not count."""
    slip = {"height": 1e-4}
    check, *_ = watched(
        lambda t: -4e-4 * (t > BEGINS + 0.005) - further * min(max(t - BEGINS - later, 0.0) / 0.1, 1.0), slip=slip
    )
    assert check.slipped.time < BEGINS + 0.1
    assert (check.slipped.down < BEGINS + later + 0.4) == down
    assert down or math.isinf(check.slipped.down)


@pytest.mark.parametrize(("lost", "noticed"), [(6e-4, False), (9e-4, True)])
def test_what_fingers_give_way_along_gravity_is_no_slip(lost, noticed):
    """An object that weighs in the plane sinks while it is pulled."""
    slip = {"height": 1e-4}
    check, *_ = watched(lambda t: -lost * (t > BEGINS), slip=slip, gives=6e-4)
    assert (check.slipped is not None) == noticed


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper")])
def test_what_goes_on_sinking_is_set_down(names):
    """From 2.5 mm on that are lost; table and phases follow, and what pulls then pulls on."""
    began = 2.88  # shortly before the first pull, from 2.9 s to 3.3 s
    check, table, _, events = watched(lambda t: -0.02 * max(t - began, 0.0), slip={"height": 1e-6}, names=names)
    found = check.slipped
    late = STEP * (len(names) > 1)
    assert found.time == pytest.approx(began + 0.02, abs=1.1 * STEP)
    assert found.down == pytest.approx(began + 0.135, abs=1.1 * STEP)
    assert "set down at" in found.text
    spans = {span.name: span for span in table.spans}
    assert [span.name for span in table.spans][-4:] == ["pull 1", "lower", "release", "end"]
    assert spans["lower"].start == found.down == spans["pull 1"].end
    assert [name for _, name in events][-3:] == ["lower", "release", "end"]
    lowered = next(t for t, name in events if name == "lower")
    assert lowered == pytest.approx(found.down, abs=1e-9)
    assert table.duration == pytest.approx(found.down + 0.3 + 0.8 + 0.2)
    outside, plan = table.outside(), plan_by_hand("finger").outside()
    down = found.down + np.array([0.0, 0.15, 0.3])
    assert outside["table_height [m]"](down) == pytest.approx([-0.05, -0.025, 0.0])
    t = np.arange(2.0, 6.0, 0.02) + late
    pulled = plan["object_force_x [N]"](t - late)
    assert outside["object_force_x [N]"](t) == pytest.approx(np.where(t < 3.4, pulled, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("low", "calls", "noticed", "down"),
    [
        (0.39, 3, True, False),
        (0.39, 2, False, False),
        (0.41, 99, False, False),
        (0.39, 12, True, False),
        (0.39, 13, True, True),
    ],
)
def test_a_contact_that_parts_is_noticed_by_its_estimate(low, calls, noticed, down):
    """Below a tenth of its certified force three times in a row, and set down where that lasts 0.1 s longer."""
    until = BEGINS + (calls + 0.5) * STEP
    check, *_ = watched(
        lambda t: math.nan, force=lambda t: low if BEGINS + STEP / 2 < t < until else CERTIFIED, slip={}
    )
    assert (check.slipped is not None) == noticed
    assert (noticed and check.slipped.down < math.inf) == down
    if noticed:
        assert (check.slipped.noticed, check.slipped.lost) == ("parts", 0.0)
        assert check.slipped.time == pytest.approx(BEGINS + 3 * STEP)
        assert "a contact parted at 2.43 s" in check.slipped.text


@pytest.mark.parametrize(
    ("seen", "noticed"), [({"sight": Sight.CONTRADICTED, "suspect": "tip"}, True), ({"sight": Sight.BLIND}, False)]
)
def test_sensors_that_contradict_the_model_still_show_that_a_contact_parts(seen, noticed):
    """What parts may well contradict the model; forces of a tripped controller show nothing."""
    in_hold = carried_out(
        fingers("finger", slip={}),
        lambda t: [0.3 if t > BEGINS + STEP / 2 else CERTIFIED],
        seen=lambda t: seen if t > 2.0 else {},
    )
    assert (in_hold.check.slipped is not None) == noticed


def test_without_a_share_no_contact_parts():
    assert (
        watched(lambda t: math.nan, force=lambda t: CERTIFIED - 4.5 * (t > BEGINS), slip={"parted": 0.0})[0].slipped
        is None
    )


def test_friction_falls_as_if_the_plant_had_less():
    """The rates with 30 % less in w are those of a plant whose parameter is 30 % smaller."""
    scene = load(ROOT / "configs/mpc/turn_bar.yaml")
    model = PlantModel(scene, falls=True)
    assert model.w_names[-1] == "friction_fall [1]"
    x, w, p = model.start.copy(), model.forces(0.0)[0], model.p
    at = model.system.object_states
    x[at.stop : at.stop + 2] = (0.05, -0.03)  # it slides on its table, m/s
    friction = model.finger_parameters + model.object_parameters.index("friction_factor")
    less = p.copy()
    less[friction] *= 0.7

    def rates(fall, p):
        given = w.copy()
        given[-1] = fall
        return np.array(model.forward_dynamics(x, model.rest_input, given, p)).ravel()

    assert rates(0.3, p) == pytest.approx(rates(0.0, less), rel=1e-12)
    assert np.abs(rates(0.3, p) - rates(0.0, p)).max() > 0.1


@pytest.fixture(scope="module")
def grasp():
    return optimize_grasp(load(MUG, QUICK).grasp)


@pytest.mark.deep
def test_a_mug_whose_friction_falls_is_squeezed_and_set_down(grasp):
    """By 30 % it creeps while it is pulled, by 60 % it falls: more than friction can carry with the usual forces."""
    own = (), ("slip={height: 0.1 mm}",)
    usual, answering = (runner_of(MUG, [*QUICK, *keys], grasp) for keys in own)
    fallen = PlantVariation(friction_fall=0.6)
    dropped, down = usual.run(fallen), answering.run(fallen)
    assert (dropped.verdict.held, dropped.verdict.slipped) == (False, None)
    assert (down.status, down.outcome, down.verdict.succeeded) == ("set_down", "set down and released", False)
    assert down.verdict.sunk < 0.005 < dropped.verdict.sunk
    # Until something is noticed both are the same, and slip margins follow the friction that is left.
    before = down.t[:-1] < down.verdict.slipped.time - 1e-9
    assert np.array_equal(dropped.runs[0].u[: len(before)][before], down.runs[0].u[before])
    assert np.nanmax(down.friction_use) < 1.0 + 1e-6
    # What falls slides: its contacts use all of the friction that is left.
    assert np.nanmax(dropped.friction_use[dropped.t > dropped.verdict.drop.time]) == pytest.approx(1.0, abs=1e-2)
    held = answering.run(PlantVariation(friction_fall=0.3))
    assert (held.status, held.verdict.succeeded) == ("finished", True)
    height, noticed = held.object_pose[:, 3], held.verdict.slipped
    # Of what is lost since the hold began, contacts give way by some when friction falls.
    lost = height[np.searchsorted(held.t, held.timetable.span("hold").start)] - height
    assert noticed.noticed == "sinks"
    assert 0.0 <= noticed.time - held.t[np.argmax(lost > 6e-5)] < 0.5
    assert "squeezed 22 % harder, which held it" in held.report()
