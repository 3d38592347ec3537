"""Shortening of the rod by the pull of its tendons.

A tendon that ends at a section pulls it towards the base, and its tension T compresses the rod between. With the
radius of gyration i of the section, i^2 = I / A, a part of the rod keeps of its length

    1 / (1 + e),    e = sum T i^2 / E I,

which is 1 - e for small strains, and to the second order the length of an incompressible rubber (neo-Hookean), whose
section widens. A link keeps the mean of e along it. Coordinates still describe the uncompressed rod, so that
elasticity, the moments of tendons and all positions along the finger stay as they are; what lies along it comes
nearer. The length follows the tensions at once, without a velocity of its own.
"""

from __future__ import annotations

from collections.abc import Mapping

from continuum_grasp.base import Array, InputError
from continuum_grasp.model.family import Family
from continuum_grasp.model.laws.section import Number, Numbers, SectionLaw
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Curve, Finger


def numbers_of(finger: Finger) -> dict[str, Number]:
    """Radius of gyration at the base; none of a rod that keeps its length."""
    radius = finger.gyration_radius
    return {} if radius is None else {"gyration_radius": Number("m", radius, "gyration_radius", least=0.0)}


def laws_of(finger: Finger, numbers: Numbers) -> list[SectionLaw]:
    """Return nothing: the moments of the sections stay as they are."""
    if finger.gyration_radius is not None and numbers.is_runtime("tendon_friction"):
        raise InputError("tendons that shorten the rod have no friction: leave gyration_radius out", key="parameters")
    return []


def remaining_shares(finger: Finger, family: Family, numbers: Numbers, named: Mapping[str, Scalar]) -> list[Scalar]:
    """Share of its length that each element keeps [1], under inputs by name and unit; none where all have all of it."""
    if finger.gyration_radius is None:
        return []
    mesh, profile, length = family.mesh, finger.profile, finger.rod.length
    depth = profile.half_depth or Curve.along(length, 1.0)

    def compliance(s: Array) -> Array:
        return (depth(s) / float(depth(0.0))) ** 2 / mesh.stiffness(s)

    per_tension: Scalar = numbers["gyration_radius"] * numbers["gyration_radius"] / numbers["bending_stiffness"]
    ends = [tendon.end(length) for tendon in finger.tendon_list]
    shares: list[Scalar] = []
    for k, h in enumerate(mesh.lengths):
        start, end = mesh.span(k)
        strain: Scalar = 0.0
        for tendon, to in enumerate(ends, start=1):
            if to > start:
                mean = float(mesh.integral(start, min(end, to), compliance, mesh.stiffness, depth)) / h
                strain += (mean * per_tension) * named[f"tension_{tendon} [N]"]
        shares.append(1.0 / (1.0 + strain))
    return shares
