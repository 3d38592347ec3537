"""Which contacts are on: every choice that the switches of a scene leave."""

from __future__ import annotations

from itertools import product

from continuum_grasp.grasp.starts.starts import touching_supports
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["MOST", "contact_modes"]

MOST = 64
"""Sets of contacts that are tried, those with the most contacts first:
all choices of six contacts."""

_CHOICES = {"on": (True,), "off": (False,), "auto": (True, False)}


def contact_modes(scene: GraspScene) -> list[frozenset[str]]:
    """The sets of contacts that may be on, those with the most contacts first.

    Parameters
    ----------
    scene : GraspScene

    Returns
    -------
    list of frozenset of str
        Names of contacts of fingers, and of the supports that the object touches; every finger touches somewhere. At
        most `MOST`.
    """
    fingers: list[list[frozenset[str]]] = []
    for setup in scene.setups:
        names = (*setup.middle_names, setup.tip_name)
        switches = (*setup.middles, setup.tip)
        sets = [
            frozenset(n for n, on in zip(names, choice, strict=True) if on)
            for choice in product(*(_CHOICES[s] for s in switches))
        ]
        fingers.append([s for s in sets if s])
    supports = [(body.name, body.touch) for body in scene.places]
    if scene.object.free is None:
        touching = touching_supports(scene, scene.object.pose)
        chosen = [frozenset(name for name, touch in supports if touch != "off" and name in touching)]
    else:
        chosen = [
            frozenset(name for (name, _), on in zip(supports, choice, strict=True) if on)
            for choice in product(*(_CHOICES[touch] for _, touch in supports))
        ]
    modes = [frozenset().union(*sets) for sets in product(*fingers, chosen)]
    return sorted(modes, key=lambda mode: (-len(mode), sorted(mode)))[:MOST]
