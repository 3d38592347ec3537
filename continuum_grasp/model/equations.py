"""The equations of motion of one model as CasADi expressions.

M qdd + bias + gravity + elastic + damping = actuation + external forces, equation (43) of the paper, for the full
coordinates of the family; where moments of the input are known, the last of these are functions of the input.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, reduce
from itertools import islice, zip_longest

import casadi as ca
import numpy as np

from continuum_grasp.model.acting import Acting
from continuum_grasp.model.actuation import Drive, Lag
from continuum_grasp.model.chain import Chain, ChainPlace, Load
from continuum_grasp.model.family import RodProperties
from continuum_grasp.model.laws.ports import SectionForces
from continuum_grasp.model.laws.section import STATEFUL, Kind
from continuum_grasp.model.laws.shortening import remaining_shares
from continuum_grasp.model.layout import place_at
from continuum_grasp.model.link import Attached, LinkSection, ShortenedLink
from continuum_grasp.model.memory import Instant, Memory
from continuum_grasp.model.pattern import Pattern, one_link_serves, pattern_of
from continuum_grasp.model.planar import IDENTITY, ZERO, Rotation, Scalar, Vec, column, matrix, solve_ldl
from continuum_grasp.model.stations import Station
from continuum_grasp.model.structure import Structure
from continuum_grasp.scene import ForceLoad


class Equations:
    """Symbols and expressions of a model; every property is built when it is first read.

    States and forces of what the finger touches follow its own. ``pressed``: run-time numbers ``press`` [m], one per
    contact, make the gaps smaller.
    """

    def __init__(self, structure: Structure, *, pressed: bool = False) -> None:
        self.structure = self._structure = structure
        self._par = structure.parameters
        self._family = structure.family
        self.q = ca.SX.sym("q", structure.n)
        self.qd = ca.SX.sym("qd", structure.n)
        self.qdd = ca.SX.sym("qdd", structure.n)
        self.lag = ca.SX.sym("lag", structure.drive_states)
        self.z = ca.SX.sym("z", structure.friction_states)
        self.x = ca.vertcat(self.q, self.qd, self.lag, self.z)
        # Of what acts at rest: friction states, and whether the finger's bending moves them (``TendonForces``).
        self.history = ca.SX.sym("history", self.z.numel() + 1 if self.z.numel() else 0)
        self.u = ca.SX.sym("u", len(structure.u_names))
        self.w = ca.SX.sym("w", len(structure.w_names))
        self.s = ca.SX.sym("s")
        self.pulled = ca.SX.sym("pulled")
        self.part = ca.SX.sym("part")
        self.p = structure.parameters.symbol
        parameters = {name: self._par[name] for name in structure.object_parameters}
        stations = [station for _, station in self._stations]
        self.contacts = structure.touches(stations, parameters, pressed)
        self.x, self.w = ca.vertcat(self.x, self.contacts.states), ca.vertcat(self.w, self.contacts.wrench)
        self.press = self.contacts.press

    # -- input ---------------------------------------------------------------------------------------------------

    @cached_property
    def amplitudes(self) -> list[list[tuple[Scalar, Scalar]]]:
        """Per source what the input gives of its own and as couples; then the rates and accelerations of these."""
        made, amplitudes, values = self._structure, [], ca.vertsplit(self.u)
        blocks = [values[k : k + made.inputs.count] for k in range(0, len(values), made.inputs.count)]
        for source in made.sources:
            scale: Scalar = 1.0
            if self._par.is_runtime("tendon_offset") and source.tendon is None and not source.chamber:
                source, scale = replace(source, arms=tuple(np.sign(source.arms))), self._par["tendon_offset"]
            amplitudes.append([source.amplitudes(block, len(made.finger.inputs), scale) for block in blocks])
        return amplitudes

    @cached_property
    def _lagging(self) -> list[tuple[list[Scalar], list[Scalar]]]:
        """States of the lag of each source, and their rates; none where it has none."""
        lag_states, runtime, lagging = iter(self._states["lag"]), self._par.is_runtime("drive_time_constant"), []
        for source, [(asked, _), *_] in zip(self._structure.sources, self.amplitudes, strict=True):
            states = list(islice(lag_states, source.lags))
            time = self._par["drive_time_constant"] if runtime else source.time_constant
            lagging.append((states, Lag.rates(states, asked, time)))
        return lagging

    @cached_property
    def commanded(self) -> list[Drive]:
        """Per source of moments what the input gives."""
        return [self._drive(k, *zip(*amplitudes, strict=True)) for k, amplitudes in enumerate(self.amplitudes)]

    @cached_property
    def drives(self) -> list[Drive]:
        """Per source the acting input: the command, or the quantity that follows it."""
        drives = list(self.commanded)
        for k, (states, rates) in enumerate(self._lagging):
            if states:
                _, couples = zip(*self.amplitudes[k], strict=True)
                drives[k] = self._drive(k, (states[0], *rates), couples)
        return drives

    def _drive(self, number: int, amplitudes: Sequence[Scalar], couples: Sequence[Scalar]) -> Drive:
        """Moments of a source by its own amplitude and its couples' amplitude, with rates and accelerations as
        given.
        """
        source = self._structure.sources[number]
        gain: Scalar = source.gain
        if source.chamber and self._par.is_runtime("chamber_area"):
            gain = gain / self._structure.finger.chambers[0].area * self._par["chamber_area"]
        total = [gain * a + c for a, c in zip_longest(amplitudes[1:3], couples[1:], fillvalue=0.0)]
        return Drive(gain * amplitudes[0], couples[0], *(*total, 0.0, 0.0)[:2])

    # -- coordinates ---------------------------------------------------------------------------------------------

    @cached_property
    def lengths(self) -> tuple[Scalar, ...]:
        """Element lengths [m]."""
        return tuple(self._par.vector("element_lengths"))

    @cached_property
    def full(self) -> list[Scalar]:
        """Full coordinates: q, and coordinates known from the input."""
        q: list[Scalar] = [self.q[k] for k in range(self._structure.n)]
        return [*q, *self._known([drive.total for drive in self.drives])]

    @cached_property
    def full_rates(self) -> list[Scalar]:
        rates: list[Scalar] = [self.qd[k] for k in range(self._structure.n)]
        return [*rates, *self._known([drive.rate for drive in self.drives])]

    def _known(self, amplitudes: Sequence[Scalar]) -> list[Scalar]:
        """Full coordinates that are functions of the input, of amplitudes of its moments [N m]."""
        return [self.per_stiffness(row, amplitudes) for row in self._family.known.tolist()]

    def per_stiffness(self, weights: Sequence[float], amplitudes: Sequence[Scalar]) -> Scalar:
        """Weighted sum of amplitudes per factor of the stiffness."""
        stiffness = self._par["bending_stiffness"]
        terms = [(w, amplitude) for w, amplitude in zip(weights, amplitudes, strict=True) if w != 0.0]
        if isinstance(stiffness, float):
            # A product with a folded constant in place of a division, which takes several times as long.
            return sum(((w / stiffness) * amplitude for w, amplitude in terms), 0.0)
        return sum((w * amplitude for w, amplitude in terms), 0.0) / stiffness

    @cached_property
    def bends(self) -> list[Scalar]:
        """Bending angle of each element [rad]."""
        return [link.link.bend(1.0) for link in self.chain.links]

    # -- geometry ------------------------------------------------------------------------------------------------

    @cached_property
    def rod(self) -> RodProperties:
        """Properties of the rod that the family needs."""
        par = self._par
        masses = tuple((place.link, float(place.fraction), par[name]) for name, place in self._structure.masses())
        rest = par["rest_curvature"] if par.is_runtime("rest_curvature") else None
        return RodProperties(self.lengths, par["linear_density"], par["rotary_inertia"], rest, masses)

    @cached_property
    def chain(self) -> Chain:
        family = self._family
        local = [family.local(k) for k in range(len(self.lengths))]
        *links, last = family.links(self.full, self.rod)
        shares = remaining_shares(self._structure.finger, family, self._par, self._named)
        if shares:
            whole = zip([*links, last], shares, strict=True)
            *links, last = [replace(loaded, link=ShortenedLink(loaded.link, share)) for loaded, share in whole]
        bodies = tuple((1.0, body) for body in self.tip_bodies)
        return Chain([*links, replace(last, attached=last.attached + bodies)], local, family.size)

    @property
    def tip_bodies(self) -> list[Attached]:
        """Bodies at the tip beside point masses: one or none."""
        if self._structure.finger.tip_body is None:
            return []
        mass, inertia, across, along = (self._par[f"tip_body_{key}"] for key in ("mass", "inertia", "across", "along"))
        # The chain's axes have X along the finger and -Y across.
        return [Attached(mass, inertia, Vec(along, -across))]

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
        turned, (x, y) = self.turn.apply(v), self._par.vector("base_position")
        return Vec(turned.x + x, turned.y + y)

    @cached_property
    def tip_position(self) -> Vec:
        """World position of the tip [m]."""
        return self.to_world(self.chain.position(self._structure.tip))

    @cached_property
    def _partial_chain(self) -> list[tuple[Rotation, LinkSection, Vec, Scalar]]:
        """Per element its start's rotation, the section where it or the run-time position s ends, and that position and
        the angle there.
        """
        start: Scalar = 0.0
        angle: Scalar = self._par["base_angle"]
        turn, total, parts = IDENTITY, ZERO, []
        for link, h in zip(self.chain.links, self.lengths, strict=True):
            # Elements before s whole, those after it of length zero: one expression for all s, without branches.
            fraction = ca.fmin(ca.fmax((self.s - start) / h, 0.0), 1.0)
            section = link.link.section(fraction)
            total += turn.apply(section.position)
            angle += link.link.bend(fraction)
            parts.append((turn, section, total, angle))
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
        return self._partial_chain[-1][3]

    @cached_property
    def section_jacobian(self) -> ca.SX:
        """Derivative (2, n) of the world position of the section at s with respect to the unknowns."""
        tip = self._partial_chain[-1][2]
        arms = [ZERO] * self._family.size
        for (turn, section, end, _), local in zip(self._partial_chain, self.chain.coordinates, strict=True):
            beyond = tip - end
            for a, arm, angle in zip(local, section.arms, section.angles, strict=True):
                arms[a] = arms[a] + turn.apply(arm) + beyond.scaled(angle)
        return ca.horzcat(*[self.turn.apply(arm.perp()).column() for arm in arms[: self._structure.n]])

    @cached_property
    def joints(self) -> list[tuple[Vec, Scalar]]:
        """World position [m] and angle [rad] of the end section of each element."""
        return [self.section_at(ChainPlace(k)) for k in range(len(self.lengths))]

    def section_at(self, place: ChainPlace) -> tuple[Vec, Scalar]:
        """World position [m] and angle [rad] of a section."""
        angle: Scalar = self._par["base_angle"]
        for bend in self.bends[: place.link]:
            angle += bend
        angle += self.chain.links[place.link].link.bend(place.fraction)
        return self.to_world(self.chain.position(place)), angle

    def section_velocity(self, place: ChainPlace) -> tuple[Vec, Scalar]:
        """World velocity [m/s] and turning rate [rad/s] of a section."""
        velocity, spin = self.chain.velocity(place, self.full_rates)
        return self.turn.apply(velocity), spin

    @property
    def curvature(self) -> list[Scalar]:
        """Curvature [1/m] that belongs to each coordinate, from base to tip, and at a matched tip."""
        return self._family.curvature_at_coordinates(self.curvatures)

    @property
    def curvatures(self) -> list[list[Scalar]]:
        """Curvature [1/m] at the places of each element."""
        return [row[: len(self._family.places)] for row in self._every_curvature]

    @property
    def _every_curvature(self) -> list[list[Scalar]]:
        return [link.link.curvatures for link in self.chain.links]

    @property
    def greatest_bends(self) -> list[list[Scalar]]:
        """Curvatures where they may be greatest times the element's length [rad], which its bending range limits."""
        rows = [[h * kappa for kappa in row] for row, h in zip(self._every_curvature, self.lengths, strict=True)]
        longest = max(len(row) for row in rows)
        return [[*row, *[row[-1]] * (longest - len(row))] for row in rows]

    @cached_property
    def range_use(self) -> list[Scalar]:
        """Share of its bending range that each element uses."""
        peaks = [reduce(ca.fmax, [ca.fabs(ca.SX(bend)) for bend in bends]) for bends in self.greatest_bends]
        return [peak / reach for peak, reach in zip(peaks, self._structure.ranges, strict=True)]

    # -- forces --------------------------------------------------------------------------------------------------

    @property
    def _world_gravity(self) -> Vec:
        return Vec(*self._par.vector("gravity"))

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
        exerted = zip(self._stations, self.contacts.on_stations, strict=False)
        touched = [Load(place, back.apply(force), couple) for (place, _), (force, couple) in exerted]
        return loads + couples + touched

    @cached_property
    def _stations(self) -> list[tuple[ChainPlace, Station]]:
        """Stations at which the finger may touch something."""
        made = self._structure
        if not made.touches_object:
            return []
        named = [(f"finger.{k + 1}", at, place_at(at, made.lengths)) for k, at in enumerate(made.contacts)]
        half = made.finger.profile.half_thickness
        motions = self.chain.end_velocities(self.full_rates)
        stations = []
        for name, at, place in [*named, ("finger.tip", made.length, made.tip)]:
            center, (velocity, spin) = self.to_world(self.chain.position(place)), motions[place.link]
            # A couple at a matched tip would set the curvature that it depends on; without it the tip must not turn in
            # the slip either, or power would appear.
            turns = not (made.matched and place is made.tip)
            radius, moved = float(half(at)), self.turn.apply(velocity)
            stations.append((place, Station(name, center, radius, moved, spin if turns else 0.0, turns)))
        return stations

    @cached_property
    def elastic(self) -> list[Scalar]:
        """Gradient of the elastic energy; equation (32), and what laws add to it."""
        bent = _product(self._family.stiffness(self.lengths), self.full, self._par["bending_stiffness"])
        return self._with(bent, self.moving, "elastic")

    def _with(self, forces: list[Scalar], acting: Acting, *kinds: Kind) -> list[Scalar]:
        """Forces on coordinates, and the forces of the laws of these kinds."""
        if not self._structure.has_law(*kinds):
            return forces
        return [f + law_force for f, law_force in zip(forces, acting.sections.force(*kinds), strict=False)]

    @property
    def viscosity(self) -> Scalar:
        """Damping of the material, as a factor of the mesh's stiffness."""
        # Kelvin-Voigt: moment eta times the rate of curvature, so the matrix of the elasticity, whatever the elements;
        # eta is that of the rod itself at the base, and goes with the stiffness of the section.
        return 1.0 / self._structure.mesh.own_stiffness * self._par["material_damping"]

    @cached_property
    def damping(self) -> list[Scalar]:
        """Damping forces, positive against the motion."""
        rates, per_arc = self.full_rates, self._par["per_arc_damping"]
        force = _product(self._family.stiffness(self.lengths), rates, self.viscosity)
        force = self._with(force, self.moving, "damping")
        if isinstance(per_arc, float) and per_arc == 0.0:
            return force
        # Equation (39): a moment per arc against the rate of its bending angle.
        for k in range(len(self.lengths)):
            gradient = self._family.work(k, self.lengths)
            moment = per_arc * _dot(gradient, rates)
            force = [f + g * moment for f, g in zip(force, gradient, strict=True)]
        return force

    @cached_property
    def moving(self) -> Acting:
        """Forces on a finger that moves."""
        return self._in_motion(self._structure.memory, self.full_rates)

    def _in_motion(self, memory: Memory, rates: Sequence[Scalar]) -> Acting:
        at = self._instant(memory, rates)
        return Acting(self._structure, at, self.drives, self._states, ca.vertsplit(self.u))

    def _instant(self, memory: Memory, rates: Sequence[Scalar]) -> Instant:
        return Instant(self.lengths, self.full, rates, memory, self._named)

    @property
    def _named(self) -> dict[str, Scalar]:
        """Inputs and states by name and unit."""
        # A tension that lags is a state of the same name as its command: what acts comes last.
        names = [*self._structure.u_names, *self._structure.x_names]
        return dict(zip(names, ca.vertsplit(ca.vertcat(self.u, self.x)), strict=False))

    @cached_property
    def resting(self) -> Acting:
        """Forces on a finger at rest under its command, with friction by ``history``."""
        return self.at_rest()

    def at_rest(self, rates: Sequence[Scalar] | None = None, *, drawn: bool = False) -> Acting:
        """Forces on a finger whose drives are where they rest, which may itself have ``rates``, with friction by
        ``history``.

        Winches are where their command leads, or ``drawn``: where (the first of) their tendons have the tension
        ``pulled``.
        """
        commands: list[Scalar | None] = [None] * len(self._structure.winches) if drawn else [*ca.vertsplit(self.u)]
        # What is no friction has faded, or is where the command leads.
        history: list[Scalar] = [*ca.vertsplit(self.history)] if self.history.numel() else [0.0]
        *friction, moved = history
        left, names = iter(friction), self._structure.states
        states: dict[str, list[Scalar]] = {"winches": [], "relaxation": [0.0] * len(names["relaxation"])}
        states |= {group: list(islice(left, len(names[group]))) for group in ("tendons", "friction")}
        at = self._instant(
            Memory(self._structure.return_time, moved), [0.0] * self._family.size if rates is None else rates
        )
        return Acting(self._structure, at, self.commanded, states, commands, self.pulled)

    @cached_property
    def _states(self) -> dict[str, list[Scalar]]:
        """States beside coordinates and rates, by the groups of ``Structure.states``."""
        entries = iter(ca.vertsplit(self.x[2 * self._structure.n :]))
        return {group: list(islice(entries, len(names))) for group, names in self._structure.states.items()}

    def drives_of(self, resting: Acting) -> list[Scalar]:
        """States of the drives of a finger at rest."""
        return [*self.lags_at_rest, *resting.tendons.drives_at_rest, *[0.0] * len(self._states["relaxation"])]

    @property
    def lags_at_rest(self) -> list[Scalar]:
        """States of lags that have reached their commands."""
        sources = zip(self._structure.sources, self.amplitudes, strict=True)
        return [state for source, [(asked, _), *_] in sources for state in [asked, 0.0][: source.lags]]

    def _bending_force(self, acting: Acting, *, driven: bool = True) -> list[Scalar]:
        """Elastic force and friction less actuation, where it is ``driven``."""
        n, nodal = self._structure.n, self._family.nodal
        if nodal is None:
            actuation = acting.actuation if driven else [0.0] * self._family.size
            bent = [e - a for e, a in zip(self.elastic, actuation, strict=True)][:n]
            return self._with(bent, acting, *STATEFUL)
        # What the input bends is subtracted from the coordinates: the same, with fewer products and less cancellation.
        amplitudes = [drive.total for drive in self.drives]
        above = [self.full[k] - self.per_stiffness(nodal[k].tolist(), amplitudes) for k in range(n)]
        matrix = [row[:n] for row in self._family.stiffness(self.lengths)[:n]]
        return self._with(_product(matrix, above, self._par["bending_stiffness"]), acting, *STATEFUL)

    # -- motion --------------------------------------------------------------------------------------------------

    @cached_property
    def mass_matrix(self) -> list[list[Scalar]]:
        return [row[: self._structure.n] for row in self.chain.mass_matrix[: self._structure.n]]

    @property
    def known_accelerations(self) -> list[Scalar]:
        """Accelerations of the full coordinates that are functions of the input."""
        return self._known([drive.acceleration for drive in self.drives])

    @cached_property
    def known_inertia_force(self) -> list[Scalar]:
        """Inertia of parts that move with the input: without the inertia of a matched tip, ramps of a moment cost
        millimeters.
        """
        n = self._structure.n
        return [_dot(row[n:], self.known_accelerations) for row in self.chain.mass_matrix[:n]]

    @cached_property
    def bias(self) -> list[Scalar]:
        """Velocity products, and what the motion of a matched tip adds."""
        motion = self.chain.motion_forces(self.full_rates, ZERO)
        return [f - m for f, m in zip(self.known_inertia_force, motion, strict=False)]

    @cached_property
    def gravity(self) -> list[Scalar]:
        """Gradient of the weight's potential; equation (29)."""
        weight = self.chain.motion_forces(None, self.gravity_vector)
        return [-f for f in weight[: self._structure.n]]

    @cached_property
    def external_force(self) -> list[Scalar]:
        """Generalized forces of ``w``; equation (41)."""
        return self.chain.motion_forces(None, ZERO, self.loads)[: self._structure.n]

    def net_force(self, acting: Acting, *, driven: bool = True) -> list[Scalar]:
        """M qdd under what acts; with what tendons and couples exert where it is ``driven``."""
        parts = zip(self._forces(acting, self.full_rates, driven), self.damping, self.known_inertia_force, strict=False)
        return [force - damping - inertia for force, damping, inertia in parts]

    @cached_property
    def force_at_rest(self) -> list[Scalar]:
        """Generalized force where neither finger nor inputs move: without mass matrix and velocity products, half the
        work.
        """
        return self._forces(self.resting, None)

    def _forces(self, acting: Acting, rates: Sequence[Scalar] | None, driven: bool = True) -> list[Scalar]:
        """M qdd under all forces but damping and the inertia of known coordinates; ``rates`` of None: nothing moves."""
        motion = self.chain.motion_forces(rates, self.gravity_vector, self.loads)
        return [f - b for f, b in zip(motion, self._bending_force(acting, driven=driven), strict=False)]

    @cached_property
    def state_rate(self) -> list[Scalar]:
        rates: list[Scalar] = [self.qd[k] for k in range(self._structure.n)]
        accelerations = solve_ldl(self.mass_matrix, self.net_force(self.moving))
        return [*rates, *accelerations, *self.drive_rates, *self.contacts.rates(self._world_gravity)]

    @property
    def implicit_rate(self) -> list[Scalar]:
        """Derivative of the state as a step takes it that is implicit in elasticity and damping in ``part`` [s]."""
        n, part = self._structure.n, self.part
        stiffness = ca.jacobian(column(self.elastic[:n]), self.q)
        slowed = part * ca.jacobian(column(self.damping[:n]), self.qd) + part**2 * stiffness
        held = self.held_stiffness
        if not isinstance(held, float) or held > 0.0:
            # As if nothing slid or relaxed: states follow the velocity at the end of the step.
            block = matrix([row[:n] for row in self._family.stiffness(self.lengths)[:n]])
            slowed += part**2 * held * block
        slow = [[m + slowed[i, j] for j, m in enumerate(row)] for i, row in enumerate(self.mass_matrix)]
        pull = part * ca.mtimes(stiffness, self.qd)
        accelerations = solve_ldl(slow, [f - pull[k] for k, f in enumerate(self.net_force(self.moving))])
        return [
            *[self.qd[k] + part * rate for k, rate in enumerate(accelerations)],
            *accelerations,
            *self.implicit_drive_rates(ca.vertcat(*accelerations)),
            *self.contacts.rates(self._world_gravity),
        ]

    @cached_property
    def drive_rates(self) -> list[Scalar]:
        """Derivative of what lags, of winches and motors, and of what laws with a memory remember."""
        return self._rates_of_states(self.moving.sections)

    def _rates_of_states(self, sections: SectionForces) -> list[Scalar]:
        lag = [rate for _, rates in self._lagging for rate in rates]
        of_tendons, friction = self.moving.tendons.state_rates, sections.rates("friction")
        relaxation, winches = sections.rates("relaxation"), self.moving.tendons.drive_rates
        return [*lag, *winches, *relaxation, *of_tendons, *friction]

    def implicit_drive_rates(self, accelerations: ca.SX) -> list[Scalar]:
        """Rates of drives and friction in a step that is implicit in ``part`` [s], where laws with states are stiff."""
        n, part = self._structure.n, self.part
        ahead: list[Scalar] = [*(self.qd[k] + part * accelerations[k] for k in range(n)), *self.full_rates[n:]]
        return self._rates_of_states(self._in_motion(Memory(self._structure.return_time, part=part), ahead).sections)

    @property
    def held_stiffness(self) -> Scalar:
        """Stiffness that laws with states add while these are held, as a factor of the mesh's stiffness."""
        held = sum((placed.law.held for placed in self._structure.laws), 0.0)
        return 1.0 / self._structure.mesh.own_stiffness * held

    @property
    def drives_feel_motion(self) -> bool:
        """Whether the rates of drives depend on the motion of the finger."""
        return any(self._states[group] for group in self._states if group != "lag")

    @cached_property
    def pattern(self) -> Pattern | None:
        """Link shared by all elements; None where the equations of motion are solved densely (``model.sweep``)."""
        return pattern_of(self._family, self.rod) if one_link_serves(self._structure) else None

    @cached_property
    def kinetic_energy(self) -> Scalar:
        """Kinetic energy [J], with parts that move with the input, motors and touched bodies."""
        bending = 0.5 * _dot(_product(self.chain.mass_matrix, self.full_rates, 1.0), self.full_rates)
        return self.moving.tendons.kinetic_energy + bending + self.contacts.energy(self._world_gravity)[0]

    @cached_property
    def potential_energy(self) -> Scalar:
        """Elastic energy above the rest shape, with the energy of tendons on winches, potential of the weight above the
        world's origin, and the energy that contacts store [J].
        """
        product = _product(self._family.stiffness(self.lengths), self.full, 0.5)
        elastic = self._par["bending_stiffness"] * _dot(product, self.full)
        elastic += self.moving.tendons.stored_energy
        elastic += self.moving.sections.stored_energy
        mass, first = self.chain.first_moment()
        gx, gy = self._par.vector("gravity")
        x, y = self._par.vector("base_position")
        # Potential of the weight: -g . integral of r dm, base included.
        weight = first.dot(self.gravity_vector) + mass * (gx * x + gy * y)
        return elastic - weight + self.contacts.energy(self._world_gravity)[1]


def _dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    return sum((u * v for u, v in zip(a, b, strict=True)), 0.0)


def _product(matrix: Sequence[Sequence[Scalar]], vector: Sequence[Scalar], scale: Scalar) -> list[Scalar]:
    """Scale * matrix * vector, with a numeric scale folded into a numeric matrix."""
    if isinstance(scale, float):
        return [_dot([scale * entry for entry in row], vector) for row in matrix]
    return [scale * _dot(row, vector) for row in matrix]
