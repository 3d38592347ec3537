"""Missions beside their certificate; from inside: what exceeds it before a run, and records made by hand.

Missions beside their certificate: what is said before the run, and why an object was dropped.
"""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.mission import PlantVariation, Trials
from continuum_grasp.addons.mission.budget import certified_contact
from continuum_grasp.addons.mission.causes import find_drop
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.plant import Timetable, reserve
from continuum_grasp.addons.mission.precheck import exceeded, exceeded_by_trials
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.addons.mission.run import variations
from continuum_grasp.base import SolverError
from continuum_grasp.cli import app
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from tests.mission_cases import CERTIFIED, MUG, fingers, planned

GRAVITY = 9.81  # m/s2


@pytest.fixture(scope="module")
def grasp():
    return optimize_grasp(load(MUG).grasp)


def found(grasp, *changes, variation=None):
    return {one.name: one for one in exceeded(assign(load(MUG, changes), grasp), variation or PlantVariation())}


def carried(grasp, friction):
    """Mass that contact forces of a grasp carry by what friction has left beside its part in the plane [kg]."""
    pairs = [(contact.normal_force, contact.friction_force) for contact in grasp.contacts]
    return sum(np.sqrt((friction * normal) ** 2 - across**2) for normal, across in pairs) / GRAVITY


# -- before the run ---------------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_a_mission_within_its_certificate_is_not_warned_of(grasp):
    """Up to the very plant that was certified: 0.33 kg and friction of 0.45, pulled as much as it resists."""
    assert found(grasp) == {}
    assert found(grasp, "object_mass=0.33", "contact_law.friction=0.45") == {}
    assert found(grasp, variation=PlantVariation(mass=1.1, friction=0.9)) == {}
    assert found(grasp, "object_mass=0.33", "contact_law.friction=0.45", "pull_share=1.001") != {}


@pytest.mark.parametrize(("mass", "friction"), [(0.36, 0.5), (0.8, 0.5), (0.3, 0.3), (0.3, 0.2), (0.5, 0.4)])
def test_mass_and_friction_are_compared_with_what_contact_forces_carry(grasp, mass, friction):
    warned = found(grasp, f"object_mass={mass}", f"contact_law.friction={friction}")
    assert ("mass" in warned) == (mass > 0.33)
    assert ("friction" in warned) == (friction < 0.45)
    dropped = mass * GRAVITY > friction * sum(contact.normal_force for contact in grasp.contacts)
    if "mass" in warned:
        one = warned["mass"]
        assert (one.given, one.certified, one.certain) == (mass, pytest.approx(0.33), dropped)
        assert one.resisted == pytest.approx(carried(grasp, friction))
    if "friction" in warned:
        one = warned["friction"]
        assert (one.given, one.certified, one.certain) == (pytest.approx(friction), 0.45, dropped)
        low = max(abs(contact.friction_force) / contact.normal_force for contact in grasp.contacts)
        assert one.resisted == pytest.approx(brentq(lambda mu: carried(grasp, mu) - mass, low * (1.0 + 1e-9), 2.0))
    for one in warned.values():
        for amount in (one.given, one.certified):
            in_millis = one.unit == "N m" and abs(amount) < 0.1
            assert f"{amount * (1e3 if in_millis else 1.0):.3g}" in one.text


def test_pulls_are_compared_with_what_is_resisted_as_certified_and_there(grasp):
    resistance = grasp.quality.resistance
    size = np.hypot(*resistance.wrenches[:, :2].T) + np.abs(resistance.wrenches[:, 2])
    same = ("object_mass=0.33", "contact_law.friction=0.45", "drive_tension=50.0")
    warned = found(grasp, *same, "pull_share=1.5")
    assert set(warned) == {f"pull {k + 1}" for k in range(6) if resistance.factors[k] < 5.0 * 1.5}
    for k in range(6):
        if one := warned.get(f"pull {k + 1}"):
            assert one.given == pytest.approx(1.5 * size[k] * resistance.factors[k])
            assert (one.certified, one.resisted) == (
                pytest.approx(size[k] * resistance.factors[k]),
                pytest.approx(size[k] * resistance.factors[k]),
            )
    rough, slippery = (found(grasp, f"contact_law.friction={mu}", "pull_share=1.2")["pull 1"] for mu in (0.6, 0.3))
    assert slippery.resisted < warned["pull 1"].resisted < rough.resisted
    assert rough.given == slippery.given == pytest.approx(1.2 / 1.5 * warned["pull 1"].given)


def test_a_drive_that_is_too_weak_is_named(grasp):
    warned = found(grasp, "drive_tension=40")
    assert set(warned) == {"tension"}
    assert (warned["tension"].given, warned["tension"].key) == (40.0, "drive_tension")
    assert warned["tension"].certified == pytest.approx(max(grasp.fingers["finger"].tensions))


def test_trials_are_compared_at_their_heavy_and_slippery_end(grasp):
    assert exceeded_by_trials(assign(load(MUG), grasp), variations(Trials(count=3))) == ()
    wide = load(MUG, ["trials={count: 8, mass: 0.3, friction: 0.4}"])
    head, *rest = exceeded_by_trials(assign(wide, grasp), variations(wide.trials))
    beyond = sum(0.3 * v.mass > 0.33 or 0.5 * v.friction < 0.45 for v in variations(wide.trials))
    assert head == f"{beyond} of 8 plants are beyond the certificate"
    assert any("0.39 kg" in text and "0.33 kg" in text for text in rest)
    assert any("0.3 at" in text and "0.45" in text for text in rest)


def test_a_mission_beyond_its_certificate_is_refused_where_it_says_so(grasp, monkeypatch, tmp_path):
    refused = load(MUG, ["object_mass=0.8", "beyond_certificate=refuse"])
    with pytest.raises(SolverError, match=r"0\.8 kg.*0\.33 kg"):
        cg.run_mission(refused, grasp=grasp)
    with pytest.raises(SolverError, match=r"0\.88 kg"):
        cg.run_trials(refused, grasp=grasp)
    monkeypatch.setattr("continuum_grasp.grasp.optimize_grasp", lambda scene: grasp)
    changes = ("--set", "object_mass=0.8", "--set", "beyond_certificate=refuse")
    done = CliRunner().invoke(app, ["mpc", str(MUG), *changes, "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert "0.8 kg" in done.output
    assert "certified for 0.33 kg" in done.output


# -- several contacts along the finger --------------------------------------------------------------------------------


@pytest.mark.deep
def test_all_contacts_of_the_grasp_are_the_controllers_and_can_be_held(grasp):
    """A second middle contact of 1 N at 0.12 m: one more force to hold; the certificate knows its name."""
    arrays, middle = dict(grasp.arrays), grasp.contact("finger.middle")
    (row,) = np.flatnonzero(arrays["contact_names"] == "finger.middle")
    for key in [key for key in arrays if key.startswith("contact_")]:
        arrays[key] = np.concatenate([arrays[key], arrays[key][row : row + 1]])
    arrays["contact_names"] = np.where(np.arange(4) == 3, "finger.station_9", arrays["contact_names"].astype(object))
    arrays["contact_stations"][3], arrays["contact_forces"][3] = 0.12, [1.0, 0.0, 0.0]
    more = replace(grasp, arrays=arrays)
    (both,) = assign(load(MUG, ["controller.held=all"]), more)
    assert both.control.contacts == (middle.station, 0.12)
    tip = grasp.contact("finger.tip").normal_force
    assert both.forces == {"finger.1": middle.normal_force, "finger.2": 1.0, "finger.tip": tip}
    assert both.control.reference.contact_force == tuple(both.forces.values())
    names = tuple(f"contact_force_{name} [N]" for name in both.forces)
    hold = Timetable(both).span("hold").start
    assert planned(Timetable(both), names, [hold])[0] == pytest.approx(list(both.forces.values()))
    assert certified_contact([both], "finger.2").normal_force == 1.0
    assert certified_contact([both], "finger.1").normal_force == middle.normal_force
    (extra,) = assign(load(MUG, ["more_contacts=[0.03]"]), grasp)
    assert certified_contact([extra], "finger.1") is None
    assert certified_contact([extra], "finger.2").normal_force == middle.normal_force
    assert list(assign(load(MUG, ["controller.held=tip"]), more)[0].forces) == ["finger.tip"]


# -- after a drop -----------------------------------------------------------------------------------------------------


def drop_of(grasp, *, normal, shear, fallen=5.0, step=0.01):
    """Why an object fell at an instant; forces of middle contact, tip, palm by functions of time, friction of 0.4."""
    (assignment,) = assign(load(MUG, ["contact_law.friction=0.4"]), grasp)
    table = Timetable(assignment)
    t = np.arange(0.0, table.duration, step)
    forces = [np.stack([f(t) for f in functions] + [0.0 * t], axis=1) for functions in (normal, shear)]
    contacts = SimpleNamespace(
        names=("finger.1", "finger.tip", "palm", "table"), normal_force=forces[0], shear=forces[1]
    )
    record = MissionRecord((assignment,), table, PlantVariation(friction=0.75), (SimpleNamespace(t=t),), contacts)
    return find_drop(record, 0.02 * (t >= fallen - 1e-9))


def steps(*pairs):
    """A function of time that has a value from each instant on."""
    return lambda t: np.array([[v for at, v in pairs if now >= at - 1e-9][-1] for now in t])


def test_the_first_contact_to_give_way_is_named_with_the_certificates_numbers(grasp):
    """Friction of 0.4 times 0.75: the palm slips for good at 4.8 s, after a slip that ended; the tip parts at 4.9 s."""
    normal = (steps((0.0, 5.0)), steps((0.0, 3.0), (4.9, 0.0)), steps((0.0, 4.0)))
    shear = (steps((0.0, 1.0)), steps((0.0, 0.5), (4.9, 0.0)), steps((0.0, 0.8), (3.0, 1.2), (3.1, 0.8), (4.8, 1.2)))
    drop = drop_of(grasp, normal=normal, shear=shear)
    assert [(one.contact, one.how) for one in drop.slips] == [("palm", "slipped"), ("finger.tip", "parted")]
    assert [one.time for one in drop.slips] == pytest.approx([4.8, 4.9])
    assert drop.time == pytest.approx(5.0)
    assert drop.phase == "pull 4"
    first, palm = drop.slips[0], grasp.contact("palm")
    assert (first.friction, first.certified.friction) == (pytest.approx(0.3), 0.45)
    assert (first.normal_force, first.certified.normal_force) == (4.0, palm.normal_force)
    assert first.certified.shear == pytest.approx(np.hypot(palm.friction_force, palm.lift))
    assert "slipped at palm at 4.80 s: friction 0.30, certificate needs 0.45" in drop.text
    assert drop.slips[1].certified.normal_force == grasp.contact("finger.tip").normal_force


def test_a_contact_that_did_not_hold_at_the_lift_is_absent(grasp):
    """The tip let go at 1.5 s, before the lift at 1.6 s; the middle slips later."""
    normal = (steps((0.0, 5.0)), steps((0.0, 3.0), (1.5, 0.0)), steps((0.0, 4.0)))
    shear = (steps((0.0, 1.0), (4.9, 1.5)), steps((0.0, 0.0)), steps((0.0, 0.0)))
    drop = drop_of(grasp, normal=normal, shear=shear)
    assert [(one.contact, one.how) for one in drop.slips] == [("finger.tip", "absent"), ("finger.1", "slipped")]
    assert [one.time for one in drop.slips] == pytest.approx([1.6, 4.9])


def test_what_was_not_dropped_has_no_reason_for_it(grasp):
    calm = (steps((0.0, 5.0)),) * 3
    assert drop_of(grasp, normal=calm, shear=(steps((0.0, 0.5)),) * 3, fallen=1e9) is None
    odd = drop_of(grasp, normal=calm, shear=(steps((0.0, 0.5)),) * 3)
    assert odd.slips == ()
    assert "in their cones" in odd.text


@pytest.mark.deep
def test_a_slippery_mug_is_announced_dropped_and_explained(grasp, tmp_path):
    with pytest.warns(cg.BeyondCertificate, match=r"friction is 0\.3 .* certified for 0\.45"):
        run = cg.run_mission(load(MUG, ["contact_law.friction=0.3"]), grasp=grasp)
    first, *_ = run.verdict.drop.slips
    assert run.verdict.drop.phase.startswith("pull")
    assert first.shear == pytest.approx(0.3 * first.normal_force, rel=0.02)
    assert (first.friction, first.certified.friction) == (pytest.approx(0.3), 0.45)
    run.save(tmp_path)
    meta = json.loads((tmp_path / "meta.json").read_text())
    assert meta["verdict"]["drop"]["slips"][0]["contact"] == first.contact
    assert first.text in (tmp_path / "report.txt").read_text()
    assert "certificate needs 0.45" in (tmp_path / "result.yaml").read_text()


def test_a_finger_presses_harder_by_as_much_as_its_contact_may_be_pressed():
    assert reserve(fingers("finger", most=1.1 * CERTIFIED)[0]) == pytest.approx(0.1)
