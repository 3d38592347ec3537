"""The text of a chain of hinges: MJCF, the modeling format of MuJoCo."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from continuum_grasp import __version__
from continuum_grasp.arrays import Array
from continuum_grasp.closed_loop.links import Links
from continuum_grasp.export.mjcf.controls import Control
from continuum_grasp.export.mjcf.surroundings import add_surroundings, touching
from continuum_grasp.export.template import fill
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.simulate import Scene

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
        "radius": float(profile.half_thickness(0.5 * (begin + end))) or _THIN * profile.length,
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
    bands = [[sign * (bend if sign in signs else _NEVER) for sign in (-1.0, 1.0)] for bend in links.stop]
    return [(k + 1, more * links.stiffness[k], low, high) for k, (low, high) in enumerate(bands)]
