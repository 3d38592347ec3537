"""A finger that touches nothing, wound up as its winches are measured: what its tendons would pull."""

from __future__ import annotations

import math
from functools import cached_property

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, NumericalError
from continuum_grasp.core import call, differentiated_step, solve, straight_function
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import ControlScene
from continuum_grasp.simulation import Friction, equilibrium_under, following, sample_shapes

_STABLE = 2.5
"""Greatest product of a Runge-Kutta step and the fastest rate [1]: 2.78 is where steps of order 4 become unstable."""


class FreeFinger:
    """The finger of a control scene without its surroundings, whose winches are where they are measured.

    Its state is s = [q, qd, friction states]. ``wound`` is what each winch has wound up, ``[length, rate]`` per winch
    [m, m/s], counted from where its drive is at zero. ``parameters`` of the model are arguments p; at ``places`` along
    the finger [m] a contact is considered.
    """

    def __init__(self, scene: ControlScene, parameters: tuple[str, ...], places: tuple[float, ...]) -> None:
        self.model = FingerModel(
            scene.finger.with_drives(following),
            family=scene.fidelity.family,
            elements=scene.fidelity.elements,
            bending_range=scene.fidelity.bending_range,
            accuracy=scene.fidelity.accuracy,
            gravity=scene.gravity,
            parameters=parameters,
            loads=[],
            tip_force=False,
        )
        self.places = places
        made = self.model.structure
        self.winches, self.n = made.winches, self.model.n
        self.friction_states = len(self.model.friction_names)
        self.size = 2 * self.n + self.friction_states
        self.nominal = np.array(self.model.p_nominal)

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
        sizes = {"s": self.size, "wound": 2 * len(self.winches), "p": self.model.np}
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    @property
    def _x(self) -> ca.SX:
        s, wound, _ = self._symbols.values()
        return ca.vertcat(s[: 2 * self.n], wound, s[2 * self.n :])

    @property
    def _lengths(self) -> ca.SX:
        return self._symbols["wound"][::2]

    @cached_property
    def rate(self) -> ca.Function:
        """``(s, wound, p) -> rate``: rate of the state."""
        n, x = self.n, self._x
        xd = self.model.forward_dynamics(x, self._lengths, ca.DM.zeros(self.model.nw), self._symbols["p"])
        indices = [*range(2 * n), *range(x.numel() - self.friction_states, x.numel())]
        return straight_function("free_rate", self._symbols, {"rate": xd[indices]})

    @cached_property
    def tension(self) -> ca.Function:
        """``(s, wound, p) -> tension, all``: what the tendons pull each winch with [N], on a pulley the difference; and
        the sum of their tensions.
        """
        outputs = {"tension": self._pulls(signed=True), "all": self._pulls(signed=False)}
        return straight_function("free_tension", self._symbols, outputs)

    def _pulls(self, *, signed: bool) -> ca.SX:
        tensions = self.model.tensions()(self._x, self._lengths, self._symbols["p"])[0]
        return ca.vertcat(
            *[
                sum(
                    ((side if signed else 1.0) * tensions[j] for side, j in zip(w.sides, w.tendons, strict=True)),
                    ca.SX(0.0),
                )
                for w in self.winches
            ]
        )

    @cached_property
    def gain(self) -> ca.Function:
        """``(s, wound, p) -> sliding, most``: tension per force across the finger at rest (winches, places) [1].

        The force is positive to the left of the finger, seen from the base to the tip. ``sliding`` is that of tendons
        that go on sliding. Those that stick stiffen the finger and feel more of the force, but no more than ``most``,
        which balances it at the base.
        """
        s, _, p = self._symbols.values()
        q, lengths, base = s[: self.n], self._lengths, self.model.position(s[: self.n], self._lengths, 0.0, p)
        across, levers = [], []
        for at in self.places:
            angle = self.model.orientation(q, lengths, at, p)
            normal = ca.vertcat(-ca.cos(angle), -ca.sin(angle))
            across.append(ca.mtimes(self.model.jacobian(q, lengths, at, p).T, normal))
            reach = self.model.position(q, lengths, at, p) - base
            levers.append(reach[0] * normal[1] - reach[1] * normal[0])
        history = [ca.vertcat(s[2 * self.n :], 0.0)] if self.friction_states else []
        stiffness = self.model.statics(q, lengths, ca.DM.zeros(self.model.nw), p, *history)[1]
        slope = ca.jacobian(self._pulls(signed=True), s)[:, : self.n]
        sliding = ca.mtimes(slope, solve(ca.densify(stiffness), ca.horzcat(*across)))
        tendons = self.model.structure.own_tendons
        arms = [tendons[winch.tendons[0]].arms[winch.tendons[0]] for winch in self.winches]
        greatest = ca.DM([-1.0 / arm for arm in arms]) @ ca.horzcat(*levers)
        outputs = {"sliding": ca.densify(sliding), "most": ca.densify(greatest)}
        return straight_function("free_gain", self._symbols, outputs)

    @cached_property
    def step(self) -> ca.Function:
        """``(s, wound, p, h) -> end``: one Runge-Kutta step, in which the winches have a constant rate."""
        symbols = self._symbols
        wound, p = symbols["wound"], symbols["p"]
        count = len(self.winches)
        moved = ca.SX.sym("moved", self.size + count)
        lengths, rates = moved[self.size :], wound[1::2]
        now = ca.vec(ca.horzcat(lengths, rates).T)
        both = {"moved": moved, "wound": wound, "p": p}
        rate = ca.vertcat(self.rate(moved[: self.size], now, p), rates)
        # Of its derivatives, which nothing here needs, the pattern alone is asked for.
        none = ca.SX(rate.numel(), rate.numel())
        slope = straight_function("free_slope", both, {"rate": rate, "jacobian": none})
        names = ["s", "wound", "p", "h"]
        s, y, parameters, h = (
            ca.MX.sym(n, v) for n, v in zip(names, (self.size, 2 * count, p.numel(), 1), strict=True)
        )
        begin = straight_function("free_begin", symbols, {"moved": ca.vertcat(symbols["s"], wound[::2])})
        end = straight_function("free_end", {"moved": moved}, {"end": moved[: self.size]})
        (start,) = call(begin, s, y, parameters)
        (reached,) = differentiated_step("rk4", "free", slope, start, (y, parameters), h, instants=0)
        return ca.Function("free_step", [s, y, parameters, h], call(end, reached), names, ["end"])

    def start(self, lengths: Array, friction: Friction) -> Array:
        """State at rest where the winches have wound up lengths [m]; ``friction`` says how it came there."""
        equilibrium = equilibrium_under(self.model, lengths, np.zeros(self.model.nw), **friction)
        return np.concatenate([equilibrium.q, np.zeros(self.n), equilibrium.friction_states])

    def substeps(self, members: Array, period: float) -> int:
        """Runge-Kutta steps in a period [s] that stay stable with each of the parameters (count, np) in all shapes, of
        tendons that slide and that stick.
        """
        symbols = list(self._symbols.values())
        jacobian = ca.Function("jacobian", symbols, [ca.jacobian(self.rate(*symbols), symbols[0])])
        fastest = 1.0 / self.model.structure.return_time if self.friction_states else 0.0
        # In tension as far as the tendons bear: elastic cables make a finger stiffer, and tensions as well.
        for shape in sample_shapes(self.model, np.zeros(self.n)):
            for states in (0.0, 1.0) if self.friction_states else (0.0,):
                friction = np.full(self.friction_states, states)
                s = np.concatenate([shape, np.zeros(self.n), friction])
                wound = np.zeros((len(self.winches), 2))
                wound[:, 0] = self._tight(shape, friction)
                for member in np.unique(members, axis=0):
                    matrix = np.array(jacobian(s, wound.ravel(), member))
                    if not np.all(np.isfinite(matrix)):
                        raise NumericalError("the linearized motion is not finite", state=shape)
                    fastest = max(fastest, float(np.abs(np.linalg.eigvals(matrix)).max()))
        return max(1, math.ceil(fastest / _STABLE * period))

    def _tight(self, shape: Array, friction: Array) -> list[float]:
        """Lengths [m] at which each winch holds a fifth of what its tendon bears."""
        pull = 0.2 * min(tendon.max_tension for tendon in self.model.finger.tendon_list)
        return self.model.drives_at(shape, np.zeros(self.model.nu), friction, pulled=pull)[::2]
