"""Motion of chains of guides: steps in C, which are implicit in bends, contacts, drives and sliding tendons."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np

from continuum_grasp.addons.chains.guides.plant import SharedChains
from continuum_grasp.base import Array
from continuum_grasp.closed_loop import Integration, PlantModel, SharedModel
from continuum_grasp.core import CodeKind, Compiler, CSource, Template


class ChainIntegration(Integration):
    """Integrates plants of ``plant.guides``: implicit in bends, contacts, drives and sliding tendons; see
    ``templates/chain.c``.
    """

    def __init__(self, model: PlantModel | SharedModel, method: str = "guides") -> None:
        self._chains = SharedChains(model.plants if isinstance(model, SharedModel) else [model])
        source = chain_source(self._chains)
        self._kind = CodeKind.of_source(source)
        quick = self._kind is CodeKind.QUICK
        self._run_steps = Compiler.load(source, "a plant of plant.guides", quick=quick).chain_steps
        self._run_steps.restype = ctypes.c_longlong

    def prepare(self, steps: float) -> CodeKind:
        """Return the kind of code, compiled already."""
        return self._kind

    def _steps(self, x: Array, u: Array, start: float, step: float, count: int) -> tuple[Array, int, str]:
        model = self._chains
        rows = np.ascontiguousarray(model.forces(start + np.arange(count + 1) * step))
        states = np.full((count + 1, model.nx), np.nan)
        states[0] = x
        numbers = np.concatenate([plant.chain.numbers(plant.p) for plant in model.chains])
        p = np.concatenate([plant.p[plant.finger_parameters :] for plant in model.plants])
        begin = ctypes.c_longlong(count), ctypes.c_double(step)
        done = self._run_steps(
            *begin, numbers.ctypes, u.ctypes, rows.ctypes, ctypes.c_longlong(model.nw), p.ctypes, states.ctypes
        )
        why = "the plant's step after t = {time} s has no solution: its loads or inputs change too fast"
        return states, int(done), why


def chain_source(model: SharedChains) -> str:
    """C of the motion of plants: what surrounds the chains, and their steps."""
    chains = [plant.chain for plant in model.chains]
    names = model.around.name_in()
    symbols = {name: ca.SX.sym(name, *model.around.size_in(name)) for name in names}
    places = ca.SX.sym("places", symbols["places"].numel())
    tension, x, u = symbols["tension"], symbols["others"], symbols["u"]
    force, rate = model.around(ca.reshape(places, symbols["places"].shape), *[symbols[name] for name in names[1:]])
    drum = model.drums(x, u)
    values = ca.vertcat(ca.vec(force), rate)
    slopes = ca.densify(ca.jacobian(values, ca.vertcat(places, tension, x)))
    drums = ca.Function("drums_of", [x, u], ca.cse([ca.densify(drum), ca.densify(ca.jacobian(drum, x))]))
    arguments = [places, *[symbols[name] for name in names[1:]]]
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
        "places": symbols["places"].size2(),
        "places_of": ", ".join(str(len(chain.places)) for chain in chains),
        "others": x.numel(),
        "nu": u.numel(),
        "nw": model.nw,
        "functions": "\n".join([CSource([drums, around]).of_core("chain"), *sizes]),
    }
    return Template.of("addons.chains", "chain.c").filled(words)
