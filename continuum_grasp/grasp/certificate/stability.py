"""Second-order test of a grasp: does every small motion that the contacts allow raise the energy?

The Lagrangian is energy minus contact force times contact constraint, in the turns of the fingers' nodes and
the object's pose. Where bodies of radii h (tip or peg) and rho (object) roll on each other, the vector y from
the object's center of mass to the center of the other body has, for turns phi of that body and psi of the
object, with n the object's normal and a the arm from the center of mass to the point of contact,

    d2y = -a psi2 - n (h psi2 + 2 h psi (phi - psi) + h2 / (rho + h) (phi - psi)2)

A wall is the limit of a large peg: d2y = -a psi2 + n rho psi2. A pin is the limit rho = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.certificate.recomputed import RecomputedContact, RecomputedFinger, RecomputedGrasp, across
from continuum_grasp.grasp.certificate.rolling import rolling_radius, surface_radius
from continuum_grasp.grasp.certificate.space import SpatialStability

CELLS = 120
"""Pieces per finger, about: the least eigenvalue of shipped grasps is then within 0.2 % of that with 480."""

TENSIONS, LOCKED = "constant tensions", "locked drives, whose tendons are springs"
ASSUMPTIONS = (
    "contacts that press stick, those that do not are left out; middle contacts are pins, "
    "rounded tips, pegs and walls roll without slip on the object's surface as it is curved there; a wall on which "
    "a flat face lies keeps the object from turning; bases and supports are fixed"
)
PLANE = "motion in the plane only: give all fingers a section to test motion out of it"


@dataclass(frozen=True)
class Stability:
    """Verdict of `contact_stability`."""

    in_plane: bool  # the least eigenvalue is positive, or the contacts leave no motion at all
    # Least one of the reduced Hessian in units of E I / L of the first finger; infinite where no motion is left.
    eigenvalue: float
    freedom: int  # number of motions of the discretized rods and the object that the contacts leave
    assumptions: str = f"{TENSIONS}; {ASSUMPTIONS}"  # what the test takes for granted
    # Of motions out of the plane; None where the sections of the fingers are not given.
    in_space: SpatialStability | None = None

    @property
    def stable(self) -> bool:
        """Whether the grasp is stable in the plane and, where that is tested, out of the plane."""
        return self.in_plane and (self.in_space is None or self.in_space.stable)

    def with_space(self, verdict: SpatialStability | None) -> Stability:
        """The verdict with the verdict on motions out of the plane, or that they are not tested."""
        assumptions = f"{self.assumptions}; {PLANE}" if verdict is None else self.assumptions
        return replace(self, in_space=verdict, assumptions=assumptions)

    @property
    def word(self) -> str:
        """Verdict in few words."""
        if not self.in_plane or self.in_space is None:
            return "stable" if self.in_plane else "unstable"
        return "stable in space" if self.in_space.stable else f"stable in the plane only: {self.in_space.motion}"

    @property
    def why(self) -> str:
        """Motion out of the plane that makes it unstable, to end a sentence; empty where it is something else."""
        return f"; in space {self.in_space}" if self.in_plane and not self.stable else ""

    def data(self) -> dict[str, Any]:
        """The verdict as plain data."""
        numbers = {name: getattr(self, name) for name in ("stable", "eigenvalue", "freedom", "assumptions")}
        return {**numbers, "in_space": None if self.in_space is None else self.in_space.data()}


def held_by(fingers: Sequence[RecomputedFinger]) -> str:
    """Tensions or drives that stay while the object moves, in words."""
    locked = [f.name for f in fingers if f.wound is not None and f.wound.law.locks]
    if not locked:
        return TENSIONS
    return LOCKED if len(locked) == len(fingers) else f"{LOCKED} ({', '.join(locked)}), {TENSIONS} elsewhere"


def contact_stability(grasp: RecomputedGrasp, cells: int = CELLS) -> Stability:
    """Least eigenvalue of the energy's Hessian on the motions that the contacts leave.

    The turn of the rods is linear in about ``cells`` pieces each, with bending springs between their ends, so that
    shapes which the optimizer's few elements cannot take, buckling between two contacts for instance, are tested too.
    """
    chains = [_Chain(finger, cells) for finger in grasp.fingers]
    starts = np.cumsum([0, *(chain.nodes.size for chain in chains)])
    size = int(starts[-1]) + 3
    hessian = np.zeros((size, size))
    assumptions = f"{held_by(grasp.fingers)}; {ASSUMPTIONS}"
    # Makes angles of nodes, shifts and turn of the object comparable, however many nodes there are.
    metric = np.concatenate([chain.ds(chain.length) / chain.length for chain in chains] + [[grasp.size**-2] * 2, [1.0]])
    for chain, start in zip(chains, starts, strict=False):
        span = slice(start, start + chain.nodes.size)
        hessian[span, span] = chain.hessian()
    rows: list[Array] = []
    for contact in grasp.contacts:
        if contact.normal_force > EXACT * grasp.force_scale:  # within the tolerance of balance, it holds nothing
            k = None if contact.finger is None else grasp.fingers.index(contact.finger)
            place = None if k is None else (chains[k], int(starts[k]))
            rows.append(_add_contact(hessian, grasp, contact, place))
    scale = 1.0 / np.sqrt(metric)
    if not (np.isfinite(hessian).all() and all(np.isfinite(block).all() for block in rows)):
        return Stability(False, float("nan"), size)
    held = _directions(np.concatenate(rows) * scale) if rows else np.zeros((size, 0))
    freedom = size - held.shape[1]
    if freedom == 0:
        return Stability(True, float("inf"), 0, assumptions)
    # Projected on the motions that are left; in the directions held, an eigenvalue that is not the least.
    reduced = hessian * np.outer(scale, scale)
    reduced -= held @ (held.T @ reduced)
    reduced -= (reduced @ held) @ held.T
    reduced += np.abs(reduced).sum(axis=1).max() * (held @ held.T)
    unit = grasp.fingers[0].stiffness / grasp.fingers[0].length
    least = float(np.linalg.eigvalsh(0.5 * (reduced + reduced.T))[0]) / unit
    return Stability(least > 0.0, least, freedom, assumptions)


class _Chain:
    """A finger by its turns at nodes, linear between them: where contacts bear is a node, and so is the tip, up to
    which locked tendons and rolling contacts bend it.
    """

    def __init__(self, finger: RecomputedFinger, cells: int) -> None:
        self.finger = finger
        self.length = finger.length
        marks = finger.rod.joints[sorted({0, *(contact.joint for contact in finger.contacts), finger.lengths.size})]
        counts = np.maximum(2, np.round(cells * (np.diff(marks) / marks[-1]))).astype(int)  # between contacts
        pieces = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(marks, marks[1:], counts, strict=False)]
        edges = np.concatenate([*pieces, marks[-1:]])
        self.nodes = edges[1:]
        self.bounds = np.append(0.5 * (edges[1:] + edges[:-1]), marks[-1])
        angle = finger.rod.at(finger.curvature, self.nodes)[1]
        mesh = finger.rod.mesh
        profile = finger.profile
        # Turn per moment between nodes, the first being clamped, and mass beyond each node.
        give = 1.0 / profile.bending_stiffness(mesh.nodes)
        self.springs = 1.0 / np.diff(mesh.integrate(give, edges))
        self.bends = np.eye(self.nodes.size) - np.eye(self.nodes.size, k=-1)
        density = profile.linear_density(mesh.nodes)
        self.beyond = mesh.to_edges(density)[-1] - mesh.integrate(density, self.nodes)
        # What each bend draws in of tendons: the mean of their arm, weighted by how a moment bends the finger there.
        self.paths = [
            (self.springs * np.diff(mesh.integrate(give * channel.shape(mesh.nodes), edges)))
            for channel in finger.finger.channels
        ]
        self.tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        self.normal = -np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def ds(self, end: float) -> Array:
        """Length that turns with each node of the finger up to a place [m]."""
        return np.diff(np.minimum(self.bounds, end))

    def hessian(self) -> Array:
        """Hessian of bending, weight and the contact forces that act on the nodes."""
        finger = self.finger
        ds = self.ds(self.length)
        matrix = self.bends.T @ (self.springs[:, None] * self.bends)
        # Weight beyond a node, and forces beyond it, pull along it or push: the second derivative of their work.
        pulls = (self.beyond * ds)[:, None] * finger.gravity
        for mass in finger.finger.masses:
            pulls = pulls + mass.mass * self.ds(mass.at)[:, None] * finger.gravity
        for contact in finger.contacts:
            pulls = pulls + self.ds(finger.rod.joints[contact.joint])[:, None] * contact.force
        matrix[np.diag_indices(ds.size)] += np.sum(self.tangent * pulls, axis=1)
        if finger.wound is not None and finger.wound.law.locks:
            # What a motion draws in elongates the tendons that pull: springs on the path, of which friction passes on
            # a share. A motion's work counts, so the symmetric part.
            (channel,), (path,) = finger.finger.channels, self.paths
            for arm, spring in zip(channel.arms, finger.wound.springs, strict=True):
                passed = path if finger.friction is None else path * finger.friction.shares(arm, self.bounds[:-1])
                work = arm**2 * spring * np.outer(self.bends.T @ passed, self.bends.T @ path)
                matrix += 0.5 * (work + work.T)
        return matrix


def _add_contact(
    hessian: Array, grasp: RecomputedGrasp, contact: RecomputedContact, place: tuple[_Chain, int] | None
) -> Array:
    """Rows of the contact's constraints; its curvature goes into the Hessian."""
    size = len(hessian)
    turn = np.eye(size)[size - 1]
    arm = contact.point - grasp.object.com
    pressure, force = contact.normal_force, contact.force
    h = contact.radius
    rho = surface_radius(grasp, contact)
    # The contact point of the finger or support, less the object's: the motions that sticking leaves out.
    block = np.zeros((2, size))
    block[:, size - 3 : size - 1] = -np.eye(2)
    block -= np.outer(across(arm), turn)
    hessian -= float(force @ arm) * np.outer(turn, turn)
    if place is None:
        both = rolling_radius(h, rho)
        if np.isinf(both):  # a flat face on a wall cannot turn
            return np.concatenate([block, turn[None]])
        hessian += pressure * both * np.outer(turn, turn)
        return block
    chain, start = place
    node = int(np.argmin(np.abs(chain.nodes - chain.finger.rod.joints[contact.joint])))
    lengths = chain.ds(chain.nodes[node])[: node + 1]
    block[:, start : start + node + 1] = (chain.normal[: node + 1] * lengths[:, None]).T
    section = np.eye(size)[start + node]
    if contact.kind == "middle":
        hessian -= pressure * h * np.outer(section, section)
    else:  # the law above; a disc on the finger is tangent only to within the tolerance
        roll = section - turn
        mixed = np.outer(turn, roll)
        hessian -= pressure * h * (np.outer(turn, turn) + mixed + mixed.T)
        if np.isfinite(rho) and h > 0.0:
            hessian -= pressure * h * h / (rho + h) * np.outer(roll, roll)
    block -= np.outer(across(contact.normal), h * section)
    return block


def _directions(jacobian: Array) -> Array:
    """Orthonormal directions (n, m) in which constraints hold motions."""
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    # Constraints of touching contacts may be dependent, two ends of a face for instance: zero up to rounding.
    rank = int((singular > 1e-10 * singular[0]).sum())
    return np.asarray(directions[:rank].T)
