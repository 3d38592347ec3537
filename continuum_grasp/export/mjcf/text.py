"""The text of a chain of hinges: MJCF, the modeling format of MuJoCo."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from continuum_grasp import __version__
from continuum_grasp.closed_loop.links import Links
from continuum_grasp.export.mjcf.controls import Control
from continuum_grasp.export.mjcf.sliders import Sliders
from continuum_grasp.export.mjcf.surroundings import add_surroundings, numbers, touching
from continuum_grasp.export.template import fill
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.simulate import Scene

Array = NDArray[np.float64]

_NEVER = 1e3
"""Bend of a hinge that no finger has, for the side without stops [rad]."""
_THIN = 0.005
"""Radius of a finger of no known thickness, for looks, per length [1]."""


def written(
    scene: Scene,
    links: Links,
    controls: Sequence[Control],
    start: tuple[Array, Array],
    title: str,
    step: float,
    frequency: float,
    differences: Sequence[str],
    sliders: Sliders | None = None,
) -> str:
    """The whole file."""
    root = ET.Element("mujoco", model=title)
    root.append(ET.Comment(_explanation(scene, links, controls, frequency, differences)))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = numbers(*scene.gravity, 0.0)
    option = ET.SubElement(root, "option", timestep=numbers(step), integrator="implicitfast", gravity=gravity)
    if scene.object is None:
        ET.SubElement(option, "flag", contact="disable")
    else:
        option.set("cone", "elliptic")
        # As stiff as the steps allow: MuJoCo's contacts are at least two steps slow.
        default = ET.SubElement(ET.SubElement(root, "default"), "geom", solref=f"{numbers(2.0 * step)} 1")
        default.set("condim", "3")
    length, (x, y) = scene.finger.profile.length, scene.finger.base.position
    ET.SubElement(root, "statistic", center=numbers(x, y, 0.0), extent=numbers(length))
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "light", pos=numbers(x, y, 4.0 * length), dir="0 0 -1", directional="true")
    ET.SubElement(world, "camera", name="plane", pos=numbers(x, y, 3.0 * length), xyaxes="1 0 0 0 1 0")
    ET.SubElement(world, "site", name="world")
    sites: dict[int, list[tuple[str, float, float]]] = {}
    tendons = _tendons(scene.finger, links, controls)
    for control in {_site(control): control for control in controls if control.gear is not None}.values():
        sites.setdefault(links.link_of(control.at), []).append((_site(control), 0.0, control.at))
    sites.setdefault(len(links.at) - 1, []).append(("tip", 0.0, length))
    _bodies(world, scene, links, sites, None if sliders is None else partial(sliders.add_bodies, step=step))
    add_surroundings(root, world, scene)
    if sliders is not None:
        sliders.add_springs(tendons, links.rest)
    if len(tendons):
        root.append(tendons)
    root.append(_actuators(controls))
    sensor = ET.SubElement(root, "sensor")
    ET.SubElement(sensor, "framepos", name="tip", objtype="site", objname="tip")
    values = [float(control(np.zeros(1))[0]) for control in controls]
    key = ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="start")
    of_object = [0.0] * 3 if scene.object_moves else []
    angles, rates = start
    if sliders is not None:
        # In the order of the bodies: the sliders of a hinge come before it.
        angles = np.vstack([sliders.start, angles]).ravel(order="F")
        rates = np.vstack([0.0 * sliders.start, rates]).ravel(order="F")
    key.attrib |= {"qpos": numbers(*angles, *of_object), "qvel": numbers(*rates, *of_object)}
    key.set("ctrl", numbers(*values))
    states = [value for control, value in zip(controls, values, strict=True) if control.lag]
    if states:
        key.set("act", numbers(*states))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _explanation(
    scene: Scene, links: Links, controls: Sequence[Control], frequency: float, differences: Sequence[str]
) -> str:
    """What the file is, in its first lines."""
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
        "sliders": scene.finger.damping.dry_friction,
        "differences": "".join(f"Differs: {text}.\n" for text in differences),
    }
    return f"\n{textwrap.indent(fill('mjcf/comment.txt', words), '    ')}  "


def _bodies(
    world: ET.Element,
    scene: Scene,
    links: Links,
    sites: dict[int, list[tuple[str, float, float]]],
    beside: Callable[[ET.Element, int, str], None] | None,
) -> None:
    """The clamped part and the links, each inside the one before, and what is ``beside`` a hinge."""
    finger = scene.finger
    profile, (x, y) = finger.profile, finger.base.position
    body = ET.SubElement(world, "body", name="base", pos=numbers(x, y, 0.0), euler=numbers(0.0, 0.0, finger.base.angle))
    begin, end = 0.0, float(links.at[0])
    for k in range(-1, len(links.at)):
        if k >= 0:
            place = numbers(0.0, float(links.at[k]) - begin, 0.0)
            if beside is not None:
                beside(body, k, place)
            body = ET.SubElement(body, "body", name=f"link_{k + 1}", pos=place)
            begin, end = float(links.at[k]), float(links.ends[k])
            ET.SubElement(
                body,
                "joint",
                name=f"hinge_{k + 1}",
                type="hinge",
                axis="0 0 1",
                stiffness=numbers(links.stiffness[k]),
                damping=numbers(links.damping[k]),
                springref=numbers(links.rest[k]),
            )
            inertia = links.inertia[k]
            ET.SubElement(
                body,
                "inertial",
                pos=numbers(links.across[k], links.center[k] - begin, 0.0),
                mass=numbers(links.mass[k]),
                diaginertia=numbers(inertia, inertia, inertia),
            )
        radius = float(profile.half_thickness(0.5 * (begin + end))) or _THIN * profile.length
        geom = ET.SubElement(body, "geom", type="capsule", size=numbers(radius))
        geom.attrib |= {"fromto": numbers(0.0, 0.0, 0.0, 0.0, end - begin, 0.0), **touching(scene)}
        for name, across, at in sites.get(k, ()):
            ET.SubElement(body, "site", name=name, pos=numbers(across, at - begin, 0.0))


def _tendons(finger: Finger, links: Links, controls: Sequence[Control]) -> ET.Element:
    """Tendons, chambers and stops."""
    parent = ET.Element("tendon")
    for control in controls:
        if control.channel is None:
            continue
        # What a rod's bend draws in, exactly: a path through sites would be off by a share of the bend at each hinge.
        tendon = ET.SubElement(parent, "fixed", name=control.name)
        for k, lever in enumerate(control.levers(links.at)):
            if lever != 0.0:
                ET.SubElement(tendon, "joint", joint=f"hinge_{k + 1}", coef=numbers(lever))
    if finger.stops is not None and links.stop is not None:
        for k, bend in enumerate(links.stop):
            # A spring with a dead band: what the stiffness grows by where the links touch.
            bands = [sign * bend if sign in finger.stops.signs else sign * _NEVER for sign in (-1.0, 1.0)]
            stiffness = (finger.stops.stiffness_ratio - 1.0) * links.stiffness[k]
            stop = ET.SubElement(parent, "fixed", name=f"stop_{k + 1}", stiffness=numbers(stiffness))
            stop.set("springlength", numbers(*bands))
            ET.SubElement(stop, "joint", joint=f"hinge_{k + 1}", coef="1")
    return parent


def _actuators(controls: Sequence[Control]) -> ET.Element:
    parent = ET.Element("actuator")
    for control in controls:
        one = ET.SubElement(parent, "general" if control.lag else "motor", name=control.name)
        if control.cable is not None:
            one.attrib |= {"tendon": control.name, "forcerange": numbers(0.0, _NEVER), "biastype": "affine"}
            one.set("biasprm", numbers(0.0, -control.cable, 0.0))
        elif control.gear is None:
            one.set("tendon", control.name)
        else:
            one.attrib |= {"site": _site(control), "gear": numbers(*control.gear)}
            if not control.follows:
                one.set("refsite", "world")
        if control.limits is not None:
            one.set("ctrlrange", numbers(*control.limits))
        if control.lag:
            one.attrib |= {"dyntype": "filterexact", "dynprm": numbers(control.lag)}
            one.set("gainprm", "1" if control.cable is None else numbers(control.cable))
    return parent


def _site(control: Control) -> str:
    return f"at_{numbers(control.at)}"
