"""Friction states with which a grasp must hold, as further columns of errors.

At given tensions at the base, what a tendon with friction exerts depends on its history. By the capstan law the tension
may change across each friction cell by anything between exp(-friction turn) and exp(friction turn): a state z in
[-1, 1] per cell, +1 where the tendon on the -X side was pulled last. Dry friction in bending resists in each cell by
anything between -M and M per branch: a state z in [-1, 1] again, which is +1 where the cell was bent towards the left
last. The bending moment at every section falls with every z of the tendons before it and with that of its own cell, so
that fingers pulled all along and released all along give the least and the greatest moment everywhere. Forces of
contacts are no such sums: contacts at several places, or weight, make them grow with some z and fall with others. To
first order, in a posture that stays, the greatest reserve of the cones is the optimum of a linear problem with z on its
right-hand side, so concave: least at a vertex of the box, which need be neither of the two.

So a grasp is tried with both, of several fingers also with some pulled and others released, which push the object
aside; then with the vertex that the slope of its reserve points to, from there again; from the worst of these by
turning one cell at a time; and last with states drawn at random from the whole box.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.friction import pulled_states, state_cells
from continuum_grasp.grasp.robust.response import Responder, Response
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

OBJECT = 6
"""Columns of errors of the object, before the friction states."""
SAME = 1e-6
"""Reserve by which friction states must be worse than those known, per force reference: rounding is less."""


def extremes(scene: GraspScene, arrays: Mapping[str, Any]) -> Array:
    """States (S, K) of fingers that were pulled all along, and released, then of some pulled and others released;
    (1, 0) where none matter.
    """
    setups = [setup for setup in scene.setups if setup.name in scene.state_columns]
    if not setups:
        return np.zeros((1, 0))
    slid = [pulled_states(setup, FingerShape(setup, arrays)) for setup in setups]
    pulled = [np.where(own < 0.0, -1.0, 1.0) for own in slid]
    ways = [way for way in product((1.0, -1.0), repeat=len(setups)) if len(set(way)) > 1]
    alike = [(sign,) * len(setups) for sign in (1.0, -1.0)]
    return np.array([np.concatenate([w * own for w, own in zip(way, pulled, strict=True)]) for way in (*alike, *ways)])


def with_states(errors: Array, states: Array) -> Array:
    """Each error (E, 6) of the object with each of the states (S, K): (E S, 6 + K)."""
    return np.concatenate([np.repeat(errors, len(states), axis=0), np.tile(states, (len(errors), 1))], axis=1)


def with_drawn_states(scene: GraspScene, errors: Array) -> Array:
    """Each error (E, 6) with states drawn at random (E, 6 + K): a half of all, evenly, at the bounds."""
    size = max((columns.stop for columns in scene.state_columns.values()), default=0)
    states = np.random.default_rng(scene.solver.random_seed).uniform(-2.0, 2.0, (len(errors), size))
    return np.concatenate([errors, np.clip(states, -1.0, 1.0)], axis=1)


def worst_vertex(response: Response) -> Array:
    """An error with the states (6 + K,) at which the reserve is least, to first order; itself without slope."""
    error, attempt, solver = response.error.copy(), response.attempt, response.solver
    if not attempt.converged:
        return error
    # What is minimized is the reserve turned around.
    slope = np.asarray(solver.nlp.slope(attempt.x, attempt.numbers, 1.0, attempt.multipliers.constraints)).ravel()
    for name, columns in response.scene.state_columns.items():
        own = slope[solver.problem.numbers.at[f"{name}.friction_history"]][:-1]
        states = error[OBJECT:][columns]
        error[OBJECT:][columns] = np.where(own > 0.0, 1.0, np.where(own < 0.0, -1.0, states))
    return error


def descended(responder: Responder, responses: Sequence[Response]) -> Iterator[Response]:
    """From each response on to the friction states that lower its reserve, until none does; last from the worst of all
    by turning one cell at a time, since a concave function has several such vertices. All that were turned are given:
    the certificate asks for those beside the worst.
    """
    if not responder.scene.state_columns:
        return
    known = {response.error.tobytes() for response in responses}
    found = list(responses)

    def down(last: Response) -> Iterator[Response]:
        while (error := worst_vertex(last)).tobytes() not in known:
            known.add(error.tobytes())
            new = responder.to(error)
            found.append(new)
            yield new
            if new.reserve >= last.reserve:
                break
            last = new

    for response in responses:
        yield from down(response)
    cells = [np.append(np.zeros(OBJECT, dtype=bool), cell) for cell in state_cells(responder.scene)]
    while True:
        worst = min(found, key=lambda response: response.reserve)
        errors = [np.where(cell, -worst.error, worst.error) for cell in cells] if np.isfinite(worst.reserve) else []
        turned = [responder.to(error) for error in errors if error.tobytes() not in known]
        known |= {response.error.tobytes() for response in turned}
        found += turned
        yield from turned
        new = min(turned, key=lambda response: response.reserve, default=worst)
        if not new.reserve < worst.reserve - SAME:
            break
        yield from down(new)


def tried_states(scene: GraspScene, arrays: Mapping[str, Any], budget: Budget) -> list[Response]:
    """Responses of a grasp to the friction states of `extremes`, and to the worst ones from there."""
    responder = Responder(scene, arrays, budget)
    found = [responder.to(error) for error in with_states(np.zeros((1, OBJECT)), extremes(scene, arrays))]
    return found + list(descended(responder, found))


def with_postures(
    scene: GraspScene, arrays: Mapping[str, Array], responses: Sequence[Response], budget: Budget
) -> dict[str, Array]:
    """The arrays of a grasp, and of its postures with the friction states of its ``responses`` for the certificate to
    verify: arrays of a grasp with the states as first axis, ``held.`` before their names.

    Each contact has one row in all of them, those of the grasp before others; where one is clear, its name is empty and
    its numbers are NaN.
    """
    if not scene.state_columns:
        return dict(arrays)
    if scene.robust:  # whose responses are to errors of the object, too
        responses = tried_states(scene, arrays, budget)
    each = [response.arrays for response in responses]
    names = list(dict.fromkeys(str(name) for one in (arrays, *each) for name in one["contact_names"]))
    each = [_with_all(one, names) for one in each]
    same = {f"{name}.family" for name in scene.named_fingers}
    return {**arrays, **{f"held.{key}": np.stack([one[key] for one in each]) for key in each[0] if key not in same}}


def _with_all(arrays: Mapping[str, Array], names: Sequence[str]) -> dict[str, Array]:
    """The arrays of a posture with a place for each of these contacts."""
    own = [str(name) for name in arrays["contact_names"]]
    rows = [names.index(name) for name in own]
    found = dict(arrays)
    for key in ("contact_positions", "contact_normals", "contact_forces", "contact_stations"):
        found[key] = np.full((len(names), *arrays[key].shape[1:]), np.nan)
        found[key][rows] = arrays[key]
    found["contact_names"] = np.array([name if name in own else "" for name in names])
    found["contact_parts"] = np.zeros(len(names), dtype=int)
    found["contact_parts"][rows] = arrays["contact_parts"]
    return found
