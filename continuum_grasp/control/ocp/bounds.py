"""Bounds of the state and of the input's rate as rows of soft constraints, each in shares of its scale."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Bounds, Penalty

HARD = Penalty(linear=1e4, quadratic=1e6)
"""Penalty weights of a hard constraint, per share of its scale. A linear penalty above the constraint's multiplier is
exact (it satisfies every constraint that can be satisfied; Fletcher, Practical Methods of Optimization, 12.3), and
keeps the QP feasible otherwise: 1e4 is 100 times the default of soft constraints, and does not spoil single
precision."""
_PER_ELEMENT = 4
"""Number of sections per element that a zone checks [1]: in an element that bends by 1.5 rad, the backbone leaves its
chord between two sections by a twentieth of their distance."""


class Row(NamedTuple):
    """An expression between two bounds.

    A violation s, as a share of the greater bound (of 1 if this is 0 or absent), costs linear s + quadratic s^2 / 2 per
    node. ``penalty`` has both weights; None is a hard constraint, satisfied whenever this is possible. ``names`` belong
    to the entries, by default numbered ones; ``key`` belongs to the scene's ``bounds``.
    """

    value: Any
    least: Any = -math.inf
    most: Any = math.inf
    penalty: Any = None
    names: tuple[str, ...] = ()
    key: str = ""


class BoundedRows:
    """Rows by entry: names, values, bounds and penalty weights; ``groups`` has the entries of each row by its key."""

    def __init__(self, rows: Sequence[Row]) -> None:
        ends = np.cumsum([0, *(len(row.names) for row in rows)]).tolist()
        self.groups = {row.key: list(range(*ends[k : k + 2])) for k, row in enumerate(rows)}
        self.names = [name for row in rows for name in row.names]
        self.column = ca.vertcat(ca.SX(0, 1), *(row.value for row in rows))
        by_entry = [row for row in rows for _ in row.names]
        self.least = np.array([row.least for row in by_entry], dtype=float)
        self.most = np.array([row.most for row in by_entry], dtype=float)
        self.linear = np.array([row.penalty.linear for row in by_entry], dtype=float)
        self.quadratic = np.array([row.penalty.quadratic for row in by_entry], dtype=float)

    @staticmethod
    def of_state(bounds: Bounds, model: Prediction) -> BoundedRows:
        """Rows of the state alone, by a scene's bounds."""
        return BoundedRows(state_bounds(bounds, model))

    @staticmethod
    def curvature_limits(bounds: Bounds, model: FingerModel) -> tuple[Array, Array]:
        """Greatest absolute values [1/m] of what ``System.curvature`` gives: asked for, and of the bending ranges."""
        family = model.structure.family
        lengths = model.lengths
        edges = np.minimum(np.cumsum([0.0, *lengths]), model.finger.rod.length).tolist()
        count = len(family.places)
        asked = []
        ranges = []
        # Each entry is read at one place of one element.
        numbers = [[float(count * k + j) for j in range(count)] for k in range(len(lengths))]
        for number in family.curvature_at_coordinates(numbers):
            element, j = divmod(int(number), count)
            place = family.places[j]
            # The ends of an arc have its curvature too; a node belongs to the elements on both sides.
            at = (edges[element] + place * lengths[element],) if family.degree else edges[element : element + 2]
            after = [element + 1] if family.continuous and place == 1.0 and element + 1 < len(lengths) else []
            asked.append(min(bounds.curvature_limit_at(model.finger, s) for s in at))
            ranges.append(min(model.ranges[k] / lengths[k] for k in (element, *after)))
        return np.array(asked), np.array(ranges)

    @property
    def hard(self) -> NDArray[np.bool_]:
        """Whether each entry is a hard constraint."""
        return self.linear >= HARD.linear


def state_bounds(bounds: Bounds, model: Prediction) -> list[Row]:
    """List the rows of the state alone: curvatures, bending rates, tensions under winches, and distances from zones."""
    rows = list[Row]()
    penalty = _penalty(bounds.penalty or bounds.usual_penalty)
    inputs = (model.x, model.u, model.p)
    if bounds.curvature is not None:
        # A row per node, relative to its limit: elements differ in range, and one scale of penalties serves all.
        kappa = model.curvature(*inputs)
        limits = np.minimum(*BoundedRows.curvature_limits(bounds, model.system.finger_model))
        names = tuple(f"curvature_{k + 1}" for k in range(kappa.numel()))
        rows.append(Row(kappa / ca.DM(limits), -1.0, 1.0, penalty, names, "curvature"))
    if bounds.speed is not None:
        rate = model.bending_rate(*inputs)
        names = tuple(f"bending_rate_{k + 1}" for k in range(rate.numel()))
        rows.append(Row(rate / bounds.speed, -1.0, 1.0, penalty, names, "speed"))
    if model.scene.finger.winches:
        # This is no input but the state of drives: if the model has too high a tension, the plan must lower it.
        greatest_tensions = [tendon.max_tension for tendon in model.scene.finger.tendon_list]
        names = tuple(f"tension_{k + 1}" for k in range(len(greatest_tensions)))
        tensions = model.tensions(*inputs) / ca.DM(greatest_tensions)
        rows.append(Row(tensions, -math.inf, 1.0, penalty, names, "tension"))
    return [*rows, *_zones(bounds, model)]


def _zones(bounds: Bounds, model: Prediction) -> Iterator[Row]:
    """Distance of the finger's surface from each zone, per finger length."""
    finger = model.scene.finger
    for name, zone in bounds.keep_out.items():
        places = [finger.rod.length]
        if zone.of == "backbone":
            lengths = model.system.finger_model.lengths
            ends = np.cumsum([0.0, *lengths])
            places = [ends[k] + h * (j + 1) / _PER_ELEMENT for k, h in enumerate(lengths) for j in range(_PER_ELEMENT)]
        # Sums of element lengths are rounded, and beyond the tip there is no section.
        places = [min(s, finger.rod.length) for s in places]
        where = model.sections(tuple(places))(model.x, model.u, model.p)[0]
        # The surface, half a thickness from the backbone, is what must stay outside.
        away = zone.clearance + finger.profile.half_thickness(places)
        gaps = zone.distance(where[0, :], where[1, :]).T - ca.DM(away)
        labels = (name,) if len(places) == 1 else tuple(f"{name}_{k + 1}" for k in range(len(places)))
        penalty = _penalty(zone.penalty or bounds.usual_penalty)
        yield Row(gaps / finger.rod.length, 0.0, math.inf, penalty, labels, f"keep_out.{name}")


def _penalty(penalty: Penalty | str) -> Penalty:
    return penalty if isinstance(penalty, Penalty) else HARD
