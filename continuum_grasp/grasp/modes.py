"""Choices of a search: contacts that are on, as the switches of a scene allow, and the elements of fingers."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

from continuum_grasp.grasp.starts.supports import touching_supports
from continuum_grasp.scene import ONE_TURN, Fidelity, FingerSetup, GraspFinger, GraspScene

MOST = 64
"""Sets of contacts that are tried, those with the most contacts first: all choices of six contacts."""
_CHOICES = {"on": (True,), "off": (False,), "auto": (True, False)}


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


def with_elements(
    scene: GraspScene, per_segment: int, family: str | None = None, *, as_curved: bool = False
) -> GraspScene:
    """The scene with this many elements per segment between base, middle contacts and tip, of each finger's own family
    or of another; they may bend as usual, or be ``as_curved`` as the finger's own, up to a turn.
    """

    def changed(setup: FingerSetup) -> GraspFinger:
        count = per_segment * (len(setup.middles) + 1)
        previous = setup.finger.fidelity or scene.fidelity
        bends = min(setup.bending_range * setup.elements / count, ONE_TURN) if as_curved else None
        fidelity = previous.replaced(tolerance=None, elements=count, family=family or setup.family, bending_range=bends)
        return setup.finger.replaced(fidelity=fidelity)

    fingers = {setup.name: changed(setup) for setup in scene.setups}
    return scene.with_fingers(fingers).replaced(fidelity=Fidelity())


def _chosen(switches: Iterable[tuple[str, str]]) -> list[frozenset[str]]:
    """The sets of names that switches leave to choose."""
    each = [[frozenset({name}) if on else frozenset() for on in _CHOICES[state]] for name, state in switches]
    return [frozenset[str]().union(*chosen) for chosen in product(*each)]
