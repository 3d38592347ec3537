"""A chain of hinges and its surroundings as text: MJCF, the modeling format of MuJoCo."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape

import numpy as np

from continuum_grasp import __version__
from continuum_grasp.addons.chains.controls import Control
from continuum_grasp.addons.chains.links import Links
from continuum_grasp.base import Array
from continuum_grasp.export import fill
from continuum_grasp.scene import Finger, OffsetPolygon, Part, Scene, Wall

# Two bodies touch where the type of one is among those that the other is asked to touch: the finger touches the object,
# the object the supports, and no link another.
FINGER = {"contype": "1", "conaffinity": "0"}
OBJECT = {"contype": "2", "conaffinity": "1"}
SUPPORT = {"contype": "0", "conaffinity": "2"}
_FREE = {"contype": "0", "conaffinity": "0"}
LEAST_INERTIA = 1e-15
"""Least inertia of a moving body that MuJoCo accepts [kg m2] (mjMINVAL in its sources)."""
_CORNERS = 120
"""Corners of the polygon in place of a round outline: off by 3e-4 of its radius."""


def _surroundings(scene: Scene) -> dict[str, object]:
    """Words of the object and its supports, which there need not be."""
    body = scene.object
    if body is None:
        return {"body": None, "meshes": (), "supports": ()}
    cos = math.cos(body.angle)
    sin = math.sin(body.angle)
    x = body.position[0] + cos * body.com[0] - sin * body.com[1]
    y = body.position[1] + sin * body.com[0] + cos * body.com[1]
    # 0.1: half the width of flat bodies out of the plane, per length of the finger: wider than links are thick
    width = 0.1 * scene.finger.profile.length
    meshes: list[tuple[str, str]] = []
    offset = (body.position[0] - x, body.position[1] - y)
    parts = [
        _geometry(meshes, f"part_{k + 1}", part.placed(offset, body.angle), width) for k, part in enumerate(body.pieces)
    ]
    table = scene.table
    walls = (*scene.walls, *(() if table is None or table.wall is None else (table.wall,)))
    supports = [_wall(wall, width, _friction(scene, wall.friction)) for wall in walls]
    for peg in scene.pegs:
        # 1e-4: radius in place of a point, per length of the finger
        radius = max(peg.radius, 1e-4 * scene.finger.profile.length)
        geom = {"name": f"support_{peg.name}", "type": "sphere", "pos": numbers(*peg.position, 0.0)}
        supports.append({**geom, "size": numbers(radius), **SUPPORT, **_friction(scene, peg.friction)})
    inertial = {"pos": "0 0 0", "mass": numbers(body.mass), "diaginertia": numbers(*[scene.inertia] * 3)}
    moves = scene.object_moves
    return {
        "body": {
            "place": {"name": "object", "pos": numbers(x, y, 0.0)}.items(),
            "joints": [joint.items() for joint in (_joints(scene, body.mass) if moves else ())],
            "inertial": inertial.items(),
            "parts": [part.items() for part in parts],
        },
        "meshes": meshes,
        "supports": [[(name, escape(value)) for name, value in support.items()] for support in supports],
    }


def _joints(scene: Scene, mass: float) -> list[dict[str, str]]:
    """Joints of an object that moves, with the friction of a table that it stands on."""
    # A table in the plane is a wall.
    table = scene.table if scene.out_of_plane_gravity else None
    limit = 0.0 if table is None else table.friction * mass * scene.out_of_plane_gravity
    losses = [limit, limit, 0.0 if table is None else limit * table.friction_radius]
    joints = [("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("angle", "hinge", "0 0 1")]
    return [
        {
            "name": f"object_{name}",
            "type": kind,
            "axis": axis,
            **({"frictionloss": numbers(loss)} if loss > 0.0 or (table is not None and kind == "slide") else {}),
        }
        for (name, kind, axis), loss in zip(joints, losses, strict=True)
    ]


def _geometry(meshes: list[tuple[str, str]], name: str, part: Part, width: float) -> dict[str, str]:
    """A convex part: a sphere, a capsule, or the prism over its outline, which is one of the meshes."""
    # Of two geometries the larger friction counts: the finger's and the supports' are those of the pairs.
    geom = {"name": name, **OBJECT, "friction": "0 0 0"}
    if isinstance(part, OffsetPolygon) and len(part.vertices) == 1:
        return {**geom, "type": "sphere", "pos": numbers(*part.vertices[0], 0.0), "size": numbers(part.radius)}
    if isinstance(part, OffsetPolygon) and len(part.vertices) == 2:
        (x0, y0), (x1, y1) = part.vertices
        ends = numbers(x0, y0, 0.0, x1, y1, 0.0)
        return {**geom, "type": "capsule", "fromto": ends, "size": numbers(part.radius)}
    corners = [z for x, y in part.outline(_CORNERS) for side in (-width, width) for z in (x, y, side)]
    meshes.append((name, numbers(*corners)))
    return {**geom, "type": "mesh", "mesh": name}


def _wall(wall: Wall, width: float, friction: dict[str, str]) -> dict[str, str]:
    """A half plane, or a box behind an edge of finite length."""
    (x, y), (nx, ny), deep = wall.point, wall.normal, wall.half_length
    geom = {"name": f"support_{wall.name}", **SUPPORT, **friction}
    if math.isinf(deep):
        place = {"pos": numbers(x, y, 0.0), "zaxis": numbers(nx, ny, 0.0)}
        return {**geom, "type": "plane", **place, "size": "0 0 1"}
    place = {"pos": numbers(x - deep * nx, y - deep * ny, 0.0), "euler": numbers(0.0, 0.0, wall.normal_angle)}
    return {**geom, "type": "box", **place, "size": numbers(deep, deep, width)}


def _friction(scene: Scene, coefficient: float | None) -> dict[str, str]:
    """Friction of a surface that the object touches."""
    law = scene.contact_law
    usual = 0.0 if law is None else law.friction
    return {"friction": numbers(usual if coefficient is None else coefficient, 0.0, 0.0)}


def numbers(*values: float) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)


def written(
    scene: Scene,
    links: Links,
    controls: Sequence[Control],
    start: tuple[Array, Array],
    title: str,
    step: float,
    frequency: float,
    differences: Sequence[str],
) -> str:
    """Text of the MJCF file of a chain in the plane."""
    finger = scene.finger
    tip = len(links.at) - 1
    sites: dict[int, dict[str, float]] = {}
    for control in controls:
        if control.gear is not None:
            sites.setdefault(links.link_of(control.at), {})[control.site] = control.at
    sites.setdefault(tip, {})["tip"] = finger.profile.length
    values = [float(control(np.zeros(1))[0]) for control in controls]
    rest = [0.0] * 3 if scene.object_moves else []
    angles, rates = start
    base = finger.base
    touching = _FREE if scene.object is None else {**FINGER, **_friction(scene, None)}
    above = {"light": 4.0 * finger.profile.length, "camera": 3.0 * finger.profile.length}
    state = {"qpos": [*angles, *rest], "qvel": [*rates, *rest], "ctrl": values}
    state["act"] = [value for control, value in zip(controls, values, strict=True) if control.lag]
    start_key = {"name": "start", **{key: numbers(*row) for key, row in state.items() if key != "act" or row}}
    option = {"timestep": numbers(step), "integrator": "implicitfast", "gravity": numbers(*scene.gravity, 0.0)}
    words: dict[str, object] = {
        "option": {**option, **({} if scene.object is None else {"cone": "elliptic"})}.items(),
        "contact": () if scene.object is None else {"solref": f"{numbers(2.0 * step)} 1"}.items(),
        "center": numbers(*base.position, 0.0),
        "extent": finger.profile.length,
        "light": {"pos": numbers(*base.position, above["light"]), "dir": "0 0 -1"}.items(),
        "cameras": [
            {"name": "plane", "pos": numbers(*base.position, above["camera"]), "xyaxes": "1 0 0 0 1 0"}.items()
        ],
        "fingers": [[_link(scene, links, k, sites.get(k, {}), touching) for k in range(-1, tip + 1)]],
        # What a rod's bend draws in, exactly: a path through sites would be off by a share of the bend at each hinge.
        "tendons": [(control, levers(control, links)) for control in controls if control.channel is not None],
        "stops": _stops(finger, links),
        "controls": controls,
        "holder": False,
        "sensed": ["tip"],
        "keyframes": [start_key.items()],
        **_surroundings(scene),
    }
    return document(words, title, _explanation(scene, links, controls, frequency, differences))


def document(words: Mapping[str, object], title: str, explanation: str) -> str:
    """Text of an MJCF file that begins with an explanation."""
    root = ET.fromstring(fill("mjcf/chain.xml", words))
    root.set("model", title)
    root.insert(0, ET.Comment(f"\n{textwrap.indent(explanation, '    ')}  "))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _link(
    scene: Scene, links: Links, k: int, sites: Mapping[str, float], touching: Mapping[str, str]
) -> dict[str, object]:
    """The clamped part, -1, or a link, inside the one before."""
    profile, base = scene.finger.profile, scene.finger.base
    # 0.005: radius of a finger of no known thickness, for looks, per length
    begin, end = links.span(k)
    radius = float(profile.half_thickness(0.5 * (begin + end))) or 0.005 * profile.length
    capsule = {"type": "capsule", "size": numbers(radius), "fromto": numbers(0.0, 0.0, 0.0, 0.0, end - begin, 0.0)}
    link: dict[str, object] = {
        "body": {
            "name": "base",
            "pos": numbers(*base.position, 0.0),
            "euler": numbers(0.0, 0.0, base.angle),
        }.items(),
        "joints": (),
        "inertial": link_inertial(links, k, radius).items(),
        "geom": {**capsule, **touching}.items(),
        "sites": [(name, at - begin) for name, at in sites.items()],
    }
    if k >= 0:
        before = links.span(k - 1)[0]
        hinge = {"name": f"hinge_{k + 1}", "type": "hinge", "axis": "0 0 1"}
        hinge |= {key: numbers(getattr(links, key)[k]) for key in ("stiffness", "damping")}
        link |= {
            "body": {"name": f"link_{k + 1}", "pos": numbers(0.0, begin - before, 0.0)}.items(),
            "joints": [{**hinge, "springref": numbers(links.rest[k])}.items()],
        }
    return link


def link_inertial(links: Links, k: int, radius: float, lightest: float = 0.0) -> dict[str, str]:
    """Return mass, center and inertia of a link (-1: the clamped part) in the axes of its body; y points along the
    link.

        The inertia about both transverse axes equals the planar inertia. The inertia about y equals that of a round
        body with the radius [m], at most the transverse inertia. A link lighter than ``lightest`` [kg] becomes uniform
        with that mass.
    """
    mass, center, across, inertia = links.body(k).tolist()
    begin, end = links.span(k)
    if k >= 0 and mass < lightest:
        mass, center, across = lightest, 0.5 * (begin + end), 0.0
        inertia = mass * (end - begin) ** 2 / 12.0
    inertia = max(inertia, LEAST_INERTIA)
    own = min(max(0.5 * mass * radius**2, LEAST_INERTIA), inertia)
    return {
        "pos": numbers(across, center - begin, 0.0),
        "mass": numbers(mass),
        "diaginertia": numbers(inertia, own, inertia),
    }


def _explanation(
    scene: Scene, links: Links, controls: Sequence[Control], frequency: float, differences: Sequence[str]
) -> str:
    """First lines of the file, which explain it."""
    bending = [control for control in controls if control.channel is not None]
    chambers = len(scene.finger.chambers)
    tendons = bending[: len(bending) - chambers]
    wound = any(control.cable is not None for control in tendons)
    words = {
        "hinges": len(links.at),
        "version": __version__,
        "frequency": f"{frequency:.6g}",
        "tendons": tendons,
        "pulled": tendons and not wound,
        "wound": wound,
        "chambers": chambers,
        "stops": links.stop is not None,
        "differences": "".join(f"Differs: {text}.\n" for text in differences),
    }
    return fill("mjcf/comment.txt", words)


def _stops(finger: Finger, links: Links) -> list[tuple[int, float, float, float]]:
    """Springs with a dead band, by what the stiffness grows where the links touch: hinge, stiffness, and the band."""
    if finger.stops is None or links.stop is None:
        return []
    more = finger.stops.stiffness_ratio - 1.0
    signs = finger.stops.signs
    # 1e3: bend of a hinge that no finger has, for the side without stops [rad]
    bands = [[sign * (bend if sign in signs else 1e3) for sign in (-1.0, 1.0)] for bend in links.stop]
    return [(k + 1, more * links.stiffness[k], low, high) for k, (low, high) in enumerate(bands)]


def levers(control: Control, links: Links) -> list[tuple[str, float]]:
    """Hinges that a control bends, with their levers."""
    return [(f"hinge_{k}", lever) for k, lever in enumerate(control.levers(links.at), 1) if lever != 0.0]
