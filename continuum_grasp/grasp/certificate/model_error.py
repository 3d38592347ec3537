"""What stored numbers can be trusted with: whether they are whole, and how far the exact elastic rods under the forces
found would be from the grasp's shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import SolverError
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.certificate.recomputed_finger import RecomputedFinger
from continuum_grasp.rod.dense_rod import Mesh, panel_edges
from continuum_grasp.rod.dimensionless import RodProblem
from continuum_grasp.rod.elastica import deformed
from continuum_grasp.rod.equations import RodEquations
from continuum_grasp.scene.families import FAMILIES
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

SMALL = 0.005
"""Greatest displacement per finger length [1] that is not warned of: half a millimeter of a finger of 0.1 m."""
SECTIONS = 200
"""Sections at which moments are compared, about: two per panel, as near to the ends of elements as 0.2 % of the length.
"""
LEAST_MOMENT = 1e-6
"""Of the moments in play [1]: less than this is rounding, and the share of a straight finger's moment means nothing."""

_OF_FINGERS = ("q", "lengths", "curvature_shapes", "tip_curvature", "tensions", "base", "backbone")
_SHARED = ("object.pose", "contact_positions", "contact_normals", "contact_forces", "contact_parts")


@dataclass(frozen=True)
class ModelError:
    """What the fingers' curvature families leave out; it falls with the number of elements.

    Attributes
    ----------
    displacements : dict of str to float
        How far the exact rods are from the grasp's shape [m], at the contacts by name and at the tips as
        ``<finger>.tip``; those of a finger are missing where no equilibrium of its exact rod was found near the
        grasp.
    length : float
        Of the shortest finger [m].
    moment : float
        Greatest difference between the bending moment of a finger's shape and that of the forces beyond each
        section, as a part of the greatest moment.
    lost : tuple of str
        Fingers whose exact rods have no equilibrium near the grasp.
    """

    displacements: dict[str, float]
    length: float
    moment: float
    lost: tuple[str, ...] = ()

    @property
    def found(self) -> bool:
        """Whether every exact rod has an equilibrium near the grasp."""
        return bool(self.displacements) and not self.lost

    @property
    def greatest(self) -> float:
        """Greatest displacement [m]; infinite where one was not found."""
        return max(self.displacements.values()) if self.found else float("inf")

    @property
    def limit(self) -> float:
        """Greatest displacement that is passed over in silence: 0.5 % of the shortest finger's length [m]."""
        return SMALL * self.length

    @property
    def small(self) -> bool:
        """Whether the displacements are within the limit."""
        return self.greatest <= self.limit

    def __str__(self) -> str:
        if not self.found:
            of = f" of {', '.join(self.lost)}" if self.lost else ""
            return f"the exact rod{of} under these forces has no equilibrium near this shape"
        parts = [f"{1e3 * off:.2g} mm at {name}" for name, off in self.displacements.items()]
        return f"the exact rod under these forces differs by {' and '.join(parts)}"


def model_error(grasp: RecomputedGrasp) -> ModelError:
    """Compare the fingers of a grasp with the equilibria of exact rods under their forces.

    Parameters
    ----------
    grasp : RecomputedGrasp

    Returns
    -------
    ModelError
    """
    displacements: dict[str, float] = {}
    lost, moment = [], 0.0
    for finger in grasp.fingers:
        problem = _problem(finger)
        moment = float(np.maximum(moment, _moment_left_out(finger, problem)))
        try:
            exact = deformed(problem, partial(finger.rod.curvature, finger.profile))
        except SolverError:
            lost.append(finger.name)
            continue
        joints = {load.name: load.joint for load in finger.loads} | {finger.setup.tip_name: finger.lengths.size}
        for name, joint in joints.items():
            off = exact.position(finger.joint_position(joint)) - finger.points[finger.joint_edges[joint]]
            displacements[name] = float(np.hypot(*off))
    return ModelError(displacements, min(f.length for f in grasp.fingers), moment, tuple(lost))


def _problem(bent: RecomputedFinger) -> RodProblem:
    """The finger under its weight, tendons and contact forces, which keep their world directions."""
    return RodProblem.of(
        bent.finger,
        complex(*bent.gravity),
        base=(complex(*bent.base[:2]), float(bent.base[2])),
        dead=[(bent.joint_position(load.joint), complex(*load.force)) for load in bent.loads],
        couples=[(bent.joint_position(load.joint), load.couple) for load in bent.loads],
        tip_moment=bent.tip_moment,
        marks=bent.rod.joints.tolist(),
    )


def _moment_left_out(bent: RecomputedFinger, problem: RodProblem) -> float:
    """Moment of the shape against that of everything beyond a section, greatest relative difference."""
    equations = RodEquations(problem, Mesh(panel_edges(problem.breaks, 2.0 / SECTIONS), 2))
    shape = bent.length * bent.rod.curvature(bent.profile, bent.length * equations.mesh.nodes)
    gap = equations.balance(shape).missing
    least = LEAST_MOMENT * bent.moment_scale(0.0) * bent.length / bent.stiffness
    return float(np.abs(gap).max() / max(np.abs(shape - equations.rest - gap).max(), least))


def not_finite(scene: GraspScene, arrays: Mapping[str, Any]) -> int:
    """How many of the numbers of a grasp are NaN or infinite; the stations of supports are NaN by right."""
    names = [f"{setup.name}.{name}" for setup in scene.setups for name in _OF_FINGERS]
    found = [_numbers(arrays.get(name, 0.0)) for name in (*names, *_SHARED)]
    return sum(int((~np.isfinite(values)).sum()) for values in found if values is not None)


def misfits(scene: GraspScene, arrays: Mapping[str, Any]) -> list[str]:
    """What is missing, misshapen or of another family than the scene's, by name."""
    return [name for name, wrong in _examined(scene, arrays) if wrong]


def _examined(scene: GraspScene, arrays: Mapping[str, Any]) -> Iterator[tuple[str, bool]]:
    for setup in scene.setups:
        n, shapes = setup.elements, _shape(arrays, f"{setup.name}.curvature_shapes") or ()
        coordinates = (shapes[-1] if shapes else 0) - FAMILIES[setup.family].matches_tip
        family = f"{setup.name}.family"
        yield family, str(arrays.get(family)) != setup.family
        own: dict[str, tuple[int, ...]] = {
            "q": (coordinates,),
            "lengths": (n,),
            "tip_curvature": (),
            "tensions": (2,),
            "base": (3,),
        }
        for name, shape in own.items():
            yield f"{setup.name}.{name}", _shape(arrays, f"{setup.name}.{name}") != shape
        yield f"{setup.name}.curvature_shapes", len(shapes) != 3 or shapes[0] != n or 0 in shapes
        backbone = _shape(arrays, f"{setup.name}.backbone")
        yield f"{setup.name}.backbone", backbone is None or len(backbone) != 2 or backbone[0] < 2 or backbone[1] != 4
    yield "object.pose", _shape(arrays, "object.pose") != (3,)
    names = np.asarray(arrays.get("contact_names", 0.0))
    count = names.size
    yield "contact_names", "contact_names" not in arrays or names.shape != (count,)
    shared: dict[str, tuple[int, ...]] = {
        "contact_positions": (count, 2),
        "contact_normals": (count, 2),
        "contact_forces": (count, 3),
        "contact_stations": (count,),
        "contact_parts": (count,),
    }
    for name, shape in shared.items():
        yield name, _shape(arrays, name) != shape
    parts = _numbers(arrays.get("contact_parts"))
    known = np.arange(len(scene.object.parts))
    yield "contact_parts", parts is None or not bool(np.isin(parts, known).all())


def _numbers(value: Any) -> Any:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return None


def _shape(arrays: Mapping[str, Any], name: str) -> tuple[int, ...] | None:
    values = _numbers(arrays[name]) if name in arrays else None
    return None if values is None else tuple(values.shape)
