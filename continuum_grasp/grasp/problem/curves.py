"""The curves along a finger in units of its own: their structure and their numbers.

For a uniform finger it is its thickness alone; the model has all else that it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import Polynomial

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.shape import skin, steepest
from continuum_grasp.model import CurveSpec, CurvesSpec, Family
from continuum_grasp.scene import Curve, FingerSetup

MOST_PANELS = 16
"""Most parts of a finger on which a curve is one polynomial: every element has Gauss nodes in each of them."""
MOST_STEEP = 0.7
"""Greatest slope of half the thickness [1]: the skin then leans by 45 degrees, and discs cover no steeper one."""


def curves_of(setup: FingerSetup, weighs: bool) -> CurvesSpec:
    """The structure of a finger's curves."""
    if setup.graded and Family.named(setup.family).degree != 1:
        raise InputError(
            f"in a grasp, elements of family {setup.family} cannot follow a finger that changes along its length: "
            "use matched_clothoid",
            key=setup.key("fidelity", "family"),
        )
    made = _curves(setup, weighs)
    steep = steepest(skin(setup.finger.profile.half_thickness))
    if steep > MOST_STEEP:
        raise InputError(
            f"half the thickness of {setup.name} changes by {steep:.2g} per length where its corners are rounded, "
            f"more than {MOST_STEEP}: give smaller jumps, or half_thickness",
            key=f"{setup.where}.rod",
        )
    panels = max(each.spec.panels for each in made)
    if panels > MOST_PANELS:
        raise InputError(
            f"{setup.name} has {panels} parts with separate curves; a grasp allows at most {MOST_PANELS}: use fewer "
            "sections or samples",
            key=f"{setup.where}.rod",
        )
    return CurvesSpec(tuple(each.spec for each in made))


@dataclass(frozen=True)
class _Made:
    """A curve on the panels: coefficients (panels, degree + 1) per powers of the distance, lengths per L."""

    spec: CurveSpec
    edges: Array  # per L
    coefficients: Array


def curve_numbers(setup: FingerSetup, weighs: bool) -> Array:
    """The run-time numbers of a finger's curves, in the order of its `CurvesSpec`."""
    made = _curves(setup, weighs)
    edges = {each.spec.group: each.edges[1:-1] for each in made}
    return np.concatenate([*edges.values(), *(each.coefficients.ravel() for each in made)])


def _curves(setup: FingerSetup, weighs: bool) -> list[_Made]:
    """All curves of a finger: per E I (its mean), rho A at its base and L where they have units."""
    finger = setup.finger
    profile = setup.finger.profile
    length = setup.finger.profile.length
    thickness = _alone("thickness", skin(profile.half_thickness), 1.0 / length)
    if not setup.graded:
        return [thickness]
    (channel,) = finger.channels  # a grasp has a pair of tendons, which run alike
    edges = (0.0, *(end for _, end in profile.panels().cut(channel.shape)))
    curves = [
        _made("stiffness", profile.bending_stiffness, edges, 1.0 / setup.stiffness),
        _made("rest", profile.rest_curvature, edges, length),
        thickness,
        _made("channel", channel.shape, edges, 1.0),
    ]
    if finger.strain_limit is not None and profile.half_depth is not None:
        curves.append(_alone("depth", profile.half_depth, 1.0 / length))
    if weighs:
        curves.append(_made("density", profile.linear_density, edges, 1.0 / finger.rod.mass_per_length))
    return curves


def _alone(name: str, curve: Curve, scale: float) -> _Made:
    return _made(name, curve, (0.0, *curve.breaks, curve.edges[-1]), scale)


@lru_cache(maxsize=64)
def _made(name: str, curve: Curve, edges: tuple[float, ...], scale: float) -> _Made:
    degree = max(len(c) for c in curve.coefficients) - 1
    rows = []
    for a in edges[:-1]:
        piece = int(np.searchsorted(curve.edges[1:-1], a + 1e-9 * edges[-1]))
        shifted = curve.local(piece, a)(Polynomial([0.0, edges[-1]]))
        row = np.zeros(degree + 1)
        row[: len(shifted.coef)] = shifted.coef
        if curve.exponential:
            row[0] += np.log(scale)
        rows.append(row if curve.exponential else scale * row)
    return _Made(CurveSpec(name, len(rows), degree, curve.exponential), np.array(edges) / edges[-1], np.array(rows))
