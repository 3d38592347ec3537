"""Motion of chains of guides: compiled steps that are implicit in bends, contacts, drives and sliding tendons."""

from __future__ import annotations

import ctypes
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.closed_loop.chain_system import ChainSystem
from continuum_grasp.control.rti.source import load_library
from continuum_grasp.core.call import pointer
from continuum_grasp.core.source import filled, generated, template
from continuum_grasp.errors import NumericalError
from continuum_grasp.model.remade import Remade

Array = NDArray[np.float64]


class Guided(Protocol):
    """Plants of ``plant.guides``, one or several that touch one object, as what integrates them sees them.

    Their state is that of all: bends, their rates, tensions finger by finger, then the other states.
    """

    nx: int
    nw: int

    @property
    def chains(self) -> tuple[ChainSystem, ...]: ...
    @property
    def chain_numbers(self) -> Array: ...
    @property
    def around_p(self) -> Array: ...
    @property
    def drums(self) -> ca.Function: ...
    @property
    def around(self) -> ca.Function: ...
    def forces(self, t: ArrayLike) -> Array:
        """Forces (T, nw) at instants (T,) [s]."""


class ChainIntegration(Remade):
    """Integrates plants of ``plant.guides`` over periods of constant input; see ``templates/chain.c``.

    Raises a TypeError where the plant is no chain of guides.
    """

    compiled = True

    def __init__(self, model: Any) -> None:
        self._model: Guided = model
        library = load_library(chain_source(model), "a plant of plant.guides")
        self._steps = library.chain_steps
        self._steps.restype = ctypes.c_longlong

    def advance(self, x: Array, u: Array, start: float, period: float, substeps: int) -> Array:
        """Compute the states (substeps + 1, nx) at equal instants of a period [s], from x (nx) with constant u (nu).

        Where a step has no solution, ``NumericalError`` states when, and holds the states before.
        """
        model = self._model
        instants = start + np.arange(substeps + 1) * (period / substeps)
        rows = np.ascontiguousarray(model.forces(instants))
        states = np.full((substeps + 1, model.nx), np.nan)
        states[0] = x
        command, numbers = np.ascontiguousarray(u, dtype=float), model.chain_numbers
        p = np.ascontiguousarray(model.around_p)
        arrays = [pointer(each) for each in (numbers, command, rows)]
        done = int(
            self._steps(
                ctypes.c_longlong(substeps),
                ctypes.c_double(period / substeps),
                *arrays,
                ctypes.c_longlong(model.nw),
                pointer(p),
                pointer(states),
            )
        )
        if done < substeps:
            time, last = start + done * period / substeps, states[done]
            raise NumericalError(
                f"the plant's step after t = {time:g} s has no solution: its loads or inputs move it too fast",
                time=time,
                state=last,
                result=states[: done + 1],
            )
        return states


def chain_source(model: Guided) -> str:
    """C of the motion of plants: what surrounds the chains, and their steps."""
    chains, names = model.chains, model.around.name_in()
    given = {name: ca.SX.sym(name, *model.around.size_in(name)) for name in names}
    places = ca.SX.sym("places", given["places"].numel())
    tension, x, u = given["tension"], given["others"], given["u"]
    force, rate, *_ = model.around(ca.reshape(places, given["places"].shape), *[given[name] for name in names[1:]])
    drum, values = model.drums(x, u), ca.vertcat(ca.vec(force), rate)
    slopes = ca.densify(ca.jacobian(values, ca.vertcat(places, tension, x)))
    drums = ca.Function("drums_of", [x, u], ca.cse([ca.densify(drum), ca.densify(ca.jacobian(drum, x))]))
    arguments = [places, *[given[name] for name in names[1:]]]
    around = ca.Function("around", arguments, ca.cse([ca.densify(values), slopes]))
    sizes = []
    for name, function in (("drums", drums), ("around", around)):
        for what in ("arg", "res", "iw", "w"):
            sizes.append(f"#define {name}_SZ_{what.upper()} {max(getattr(function, f'sz_{what}')(), 1)}")
    words = {
        "fingers": len(chains),
        "hinges": chains[0].n,
        "tendons": tension.numel(),
        "tendons_of": ", ".join(str(len(chain.tendons)) for chain in chains),
        "places": given["places"].size2(),
        "places_of": ", ".join(str(len(chain.places)) for chain in chains),
        "others": x.numel(),
        "nu": u.numel(),
        "nw": model.nw,
        "functions": "\n".join([generated("chain", drums, around), *sizes]),
    }
    return filled(template("closed_loop", "chain.c"), words)
