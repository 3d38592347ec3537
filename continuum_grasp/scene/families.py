"""The curvature families: what a scene must know of each, and where its equations are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import AfterValidator, WithJsonSchema
from pydantic_core import PydanticCustomError


@dataclass(frozen=True)
class CurvatureFamily:
    """Properties of a curvature family that scenes use."""

    equations: str
    """Module and name of the subclass of ``model.family.Family``, imported when a model is built."""
    matches_tip: bool = False
    """Whether the curvature at the tip, its last coordinate, is not free but set by the moment balance there. The tip
    then moves with its moment, which must be continuous, and tendons have no friction."""
    one_turn: bool = False
    """Whether an element bends by ``ONE_TURN`` at most."""
    even: bool = False
    """Whether the curvature is the same all along an element."""


DEFAULT_RANGE = 2.0 * math.pi / 3.0
"""Bending range of one element by default [rad]; equation (44) of the paper."""
ONE_TURN = 6.3
"""Greatest bend of an element that is evaluated by quadrature [rad]: as far as its number of nodes is tabulated."""

FAMILIES = {
    "arc": CurvatureFamily("continuum_grasp.model.arc:ArcFamily", even=True),
    "clothoid": CurvatureFamily("continuum_grasp.model.moment_linear:MomentLinearFamily", one_turn=True),
    "matched_clothoid": CurvatureFamily(
        "continuum_grasp.model.moment_linear:MomentLinearFamily", matches_tip=True, one_turn=True
    ),
}
"""All families by name, from coarse to fine; a new one is a line here."""

PAPER_FAMILY = "arc"
"""Curvature family of the paper, doi:10.1155/2014/308283."""


def default_family(*, free_tip: bool) -> str:
    """Name the family of a model where none is stated: the finest one that allows its tip moment.

    ``free_tip``: that moment may jump, or depends on the shape by tendon friction.
    """
    return "clothoid" if free_tip else "matched_clothoid"


def _known(name: str) -> str:
    if name not in FAMILIES:
        *others, last = (repr(each) for each in FAMILIES)
        expected = f"{', '.join(others)} or {last}"
        raise PydanticCustomError("literal_error", "Input should be {expected}", {"expected": expected})
    return name


FamilyName = Annotated[str, AfterValidator(_known), WithJsonSchema({"enum": list(FAMILIES), "type": "string"})]
"""A name of ``FAMILIES``."""
