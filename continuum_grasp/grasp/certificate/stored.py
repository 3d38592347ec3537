"""Whether the stored numbers of a grasp are all there, of the right shapes, and finite."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from continuum_grasp.scene.families import FAMILIES
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

__all__ = ["misfits", "not_finite"]

_OF_FINGERS = ("q", "lengths", "curvature_shapes", "tip_curvature", "tensions", "base", "backbone")
_SHARED = ("object.pose", "contact_positions", "contact_normals", "contact_forces", "contact_parts")


def not_finite(setups: tuple[FingerSetup, ...], arrays: Mapping[str, Any]) -> int:
    """How many of the numbers of a grasp are NaN or infinite; the stations of supports are NaN by right."""
    names = [f"{setup.name}.{name}" for setup in setups for name in _OF_FINGERS]
    found = [_numbers(arrays.get(name, 0.0)) for name in (*names, *_SHARED)]
    return sum(int((~np.isfinite(values)).sum()) for values in found if values is not None)


def misfits(scene: GraspScene, setups: tuple[FingerSetup, ...], arrays: Mapping[str, Any]) -> list[str]:
    """What is missing, misshapen or of another family than the scene's, by name."""
    return [name for name, wrong in _examined(scene, setups, arrays) if wrong]


def _examined(
    scene: GraspScene, setups: tuple[FingerSetup, ...], arrays: Mapping[str, Any]
) -> Iterator[tuple[str, bool]]:
    for setup in setups:
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
