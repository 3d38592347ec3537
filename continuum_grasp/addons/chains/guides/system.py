"""A finger as a chain of hinges with a guide of its tendons at each, and what it touches: the finest plant.

It has no kinematics, inertia, elasticity or tendon law in common with ``model``, whose fingers controllers assume: bars
between hinges, each of which bends for the rod within a half length of a bar on either side. At a guide a tendon
sticks, or slides at the capstan limit against the direction of its sliding; between guides it is elastic. The rest
(object, supports, contacts and drives) comes from ``model``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.addons.chains.guides.tendons import guided_tendons
from continuum_grasp.addons.chains.links import Links
from continuum_grasp.base import Array, InputError
from continuum_grasp.model import (
    Contacts,
    FingerModel,
    Model,
    Scalar,
    System,
    Vec,
    Winch,
    column,
)
from continuum_grasp.scene import Consumer, ForceLoad, Scene

OF_FINGER = ("bending_stiffness", "material_damping", "tendon_friction")
"""Numbers of the finger that may be changed without compiling anew."""


class ChainSystem(Model):
    """A chain of N hinges in equal parts of the finger, each with the bend of its part, as ``System`` is a finger.

    x = [bends, their rates, tensions, drives, object, contacts].

    Tensions [N] belong to the pieces of each tendon, from the piece after its first guide on. It has what
    ``PlantModel`` reads off a system, and ``around`` for the integration of its motion; there is no
    ``forward_dynamics``, since what sticks at a guide is decided step by step.

    Tendons of the scene have no lag; ``axial_stiffness`` [N] is of those whose tension is commanded. Of the finger,
    ``parameters`` are some of ``OF_FINGER``. What a chain does not have is an InputError.
    """

    def __init__(
        self,
        scene: Scene,
        hinges: int,
        axial_stiffness: float | None = None,
        parameters: Sequence[str] = (),
        object_parameters: Sequence[str] = (),
    ) -> None:
        _check(scene, parameters)
        self.scene = scene
        finger = scene.finger
        self.length = finger.rod.length
        self.pitch = finger.rod.length / hinges
        self.links = Links.of(finger, hinges, even=True)
        self.tendons = guided_tendons(finger, self.links.at, axial_stiffness)
        self.winches = Winch.of_finger(finger)
        self.finger_model = FingerModel(
            scene.replaced(finger=finger.with_tendons(friction_cells=1)), family="arc", elements=hinges
        )
        self.surroundings = scene if scene.object is not None else None
        model = self.finger_model
        self.n = hinges
        self.u_names = model.u_names
        self.nu = model.nu
        self._finger_parameters = tuple(parameters)
        self._object_parameters = tuple(object_parameters)
        values = {"bending_stiffness": 1.0, "material_damping": 1.0, "tendon_friction": 1.0, "friction_factor": 1.0}
        values |= {"object_mass": 1.0 if scene.object is None else scene.object.mass}
        self.p_names = [*parameters, *object_parameters]
        self.p_nominal = [values[name] for name in self.p_names]
        self.np = len(self.p_nominal)
        self._build()

    def _place(self, at: float) -> tuple[int, float]:
        """Return which bar carries a position along the finger [m], counted from that after the first hinge (-1: before
        it), and how far along it that is [m].
        """
        bar = self.links.link_of(at + 1e-9 * self.pitch)
        return bar, at - (self.links.at[bar] if bar >= 0 else 0.0)

    def numbers(self, p: Array) -> Array:
        """All that the C of the motion needs to know, at run-time arguments."""
        factors = dict.fromkeys(OF_FINGER, 1.0) | dict(zip(self._finger_parameters, p.tolist(), strict=False))
        links = self.links
        base = self.scene.finger.base
        points = [self._place(at) for at in self.places]
        weights, carried = links.turning
        parts: list[ArrayLike] = [
            [*base.position, base.angle, links.at[0], *self.scene.gravity],
            weights.ravel(),
            factors["bending_stiffness"] * links.stiffness,
            links.rest,
            # Material damping follows from the stiffness of the section as it is described.
            factors["material_damping"] * links.damping,
            carried,
            links.bars,
            [bar for bar, _ in points],
            [along for _, along in points],
        ]
        for tendon in self.tendons:
            gives = np.zeros(self.n + 2)
            gives[: len(tendon.gives)] = tendon.gives
            friction = factors["tendon_friction"] * tendon.friction
            numbers = [tendon.guides, tendon.wound, tendon.conduit > 0.0, friction, tendon.conduit, *tendon.gear]
            parts += [numbers, tendon.arms, gives]
        return np.concatenate([np.asarray(part, dtype=float).ravel() for part in parts])

    # -- what surrounds the chain -------------------------------------------------------------------------------------

    def _build(self) -> None:
        scene, model, n = self.scene, self.finger_model, self.n
        ways = [at for at in model.contacts if at < self.length]
        self._loads = [load for load in model.loads if isinstance(load, ForceLoad)]
        self.places = [*ways, self.length, *(load.at for load in self._loads)]
        # Position, velocity, angle and spin of each place, where contacts and loads act.
        self._motion = ca.SX.sym("places", 6, len(self.places))
        self._of_object = ca.SX.sym("p", len(self._object_parameters))
        object_parameters = {name: self._of_object[k] for k, name in enumerate(self._object_parameters)}
        touching = self.places[: len(ways) + 1]
        touched = self._touched = Contacts.of_finger(scene, touching, self._motion, object_parameters)
        self.touch_names = [pair.name for pair in touched.pairs]
        self._states = ca.SX.sym("drives", sum(winch.states for winch in self.winches))
        self._others = ca.vertcat(self._states, touched.states)
        bends = [f"bend_{k + 1} [rad]" for k in range(n)]
        tensions = [f"tension_{j + 1}_{k + 1} [N]" for j in range(len(self.tendons)) for k in range(n + 1)]
        self.x_names = [*bends, *(name.replace(" [rad]", "_rate [rad/s]") for name in bends), *tensions]
        self.first_other = len(self.x_names)
        self.x_names += [name for k, winch in enumerate(self.winches) for name in winch.names(k + 1)]
        at = len(self.x_names)
        self.object_states = slice(at, at + len(touched.start))
        self.x_names += touched.names
        self.w_names = model.w_names + touched.w_names
        self.nx = len(self.x_names)
        self.nw = len(self.w_names)
        self._w = ca.vertcat(ca.SX.sym("w", model.nw), touched.wrench)
        self._x = ca.vertcat(ca.SX.sym("x", self.first_other), self._others)
        self._p = ca.vertcat(ca.SX.sym("factors", len(self._finger_parameters)), self._of_object)
        self._u = ca.SX.sym("u", self.nu)
        self._tension = ca.SX.sym("tension", len(self.tendons))
        bend = self._x[:n]
        # Read off as those of elements are.
        self._equations: Any = SimpleNamespace(
            x=self._x,
            u=self._u,
            w=self._w,
            p=self._p,
            contacts=touched,
            tip_position=self._at(self.length)[0],
            curvature=bend / self.pitch,
            range_use=ca.fabs(bend) / (0.5 * np.pi),  # per that at which neighboring bars are at a right angle
            tensions=self._tensions,
        )

    def _of_winches(self, others: ca.SX | Array) -> list[tuple[Winch, list[Scalar]]]:
        """The winches with their states."""
        winches = []
        at = 0
        for winch in self.winches:
            states: list[Scalar] = [others[k] for k in range(at, at + winch.states)]
            winches.append((winch, states))
            at += winch.states
        return winches

    @cached_property
    def drums(self) -> ca.Function:
        """``(others, u) -> drum``: what each tendon has at its drive: a length wound up [m] where a gear neither yields
        nor has a play, or a tension [N].
        """
        wound: list[Scalar] = [] if self.winches else [self._u[j] for j in range(len(self.tendons))]
        for winch, states in self._of_winches(self._states):
            wound += winch.wound(states[0])
        return ca.Function("drums", [self._others, self._u], [column(wound)], ["others", "u"], ["drum"])

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
                c = ca.cos(self._motion[4, at])
                s = ca.sin(self._motion[4, at])
                fx, fy = c * fx - s * fy, s * fx + c * fy
            forces[at] += ca.vertcat(fx, fy, 0.0)
        pairs = self._touched.pairs[: contacts + 1]
        for k, (force, couple) in enumerate(self._touched.on_stations):
            forces[k] += ca.vertcat(force.x, force.y, couple)
        rates: list[Scalar] = []
        taken = iter(ca.vertsplit(self._tension))
        for k, (winch, states) in enumerate(self._of_winches(self._states)):
            rates += winch.rates(states, self._u[k], [next(taken) for _ in winch.tendons])
        rates += self._touched.rates(Vec(*self.scene.gravity))
        inputs = [self._motion, self._tension, self._others, self._u, self._w, self._of_object]
        exerted = [Vec.columns(pair.force.scaled(-1.0) for pair in pairs), Vec.columns(pair.point for pair in pairs)]
        values = [ca.horzcat(*forces), column(rates), *exerted, column([pair.lift for pair in pairs])]
        outputs = ca.cse([ca.densify(value) for value in values])
        names = ["places", "tension", "others", "u", "w", "p"]
        return ca.Function("around", inputs, outputs, names, ["force", "rate", "exerted", "point", "lift"])

    # -- what is read off -------------------------------------------------------------------------------------------

    def _placed(self, expressions: list[ca.SX]) -> list[ca.SX]:
        motion = ca.horzcat(*[ca.vertcat(*self._at(at)) for at in self.places])
        return list(ca.substitute(expressions, [self._motion], [motion]))

    def _at(self, at: float) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Position, velocity, angle and spin of a point of the chain."""
        n = self.n
        x = self._x
        base = self.scene.finger.base
        bar, along = self._place(at)
        angle = base.angle + ca.cumsum(x[:n])
        spin = ca.cumsum(x[n : 2 * n])
        start = float(self.links.at[0]) if bar >= 0 else along
        position = ca.SX(ca.DM(base.position)) + start * ca.DM([-np.sin(base.angle), np.cos(base.angle)])
        velocity = ca.SX(2, 1)
        for i in range(bar + 1):
            length = float(self.links.bars[i]) if i < bar else along
            way = length * ca.vertcat(-ca.sin(angle[i]), ca.cos(angle[i]))
            position += way
            velocity += spin[i] * ca.vertcat(-way[1], way[0])
        if bar < 0:
            return position, velocity, ca.SX(base.angle), ca.SX(0.0)
        return position, velocity, angle[bar], spin[bar]

    tip = System.tip
    touch = System.touch
    curvature = System.curvature
    range_use = System.range_use

    @cached_property
    def tensions(self) -> ca.Function:
        """(x, u, p) -> tensions at the drives [N]."""
        return self._function("tensions", "x u p", tensions=self._equations.tensions)

    def sections(self, stations: Sequence[float]) -> ca.Function:
        """``(x, u, p) -> r, angle`` of sections [m], as of a ``System``; a hinge spreads its bend over its part."""
        x = self._x
        angles = list[Scalar]()
        for at in stations:
            whole = min(int(at / self.pitch), self.n - 1)
            angle = self.scene.finger.base.angle + ca.sum1(x[:whole])
            angles.append(angle + (at / self.pitch - whole) * x[whole])
        points = [self._at(at)[0] for at in stations]
        return self._function("sections", "x u p", r=ca.horzcat(*points), angle=angles)

    @property
    def _tensions(self) -> list[Scalar]:
        """Tension of each tendon at its drive [N]."""
        x = self._x
        n = self.n
        paths = list[Scalar]()
        for j, tendon in enumerate(self.tendons):
            tendon_states = x[2 * n + j * (n + 1) : 2 * n + (j + 1) * (n + 1)]
            stretched = ca.dot(ca.DM(tendon.gives[1:]), tendon_states[: tendon.guides])
            paths.append(ca.dot(ca.DM(tendon.arms), x[:n]) + stretched)
        return self._pulls(x[self.first_other :], self._u, [float(tendon.gives[0]) for tendon in self.tendons], paths)

    def _pulls(
        self, others: ca.SX | Array, u: ca.SX | Array, compliances: Sequence[Scalar], paths: Sequence[Scalar]
    ) -> list[Scalar]:
        """Tensions at the drives [N] of tendons of compliances [m/N] that are drawn in by paths [m]."""
        tensions: list[Scalar] = [] if self.winches else [u[j] for j in range(len(self.tendons))]
        for winch, states in self._of_winches(others):
            cables = winch.cables(compliances, paths)
            slacks = cables.slacks(winch.drum(states, cables, sharp=True))
            tensions += [ca.fmax(slack, 0.0) / give for slack, give in zip(slacks, cables.compliances, strict=True)]
        return tensions

    def friction_along(self, x: ca.SX, u: ca.SX, tendon: int, start: float, end: float) -> ca.SX:
        """Direction of friction on a tendon between two positions [m]: the loss there per the greatest one."""
        cable = self.tendons[tendon]
        n = self.n
        first = int(cable.conduit > 0.0)
        base = self.tensions(x[: self.nx], u[: self.nu], ca.SX.zeros(self.np))[tendon]
        at = 2 * n + tendon * (n + 1)
        # 1e-9: tension below which a tendon has no friction that could be read off [N]
        along = ca.fmax(ca.vertcat(base, x[at : at + cable.guides]), 1e-9)
        inside = [k for k in range(cable.guides - first) if start <= self.links.at[k] <= end]
        if not inside or cable.friction == 0.0:
            return ca.SX(0.0)
        loss = ca.log(along[inside[0] + first]) - ca.log(along[inside[-1] + first + 1])
        # 1e-9: greatest loss, as a logarithm, below which a tendon has no friction that could be read off
        greatest_loss = cable.friction * ca.sum1(ca.fabs(x[inside[0] : inside[-1] + 1])) + 1e-9
        return ca.fmin(ca.fmax(loss / greatest_loss, -1.0), 1.0)

    # -- the start ----------------------------------------------------------------------------------------------------

    def start(self, finger: Array, u: Array) -> Array:
        """Return the state at rest with the shape and friction of ``finger_model`` in its state ``finger`` (nx,)."""
        model, x = self.finger_model, np.zeros(self.nx)
        groups, winches = model.structure.states, sum(winch.states for winch in self.winches)
        # The chain has no states for the lags of the finger's drives.
        bends, rates, _, drives, _ = np.split(finger, np.cumsum([self.n, self.n, len(groups["lag"]), winches]))
        # The model's bends count from the shape at rest.
        q = bends + self.links.rest
        x[: self.n], x[self.n : 2 * self.n] = q, rates
        x[self.first_other : self.first_other + len(drives)] = drives
        x[self.object_states] = self._touched.start
        ways = model.friction_in(finger)
        passed = [np.ones(tendon.guides + 1) for tendon in self.tendons]
        for cells in model.structure.cell_sets:
            own, ways = np.split(ways, [cells.states])
            for k, side in zip(cells.tendons, cells.sides, strict=True):
                tendon = self.tendons[k]
                bent = np.append(tendon.conduit, np.abs(q)) if tendon.conduit else np.abs(q)
                losses = side * tendon.friction * own[: tendon.guides] * bent[: tendon.guides]
                passed[k] = np.exp(-np.cumsum([0.0, *losses]))
        compliances = [float(tendon.gives @ shares) for tendon, shares in zip(self.tendons, passed, strict=True)]
        paths = [float(tendon.arms @ q) for tendon in self.tendons]
        tensions = self._pulls(x[self.first_other :], u, compliances, paths)
        for j, (tendon, shares) in enumerate(zip(self.tendons, passed, strict=True)):
            at = 2 * self.n + j * (self.n + 1)
            x[at : at + tendon.guides] = float(tensions[j]) * shares[1:]
        return x


_GUIDES = Consumer(
    "plant.guides",
    refused={
        **Consumer.unknown_laws("a chain of guides (plant.guides)"),
        "support_motion": "supports beside a chain of guides (plant.guides) stay: leave it out",
        "finger.pressure": "a chain of guides (plant.guides) works only with tendons: omit guides",
        "loads.kind=moment": "a chain of guides (plant.guides) takes only forces as loads, no moments",
        "initial.reached_by=state": "state describes friction cells, which a chain of guides does not have",
    },
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        "finger.damping.per_arc": "the plant has as much material damping in its place",
        **dict.fromkeys(("object_load", "table_height"), "the plant has them among its forces"),
        "finger.damping.friction_cells": "there is no dry friction",
        "finger.tendons.friction_cells": "each guide is a cell",
        "finger.tendons.presliding": "tendons slide or stick, and are elastic between guides",
        **dict.fromkeys(("finger.tendons.time_constant", "finger.tendons.drive_order"), "the plant's drives have it"),
        **dict.fromkeys(("finger.tendons.min_tension", "finger.tendons.max_tension"), "the controller keeps it"),
    },
)
_ON_AXIS = Consumer(
    "plant.guides under a body aside",
    {"finger.tip_body.center_of_mass": "a chain of guides takes a tip body only on its axis: expected 0 across it"},
    where=lambda s: s.finger.tip_body is not None and s.finger.tip_body.center_of_mass[0] != 0.0,
)


def _check(scene: Scene, parameters: Sequence[str]) -> None:
    """Refuse what a chain does not have."""
    for feature in (_GUIDES, _ON_AXIS):
        feature.check(scene)
    odd = [name for name in parameters if name not in OF_FINGER]
    if odd:
        raise InputError(f"a chain of guides has no run-time argument {odd[0]}", key="plant.guides")
