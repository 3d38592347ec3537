"""The chain of hinges, run by MuJoCo, against the exact rod; and against closed forms where the rod is straight."""

from __future__ import annotations

import csv
import itertools
import math
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from scipy.linalg import eigh

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.rod import natural_frequencies, solve_elastica
from tests.closed_forms.graded import stepped_frequencies
from tests.graded_rods import CLOSED, FREQUENCIES, RODS, sections
from tests.rods import UNIT, force, rod_scene

mujoco = pytest.importorskip("mujoco")


def test_the_file_is_well_formed_xml(tmp_path):
    """MuJoCo reads comments that the standard forbids."""
    for file in cg.export_mjcf("configs/simulate/hanging.yaml", tmp_path / "chain.xml", hinges=4).files:
        if file.suffix == ".xml":
            assert ElementTree.parse(file).getroot().tag == "mujoco"


def pulled(first, second, **tendon):
    """Two tendons that run alike on both sides."""
    offset = tendon.pop("offset", (0.02, 0.02))
    sides = [{"offset": [sign * e for e in offset], "max_tension": 1.2 * first, **tendon} for sign in (1.0, -1.0)]
    return {"finger": {"tendons": sides, "half_thickness": max(offset)}, "actuation": {"tensions": [first, second]}}


ACROSS, NONE = (0.0, -1.0), (0.0, 0.0)
NOTCHES = [1.0, 0.2] * 25
MANY_STEPS = sections(*[(0.02 * (k + 1), value, 1.0 / value) for k, value in enumerate(NOTCHES)])
"""More jumps than hinges: a tube with notches."""
STRAIGHT = {
    **{name: (rod, FREQUENCIES[name]) for name, rod in CLOSED.items()},
    "fifty notches": (MANY_STEPS, stepped_frequencies([(0.02, value, 1.0 / value) for value in NOTCHES])),
}
"""Rods, and their frequencies [rad/s] when straight."""
BENT = {"breaks": [0.55], "values": [1.5, -3.0]}

SCENES = {
    "uniform, tendons, weight": rod_scene(UNIT, gravity=(-2.0, -1.0), tip_mass=0.2, **pulled(60.0, 5.0)),
    "uniform, inclined tendons": rod_scene(UNIT, gravity=NONE, **pulled(20.0, 2.0, offset=(0.05, 0.01))),
    "cone, tendons to the tip": rod_scene(RODS["cone 0.25"], gravity=ACROSS, **pulled(15.0, 5.0, offset=(0.02, 0.005))),
    "cone, tendons that end inside": rod_scene(
        RODS["cone 0.25"],
        gravity=ACROSS,
        loads=[force(1.0, (0.02, 0.05))],
        **pulled(60.0, 5.0, offset=(0.02, 0.0137), to=0.63),
    ),
    "step, couple and force inside": rod_scene(
        RODS["step"],
        gravity=NONE,
        loads=[{"kind": "moment", "at": 0.31, "moment": 0.5}, force(0.77, (0.1, -0.2), follows=True)],
    ),
    "bent at rest by pieces": rod_scene(
        RODS["step"],
        gravity=(0.1, 0.2),
        finger={"rest_curvature": BENT},
        loads=[force(1.0, (0.05, -0.1))],
    ),
    "chambers inside": rod_scene(
        RODS["step"],
        gravity=ACROSS,
        finger={
            "tendons": None,
            "pressure": [
                {"area": 1e-4, "offset": -0.02, "max_pressure": 1e6, "start": 0.2, "to": 0.75, "stiffness_share": 0.3},
                {"area": 1e-4, "offset": -0.02, "max_pressure": 1e6, "contracts": True, "to": 0.5},
            ],
        },
        actuation={"pressures": [6e5, 2e5]},
    ),
    "fifty notches": rod_scene(MANY_STEPS, gravity=ACROSS, loads=[force(1.0, (0.0, 0.5))]),
}


class Chain:
    """A chain in MuJoCo."""

    def __init__(self, scene, hinges):
        self.chain = cg.export_mjcf(scene, hinges=hinges)
        self.model = mujoco.MjModel.from_xml_string(self.chain.text)
        self.data = mujoco.MjData(self.model)
        self.control = self.chain.controls(0.0)[0]
        self.gravity = self.model.opt.gravity.copy()

    def force(self, q, load=1.0):
        """Generalized force (n,) at rest, under a share of weight and controls."""
        self.data.qpos, self.data.qvel, self.data.ctrl = q, 0.0, load * self.control
        self.model.opt.gravity = load * self.gravity
        mujoco.mj_forward(self.model, self.data)
        return self.data.qfrc_passive + self.data.qfrc_actuator - self.data.qfrc_bias

    def stiffness(self, q, load=1.0):
        step = 1e-6 * np.eye(self.model.nv)
        return np.column_stack([(self.force(q - d, load) - self.force(q + d, load)) / 2e-6 for d in step])

    def equilibrium(self):
        """Newton's method under loads that grow."""
        q = np.zeros(self.model.nv)
        for load in (0.2, 0.4, 0.6, 0.8, *[1.0] * 12):
            q = q + np.linalg.solve(self.stiffness(q, load), self.force(q, load))
        assert np.abs(self.force(q)).max() < 1e-9
        return q

    def frequencies(self, q, count=2):
        stiffness, mass = self.stiffness(q), np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, mass)
        return np.sqrt(eigh(0.5 * (stiffness + stiffness.T), mass, eigvals_only=True)[:count]) / (2.0 * math.pi)

    @property
    def tip(self):
        return self.data.sensor("tip").data[:2].copy()


@pytest.mark.parametrize("name", SCENES)
def test_shapes_and_first_frequency_are_those_of_the_rod(name):
    scene = SCENES[name]
    rod = solve_elastica(scene)
    exact = natural_frequencies(scene.finger, rod, 1)
    off = []
    for hinges in (20, 40):
        chain = Chain(scene, hinges)
        q = chain.equilibrium()
        off.append(np.linalg.norm(chain.tip - rod.tip))
    length = scene.finger.profile.length
    assert off[1] < 0.01 * length
    if name != "fifty notches":  # whose parts per hinge differ from number to number
        assert 3.3 < off[0] / off[1] < 5.0
    # A following load has no energy, and a stiffness that is not symmetric.
    if not any(getattr(load, "follows", False) for load in scene.loads) and name != "fifty notches":
        assert chain.frequencies(q, 1) == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("name", STRAIGHT)
def test_a_straight_chain_has_the_frequencies_of_beam_theory(name):
    rod, exact = STRAIGHT[name]
    off = []
    for hinges in (20, 40):
        chain = Chain(rod_scene(rod, gravity=NONE), hinges)
        found = chain.frequencies(np.zeros(hinges))
        assert chain.chain.first_frequency == pytest.approx(found[0], rel=1e-6)
        off.append(2.0 * math.pi * found / exact - 1.0)
    assert np.abs(off[1][0]) < 0.01
    assert off[0] == pytest.approx(4.0 * off[1], rel=0.3)


def test_a_released_chain_moves_like_the_rod():
    scene = cg.load("configs/simulate/nitinol_release_020g.yaml", {"time.duration": 0.2})
    motion = cg.simulate(scene)
    chain = Chain(scene, 40)
    mujoco.mj_resetDataKeyframe(chain.model, chain.data, 0)
    chain.model.opt.timestep = 1e-4
    tips = []
    for _ in motion.t[1:]:
        mujoco.mj_step(chain.model, chain.data, nstep=10)
        tips.append(chain.tip)
    assert np.abs(np.array(tips) - motion.tip[1:]).max() < 2e-3
    assert np.ptp(motion.tip[:, 1]) > 0.1


def test_the_written_step_is_stable_and_half_as_long_as_what_is_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs there that a motion is unstable
    scene = rod_scene(UNIT, gravity=NONE)
    chain = Chain(scene, 12)
    chain.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    longest = chain.chain.links.longest_step()
    assert chain.chain.timestep <= 0.5 * longest

    def reach(step):
        chain.model.opt.timestep = step
        mujoco.mj_resetData(chain.model, chain.data)
        chain.data.qpos[-1] = 1e-9
        mujoco.mj_step(chain.model, chain.data, nstep=4000)
        return np.abs(chain.data.qpos).max()

    assert reach(0.98 * longest) < 1e-6
    assert not reach(1.02 * longest) < 1e-6


def test_controls_over_time(tmp_path):
    chain = cg.export_mjcf("configs/simulate/tendon_step.yaml", tmp_path / "step.xml", hinges=10)
    assert [file.name for file in chain.files] == ["step.xml", "step.csv"]
    with open(chain.files[1], encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(rows[k]["tendon_1"]) for k in (0, 1000)] == [2.0, 12.0]
    assert rows[50]["time"] == "0.05"
    model = mujoco.MjModel.from_xml_path(str(chain.files[0]))
    assert model.actuator(0).dynprm[0] == pytest.approx(0.04)
    assert model.actuator(0).ctrlrange == pytest.approx([1.0, 60.0])


@pytest.mark.parametrize(("side", "stopped"), [("both", (1, -1)), ("left", (1,)), ("right", (-1,))])
def test_stops_have_the_bilinear_law(side, stopped):
    finger = {"stops": {"curvature": 1.2, "stiffness_ratio": 20.0, "side": side}}
    for sign in (1, -1):
        scene = rod_scene(UNIT, "clothoid", gravity=NONE, finger=finger, actuation={"tip_moment": 2.0 * sign})
        # EI = 1: 2.0 = k + 19 (k - 1.2) beyond the stop.
        bend = sign * ((2.0 + 19.0 * 1.2) / 20.0 if sign in stopped else 2.0)
        chain = Chain(scene, 10)
        assert chain.equilibrium().sum() == pytest.approx(bend, rel=1e-9)


def test_a_body_at_the_tip_is_part_of_the_last_link():
    body = {"mass": 0.7, "rotary_inertia": 0.02, "center_of_mass": [0.1, 0.2]}
    bare, heavy = (Chain(rod_scene(UNIT, "clothoid", finger=f), 6).chain.links for f in ({}, {"tip_body": body}))
    mass = np.array([bare.mass[-1], 0.7])
    places = np.array([[0.0, bare.center[-1]], [0.1, 1.2]])
    center = mass @ places / mass.sum()
    assert (heavy.mass[-1], heavy.across[-1], heavy.center[-1]) == pytest.approx((mass.sum(), *center), rel=1e-12)
    spread = bare.inertia[-1] + 0.02 + mass @ np.sum((places - center) ** 2, axis=1)
    assert heavy.inertia[-1] == pytest.approx(spread, rel=1e-12)
    chain = Chain(rod_scene(UNIT, "clothoid", gravity=NONE, finger={"tip_body": body}), 6)
    assert chain.chain.first_frequency == pytest.approx(chain.frequencies(np.zeros(6), 1)[0], rel=1e-6)


HEAVY = {
    **{name: {"rod": RODS[name]} for name in ("cone 0.25", "step")},
    "uniform": {"rod": UNIT},
    "notches": {"rod": MANY_STEPS},
    "masses near the base and at the tip": {
        "rod": UNIT,
        "masses": [{"at": 0.004, "mass": 0.3}, {"at": 0.51, "mass": 0.2}, {"at": 1.0, "mass": 0.1}],
        "tip_body": {"mass": 0.7, "rotary_inertia": 0.02, "center_of_mass": [0.1, 0.2]},
    },
}


@pytest.mark.parametrize("hinges", [4, 30])
@pytest.mark.parametrize("name", HEAVY)
def test_masses_of_all_bodies_are_the_finger(name, hinges):
    """With the base: mass, center of mass, and inertia about the clamp are integrals of the rod, and its masses."""
    others = {key: value for key, value in HEAVY[name].items() if key != "rod"}
    scene = rod_scene(HEAVY[name]["rod"], "clothoid", finger=others)
    model = Chain(scene, hinges).model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    profile, finger = scene.finger.profile, scene.finger
    weights = [(point.mass, 0.0, point.at, 0.0) for point in finger.masses]
    if (body := finger.tip_body) is not None:
        x, y = body.center_of_mass
        weights.append((body.mass, x, finger.rod.length + y, body.rotary_inertia))
    breaks = [0.0, *profile.breaks, finger.rod.length]
    for start, end in itertools.pairwise(breaks):
        nodes, shares = np.polynomial.legendre.leggauss(12)
        for node, share in zip(nodes, shares, strict=True):
            at, part = 0.5 * (start + end + (end - start) * node), 0.5 * (end - start) * share
            weights.append((part * profile.linear_density(at), 0.0, at, part * profile.rotary_inertia(at)))
    mass, x, y, own = np.array(weights, dtype=float).T
    places = data.xipos[1:, :2] - np.array(finger.base.position)
    turn = finger.base.angle
    axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    places = places @ axes
    assert model.body_mass[1:].sum() == pytest.approx(mass.sum(), rel=1e-9)
    assert model.body_mass[1:] @ places == pytest.approx([mass @ x, mass @ y], rel=1e-9, abs=1e-9)
    turned = [
        mujoco_axes(quaternion) @ np.diag(each) @ mujoco_axes(quaternion).T
        for quaternion, each in zip(model.body_iquat[1:], model.body_inertia[1:], strict=True)
    ]
    about = np.array([tensor[2, 2] for tensor in turned])
    whole = about.sum() + model.body_mass[1:] @ (places**2).sum(axis=1)
    assert whole == pytest.approx(own.sum() + mass @ (x**2 + y**2), rel=1e-9)


def mujoco_axes(quaternion):
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def test_links_of_a_uniform_rod_are_slender():
    """Mass times l^2 / 12 across, and no more about their own axis."""
    model = Chain(rod_scene(UNIT, "clothoid"), 8).model
    length = np.array([1.0 / 16.0, *[1.0 / 8.0] * 7, 1.0 / 16.0])
    mass = model.body_mass[1:]
    assert mass == pytest.approx(mass.sum() * length, rel=1e-9)
    for k, across in enumerate(mass * length**2 / 12.0):
        own, *others = sorted(model.body_inertia[k + 1])
        assert others == pytest.approx([across] * 2, rel=1e-6)
        assert own <= across


def test_positive_tension_on_tendon_one_bends_towards_minus_x():
    chain = Chain(rod_scene(UNIT, gravity=NONE, **pulled(60.0, 5.0)), 20)
    assert chain.equilibrium().sum() == pytest.approx(55.0 * 0.02, rel=1e-9)


def moved(scene, duration):
    """A chain of few links after some time under the controls of its scene."""
    chain = Chain(scene, 12)
    mujoco.mj_resetDataKeyframe(chain.model, chain.data, 0)
    while chain.data.time < duration - 1e-9:
        chain.data.ctrl = chain.chain.controls(chain.data.time)[0]
        mujoco.mj_step(chain.model, chain.data)
    mujoco.mj_forward(chain.model, chain.data)  # a step leaves places as they were at its start
    return chain


@pytest.mark.parametrize(
    ("arrangement", "lengths"),
    [("per_tendon", [0.010, -0.0095]), ("per_tendon", [0.008, -0.012]), ("one_pulley", [0.008])],
)
def test_cables_that_are_wound_up_hold_the_chain_where_they_hold_the_rod(arrangement, lengths):
    """At rest, under weight, with both tendons taut or one slack: the tip and the tensions."""
    changes = {"finger.tendons.friction": 0.0, "actuation": {"lengths": lengths}, "gravity": [0.0, -9.81]}
    changes |= {"finger.tendons.drive.arrangement": arrangement, "initial.pose": "equilibrium"}
    scene = cg.load("configs/simulate/winch_loop.yaml", changes)
    rod = solve_elastica(scene)
    model = mujoco.MjModel.from_xml_string(cg.export_mjcf(scene, hinges=30).text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, nstep=round(0.5 / model.opt.timestep))
    mujoco.mj_forward(model, data)
    assert data.sensordata[:2] == pytest.approx(rod.tip, abs=1e-3 * 0.18)
    assert np.abs(data.qvel).max() < 1e-3
    assert data.actuator_force == pytest.approx(rod.equations.tensions(rod.nodal_curvature), abs=0.02)


@pytest.mark.deep
def test_a_finger_comes_to_rest_against_a_disc():
    scene = cg.load("configs/simulate/swing_against_disc.yaml")
    chain = moved(scene, 1.0)
    assert chain.data.ncon > 0
    # It touches with all of its length, the scene's finger at two stations.
    assert chain.tip == pytest.approx(cg.simulate(scene).tip[-1], abs=2e-3)


SHAPES = {
    "circle": ({"shape": "circle", "diameter": 0.2}, 0.1),
    "stadium": ({"shape": "stadium", "length": 0.3, "radius": 0.05}, 0.05),
    "box": ({"shape": "box", "width": 0.3, "height": 0.16}, 0.08),
    "ellipse": ({"shape": "ellipse", "width": 0.3, "height": 0.12}, 0.06),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_an_object_falls_and_rests_on_a_wall(shape):
    fields, height = SHAPES[shape]
    scene = rod_scene(
        UNIT,
        gravity=(0.0, -10.0),
        object={**fields, "mass": 2.0, "position": [3.0, -0.6]},
        object_moves=True,
        supports={"floor": {"type": "palm", "point": [0.0, -1.0], "normal_angle": 0.5 * math.pi}},
        contact_law={"stiffness": 1e4, "friction": 0.3},
        time={"duration": 1.0, "step": 0.001},
        initial={"pose": "straight"},
    )
    falling, resting = moved(scene, 0.1), moved(scene, 1.0)
    h = falling.model.opt.timestep
    assert falling.data.body("object").xpos[1] == pytest.approx(-0.6 - 5.0 * 0.1 * (0.1 + h), abs=1e-9)
    assert resting.data.body("object").xpos[:2] == pytest.approx([3.0, height - 1.0], abs=2e-3)
    assert resting.data.ncon > 0


@pytest.mark.parametrize(
    ("config", "changes", "key"),
    [
        ("hold_mug", {}, "out_of_plane_gravity"),
        ("tendon_step", {"finger.tendons.friction": 0.1}, "finger.tendons"),
        ("motor_pulley", {"finger.tendons.friction": 0.0}, "finger.tendons.drive.kind: the export has no motors"),
        ("tendon_step", {"finger.damping.quadratic": 1e-4}, "finger.damping.quadratic"),
        ("tendon_step", {"finger.damping.dry_friction": [{"stiffness": 1, "moment": 1}]}, "dry_friction: .* creeps"),
    ],
)
def test_what_a_chain_cannot_have_is_refused(config, changes, key):
    with pytest.raises(InputError, match=key):
        cg.export_mjcf(cg.load(f"configs/simulate/{config}.yaml", changes))


def test_too_few_and_too_many_hinges_are_refused():
    scene = SCENES["cone, tendons that end inside"]
    with pytest.raises(InputError, match="hinges: expected at least 2"):
        cg.export_mjcf(scene, hinges=1)
    thin = cg.load("configs/simulate/hanging.yaml", {"finger.rod.diameter": 1e-4, "finger.masses": []})
    with pytest.raises(InputError, match="use fewer"):
        cg.export_mjcf(thin, hinges=1000)


# -- objects in the plane that are not convex --------------------------------------------------------------------------

SLOT = [[0, 0], [0.3, 0], [0.3, 0.2], [0.22, 0.2], [0.22, 0.06], [0.09, 0.06], [0.09, 0.2], [0, 0.2]]
CUT = [[round(0.2 * math.cos(t), 6), round(0.2 * math.sin(t), 6)] for t in np.arange(0.4, 2.0 * math.pi - 0.39, 0.05)]
PLANE = {
    "a slot": ({"shape": "polygon", "vertices": SLOT}, shapely.Polygon(SLOT)),
    "a slot, mirrored": (
        {"shape": "polygon", "vertices": [[-x, y] for x, y in SLOT[::-1]]},
        shapely.Polygon([(-x, y) for x, y in SLOT]),
    ),
    "a ring that is open": (
        {"shape": "polygon", "vertices": [*CUT, *[[0.7 * x, 0.7 * y] for x, y in CUT[::-1]]]},
        shapely.Polygon([*CUT, *[(0.7 * x, 0.7 * y) for x, y in CUT[::-1]]]),
    ),
    "a mug with its handle": (
        {
            "shape": "union",
            "center_of_mass": [0.0, 0.0],
            "members": [
                {"shape": "circle", "diameter": 0.2},
                {"shape": "stadium", "length": 0.3, "radius": 0.03, "position": [0.2, 0.02], "angle": 0.4},
                {"shape": "polygon", "vertices": SLOT, "position": [-0.35, -0.1], "angle": -0.2},
            ],
        },
        shapely.union_all([
            shapely.Point(0.0, 0.0).buffer(0.1, 256),
            shapely.affinity.translate(
                shapely.affinity.rotate(shapely.LineString([(-0.15, 0), (0.15, 0)]), 0.4, (0, 0), use_radians=True),
                0.2, 0.02,
            ).buffer(0.03, 256),
            shapely.affinity.translate(
                shapely.affinity.rotate(shapely.Polygon(SLOT), -0.2, (0, 0), use_radians=True), -0.35, -0.1
            ),
        ]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", PLANE)
def test_objects_in_the_plane_collide_as_what_they_are(name):
    """Shapely's distances from the outline, at points outside of it where a finger may be."""
    fields, outline = PLANE[name]
    scene = rod_scene(
        UNIT,
        gravity=NONE,
        object={**fields, "mass": 2.0, "position": [3.0, -0.6], "angle": 0.7},
        object_moves=True,
        time={"duration": 1.0, "step": 0.001},
        initial={"pose": "straight"},
        contact_law={"stiffness": 1e4, "friction": 0.3},
    )
    ball = '<body name="probe" mocap="true"><geom type="sphere" size="0.02" contype="1" conaffinity="0" margin="0.2"/>'
    text = cg.export_mjcf(scene, hinges=4).text.replace("</worldbody>", f"{ball}</body></worldbody>")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    assert model.body("object").mass[0] == 2.0
    turn = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    checked = 0
    for point in np.random.default_rng(2).uniform(-0.5, 0.5, (80, 2)):
        distance = outline.distance(shapely.Point(point))
        if not 0.005 < distance < 0.15:
            continue
        data.mocap_pos[0, :2] = turn @ point + [3.0, -0.6]
        mujoco.mj_forward(model, data)
        near = min(c.dist for c in data.contact if model.body("probe").id in model.geom_bodyid[c.geom])
        assert near + 0.02 == pytest.approx(distance, abs=5e-4)
        checked += 1
    assert checked > 8
