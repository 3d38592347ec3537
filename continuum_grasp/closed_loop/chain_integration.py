"""Motion of a chain of guides: compiled steps that are implicit in bends, contacts, drives and sliding tendons."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.chain_system import ChainSystem
from continuum_grasp.control.rti.source import load_library
from continuum_grasp.core.call import pointer
from continuum_grasp.core.source import filled, generated, template
from continuum_grasp.errors import NumericalError
from continuum_grasp.model.remade import Remade

if TYPE_CHECKING:
    from continuum_grasp.closed_loop.plant_model import PlantModel

Array = NDArray[np.float64]


class ChainIntegration(Remade):
    """Integrates a plant of ``plant.guides`` over periods of constant input; see ``templates/chain.c``."""

    compiled = True

    def __init__(self, model: PlantModel) -> None:
        if not isinstance(model.system, ChainSystem):
            raise TypeError("the plant is no chain of guides")
        self._model, self._system = model, model.system
        library = load_library(chain_source(model, model.system), "a plant of plant.guides")
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
        command, numbers = np.ascontiguousarray(u, dtype=float), self._system.numbers(model.p)
        p = np.ascontiguousarray(model.p[model.finger_parameters :])
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


def chain_source(model: PlantModel, system: ChainSystem) -> str:
    """C of the motion of a plant: what surrounds the chain, and its steps."""
    x, u, w = model.others, model.command, ca.SX.sym("w", model.nw)
    places = ca.SX.sym("places", 6 * len(system.places))
    tension = ca.SX.sym("tension", len(system.tendons))
    p = ca.SX.sym("p", system.np - model.finger_parameters)
    own = x[: system.nx - system.first_other]
    drum = system.drums(own, model.acting)
    motion = ca.reshape(places, 6, len(system.places))
    force, rate = system.around(motion, tension, own, model.acting, w, p)
    values = ca.vertcat(ca.vec(force), rate, model.drive_rates)
    slopes = ca.densify(ca.jacobian(values, ca.vertcat(places, tension, x)))
    drums = ca.Function("drums_of", [x, u], ca.cse([ca.densify(drum), ca.densify(ca.jacobian(drum, x))]))
    around = ca.Function("around", [places, tension, x, u, w, p], ca.cse([ca.densify(values), slopes]))
    sizes = []
    for name, function in (("drums", drums), ("around", around)):
        for what in ("arg", "res", "iw", "w"):
            sizes.append(f"#define {name}_SZ_{what.upper()} {max(getattr(function, f'sz_{what}')(), 1)}")
    words = {
        "hinges": system.n,
        "tendons": len(system.tendons),
        "places": len(system.places),
        "others": x.numel(),
        "nu": model.nu,
        "nw": model.nw,
        "functions": "\n".join([generated("chain", drums, around), *sizes]),
    }
    return filled(template("closed_loop", "chain.c"), words)
