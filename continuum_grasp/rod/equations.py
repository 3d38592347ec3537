"""Balance of moments of a planar elastic rod at the nodes of a mesh, with its exact derivative and its energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.rod.dense_rod import Mesh
from continuum_grasp.rod.dimensionless import RodProblem

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

BEND_ROUNDING = 1e-3
"""Curvature times length below which the capstan law is rounded off [rad], so that its derivative exists: as the finger
model does."""


@dataclass(frozen=True)
class Balance:
    """What is missing for equilibrium at the nodes."""

    missing: Array  # (N,) elastic moment less the share of the moment of the loads
    slope: Array  # (N, N) derivative with respect to the curvature
    per_share: Array  # (N,) derivative with respect to the share of the loads


class RodEquations:
    """The rod as an integral equation of the second kind for its curvature k at the nodes, in dimensionless numbers.

    With the section's angle psi = angle + integral of k, the tangent t = i exp(i psi) and the force n(s) that the part
    beyond s exerts, the moment of the loads is m(s) = (couples beyond s) + drive(s) exp(-friction b(s)) + integral from
    s to the tip of t x n, and equilibrium is EI (k - rest) = m (S. S. Antman, 2005, doi:10.1007/0-387-27649-1,
    chapter 4), with EI(s) per that of the problem. The derivative is EI plus a compact operator: but for the scale of
    its rows it is well conditioned on any mesh.

    Tendons lose tension by the capstan law, each drive by its own friction; b(s) is the integral of |k| from the base,
    with |k| rounded off to k^2 / sqrt(k^2 + (1e-3 rad / L)^2). The mesh has panels between the problem's breaks.
    """

    def __init__(self, problem: RodProblem, mesh: Mesh) -> None:
        self.problem, self.mesh = problem, mesh
        s, place = mesh.nodes, problem.length * mesh.nodes
        self.bending_stiffness: Array = problem.profile.bending_stiffness(place) / problem.stiffness
        self.rest: Array = problem.length * problem.profile.rest_curvature(place)
        density = problem.profile.linear_density(place)
        self._density: Array = density / (mesh.weights @ density)
        self._force: Complex = np.asarray(problem.weight * (mesh.backward @ self._density), dtype=complex)
        for at, value in problem.dead:
            self._force += value * (s < at)
        self._couple: Array = np.zeros(mesh.size)
        for at, couple in problem.couples:
            self._couple += couple * (s < at)
        self._drives: list[tuple[Array, float]] = []  # moments before friction, and frictions
        for shape, amplitude, friction in problem.drives:
            self._drives.append((amplitude * shape(place), friction))
        self.metric: Array = mesh.weights * self.bending_stiffness  # of the integral of EI (change of curvature)^2

    @property
    def greatest_curvature(self) -> float:
        """Curvature that tendons, couples and rest curvature give on a rod of mean stiffness, at most [1]."""
        moments = [float(np.abs(drive).max()) for drive, _ in self._drives]
        return sum(moments) + sum(abs(value) for _, value in self.problem.couples) + float(np.abs(self.rest).max())

    def tangents(self, curvature: Array) -> Complex:
        """Unit tangents at the nodes."""
        return np.asarray(1j * np.exp(1j * (self.problem.angle + self.mesh.forward @ curvature)))

    def unresolved(self, curvature: Array) -> Array:
        """Turn [rad] per panel that its polynomials may miss: in curvature, tangent, friction, or the rod itself.

        Of the rod itself it is the turn by a moment of one, and the mass per that of the whole rod.
        """
        mesh = self.mesh
        functions = [curvature, self.tangents(curvature), 1.0 / self.bending_stiffness, self._density]
        losses = [friction * float(np.abs(drive).max()) for drive, friction in self._drives]
        if any(losses):
            functions.append(sum(losses) * _rounded_size(curvature)[0])
        return np.asarray(mesh.widths * np.max([mesh.tails(function) for function in functions], axis=0))

    def turn(self, change: Array) -> float:
        """Greatest turn of a section [rad] by a change of curvature."""
        return float(np.abs(self.mesh.forward @ change).max(initial=0.0))

    def norm(self, moment: Array) -> float:
        """Root of the integral of a moment's square per EI; the greatest turn by the moment is not above it."""
        return float(np.sqrt(self.mesh.weights @ (moment**2 / self.bending_stiffness)))

    def balance(self, curvature: Array, share: float = 1.0) -> Balance:
        """Missing moment under a share of all loads and the actuation."""
        mesh, problem = self.mesh, self.problem
        tangent, force = self.tangents(curvature), self._force.copy()
        turning = []
        for at, body in problem.following:
            inside = mesh.nodes < at
            row = mesh.weights * inside
            value = body * np.exp(1j * (problem.angle + row @ curvature))
            force[inside] += value
            turning.append((np.real(np.conj(tangent) * value) * inside, row))
        # t x n = Im(conj(t) n); its derivative by the angle is -Re(conj(t) n), and n turns with a following force.
        moment = self._couple + mesh.backward @ np.imag(np.conj(tangent) * force)
        along = np.real(np.conj(tangent) * force)
        slope = (mesh.backward * along) @ mesh.forward
        for column, row in turning:
            slope -= np.outer(mesh.backward @ column, row)
        for drive, friction in self._drives:
            if friction == 0.0:
                moment += drive
                continue
            size, rate = _rounded_size(curvature)
            pull = drive * np.exp(-friction * (mesh.forward @ size))
            moment += pull
            slope += (friction * pull)[:, None] * mesh.forward * rate
        slope *= share
        slope.flat[:: mesh.size + 1] += self.bending_stiffness
        return Balance(self.bending_stiffness * (curvature - self.rest) - share * moment, slope, -moment)

    def stiffness(self, slope: Array) -> Array:
        """Second variation of the energy in the metric of the integral of EI (change of curvature)^2; symmetric."""
        # W slope is symmetric to rounding, since the mesh integrates by parts exactly.
        root = np.sqrt(self.metric)
        scaled = self.mesh.weights[:, None] * slope / (root[:, None] * root)
        return np.asarray(0.5 * (scaled + scaled.T))

    def elastic_energy(self, curvature: Array) -> float:
        """Energy of bending, per EI / L."""
        return float(0.5 * self.mesh.weights @ (self.bending_stiffness * (curvature - self.rest) ** 2))

    def energy(self, curvature: Array) -> float:
        """Elastic energy less the work that dead forces, couples and actuation do from the base, per EI / L.

        What following forces and tendon friction do is not included.
        """
        mesh, problem = self.mesh, self.problem
        work = mesh.weights @ np.real(np.conj(self.tangents(curvature)) * self._force)
        bends = mesh.to_edges(curvature).real
        for at, couple in problem.couples:
            work += couple * np.interp(at, mesh.edges, bends)
        for drive, friction in self._drives:
            if friction == 0.0:
                work += (mesh.weights * drive) @ curvature
        return float(self.elastic_energy(curvature) - work)

    @property
    def base_energy(self) -> float:
        """Potential of dead forces and weight where the whole rod is at the base, per EI / L."""
        force = self.problem.weight + sum(value for _, value in self.problem.dead)
        return float(-np.real(np.conj(force) * self.problem.base) / self.problem.length)


def _rounded_size(curvature: Array) -> tuple[Array, Array]:
    """Size without sign, rounded off near zero, and its derivative."""
    square = curvature**2
    root = np.sqrt(square + BEND_ROUNDING**2)
    return square / root, curvature * (square + 2.0 * BEND_ROUNDING**2) / root**3
