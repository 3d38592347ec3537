"""A finger and its object as one system: what it shares with the finger's model, and the laws of mechanics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime, brentq

from continuum_grasp.base import InputError
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene import (
    BasePose,
    Box,
    Circle,
    ContactLaw,
    Ellipse,
    Finger,
    Line,
    MomentLoad,
    Palm,
    Point,
    PointMass,
    Polygon,
    Rod,
    Stadium,
    Superellipse,
    Surroundings,
    Tendons,
    VGroove,
)
from tests.finger_cases import energy_rate
from tests.marks import few
from tests.truth.differences import differences

FAMILIES = ("arc", "clothoid", "matched_clothoid")
ROD = Rod(length=0.2, linear_density=0.04, bending_stiffness=8e-3, rotary_inertia=2e-6, diameter=0.002)
BASE = BasePose(position=(0.02, -0.01), angle=-1.2)
DRIVE = Tendons(offset=0.005, max_tension=60.0, time_constant=0.02)
AT = (0.08, 0.14)
PLACED = {"mass": 0.2, "position": (0.1, 0.07), "angle": 0.4}
SHAPES = {
    "disc": Circle(shape="circle", diameter=0.06, **PLACED),
    "eccentric": Circle(shape="circle", diameter=0.06, center_of_mass=(0.01, -0.005), **PLACED),
    "box": Box(shape="box", width=0.07, height=0.05, corner_radius=0.004, **PLACED),
    "polygon": Polygon(shape="polygon", vertices=((-0.03, -0.02), (0.04, -0.02), (0.0, 0.04)), **PLACED),
    "stadium": Stadium(shape="stadium", length=0.04, radius=0.02, **PLACED),
    "ellipse": Ellipse(shape="ellipse", width=0.08, height=0.05, **PLACED),
    "superellipse": Superellipse(shape="superellipse", width=0.08, height=0.05, exponent=4.0, **PLACED),
}
LAW = ContactLaw(stiffness=900.0, friction=0.6, dissipation=2.0, rounding=1e-3, presliding=5e-4)
CONSERVATIVE = LAW.model_copy(update={"friction": 0.0, "dissipation": 0.0})


def finger(**keys) -> Finger:
    return Finger(rod=ROD, base=BASE, half_thickness=0.006, masses=(PointMass(at=0.2, mass=0.003),), **keys)


def system(item, *, law=LAW, given=None, family="matched_clothoid", gravity=(0.6, -2.0), **around) -> System:
    surroundings = Surroundings(object=item, contact_law=law, **{"object_moves": True, **around})
    return System(given or finger(), surroundings=surroundings, contacts=AT, family=family, elements=3, gravity=gravity)


def shape_of(family: str, seed: int) -> np.ndarray:
    """Bending coordinates."""
    return (0.3 if family == "arc" else 4.0) * np.random.default_rng(seed).uniform(0.6, 1.4, 4)


def pressed_on(name: str, family: str, seed: int):
    """The object against the second station of the bent finger, pressed in by 1.5 mm."""
    rng = np.random.default_rng(seed)
    alone = System(finger(), contacts=AT, family=family, elements=3)
    station = numbers(alone.sections([AT[1]])(alone.state(shape_of(family, seed)[: alone.n]), [0.0], [])[0])
    turn, way = rng.uniform(0.0, math.tau), rng.uniform(0.0, math.tau)

    def at(reach: float):
        position = (station[0] + reach * math.cos(way), station[1] + reach * math.sin(way))
        return SHAPES[name].model_copy(update={"position": position, "angle": turn})

    wanted = finger().half_thickness - 0.0015
    return at(brentq(lambda reach: at(reach).distance(tuple(station)) - wanted, 0.0, 0.3))


def supports_of(item) -> dict:
    """A support of each kind, pressed into the object by 1 mm."""

    def face(turn: float, depth: float = 0.001) -> tuple[float, float]:
        reach = max(part.support(turn + math.pi - item.angle) for part in item.parts) - depth
        return item.position[0] - reach * math.cos(turn), item.position[1] - reach * math.sin(turn)

    def beside(way: float, size: float) -> tuple[float, float]:
        return item.position[0] + size * math.cos(way), item.position[1] + size * math.sin(way)

    x, y = face(2.0)
    across = (0.02 * math.sin(2.0), -0.02 * math.cos(2.0))
    size = brentq(lambda size: item.distance(beside(4.0, size)) - 0.004, 0.0, 0.2)
    return {
        "palm": Palm(point=face(0.3), normal_angle=0.3),
        "edge": Line(type="line", start=(x - across[0], y - across[1]), end=(x + across[0], y + across[1])),
        "peg": Point(type="point", position=beside(4.0, size), radius=0.005),
        "groove": VGroove(type="v_groove", apex=face(1.4, 0.008), opening_angle=1.8, axis_angle=1.4),
    }


def moving(model: System, seed: int, speed: float = 1.0) -> np.ndarray:
    """A state of the bent finger and its object, with random velocities and friction."""
    rng, family, n = np.random.default_rng(seed + 100), model.finger_model.family, model.n
    rates = speed * (1.0 if family == "arc" else 15.0) * rng.normal(size=n)
    x = np.array(model.state(shape_of(family, seed)[:n], rates))
    body = slice(model.object_states.stop, model.friction_states.start)
    x[body] = 0.1 * speed * rng.normal(size=body.stop - body.start)
    z = model.friction_states
    x[z] = rng.uniform(-0.6, 0.6, z.stop - z.start)
    return x


def numbers(value) -> np.ndarray:
    return np.array(value).squeeze()


def touch(model: System, x: np.ndarray) -> dict[str, np.ndarray]:
    found = model.touch(x, np.zeros(model.nu), np.zeros(model.nw), [])
    return {name: np.array(v) for name, v in zip(model.touch.name_out(), found, strict=True)}


def rate(model: System, x: np.ndarray, u=0.0, w=None) -> np.ndarray:
    forces = np.zeros(model.nw) if w is None else w
    return numbers(model.forward_dynamics(x, np.zeros(model.nu) + u, forces, model.p_nominal))


# without an object


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("drive", [None, DRIVE])
def test_without_an_object_the_system_is_the_finger_instruction_by_instruction(family, drive):
    keys = {"contacts": AT, "family": family, "elements": 3, "parameters": ("tip_mass",)}
    alone, own = System(finger(tendons=drive), **keys), FingerModel(finger(tendons=drive), **keys)
    for name in ("forward_dynamics", "linearization"):
        one, two = getattr(alone, name), getattr(own, name)
        assert one.n_instructions() == two.n_instructions()
        arguments = [np.linspace(0.1, 1.0, one.numel_in(k)) for k in range(4)]
        assert all(
            np.array_equal(np.array(a), np.array(b))
            for a, b in zip(one.call(arguments), two.call(arguments), strict=True)
        )
    assert (alone.x_names, alone.u_names, alone.w_names) == (own.x_names, own.u_names, own.w_names)
    assert (alone.p_names, alone.p_nominal, alone.nx, alone.np) == (own.p_names, own.p_nominal, own.nx, own.np)
    assert alone.touch_names == []
    assert [v.shape for v in alone.touch.call([0.0] * 4)[:4]] == [(0, 1)] * 4


@pytest.mark.parametrize("family", FAMILIES)
def test_positions_follow_the_moment_that_acts_not_the_one_that_is_commanded(family):
    """The finger's model is given tensions that command what the lag has."""
    model = System(finger(tendons=DRIVE), family=family, elements=3)
    own, u = model.finger_model, [11.0, 3.0]
    x = model.state(q=np.linspace(0.5, 1.5, model.n), u=u)
    assert x[-2:] == [0.04, 0.0]
    q, elsewhere = x[: model.n], [0.0, 30.0]
    stations = [0.0, 0.03, 0.1, 0.171, 0.2]
    r, angle = (np.array(v) for v in model.sections(stations)(x, elsewhere, []))
    for k, s in enumerate(stations):
        assert r[:, k] == pytest.approx(numbers(own.position(q, u, s, [])), abs=1e-6)
        assert angle[k, 0] == pytest.approx(float(own.orientation(q, u, s, [])), abs=1e-9)
    for name in ("tip", "bending", "range_use"):
        assert numbers(getattr(model, name)(x, elsewhere, [])) == pytest.approx(
            numbers(getattr(own, name)(q, u, [])), rel=1e-12
        )
    assert model.energy(x, elsewhere, [])[1] == pytest.approx(float(own.energy(x, elsewhere, [])[1]), rel=1e-12)


@pytest.mark.parametrize("family", FAMILIES)
def test_curvatures_are_the_slopes_of_the_angle(family):
    model = System(finger(), family=family, elements=2)
    x, u, step = model.state(q=np.linspace(0.4, 1.1, model.n)), [0.006], 1e-5
    kappa = numbers(model.curvature(x, u, []))
    nodes = [0.05, 0.15] if family == "arc" else [step, 0.1, 0.2 - step]
    for s, value in zip(nodes, kappa, strict=True):
        near = np.array(model.sections([s - step, s + step])(x, u, [])[1]).ravel()
        assert (near[1] - near[0]) / (2 * step) == pytest.approx(value, rel=1e-3)


# names and states


def test_names_and_sizes_fit_together():
    supports = supports_of(SHAPES["box"])
    model = system(SHAPES["box"], supports=supports, given=finger(tendons=DRIVE), out_of_plane_gravity=9.81)
    corners = [f".{k}" for k in range(1, 5)]
    walls = [f"{wall}{corner}" for wall in ("palm", "edge") for corner in corners]
    groove = [f"groove.{side}{corner}" for side in ("left", "right") for corner in corners]
    names = ["finger.1", "finger.2", "finger.tip", *walls, "edge.start", "edge.end", *groove, "peg"]
    assert sorted(model.touch_names) == sorted(names)
    assert model.touch_names[:3] == names[:3]
    assert len(model.x_names) == model.nx == model.forward_dynamics.numel_in(0) == model.forward_dynamics.numel_out(0)
    assert len(model.w_names) == model.nw == model.forward_dynamics.numel_in(2)
    assert model.w_names[-3:] == ["object_force_x [N]", "object_force_y [N]", "object_moment [N m]"]
    assert model.x_names[model.object_states] == ["object_x [m]", "object_y [m]", "object_angle [rad]", "object_z [m]"]
    assert model.x_names[model.friction_states] == [
        f"{name}.{way} [1]" for name in model.touch_names for way in ("slide", "climb")
    ]
    assert model.state()[model.object_states] == [0.1, 0.07, 0.4, 0.0]
    assert model.state(pose=[0.0, 1.0, 2.0])[model.object_states] == [0.0, 1.0, 2.0, 0.0]
    for wrong in ({"q": [1.0]}, {"pose": [0.0] * 5}, {"u": [math.nan, 0.0]}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            model.state(**wrong)


@pytest.mark.parametrize(
    ("around", "words"),
    [
        ({"contact_law": None}, "contact_law is missing"),
        ({"object": None, "supports": {}}, "contact_law: has no effect without an object"),
        (
            {"supports": {"palm": Palm(point=(0.0, 0.0), normal_angle=0.0)}},
            "supports: has no effect on a fixed object",
        ),
        ({"out_of_plane_gravity": 9.81}, "out_of_plane_gravity: has no effect on a fixed object"),
        ({"object": Circle(shape="circle", diameter=0.1, mass=0.0, position=(0.0, 0.0)), "object_moves": True}, "mass"),
    ],
)
def test_surroundings_that_make_no_sense_are_refused(around, words):
    with pytest.raises(InputError, match=words):
        Surroundings(**{"object": SHAPES["disc"], "contact_law": LAW, **around})


def test_the_moment_of_inertia_of_even_shapes():
    """Of a disc, a rectangle about its center, and the rectangle about a center of mass beside it."""
    for item, expected in (
        (SHAPES["disc"], 0.5 * 0.2 * 0.03**2),
        (SHAPES["eccentric"], 0.2 * (0.5 * 0.03**2 + 0.01**2 + 0.005**2)),
        (Box(shape="box", width=0.07, height=0.05, **PLACED), 0.2 * (0.07**2 + 0.05**2) / 12),
        # A rectangle and two half discs: the second moments of each about the middle, over the area.
        (
            SHAPES["stadium"],
            0.2
            * (0.04 * 0.04 * (0.04**2 + 0.04**2) / 12 + math.pi * (0.02**4 / 2 + 0.02**4) + 4 / 3 * 0.04 * 0.02**3)
            / (0.04 * 0.04 + math.pi * 0.02**2),
        ),
        (SHAPES["ellipse"], 0.2 * (0.04**2 + 0.025**2) / 4),
    ):
        assert Surroundings(object=item, contact_law=LAW, object_moves=True).inertia == pytest.approx(
            expected, rel=1e-4
        )
    stated = Surroundings(object=SHAPES["disc"], contact_law=LAW, object_moves=True, moment_of_inertia=0.7)
    assert stated.inertia == 0.7


# mechanics


@pytest.mark.parametrize("family", FAMILIES)
def test_action_is_reaction(family):
    """The finger alone under what it bears, and the rigid body alone, both by other means, move like the system.

    A couple on the matched tip would be an input; it has none.
    """
    model = system(pressed_on("eccentric", family, 1), family=family, out_of_plane_gravity=3.0)
    x = moving(model, 1)
    found, xd, n = touch(model, x), rate(model, x), model.n
    assert found["normal_force"].max() > 0.5
    assert np.abs(found["friction"]).max() > 0.02
    assert np.abs(found["lift"]).max() > 0.1
    places = [*AT, ROD.length][: 2 if family == "matched_clothoid" else 3]
    own = FingerModel(
        finger(),
        contacts=AT,
        family=family,
        elements=3,
        gravity=(0.6, -2.0),
        loads=[MomentLoad(at=s, moment=0.0) for s in places],
        input_rates=False,
    )
    centers = np.array(model.sections([*AT, ROD.length])(x, [0.0], [])[0])
    lever, on_finger = found["point"] - centers, -found["force"]
    couples = lever[0] * on_finger[1] - lever[1] * on_finger[0]
    assert np.linalg.norm(lever, axis=0) == pytest.approx([0.006] * 3)
    w = np.zeros(own.nw)
    w[:6] = on_finger.T.ravel()
    u = np.zeros(own.nu)
    for couple, (vector, at) in zip(couples, own.load_entries, strict=False):
        (u if vector == "u" else w)[at] = couple
    alone = numbers(own.forward_dynamics(x[: 2 * n], u, w, []))
    assert xd[: 2 * n] == pytest.approx(alone, rel=1e-9)

    pose = model.object_states
    angle, spin = x[pose.start + 2], x[pose.stop + 2]
    c, s = math.cos(angle), math.sin(angle)
    arm = np.array([[c, -s], [s, c]]) @ [0.01, -0.005]
    ax, ay, turning, climbing = xd[pose.stop : pose.stop + 4]
    center = np.array([ax, ay]) + turning * np.array([-arm[1], arm[0]]) - spin**2 * arm
    away = found["point"] - (x[pose.start : pose.start + 2] + arm)[:, None]
    inertia = 0.2 * (0.5 * 0.03**2 + 0.01**2 + 0.005**2)
    assert 0.2 * (center - [0.6, -2.0]) == pytest.approx(found["force"].sum(axis=1), rel=1e-9)
    assert inertia * turning == pytest.approx(
        np.sum(away[0] * found["force"][1] - away[1] * found["force"][0]), rel=1e-4
    )
    assert 0.2 * (climbing + 3.0) == pytest.approx(found["lift"].sum(), rel=1e-9)


def power(model: System, x: np.ndarray) -> float:
    """Rate of the total energy along the motion."""
    return energy_rate(model, np.zeros(model.nu))(x, rate(model, x))


@pytest.mark.parametrize(
    ("shape", "family"),
    few([*(("disc", family) for family in FAMILIES), *((shape, "matched_clothoid") for shape in list(SHAPES)[1:])], 5),
)
def test_without_friction_and_damping_contacts_keep_the_energy(shape, family):
    """Gaps, normals, points and forces fit together, for every shape; with supports and a fixed object too."""
    for seed, kind in enumerate(({}, {"object_moves": False}, {"supports": True}, {"out_of_plane_gravity": 2.0})):
        item = pressed_on(shape, family, seed)
        around = {"supports": supports_of(item)} if "supports" in kind else kind
        model = system(item, law=CONSERVATIVE, family=family, **around)
        x = moving(model, seed)
        forces = touch(model, x)["normal_force"]
        assert np.count_nonzero(forces > 0.1) >= (5 if "supports" in around else 1)
        passing = forces.sum() * np.abs(x[model.n :]).max()  # power that goes through the contacts
        assert abs(power(model, x)) <= 1e-8 * passing


@pytest.mark.parametrize("family", FAMILIES)
def test_friction_and_dissipation_take_energy_and_never_give_any(family):
    law = ContactLaw(stiffness=900.0, friction=0.6, dissipation=2.0, rounding=1e-3, slip_speed=0.01)
    item = pressed_on("polygon", family, 0)
    model = system(item, law=law, family=family, supports=supports_of(item), out_of_plane_gravity=2.0)
    lost = [power(model, moving(model, 0, speed)) for speed in (0.01, 0.1, 0.3, 1.0, -0.01, -0.1, -0.3, -1.0)]
    assert max(lost) < 0.0
    assert min(lost) < -1e-2


@pytest.mark.parametrize("family", FAMILIES)
def test_linearization_is_the_slope_of_the_dynamics(family):
    item = pressed_on("superellipse", family, 5)
    model = system(item, family=family, supports=supports_of(item), out_of_plane_gravity=2.0)
    x = moving(model, 5)
    a, b = (np.array(v) for v in model.linearization(x, [0.0], np.zeros(model.nw), []))
    slope = differences(lambda x: rate(model, x), x, 1e-7 * np.maximum(1.0, np.abs(x)))
    assert a == pytest.approx(slope, rel=2e-4, abs=2e-5 * np.abs(a).max())
    moments = approx_fprime(np.zeros(1), lambda u: rate(model, x, u[0]), 1e-5)
    assert b[:, 0] == pytest.approx(moments.ravel(), rel=1e-4, abs=1e-4 * np.abs(b).max())


def test_pressing_is_a_shift_of_the_gaps():
    """A disc that is larger by what is pressed has the same contacts, but for where on the surface they are."""
    item = pressed_on("disc", "clothoid", 2)
    larger = item.model_copy(update={"diameter": 0.064})
    model = system(item, family="clothoid", object_moves=False)
    x = moving(model, 2, speed=0.0)
    pressed = np.array(model.pressed_linearization(x, [0.0], np.zeros(model.nw), [], [0.002] * 3))
    other = system(larger, family="clothoid", object_moves=False)
    true = np.array(other.linearization(x, [0.0], np.zeros(model.nw), [])[0])
    assert np.abs(pressed - true).max() <= 1e-9 * np.abs(true).max()
    assert pressed != pytest.approx(np.array(model.linearization(x, [0.0], np.zeros(model.nw), [])[0]), rel=1e-3)


def test_weights_and_wrenches_move_a_free_body_as_they_should():
    """Far from everything: free fall, and a wrench about the center of mass."""
    model = system(SHAPES["eccentric"], out_of_plane_gravity=9.81)
    x = np.array(model.state(pose=[5.0, 5.0, 0.4]))
    pose = model.object_states
    assert rate(model, x)[pose.stop : pose.stop + 4] == pytest.approx([0.6, -2.0, 0.0, -9.81])
    w = np.zeros(model.nw)
    w[-1] = 1e-4
    turning = 1e-4 / (0.2 * (0.5 * 0.03**2 + 0.01**2 + 0.005**2))
    arm = np.array([[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]]) @ [0.01, -0.005]
    expected = [0.6 + turning * arm[1], -2.0 - turning * arm[0], turning, -9.81]
    assert rate(model, x, w=w)[pose.stop : pose.stop + 4] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("family", few(("arc", "clothoid"), 1))
def test_a_share_of_the_friction_pushes_where_the_disc_touches(family):
    item = pressed_on("disc", family, 1)
    around = Surroundings(object=item, contact_law=LAW.model_copy(update={"dissipation": 0.0}))
    model = System(
        finger(),
        surroundings=around,
        contacts=AT,
        family=family,
        elements=3,
        object_parameters=("contact_friction_2",),
    )
    assert model.p_names == ["contact_friction_2 [1]"]
    share, u, w = -0.4, [0.0], np.zeros(model.nw)
    n, x = model.n, np.array(model.state(shape_of(family, 1)[: model.n]))
    _, normal, friction, _, force, _, out = (numbers(value) for value in model.touch(x, u, w, [share]))
    assert friction[1] == pytest.approx(share * LAW.friction * normal[1])
    away = out[:, 1]
    tangent = np.array([-away[1], away[0]])
    assert -force[:, 1] == pytest.approx(normal[1] * away + friction[1] * tangent)
    # Virtual work: the point of the disc that touches moves with its center and turns with its section.
    sections = model.sections([AT[1]])

    def touching(q):
        center, angle = (numbers(value) for value in sections(np.concatenate([q, x[n:]]), u, [share]))
        turn = float(angle) - float(numbers(sections(x, u, [share])[1]))
        lever = -float(finger().half_thickness) * away
        c, s = math.cos(turn), math.sin(turn)
        return center + np.array([[c, -s], [s, c]]) @ lever

    moved = np.array([approx_fprime(x[:n], lambda q, k=k: touching(q)[k], 1e-7) for k in range(2)])
    mass = numbers(model.internal(x, u, [share])[0])
    rates = [numbers(model.forward_dynamics(x, u, w, [given]))[n : 2 * n] for given in (share, 0.0)]
    assert mass @ (rates[0] - rates[1]) == pytest.approx(moved.T @ (friction[1] * tangent), rel=1e-5)


def test_a_share_of_no_friction_is_refused():
    law = LAW.model_copy(update={"friction": 0.0})
    around = Surroundings(object=SHAPES["disc"], contact_law=law)
    with pytest.raises(InputError, match=r"contact_law\.friction"):
        System(finger(), surroundings=around, contacts=AT, object_parameters=("contact_friction_tip",))
    around = Surroundings(object=SHAPES["disc"], contact_law=LAW)
    with pytest.raises(InputError, match="contact_friction_2"):
        System(finger(), surroundings=around, contacts=AT, object_parameters=("contact_friction_3",))
