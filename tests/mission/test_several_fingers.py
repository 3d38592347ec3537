"""Missions of several fingers; from inside: plants and assignments before a run, and records made by hand.

Missions of several fingers: one object between them, a controller for each, names that tell them apart.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.addons.chains.guides.integration import ChainIntegration
from continuum_grasp.addons.mission import PlantVariation, run_mission
from continuum_grasp.addons.mission.budget import certified_contact
from continuum_grasp.addons.mission.causes import find_drop
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.on_pads import pushed_out
from continuum_grasp.addons.mission.plant import Timetable, mission_plant_model
from continuum_grasp.addons.mission.precheck import exceeded
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.addons.mission.run import MissionRunner
from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import SharedModel
from continuum_grasp.control import Prediction
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.results import read_run
from continuum_grasp.scene import load
from continuum_grasp.simulation import ContactHistory, simulate
from tests.declared import assert_declared
from tests.mission_cases import PINCH, QUICK, SHORT, pressed

GUIDES = "plant={guides: 8, axial_stiffness: 10 kN, stiffness: 1.1, damping: 1.3, tendon_friction: 0.02}"
COARSE = ("plant.fidelity={family: clothoid, elements: 2}",)


@pytest.fixture(scope="module")
def grasp():
    return optimize_grasp(load(PINCH, ["grasp.solver.effort=quick"]).grasp)


@pytest.fixture(scope="module")
def assignments(grasp):
    return assign(load(PINCH, COARSE), grasp)


@pytest.fixture(scope="module")
def models(assignments):
    return [mission_plant_model(one) for one in assignments]


@pytest.mark.deep
def test_two_tips_push_out_what_slides_between_them(grasp, assignments):
    """A disc of mass m between opposed tips that press with N leaves them as exp(t sqrt(2 N / (R m))), where R is the
    distance of its center from those of the tips; fingers that give slow it a little. A palm behind it holds it.
    """
    force = sum(contact.normal_force for contact in grasp.contacts)
    mass, radius = load(PINCH).object_mass, grasp.scene.object.diameter / 2.0
    rigid = np.sqrt(force / (mass * radius))
    assert 0.8 * rigid < pushed_out(assignments) < rigid


@pytest.mark.deep
def test_what_is_pushed_out_is_pressed_harder_from_the_lift_on(grasp):
    """As hard as the drives can, where slip is watched; a mug that a palm holds in the plane waits for slip."""
    firm = assign(load(PINCH, [*COARSE, "slip={height: 0.1 mm}"]), grasp)
    assert [one.standing for one in firm] == pytest.approx([one.reserve for one in firm], rel=1e-6)
    mug = assign(load(PINCH.with_name("mug.yaml"), ["slip={height: 0.1 mm}", "grasp.solver.effort=quick"]))
    assert (pushed_out(mug), mug[0].standing) == (pytest.approx(0.0, abs=1e-6), 0.0)


@pytest.mark.deep
def test_a_pinch_whose_friction_falls_is_held(grasp):
    """A plant that fell 51 mm with squeezes that came when the tips slid: here it is pulled in the plane before."""
    scene = load(PINCH, ["slip={height: 0.1 mm}"])
    fallen = PlantVariation(stiffness=0.945, mass=0.975, friction=1.042, friction_fall=0.3)
    run = MissionRunner(assign(scene, grasp)).run(fallen)
    verdict = run.verdict
    assert any("they press 12 % harder from the lift on" in text for text in run.warnings)
    assert (verdict.held, verdict.slipped) == (True, None)
    assert verdict.sunk < 5e-4


@pytest.mark.deep
def test_a_pinch_lifts_only_where_its_models_agree_with_the_plant(grasp):
    """Drives of 100 ms in place of 20 ms: tensions contradict the models until they have risen, and it lifts 0.6 s
    late, by forces that are there. With 150 ms controllers trip and nothing is lifted: by the time of the lift forces
    are estimated 28 % too high.
    """
    slow, slower = (
        MissionRunner(assign(load(PINCH, [*COARSE, f"plant.time_constant={lag}"]), grasp)).run() for lag in (0.1, 0.15)
    )
    lift = slow.timetable.span("lift").start
    assert lift > slow.timetable.span("squeeze").end + 0.3
    for name, run in slow.fingers.items():
        at = int(np.searchsorted(run.t, lift - 1e-9))
        assert run.mismatch[at - 20] > 2.5 > run.mismatch[at]
        felt = slow.contacts.normal_force[at, slow.contacts.names.index(f"{name}.tip")]
        assert run.contact_force_estimate[at, 0] == pytest.approx(felt, abs=3.0 * run.contact_force_std[at, 0])
    assert (slow.status, slow.verdict.succeeded) == ("finished", True)
    assert (slower.status, slower.outcome) == ("tripped", "tripped, not lifted, released")
    assert "tension contradicts the model by many" in slower.verdict.tripped.text


def random_state(models, seed):
    """A common state at which all tips are pressed in, fingers and object move, and contacts have friction."""
    rng, shared, parts = np.random.default_rng(seed), SharedModel(models), []
    for model in models:
        gap, part, n = model.function("gap", gap=model.touch["gap"][0]), model.start.copy(), model.system.n
        side = 1.0 if model.scene.finger.base.position[1] < 0.0 else -1.0
        for bend in np.linspace(0.0, 3.0, 600):
            part[:n] = side * bend * np.ones(n)
            if float(gap(part, np.zeros(model.nu), model.forces(0.0)[0])) < -1e-3:
                break
        part[n : 2 * n] = 0.1 * rng.standard_normal(n)
        of_contacts = slice(object_rates(model).stop, model.system.nx)
        part[of_contacts] = 0.3 * rng.standard_normal(of_contacts.stop - of_contacts.start)
        part[object_rates(model)] = 0.02 * rng.standard_normal(4)
        parts.append(part)
    return shared, shared.joined(parts)


def object_rates(model):
    pose = model.system.object_states
    return slice(pose.stop, 2 * pose.stop - pose.start)


@pytest.fixture(scope="module")
def against_palm(grasp):
    """The same tin in the way of a palm, 1 mm deep in it."""
    palm = "grasp.supports={palm: {type: line, start: [0.0607, 0.02], end: [0.0607, -0.02], touch: on}}"
    return [mission_plant_model(one) for one in assign(load(PINCH, [*COARSE, palm]), grasp)]


def on_object(models, parts, u, w):
    """Force, and its moment about the center, of all contacts of several plants on their object, and the lift."""
    total, lifted, center = np.zeros(3), 0.0, parts[0][models[0].system.object_states][:2]
    for k, (model, part, given) in enumerate(zip(models, parts, w, strict=True)):
        touch = model.function("touch", **{name: model.touch[name] for name in ("force", "point", "lift")})
        force, point, lift = (np.array(v) for v in touch(part, u[2 * k : 2 * k + 2], given))
        assert np.hypot(*force[:, 0]) > 0.5
        if "palm" in model.system.touch_names:
            assert np.hypot(*force[:, model.system.touch_names.index("palm")]) > 1.5
        for row in range(force.shape[1]) if k == 0 else [0]:  # supports and table count once
            arm = point[:, row] - center
            total += [*force[:, row], arm[0] * force[1, row] - arm[1] * force[0, row]]
            lifted += float(lift[row, 0])
    return total, lifted


def newton(model, total, lifted):
    """Accelerations of the object, of which the last is along gravity."""
    mass = model.scene.object.mass
    return [*(total[:2] / mass), total[2] / model.scene.inertia, lifted / mass - 9.81]


@pytest.mark.parametrize(("around", "fingers"), [("models", (0, 1)), ("models", (0, 1, 1)), ("against_palm", (0, 1))])
def test_the_object_obeys_newton_and_each_finger_its_own_plant(request, around, fingers):
    """Rates of the common state beside those of each plant, and the object's beside the sum of all forces on it."""
    models = [request.getfixturevalue(around)[k] for k in fingers]
    shared, x = random_state(models, len(fingers))
    parts, forces = shared.parts(x), [model.forces(0.0)[0] for model in models]
    u = np.array([30.0, 2.0, 3.0, 28.0, 4.0, 20.0])[: shared.nu]
    wrench = np.array([0.3, -0.2, 0.01])
    for model, w in zip(models, forces, strict=True):
        w[[model.w_names.index(f"object_{name}") for name in ("force_x [N]", "force_y [N]", "moment [N m]")]] = wrench
    found = np.array(shared.forward_dynamics(x, u, np.concatenate(forces), shared.p)).ravel()
    for k, (model, part, w) in enumerate(zip(models, parts, forces, strict=True)):
        own = np.array(model.forward_dynamics(part, u[2 * k : 2 * k + 2], w, model.p)).ravel()
        alone = np.r_[0 : model.system.object_states.start, model.system.nx : model.nx]
        assert shared.parts(found)[k][alone] == pytest.approx(own[alone], rel=1e-9, abs=1e-9)
    total, lifted = on_object(models, parts, u, forces)
    rates = shared.parts(found)[0][object_rates(models[0])]
    assert rates == pytest.approx(newton(models[0], total + wrench, lifted), rel=1e-9, abs=1e-9)


def test_implicit_rates_are_those_of_each_finger_alone_and_of_the_motion_in_the_limit(models):
    shared, x = random_state(models, 4)
    u, w = np.ones(shared.nu), shared.forces(0.0)[0]
    implicit, exact = shared.implicit(), np.array(shared.forward_dynamics(x, u, w, shared.p)).ravel()
    assert np.array(implicit(x, u, w, shared.p, 0.0)).ravel() == pytest.approx(exact, rel=1e-9, abs=1e-9)
    found = np.array(implicit(x, u, w, shared.p, 1e-3)).ravel()
    for model, part, rate in zip(models, shared.parts(x), shared.parts(found), strict=True):
        n, own = model.system.n, model.implicit()
        alone = np.array(own(part, np.ones(model.nu), model.forces(0.0)[0], model.p, 1e-3)).ravel()
        assert rate[: 2 * n] == pytest.approx(alone[: 2 * n], rel=1e-9)
        assert not np.allclose(rate[n : 2 * n], shared.parts(exact)[models.index(model)][n : 2 * n], rtol=0.1)


@pytest.fixture(scope="module")
def guided(grasp):
    """The same plants as chains of guides, and what integrates both together."""
    models = [mission_plant_model(one) for one in assign(load(PINCH, [GUIDES]), grasp)]
    shared = SharedModel(models)
    return models, shared, ChainIntegration(shared)


def closing(models, tension):
    """Commands (nu) under which all fingers close with a tension [N]."""
    below = [model.scene.finger.base.position[1] < 0.0 for model in models]
    return [np.array([tension, 1.0] if one else [1.0, tension]) for one in below]


def test_chains_of_guides_obey_newton_with_one_object(guided):
    """A step of 10 ns with both pressing: the object's by the sum of forces, each finger's as if alone."""
    models, shared, integration = guided
    x, h = random_state(models, 5)[1], 1e-8
    parts = shared.parts(x)
    for model, part in zip(models, parts, strict=True):
        part[2 * model.system.n : model.system.first_other] = 20.0  # N, all along both tendons
    x = shared.joined(parts)
    u = np.concatenate(closing(models, 40.0))
    after = shared.parts(integration.advance(x, u, 0.0, h, 1)[-1])
    for k, (model, part) in enumerate(zip(models, parts, strict=True)):
        alone = ChainIntegration(model).advance(part, u[2 * k : 2 * k + 2], 0.0, h, 1)[-1]
        n, moved = model.system.n, slice(0, model.system.object_states.start)
        speed = np.abs(alone[n : 2 * n] - part[n : 2 * n]).max()
        assert speed > 1e-3
        # The other finger acts on this one through the object's motion alone, by the square of the step.
        assert after[k][moved] == pytest.approx(alone[moved], abs=1e-4 * speed)
    expected = newton(models[0], *on_object(models, parts, u, [model.forces(0.0)[0] for model in models]))
    rates = object_rates(models[0])
    assert (after[0] - parts[0])[rates] / h == pytest.approx(expected, rel=2e-3, abs=1e-2)
    assert np.array_equal(after[0][rates], after[1][rates])


def test_a_chain_that_touches_nothing_leaves_the_other_alone(guided):
    """The lower finger pushes the tin, the upper one bends away from it: each as if the other were not."""
    models, shared, integration = guided
    lower, upper = closing(models, 60.0)
    u = [lower, upper[::-1]]
    together = shared.joined([model.start for model in models])
    alone, own = [model.start for model in models], [ChainIntegration(model) for model in models]
    for k in range(8):  # in the next ones the tin comes to the upper finger
        together = integration.advance(together, np.concatenate(u), 0.01 * k, 0.01, 10)[-1]
        alone = [one.advance(x, v, 0.01 * k, 0.01, 10)[-1] for one, x, v in zip(own, alone, u, strict=True)]
    found = shared.parts(together)
    pose, n = models[0].system.object_states, models[0].system.n
    assert np.linalg.norm(alone[0][pose][:2] - models[0].start[pose][:2]) > 0.005  # it was pushed
    assert found[0] == pytest.approx(alone[0], abs=1e-9)
    assert found[1][: 2 * n] == pytest.approx(alone[1][: 2 * n], abs=1e-9)
    assert abs(found[1][:n].sum()) > 0.3


def test_each_finger_has_its_own_task(assignments, grasp):
    lower, upper = assignments
    assert [one.name for one in assignments] == ["lower", "upper"]
    for one in assignments:
        assert one.forces == {"finger.tip": grasp.contact(f"{one.name}.tip").normal_force}
        assert one.control.contacts == ()
        assert sum(one.control.fidelity.elements) == pytest.approx(0.09)
    # The grasp is symmetric, and so is what both have to do.
    assert lower.held == pytest.approx(upper.held[::-1], rel=1e-4)
    assert lower.bends == pytest.approx(-upper.bends, abs=1e-6)
    assert lower.posture == pytest.approx(-upper.posture, abs=1e-4)


def test_fingers_of_one_kind_share_their_code(assignments):
    """What is compiled is the same for both; where they stand is a parameter."""
    models = [Prediction(one.control) for one in assignments]
    lower, upper = models
    for name in ("dynamics", "contact_force", "tip"):
        assert getattr(lower, name).serialize() == getattr(upper, name).serialize()
    there = [dict(zip(model.p_names, model.p_nominal, strict=True)) for model in models]
    assert [p["base_position_y [m]"] for p in there] == [-0.04, 0.04]
    assert "base_angle [rad]" not in there[0]  # equal, and folded into the code


def test_a_finger_alone_of_its_kind_has_its_base_in_the_code(grasp):
    longer = load(PINCH, ["grasp.fingers.upper.tendons.max_tension=121"])
    for one in assign(longer, grasp):
        assert not any(name.startswith("base_") for name in one.control.parameters)


def test_the_check_before_the_run_names_the_finger(grasp):
    weak = assign(load(PINCH, ["drive_tension=60"]), grasp)
    found = exceeded(weak, PlantVariation())
    assert [one.name for one in found] == ["tension", "tension"]
    assert "the drive of lower" in found[0].text
    assert "the drive of upper" in found[1].text
    heavy = {one.name: one for one in exceeded(assign(load(PINCH, ["object_mass=0.6"]), grasp), PlantVariation())}
    carried = 0.5 * sum(contact.normal_force for contact in grasp.contacts) / 9.81
    assert heavy["mass"].resisted == pytest.approx(carried, rel=1e-3)
    assert heavy["mass"].certain


@pytest.mark.deep
def test_a_drop_names_finger_and_contact(assignments, grasp):
    table = Timetable(assignments[0])
    t = np.arange(0.0, table.duration, 0.01)
    shape = (len(t), 2)

    names = ("finger.tip", "table")
    firm, weak = np.full(shape, 4.0), np.full(shape, 1.0)
    slipping = np.where(t[:, None] < 3.0, 1.0, 2.0) * np.ones(shape)
    both = ContactHistory.joined({"lower": pressed(names, firm, weak), "upper": pressed(names, firm, slipping)})
    assert both.names == ("lower.tip", "upper.tip", "table")
    assert [both.on_finger(name) for name in both.names] == [True, True, False]
    record = MissionRecord(assignments, table, PlantVariation(), (SimpleNamespace(t=t),), both)
    drop = find_drop(record, 0.02 * (t >= 3.2))
    assert drop.text.startswith("slipped at upper.tip at 3.00 s: friction 0.50, certificate needs 0.45")
    own = certified_contact(assignments, "upper.tip")
    assert own.normal_force == grasp.contact("upper.tip").normal_force


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("grasp.fingers.upper.tendons.time_constant=null", "grasp.fingers.upper.tendons: needs a time_constant"),
        (
            "grasp.supports.table={type: point, position: [0.3, 0.2]}",
            "grasp: a finger or support has the name of the table",
        ),
        ("more_contacts=[0.1]", r"more_contacts\[0\]: 0.1 m is not before the tip"),
    ],
)
def test_what_makes_no_mission_of_two_fingers_is_named(change, said):
    with pytest.raises(InputError, match=said):
        load(PINCH, [change])


@pytest.mark.deep
def test_a_mission_of_two_fingers_is_simulated_with_the_other_as_it_moved(grasp):
    """From approach to release, by another integrator: what is between the tips goes where it went."""
    run = MissionRunner(assign(load(PINCH, QUICK[:2]), grasp)).run()
    scene = run.simulated
    assert (list(scene.support_motion), scene.finger) == (["upper_tip"], run.scene.finger)
    motion = simulate(run)
    assert motion.t == pytest.approx(run.t)
    assert np.linalg.norm(motion.tip - run.runs[0].tip, axis=1).max() < 1e-5
    off = np.abs(motion.object_pose - run.object_pose)
    assert np.ptp(run.object_pose[:, :2], axis=0).max() > 1e-3
    assert off[:, [0, 1, 3]].max() < 1e-5
    assert off[:, 2].max() < 1e-3
    other = motion.contacts.normal_force[:, motion.contacts.names.index("upper_tip")]
    pressed = run.contacts.normal_force[:, run.contacts.names.index("upper.tip")]
    assert other == pytest.approx(pressed, abs=0.01 * pressed.max())
    # A support of that name stays beside it.
    peg = {"type": "point", "position": (0.3, 0.2), "radius": 0.01}
    beside = replace(run, scenes=(run.scene.replaced(supports={"upper_tip": peg}), *run.scenes[1:])).simulated
    assert list(beside.supports) == ["upper_tip", "upper_tip_"]
    assert beside.support_motion["upper_tip_"] == scene.support_motion["upper_tip"]


@pytest.mark.deep
def test_a_short_mission_of_two_fingers_holds_and_is_saved(grasp, tmp_path):
    short = load(PINCH, QUICK[:2])
    runner = MissionRunner(assign(short, grasp))
    libraries = {one._c.library._name for one in runner._controllers}
    assert len(libraries) == 1  # compiled once
    run = runner.run()
    assert run.verdict.succeeded
    names, t, hold = run.contacts.names, run.t, run.timetable.span("hold")
    assert names == ("lower.tip", "upper.tip", "table")
    during = (t > hold.start) & (t < hold.end)
    lower, upper = run.contacts.normal_force[during, :2].T
    assert lower.mean() == pytest.approx(upper.mean(), rel=0.02)
    assert run.contacts.lift[during, :2].sum(axis=1).mean() == pytest.approx(0.1 * 9.81, rel=0.02)
    assert run.run is None
    assert run.force_estimate.shape == run.force_std.shape == (len(t) - 1, 2)
    assert list(run.held_forces) == ["lower.tip", "upper.tip"]
    # Both fingers see one object, and sensors of their own.
    poses = [one.object_pose for one in run.runs]
    assert np.array_equal(*poses)
    assert not np.array_equal(run.runs[0].y[:, 1], -run.runs[1].y[:, 1])
    run.save(tmp_path)
    stored = read_run(tmp_path)
    assert stored.arrays["contact_gap"].shape == (len(t), 3)
    assert stored.arrays["object_pose"] == pytest.approx(run.object_pose)
    assert "u" not in stored.arrays
    assert_declared(run, stored.arrays)
    for name, one in run.fingers.items():
        assert np.array_equal(read_run(tmp_path / name).arrays["u"], one.u)
    report = (tmp_path / "report.txt").read_text()
    assert "finger lower" in report
    assert "finger upper" in report
    assert {path.name for path in run.save_pictures(tmp_path)} == {"timeline.png", "snapshots.png"}
    assert run.animate(tmp_path / "a.gif", fps=2).stat().st_size > 10_000
    # Other plants in between leave no trace; half of the friction is too little.
    dropped = runner.run(PlantVariation(friction=0.2))
    assert not dropped.verdict.held
    assert {slip.contact for slip in dropped.verdict.drop.slips} == {"lower.tip", "upper.tip"}
    again = runner.run()
    assert all(np.array_equal(a.x, b.x) for a, b in zip(again.runs, run.runs, strict=True))


@pytest.mark.deep
def test_chains_of_guides_hold_a_tin_between_them(grasp):
    """The exact law of tendons at every guide, of a finger that no controller knows."""
    run = MissionRunner(assign(load(PINCH, [GUIDES.replace("8,", "16,"), f"phases={SHORT}"]), grasp)).run()
    assert run.verdict.succeeded
    hold = run.timetable.span("hold")
    during = (run.t > hold.start) & (run.t < hold.end)
    force = run.contacts.normal_force[during, :2]
    assert force[:, 0].mean() == pytest.approx(force[:, 1].mean(), rel=0.02)
    assert force.mean() == pytest.approx(grasp.contact("lower.tip").normal_force, rel=0.15)
    # What bears the weight is not averaged: the tin bounces on its friction with the period of the samples.
    assert run.verdict.sunk < 1e-4
    assert max(one.statistics["plant_error_m"] for one in run.runs) < 1e-4


@pytest.mark.deep
def test_a_tin_is_pressed_on_a_palm_by_two_fingers_and_dropped_off_it():
    short = load(PINCH.with_name("pinch_palm.yaml"), [f"phases={SHORT}", "plant.fidelity.elements=3"])
    runner = MissionRunner(assign(short))
    run = runner.run()
    assert run.verdict.succeeded
    names = run.contacts.names  # with the ends of the palm, which nothing touches
    assert set(names) == {"lower.tip", "upper.tip", "palm", "palm.start", "palm.end", "table"}
    bearing = [k for k, name in enumerate(names) if name != "table"]
    hold = run.timetable.span("hold")
    during = (run.t > hold.start) & (run.t < hold.end)
    # The palm bears the weight with the tips, and what both press it on the palm with: forces on the tin add up.
    assert run.contacts.lift[during][:, bearing].sum(axis=1).mean() == pytest.approx(0.1 * 9.81, rel=0.02)
    assert run.contacts.force[during][:, 0, bearing].sum(axis=1).mean() == pytest.approx(0.0, abs=0.05)
    assert run.contacts.normal_force[during, names.index("palm")].mean() > 2.0
    dropped = runner.run(PlantVariation(friction=0.2)).verdict
    assert not dropped.held
    assert "palm" in {slip.contact for slip in dropped.drop.slips}
    assert "palm slipped" in dropped.drop.text or "slipped at palm" in dropped.drop.text


@pytest.mark.deep
def test_three_fingers_hold_more_firmly_than_two():
    phases = SHORT.replace("approach: 0.4", "approach: 0.5")
    changes = [f"phases={phases}", "plant.fidelity.elements=4", "controller.elements=[1, 1]", "pull_share=0.4"]
    run = run_mission(load(PINCH.with_name("pinch_three.yaml"), changes))
    assert run.verdict.succeeded
    assert run.contacts.names == ("a.tip", "b.tip", "c.tip", "table")
    # Of two fingers it moves by millimeters: three normals span the plane.
    assert run.verdict.moved < 0.5e-3
    assert np.all(run.contacts.normal_force[run.t > run.timetable.span("lift").end][:10, :3] > 4.0)
