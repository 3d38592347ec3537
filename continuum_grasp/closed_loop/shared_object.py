"""Plants of several fingers that touch one object, as one system of equations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.closed_loop.chain_integration import ChainIntegration
from continuum_grasp.closed_loop.chain_system import ChainSystem
from continuum_grasp.closed_loop.plant import Integration, Plant
from continuum_grasp.closed_loop.plant_model import PlantModel

Array = NDArray[np.float64]

_WRENCH = ("object_force_x [N]", "object_force_y [N]", "object_moment [N m]")
_RISE = "object_z_rate [m/s]"


class SharedModel:
    """The plants of several fingers that touch one object that moves, as functions of a common state.

    Each plant describes its finger with the object, the supports and the table, as if the other fingers were not there.
    Here the object's motion is that of the first plant, on which the other fingers act with their contact forces, and
    so is the friction of supports and table; all else is each finger's own. State, input, forces and parameters are
    those of the plants one after the other, without what they share; the fingers' coordinates and their rates, of
    chains of guides also their tensions, come first, as integrators expect them.

    Parameters
    ----------
    plants : sequence of PlantModel
        With the same object, supports and table; their ``p`` and ``outside`` may be changed at any time.

    Attributes
    ----------
    nx, nu, nw : int
        Numbers of states, inputs and forces.
    """

    def __init__(self, plants: Sequence[PlantModel]) -> None:
        self.plants = tuple(plants)
        shared = [_shared(plant) for plant in plants]
        sizes = [plant.nx for plant in plants]
        bends = [np.arange(plant.system.n) for plant in plants]
        rates = [plant.system.n + np.arange(plant.system.n) for plant in plants]
        first = [_first_other(plant) for plant in plants]
        tensions = [np.arange(2 * plant.system.n, at) for plant, at in zip(plants, first, strict=True)]
        others = [
            np.setdiff1d(np.arange(begin, size), common)
            for begin, size, common in zip(first, sizes, shared, strict=True)
        ]
        at = [np.zeros(size, dtype=np.intp) for size in sizes]
        start = 0
        for group in (bends, rates, tensions, others):
            for place, own in zip(at, group, strict=True):
                place[own] = start + np.arange(own.size)
                start += own.size
        for place, common in zip(at, shared, strict=True):
            place[common] = start + np.arange(common.size)
        self._at, self._first = at, first
        self.nx = start + shared[0].size
        self.nu, self.nw = sum(plant.nu for plant in plants), sum(plant.nw for plant in plants)

    # -- the plants' states, and the common one -----------------------------------------------------------------------

    def joined(self, states: Sequence[Array]) -> Array:
        """The common state (..., nx) of the plants' states; of what they share, the first one's."""
        found: Array = np.empty((*np.shape(states[0])[:-1], self.nx))
        for place, own in reversed([*zip(self._at, states, strict=True)]):
            found[..., place] = own
        return found

    def parts(self, x: Array) -> list[Array]:
        """The state of each plant in common states (..., nx)."""
        return [x[..., place] for place in self._at]

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
        x, u, w, p = (ca.SX.sym(key, size) for key, size in self._sizes.items())
        given = self._split(x, u, w, p)
        xd = ca.SX(self.nx, 1)
        lead, (x0, u0, w0, p0) = self.plants[0], given[0]
        exerted = list[list[ca.SX]]()
        for plant, place, arguments in zip(self.plants[1:], self._at[1:], given[1:], strict=True):
            rate, *of_object = plant.touching_dynamics(*arguments)
            xd[place.tolist()] = rate
            exerted.append(of_object)
        known = p0[lead.system.np - len(lead.object_parameters) : lead.system.np]
        more, rise = self._exerted(exerted, x0[lead.system.object_states], known)
        own = lead.forward_dynamics(x0, u0, w0 + more, p0)
        if _RISE in lead.x_names:
            own[lead.x_names.index(_RISE)] += rise
        xd[self._at[0].tolist()] = own  # last: what is shared moves as the first plant says
        value = ca.cse([ca.densify(xd)])
        return ca.Function("forward_dynamics", [x, u, w, p], value, ["x", "u", "w", "p"], ["xd"])

    def _exerted(self, exerted: Sequence[Sequence[ca.SX]], pose: ca.SX, known: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Forces w on the first plant by what other fingers exert on its object, and its acceleration out of the plane.

        Each finger exerts forces (2, C) [N] at points (2, C) [m] and forces out of the plane (C) [N]; ``known`` are the
        object's parameters.
        """
        lead = self.plants[0]
        w, lifts, center = ca.SX(lead.nw, 1), ca.SX(0), _center_of_mass(lead, pose)
        for force, point, lift in exerted:
            arms = point - ca.repmat(center, 1, point.size2())
            moments = arms[0, :] * force[1, :] - arms[1, :] * force[0, :]
            for name, total in zip(_WRENCH, (*ca.vertsplit(ca.sum2(force)), ca.sum2(moments)), strict=True):
                w[lead.w_names.index(name)] += total
            lifts += ca.sum1(lift)
        names = lead.object_parameters
        mass = known[names.index("object_mass")] if "object_mass" in names else _body_mass(lead)
        return w, lifts / mass

    @cached_property
    def internal(self) -> ca.Function:
        """(x, u, p) -> mass matrix of the fingers, their stiffness and their damping, a block for each."""
        x, u, w, p = (ca.SX.sym(key, size) for key, size in self._sizes.items())
        blocks = [
            plant.internal(of[0], of[1], of[3]) for plant, of in zip(self.plants, self._split(x, u, w, p), strict=True)
        ]
        values = [ca.densify(ca.diagcat(*each)) for each in zip(*blocks, strict=True)]
        return ca.Function("internal", [x, u, p], ca.cse(values), ["x", "u", "p"], ["M", "K", "D"])

    @cached_property
    def integration(self) -> Integration | ChainIntegration:
        """What integrates it."""
        guided = isinstance(self.plants[0].system, ChainSystem)
        return ChainIntegration(self) if guided else Integration(self, "ros2")

    # -- chains of guides ---------------------------------------------------------------------------------------------

    @property
    def chains(self) -> tuple[ChainSystem, ...]:
        """The chain of each finger."""
        return tuple(plant.chain for plant in self.plants)

    @property
    def chain_numbers(self) -> Array:
        """What the C of their motion needs to know of the chains."""
        return np.concatenate([plant.chain_numbers for plant in self.plants])

    @property
    def around_p(self) -> Array:
        """Parameters of what surrounds the chains."""
        return np.concatenate([plant.around_p for plant in self.plants])

    @cached_property
    def drums(self) -> ca.Function:
        """``(others, u) -> drum``: what each tendon has at its drive: a length [m], or a tension [N]."""
        given = self._around_symbols(("others", "u"))
        parts = self._around_parts(given)
        values = [plant.drums(*own.values()) for plant, own in zip(self.plants, parts, strict=True)]
        return ca.Function("drums", [*given.values()], [ca.vertcat(*values)], [*given], ["drum"])

    @cached_property
    def around(self) -> ca.Function:
        """``(places, tension, others, u, w, p) -> force, rate``: forces and couples (3, K) on the places of all chains,
        and the rates of all other states.
        """
        given = self._around_symbols(("places", "tension", "others", "u", "w", "p"))
        parts, forces, exerted = self._around_parts(given), list[ca.SX](), list[list[ca.SX]]()
        rates = ca.SX(given["others"].numel(), 1)
        for plant, own, place in zip(self.plants[1:], parts[1:], self._others_at[1:], strict=True):
            force, rate, *of_object = plant.around(*own.values())
            rates[place] = rate
            forces.append(force)
            exerted.append(of_object)
        lead, first, first_own = self.plants[0], parts[0], self._first[0]
        pose = lead.system.object_states
        of_pose = first["others"][pose.start - first_own : pose.stop - first_own]
        more, rise = self._exerted(exerted, of_pose, first["p"])
        first["w"] += more
        force, rate, *_ = lead.around(*first.values())
        if _RISE in lead.x_names:
            rate[lead.x_names.index(_RISE) - first_own] += rise
        rates[self._others_at[0]] = rate  # last: what is shared moves as the first plant says
        values = [ca.horzcat(force, *forces), rates]
        return ca.Function("around", [*given.values()], values, [*given], ["force", "rate"])

    @property
    def _others_at(self) -> list[list[int]]:
        """Where the other states of each chain are among those of all."""
        before = sum(self._first)
        return [(place[first:] - before).tolist() for place, first in zip(self._at, self._first, strict=True)]

    def _around_symbols(self, names: Sequence[str]) -> dict[str, ca.SX]:
        """Arguments of what surrounds all chains."""
        places = sum(len(chain.places) for chain in self.chains)
        sizes = {"others": (self.nx - sum(self._first), 1), "places": (6, places), "u": (self.nu, 1)}
        sizes |= {"tension": (sum(len(chain.tendons) for chain in self.chains), 1), "w": (self.nw, 1)}
        sizes |= {"p": (self.around_p.size, 1)}
        return {name: ca.SX.sym(name, *sizes[name]) for name in names}

    def _around_parts(self, given: dict[str, ca.SX]) -> list[dict[str, ca.SX]]:
        """The same arguments for each chain alone."""
        found: list[dict[str, ca.SX]] = [{} for _ in self.plants]
        for name, whole in given.items():
            if name == "others":
                parts = [whole[place] for place in self._others_at]
            else:
                of = "size2_in" if name == "places" else "size1_in"
                ends = np.cumsum([0, *[getattr(plant.around, of)(name) for plant in self.plants]]).tolist()
                parts = (ca.horzsplit if name == "places" else ca.vertsplit)(whole, ends)
            for own, part in zip(found, parts, strict=True):
                own[name] = part
        return found

    @property
    def _sizes(self) -> dict[str, int]:
        return {"x": self.nx, "u": self.nu, "w": self.nw, "p": self.p.size}

    def _split(self, x: ca.SX, u: ca.SX, w: ca.SX, p: ca.SX) -> list[list[ca.SX]]:
        """State, input, forces and parameters of each plant."""
        found = [[x[place.tolist()]] for place in self._at]
        for whole, sizes in (
            (u, [plant.nu for plant in self.plants]),
            (w, [plant.nw for plant in self.plants]),
            (p, [plant.p.size for plant in self.plants]),
        ):
            ends = np.cumsum([0, *sizes]).tolist()
            for arguments, a, b in zip(found, ends, ends[1:], strict=False):
                arguments.append(whole[a:b])
        return found


def _first_other(plant: PlantModel) -> int:
    """Where the states behind the coordinates of a finger, their rates and the tensions of a chain begin."""
    return plant.system.first_other if isinstance(plant.system, ChainSystem) else 2 * plant.system.n


def _shared(plant: PlantModel) -> NDArray[np.intp]:
    """Where in a plant's state the object is, and the friction states of supports and table."""
    system = plant.system
    pose = system.object_states
    body = range(pose.start, 2 * pose.stop - pose.start)
    friction = range(body.stop, system.nx)
    common = [k for k in friction if not system.x_names[k].startswith("finger.")]
    return np.array([*body, *common], dtype=np.intp)


def _center_of_mass(plant: PlantModel, pose: ca.SX) -> ca.SX:
    """World position of the object's center of mass (2) [m]."""
    along, across = plant.scene.object.com if plant.scene.object is not None else (0.0, 0.0)
    c, s = ca.cos(pose[2]), ca.sin(pose[2])
    return pose[:2] + ca.vertcat(c * along - s * across, s * along + c * across)


def _body_mass(plant: PlantModel) -> float:
    if plant.scene.object is None:
        raise TypeError("fingers share an object")
    return plant.scene.object.mass


class SharedPlant:
    """Plants of several fingers that move together; of one finger, the plant alone.

    Parameters
    ----------
    plants : sequence of Plant
        At the same instant; each measures for itself.
    model : SharedModel, optional
        Their equations, where they exist already; not needed for one finger.
    """

    def __init__(self, plants: Sequence[Plant], model: SharedModel | None = None) -> None:
        self.plants = tuple(plants)
        several = len(self.plants) > 1
        self._model = SharedModel([plant.model for plant in plants]) if several and model is None else model

    @property
    def compiled(self) -> bool:
        """Whether the integrator is compiled."""
        return self.plants[0].compiled if self._model is None else self._model.integration.compiled

    def advance(self, commands: Sequence[ArrayLike]) -> list[Array]:
        """Apply the command (nu) of each finger for one period; return the states (substeps + 1, nx) of each.

        Raises
        ------
        InputError
            If a command has the wrong size or is not finite.
        NumericalError
            If the motion does not stay finite.
        """
        if self._model is None:
            return [self.plants[0].advance(commands[0])]
        known = [plant.checked(u) for plant, u in zip(self.plants, commands, strict=True)]
        states = self._moved([plant.x for plant in self.plants], known, self.plants[0].t)
        for plant, own, command in zip(self.plants, states, known, strict=True):
            plant.reach(own, command)
        return states

    def replayed(self, x: Sequence[Array], u: Sequence[Array], start: float) -> list[Array]:
        """Return the ends of a period from states x with steps half as long; the plants stay as they are."""
        if self._model is None:
            return [self.plants[0].replayed(x[0], u[0], start)]
        return [states[-1] for states in self._moved(x, u, start, finer=2)]

    def _moved(self, x: Sequence[Array], u: Sequence[Array], start: float, finer: int = 1) -> list[Array]:
        if self._model is None:
            raise TypeError("one finger moves alone")
        first, model = self.plants[0], self._model
        whole, steps = np.concatenate(u), finer * first.method.substeps
        return model.parts(model.integration.advance(model.joined(x), whole, start, first.period, steps))
