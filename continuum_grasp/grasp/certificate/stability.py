"""Second-order test of a grasp: does every small motion that the contacts allow raise the energy?

The Lagrangian is energy minus contact force times contact constraint, in the angles of the fingers' cells and
the object's pose. Where bodies of radii h (tip or peg) and rho (object) roll on each other, the vector y from
the object's center of mass to the center of the other body has, for turns phi of that body and psi of the
object, with n the object's normal and a the arm from the center of mass to the point of contact,

    d2y = -a psi2 - n (h psi2 + 2 h psi (phi - psi) + h2 / (rho + h) (phi - psi)2)

A wall is the limit of a large peg: d2y = -a psi2 + n rho psi2. A pin is the limit rho = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.check import EQUILIBRIUM, GAP
from continuum_grasp.grasp.certificate.recomputed import RecomputedContact, RecomputedFinger, RecomputedGrasp, across

Array = NDArray[Any]

CELLS = 120
"""Rigid pieces per finger, about: the least eigenvalue of shipped grasps is then within 0.2 % of that with 480."""

TENSIONS, LOCKED = "constant tensions", "locked drives, whose tendons are springs"
ASSUMPTIONS = (
    "contacts that press stick, those that do not are left out; middle contacts are pins, "
    "rounded tips, pegs and walls roll without slip on the object's surface as it is curved there; a wall on which "
    "a flat face lies keeps the object from turning; bases and supports are fixed; motion in the plane only"
)


@dataclass(frozen=True)
class Stability:
    """Verdict of `contact_stability`."""

    stable: bool  # the least eigenvalue is positive, or the contacts leave no motion at all
    # Least one of the reduced Hessian in units of E I / L of the first finger; infinite where no motion is left.
    eigenvalue: float
    freedom: int  # number of motions of the discretized rods and the object that the contacts leave
    assumptions: str = f"{TENSIONS}; {ASSUMPTIONS}"  # what the test takes for granted


def contact_stability(grasp: RecomputedGrasp, cells: int = CELLS) -> Stability:
    """Least eigenvalue of the energy's Hessian on the motions that the contacts leave.

    The rods are cut into about ``cells`` rigid pieces each with bending springs between them, so that shapes
    which the optimizer's few elements cannot take, buckling between two contacts for instance, are tested too.
    """
    chains = [_Chain(finger, cells) for finger in grasp.fingers]
    starts = np.cumsum([0, *(chain.ds.size for chain in chains)])
    size = int(starts[-1]) + 3
    hessian = np.zeros((size, size))
    locked = [f.name for f in grasp.fingers if f.wound is not None and f.wound.law.locks]
    how = LOCKED if len(locked) == len(chains) else f"{LOCKED} ({', '.join(locked)}), {TENSIONS} elsewhere"
    assumptions = f"{how if locked else TENSIONS}; {ASSUMPTIONS}"
    # Makes angles of cells, shifts and turn of the object comparable, however many cells there are.
    metric = np.concatenate([chain.ds / chain.length for chain in chains] + [[grasp.size**-2] * 2, [1.0]])
    for chain, start in zip(chains, starts, strict=False):
        own = slice(start, start + chain.ds.size)
        hessian[own, own] = chain.hessian()
    rows: list[Array] = []
    for contact in grasp.contacts:
        if contact.normal_force > EQUILIBRIUM * grasp.force_scale:  # within the tolerance of balance, it holds nothing
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
    """A finger cut into rigid cells, with joints of the elements at cell ends."""

    def __init__(self, finger: RecomputedFinger, cells: int) -> None:
        self.finger, self.length = finger, finger.length
        marks = finger.rod.joints[sorted({0, *(load.joint for load in finger.loads), finger.lengths.size})]
        counts = np.maximum(2, np.round(cells * (np.diff(marks) / marks[-1]))).astype(int)  # between contacts
        pieces = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(marks, marks[1:], counts, strict=False)]
        self.edges = np.concatenate([*pieces, marks[-1:]])
        self.ds = np.diff(self.edges)
        middles = 0.5 * (self.edges[1:] + self.edges[:-1])
        angle = finger.rod.at(finger.curvature, middles)[1]
        mesh, profile = finger.rod.mesh, finger.profile
        # Turn per moment between middles of neighbors, the first being clamped, and mass beyond each middle.
        give = mesh.integrate(1.0 / profile.bending_stiffness(mesh.nodes), np.append(0.0, middles))
        self.springs = 1.0 / np.diff(give)
        density = profile.linear_density(mesh.nodes)
        self.beyond = mesh.to_edges(density)[-1] - mesh.integrate(density, middles)
        # A turn of a cell moves all beyond it by the cell's length along its normal.
        self.tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        self.arm = -np.stack([np.cos(angle), np.sin(angle)], axis=-1) * self.ds[:, None]

    def reach(self, joint: int) -> int:
        """Number of cells before a joint of elements."""
        return int(np.argmin(np.abs(self.edges - self.finger.rod.joints[joint])))

    def hessian(self) -> Array:
        """Of bending, weight and the contact forces that act on the cells."""
        finger, ds = self.finger, self.ds
        matrix = np.zeros((ds.size, ds.size))
        springs = self.springs[1:]
        index = np.arange(ds.size - 1)
        matrix[0, 0] += self.springs[0]
        matrix[index, index] += springs
        matrix[index + 1, index + 1] += springs
        matrix[index, index + 1] -= springs
        matrix[index + 1, index] -= springs
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        # Weight beyond a cell, and forces beyond it, pull along it or push: the second derivative of their work.
        beyond = self.beyond
        for mass in finger.finger.masses:
            beyond = beyond + np.where(middle < mass.at, mass.mass, 0.0)
        matrix[np.diag_indices(ds.size)] += beyond * (self.tangent @ finger.gravity) * ds
        if finger.wound is not None and finger.wound.law.locks:
            # What a motion draws in elongates the tendons that pull: a spring on the path.
            (channel,) = finger.finger.channels
            arms = abs(channel.arms[0]) * channel.shape(self.edges[:-1])
            path = arms - np.append(arms[1:], 0.0)
            matrix += finger.wound.stiffness * np.outer(path, path)
        for load in finger.loads:
            reach = self.reach(load.joint)
            matrix[range(reach), range(reach)] += (self.tangent[:reach] @ load.force) * ds[:reach]
        return matrix


def _add_contact(
    hessian: Array, grasp: RecomputedGrasp, contact: RecomputedContact, place: tuple[_Chain, int] | None
) -> Array:
    """Rows of the contact's constraints; its curvature goes into the Hessian."""
    size = len(hessian)
    turn = np.eye(size)[size - 1]
    arm = contact.point - grasp.object.com
    pressure, force = contact.normal_force, contact.force
    h, rho = contact.radius, _surface_radius(grasp, contact)
    # The contact point of the finger or support, less that of the object: the motions that sticking leaves out.
    block = np.zeros((2, size))
    block[:, size - 3 : size - 1] = -np.eye(2)
    block -= np.outer(across(arm), turn)
    hessian -= float(force @ arm) * np.outer(turn, turn)
    if place is None:
        if np.isinf(rho) and np.isinf(h):  # a flat face on a wall cannot turn
            return np.concatenate([block, turn[None]])
        # The law above for phi = 0: h rho / (h + rho), which tends to the other radius where one is flat.
        both = rho if np.isinf(h) else h if np.isinf(rho) else 0.0 if h + rho == 0.0 else h * rho / (h + rho)
        hessian += pressure * both * np.outer(turn, turn)
        return block
    chain, start = place
    reach = chain.reach(contact.joint)
    block[:, start : start + reach] = chain.arm[:reach].T
    section = np.zeros(size)
    if contact.kind == "middle":  # between two cells, whose mean is the section's angle
        section[[start + reach - 1, start + reach]] = 0.5
        hessian -= pressure * h * np.outer(section, section)
    else:
        if contact.kind == "station":  # a disc on the finger: tangent only to within the tolerance
            section[[start + reach - 1, start + reach]] = 0.5
        else:
            section[start + reach - 1] = 1.0  # the last cell: phi of the law above
        roll = section - turn
        mixed = np.outer(turn, roll)
        hessian -= pressure * h * (np.outer(turn, turn) + mixed + mixed.T)
        if np.isfinite(rho) and h > 0.0:
            hessian -= pressure * h * h / (rho + h) * np.outer(roll, roll)
    block -= np.outer(across(contact.normal), h * section)
    return block


def _surface_radius(grasp: RecomputedGrasp, contact: RecomputedContact) -> float:
    """Radius of curvature where the object is touched; within the tolerance of places a face ends in its corner [m]."""
    if np.isfinite(contact.surface_radius):
        return contact.surface_radius
    beside = GAP * contact.length * across(contact.normal)
    seen = contact.point + contact.length * contact.normal + np.stack([-beside, beside])
    return float(np.min(grasp.object.nearest(seen, contact.part).radius))


def _directions(jacobian: Array) -> Array:
    """Orthonormal directions (n, m) in which constraints hold motions."""
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    # Constraints of touching contacts may be dependent, two ends of a face for instance: zero up to rounding.
    rank = int((singular > 1e-10 * singular[0]).sum())
    return np.asarray(directions[:rank].T)
