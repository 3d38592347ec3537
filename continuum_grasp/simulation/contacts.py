"""Forces at the contacts of an object during a motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import Core
from continuum_grasp.model import Vec, nearest
from continuum_grasp.results import Dimension, Stored
from continuum_grasp.scene import Curve, GraspObject

_ARRAYS = ("gap", "normal_force", "friction", "lift", "force", "point")
_FRICTION = (
    "friction in the plane, on what touches the object, along its normal turned by +90 degrees; on a table along x"
)


@dataclass(frozen=True)
class ContactHistory:
    """Gaps and forces of C contacts at T instants, as ``stored`` describes them.

    Names are ``finger.1`` and so on, ``finger.tip`` (several fingers have their names instead of ``finger``), then the
    supports.
    """

    stored: ClassVar[tuple[Stored, ...]] = tuple(
        Stored(f"contact_{name}", shape, unit, meaning, f"contacts.{name}")
        for name, shape, unit, meaning in (
            ("gap", "(time, contact)", "m", "distance of the surfaces, negative where they are pressed together"),
            ("normal_force", "(time, contact)", "N", "normal force"),
            ("friction", "(time, contact)", "N", _FRICTION),
            ("lift", "(time, contact)", "N", "force out of the plane, on the object: friction, or what a table bears"),
            ("force", "(time, xy, contact)", "N", "world force on the object in the plane"),
            ("point", "(time, xy, contact)", "m", "point of the force, world"),
        )
    )
    """Arrays that results with `contacts` store."""
    dimension: ClassVar[Dimension] = Dimension(
        "contact", "contacts of the object: finger.1 and so on, finger.tip, then the supports", "contacts.names"
    )

    names: tuple[str, ...]
    gap: Array = field(repr=False)
    normal_force: Array = field(repr=False)
    friction: Array = field(repr=False)
    lift: Array = field(repr=False)
    force: Array = field(repr=False)
    point: Array = field(repr=False)
    fingers: tuple[str, ...] = ("finger",)

    @staticmethod
    def of(core: Core, x: Array, u: Array, w: Array) -> ContactHistory:
        """Contact forces of a compiled system at states x (T, nx), inputs u and forces w."""
        outputs = dict(zip(core.model.touch.name_out(), core.batch("touch", x, u, w), strict=True))
        wanted: dict[str, Any] = {name: np.asarray(outputs[name]) for name in _ARRAYS}
        return ContactHistory(tuple(core.model.touch_names), **wanted)

    @staticmethod
    def from_expressions(
        names: tuple[str, ...], touch: Mapping[str, ca.SX], rows: Callable[[ca.SX], Array]
    ) -> ContactHistory:
        """Contact forces from outputs of ``System.touch``, where ``rows`` gives the values of an expression over
        time.
        """
        arrays: dict[str, Any] = {name: rows(ca.vec(touch[name])) for name in _ARRAYS}
        for name in ("force", "point"):
            arrays[name] = arrays[name].reshape(-1, len(names), 2).transpose(0, 2, 1)
        return ContactHistory(names, **arrays)

    @staticmethod
    def joined(fingers: Mapping[str, ContactHistory]) -> ContactHistory:
        """Contact forces of several fingers by name, each with the supports, which are the same for all."""
        names: list[str] = []
        columns: dict[str, list[Array]] = {name: [] for name in _ARRAYS}
        for finger, contacts in fingers.items():
            indices = [k for k, name in enumerate(contacts.names) if contacts.on_finger(name)]
            names += [f"{finger}.{contacts.names[k].partition('.')[2]}" for k in indices]
            for name, values in columns.items():
                values.append(getattr(contacts, name)[..., indices])
        rest = [k for k, name in enumerate(contacts.names) if not contacts.on_finger(name)]
        for name, values in columns.items():
            values.append(getattr(contacts, name)[..., rest])
        whole: dict[str, Any] = {name: np.concatenate(values, axis=-1) for name, values in columns.items()}
        return ContactHistory((*names, *(contacts.names[k] for k in rest)), **whole, fingers=tuple(fingers))

    def on_finger(self, name: str) -> bool:
        """Whether a contact is one of a finger, and none of a support."""
        return name.partition(".")[0] in self.fingers

    @property
    def shear(self) -> Array:
        """Size of the friction force, in and out of the plane (T, C) [N].

        It is the force without its normal part. The shear of a table is out of the plane: its lift.
        """
        whole = np.square(self.force).sum(axis=1) + np.square(self.lift)
        shear: Array = np.sqrt(np.maximum(whole - np.square(self.normal_force), 0.0))
        return shear

    def at(self, index: int) -> list[tuple[Array, Array, str]]:
        """Forces in the plane at one instant: position (2,) [m], force (2,) [N], and on what: finger or object."""
        forces = []
        for k, name in enumerate(self.names):
            on_finger = self.on_finger(name)
            force = self.force[index, :, k] * (-1.0 if on_finger else 1.0)
            forces.append((self.point[index, :, k], force, "contact" if on_finger else "support"))
        return forces

    def overlap_text(self, run: Any, body: GraspObject, poses: Array, half_thickness: Curve, points: int) -> str:
        """Describe how much deeper the finger of a run lies in an object than its stations are pressed into it, and
        when.

        Empty if it does not lie deeper. Poses of the object are (T, 3 or 4); each backbone is checked at a number of
        points.
        """
        # 50: instants of the search for overlaps
        looked = np.unique(np.linspace(0, len(run.t) - 1, 50).astype(int))
        columns = [k for k, name in enumerate(self.names) if name.startswith("finger.")]
        pressed = np.maximum(0.0, -self.gap[looked][:, columns].min(axis=1))
        beyond = _overlaps(body, poses[looked, :3], run.backbone(looked, points), half_thickness) - pressed
        k = int(beyond.argmax())
        thinnest = float(half_thickness(half_thickness.edges).min())
        # 0.5: overlap between stations that is reported, per the half thickness: what chords cut off is less
        return f"{1e3 * beyond[k]:.2g} mm at t = {run.t[looked[k]]:g} s" if beyond[k] > 0.5 * thinnest else ""


def greatest_motion(body: GraspObject, poses: Array, others: Array) -> float:
    """Distance [m] that no point of an object exceeds between poses (T, 3) or (T, 4) and others."""
    off = poses - others
    # The origin's, and that by the angle, in column 2, at the object's size.
    return float((np.linalg.norm(np.delete(off, 2, axis=1), axis=1) + np.abs(off[:, 2]) * body.size).max())


def _overlaps(body: GraspObject, poses: Array, backbones: Array, half_thickness: Curve) -> Array:
    """Return the deepest overlap of a finger and an object at some instants (T,) [m]; zero while they are apart.

    Poses (T, 3) are the object's x, y [m] and angle [rad], backbones (T, points, 2) the finger's [m], in the world and
    evenly spaced from base to tip.
    """
    half = half_thickness(np.linspace(0.0, half_thickness.edges[-1], backbones.shape[1]))
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    away = backbones - poses[:, None, :2]
    local = np.stack([c * away[..., 0] + s * away[..., 1], c * away[..., 1] - s * away[..., 0]], axis=-1)
    at = ca.SX.sym("at", 2)
    # A function of one point takes all of them as columns.
    distance = ca.Function("distance", [at], [nearest(body.parts, Vec(at[0], at[1])).distance])
    distances = np.array(distance(local.reshape(-1, 2).T)).reshape(local.shape[:2])
    return np.asarray(np.maximum(0.0, (half - distances).max(axis=1)))
