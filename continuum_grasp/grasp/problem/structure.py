"""Structure of the equations of a grasp; two scenes of one structure share one compiled solver."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from continuum_grasp.grasp.problem.unit_finger import FingerSpec
from continuum_grasp.grasp.starts.values import ContactStart
from continuum_grasp.model.surfaces import surface_of
from continuum_grasp.model.surfaces.surface import Surface
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity, PlanarGravity


@dataclass(frozen=True)
class ContactSpec:
    """A contact.

    Attributes
    ----------
    name : str
    finger : int
        Index of the finger; -1 for a support's.
    joint : int
        Index of the middle contact along the finger; -1 for the tip, -2 for a support's.
    peg : bool
        Whether the support is round.
    surface : Surface
        Of the part that is touched.
    bounded : bool
        Whether the support is a finite line.
    """

    name: str
    finger: int
    joint: int
    peg: bool
    surface: Surface[Any]
    bounded: bool


@dataclass(frozen=True)
class ProblemSpec:
    """A grasp problem but for its numbers.

    Attributes
    ----------
    fingers : tuple of FingerSpec
    contacts : tuple of ContactSpec
        Those that are on.
    surfaces : tuple of Surface
        Of the object's convex parts.
    planes, lines, pegs : int
        Supports: half planes, finite lines, round ones.
    free : bool
        Whether the object's pose is sought.
    gravity : {"planar", "out_of_plane", "none"}
    tilt : bool
        Whether the tilt balance holds.
    aims : tuple of str
        Objectives with a weight.
    wrenches : int
        Disturbances, where they are an aim.
    locked : bool
        Whether tendons are locked under disturbances.
    """

    fingers: tuple[FingerSpec, ...]
    contacts: tuple[ContactSpec, ...]
    surfaces: tuple[Surface[Any], ...]
    planes: int
    lines: int
    pegs: int
    free: bool
    gravity: str
    tilt: bool
    aims: tuple[str, ...]
    wrenches: int
    locked: bool

    @staticmethod
    def of(scene: GraspScene, contacts: dict[str, ContactStart]) -> ProblemSpec:
        """The structure of the problem of a scene with some contacts on, which sit where a start has them."""
        gravity, aims, parts = scene.gravity, scene.aims, scene.object.parts
        planar, on = isinstance(gravity, PlanarGravity), frozenset(contacts)
        setups = scene.setups
        places: dict[str, tuple[int, int]] = {}
        for i, setup in enumerate(setups):
            places |= {name: (i, k) for k, name in enumerate(setup.middle_names)}
            places[setup.tip_name] = (i, -1)
        pegs = {peg.name for peg in scene.pegs}
        bounded = {wall.name for wall in scene.walls if math.isfinite(wall.half_length)}
        made = []
        for name, start in contacts.items():
            finger, joint = places.get(name, (-1, -2))
            support = support_of(name, scene)
            surface = surface_of(parts[start.part])
            made.append(ContactSpec(name, finger, joint, support in pegs, surface, support in bounded))
        disturbed = "greatest_disturbance" in aims
        return ProblemSpec(
            fingers=tuple(FingerSpec.of(s, on, planar and any(gravity.vector)) for s in setups),  # type: ignore[union-attr]
            contacts=tuple(made),
            surfaces=tuple(surface_of(part) for part in parts),
            planes=sum(math.isinf(wall.half_length) for wall in scene.walls),
            lines=sum(math.isfinite(wall.half_length) for wall in scene.walls),
            pegs=len(scene.pegs),
            free=scene.object.free is not None,
            gravity=gravity.mode,
            tilt=isinstance(gravity, OutOfPlaneGravity) and gravity.tilt == "balance",
            aims=aims,
            wrenches=len(scene.wrenches) if disturbed else 0,
            locked=disturbed and scene.disturbances.tendons == "locked",
        )


def support_of(contact: str, scene: GraspScene) -> str:
    """Name of the wall or peg of a contact; empty for a finger's."""
    names = [body.name for body in scene.places]
    return next((n for n in names if contact in (n, f"{n}.1", f"{n}.2")), "")
