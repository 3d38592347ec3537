"""Sets of contacts of a planar scene that a search tries, and stations that touch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.object_supports import touching_supports
from continuum_grasp.scene import FingerSetup, GraspScene

MOST = 64
"""Sets of contacts that are tried, those with the most contacts first: all choices of six contacts."""
AT_ONCE = 2
"""Stations of a finger that touch in the starts of a search [1]: more are added one by one, where they lessen the aim.
"""
_CHOICES = {"on": (True,), "off": (False,), "auto": (True, False)}


def contact_sets(scene: GraspScene) -> list[frozenset[str]]:
    """The sets of contacts that may be on, at most `MOST`, those with the most contacts first.

    Stations of a finger, and middle contacts that are ``auto``, may stand for each other: the first ones do.
    """
    if all(len(setup.middles) < 2 for setup in scene.setups):
        return contact_modes(scene)
    each = [_of_finger(setup) for setup in scene.setups]
    plain = _with_one_each(scene)
    of_fingers = frozenset(name for setup in plain.setups for name in setup.switches)
    supports = list(dict.fromkeys(mode - of_fingers for mode in contact_modes(plain)))
    sets = [frozenset[str]().union(*chosen) for chosen in product(*each, supports)]
    return sorted(sets, key=lambda on: (-len(on), sorted(on)))[:MOST]


def _of_finger(setup: FingerSetup) -> list[frozenset[str]]:
    """Sets of contacts of a finger, without the empty one."""
    fixed = [name for name, switch in zip(setup.middle_names, setup.middles, strict=True) if switch == "on"]
    free = [name for name, switch in zip(setup.middle_names, setup.middles, strict=True) if switch == "auto"]
    most = min(len(free), AT_ONCE) if setup.stations else len(free)
    with_tip = _CHOICES[setup.tip]
    sets = (
        frozenset([*fixed, *free[:count], *[setup.tip_name] * tip]) for count in range(most + 1) for tip in with_tip
    )
    return [on for on in sets if on]


def _with_one_each(scene: GraspScene) -> GraspScene:
    """The scene with one middle contact of each finger, whose supports have the same choices."""
    one = {"stations": None, "middle": "on"}
    fingers = {
        name: finger.model_copy(update={"contacts": finger.contacts.model_copy(update=one)})
        for name, finger in scene.named_fingers.items()
    }
    return scene.model_copy(update={"contacts": scene.contacts.model_copy(update=one)}).with_fingers(fingers)


def nearest_stations(setup: FingerSetup, places: Array) -> set[str]:
    """Names of the stations that are nearest to places along a finger [m]."""
    stations = np.array(setup.stations)
    return {setup.middle_names[int(np.abs(stations - place).argmin())] for place in places.tolist()}


def neighboring_stations(scene: GraspScene, on: frozenset[str]) -> Iterator[frozenset[str]]:
    """Sets of contacts with one station less than a set, one more beside those on, or one moved to its neighbor."""
    for setup in scene.setups:
        names = setup.middle_names if setup.stations else ()
        touching = [k for k, name in enumerate(names) if name in on]
        free = [k for k in range(len(names)) if k not in touching]
        beside = [k for k in free if {k - 1, k + 1} & set(touching)] or free
        yield from (on | {names[k]} for k in beside)
        yield from (on - {names[k]} for k in touching if (on - {names[k]}) & setup.switches.keys())
        yield from (on - {names[k]} | {names[j]} for k in touching for j in (k - 1, k + 1) if j in free)


def contact_modes(scene: GraspScene) -> list[frozenset[str]]:
    """The sets of contacts that may be on, those with the most contacts first, at most `MOST`.

    They name contacts of fingers, each of which touches somewhere, and supports that the object touches.
    """
    choices: list[list[frozenset[str]]] = []
    for setup in scene.setups:
        chosen = _chosen(setup.switches.items())
        choices.append([names for names in chosen if names])
    supports = [(body.name, body.touch) for body in scene.places]
    if scene.object.free is None:
        touching = touching_supports(scene, scene.object.pose)
        choices.append([frozenset(name for name, touch in supports if touch != "off" and name in touching)])
    else:
        choices.append(_chosen(supports))
    modes = [frozenset[str]().union(*sets) for sets in product(*choices)]
    return sorted(modes, key=lambda mode: (-len(mode), sorted(mode)))[:MOST]


def _chosen(switches: Iterable[tuple[str, str]]) -> list[frozenset[str]]:
    """The sets of names that switches leave to choose."""
    each = [[frozenset({name}) if on else frozenset() for on in _CHOICES[state]] for name, state in switches]
    return [frozenset[str]().union(*chosen) for chosen in product(*each)]
