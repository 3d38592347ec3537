"""A stage of an exact rod in the plane: from its state at one place to its state at another, for multiple shooting.

The rod is inextensible and unshearable (S. S. Antman, Nonlinear Problems of Elasticity, 2005, chapter 4). Its tangent
at the angle a is (-sin a, cos a), and along it

    x' = -sin a,  y' = cos a,  a' = kappa,  M' = sin a F_y + cos a F_x,  F(s) = G - gravity mass(s),

with the moment M and the force F of what acts beyond s. G is the force with the weight of everything from the base to
s added: it is constant between contacts, whatever masses lie there. Curvature and the states of tendons are those of a
``SectionForm``; units are those of the finger (``Section``), gravity is in m/s^2.

A rod in space (place, quaternion, moment) is another function of the same form.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca

from continuum_grasp.model.planar import Scalar, column
from continuum_grasp.model.section_form import SectionForm, SectionPlace, scalars

SUBSTEPS = 4
"""Steps of the classical Runge-Kutta method in a stage [1]: with 24 stages per finger, 96 % of 55 hard grasps were
within 0.3 % of the tension with 96 stages; with one step 73 %."""
PLANE = ("x", "y", "angle", "moment")
"""States of a rod in the plane, before those of its tendons."""


def plane_states(form: SectionForm) -> tuple[str, ...]:
    """Names of the states of a rod in the plane."""
    return (*PLANE, *form.sliding_names)


def plane_rates(
    form: SectionForm, place: SectionPlace, state: Any, force: Any, pulls: Any, gravity: Any, history: Any, numbers: Any
) -> list[Scalar]:
    """Derivatives of the states along the rod, at a place.

    Parameters
    ----------
    form, place, numbers
        The section, its values at the place, and the numbers (m,) of the piece.
    state
        x, y, angle [rad], moment, and the states of the tendons.
    force
        G (2,): force of what acts beyond the place, with the weight of everything before it.
    pulls
        Moments of tensions and pressures above the least ones.
    gravity
        Gravity [m/s2], shape (2,).
    history
        h and the friction states z.
    """
    (_, _, angle, moment), sliding = scalars(state)[:4], scalars(state)[4:]
    forces = zip(scalars(force), scalars(gravity), strict=True)
    fx, fy = (f - g * place.mass for f, g in forces)
    bend = form.bent(place, form.load(place, moment, pulls, sliding, numbers), numbers, history)
    sine, cosine = ca.sin(angle), ca.cos(angle)
    planar = [-sine, cosine, place.rest + bend, sine * fy + cosine * fx]
    return [*planar, *form.sliding_rates(place, bend, sliding, numbers, history)]


@lru_cache(maxsize=256)
def plane_stage(form: SectionForm, substeps: int = SUBSTEPS) -> ca.Function:
    """Make the function of a stage in the plane, on one piece of a finger.

    Parameters
    ----------
    form
        The form of the section.
    substeps
        Steps of the method of Runge and Kutta.

    Returns
    -------
    casadi.Function
        Of SX, with the inputs below and the output ``after``, the states at ``end``:

        | name    | symbol | shape | unit    | what                                                            |
        |---------|--------|-------|---------|-----------------------------------------------------------------|
        | state   | q      | n     | L, rad, B0 / L | states at ``begin`` (`plane_states`)                     |
        | force   | G      | 2     | B0 / L^2 | force of what acts beyond, with the weight of all before it     |
        | pulls   | p      | k     | B0 / L  | moments of the pulls above the least ones                        |
        | begin, end | s   | 1     | L       | places from base to tip                                          |
        | couple  |        | 1     | B0 / L  | added to the moment at ``begin``, as friction at a contact does  |
        | gravity | g      | 2     | m/s^2   | gravity in the axes of x and y                                   |
        | history | h, z   |       | 1       | how the friction states came about (`SectionForm.history_names`) |
        | numbers |        | m     |         | of the piece (`Section.numbers`)                                 |
    """
    names = plane_states(form)
    inputs = {
        "state": ca.SX.sym("state", len(names)),
        "force": ca.SX.sym("force", 2),
        "pulls": ca.SX.sym("pulls", len(form.pulls)),
        "begin": ca.SX.sym("begin"),
        "end": ca.SX.sym("end"),
        "couple": ca.SX.sym("couple"),
        "gravity": ca.SX.sym("gravity", 2),
        "history": ca.SX.sym("history", len(form.history_names)),
        "numbers": ca.SX.sym("numbers", form.size),
    }
    begin, end, numbers = inputs["begin"], inputs["end"], inputs["numbers"]
    acting = {name: inputs[name] for name in ("force", "pulls", "gravity", "history", "numbers")}

    def rates(place: SectionPlace, state: Sequence[Scalar]) -> list[Scalar]:
        return plane_rates(form, place, state, **acting)

    step = (end - begin) / substeps
    state = scalars(inputs["state"])
    state[3] = state[3] + inputs["couple"]
    before = form.at(begin, numbers)
    for k in range(substeps):
        middle, after = (form.at(begin + (k + share) * step, numbers) for share in (0.5, 1.0))
        first = rates(before, state)
        second = rates(middle, _moved(state, first, 0.5 * step))
        third = rates(middle, _moved(state, second, 0.5 * step))
        fourth = rates(after, _moved(state, third, step))
        slopes = [(a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(first, second, third, fourth, strict=True)]
        state, before = _moved(state, slopes, step), after
    return ca.Function(f"plane_stage_{form.key}", list(inputs.values()), [column(state)], list(inputs), ["after"])


def _moved(state: Sequence[Scalar], rates: Sequence[Scalar], step: Scalar) -> list[Scalar]:
    return [value + step * rate for value, rate in zip(state, rates, strict=True)]
