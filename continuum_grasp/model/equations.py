"""The equations of motion of one model as CasADi expressions.

M qdd + bias + gravity + elastic + damping = actuation + external forces, equation (43) of the paper, for the full
coordinates of the family; where the tip is matched, the last of these is a function of the input.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, reduce

import casadi as ca

from continuum_grasp.model.actuation import Drive, friction_factors
from continuum_grasp.model.chain import Chain, Load, Place
from continuum_grasp.model.family import Rod
from continuum_grasp.model.layout import place_at
from continuum_grasp.model.link import Section
from continuum_grasp.model.planar import IDENTITY, ZERO, Rotation, Scalar, Vec, solve_ldl
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.sweep import Builder, sweep_function
from continuum_grasp.scene.loads import ForceLoad


class Equations:
    """Symbols and expressions of a model; every property is built when it is first read."""

    def __init__(self, structure: Structure) -> None:
        self._structure = structure
        self._par = structure.parameters
        self._family = structure.family
        self.q = ca.SX.sym("q", structure.n)
        self.qd = ca.SX.sym("qd", structure.n)
        self.qdd = ca.SX.sym("qdd", structure.n)
        self.lag = ca.SX.sym("lag", 2 if structure.lagged else 0)
        self.x = ca.vertcat(self.q, self.qd, self.lag)
        self.u = ca.SX.sym("u", len(structure.u_names))
        self.w = ca.SX.sym("w", len(structure.w_names))
        self.s = ca.SX.sym("s")
        self.p = structure.parameters.symbol

    # -- input ---------------------------------------------------------------------------------------------------

    @cached_property
    def commanded(self) -> Drive:
        """The drive as the input gives it."""
        offset = self._par["tendon_offset"] if self._structure.inputs.tendons else 0.0
        return Drive.from_input(self.u, self._structure.inputs, offset)

    @cached_property
    def drive(self) -> Drive:
        """The drive that acts: the commanded one, or the one that follows it."""
        if not self._structure.lagged:
            return self.commanded
        return Drive(self.lag[0], self.commanded.couple, self.lag[1], self.lag_acceleration)

    @cached_property
    def lag_acceleration(self) -> Scalar:
        """Second derivative of the lagged tip moment: a critically damped second-order lag."""
        tendons = self._structure.finger.tendons
        if tendons is None or tendons.time_constant is None:
            return 0.0
        # Second order, because a matched tip needs the moment's rate and acceleration; critically damped: no overshoot.
        pole = 1.0 / tendons.time_constant
        return pole**2 * (self.commanded.moment - self.lag[0]) - 2.0 * pole * self.lag[1]

    # -- coordinates ---------------------------------------------------------------------------------------------

    @cached_property
    def lengths(self) -> tuple[Scalar, ...]:
        """Element lengths [m]."""
        return tuple(self._par.vector("element_lengths"))

    @cached_property
    def full(self) -> list[Scalar]:
        """Full coordinates: q, and the tip's curvature where it is matched."""
        q: list[Scalar] = [self.q[k] for k in range(self._structure.n)]
        if not self._structure.matched:
            return q
        # Nothing but moments acts at a free tip: kappa(L) = rest curvature + moment / EI.
        return [*q, self._per_stiffness(self.drive.moment + self.drive.couple) + self._tip_rest]

    @cached_property
    def full_rates(self) -> list[Scalar]:
        """Rates of the full coordinates."""
        rates: list[Scalar] = [self.qd[k] for k in range(self._structure.n)]
        return [*rates, self._per_stiffness(self.drive.rate)] if self._structure.matched else rates

    def _per_stiffness(self, moment: Scalar) -> Scalar:
        stiffness = self._par["bending_stiffness"]
        # A product with a folded constant in place of a division, which takes several times as long.
        return 1.0 / stiffness * moment if isinstance(stiffness, float) else moment / stiffness

    @cached_property
    def _tip_rest(self) -> Scalar:
        if self._par.is_runtime("rest_curvature"):
            return self._par["rest_curvature"]
        return self._structure.finger.curvature_pieces[-1][2]

    @cached_property
    def bends(self) -> list[Scalar]:
        """Bending angle of each element [rad]."""
        shapes = [self._family.shape(k, self.full) for k in range(len(self.lengths))]
        return [_dot(link.link.end.angles, shape) for link, shape in zip(self.chain.links, shapes, strict=True)]

    # -- geometry ------------------------------------------------------------------------------------------------

    @cached_property
    def rod(self) -> Rod:
        """What the family needs to know of the rod."""
        par, made = self._par, self._structure
        masses = tuple((place.link, float(place.fraction), par[name]) for name, place in made.masses())
        # One kernel serves all links of a sweep: they then have the series and nodes of the one that bends most.
        ranges = (max(made.ranges),) * len(made.ranges) if made.sweeps else made.ranges
        return Rod(self.lengths, ranges, par["linear_density"], par["rotary_inertia"], masses)

    @cached_property
    def chain(self) -> Chain:
        """The chain of links."""
        family = self._family
        local = [family.local(k) for k in range(len(self.lengths))]
        return Chain(family.links(self.full, self.rod), local, family.size)

    @cached_property
    def turn(self) -> Rotation:
        """From the chain's axes (X along the undeformed finger) to the world's."""
        # The tangent of an undeformed finger at base angle psi is (-sin psi, cos psi): Y along the backbone, as in the
        # paper. Sines of right angles that are 1e-17 become zero, and their products disappear from the code.
        if self._par.is_runtime("base_angle"):
            return Rotation(-ca.sin(self._par["base_angle"]), ca.cos(self._par["base_angle"]))
        angle = self._structure.finger.base.angle + math.pi / 2
        return Rotation(*(0.0 if abs(v) < 1e-15 else v for v in (math.cos(angle), math.sin(angle))))

    def to_world(self, v: Vec) -> Vec:
        """World position of a point given from the base in the chain's axes."""
        turned, (x, y) = self.turn.apply(v), self._structure.finger.base.position
        return Vec(turned.x + x, turned.y + y)

    @cached_property
    def tip_position(self) -> Vec:
        """World position of the tip [m]."""
        return self.to_world(self.chain.position(self._structure.tip))

    @cached_property
    def _partial_chain(self) -> list[tuple[Rotation, Section, Vec]]:
        """Per element its start's rotation, the section where it or the run-time position s ends, and that position."""
        start: Scalar = 0.0
        turn, total, parts = IDENTITY, ZERO, []
        for link, h in zip(self.chain.links, self.lengths, strict=True):
            # Elements before s whole, those after it of length zero: one expression for all s, without branches.
            section = link.link.section(ca.fmin(ca.fmax((self.s - start) / h, 0.0), 1.0))
            total += turn.apply(section.position)
            parts.append((turn, section, total))
            turn = turn @ section.rotation
            start += h
        return parts

    @cached_property
    def section_position(self) -> Vec:
        """World position [m] of the section at the run-time position s."""
        return self.to_world(self._partial_chain[-1][2])

    @cached_property
    def section_angle(self) -> Scalar:
        """Angle in the world [rad] of the section at the run-time position s."""
        angle: Scalar = self._par["base_angle"]
        for k, (_, section, _) in enumerate(self._partial_chain):
            angle += _dot(section.angles, self._family.shape(k, self.full))
        return angle

    @cached_property
    def section_jacobian(self) -> ca.SX:
        """Derivative (2, n) of the world position of the section at s with respect to the unknowns."""
        tip = self._partial_chain[-1][2]
        arms = [ZERO] * self._family.size
        for (turn, section, end), local in zip(self._partial_chain, self.chain.coordinates, strict=True):
            beyond = tip - end
            for a, arm, angle in zip(local, section.arms, section.angles, strict=True):
                arms[a] = arms[a] + turn.apply(arm) + beyond.scaled(angle)
        return ca.horzcat(*[self.turn.apply(arm.perp()).column() for arm in arms[: self._structure.n]])

    @cached_property
    def joints(self) -> list[tuple[Vec, Scalar]]:
        """World position [m] and angle [rad] of the end section of each element."""
        return [self.section_at(Place(k)) for k in range(len(self.lengths))]

    @cached_property
    def waypoints(self) -> list[Vec]:
        """World positions [m] at the fractions of the elements where they cost least, from base to tip."""
        start, found = ZERO, []
        for link, turn, span in zip(self.chain.links, self.chain.rotations, self.chain.spans, strict=False):
            found += [self.to_world(start + turn.apply(at)) for _, at in link.link.waypoints]
            start += span
        return found

    def inside(self, fractions: ca.SX) -> list[Vec]:
        """World positions [m] at run-time fractions (M, N) of the N elements' lengths, from base to tip."""
        count, elements = fractions.shape
        places = [Place(k, fractions[j, k]) for k in range(elements) for j in range(count)]
        return [self.to_world(self.chain.position(place)) for place in places]

    def section_at(self, place: Place) -> tuple[Vec, Scalar]:
        """World position [m] and angle [rad] of a section."""
        angle: Scalar = self._par["base_angle"]
        for bend in self.bends[: place.link]:
            angle += bend
        section = self.chain.links[place.link].link.section(place.fraction)
        angle += _dot(section.angles, self._family.shape(place.link, self.full))
        return self.to_world(self.chain.position(place)), angle

    @property
    def curvature(self) -> list[Scalar]:
        """Curvature [1/m] that belongs to each full coordinate, from base to tip."""
        return self._family.profile(self.full, self.lengths)

    @property
    def curvatures(self) -> list[list[Scalar]]:
        """Curvature [1/m] at the places of each element."""
        return [self._family.curvature(k, self.full, h) for k, h in enumerate(self.lengths)]

    @property
    def greatest_bends(self) -> list[list[Scalar]]:
        """The same times the element's length [rad], which its bending range limits."""
        return [self._family.bends(k, self.full, h) for k, h in enumerate(self.lengths)]

    @cached_property
    def range_use(self) -> list[Scalar]:
        """Share of the declared bending range that each element uses."""
        peaks = [reduce(ca.fmax, [ca.fabs(ca.SX(bend)) for bend in bends]) for bends in self.greatest_bends]
        return [peak / reach for peak, reach in zip(peaks, self._structure.ranges, strict=True)]

    # -- forces --------------------------------------------------------------------------------------------------

    @cached_property
    def gravity_vector(self) -> Vec:
        """Gravity in the chain's axes [m/s2]."""
        gx, gy = self._par.vector("gravity")
        if isinstance(gx, float) and isinstance(gy, float) and gx == 0.0 and gy == 0.0:
            return ZERO  # this very object: the chain then leaves the weight out
        return self.turn.transposed().apply(Vec(gx, gy))

    @cached_property
    def loads(self) -> list[Load]:
        """Point forces and couples of ``w``, and of the contacts."""
        back, made = self.turn.transposed(), self._structure
        places = [place_at(at, made.lengths) for at in made.contacts] + [made.tip] * made.tip_force
        loads = [Load(place, back.apply(Vec(self.w[2 * k], self.w[2 * k + 1]))) for k, place in enumerate(places)]
        couples = []
        for load, (vector, start) in zip(made.loads, made.load_entries, strict=True):
            place = place_at(load.at, made.lengths)
            if isinstance(load, ForceLoad) and load.follows:
                # (across, along) the section; the chain's axes have X along it and -Y across.
                loads.append(Load(place, Vec(self.w[start + 1], -self.w[start]), follows=True))
            elif isinstance(load, ForceLoad):
                loads.append(Load(place, back.apply(Vec(self.w[start], self.w[start + 1]))))
            elif vector == "w":  # those of u act on the tip, like the tip moment
                couples.append(Load(place, couple=self.w[start]))
        return loads + couples + self.contact_loads

    @property
    def contact_loads(self) -> list[Load]:
        """Forces and couples that follow from the state; none on a finger alone."""
        return []

    @cached_property
    def rest(self) -> list[Scalar]:
        """Integral of the rest curvature times the curvature shapes."""
        if self._par.is_runtime("element_lengths"):
            return [self._tip_rest * r for r in self._family.rest_uniform(self.lengths)]
        return [self.rest_factor * r for r in self.rest_numbers]

    @cached_property
    def rest_factor(self) -> Scalar:
        """Factor of ``rest_numbers``: a uniform rest curvature that is a run-time argument."""
        return self._par["rest_curvature"] if self._par.is_runtime("rest_curvature") else 1.0

    @cached_property
    def rest_numbers(self) -> list[float]:
        """The same integrals as numbers, of numeric element lengths."""
        made = self._structure
        if self._par.is_runtime("rest_curvature"):
            return [float(r) for r in self._family.rest_uniform(made.lengths)]
        return list(self._family.rest(made.lengths, made.finger.curvature_pieces))

    @cached_property
    def elastic(self) -> list[Scalar]:
        """Gradient of the elastic energy; equation (32)."""
        stiffness = self._par["bending_stiffness"]
        force = _product(self._family.stiffness(self.lengths), self.full, stiffness)
        return [f - stiffness * r for f, r in zip(force, self.rest, strict=True)]

    @cached_property
    def damping(self) -> list[Scalar]:
        """Damping forces, positive against the motion."""
        rates, per_arc = self.full_rates, self._par["per_arc_damping"]
        # Kelvin-Voigt: moment eta times the rate of curvature, so the matrix of the elasticity, whatever the elements.
        force = _product(self._family.stiffness(self.lengths), rates, self._par["material_damping"])
        if isinstance(per_arc, float) and per_arc == 0.0:
            return force
        # Equation (39): a moment per arc against the rate of its bending angle.
        for k in range(len(self.lengths)):
            gradient = self._family.bend_gradient(k, self.lengths)
            moment = per_arc * _dot(gradient, rates)
            force = [f + g * moment for f, g in zip(force, gradient, strict=True)]
        return force

    @cached_property
    def actuation(self) -> list[Scalar]:
        """Generalized forces of the drive."""
        drive, count = self.drive, len(self.lengths)
        gradients = [self._family.bend_gradient(k, self.lengths) for k in range(count)]
        whole = [sum(column) for column in zip(*gradients, strict=True)]
        # A moment at the tip turns with the tip's angle, the sum of all bends: its power is tau times their rates.
        if not self._structure.has_tendon_friction:
            return [g * (drive.moment + drive.couple) for g in whole]
        total = [g * drive.couple for g in whole]
        shares = [1.0 / self._structure.length * h for h in self.lengths]
        factors = friction_factors(self._par["tendon_friction"], self.bends, shares)
        # The tension changes along the finger: each element is bent by that in its middle.
        for gradient, factor in zip(gradients, factors, strict=True):
            moment = factor * drive.moment
            total = [t + g * moment for t, g in zip(total, gradient, strict=True)]
        return total

    # -- motion --------------------------------------------------------------------------------------------------

    @cached_property
    def mass_matrix(self) -> list[list[Scalar]]:
        """Mass matrix of the unknowns."""
        return [row[: self._structure.n] for row in self.chain.mass_matrix[: self._structure.n]]

    @property
    def tip_acceleration(self) -> Scalar:
        """Acceleration of a matched tip's coordinate."""
        return self._per_stiffness(self.drive.acceleration) if self._structure.matched else 0.0

    @cached_property
    def tip_inertia_force(self) -> list[Scalar]:
        """Inertia of the matched tip's own motion, M_qN kappa_N'': without it, ramps of the moment cost millimeters."""
        return [row[-1] * self.tip_acceleration for row in self.chain.mass_matrix[: self._structure.n]]

    @cached_property
    def bias(self) -> list[Scalar]:
        """Velocity products, and what the motion of a matched tip adds."""
        motion = self.chain.motion_forces(self.full_rates, ZERO)
        return [f - m for f, m in zip(self.tip_inertia_force, motion, strict=False)]

    @cached_property
    def gravity(self) -> list[Scalar]:
        """Gradient of the weight's potential; equation (29)."""
        weight = self.chain.motion_forces(None, self.gravity_vector)
        return [-f for f in weight[: self._structure.n]]

    @cached_property
    def external_force(self) -> list[Scalar]:
        """Generalized forces of ``w``; equation (41)."""
        return self.chain.motion_forces(None, ZERO, self.loads)[: self._structure.n]

    @cached_property
    def net_force(self) -> list[Scalar]:
        """M qdd."""
        motion = self.chain.motion_forces(self.full_rates, self.gravity_vector, self.loads)
        net = []
        for k in range(self._structure.n):
            internal = self.elastic[k] + self.damping[k]
            value = motion[k] + self.actuation[k] - internal - self.tip_inertia_force[k]
            net.append(value)
        return net

    @cached_property
    def force_at_rest(self) -> list[Scalar]:
        """The same where neither finger nor inputs move: without mass matrix and velocity products, half the work."""
        acting = self.chain.motion_forces(None, self.gravity_vector, self.loads)
        return [acting[k] + self.actuation[k] - self.elastic[k] for k in range(self._structure.n)]

    @cached_property
    def state_rate(self) -> list[Scalar]:
        """Derivative of the state."""
        rates: list[Scalar] = [self.qd[k] for k in range(self._structure.n)]
        rates += solve_ldl(self.mass_matrix, self.net_force)
        return [*rates, self.lag[1], self.lag_acceleration] if self._structure.lagged else rates

    @property
    def sweeps(self) -> bool:
        """Whether sweeps along the chain give the accelerations."""
        return self._structure.sweeps

    @property
    def sweep_instructions(self) -> int:
        """Instructions of the sweeps that give the accelerations."""
        return Builder(self._structure, self).kernels().instructions

    def sweep(self, *, moving: bool = True, implicit: bool = False) -> ca.Function:
        """Rates of the unknowns' rates, and those of the lag, by sweeps; see ``model.sweep``."""
        return sweep_function(Builder(self._structure, self, moving=moving, implicit=implicit))

    @cached_property
    def kinetic_energy(self) -> Scalar:
        """Kinetic energy [J], with the motion of a matched tip."""
        return 0.5 * _dot(_product(self.chain.mass_matrix, self.full_rates, 1.0), self.full_rates)

    @cached_property
    def potential_energy(self) -> Scalar:
        """Elastic energy above the rest shape and potential of the weight above the world's origin [J]."""
        stiffness, pieces = self._par["bending_stiffness"], self._structure.finger.curvature_pieces
        product = _product(self._family.stiffness(self.lengths), self.full, 0.5)
        # Half the integral of (kappa - rest)^2: the constant makes it vanish on the rest shape.
        if self._par.is_runtime("rest_curvature") or self._par.is_runtime("element_lengths"):
            constant = 0.5 * (sum(self.lengths) * self._tip_rest**2)
        else:
            constant = self._family.rest_energy(self._structure.lengths, pieces)
        elastic = stiffness * (_dot(product, self.full) - _dot(self.rest, self.full) + constant)
        mass, first = self.chain.first_moment()
        gx, gy = self._par.vector("gravity")
        x, y = self._structure.finger.base.position
        # Potential of the weight: -g . integral of r dm, base included.
        weight = first.dot(self.gravity_vector) + mass * (gx * x + gy * y)
        return elastic - weight


def _dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    return sum((u * v for u, v in zip(a, b, strict=True)), 0.0)


def _product(matrix: Sequence[Sequence[Scalar]], vector: Sequence[Scalar], scale: Scalar) -> list[Scalar]:
    """Scale * matrix * vector, with a numeric scale folded into a numeric matrix."""
    if isinstance(scale, float):
        return [_dot([scale * entry for entry in row], vector) for row in matrix]
    return [scale * _dot(row, vector) for row in matrix]
