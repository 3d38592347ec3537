"""A finger as a chain of hinges with a guide of its tendons at each, and what it touches: the finest plant.

It has no kinematics, inertia, elasticity or tendon law in common with ``model``, whose fingers controllers assume: bars
between hinges, each of which bends what is of the rod within a half length of a bar on either side. At a guide a tendon
sticks, or slides at the capstan limit against the direction of its sliding; between guides it is elastic. What is
outside of the finger, object, supports, contacts and drives, is that of ``model``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.hinge_chain import OF_FINGER, Guided, HingeChain
from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.model.body import Body
from continuum_grasp.model.planar import Scalar, Vec, column
from continuum_grasp.model.touching import Pair, Station, disc_pair, support_pairs, table_pairs
from continuum_grasp.model.winches import Winch, winches_of
from continuum_grasp.scene.consumer import LIMITS_OF_BENDING, Consumer, beside
from continuum_grasp.scene.loads import ForceLoad
from continuum_grasp.scene.section_laws import unknown_to
from continuum_grasp.scene.simulate import Initial, Scene

Array = NDArray[np.float64]

_NO_TENSION = 1e-9
"""Tension below which a tendon has no friction that could be read off [N]."""
_NO_BEND = 1e-9
"""The same of its greatest loss, in logarithms [1]."""


class ChainSystem:
    """A chain of hinges as ``System`` is a finger: x = [bends, their rates, tensions, drives, object, contacts].

    Tensions [N] are those of the pieces of each tendon, from that after its first guide on. It has what ``PlantModel``
    reads off a system, and ``around`` for the integration of its motion; there is no ``forward_dynamics``, since what
    sticks at a guide is decided step by step.

    Parameters
    ----------
    scene : Scene
        The plant's finger in its surroundings; its tendons have no lag.
    hinges : int
        Number of hinges.
    axial_stiffness : float, optional
        Of tendons whose tension is commanded [N].
    parameters, object_parameters : sequence of str
        As those of ``System``; of the finger ``bending_stiffness``, ``material_damping``, ``tendon_friction``.

    Raises
    ------
    InputError
        Of what a chain does not have: no tendons, stops, a body beside the tip, tendons that are rigid.
    """

    def __init__(
        self,
        scene: Scene,
        hinges: int,
        axial_stiffness: float | None = None,
        parameters: Sequence[str] = (),
        object_parameters: Sequence[str] = (),
    ) -> None:
        self.scene = scene
        _check(scene, parameters)
        finger = scene.finger
        self.chain = HingeChain(finger, hinges, axial_stiffness)
        self.finger_model = FingerModel(
            scene.replaced(finger=finger.with_tendons(friction_cells=1)), family="arc", elements=hinges
        )
        self.winches = winches_of(finger.tendon_list, self.chain.length)
        self.surroundings = scene if scene.object is not None else None
        model = self.finger_model
        self.n, self.u_names, self.nu = hinges, model.u_names, model.nu
        self._finger_parameters, self._object_parameters = tuple(parameters), tuple(object_parameters)
        values = {"bending_stiffness": 1.0, "material_damping": 1.0, "tendon_friction": 1.0, "friction_factor": 1.0}
        values |= {"object_mass": 1.0 if scene.object is None else scene.object.mass}
        self.p_nominal = [values[name] for name in (*parameters, *object_parameters)]
        self.np = len(self.p_nominal)
        self._build()

    @property
    def tendons(self) -> list[Guided]:
        """Tendons and their guides."""
        return self.chain.tendons

    def numbers(self, p: Array) -> Array:
        """All that the C of the motion needs to know, at run-time arguments."""
        factors = dict(zip(self._finger_parameters, p.tolist(), strict=False))
        return self.chain.numbers(self.scene.gravity, self.places, factors)

    # -- what surrounds the chain -------------------------------------------------------------------------------------

    def _build(self) -> None:
        scene, model = self.scene, self.finger_model
        ways = [at for at in model.contacts if at < self.chain.length]
        forces = [load for load in model.loads if isinstance(load, ForceLoad)]
        self.places = [*ways, self.chain.length, *(load.at for load in forces)]
        self._motion = ca.SX.sym("places", 6, len(self.places))
        w, p = ca.SX.sym("w", model.nw), ca.SX.sym("p", len(self._object_parameters))
        given = dict(zip(self._object_parameters, ca.vertsplit(p), strict=True)) if p.numel() else {}
        half = scene.finger.profile.half_thickness
        self._body: Body | None = None
        self._pairs: list[Pair] = []
        names = [*(f"finger.{k + 1}" for k in range(len(ways))), "finger.tip"]
        if scene.object is not None and scene.contact_law is not None:
            x, y = scene.object.position
            place = given.get("object_x", x), given.get("object_y", y)
            grip = given.get("friction_factor", 1.0)
            self._body = body = Body(scene.object, scene, given.get("object_mass"), grip, place)
            law = scene.contact_law
            for k, name in enumerate(names):
                m = self._motion[:, k]
                disc = Station(name, Vec(m[0], m[1]), float(half(self.places[k])), Vec(m[2], m[3]), m[5])
                self._pairs.append(disc_pair(body, law, disc))
            self._pairs += support_pairs(body, law, scene.walls, scene.pegs)
            if scene.table is not None:
                self._pairs += table_pairs(body, law, scene.table)
        self.touch_names = [pair.name for pair in self._pairs]
        self._states = ca.SX.sym("drives", sum(winch.states for winch in self.winches))
        pose, rates, wrench = ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1)
        own_names: list[str] = []
        self.w_names = list(model.w_names)
        if self._body is not None:
            pose, rates, wrench = self._body.pose, self._body.rates, self._body.wrench
            own_names, self.w_names = self._body.x_names, [*self.w_names, *self._body.w_names]
        z = [pair.z for pair in self._pairs]
        self._others = ca.vertcat(self._states, pose, rates, *z)
        winch_names = [name for k, winch in enumerate(self.winches) for name in winch.names(k + 1)]
        contact_names = [name for pair in self._pairs for name in pair.z_names]
        q_names = [f"bend_{k + 1} [rad]" for k in range(self.chain.hinges)]
        tension_names = [
            f"tension_{j + 1}_{k + 1} [N]" for j in range(len(self.tendons)) for k in range(self.chain.hinges + 1)
        ]
        self.x_names = [*q_names, *(name.replace(" [rad]", "_rate [rad/s]") for name in q_names), *tension_names]
        self.first_other = len(self.x_names)
        self.x_names += [*winch_names, *own_names, *contact_names]
        self.nx, self.nw = len(self.x_names), len(self.w_names)
        pose_at = self.first_other + len(winch_names)
        self.object_states = slice(pose_at, pose_at + pose.numel())
        self._w, self._p = ca.vertcat(w, wrench), p
        self._u, self._tension = ca.SX.sym("u", self.nu), ca.SX.sym("tension", len(self.tendons))
        self._loads = forces

    def _of_winches(self, others: ca.SX | Array) -> list[tuple[Winch, list[Scalar]]]:
        """The winches with their states."""
        found, at = list[tuple[Winch, list[Scalar]]](), 0
        for winch in self.winches:
            found.append((winch, [others[at + k] for k in range(winch.states)]))
            at += winch.states
        return found

    @cached_property
    def drums(self) -> ca.Function:
        """``(others, u) -> drum``: what each tendon has at its drive: a length wound up [m] where a gear neither yields
        nor has a play, or a tension [N].
        """
        given: list[Scalar] = [] if self.winches else [self._u[j] for j in range(len(self.tendons))]
        for winch, states in self._of_winches(self._states):
            given += winch.wound(states[0])
        return ca.Function("drums", [self._others, self._u], [column(given)], ["others", "u"], ["drum"])

    @cached_property
    def around(self) -> ca.Function:
        """``(places, tension, others, u, w, p) -> force, rate, exerted, point, lift``: forces and couples (3, K) on the
        places, world, and the rates of the other states; places (6, K) have position, velocity, angle and spin,
        tensions are those at the drives. What the finger exerts on the object at its C contacts is world force (2, C)
        [N], the point (2, C) [m] where it acts, and force out of the plane (C) [N].
        """
        forces = [ca.SX(3, 1) for _ in self.places]
        w_at = {name: self._w[k] for k, name in enumerate(self.w_names)}
        contacts = len(self.finger_model.contacts)
        for k in range(contacts):
            forces[k] += ca.vertcat(*[w_at[f"contact_{k + 1}_{axis} [N]"] for axis in "xy"], 0.0)
        if "tip_x [N]" in w_at:
            forces[contacts] += ca.vertcat(w_at["tip_x [N]"], w_at["tip_y [N]"], 0.0)
        for k, load in enumerate(self._loads):
            at = contacts + 1 + k
            axes = ("across", "along") if load.follows else ("x", "y")
            fx, fy = (w_at[f"load_{k + 1}_{axis} [N]"] for axis in axes)
            if load.follows:
                c, s = ca.cos(self._motion[4, at]), ca.sin(self._motion[4, at])
                fx, fy = c * fx - s * fy, s * fx + c * fy
            forces[at] += ca.vertcat(fx, fy, 0.0)
        own = self._pairs[: contacts + 1]
        for k, pair in enumerate(own):
            center = Vec(self._motion[0, k], self._motion[1, k])
            couple = (pair.point - center).cross(pair.force)
            forces[k] += ca.vertcat(pair.force.x, pair.force.y, couple)
        rates: list[Scalar] = []
        taken = iter(ca.vertsplit(self._tension))
        for k, (winch, states) in enumerate(self._of_winches(self._states)):
            rates += winch.rates(states, self._u[k], [next(taken) for _ in winch.tendons])
        if self._body is not None:
            given = [(pair.point, pair.force.scaled(-1.0)) for pair in self._pairs]
            lifts, moments = [pair.lift for pair in self._pairs], [pair.moment for pair in self._pairs if pair.arm]
            rates += self._body.state_rate(Vec(*self.scene.gravity), given, lifts, moments)
        for pair in self._pairs:
            rates += pair.z_rate
        inputs = [self._motion, self._tension, self._others, self._u, self._w, self._p]
        exerted = [_columns([pair.force.scaled(-1.0) for pair in own]), _columns([pair.point for pair in own])]
        values = [ca.horzcat(*forces), column(rates), *exerted, column([pair.lift for pair in own])]
        outputs = ca.cse([ca.densify(value) for value in values])
        names = ["places", "tension", "others", "u", "w", "p"]
        return ca.Function("around", inputs, outputs, names, ["force", "rate", "exerted", "point", "lift"])

    # -- what is read off -------------------------------------------------------------------------------------------

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return ca.SX.sym("x", self.nx), ca.SX.sym("u", self.nu), ca.SX.sym("p", self.np)

    def _function(self, name: str, values: Sequence[ca.SX], names: Sequence[str]) -> ca.Function:
        return ca.Function(name, list(self._symbols), [ca.densify(v) for v in values], ["x", "u", "p"], list(names))

    def _at(self, at: float) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Position, velocity, angle and spin of a point of the chain."""
        n, (x, *_), base, place = self.chain.hinges, self._symbols, self.scene.finger.base, self.chain.place(at)
        angle, spin = base.angle + ca.cumsum(x[:n]), ca.cumsum(x[n : 2 * n])
        start = float(self.chain.links.at[0]) if place.bar >= 0 else place.along
        position = ca.SX(ca.DM(base.position)) + start * ca.DM([-np.sin(base.angle), np.cos(base.angle)])
        velocity = ca.SX(2, 1)
        for i in range(place.bar + 1):
            length = float(self.chain.bars[i]) if i < place.bar else place.along
            way = length * ca.vertcat(-ca.sin(angle[i]), ca.cos(angle[i]))
            position += way
            velocity += spin[i] * ca.vertcat(-way[1], way[0])
        if place.bar < 0:
            return position, velocity, ca.SX(base.angle), ca.SX(0.0)
        return position, velocity, angle[place.bar], spin[place.bar]

    @cached_property
    def tip(self) -> ca.Function:
        """``(x, u, p) -> r``: world position of the tip (2) [m]."""
        return self._function("tip", [self._at(self.chain.length)[0]], ["r"])

    def sections(self, stations: Sequence[float]) -> ca.Function:
        """``(x, u, p) -> r, angle`` of sections [m], as of a ``System``; a hinge spreads its bend over its part."""
        (x, *_), n = self._symbols, self.chain.hinges
        points = [self._at(at)[0] for at in stations]
        angles = []
        for at in stations:
            whole = min(int(at / self.chain.pitch), n - 1)
            angle = self.scene.finger.base.angle + ca.sum1(x[:whole])
            angles.append(angle + (at / self.chain.pitch - whole) * x[whole])
        return self._function("sections", [ca.horzcat(*points), ca.vertcat(*angles)], ["r", "angle"])

    @cached_property
    def curvature(self) -> ca.Function:
        """``(x, u, p) -> kappa``: curvature of each hinge's part (N) [1/m]."""
        return self._function("curvature", [self._symbols[0][: self.chain.hinges] / self.chain.pitch], ["kappa"])

    @cached_property
    def range_use(self) -> ca.Function:
        """``(x, u, p) -> use``: bend per that at which neighboring bars are at a right angle (N) [1]."""
        return self._function("range_use", [ca.fabs(self._symbols[0][: self.chain.hinges]) / (0.5 * np.pi)], ["use"])

    @cached_property
    def tensions(self) -> ca.Function:
        """``(x, u, p) -> tensions``: of each tendon at its drive [N]."""
        (x, u, _), n = self._symbols, self.chain.hinges
        paths: list[Scalar] = []
        for j, tendon in enumerate(self.tendons):
            own = x[2 * n + j * (n + 1) : 2 * n + (j + 1) * (n + 1)]
            stretched = ca.dot(ca.DM(tendon.gives[1:]), own[: tendon.guides])
            paths.append(ca.dot(ca.DM(tendon.arms), x[:n]) + stretched)
        found = self._pulls(x[self.first_other :], u, [float(tendon.gives[0]) for tendon in self.tendons], paths)
        return self._function("tensions", [ca.vertcat(*found)], ["tensions"])

    def _pulls(
        self, others: ca.SX | Array, u: ca.SX | Array, compliances: Sequence[Scalar], paths: Sequence[Scalar]
    ) -> list[Scalar]:
        """Tensions at the drives [N] of tendons of compliances [m/N] that are drawn in by paths [m]."""
        found: list[Scalar] = [] if self.winches else [u[j] for j in range(len(self.tendons))]
        for winch, states in self._of_winches(others):
            gives, drawn = winch.of_its(compliances), winch.of_its(paths)
            wound = winch.wound(winch.drum(states, gives, drawn, sharp=True))
            found += [ca.fmax(y - path, 0.0) / give for y, path, give in zip(wound, drawn, gives, strict=True)]
        return found

    def friction_along(self, x: ca.SX, u: ca.SX, tendon: int, start: float, end: float) -> ca.SX:
        """Which way friction acts on a tendon between two positions [m]: its loss there per the greatest one."""
        own, n = self.tendons[tendon], self.chain.hinges
        first = int(own.conduit > 0.0)
        base = self.tensions(x[: self.nx], u[: self.nu], ca.SX.zeros(self.np))[tendon]
        at = 2 * n + tendon * (n + 1)
        along = ca.fmax(ca.vertcat(base, x[at : at + own.guides]), _NO_TENSION)
        inside = [k for k in range(own.guides - first) if start <= self.chain.links.at[k] <= end]
        if not inside or own.friction == 0.0:
            return ca.SX(0.0)
        loss = ca.log(along[inside[0] + first]) - ca.log(along[inside[-1] + first + 1])
        most = own.friction * ca.sum1(ca.fabs(x[inside[0] : inside[-1] + 1])) + _NO_BEND
        return ca.fmin(ca.fmax(loss / most, -1.0), 1.0)

    @cached_property
    def touch(self) -> ca.Function:
        """``(x, u, w, p) -> gap, ...``: as of a ``System``."""
        (x, u, p), pairs = self._symbols, self._pairs

        values = {
            "gap": column([pair.gap for pair in pairs]),
            "normal_force": column([pair.normal_force for pair in pairs]),
            "friction": column([pair.tangential for pair in pairs]),
            "lift": column([pair.lift for pair in pairs]),
            "force": _columns([pair.force.scaled(-1.0) for pair in pairs]),
            "point": _columns([pair.point for pair in pairs]),
            "normal": _columns([pair.normal for pair in pairs]),
        }
        own = ca.Function("own", [self._motion, self._others, self._w, self._p], list(values.values()))
        motion = ca.horzcat(*[ca.vertcat(*self._at(at)) for at in self.places])
        w = ca.SX.sym("w", self.nw)
        found = own.call([motion, x[self.first_other :], w, p[len(self._finger_parameters) :]])
        dense = [ca.densify(v) for v in ca.cse(found)]
        return ca.Function("touch", [x, u, w, p], dense, ["x", "u", "w", "p"], list(values))

    # -- the start ----------------------------------------------------------------------------------------------------

    def start(self, q: Array, qd: Array, drives: Array, u: Array, initial: Initial) -> Array:
        """State at rest in bends (N) under drives; guides have slid as a pose was ``reached_by``, or not at all."""
        x = np.zeros(self.nx)
        x[: self.n], x[self.n : 2 * self.n] = q, qd
        x[self.first_other : self.first_other + len(drives)] = drives
        if self._body is not None:
            x[self.object_states] = self._body.start
        way = {"pulling": 1.0, "releasing": -1.0}.get(initial.reached_by or "", 0.0)
        passed = list[Array]()
        for tendon in self.tendons:
            drawn = tendon.arms * q
            beyond = np.cumsum(drawn[::-1])[::-1] - 0.5 * drawn
            losses = way * np.sign(beyond) * tendon.friction * np.abs(q)
            if tendon.conduit:
                losses = np.append(way * np.sign(drawn.sum()) * tendon.friction * tendon.conduit, losses)
            passed.append(np.exp(-np.cumsum([0.0, *losses[: tendon.guides]])))
        compliances = [float(tendon.gives @ shares) for tendon, shares in zip(self.tendons, passed, strict=True)]
        paths = [float(tendon.arms @ q) for tendon in self.tendons]
        tensions = self._pulls(x[self.first_other :], u, compliances, paths)
        for j, (tendon, shares) in enumerate(zip(self.tendons, passed, strict=True)):
            at = 2 * self.n + j * (self.n + 1)
            x[at : at + tendon.guides] = float(tensions[j]) * shares[1:]
        return x


def _columns(vectors: Sequence[Vec]) -> ca.SX:
    """Vectors as columns (2, C)."""
    return ca.horzcat(ca.SX(2, 0), *[v.column() for v in vectors])


_GUIDES = Consumer(
    "plant.guides",
    refused={
        **unknown_to("a chain of guides (plant.guides)"),
        "loads.kind=moment": "a chain of guides (plant.guides) takes forces as loads, no moments",
        "initial.reached_by=state": "state is that of cells, which a chain of guides has not",
    },
    unneeded={
        **LIMITS_OF_BENDING,
        "finger.damping.per_arc": "the plant has as much material damping in its place",
        "finger.damping.friction_cells": "there is no dry friction",
        "finger.tendons.friction_cells": "each guide is a cell",
        "finger.tendons.presliding": "tendons slide or stick, and are elastic between guides",
        "finger.tendons.time_constant": "the plant's drives have it",
        **dict.fromkeys(("finger.tendons.min_tension", "finger.tendons.max_tension"), "the controller keeps it"),
    },
)
_ON_AXIS = beside(
    "plant.guides under what is aside",
    lambda s: s.finger.tip_body is not None and s.finger.tip_body.center_of_mass[0] != 0.0,
    "finger.tip_body.center_of_mass",
    "a chain of guides carries a body at the tip on its axis alone: expected 0 across",
)


def _check(scene: Scene, parameters: Sequence[str]) -> None:
    """Refuse what a chain does not have."""
    for one in (_GUIDES, _ON_AXIS):
        one.check(scene)
    odd = [name for name in parameters if name not in OF_FINGER]
    if odd:
        raise InputError(f"a chain of guides has no run-time argument {odd[0]}", key="plant.guides")
