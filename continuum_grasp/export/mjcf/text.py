"""A chain of hinges and its surroundings as text: MJCF, the modeling format of MuJoCo."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from continuum_grasp import __version__
from continuum_grasp.arrays import Array
from continuum_grasp.closed_loop.links import Links
from continuum_grasp.export.fields import fill
from continuum_grasp.export.mjcf.controls import Control
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.parts import OffsetPolygon, Part
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.scene.supports import Wall

# Two bodies touch where the type of one is among those that the other is asked to touch: the finger touches the object,
# the object the supports, and no link another.
_FINGER = {"contype": "1", "conaffinity": "0"}
_OBJECT = {"contype": "2", "conaffinity": "1"}
_SUPPORT = {"contype": "0", "conaffinity": "2"}
_NOTHING = {"contype": "0", "conaffinity": "0"}
_CORNERS = 120
"""Corners of the polygon in place of a round outline: off by 3e-4 of its radius."""


def touching(scene: Scene) -> dict[str, str]:
    """Attributes of the geometry of the finger's links that let them touch."""
    return _FINGER | _friction(scene, None) if scene.object is not None else _NOTHING


def add_surroundings(root: ET.Element, scene: Scene) -> None:
    """Add the object and its supports, where there are any."""
    body, (world,) = scene.object, root.iter("worldbody")
    if body is None:
        return
    cos, sin = math.cos(body.angle), math.sin(body.angle)
    x = body.position[0] + cos * body.com[0] - sin * body.com[1]
    y = body.position[1] + sin * body.com[0] + cos * body.com[1]
    element = ET.SubElement(world, "body", name="object", pos=numbers(x, y, 0.0))
    if scene.object_moves:
        table = scene.table if scene.out_of_plane_gravity else None  # one in the plane is a wall
        friction_limit = 0.0 if table is None else table.friction * body.mass * scene.out_of_plane_gravity
        for name, kind, axis in (("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("angle", "hinge", "0 0 1")):
            joint = ET.SubElement(element, "joint", name=f"object_{name}", type=kind, axis=axis)
            if kind == "slide" and table is not None:
                joint.set("frictionloss", numbers(friction_limit))
            elif table is not None and table.friction_radius > 0.0:
                joint.set("frictionloss", numbers(friction_limit * table.friction_radius))
        inertia = numbers(*[scene.inertia] * 3)
        ET.SubElement(element, "inertial", pos="0 0 0", mass=numbers(body.mass), diaginertia=inertia)
    asset = ET.Element("asset")
    # 0.1: half the width of flat bodies out of the plane, per length of the finger: wider than links are thick
    width = 0.1 * scene.finger.profile.length
    for k, part in enumerate(body.pieces):
        placed = part.placed((body.position[0] - x, body.position[1] - y), body.angle)
        element.append(_geometry(asset, f"part_{k + 1}", placed, width))
    if len(asset):
        root.insert([*root].index(world) + 1, asset)
    in_plane = None if scene.table is None else scene.table.wall
    for wall in (*scene.walls, *(() if in_plane is None else (in_plane,))):
        world.append(_wall(wall, width, _friction(scene, wall.friction)))
    for peg in scene.pegs:
        # 1e-4: radius in place of a point, per length of the finger
        radius = max(peg.radius, 1e-4 * scene.finger.profile.length)
        geom = ET.SubElement(world, "geom", name=f"support_{peg.name}", type="sphere", pos=numbers(*peg.position, 0.0))
        geom.attrib |= {"size": numbers(radius), **_SUPPORT, **_friction(scene, peg.friction)}


def _geometry(asset: ET.Element, name: str, part: Part, width: float) -> ET.Element:
    """A convex part: a sphere, a capsule, or the prism over its outline."""
    # Of two geometries the larger friction counts: the finger's and the supports' are those of the pairs.
    geom = ET.Element("geom", {"name": name, **_OBJECT, "friction": "0 0 0"})
    if isinstance(part, OffsetPolygon) and len(part.vertices) == 1:
        geom.attrib |= {"type": "sphere", "pos": numbers(*part.vertices[0], 0.0), "size": numbers(part.radius)}
    elif isinstance(part, OffsetPolygon) and len(part.vertices) == 2:
        (x0, y0), (x1, y1) = part.vertices
        geom.attrib |= {"type": "capsule", "fromto": numbers(x0, y0, 0.0, x1, y1, 0.0), "size": numbers(part.radius)}
    else:
        corners = [z for x, y in part.outline(_CORNERS) for side in (-width, width) for z in (x, y, side)]
        ET.SubElement(asset, "mesh", name=name, vertex=numbers(*corners), inertia="convex")
        geom.attrib |= {"type": "mesh", "mesh": name}
    return geom


def _wall(wall: Wall, width: float, friction: dict[str, str]) -> ET.Element:
    """A half plane, or a box behind an edge of finite length."""
    (x, y), (nx, ny) = wall.point, wall.normal
    geom = ET.Element("geom", {"name": f"support_{wall.name}", **_SUPPORT, **friction})
    if math.isinf(wall.half_length):
        geom.attrib |= {"type": "plane", "pos": numbers(x, y, 0.0), "zaxis": numbers(nx, ny, 0.0), "size": "0 0 1"}
        return geom
    deep = wall.half_length
    geom.attrib |= {
        "type": "box",
        "pos": numbers(x - deep * nx, y - deep * ny, 0.0),
        "euler": numbers(0.0, 0.0, wall.normal_angle),
        "size": numbers(deep, wall.half_length, width),
    }
    return geom


def _friction(scene: Scene, coefficient: float | None) -> dict[str, str]:
    """Friction of a surface that the object touches."""
    law = scene.contact_law
    return {
        "friction": numbers(
            (law.friction if law is not None else 0.0) if coefficient is None else coefficient, 0.0, 0.0
        )
    }


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
    """Text of the MJCF file of a chain."""
    finger, tip = scene.finger, len(links.at) - 1
    sites: dict[int, dict[str, float]] = {}
    for control in controls:
        if control.gear is not None:
            sites.setdefault(links.link_of(control.at), {})[control.site] = control.at
    sites.setdefault(tip, {})["tip"] = finger.profile.length
    values = [float(control(np.zeros(1))[0]) for control in controls]
    rest = [0.0] * 3 if scene.object_moves else []
    angles, rates = start
    words: dict[str, object] = {
        "scene": scene,
        "step": step,
        "two_steps": 2.0 * step,
        "length": finger.profile.length,
        "above": {"light": 4.0 * finger.profile.length, "camera": 3.0 * finger.profile.length},
        "links": [_link(scene, links, k, sites.get(k, {})) for k in range(-1, tip + 1)],
        # What a rod's bend draws in, exactly: a path through sites would be off by a share of the bend at each hinge.
        "tendons": [
            (control, [(k, lever) for k, lever in enumerate(control.levers(links.at), 1) if lever != 0.0])
            for control in controls
            if control.channel is not None
        ],
        "stops": _stops(finger, links),
        "controls": controls,
        "qpos": [*angles, *rest],
        "qvel": [*rates, *rest],
        "ctrl": values,
        "act": [value for control, value in zip(controls, values, strict=True) if control.lag],
        "touching": touching(scene).items(),
    }
    root = ET.fromstring(fill("mjcf/chain.xml", words))
    root.set("model", title)
    root.insert(0, ET.Comment(_explanation(scene, links, controls, frequency, differences)))
    add_surroundings(root, scene)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _link(scene: Scene, links: Links, k: int, sites: Mapping[str, float]) -> dict[str, object]:
    """The clamped part, -1, or a link, inside the one before."""
    profile = scene.finger.profile
    before = float(links.at[k - 1]) if k > 0 else 0.0
    begin, end = (float(links.at[k]), float(links.ends[k])) if k >= 0 else (0.0, float(links.at[0]))
    link: dict[str, object] = {
        "number": k + 1,
        "place": begin - before,
        # 0.005: radius of a finger of no known thickness, for looks, per length
        "radius": float(profile.half_thickness(0.5 * (begin + end))) or 0.005 * profile.length,
        "length": end - begin,
        "sites": [(name, at - begin) for name, at in sites.items()],
    }
    if k >= 0:
        link |= {
            name: getattr(links, name)[k] for name in ("stiffness", "damping", "rest", "across", "mass", "inertia")
        }
        link["center"] = links.center[k] - begin
    return link


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
    return f"\n{textwrap.indent(fill('mjcf/comment.txt', words), '    ')}  "


def _stops(finger: Finger, links: Links) -> list[tuple[int, float, float, float]]:
    """Springs with a dead band, by what the stiffness grows where the links touch: hinge, stiffness, and the band."""
    if finger.stops is None or links.stop is None:
        return []
    more, signs = finger.stops.stiffness_ratio - 1.0, finger.stops.signs
    # 1e3: bend of a hinge that no finger has, for the side without stops [rad]
    bands = [[sign * (bend if sign in signs else 1e3) for sign in (-1.0, 1.0)] for bend in links.stop]
    return [(k + 1, more * links.stiffness[k], low, high) for k, (low, high) in enumerate(bands)]
