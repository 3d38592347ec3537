"""The inequalities of a grasp: friction cones, clearance of object and palm, limits of finger and model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from continuum_grasp.scene.grasp import OutOfPlaneGravity

if TYPE_CHECKING:
    from continuum_grasp.grasp.problem import GraspProblem

__all__ = ["add_limits"]

APEX = 1e-3
"""Rounding of the apex of the spatial friction cones (scaled force); the rounded cone lies inside the true
one."""


def add_limits(problem: GraspProblem) -> None:
    """Add the inequalities to a problem whose unknowns and contacts are there."""
    _bound_contacts(problem)
    _keep_clear(problem)
    _keep_limits(problem)


def _bound_contacts(problem: GraspProblem) -> None:
    most = problem.scene.contacts.normal_force_max + problem.give["normal force"]
    spatial = isinstance(problem.scene.gravity, OutOfPlaneGravity)
    for contact in problem.contacts:
        n, f, lift = contact.force[0], contact.force[1], contact.force[2]
        key = "palm.friction" if contact.name == "palm" else "contacts.friction"
        if spatial:
            cone = contact.friction * n - ca.sqrt(f**2 + lift**2 + (APEX * problem.force_scale) ** 2)
        else:
            cone = ca.vertcat(contact.friction * n - f, contact.friction * n + f)
        problem.parts.require(f"friction cone, {contact.name}", cone, problem.force_scale, "N", key, upper=np.inf)
        problem.parts.require(
            f"normal force, {contact.name}",
            n - most,
            problem.force_scale,
            "N",
            "contacts.normal_force_max",
            lower=-np.inf,
        )


def _keep_clear(problem: GraspProblem) -> None:
    scene, tolerance = problem.scene, problem.scene.solver.penetration_tolerance
    reach = scene.object.radius + problem.finger.thickness_radius
    centre = ca.DM(scene.object.position)
    starts = ca.vertcat(0, ca.cumsum(problem.lengths))
    touching = [False] * problem.count  # at their far ends
    touching[problem.before - 1], touching[-1] = problem.middle_on, problem.tip_on
    clear, height = [], []
    base_height = 0.0 if scene.palm is None else min(0.0, scene.palm.height(problem.finger.base.position))
    for k in range(problem.count):
        for j in range(1, problem.samples + 1):
            s = starts[k] + problem.lengths[k] * (j / problem.samples)
            point = problem.position(s)
            if not (j == problem.samples and touching[k]):
                clear.append(ca.norm_2(point - centre) - reach + problem.give["room at the object"])
            if scene.palm is not None:
                off = ca.dot(ca.DM(scene.palm.normal), point - ca.DM(scene.palm.point))
                needed = problem.finger.thickness_radius if k >= problem.before else base_height
                height.append(off - needed + problem.give["room at the palm"])
    problem.parts.require(
        "penetration into the object",
        ca.vertcat(*clear),
        problem.length,
        "m",
        "object",
        lower=-tolerance * problem.length,
        upper=np.inf,
    )
    if height:
        problem.parts.require(
            "penetration into the palm",
            ca.vertcat(*height),
            problem.length,
            "m",
            "palm",
            lower=-tolerance * problem.length,
            upper=np.inf,
        )


def _keep_limits(problem: GraspProblem) -> None:
    require, give = problem.parts.require, problem.give
    tension_scale = problem.moment_scale / problem.tendons.offset
    over = problem.tensions - problem.tendons.max_tension - give["tension"]
    require("tendon tension", over, tension_scale, "N", "finger.tendons.max_tension", lower=-np.inf)
    bends = problem.model.bending(problem.q, problem.u, problem.lengths)
    most = problem.scene.bending_range + give["bending range"]
    over = ca.vertcat(bends - most, -bends - most)
    require("bending range", over, 1.0, "rad", "fidelity.bending_range", lower=-np.inf)
    limit = problem.finger.curvature_limit
    if np.isfinite(limit):
        curvature = problem.curvatures
        over = ca.vertcat(curvature - limit - give["strain"], -curvature - limit - give["strain"])
        require("bending strain", over, 1.0 / problem.length, "1/m", "finger.strain_limit", lower=-np.inf)
