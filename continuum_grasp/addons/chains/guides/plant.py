"""Plants that are chains of guides, one or several that touch one object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import cast

import casadi as ca

from continuum_grasp.addons.chains.guides.system import ChainSystem
from continuum_grasp.base import Array
from continuum_grasp.closed_loop import PlantModel, SharedModel
from continuum_grasp.model import System


class ChainPlant(PlantModel):
    """A plant whose finger is a chain of guides.

    It has no state derivative, since what sticks at a guide is decided step by step.
    """

    INTEGRATION = "continuum_grasp.addons.chains.guides.integration:ChainIntegration"

    def _system(self) -> System:
        plant = self.control.plant
        varied = self.parameters, self.object_parameters
        return cast(System, ChainSystem(self._unlagged, cast(int, plant.guides), plant.axial_stiffness, *varied))

    @property
    def chain(self) -> ChainSystem:
        """The finger in its surroundings."""
        return cast(ChainSystem, cast(object, self.system))

    @property
    def first_other(self) -> int:
        """Index of the first state behind bends, their rates and tensions."""
        return self.chain.first_other

    @cached_property
    def tensions(self) -> ca.SX:
        """Tension of each tendon at its drive [N]."""
        return ca.SX(self.chain.tensions(*self._of_system))

    def friction_along(self, tendon: int, start: float, end: float) -> ca.SX:
        """Direction of friction on a tendon between two positions [m], on average: 1 where it slides to the base."""
        return self.chain.friction_along(self._x, self._u, tendon, start, end)

    @property
    def elements(self) -> System:
        raise TypeError("a chain of guides has no differential equation")

    def steps_for(self, period: float) -> tuple[str, int, float]:
        """Steps of a chain, whatever its rates."""
        # 10: step of a chain of guides, which is implicit, per that of methods that are so in part
        longest = 10.0 * self.system.finger_model.structure.partial_step
        return "guides", math.ceil(period / longest - 1e-9), 0.0

    @property
    def _bending_rate(self) -> ca.SX:
        # Angles are functions of the bends alone, which are the first n states.
        n = self.chain.n
        return ca.vertcat(self._x[n : 2 * n], ca.SX(self.nx - n, 1))

    def _begun(self, finger: Array, pose: list[float] | None) -> Array:
        x = self.chain.start(finger, self.rest_input)
        if pose is not None:
            x[self.system.object_states] = pose
        return x

    @property
    def _others(self) -> tuple[ca.SX, ca.SX]:
        """States of a chain beside bends and tensions: drive, object, contacts and lag; and the states of its
        system.
        """
        return self._x[self.first_other :], self._x[self.first_other : self.chain.nx]

    @cached_property
    def drums(self) -> ca.Function:
        """``(others, u) -> drum``: what each tendon of a chain has at its drive: a length [m], or a tension [N]."""
        others, chain_states = self._others
        value = ca.densify(self.chain.drums(chain_states, self.acting))
        return ca.Function("drums", [others, self._u], [value], ["others", "u"], ["drum"])

    @cached_property
    def around(self) -> ca.Function:
        """``(places, tension, others, u, w, p) -> rate, exerted, force``: rates of the other states with the lag, the
        force of the finger on the object, and forces on the places; parameters are without those for the finger.
        """
        chain, (others, chain_states) = self.chain, self._others
        places = ca.SX.sym("places", 6, len(chain.places))
        tension = ca.SX.sym("tension", len(chain.tendons))
        p = self._now[self.finger_parameters :]
        force, rate, *exerted = chain.around(places, tension, chain_states, self.acting, self._loads, p)
        names = ["places", "tension", "others", "u", "w", "p"]
        values = [ca.vertcat(rate, self._drive_rates), self._wrench(*exerted), force]
        inputs = [places, tension, others, self._u, self._w, self._p[self.finger_parameters :]]
        return ca.Function("around", inputs, values, names, ["rate", "exerted", "force"])


class SharedChains(SharedModel):
    """Plants that are chains of guides, as their integration takes them."""

    def __init__(self, plants: Sequence[PlantModel]) -> None:
        super().__init__(plants)
        self.chains = tuple(cast(ChainPlant, plant) for plant in plants)

    @cached_property
    def drums(self) -> ca.Function:
        """``(others, u) -> drum``: what each tendon has at its drive: a length [m], or a tension [N]."""
        return self._separate([plant.drums for plant in self.chains], ca.vertcat)

    @cached_property
    def around(self) -> ca.Function:
        """``(places, tension, others, u, w, p) -> force, rate``: forces and couples (3, K) on the places of all chains,
        and the rates of all other states.
        """
        functions = [plant.around for plant in self.chains]
        symbols, parts = self._arguments(functions)
        rate, outputs = self._rates(functions, parts, self._state_places["others"], "others")
        values = [ca.horzcat(*(force for *_, force in outputs)), rate]
        return ca.Function("around", [*symbols.values()], values, [*symbols], ["force", "rate"])

    @property
    def _state_places(self) -> dict[str, list[list[int]]]:
        before = sum(self._first)
        places = [(place[first:] - before).tolist() for place, first in zip(self._at, self._first, strict=True)]
        return super()._state_places | {"others": places}
