"""Balance of moments of a planar elastic rod at the nodes of a mesh, with its exact derivative and its energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.rod.dimensionless import RodProblem, TendonMoment
from continuum_grasp.rod.mesh import PanelMesh, panel_edges

Complex = NDArray[np.complex128]

BEND_ROUNDING = 1e-3
"""Bend below which the capstan law is rounded off [rad], so that its derivative exists, as the finger model does:
curvature times length, and the bend beyond a place at which a tendon slides one way or the other there. With a
coefficient of 0.4 the latter moves the tip by 2e-6 rad."""


@dataclass(frozen=True)
class Balance:
    """Residual of the equilibrium at the nodes."""

    missing: Array  # (N,) elastic moment less the share of the moment of the loads
    slope: Array  # (N, N) derivative with respect to the curvature
    per_share: Array  # (N,) derivative with respect to the share of the loads


class RodEquations:
    """The rod as an integral equation of the second kind for its curvature k at the nodes, in dimensionless numbers.

    The section has the angle psi = angle + integral of k and the tangent t = i exp(i psi), and the part beyond s exerts
    the force n(s). The loads then have the moment m(s) = (couples beyond s) + drives(s) exp(-friction b(s)) + integral
    from s to the tip of t x n, and the rod is in equilibrium if EI (k - rest) = m (S. S. Antman, 2005,
    doi:10.1007/0-387-27649-1, chapter 4), with EI(s) divided by the EI of the problem. The derivative is EI plus a
    compact operator. With scaled rows, it is thus well conditioned on any mesh.

    A tendon that is wound up by y has the tension (y - integral of e k) divided by its compliance c0 + integral of
    exp(-friction b) / EA; the numerator is rounded off where the tendon becomes slack.

    If links touch beyond a curvature c, the elastic moment grows by EI added (|k| - c), rounded off. Each drive changes
    along the rod by the capstan law, with its own friction coefficient; this is negative if the pulled tendon bends the
    rod away from itself. The angle b(s) is the integral of w |k| from the base. Here |k| is rounded off to k^2 /
    sqrt(k^2 + (1e-3 rad / L)^2), w = u / sqrt(u^2 + (1e-3 rad)^2) is the direction of sliding, and u(s) is the change
    of the bend beyond s since the tendons began to slide. The mesh has panels between the problem's breaks.
    """

    def __init__(self, problem: RodProblem, mesh: PanelMesh) -> None:
        self.problem = problem
        self.mesh = mesh
        s = mesh.nodes
        place = problem.length * mesh.nodes
        self.bending_stiffness: Array = problem.profile.bending_stiffness(place) / problem.stiffness
        self.rest: Array = problem.length * problem.profile.rest_curvature(place)
        density = problem.profile.linear_density(place)
        begun = problem.slid_from
        self._begun: Array = self.rest if begun is None else problem.length * begun(place)
        self._density: Array = density / (mesh.weights @ density)
        self._force: Complex = np.asarray(problem.weight * (mesh.backward @ self._density), dtype=complex)
        for at, value in problem.dead:
            self._force += value * (s < at)
        self._couple: Array = np.zeros(mesh.size)
        for at, couple in problem.couples:
            self._couple += couple * (s < at)
        self._added = 0.0  # stiffness per EI where links touch
        if problem.stops is not None:
            limit, self._signs, self._added = problem.stops
            self._limit: Array = problem.length * limit(place)
        # Moments of tendons before friction.
        self._drives: list[tuple[Array, TendonMoment]] = [
            (each.amplitude * each.shape(place), each) for each in problem.tendons
        ]
        self.metric: Array = mesh.weights * self.bending_stiffness  # of the integral of EI (change of curvature)^2

    @classmethod
    def on_panels(cls, problem: RodProblem, longest: float, nodes: int) -> RodEquations:
        """On equal panels between the problem's breaks, no longer than a part of the rod, with so many nodes each."""
        return cls(problem, PanelMesh(panel_edges(problem.breaks, longest), nodes))

    def panel_turns(self) -> Array:
        """Turn of each panel [rad] by tendons, couples and rest curvature, at most: all to one side."""
        moment = np.zeros(self.mesh.size)
        for drive, tendon in self._drives:
            # What is wound up bends by no more than what leaves the tendon just in tension.
            greatest_tension = (
                1.0 if tendon.cable is None else max(tendon.cable.wound, 0.0) / abs(tendon.cable.arm * tendon.amplitude)
            )
            moment += greatest_tension * np.abs(drive)
        for at, couple in self.problem.couples:
            moment += abs(couple) * (self.mesh.nodes < at)
        curvature = np.abs(self.rest) + moment / self.bending_stiffness
        if self._added and len(self._signs) == 2:
            curvature = np.minimum(curvature, self._limit + (curvature - self._limit) / (1.0 + self._added))
        return np.diff(self.mesh.to_edges(curvature).real)

    def tangents(self, curvature: Array) -> Complex:
        """Unit tangents at the nodes."""
        return np.asarray(1j * np.exp(1j * (self.problem.angle + self.mesh.forward @ curvature)))

    def unresolved(self, curvature: Array) -> Array:
        """Turn [rad] per panel that its polynomials may miss: in curvature, tangent, friction, or the rod itself.

        For the rod itself it is the turn by a moment of one, and the mass per mass of the whole rod.
        """
        mesh = self.mesh
        functions = [curvature, self.tangents(curvature), 1.0 / self.bending_stiffness, self._density]
        losses = [
            abs(tendon.friction) * float(np.abs(self._pull(drive, tendon, curvature)[0]).max(initial=0.0))
            for drive, tendon in self._drives
            if tendon.friction
        ]
        if any(losses):
            way, _ = self._ways(curvature)
            functions.append(sum(losses) * _rounded_size(curvature)[0] * way)
        # The larger of the last two Legendre coefficients on each panel says how well it is resolved.
        tails = [np.abs(mesh.series(function)[:, -2:]).max(axis=1) for function in functions]
        return np.asarray(mesh.widths * np.max(tails, axis=0))

    def turn(self, change: Array) -> float:
        """Greatest turn of a section [rad] by a change of curvature."""
        return float(np.abs(self.mesh.forward @ change).max(initial=0.0))

    def norm(self, moment: Array) -> float:
        """Root of the integral of a moment's square per EI; the greatest turn by the moment is not above it."""
        return float(np.sqrt(self.mesh.weights @ (moment**2 / self.bending_stiffness)))

    def balance(self, curvature: Array, share: float = 1.0) -> Balance:
        """Missing moment under a share of all loads and the actuation."""
        mesh, problem = self.mesh, self.problem
        tangent = self.tangents(curvature)
        force = self._force.copy()
        turning = []
        swung = []
        levered = np.zeros(mesh.size)
        for at, body in problem.following:
            inside = mesh.nodes < at
            row = mesh.weights * inside
            value = body * np.exp(1j * (problem.angle + row @ curvature))
            force[inside] += value
            turning.append((np.real(np.conj(tangent) * value) * inside, row))
        for at, lever, weight in problem.levers:
            inside = mesh.nodes < at
            row = mesh.weights * inside
            arm = lever * np.exp(1j * (problem.angle + row @ curvature))
            levered += np.imag(np.conj(arm) * weight) * inside
            swung.append((np.real(np.conj(arm) * weight) * inside, row))
        # t x n = Im(conj(t) n); its derivative by the angle is -Re(conj(t) n), and n turns with a following force.
        moment = self._couple + levered + mesh.backward @ np.imag(np.conj(tangent) * force)
        along = np.real(np.conj(tangent) * force)
        slope = (mesh.backward * along) @ mesh.forward
        for column, row in turning:
            slope -= np.outer(mesh.backward @ column, row)
        for column, row in swung:
            slope += np.outer(column, row)
        for drive, tendon in self._drives:
            pull, rate = self._pull(drive, tendon, curvature)
            moment += pull
            if rate is not None:
                slope -= rate
        slope *= share
        _, elastic, stiffness = self._elastic(curvature)
        slope.flat[:: mesh.size + 1] += stiffness
        return Balance(elastic - share * moment, slope, -moment)

    def _pull(self, drive: Array, tendon: TendonMoment, curvature: Array) -> tuple[Array, Array | None]:
        """Moment of a tendon, and its derivative; None where it does not depend on the curvature."""
        share, rate = self._share(tendon, curvature)
        if tendon.cable is None:
            return drive * share, None if rate is None else drive[:, None] * rate
        tension, slope = self._tension(tendon, curvature, share, rate)
        derivative = np.outer(drive * share, slope)
        if rate is not None:
            derivative += (tension * drive)[:, None] * rate
        return tension * drive * share, derivative

    def _share(self, tendon: TendonMoment, curvature: Array) -> tuple[Array, Array | None]:
        """Share of the tension at the drive along the rod, and its derivative; None where it is one."""
        mesh, friction = self.mesh, tendon.friction
        if friction == 0.0:
            return np.ones(mesh.size), None
        size, rate = _rounded_size(curvature)
        slid, turned = self._ways(curvature)
        by_bend = mesh.forward * (slid * rate) + (mesh.forward * (turned * size)) @ mesh.backward
        bend = mesh.forward @ (slid * size)
        if tendon.conduit_bend:
            # It slides there as at the base.
            whole = float(mesh.weights @ (curvature - self._begun))
            root = float(np.hypot(whole, BEND_ROUNDING))
            bend = bend + tendon.conduit_bend * whole / root
            by_bend = by_bend + (tendon.conduit_bend * BEND_ROUNDING**2 / root**3) * mesh.weights
        share = np.exp(-friction * bend)
        return share, (-friction * share)[:, None] * by_bend

    def _tension(self, tendon: TendonMoment, curvature: Array, share: Array, rate: Array | None) -> tuple[float, Array]:
        """Tension [N] of a tendon that is wound up, and its derivative."""
        mesh = self.mesh
        length = self.problem.length
        cable = tendon.cable
        if cable is None:
            raise TypeError("the tension of this tendon is given")
        drawn = cable.arm * mesh.weights * tendon.shape(length * mesh.nodes)
        along = length * cable.elongation * mesh.weights * (mesh.nodes < cable.to)
        compliance = cable.series + float(along @ share)
        longer, slope, _ = _soft(cable.wound - float(drawn @ curvature), cable.onset)
        tension = longer / compliance
        derivative = -slope / compliance * drawn
        if rate is not None:
            derivative = derivative - tension / compliance * (along @ rate)
        return tension, derivative

    def tensions(self, curvature: Array) -> list[float]:
        """Tensions [N] of the tendons that are wound up, in their order."""
        wound = [tendon for _, tendon in self._drives if tendon.cable is not None]
        return [self._tension(each, curvature, *self._share(each, curvature))[0] for each in wound]

    def slid(self, curvature: Array) -> Array:
        """Change of the bend beyond each node [rad] since the tendons began to slide."""
        return np.asarray(self.mesh.backward @ (curvature - self._begun))

    def _ways(self, curvature: Array) -> tuple[Array, Array]:
        """Direction in which tendons slid, from -1 to 1, and its derivative by the bend beyond."""
        slid = self.slid(curvature)
        root = np.sqrt(slid**2 + BEND_ROUNDING**2)
        return slid / root, BEND_ROUNDING**2 / root**3

    def _elastic(self, curvature: Array) -> tuple[Array, Array, Array]:
        """Elastic energy per length at the nodes, and its first and second derivative: moment and stiffness."""
        bent = curvature - self.rest
        energy = 0.5 * bent**2
        moment = bent
        stiffness = np.ones(bent.shape)
        for sign in self._signs if self._added else ():
            # 0.005: curvature about that at which links touch, per it, over which the stop's law is rounded off: as the
            # finger model does. A law that is rounded off over 0.02 has the tip off by 3e-3 of the length where all
            # links touch.
            beyond = sign * curvature - self._limit
            width = 0.005 * self._limit
            root = np.sqrt(beyond**2 + width**2)
            touching = 0.5 * (beyond + root)
            rate = 0.5 * (1.0 + beyond / root)
            energy = energy + 0.5 * self._added * touching**2
            moment = moment + sign * self._added * touching * rate
            stiffness = stiffness + self._added * (rate**2 + touching * 0.5 * width**2 / root**3)
        return self.bending_stiffness * energy, self.bending_stiffness * moment, self.bending_stiffness * stiffness

    def stiffness(self, slope: Array) -> Array:
        """Second variation of the energy in the metric of the integral of EI (change of curvature)^2; symmetric."""
        # W slope is symmetric to rounding, since the mesh integrates by parts exactly.
        root = np.sqrt(self.metric)
        scaled = self.mesh.weights[:, None] * slope / (root[:, None] * root)
        return np.asarray(0.5 * (scaled + scaled.T))

    def elastic_energy(self, curvature: Array) -> float:
        """Energy of bending, per EI / L."""
        return float(self.mesh.weights @ self._elastic(curvature)[0])

    def energy(self, curvature: Array) -> float:
        """Elastic energy less the work that dead forces, couples and actuation do from the base, per EI / L.

        Elongated tendons on winches count as elastic.
        Work of following forces and tendon friction is not included.
        """
        mesh, problem = self.mesh, self.problem
        work = mesh.weights @ np.real(np.conj(self.tangents(curvature)) * self._force)
        bends = mesh.to_edges(curvature).real
        for at, couple in problem.couples:
            work += couple * np.interp(at, mesh.edges, bends)
        for at, lever, weight in problem.levers:
            turned = problem.angle + np.interp(at, mesh.edges, bends)
            work += np.real(np.conj(lever * np.exp(1j * turned)) * weight)
        for drive, tendon in self._drives:
            if tendon.friction == 0.0 and tendon.cable is None:
                work += (mesh.weights * drive) @ curvature
            elif tendon.friction == 0.0 and tendon.cable is not None:
                cable = tendon.cable
                shape = tendon.shape(problem.length * mesh.nodes)
                longer = _soft(cable.wound - cable.arm * float((mesh.weights * shape) @ curvature), cable.onset)[2]
                per_joule = problem.length / problem.stiffness
                work -= per_joule * longer / (cable.series + problem.length * cable.elongation * cable.to)
        return float(self.elastic_energy(curvature) - work)

    @property
    def base_energy(self) -> float:
        """Potential of dead forces and weight where the whole rod is at the base, per EI / L."""
        force = self.problem.weight + sum(value for _, value in self.problem.dead)
        return float(-np.real(np.conj(force) * self.problem.base) / self.problem.length)


def _soft(longer: float, onset: float) -> tuple[float, float, float]:
    """Elongation of a tendon [m], none where it is slack, its derivative and its integral [m2]; rounded off."""
    v = min(max(longer / onset, -1.0), 1.0)
    inside = onset / 16.0 * (3.0 + v * (8.0 + v * (6.0 - v * v)))
    beyond = max(longer - onset, 0.0)
    slope = (8.0 + v * (12.0 - 4.0 * v * v)) / 16.0
    whole = onset**2 / 16.0 * (0.8 + v * (3.0 + v * (4.0 + v * (2.0 - 0.2 * v * v))))
    return inside + beyond, slope, whole + beyond * (onset + 0.5 * beyond)


def _rounded_size(curvature: Array) -> tuple[Array, Array]:
    """Size without sign, rounded off near zero, and its derivative."""
    square = curvature**2
    root = np.sqrt(square + BEND_ROUNDING**2)
    return square / root, curvature * (square + 2.0 * BEND_ROUNDING**2) / root**3
