"""Plants of several fingers that touch one object, as one system of equations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.closed_loop.chain_system import ChainSystem
from continuum_grasp.closed_loop.plant import Integration, Plant
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.errors import InputError
from continuum_grasp.model import System

Array = NDArray[np.float64]

_WRENCH = ("object_force_x [N]", "object_force_y [N]", "object_moment [N m]")


class SharedModel:
    """The plants of several fingers that touch one object that moves, as functions of a common state.

    Each plant describes its finger with the object, the supports and the table, as if the other fingers were not there.
    Here the object's motion is that of the first plant, on which the other fingers act with their contact forces, and
    so is the friction of supports and table; all else is each finger's own. State, input, forces and parameters are
    those of the plants one after the other, without what they share; the fingers' coordinates and their rates come
    first, as integrators expect them.

    Parameters
    ----------
    plants : sequence of PlantModel
        With the same object, supports and table; their ``p`` and ``outside`` may be changed at any time.

    Attributes
    ----------
    nx, nu, nw : int
        Numbers of states, inputs and forces.

    Raises
    ------
    InputError
        A finger is a chain of guides, whose motion is decided step by step.
    """

    def __init__(self, plants: Sequence[PlantModel]) -> None:
        self.plants = tuple(plants)
        if any(isinstance(plant.system, ChainSystem) for plant in plants):
            raise InputError("chains of guides are for one finger", key="plant.guides")
        shared = [_shared(plant) for plant in plants]
        sizes = [plant.nx for plant in plants]
        bends = [np.arange(plant.system.n) for plant in plants]
        rates = [plant.system.n + np.arange(plant.system.n) for plant in plants]
        others = [
            np.setdiff1d(np.arange(size), [*q, *qd, *common])
            for size, q, qd, common in zip(sizes, bends, rates, shared, strict=True)
        ]
        at = [np.zeros(size, dtype=np.intp) for size in sizes]
        start = 0
        for group in (bends, rates, others):
            for place, own in zip(at, group, strict=True):
                place[own] = start + np.arange(own.size)
                start += own.size
        for place, common in zip(at, shared, strict=True):
            place[common] = start + np.arange(common.size)
        self._at = at
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
        center, wrench, lifts = _center_of_mass(lead, x0), ca.SX(3, 1), ca.SX(0)
        for plant, place, arguments in zip(self.plants[1:], self._at[1:], given[1:], strict=True):
            rate, force, point, lift = plant.touching_dynamics(*arguments)
            xd[place.tolist()] = rate
            arms = point - ca.repmat(center, 1, point.size2())
            moments = arms[0, :] * force[1, :] - arms[1, :] * force[0, :]
            wrench += ca.vertcat(ca.sum2(force), ca.sum2(moments))
            lifts += ca.sum1(lift)
        for k, name in enumerate(_WRENCH):
            w0[lead.w_names.index(name)] += wrench[k]
        own = lead.forward_dynamics(x0, u0, w0, p0)
        if "object_z_rate [m/s]" in lead.x_names:
            names = _system(lead).p_names
            mass = p0[names.index("object_mass [kg]")] if "object_mass [kg]" in names else _body_mass(lead)
            own[lead.x_names.index("object_z_rate [m/s]")] += lifts / mass
        xd[self._at[0].tolist()] = own  # last: what is shared moves as the first plant says
        value = ca.cse([ca.densify(xd)])
        return ca.Function("forward_dynamics", [x, u, w, p], value, ["x", "u", "w", "p"], ["xd"])

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
    def integration(self) -> Integration:
        """What integrates it."""
        return Integration(self, "ros2")

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


def _system(plant: PlantModel) -> System:
    if isinstance(plant.system, ChainSystem):
        raise TypeError("a chain of guides has no differential equation")
    return plant.system


def _shared(plant: PlantModel) -> NDArray[np.intp]:
    """Where in a plant's state the object is, and the friction states of supports and table."""
    system = _system(plant)
    pose = system.object_states
    body = range(pose.start, 2 * pose.stop - pose.start)
    friction = range(body.stop, system.nx)
    common = [k for k in friction if not system.x_names[k].startswith("finger.")]
    return np.array([*body, *common], dtype=np.intp)


def _center_of_mass(plant: PlantModel, x: ca.SX) -> ca.SX:
    """World position of the object's center of mass (2) [m]."""
    pose = x[plant.system.object_states]
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
