"""A grasp solved again with other elements: how much a fine model changes it, and which model keeps a tolerance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.search import Search, Tried
from continuum_grasp.grasp.starts.found import start_from
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.grasp_options import GraspFinger
from continuum_grasp.scene.simulate import Fidelity

if TYPE_CHECKING:
    from continuum_grasp.grasp.result import GraspResult

__all__ = [
    "ELEMENTS",
    "Change",
    "asked_tolerance",
    "compare",
    "resolve_elements",
    "solve_again",
    "with_elements",
    "with_fine",
]

Array = NDArray[Any]

FINE = 6
"""Elements per stretch between base, middle contacts and tip of the model that a grasp is compared with."""
ELEMENTS = (1, 2, 3, 4)
"""Elements per stretch among which the cheapest is chosen that keeps a tolerance."""


@dataclass(frozen=True)
class Change:
    """What other elements change about a grasp.

    Attributes
    ----------
    elements : dict of str to int
        Elements of each finger in the model compared with.
    tension : float
        Sum of tensions there [N].
    tension_change : float
        Its change, as a part of the sum here.
    displacement : float
        Greatest displacement of a contact point [m].
    length : float
        Of the shortest finger [m].
    """

    elements: dict[str, int]
    tension: float
    tension_change: float
    displacement: float
    length: float

    @property
    def size(self) -> float:
        """The greater of the change of tension and the displacement per length [1]."""
        return max(abs(self.tension_change), self.displacement / self.length)

    def __str__(self) -> str:
        count = max(self.elements.values())
        return (
            f"with {count} elements the tension changes by {self.tension_change:+.2%} to {self.tension:.4g} N, "
            f"contacts by {1e3 * self.displacement:.2g} mm at most"
        )


def with_elements(scene: GraspScene, per_stretch: int, family: str | None = None) -> GraspScene:
    """The scene with this many elements per stretch between base, middle contacts and tip.

    Parameters
    ----------
    scene : GraspScene
    per_stretch : int
    family : {"arc", "clothoid", "matched_clothoid"}, optional
        None: each finger keeps its own.
    """

    def changed(setup: FingerSetup) -> GraspFinger:
        count = per_stretch * (len(setup.middles) + 1)
        own = setup.finger.fidelity or scene.fidelity
        fidelity = own.model_copy(
            update={"tolerance": None, "elements": count, "family": family or setup.family, "bending_range": None}
        )
        after = tuple(per_stretch * (k + 1) for k in range(len(setup.middles)))
        contacts = setup.finger.contacts.model_copy(update={"middle_after": after})
        return setup.finger.model_copy(update={"fidelity": fidelity, "contacts": contacts})

    fingers = {setup.name: changed(setup) for setup in scene.setups}
    plain = {"fidelity": Fidelity()}
    if scene.fingers is None:
        return scene.model_copy(update={"finger": fingers["finger"], **plain})
    return scene.model_copy(update={"fingers": fingers, **plain})


def solve_again(scene: GraspScene, found: GraspScene, arrays: dict[str, Array], budget: Budget) -> Tried | None:
    """The grasp next to one that was found with other elements; None where there is none.

    Parameters
    ----------
    scene : GraspScene
        With the elements wanted.
    found : GraspScene
        With those of the grasp.
    arrays : dict
    budget : Budget
    """
    search = Search(scene, budget)
    if budget.over:
        return None
    search.attempt(start_from(found, arrays))
    search.slide()
    return None if budget.stopped else search.best


def compare(scene: GraspScene, here: dict[str, Array], there: dict[str, Array]) -> Change:
    """What changes from one model of a grasp to another.

    Parameters
    ----------
    scene : GraspScene
    here, there : dict
        Numbers of the grasp with either model.
    """
    one, two = _tension(scene, here), _tension(scene, there)
    names = [str(name) for name in there["contact_names"]]
    places = dict(zip(names, there["contact_positions"], strict=True))
    moved = [
        float(np.linalg.norm(at - places[str(name)]))
        for name, at in zip(here["contact_names"], here["contact_positions"], strict=True)
        if str(name) in places
    ]
    elements = {setup.name: int(there[f"{setup.name}.lengths"].size) for setup in scene.setups}
    length = min(setup.finger.rod.length for setup in scene.setups)
    return Change(elements, two, two / one - 1.0 if one else 0.0, max(moved, default=0.0), length)


def _tension(scene: GraspScene, arrays: dict[str, Array]) -> float:
    return float(sum(arrays[f"{name}.tensions"].sum() for name in scene.named_fingers))


def with_fine(result: GraspResult, budget: Budget) -> GraspResult:
    """The result with what a fine model changes; as it is where that has no grasp next to it.

    Parameters
    ----------
    result : GraspResult
        A grasp.
    budget : Budget
    """
    scene, arrays = result.scene, dict(result.arrays)
    found = solve_again(with_elements(scene, FINE, _smooth(scene)), scene, arrays, budget)
    if found is None:
        return replace(result, statistics={**result.statistics, "fine_model": _none(budget)})
    change = compare(scene, arrays, found.arrays)
    return replace(result, fine=change, statistics={**result.statistics, "fine_model": str(change)})


def asked_tolerance(scene: GraspScene) -> float | None:
    """The least tolerance that the scene or one of its fingers asks for."""
    fidelities = [finger.fidelity or scene.fidelity for finger in scene.named_fingers.values()]
    return min((f.tolerance for f in fidelities if f.tolerance is not None), default=None)


def resolve_elements(
    scene: GraspScene, first: GraspResult, tolerance: float, budget: Budget
) -> tuple[GraspScene, str, Change | None]:
    """The scene with the fewest elements whose grasp differs from a fine model's by no more than a tolerance.

    Parameters
    ----------
    scene : GraspScene
        As asked.
    first : GraspResult
        Its grasp with some elements.
    tolerance : float
        Greatest change of the tension (relative) and of contact points (per length).
    budget : Budget

    Returns
    -------
    scene : GraspScene
        With the elements found.
    note : str
        The choice in words.
    change : Change or None
        What the fine model changes about it.
    """
    arrays = dict(first.arrays)
    reference = solve_again(with_elements(scene, FINE, _smooth(scene)), first.scene, arrays, budget)
    if reference is None:
        return first.scene, f"the fine model: {_none(budget)}, so no tolerance can be told", None
    note, change, chosen = "", None, first.scene
    for count in ELEMENTS:
        chosen = with_elements(scene, count)
        found = solve_again(chosen, first.scene, arrays, budget)
        if found is None:
            continue
        change = compare(scene, found.arrays, reference.arrays)
        if change.size <= tolerance:
            return chosen, f"{_words(chosen)}: {change}; tolerance {tolerance:.2%} kept", change
        note = f"{_words(chosen)}: {change}; tolerance {tolerance:.2%} NOT kept"
    return chosen, note, change


def _none(budget: Budget) -> str:
    """Why a grasp was not found again."""
    cut = {"clock": "stopped by the clock", "iterations": "the iterations were used up"}
    return cut.get(budget.cut, "no grasp next to this one")


def _words(scene: GraspScene) -> str:
    return ", ".join(f"{setup.name} with {setup.elements} elements ({setup.family})" for setup in scene.setups)


def _smooth(scene: GraspScene) -> str:
    """A family of clothoids that all fingers can have."""
    rubs = any(f.tendons is not None and f.tendons.friction > 0.0 for f in scene.named_fingers.values())
    return "clothoid" if rubs else "matched_clothoid"
