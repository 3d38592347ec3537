"""Second-order test of a grasp: does every small motion that the contacts allow raise the energy?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.dense_rod import DenseRod
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.grasp import GraspScene, PlanarGravity

__all__ = ["Stability", "contact_stability"]

Array = NDArray[Any]

ASSUMPTIONS = (
    "constant tensions; contacts stick; the middle contact is a pin, the rounded tip and the palm roll "
    "without slip; motion in the plane only"
)


@dataclass(frozen=True)
class Stability:
    """Verdict of `contact_stability`.

    Attributes
    ----------
    stable : bool
        The least eigenvalue is positive, or the contacts leave no motion at all.
    eigenvalue : float
        Least eigenvalue of the reduced Hessian in units of E I / L (infinite where no motion is left).
    freedom : int
        Number of motions of the discretised rod and the object that the contacts leave.
    assumptions : str
        What the test takes for granted.
    """

    stable: bool
    eigenvalue: float
    freedom: int
    assumptions: str = ASSUMPTIONS


def contact_stability(
    scene: GraspScene, rod: DenseRod, ends: Array, contacts: dict[str, tuple[Array, Array]], cells: int = 120
) -> Stability:
    """Least eigenvalue of the energy's Hessian on the motions that the contacts leave.

    The rod is cut into ``cells`` rigid pieces with bending springs between them, so that shapes which the
    optimiser's few elements cannot take, buckling between two contacts for instance, are tested too. Unknowns
    are the pieces' angles and the object's pose; the Lagrangian is energy minus contact force times contact
    constraint.

    Parameters
    ----------
    scene : GraspScene
    rod : DenseRod
        The bent rod.
    ends : ndarray, shape (N, 2)
        Curvatures at the ends of its elements [1/m].
    contacts : dict
        ``middle``, ``tip``, ``palm``: (outward normal of the object, force on what touches it [N]), both
        (2,).
    cells : int, optional
        Number of rigid pieces.
    """
    finger, length = scene.finger, float(rod.joints[-1])
    joint = rod.joints[scene.elements_before_middle]
    before = min(max(2, round(cells * joint / length)), cells - 2)
    edges = np.concatenate([np.linspace(0, joint, before + 1), np.linspace(joint, length, cells - before + 1)[1:]])
    ds = np.diff(edges)
    angle = np.interp(0.5 * (edges[1:] + edges[:-1]), rod.edges, rod.edge_angle(ends))
    tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    arm = -np.stack([np.cos(angle), np.sin(angle)], axis=-1) * ds[:, None]

    size, turn = cells + 3, cells + 2
    hessian = np.zeros((size, size))
    _add_bending(hessian, finger.rod.stiffness, ds)
    if isinstance(scene.gravity, PlanarGravity):
        along = tangent @ np.asarray(scene.gravity.vector)
        _add_weight(hessian, scene.finger, edges, along, ds)
    rows: list[Array] = []
    radius, thickness = scene.object.radius, finger.thickness_radius
    for name, (normal, force) in contacts.items():
        across = np.array([-normal[1], normal[0]])
        pressure = float(normal @ force)
        block = np.zeros((2, size))
        if name == "palm":  # n . dc = 0, t . dc + R dpsi = 0
            block[0, cells : cells + 2], block[1, cells : cells + 2] = normal, across
            block[1, turn] = radius
        else:
            reach = before if name == "middle" else cells
            block[:, :reach] = arm[:reach].T
            block[:, cells : cells + 2] = -np.eye(2)
            hessian[range(reach), range(reach)] += (tangent[:reach] @ force) * ds[:reach]
            section = np.zeros(size)
            section[[before - 1, before] if name == "middle" else [cells - 1]] = 0.5 if name == "middle" else 1.0
            spin = np.eye(size)[turn]
            block -= np.outer(across, thickness * section + radius * spin)
            if name == "middle":
                hessian -= pressure * (thickness * np.outer(section, section) + radius * np.outer(spin, spin))
            else:
                roll = (thickness * section + radius * spin) / (thickness + radius)
                hessian -= pressure * (thickness + radius) * np.outer(roll, roll)
        rows.append(block)
    metric = np.concatenate([ds / length, [length**-2, length**-2, 1.0]])
    scale = 1.0 / np.sqrt(metric)
    jacobian = np.concatenate(rows) * scale
    _, singular, directions = np.linalg.svd(jacobian)
    rank = int((singular > 1e-10 * singular[0]).sum())
    free = directions[rank:].T
    if free.shape[1] == 0:
        return Stability(True, float("inf"), 0)
    if not np.isfinite(hessian).all():
        return Stability(False, float("nan"), free.shape[1])
    reduced = free.T @ (hessian * np.outer(scale, scale)) @ free
    least = float(np.linalg.eigvalsh(0.5 * (reduced + reduced.T))[0]) * length / finger.rod.stiffness
    return Stability(least > 0.0, least, free.shape[1])


def _add_bending(hessian: Array, stiffness: float, ds: Array) -> None:
    springs = 2 * stiffness / (ds[1:] + ds[:-1])
    index = np.arange(ds.size - 1)
    hessian[0, 0] += 2 * stiffness / ds[0]
    hessian[index, index] += springs
    hessian[index + 1, index + 1] += springs
    hessian[index, index + 1] -= springs
    hessian[index + 1, index] -= springs


def _add_weight(hessian: Array, finger: Finger, edges: Array, along: Array, ds: Array) -> None:
    middle = 0.5 * (edges[1:] + edges[:-1])
    beyond = finger.rod.mass_per_length * (edges[-1] - middle)
    for mass in finger.masses:
        beyond = beyond + np.where(middle < mass.at, mass.mass, 0.0)
    index = np.arange(ds.size)
    hessian[index, index] += beyond * along * ds
