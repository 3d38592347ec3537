"""What is sought: least tension, least greatest normal force, greatest disturbance or friction margin, or a sum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from continuum_grasp.grasp.problem.disturbance import add_disturbances
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS

if TYPE_CHECKING:
    from continuum_grasp.grasp.problem.problem import GraspProblem

__all__ = ["REGULARISATION", "TINY", "add_objective"]

REGULARISATION = 1e-8
"""Weight of the squared contact forces (scaled) beside what is sought, so that they are unique."""
TINY = 1e-6
"""Rounding of the norm of what gives way in several components (scaled)."""


def add_objective(problem: GraspProblem) -> ca.SX:
    """The objective; its unknowns and constraints are added to the problem."""
    parts, number, aims = problem.parts, problem.numbers, problem.make.aims
    total = ca.SX(0)
    total += sum(f.unit.number("tension weight") * ca.sum1(f.pulls) for f in problem.fingers)
    if "least_normal_force" in aims:
        greatest = parts.unknown("greatest normal force")
        for contact in problem.contacts:
            room = greatest - contact.force[0]
            parts.require(f"greatest normal force, {contact.make.name}", room, "N", "objective", upper=ca.inf)
        total += number("normal weight") * greatest
    if "greatest_friction_margin" in aims:
        total -= number("margin weight") * parts.variables["friction margin"].symbol
    if "greatest_disturbance" in aims:
        total -= number("disturbance weight") * add_disturbances(problem)
    forces = ca.vertcat(*(c.force for c in problem.contacts)) / number("force reference")
    effort = total + REGULARISATION * ca.sumsqr(forces)
    given = (problem.give[r.name] for r in RELAXATIONS)
    relaxed = ca.vertcat(*(z if z.numel() == 1 else ca.sqrt(ca.sumsqr(z) + TINY**2) for z in given))
    weights = number("relaxation weights", len(RELAXATIONS))
    return number("effort weight") * effort + ca.dot(weights, relaxed)
