"""Cost terms: how each is named and computed, and where its setpoint comes from.

A term is a row of ``TERMS``, with its weight and its setpoint declared in ``scene/cost.py``. Stage functions, setpoints
and their ranges, readings of a plant, metrics, plots and the exported C follow from these two.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.quantities import Quantities
from continuum_grasp.scene import Cost, Finger, Reach

Limits = tuple[tuple[float, float], ...]

UNLIMITED = 1e6
"""Magnitude beyond which a number without any other limit is a mistake: far above every SI value of a finger, and far
below what overflows when squared in single precision (1e19)."""
REACH = 10.0
"""Greatest distance from the base of a position setpoint, and of an object that a camera shows, in finger lengths [1]:
a setpoint out of reach is allowed (the cost then points the finger at it, and the call reports it), one in millimeters
(1000 lengths) is not."""
_TURNS = 10.0
"""Greatest angle setpoint relative to the base, in turns [1]: a finger curls up a few times at most, and an angle in
degrees is beyond."""


class Residual(NamedTuple):
    """A term of the cost: half the weighted squares of an expression's distance from its setpoint.

    ``weight`` counts per second of the horizon, ``final`` once at its end (None: no final weight); each is one number,
    or one per entry. ``names`` belong to the entries, by default numbered ones.
    """

    value: Any
    weight: Any
    final: Any = None
    names: tuple[str, ...] = ()


def _near_base(finger: Finger) -> Limits:
    reach = REACH * finger.rod.length
    x, y = ((base - reach, base + reach) for base in finger.base.position)
    return x, y


def _turned(finger: Finger) -> Limits:
    turn = 2.0 * math.pi * _TURNS
    return ((finger.base.angle - turn, finger.base.angle + turn),)


def _elements(cost: Cost, model: Prediction) -> tuple[str, ...]:
    return tuple(str(k + 1) for k in range(len(model.system.finger_model.lengths)))


def _shape_at(cost: Cost) -> tuple[float, ...]:
    return () if cost.shape is None else cost.shape.at


def _rates(cost: Cost, model: Prediction) -> tuple[str, ...]:
    return tuple(f"{n.split(' ')[0]}_rate [{n.split('[')[1][:-1]}/s]" for n in model.u_names)


def _one(cost: Cost, model: Prediction) -> tuple[str, ...]:
    return ("",)


@dataclass(frozen=True)
class CostTerm:
    """Half the weighted squared distances of some entries from their setpoints."""

    key: str  # of its weight in ``controller.cost``, a ``Weight`` or for terms of the input a number
    entry: str  # name and unit: ``{place}`` stands for one of ``places``, ``{axis}`` for x and y of a point
    value: Callable[[Quantities, Cost], Any]  # expression of all entries
    places: Callable[[Cost, Prediction], Sequence[str]] = _one  # numbers of elements, names of contacts
    reference: str = ""  # name of the setpoint, always zero where empty
    limits: Callable[[Finger], Limits] = lambda finger: ((-UNLIMITED, UNLIMITED),)  # of the setpoint, per axis
    of_state: bool = True  # whether it depends on the state alone, so that the end of the horizon has it too

    @property
    def label(self) -> str:
        """Common name of the entries."""
        return re.split(r"_?\{| \[", self.entry)[0].replace("_", " ")

    @property
    def of_points(self) -> bool:
        """Whether entries are x, y of points."""
        return "{axis}" in self.entry

    def names(self, cost: Cost, model: Prediction) -> tuple[str, ...]:
        """Name and unit of each entry."""
        axes = "xy" if self.of_points else " "
        return tuple(self.entry.format(place=p, axis=a) for p in self.places(cost, model) for a in axes)

    def ranges(self, cost: Cost, model: Prediction) -> Array:
        """Least and greatest setpoint of each entry (size, 2)."""
        pairs = self.limits(model.scene.finger)
        return np.tile(np.array(pairs), (len(self.names(cost, model)) // len(pairs), 1))

    def entries_in_reach(self, reach: Reach, cost: Cost, model: Prediction) -> Array:
        """Return the limits (size, 3) of possible values: least, most, and for the x of a point its circle's radius."""
        entries = np.array(reach.entries(self.reference, len(self.names(cost, model))), dtype=float)
        return np.asarray(np.clip(entries, -UNLIMITED, UNLIMITED))

    def owns(self, name: str) -> bool:
        """Whether an entry of a run or a package, by name and unit, is one of this term."""
        # Names of contacts contain dots, but nothing that stands for a place contains a space.
        pattern = re.escape(self.entry).replace(r"\{axis\}", "[xy]").replace(r"\{place\}", "[^ ]+")
        return re.fullmatch(pattern, name) is not None

    def weights(self, cost: Cost) -> tuple[float, float | None]:
        """Running and terminal weight; None: no weight at the end of the horizon."""
        return cost.weights(self.key)


TERMS: tuple[CostTerm, ...] = (
    CostTerm("tip", "tip_{axis} [m]", lambda q, _: q.tip(), reference="tip", limits=_near_base),
    CostTerm("bending", "bending_{place} [rad]", lambda q, _: q.bending(), _elements, "bending"),
    CostTerm(
        "shape",
        "section_{place}_{axis} [m]",
        lambda q, cost: ca.vec(q.sections(_shape_at(cost))[0]),
        lambda cost, _: [str(k + 1) for k in range(len(_shape_at(cost)))],
        "shape",
        _near_base,
    ),
    CostTerm("tip_angle", "tip_angle [rad]", lambda q, _: q.sections((q.length,))[1], _one, "tip_angle", _turned),
    CostTerm(
        "contact_force",
        "contact_force_{place} [N]",
        lambda q, _: q.contact_force(),
        lambda cost, model: cost.tracked_contacts("contact_force", model.contact_names),
        reference="contact_force",
    ),
    CostTerm(
        "gap",
        "gap_{place} [m]",
        lambda q, _: q.gap(),
        lambda cost, model: cost.tracked_contacts("gap", model.contact_names),
        reference="gap",
    ),
    CostTerm(
        "object_position",
        "object_{axis} [m]",
        lambda q, _: q.object_pose()[:2],
        reference="object_position",
        limits=_near_base,
    ),
    CostTerm("object_angle", "object_angle [rad]", lambda q, _: q.object_pose()[2], _one, "object_angle", _turned),
    CostTerm("speed", "bending_rate_{place} [rad/s]", lambda q, _: q.bending_rate(), _elements),
    CostTerm("effort", "{place}", lambda q, _: q.input, lambda _, model: model.u_names, "input", of_state=False),
    CostTerm("input_rate", "{place}", lambda q, _: q.input_rate, _rates, of_state=False),
)
"""All terms, in the order of a controller's outputs: terms of the state first, since the end of the horizon has the
first ``nt`` outputs; the input's rate last, since the supervisor raises the last ``nu`` weights."""


def predicted(cost: Cost, model: Prediction, input_rate: ca.SX | None = None) -> Quantities:
    """Quantities of a controller's model."""
    inputs = (model.x, model.u, model.p)
    names = model.contact_names

    def touched(key: str, values: ca.Function) -> ca.SX:
        return values(*inputs)[[names.index(name) for name in cost.tracked_contacts(key, names)]]

    return Quantities(
        length=model.scene.finger.rod.length,
        tip=lambda: model.tip(*inputs),
        sections=lambda at: model.sections(tuple(at)).call([*inputs]),
        object_pose=lambda: model.x[model.system.object_states],
        bending=lambda: model.bending(*inputs),
        bending_rate=lambda: model.bending_rate(*inputs),
        contact_force=lambda: touched("contact_force", model.contact_force),
        gap=lambda: touched("gap", model.gap),
        input=model.u,
        input_rate=input_rate,
    )


@dataclass(frozen=True)
class Outputs:
    """Quantities of a model that the terms of a cost track, in the order of a controller's setpoints."""

    cost: Cost
    model: Prediction
    terms: tuple[CostTerm, ...]

    @staticmethod
    def of(cost: Cost, model: Prediction) -> Outputs:
        """Take all terms that have a weight; one of an explicit 0 for the input would only cost time."""
        return Outputs(cost, model, tuple(term for term in TERMS if getattr(cost, term.key)))

    @staticmethod
    def followed(names: Sequence[str]) -> list[tuple[CostTerm, tuple[int, ...]]]:
        """Terms that follow setpoints among entries by name and unit, each with the numbers of its entries.

        Terms of the input are left out: their setpoints are what costs no effort.
        """
        followed = []
        for term in TERMS:
            columns = tuple(k for k, name in enumerate(names) if term.of_state and term.reference and term.owns(name))
            if columns:
                followed.append((term, columns))
        return followed

    @property
    def names(self) -> tuple[str, ...]:
        """Name and unit of each entry."""
        return tuple(name for term in self.terms for name in term.names(self.cost, self.model))

    @property
    def slices(self) -> dict[str, slice]:
        """Slice of the entries of each term, by the key of its weight."""
        ends = np.cumsum([0, *(len(term.names(self.cost, self.model)) for term in self.terms)]).tolist()
        return {term.key: slice(a, b) for term, a, b in zip(self.terms, ends[:-1], ends[1:], strict=True)}

    @property
    def of_state(self) -> int:
        """Number of entries that depend on the state alone, which are the first."""
        return sum(len(term.names(self.cost, self.model)) for term in self.terms if term.of_state)

    @property
    def weights(self) -> Array:
        """Running and terminal weight of each entry (size, 2)."""
        rows: list[list[float]] = []
        for term in self.terms:
            row = [weight or 0.0 for weight in term.weights(self.cost)]
            rows += [row] * len(term.names(self.cost, self.model))
        return np.array(rows).reshape(-1, 2)

    @property
    def reach(self) -> Reach:
        """Limits of setpoints that the finger can meet."""
        scene, shape = self.model.scene, self.cost.shape
        return Reach(
            scene.finger,
            () if shape is None else shape.at,
            scene.surroundings.object if scene.surroundings else None,
            self.model.system.finger_model.ranges,
        )

    def residuals(self, input_rate: ca.SX | None = None) -> dict[str, Residual]:
        """Return the terms by the names of their setpoints, or of their weights if they have no setpoints."""
        quantities = predicted(self.cost, self.model, input_rate)
        return {
            term.reference or term.key: Residual(
                term.value(quantities, self.cost),
                *term.weights(self.cost),
                term.names(self.cost, self.model),
            )
            for term in self.terms
        }

    def value(self, input_rate: ca.SX | None = None) -> ca.SX:
        """Expression of all entries; ``input_rate`` where the state knows the input before."""
        quantities = predicted(self.cost, self.model, input_rate)
        return ca.SX(ca.vertcat(*[term.value(quantities, self.cost) for term in self.terms]))
