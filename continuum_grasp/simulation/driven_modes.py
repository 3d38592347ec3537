"""Small motions of a finger that has friction, or whose tendons are wound up.

Three limits, between which a motion is: friction acts as it does and the drives are held; all sticks, so that branches
of dry friction add their stiffness, and tendons that are wound up elongate locally with the finger's bend and add
E A e^2; the drives are free to turn, with their inertia. Dry friction of motors is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.model.laws.section import STATEFUL
from continuum_grasp.model.memory import state_of
from continuum_grasp.model.winches import compliance
from continuum_grasp.scene.profile import nodes_of
from continuum_grasp.simulation.slack import SLACK
from continuum_grasp.simulation.spectrum import damping_matrix
from continuum_grasp.simulation.static_shape import Equilibrium

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SmallMotions:
    """Mass, stiffness and damping of the bending coordinates; and these where all sticks, and where drives turn.

    ``stuck`` (n, n) is a stiffness; None where nothing has friction, or what it is stiff by is not known, as that of
    tendons whose tension is commanded.
    ``free`` is None where drives do not turn.
    """

    mass: Array
    stiffness: Array
    damping: Array
    stuck: Array | None = None
    free: tuple[Array, Array] | None = None


def small_motions(found: Equilibrium) -> SmallMotions:
    """Small motions about an equilibrium."""
    model, q, u, w, p = found.model, found.q, found.u, found.w, found.p
    core, n = Core(model, compiled=False), model.n
    mass, damping = core.mass_matrix(q, u, p), damping_matrix(core, q, u, p)
    friction = found.friction_states
    if not model.structure.winches:
        # Friction acts as it does at rest.
        history = (np.append(friction, 0.0),) if friction.size else ()
        held = core.statics(q, u, w, p, *history)[1]
        return SmallMotions(mass, held, damping, held + _held(model, p) if model.structure.has_law(*STATEFUL) else None)
    of_tendons = model.structure.tendon_friction_states
    states = state_of(friction[:of_tendons]), friction[of_tendons:]
    x = np.concatenate([q, np.zeros(n), model.drives_at(q, u, friction), *states])
    stiffness, _, inertia, passive = (np.array(value) for value in model.stiffness_of_drives()(x, u, w, p))
    free = None
    if inertia.size:
        both = np.zeros_like(stiffness)
        both[:n, :n], both[n:, n:] = mass, np.diag(inertia.ravel())
        free = both, stiffness
    slides = model.friction_names or model.structure.has_law(*STATEFUL)
    stuck = passive + _glued(model, found, x) + _held(model, p) if slides else None
    return SmallMotions(mass, stiffness[:n, :n], damping, stuck, free)


def _glued(model: FingerModel, found: Equilibrium, x: Array) -> Array:
    """Stiffness of taut tendons: of those with friction as if they were glued to the finger all along."""
    made, total = model.structure, np.zeros((model.n, model.n))
    tensions = np.array(model.tensions()(x, found.u, found.p)[0]).ravel()
    frictional = {tendon for cells in made.cell_sets for tendon in cells.tendons}
    for k, (tendon, tension) in enumerate(zip(model.finger.tendon_list, tensions, strict=True)):
        if tension < SLACK or tendon.axial_stiffness is None:
            continue
        shape, arm = made.own_tendons[k].shape, made.own_tendons[k].arms[k]
        drawn = np.zeros(model.n)
        for element in range(len(made.lengths)):
            local = list(made.family.local(element))
            for s, weights in nodes_of(made.mesh.panels(element, shape, made.mesh.stiffness)):
                bent = arm * shape(s) * made.family.shapes_at(element, s)[:-1]
                drawn[local] += bent @ weights
                if k in frictional:
                    total[np.ix_(local, local)] += tendon.axial_stiffness * (bent * weights) @ bent.T
        if k not in frictional:
            total += np.outer(drawn, drawn) / compliance(tendon, made.length)
    return total


def _held(model: FingerModel, p: Array) -> Array:
    """Stiffness that laws of the sections add while nothing slides or relaxes."""
    made, total = model.structure, np.zeros((model.n, model.n))
    for law in made.laws:
        held = float(ca.Function("held", [made.parameters.symbol], [ca.SX(law.held)])(p))
        for port in law.ports if held else ():
            local, shapes = list(made.family.local(port.element)), np.array(port.shapes, dtype=float)
            total[np.ix_(local, local)] += held * port.measure * np.outer(shapes, shapes)
    return total
