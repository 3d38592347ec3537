"""Grasps made by hand: straight fingers in closed form, wrapped ones with forces by linear programming.

The backbone is integrated here, virtual displacements are differences; nothing of the package's mechanics is used.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.optimize import linprog

from continuum_grasp.scene import (
    BasePose,
    Box,
    Circle,
    Fidelity,
    Freedom,
    GraspContacts,
    GraspFinger,
    GraspScene,
    Line,
    Palm,
    Point,
    PointMass,
    Rod,
    Tendons,
    Union,
    VGroove,
)

X, W = np.polynomial.legendre.leggauss(40)
X60, W60 = np.polynomial.legendre.leggauss(60)
PLANAR = (0.0, -9.81, 0.0)
INTO_PLANE = (0.0, 0.0, -9.81)
WEIGHTLESS = (0.0, 0.0, 0.0)
LENGTH, STIFFNESS, OFFSET, HALF = 0.2, 0.01, 0.005, 0.006
UP, DOWN, RIGHT, LEFT = (np.array(v, dtype=float) for v in ((0, 1), (0, -1), (1, 0), (-1, 0)))


def make_finger(position=(0.0, 0.0), angle=0.0, half=HALF, **changes):
    """A finger that, straight, points along its base's y axis; its own weight is next to nothing."""
    values = {
        "rod": Rod(length=LENGTH, linear_density=1e-12, bending_stiffness=STIFFNESS),
        "half_thickness": half,
        "tendons": Tendons(offset=OFFSET, max_tension=60.0),
        "base": BasePose(position=tuple(map(float, position)), angle=float(angle)),
        **changes,
    }
    return GraspFinger(**values)


def make_scene(fingers, body, contacts=None, gravity=WEIGHTLESS, family="matched_clothoid", elements=2, **more):
    """A scene whose contacts are tips alone unless something else is given."""
    contacts = {"friction": 0.5, "normal_force_max": 50.0, "middle": "off", **(contacts or {})}
    one = {"finger": fingers} if isinstance(fingers, GraspFinger) else {"fingers": fingers}
    return GraspScene(
        **one,
        object=body,
        contacts=GraspContacts(**contacts),
        gravity=gravity,
        fidelity=Fidelity(family=family, elements=elements),
        **more,
    )


def bent(base, ends, lengths, s):
    """Positions and angles (K, 3) at places s along a rod of linear curvatures ``ends`` (N, 2) per element."""
    x, y, phi = base
    start, rows = 0.0, {}
    for (a, b), length in zip(ends, lengths, strict=True):

        def walk(u, phi=phi, a=a, b=b, length=length):
            v = 0.5 * u * (X + 1)
            angle = phi + a * v + (b - a) * v**2 / (2 * length)
            w = 0.5 * u * W
            return -(np.sin(angle) @ w), np.cos(angle) @ w, phi + a * u + (b - a) * u**2 / (2 * length)

        for place in s:
            if start - 1e-12 <= place <= start + length + 1e-12 and place not in rows:
                dx, dy, angle = walk(place - start)
                rows[place] = (x + dx, y + dy, angle)
        dx, dy, phi = walk(length)
        x, y, start = x + dx, y + dy, start + length
    return np.array([rows[place] for place in s])


def ends_of(family, q, lengths, tip):
    """Curvatures at both ends of each element."""
    if family == "arc":
        return [(k / length, k / length) for k, length in zip(q, lengths, strict=True)]
    nodes = [*q, tip] if family == "matched_clothoid" else list(q)
    return list(pairwise(nodes))


def shapes_of(family, lengths):
    """Curvature of each arc, or at both ends of each clothoid, per coordinate and, where it is none, the tip's."""
    if family == "arc":
        return np.diag(1.0 / lengths)[:, None]
    nodes = np.eye(len(lengths) + 1)
    return np.stack([nodes[:-1], nodes[1:]], axis=1)


def finger_arrays(scene, name, q=None, lengths=None, tip=0.0, tensions=(0.0, 0.0), base=None):
    """Stored arrays of one finger; straight and of equal elements unless something else is given."""
    setup = next(s for s in scene.setups if s.name == name)
    n = setup.elements
    lengths = np.full(n, setup.finger.rod.length / n) if lengths is None else np.asarray(lengths, dtype=float)
    q = np.zeros(n + (setup.family == "clothoid")) if q is None else np.asarray(q, dtype=float)
    base = (*setup.finger.base.position, setup.finger.base.angle) if base is None else base
    ends = ends_of(setup.family, q, lengths, tip)
    s = np.append(np.linspace(0.0, lengths.sum(), 61)[:-1], lengths.sum())
    backbone = np.column_stack([s, bent(base, ends, lengths, s)])
    return {
        f"{name}.family": setup.family,
        f"{name}.q": q,
        f"{name}.curvature_shapes": shapes_of(setup.family, lengths),
        f"{name}.lengths": lengths,
        f"{name}.tip_curvature": float(ends[-1][1]),
        f"{name}.tensions": np.asarray(tensions, dtype=float),
        f"{name}.base": np.asarray(base, dtype=float),
        f"{name}.backbone": backbone,
    }


def contact_arrays(contacts):
    """Stored arrays of contacts (name, position, normal, (N, f, lift), station, part)."""
    names, positions, normals, forces, stations, parts = zip(*contacts, strict=True)
    return {
        "contact_names": np.array(names),
        "contact_positions": np.array(positions, dtype=float),
        "contact_normals": np.array(normals, dtype=float),
        "contact_forces": np.array(forces, dtype=float),
        "contact_stations": np.array(stations, dtype=float),
        "contact_parts": np.array(parts),
    }


def stored(scene, fingers, contacts, pose=None):
    """All stored arrays; ``fingers``: name to keywords of `finger_arrays`."""
    arrays = {"object.pose": np.array(scene.object.pose if pose is None else pose, dtype=float)}
    for name, values in fingers.items():
        arrays |= finger_arrays(scene, name, **values)
    arrays |= contact_arrays(contacts)
    return arrays | {f"{name}.base_moment": base_moment(scene, arrays, name) for name in fingers}


def base_moment(scene, arrays, name):
    """Moment (3,) in the base of a planar finger that bears its contacts and its weight, by statics alone."""
    finger, base = scene.named_fingers[name], arrays[f"{name}.base"]
    s, *line, _ = arrays[f"{name}.backbone"].T
    gravity = np.array(scene.gravity[:2])
    loads = [
        (place, n * normal + f * np.array([-normal[1], normal[0]]))
        for contact, place, normal, (n, f, _) in zip(
            *(arrays[f"contact_{key}"] for key in ("names", "positions", "normals", "forces")), strict=True
        )
        if str(contact).startswith(f"{name}.")
    ]
    loads += [(np.array([np.interp(m.at, s, x) for x in line]), m.mass * gravity) for m in finger.masses]
    middle = np.diff(s)[:, None] * 0.5 * (np.array(line).T[1:] + np.array(line).T[:-1])
    center = middle.sum(axis=0) / s[-1]
    loads.append((center, float(finger.profile.linear_density.integral()) * gravity))
    return np.array(
        [
            0.0,
            0.0,
            sum(float((place[0] - base[0]) * force[1] - (place[1] - base[1]) * force[0]) for place, force in loads),
        ]
    )


NONE = float("nan")
PALMS = {
    name: Palm(point=(0.4, side * 0.02), normal_angle=-side * math.pi / 2)
    for name, side in (("below", -1.0), ("above", 1.0))
}
BOX = Box(shape="box", width=0.04, height=0.04, mass=0.0, position=(0.4, 0.0))
BETWEEN = [
    (f"{name}.{k}", (x, y), n, (1.0, 0, 0), NONE, 0)
    for name, y, n in (("below", -0.02, DOWN), ("above", 0.02, UP))
    for k, x in ((1, 0.38), (2, 0.42))
]
"""A box without weight that two palms hold, and its contacts."""


def apart(fingers=None, values=None, body=None, contacts=None, **more):
    """Fingers that touch nothing; the object is a small disc far away unless something else is given."""
    body = Circle(shape="circle", diameter=0.01, mass=0.0, position=(9.0, 0.1)) if body is None else body
    fingers = {"finger": make_finger()} if fingers is None else fingers
    scene, values = make_scene(fingers, body, {"tip": "auto"}, **more), values or {}
    first = scene.setups[0]
    contacts = [(first.tip_name, (0, 0), UP, (0, 0, 0), first.finger.rod.length, 0)] if contacts is None else contacts
    return scene, stored(scene, {setup.name: values.get(setup.name, {}) for setup in scene.setups}, contacts)


def beside_box(finger, tensions=(0.0, 0.0), **more):
    """A straight finger that touches nothing beside the box between two palms."""
    return apart(finger, {"finger": {"tensions": tensions}}, BOX, BETWEEN, supports=PALMS, **more)


def squeezed_disc(radius=0.04, mass=0.2, press=4.0, family="matched_clothoid", friction=0.5, half=HALF):
    """One straight finger presses a disc against a palm opposite; friction bears the weight out of the plane."""
    scene = make_scene(
        make_finger(half=half),
        Circle(shape="circle", diameter=2 * radius, mass=mass, position=(0.0, LENGTH + half + radius)),
        {"friction": friction},
        INTO_PLANE if mass else WEIGHTLESS,
        family,
        supports={"palm": Palm(point=(0.3, LENGTH + half + 2 * radius), normal_angle=-math.pi / 2)},
    )
    lift = 0.5 * 9.81 * mass
    contacts = [
        ("finger.tip", (0, LENGTH + half), DOWN, (press, 0, lift), LENGTH, 0),
        ("palm", (0, LENGTH + half + 2 * radius), UP, (press, 0, lift), NONE, 0),
    ]
    return scene, stored(scene, {"finger": {}}, contacts)


def two_fingers_below(mass=0.2, radius=0.05, aside=0.03, half=HALF, family="matched_clothoid", **more):
    """Two straight, upright fingers carry a disc on their tips, a little tension against the friction's couple."""
    slope = math.asin(aside / (radius + half))
    top = LENGTH + (radius + half) * math.cos(slope)
    scene = make_scene(
        {"left": make_finger((-aside, 0.0), half=half), "right": make_finger((aside, 0.0), half=half)},
        Circle(shape="circle", diameter=2 * radius, mass=mass, position=(0.0, top)),
        {"friction": 1.2},
        PLANAR,
        family,
        **more,
    )
    push = 0.5 * mass * 9.81
    contacts, fingers = [], {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        normal = np.array([side * math.sin(slope), -math.cos(slope)])
        along = np.array([-normal[1], normal[0]])
        load = push * DOWN
        point = np.array([0.0, top]) + radius * normal
        f = float(load @ along)
        pull = half * f / OFFSET  # (T1 - T2) e - h f = 0
        contacts.append((f"{name}.tip", point, normal, (float(load @ normal), f, 0.0), LENGTH, 0))
        fingers[name] = {"tensions": (max(pull, 0.0), max(-pull, 0.0))}
    return scene, stored(scene, fingers, contacts)


def pinched_box(width=0.06, height=0.05, press=6.0, mass=0.3, at=0.01, turn=0.0, family="clothoid", body=None):
    """Two straight fingers from both sides hold a box between their tips; its weight is out of the plane.

    They touch it ``at`` above its middle; the whole scene may be turned.
    """
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    reach = LENGTH + HALF + 0.5 * width
    left, right = rotation @ (-reach, 0.0), rotation @ (reach, 0.0)
    center = rotation @ (0.0, -at)
    values = {"mass": mass, "position": tuple(center), "angle": turn, "free": Freedom(x=(-0.02, 0.02), y=(-0.02, 0.02))}
    if body is None:
        body = Box(shape="box", width=width, height=height, center_of_mass=(0.0, at), **values)
    else:
        body = body(values)
    scene = make_scene(
        {"a": make_finger(left, turn - math.pi / 2), "b": make_finger(right, turn + math.pi / 2)},
        body,
        {"friction": 0.4},
        INTO_PLANE,
        family,
        elements=3,
    )
    lift = 0.5 * 9.81 * mass
    contacts = [
        ("a.tip", rotation @ (-0.5 * width, 0.0), rotation @ LEFT, (press, 0, lift), LENGTH, 0),
        ("b.tip", rotation @ (0.5 * width, 0.0), rotation @ RIGHT, (press, 0, lift), LENGTH, 0),
    ]
    return scene, stored(scene, {"a": {}, "b": {}}, contacts)


def pressed_down(body, supports, reactions, press=5.0, top=0.0, part=0, friction=0.5, **more):
    """A straight finger from above presses on the object's point (0, top); the supports bear it."""
    finger = make_finger((0.0, top + HALF + LENGTH), math.pi)
    scene = make_scene(finger, body, {"friction": friction}, PLANAR, supports=supports, **more)
    contacts = [("finger.tip", (0.0, top), UP, (press, 0.0, 0.0), LENGTH, part), *reactions]
    return scene, stored(scene, {"finger": {}}, contacts)


def disc_in_groove(press=5.0, mass=0.1, radius=0.03):
    """A disc in a V groove of 90 degrees that opens upwards, without friction; N = (press + m g) / sqrt 2 each."""
    body = Circle(shape="circle", diameter=2 * radius, mass=mass, position=(0.0, radius * math.sqrt(2)))
    r = math.sqrt(0.5)
    share = (press + 9.81 * mass) * r
    reactions = [
        (f"groove.{side}", (x * radius, r * radius), (x, -r), (share, 0.0, 0.0), NONE, 0)
        for side, x in (("left", -r), ("right", r))
    ]
    groove = VGroove(type="v_groove", apex=(0.0, 0.0), opening_angle=math.pi / 2, axis_angle=math.pi / 2)
    return pressed_down(body, {"groove": groove}, reactions, press, radius * (math.sqrt(2) + 1))


def box_on_line(press=5.0, mass=0.1, width=0.06, height=0.04):
    """A box that stands on a line wider than itself; both ends of its face bear half the load."""
    body = Box(shape="box", width=width, height=height, mass=mass, position=(0.0, 0.5 * height))
    share = 0.5 * (press + 9.81 * mass)
    reactions = [
        ("table.1", (-0.5 * width, 0.0), DOWN, (share, 0.0, 0.0), NONE, 0),
        ("table.2", (0.5 * width, 0.0), DOWN, (share, 0.0, 0.0), NONE, 0),
    ]
    line = Line(type="line", start=(-0.05, 0.0), end=(0.05, 0.0))
    return pressed_down(body, {"table": line}, reactions, press, height)


def disc_on_pegs(press=5.0, mass=0.1, radius=0.03, peg=0.01, aside=0.02):
    """A disc that rests on two round pegs without friction."""
    slope = math.asin(aside / (radius + peg))
    center = np.array([0.0, (radius + peg) * math.cos(slope)])
    body = Circle(shape="circle", diameter=2 * radius, mass=mass, position=tuple(center))
    share = (press + 9.81 * mass) / (2 * math.cos(slope))
    supports, reactions = {}, []
    for name, side in (("first", -1.0), ("second", 1.0)):
        supports[name] = Point(type="point", position=(side * aside, 0.0), radius=peg)
        normal = np.array([side * math.sin(slope), -math.cos(slope)])
        reactions.append((name, center + radius * normal, normal, (share, 0.0, 0.0), NONE, 0))
    return pressed_down(body, supports, reactions, press, float(center[1]) + radius)


def union_on_palm(press=5.0, mass=0.1):
    """A disc with a box as its foot, which stands on a palm; the finger presses on the disc."""
    members = (
        {"shape": "circle", "diameter": 0.05, "position": (0.0, 0.04)},
        {"shape": "box", "width": 0.06, "height": 0.03, "position": (0.0, 0.015)},
    )
    body = Union(shape="union", members=members, mass=mass, position=(0.0, 0.0), center_of_mass=(0.0, 0.03))
    share = 0.5 * (press + 9.81 * mass)
    reactions = [
        ("palm.1", (-0.03, 0.0), DOWN, (share, 0.0, 0.0), NONE, 1),
        ("palm.2", (0.03, 0.0), DOWN, (share, 0.0, 0.0), NONE, 1),
    ]
    palm = Palm(point=(0.0, 0.0), normal_angle=math.pi / 2)
    return pressed_down(body, {"palm": palm}, reactions, press, 0.065)


def wrapped_disc(gravity=INTO_PLANE, mass=0.3, used="both", mirrored=False, middles=1, friction=0.5):
    """Arcs, all but the first of which lie on the disc; forces of least tension by linear programming.

    The finger comes out of the palm beside the disc. Weight and masses of the finger act where gravity is planar.
    """
    rho, radius, d, y, total = 0.046, 0.040, 0.055, 0.040, 0.18
    bow = (d**2 + y**2 - rho**2) / (2 * (d - rho))
    theta = math.atan2(y, bow - d)
    side = -1.0 if mirrored else 1.0
    wrapped = (total - bow * theta) / middles
    lengths = np.array([bow * theta, *[wrapped] * middles])
    q = side * np.array([theta, *[wrapped / rho] * middles])
    finger = make_finger(
        (0.0, -side * d),
        -math.pi / 2,
        rod=Rod(length=total, linear_density=0.034, bending_stiffness=6.11e-3),
        masses=(PointMass(at=total, mass=0.002),),
        tendons=Tendons(offset=OFFSET, max_tension=60.0),
        tendons_used=used,
    )
    touch = {"middle": "on"} if middles == 1 else {"middle": ("on",) * middles}
    scene = make_scene(
        finger,
        Circle(shape="circle", diameter=2 * radius, mass=mass, position=(0.04, 0.0)),
        {**touch, "normal_force_max": 40.0, "friction": friction},
        gravity,
        "arc",
        middles + 1,
        supports={"palm": Palm(point=(0.0, 0.0), normal_angle=0.0)},
    )
    center, joints = np.array([0.04, 0.0]), np.cumsum(lengths)
    base, g = (0.0, -side * d, -math.pi / 2), np.array(gravity[:2])

    def shape(q):
        """At the joints, and the work of the weight."""
        s = 0.5 * total * (X60 + 1)
        places = bent(base, ends_of("arc", q, lengths, 0.0), lengths, [*joints, *s])
        moment = 0.034 * 0.5 * total * (W60 @ places[len(joints) :, :2]) + 0.002 * places[len(joints) - 1, :2]
        return places[: len(joints)], moment @ g

    normals = [(place[:2] - center) / np.linalg.norm(place[:2] - center) for place in shape(q)[0]] + [LEFT]
    count = len(normals)
    width = 1 + 3 * count
    rows, right = [], []
    for i, step in enumerate(1e-6 * np.eye(len(q))):
        (after, won), (before, lost) = shape(q + step), shape(q - step)
        move, row = (after - before) / 2e-6, np.zeros(width)
        row[0] = OFFSET * side
        for k, n in enumerate(normals[:-1]):
            row[1 + 3 * k] = move[k, :2] @ n
            row[2 + 3 * k] = move[k, :2] @ (-n[1], n[0]) - HALF * move[k, 2]
        rows.append(row)
        right.append(6.11e-3 * q[i] / lengths[i] - (won - lost) / 2e-6)
    force, moment, lift, tilt = np.zeros((2, width)), np.zeros(width), np.zeros(width), np.zeros((2, width))
    for k, n in enumerate(normals):
        force[:, 1 + 3 * k], force[:, 2 + 3 * k] = n, (-n[1], n[0])
        moment[2 + 3 * k], lift[3 + 3 * k], tilt[:, 3 + 3 * k] = 1.0, 1.0, n
    rows = np.array([*rows, *force, moment, lift, *tilt])
    spatial = gravity[2] < 0.0
    right = np.array([*right, *(mass * g), 0.0, -mass * gravity[2], 0.0, 0.0])
    cone = []
    for k in range(count):
        for a in np.linspace(0, 2 * np.pi, 96, endpoint=False):  # a polygon within the cone
            row = np.zeros(width)
            row[1 + 3 * k : 4 + 3 * k] = -friction * math.cos(math.pi / 96), math.cos(a), math.sin(a)
            cone.append(row)
    bounds = [(0, 60)] + [(0, 40), (None, None), (None, None) if spatial else (0, 0)] * count
    found = linprog(np.eye(width)[0], A_ub=cone, b_ub=np.zeros(len(cone)), A_eq=rows, b_eq=right, bounds=bounds)
    if found.status:
        raise RuntimeError(found.message)
    x = found.x
    active = np.abs(x) > 1e-9  # a few digits more than the linear program keeps
    x[active] -= np.linalg.pinv(rows[:, active]) @ (rows @ x - right)
    setup = scene.setups[0]
    names = (*setup.middle_names, setup.tip_name, "palm")
    touched = [*(center + radius * n for n in normals[:-1]), np.zeros(2)]
    contacts = [
        (names[k], touched[k], normals[k], x[1 + 3 * k : 4 + 3 * k], [*joints, NONE][k], 0) for k in range(count)
    ]
    tensions = (x[0], 0.0) if side > 0 else (0.0, x[0])
    return scene, stored(scene, {"finger": {"q": q, "lengths": lengths, "tensions": tensions}}, contacts)
