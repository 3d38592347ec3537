"""Why there is no grasp, and what would repair it; from inside: single repairs, and a search that finds nothing.

Why there is no grasp: repairs that are none are not offered, the balance against tilting is.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from continuum_grasp.grasp.reasons.diagnosis import Repairs, ordered, out_of_reach, part_of
from continuum_grasp.grasp.reasons.elastic import Repair
from grasp_scenes import CONFIGS, HEXAGON, INTO_PLANE, PLANAR, WEIGHTLESS, make_scene
from scipy.optimize import linprog

from benchmarks.grasp_images import drawn, mirrored, moved, scaled, scene_of
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.scenes import DRAWN, UNASKED
from benchmarks.grasp_oracle.search import Search
from continuum_grasp.base import SolverError
from continuum_grasp.grasp import GraspStatus, Reason, optimize_grasp, solve, verdict
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.nlp import Budget, Violation
from continuum_grasp.scene import GraspContacts, GraspScene, load
from tests import certificate_cases as cases


def middle_only(friction, gravity=INTO_PLANE, family="arc", **changes):
    contacts = GraspContacts(friction=friction, normal_force_max=30.0, tip="off")
    return make_scene(family, gravity, contacts=contacts, **changes)


@pytest.mark.parametrize(("effort", "more"), [("quick", True), ("normal", True), ("thorough", False)])
def test_advice_names_the_effort_that_tries_more_where_there_is_one(effort, more):
    scene = load(CONFIGS / "pinch.yaml").changed({"solver.effort": effort})
    found = solve._ModelSearch(scene, Budget())._verdict.unsolved(None)
    assert found.status is GraspStatus.NOT_SOLVED
    assert ("Try solver.effort: thorough" in found.advice) is more
    assert "solver.effort" in found.advice or not more
    assert "move the base or the object" in found.advice


@pytest.mark.parametrize("angle", [0.0, 1.5, 3.0])
def test_what_can_be_turned_towards_the_base_is_not_out_of_reach(angle):
    """A bar whose frame is at one end: whether it reaches the base's surroundings depends on its angle alone."""
    corners = [(0.0, -0.01), (0.1, -0.01), (0.1, 0.01), (0.0, 0.01)]

    def reason(x):
        bar = {"shape": "polygon", "vertices": corners, "mass": 0.1, "position": (x, 0.0), "angle": angle}
        free = {"free": {"angle": (-3.2, 3.2)}}
        return out_of_reach(make_scene(gravity=WEIGHTLESS, base_y=0.0, supports={}, object=bar | free))

    reach = 0.95 * 0.18 + 0.006  # a middle contact is on, which touches up to there
    assert reason(reach + 0.099) is None  # turned by half a turn from the x axis, it is 1 mm within
    assert reason(reach + 0.115) is not None
    assert reason(reach + 0.115).needed == pytest.approx(reach)


@pytest.mark.deep
@pytest.mark.parametrize("family", ["matched_clothoid", "arc"])
@pytest.mark.parametrize("friction", [0.5, 1.5])
def test_no_mass_at_all_is_no_repair(family, friction):
    result = optimize_grasp(middle_only(friction, family=family), raise_on_failure=False)
    assert not result.solved
    named = [one for reason in result.reasons for one in (reason, *reason.also)]
    assert named
    assert all(one.needed > 0.1 * one.limit for one in named if one.name == "mass")


@pytest.mark.deep
def test_tilt_balance_is_named_with_the_moment_that_is_missing():
    """Two contacts bear the weight: finger at the normal n, palm at m. Of all shares that add up to the weight W,
    equal ones leave the least moment, R W |n + m| / 2; the arc that touches the mug fixes n.
    """
    scene = middle_only(1.5)
    (touch,) = {round(float(p.ends[0, 0] * p.lengths[0]), 9) for p in Search(numbers(scene)).postures if p.side == 1}
    n = scene.finger.base.angle + touch
    least = 0.04 * 0.3 * 9.81 * 0.5 * math.hypot(math.cos(n) - 1.0, math.sin(n))
    result = optimize_grasp(scene, raise_on_failure=False)
    assert result.status is GraspStatus.INFEASIBLE
    reason = next(r for r in result.reasons if r.key == "upright")
    assert reason.needed == pytest.approx(least, rel=1e-4)
    assert reason.unit == "N m"
    assert f"{1e3 * least:.3g} mN m" in reason.text
    assert "upright: true" in result.advice
    assert optimize_grasp(middle_only(1.5).replaced(upright=True)).solved


@pytest.mark.deep
def test_tilt_is_no_reason_where_it_is_ignored_or_harmless():
    ignored = optimize_grasp(middle_only(0.5).replaced(upright=True), raise_on_failure=False)
    heavy = optimize_grasp(make_scene("arc", INTO_PLANE, mass=1.2), raise_on_failure=False)
    for result in (ignored, heavy):
        assert result.status is GraspStatus.INFEASIBLE
        assert "upright" not in [reason.key for reason in result.reasons]


@pytest.mark.deep
@pytest.mark.parametrize("seed", [2, 10, 16])
def test_images_of_a_scene_have_the_same_reasons(seed):
    """Single limits and pairs, in the same order, off by the same factors."""

    def reasons(image):
        result = optimize_grasp(scene_of(image(DRAWN["one"](seed) | UNASKED), 4), raise_on_failure=False)
        assert result.status is GraspStatus.INFEASIBLE
        return [(one, *one.also) for one in result.reasons]

    own = reasons(dict)
    for image in (mirrored, moved, scaled):
        for one, expected in zip(reasons(image), own, strict=True):
            assert [part.name for part in one] == [part.name for part in expected]
            factors = [part.needed / part.limit for part in expected]
            assert [part.needed / part.limit for part in one] == pytest.approx(factors, rel=1e-4)


@pytest.mark.deep
def test_a_bending_range_is_a_reason_where_it_is_given_and_widened_where_it_is_not():
    """The hexagon is held where an element may bend by more than half a turn, its bending range by default."""
    free = scene_of(HEXAGON | {"fidelity": {"family": "matched_clothoid"}, "overlap": "forbid"}, 4)
    wide = optimize_grasp(free.changed({"fidelity.bending_range": 6.28}))
    widened = optimize_grasp(free)
    assert widened.tension == pytest.approx(wide.tension, rel=1e-6)
    assert "bending_range" in widened.statistics["fidelity"]
    given = optimize_grasp(free.changed({"fidelity.bending_range": math.pi}), raise_on_failure=False)
    assert given.status is GraspStatus.INFEASIBLE
    needed = next(reason.needed for reason in given.reasons if reason.name == "bending range")
    bends = np.abs(wide.arrays["finger.lengths"][:, None] * FingerShape(free.setups[0], wide.arrays).curvatures)
    assert math.pi < needed <= bends.max() * (1.0 + 1e-6)


@pytest.mark.parametrize("given", [None, 2.0])
def test_only_a_given_bending_range_is_ever_a_reason(monkeypatch, given):
    """A stub finds no grasp however far elements may bend: ranges and elements of the program's own choice grow until
    there is no verdict, while a given range is named at once.
    """
    scene, asked = make_scene("arc").changed({"fidelity.elements": 4, "fidelity.bending_range": given}), []

    def reasons(verdict, further=False):
        (setup,) = verdict.scene.setups
        asked.append((setup.elements, round(setup.bending_range, 3)))
        needed = setup.bending_range + 0.5
        return [Reason("bending range", "fidelity.bending_range", "rad", setup.bending_range, needed, "", "")]

    monkeypatch.setattr(solve.GraspSearch, "run", lambda search, **_: None)
    monkeypatch.setattr(solve._ModelSearch, "_reasons", reasons)
    result = optimize_grasp(scene, raise_on_failure=False)
    if given:
        assert (result.status, asked) == (GraspStatus.INFEASIBLE, [(4, given)])
    else:
        assert result.status is GraspStatus.NOT_SOLVED
        assert asked[:2] == [(4, 3.142), (4, 6.283)]
        assert [elements for elements, _ in asked[2:]] == [8, 8, 8, 16, 16, 16, 32, 32, 32]


@pytest.mark.parametrize("seed", range(20))
def test_both_halves_of_a_pair_are_needed(seed):
    """Limits whose amounts z have to satisfy random rows A z >= 1, in place of grasps: a pair that is named satisfies
    all, and neither half alone does by as much; the least sum alone may relax many.
    """
    random = np.random.default_rng(seed)
    names = [limit for limit in RELAXATIONS if limit.limit is not None and limit.name != "strain"]
    rows = random.uniform(0.1, 2.0, (6, len(names))) * (random.random((6, len(names))) < 0.6)
    rows[:, random.integers(len(names))] = random.uniform(0.1, 2.0, 6)

    def relax(limits, begin):
        found = linprog(np.ones(len(limits)), -rows[:, [names.index(limit) for limit in limits]], -np.ones(6))
        return (
            Repair(dict(zip(limits, found.x, strict=True)), {}, SimpleNamespace(start=None)) if found.success else None
        )

    known = {"impossible": False, "keep_clear": lambda _: False, "maps": SimpleNamespace()}
    search = SimpleNamespace(budget=SimpleNamespace(over=False), **known)
    repairs = Repairs(make_scene(gravity=PLANAR), search)
    repairs.relax, repairs.certificate = relax, lambda repair: SimpleNamespace(failed=())
    repairs.starts = SimpleNamespace(of=lambda limits: [None], closer=lambda limits, enough: [None], near=[])
    named = []
    repairs._reason = lambda repair: named.append(repair.parts) or Reason("tension", "", "", 1.0, 2.0, "", "")
    repairs._relaxed(itertools.combinations(names, 2))
    found = [repair.parts for repair in repairs.found.values()]
    assert found
    for parts in found:
        columns, amounts = [names.index(limit) for limit in parts], np.array(list(parts.values()))
        assert len(parts) <= 2
        assert (rows[:, columns] @ amounts >= 1.0 - 1e-9).all()
    repairs.reasons()
    assert named
    for parts in (parts for parts in named if len(parts) > 1):
        assert all((rows[:, names.index(limit)] * part).min() < 1.0 - 1e-9 for limit, part in parts.items())


CLIP = """
schema_version: 1
finger:
  rod:
    length: 150 mm
    youngs_modulus: 8 MPa
    density: 1200
    sections: [{to: 150 mm, thickness: [12 mm, 6 mm], width: 15 mm}]
  tendons: {offset: 2.5 mm, max_tension: 60 N}
  base: {position: [0, -50 mm], angle: -90 deg}
object:
  shape: union
  members:
    - {shape: box, width: 50 mm, height: 25 mm, position: [25 mm, -17.5 mm]}
    - {shape: box, width: 25 mm, height: 35 mm, position: [12.5 mm, 12.5 mm]}
  center_of_mass: [19.9 mm, -5.1 mm]
  mass: 300 g
  position: [0, 0]
supports: {palm: {type: palm, point: [0, 0], normal_angle: 0}}
contacts: {friction: 0.6, normal_force_max: 30, middle: auto, tip: on}
gravity: [0.0, 0.0, -9.81]
"""


@pytest.mark.deep
def test_limits_that_repair_nothing_cost_few_iterations():
    """Runs that do not end where violations stand still take 722 for the same mass."""
    result = optimize_grasp(scene_of(drawn("one", 857), 4), raise_on_failure=False)
    assert [(reason.name, reason.needed) for reason in result.reasons] == [
        ("mass", pytest.approx(0.09378481, rel=1e-5))
    ]
    assert result.statistics["total_iterations"] < 500


@pytest.mark.deep
def test_a_limit_that_is_enough_alone_is_named_alone():
    """No start for friction alone leads to a grasp here, only points at which all limits are relaxed do."""
    scene = GraspScene.model_validate(yaml.safe_load(CLIP))
    result = optimize_grasp(scene, raise_on_failure=False)
    assert result.status is GraspStatus.INFEASIBLE
    (friction,) = (reason for reason in result.reasons if reason.title == "friction")
    for part in (part for reason in result.reasons for part in (reason, *reason.also)):
        assert abs(part.needed - part.limit) > 1e-3 * part.limit
    assert optimize_grasp(scene.changed({"contacts.friction": 1.0001 * friction.needed})).solved


@pytest.mark.deep
def test_repairs_are_enough_for_all_friction_states():
    """What the mug's finger can hold as it is pulled, 0.69 kg without friction, it cannot after it is released."""
    scene = load(CONFIGS / "mug.yaml").changed({"finger.tendons.friction": 0.05, "fidelity.family": "clothoid"})
    reason = optimize_grasp(scene.changed({"object.mass": 1.5}), raise_on_failure=False).reasons[0]
    assert reason.name == "mass"
    assert optimize_grasp(scene.changed({"object.mass": reason.needed})).solved


@pytest.mark.deep
@pytest.mark.parametrize(
    ("config", "key", "factor"),
    [
        # Two fingers may press 3 N each: weight / (2 * 3 N), and the mass by the same balance.
        ("slippery_bottle", "contacts.friction", 0.2 * 9.81 / 6.0 / 0.15),
        ("slippery_bottle", "object.mass", 0.15 * 6.0 / 9.81 / 0.2),
        ("heavy_bottle", "contacts.friction", None),
        ("heavy_bottle", "object.mass", None),
    ],
)
def test_numbers_of_reasons_are_enough_and_little_less_is_not(config, key, factor):
    scene = load(CONFIGS / f"{config}.yaml")
    reason = next(one for one in optimize_grasp(scene, raise_on_failure=False).reasons if one.key == key)
    if factor is not None:
        assert reason.needed / reason.limit == pytest.approx(factor, rel=1e-4)
    way = 1.0 if reason.needed > reason.limit else -1.0
    enough, less = (scene.changed({key: reason.needed * (1.0 + way * part)}) for part in (1e-4, -5e-3))
    assert optimize_grasp(enough, raise_on_failure=False).solved
    assert not optimize_grasp(less, raise_on_failure=False).solved


BOX = """
schema_version: 1
finger: {extends: fingers/hand_finger.yaml, base: {position: [0.0, -60.3 mm], angle: -90 deg}}
object: {shape: box, width: 64.75 mm, height: 71.17 mm, mass: 145 g, position: [32.375 mm, 4.966 mm]}
supports: {palm: {type: palm, point: [0, 0], normal_angle: 0}}
contacts: {friction: 0.7, normal_force_max: 30, reserve: 20 %, middle: on, tip: off}
gravity: [0.0, 0.0, -9.81]
fidelity: {family: matched_clothoid, elements: 2}
objective: greatest_friction_margin
"""


@pytest.mark.deep
def test_repairs_hold_as_they_are_written(tmp_path):
    """With the number needed itself, in four digits, no grasp is found: the one there is breaks limits by rounding."""
    (tmp_path / "box.yaml").write_text(BOX.replace("fingers/", f"{CONFIGS.parent.resolve()}/fingers/"))
    result = optimize_grasp(tmp_path / "box.yaml", raise_on_failure=False)
    repairs = re.findall(r"([a-z.]+) = ([\d.]+\d)", result.advice)
    assert (
        [key for key, _ in repairs] == [reason.key for reason in result.reasons] == ["object.mass", "contacts.friction"]
    )
    for repair in repairs:
        assert optimize_grasp(load(tmp_path / "box.yaml", ["=".join(repair)])).solved


def test_a_repair_goes_beyond_what_is_needed_and_says_what_goes_with_it():
    """By 1 % at least, in three digits; a friction that a support has by itself is raised by as much."""
    scene = load(CONFIGS / "mug.yaml").changed({"contacts.friction": 0.25, "object.mass": 0.123})
    repairs = Repairs(scene, SimpleNamespace())
    stated = {limit.name: part_of(repairs, limit, Repair({limit: 0.1}, {}, None)) for limit in repairs.limits}
    assert stated["friction"].needed == pytest.approx(0.3)
    assert stated["friction"].repair == "contacts.friction = 0.303"
    assert stated["mass"].needed == pytest.approx(0.92 * 0.123)  # 0.1132
    assert stated["mass"].repair == "object.mass = 0.112 kg"
    assert stated["tilt balance"].repair.startswith("upright: true")
    rubber = Repairs(scene.changed({"supports.palm.friction": 0.8}), SimpleNamespace())
    friction = next(limit for limit in rubber.limits if limit.name == "friction")
    little = part_of(rubber, friction, Repair({friction: 1e-6}, {}, None))
    assert little.text == "friction is too low: coefficient 0.25, 0.250001 needed"
    assert little.repair == "contacts.friction = 0.253 together with supports.palm.friction = 0.803"


def test_of_two_fingers_only_the_weak_one_is_named_and_to_raise_its_limit_is_enough():
    """Its numbers are the reason's, not those of the strong one, whose limit is nowhere near."""
    scene = load(CONFIGS / "pinch.yaml").changed({"fingers.left.tendons.max_tension": 20.0, "stability": "ignore"})
    with pytest.raises(SolverError) as error:
        optimize_grasp(scene)
    reason = next(reason for reason in error.value.result.reasons if reason.name == "tension")
    assert reason.key == "fingers.left.tendons.max_tension"
    assert reason.limit == 20.0
    assert reason.needed > 25.0
    key, _, number = reason.repair.removesuffix(" N").partition(" = ")
    assert optimize_grasp(scene.changed({key: float(number)})).verified


@pytest.mark.parametrize(
    ("config", "changes"),
    [
        ("wrap", {}),  # three fingers
        ("pinch", {"fingers.left.contacts": {"friction": 0.4, "normal_force_max": 5.0}, "fidelity.bending_range": 2.0}),
        ("spirob_cup", {"supports.palm.friction": 0.8}),  # a list of tendons
        ("mug_motor", {}),  # 70 N, of which the motors pull up 62.25 N
        ("mug_motor", {"finger.tendons.drive.torque_max": 2.0}),
        ("mug_motor", {"finger.tendons.drive.arrangement": "one_pulley"}),
    ],
)
def test_repairs_are_keys_of_the_scene(config, changes):
    """Written back into the scene as they stand, they leave every limit as far away as is needed, or farther."""
    scene = load(CONFIGS / f"{config}.yaml").changed(changes)
    repairs = Repairs(scene, SimpleNamespace())
    for limit in (one for one in repairs.limits if one.limit is not None):
        stated = part_of(repairs, limit, Repair({limit: 0.1}, {}, None))
        pairs = re.findall(r"([a-z_.\[\]0-9]+) = ([\d.]+\d)", stated.repair)
        assert stated.key == pairs[0][0]
        repaired = scene.changed({key: float(number) for key, number in pairs})
        way = 1.0 if stated.needed > stated.limit else -1.0
        assert way * limit.limit(repaired) >= way * stated.needed
        just = limit.relaxed(scene, 0.1 * limit.start(scene))
        for enough, needed in zip(repaired.setups, just.setups, strict=True):
            assert enough.max_tension >= needed.max_tension
            assert enough.friction >= needed.friction
            assert enough.normal_force_max >= needed.normal_force_max
            assert enough.bending_range >= needed.bending_range


def test_a_repair_says_that_its_grasp_is_unstable():
    """Two fingers below a disc, which rolls off them; stable ones come first, and there is no note where they need not
    be.
    """
    scene, arrays = cases.two_fingers_below()
    for stability, stable in (("require", False), ("ignore", True)):
        repairs = Repairs(scene.changed({"stability": stability}), SimpleNamespace())
        limit = next(one for one in repairs.limits if one.name == "tension")
        reason = repairs._reason(Repair({limit: 0.5}, arrays, SimpleNamespace(optimal=True)))
        assert reason.stable == stable
        assert reason.repair.endswith("but the grasp found then is unstable") == (not stable)
    worse = replace(reason, limit=1.0, needed=1e3)
    assert ordered([replace(reason, stable=False), worse])[0] is worse


def test_of_what_many_disturbances_break_the_worst_is_named():
    units = {"unit": "N", "key": "contacts.friction", "index": 0, "scaled": 1.0}
    names = (
        "disturbed friction cone, finger.tip, 1",
        "overlap of fingers, a, b",
        "disturbed friction cone, finger.tip, 0",
    )
    broken = verdict._broken([Violation(name=name, amount=1e-4, **units) for name in names])
    assert [text.split(":")[0] for text in broken] == list(names[:2])


def test_what_was_tried_in_vain_is_counted():
    searched = solve._ModelSearch(load(CONFIGS / "pinch.yaml"), Budget())
    assert "No posture touches the object" in searched._verdict.unsolved(None).message
    start = SimpleNamespace(label="scan", contacts={})
    ended = {"iterations": 3, "seconds": 0.1, "objective": 1.0, "badness": 0.5, "start": start}
    tried = SimpleNamespace(attempt=SimpleNamespace(outcome="Stalled", converged=False, **ended))
    searched.search.tried += [tried] * 48
    message = searched._verdict.unsolved(None).message
    assert "48 starting postures were tried; none reached contact and force balance." in message
    assert "Stalled" not in message


def test_violated_constraints_are_reported_in_newtons_and_newton_meters():
    """A grasp in scenes that ask for more: a tendon 2 N weaker, and a mass that lies 3 mm farther out."""
    scene = make_scene("arc", PLANAR, max_tension=60.0)
    search = solve.GraspSearch(scene, Budget())
    search.run()
    tried = search.best
    greatest = tried.arrays["finger.tensions"].max()

    def reported(**changes):
        attempt = tried.solver.unrelaxed(scene.changed(changes), tried.attempt)
        return {violation.name: str(violation) for violation in attempt.violations}

    weak = reported(**{"finger.tendons.max_tension": greatest - 2.0})
    assert weak["tendon tension, finger"] == "tendon tension, finger: violated by 2 N (finger.tendons.max_tension)"
    aside = reported(**{"object.center_of_mass": [0.003, 0.0]})
    moment = f"{1e3 * 0.3 * 9.81 * 0.003:.3g} mN m"
    assert aside["object moment balance"] == f"object moment balance: violated by {moment} (object)"
