"""Plants of several fingers that touch one object, as one system of equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import Array, named_value
from continuum_grasp.closed_loop.plant_model import PlantModel

_RISE = "object_z_rate [m/s]"


class SharedModel:
    """The plants of several fingers that touch one object that moves, as functions of a common state.

    Each plant describes its finger with the object, the supports and the table, as if the other fingers were not there.
    Here the object's motion, and the friction of supports and table, come from the first plant, on which the other
    fingers act with their contact forces; all else is each finger's own. State, input, forces and parameters are
    the plants' own, one after the other, without what they share; the fingers' coordinates and their rates, of
    chains of guides also their tensions, come first, as integrators expect them. One plant alone shares nothing.

    ``p`` and ``outside`` of the plants may be changed at any time.
    """

    def __init__(self, plants: Sequence[PlantModel]) -> None:
        self.plants = tuple(plants)
        self._integrations: dict[str, Any] = {}
        shared = [_shared(plant) if len(plants) > 1 else np.zeros(0, dtype=np.intp) for plant in plants]
        self._first = [plant.first_other for plant in plants]
        start = 0
        self._at = [np.zeros(plant.nx, dtype=np.intp) for plant in plants]
        ends = [
            (0, plant.system.n, 2 * plant.system.n, at, plant.nx) for plant, at in zip(plants, self._first, strict=True)
        ]
        for k in range(4):  # bends, rates, tensions, and what else is each finger's own
            for place, end, common in zip(self._at, ends, shared, strict=True):
                separate = np.setdiff1d(np.arange(end[k], end[k + 1]), common)
                place[separate] = start + np.arange(separate.size)
                start += separate.size
        for place, common in zip(self._at, shared, strict=True):
            place[common] = start + np.arange(common.size)
        self.nx = start + shared[0].size
        self.nu = sum(plant.nu for plant in plants)
        self.nw = sum(plant.nw for plant in plants)

    # -- the plants' states, and the common one -----------------------------------------------------------------------

    def joined(self, states: Sequence[Array]) -> Array:
        """Return the common state (..., nx) from the plants' states; shared parts come from the first plant."""
        joined: Array = np.empty((*np.shape(states[0])[:-1], self.nx))
        for place, state in reversed([*zip(self._at, states, strict=True)]):
            joined[..., place] = state
        return joined

    def parts(self, x: Array) -> list[Array]:
        """The state of each plant in common states (..., nx)."""
        return [x[..., place] for place in self._at]

    def integration(self, method: str) -> Any:
        """The integrator of the plants by a method, made once."""
        if method not in self._integrations:
            self._integrations[method] = named_value(self.plants[0].INTEGRATION)(self, method)
        return self._integrations[method]

    # -- what integrators need ----------------------------------------------------------------------------------------

    @property
    def p(self) -> Array:
        """Parameters of all plants."""
        return np.concatenate([plant.p for plant in self.plants])

    def forces(self, t: ArrayLike) -> Array:
        """Forces (T, nw) at instants (T,) [s]."""
        return np.hstack([plant.forces(t) for plant in self.plants])

    @property
    def steady(self) -> bool:
        """Whether no load varies."""
        return all(plant.steady for plant in self.plants)

    @cached_property
    def forward_dynamics(self) -> ca.Function:
        """(x, u, w, p) -> rates of the common state."""
        lead, *others = self.plants
        functions = [lead.forward_dynamics, *(plant.touching_dynamics for plant in others)]
        return self._common("forward_dynamics", functions, "xd")

    def implicit(self) -> ca.Function:
        """``(x, u, w, p, part) -> k``, as `System.implicit` for each finger; the object moves as pushed."""
        lead, *others = self.plants
        return self._common("implicit", [lead.implicit(), *(plant.implicit(touching=True) for plant in others)], "k")

    def _common(self, name: str, functions: Sequence[ca.Function], output: str) -> ca.Function:
        symbols, parts = self._arguments(functions)
        rate, _ = self._rates(functions, parts, [place.tolist() for place in self._at], "x")
        return ca.Function(name, [*symbols.values()], ca.cse([ca.densify(rate)]), [*symbols], [output])

    @cached_property
    def internal(self) -> ca.Function:
        """(x, u, p) -> mass matrix of the fingers, their stiffness and their damping, a block for each."""
        return self._separate([plant.internal for plant in self.plants], ca.diagcat)

    # -- all plants together ------------------------------------------------------------------------------------------

    @property
    def _state_places(self) -> dict[str, list[list[int]]]:
        """Places of each plant's states in the common state, by the names of inputs of the plants' functions."""
        return {"x": [place.tolist() for place in self._at]}

    def _arguments(self, functions: Sequence[ca.Function]) -> tuple[dict[str, ca.SX], list[dict[str, ca.SX]]]:
        """Symbols of a function of all plants by the names of the plants' ``functions``, and the symbols of each."""
        symbols = dict[str, ca.SX]()
        parts = list[dict[str, ca.SX]]([{} for _ in functions])
        states = self._state_places
        for name in functions[0].name_in():
            sizes = [function.size_in(name) for function in functions]
            if name in states:
                symbols[name] = ca.SX.sym(name, _size(states[name]))
                pieces = [symbols[name][places] for places in states[name]]
            elif name == "part":  # one step for all
                symbols[name] = ca.SX.sym(name)
                pieces = [symbols[name]] * len(functions)
            else:  # side by side or one below the other
                axis = int(name == "places")
                ends = np.cumsum([0, *(size[axis] for size in sizes)]).tolist()
                symbols[name] = ca.SX.sym(name, *((sizes[0][0], ends[-1]) if axis else (ends[-1], 1)))
                pieces = (ca.horzsplit if axis else ca.vertsplit)(symbols[name], ends)
            for part, value in zip(parts, pieces, strict=True):
                part[name] = value
        return symbols, parts

    def _separate(self, functions: Sequence[ca.Function], joined: Callable[..., ca.SX]) -> ca.Function:
        """Functions of the plants that share nothing, as one whose outputs are theirs, joined."""
        symbols, parts = self._arguments(functions)
        outputs = [function.call([*part.values()]) for function, part in zip(functions, parts, strict=True)]
        values = [ca.densify(joined(*each)) for each in zip(*outputs, strict=True)]
        of = functions[0]
        return ca.Function(of.name(), [*symbols.values()], ca.cse(values), [*symbols], of.name_out())

    def _rates(
        self, functions: Sequence[ca.Function], parts: Sequence[dict[str, ca.SX]], at: list[list[int]], states: str
    ) -> tuple[ca.SX, list[list[ca.SX]]]:
        """Rates of common states, each plant's ``at`` some places, and the other results of the plants' functions.

        The functions give the rates of a plant's ``states``, of other plants than the first then what it exerts on the
        object: force [N], moment about its center of mass [N m] and force out of the plane [N].
        """
        rates = ca.SX(_size(at), 1)
        outputs = list[list[ca.SX]]()
        exerted = ca.SX(4, 1)
        for function, part, places in zip(functions[1:], parts[1:], at[1:], strict=True):
            rate, wrench, *rest = function.call([*part.values()])
            rates[places], exerted = rate, exerted + wrench
            outputs.append(rest)
        lead = self.plants[0]
        first = parts[0]
        more = ca.SX(self.plants[0].nw, 1)
        for name, total in zip(PlantModel.WRENCH, ca.vertsplit(exerted), strict=False):
            if outputs:
                more[lead.w_names.index(name)] = total
        rate, *of_lead = functions[0].call([*(first | {"w": first["w"] + more}).values()])
        if outputs and _RISE in lead.x_names:
            before, known = (0, lead.finger_parameters) if states == "x" else (self._first[0], 0)
            mass = first["p"][known + lead.object_parameters.index("object_mass")]
            rate[lead.x_names.index(_RISE) - before] += exerted[3] / mass
        rates[at[0]] = rate  # last: the shared object moves as the first plant says
        return rates, [of_lead, *outputs]


def _size(at: list[list[int]]) -> int:
    """Number of common states that each plant has at some places."""
    return 1 + max((k for places in at for k in places), default=-1)


def _shared(plant: PlantModel) -> NDArray[np.intp]:
    """Places in a plant's state of the object, and of the friction states of supports and table."""
    system = plant.system
    pose = system.object_states
    body = range(pose.start, 2 * pose.stop - pose.start)
    friction = range(body.stop, system.nx)
    common = [k for k in friction if not system.x_names[k].startswith("finger.")]
    return np.array([*body, *common], dtype=np.intp)
