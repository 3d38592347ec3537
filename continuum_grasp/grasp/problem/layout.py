"""Layout of the columns and rows of a grasp problem, which is known without its expressions."""

from __future__ import annotations

import json
from dataclasses import dataclass

from continuum_grasp.grasp.problem.blocks import Places, Rows
from continuum_grasp.grasp.problem.structure import FingerSpec, ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import unit_model
from continuum_grasp.model.family import Family


@dataclass(frozen=True)
class FingerLayout:
    """Layout of a finger."""

    spec: FingerSpec
    size: int  # number of its bending coordinates
    elements: list[int]  # that guarded places but for the probes are in
    touches: list[bool]  # whether the finger touches the object there, of all guarded places

    @property
    def family(self) -> Family:
        """The family of the unit finger's elements."""
        return unit_model(self.spec).structure.family


@dataclass(frozen=True, eq=False)
class Layout:
    """Unknowns, run-time numbers, constraints and fingers of a grasp problem."""

    spec: ProblemSpec
    x: Places  # the unknowns
    numbers: Places  # the run-time numbers
    rows: Rows
    fingers: list[FingerLayout]

    @staticmethod
    def of(spec: ProblemSpec, text: str) -> Layout:
        """The layout of a structure from what `described` wrote of it."""
        x, numbers, blocks, guarded = json.loads(text)
        rows = Rows()
        for name, key, unit, count, lower, upper in blocks:
            rows.rows(name, key, unit, count, 1.0, lower, upper)
        own = zip(spec.fingers, guarded, strict=True)
        fingers = [FingerLayout(finger, x[f"{finger.name}.q"], *places) for finger, places in own]
        return Layout(spec, Places(x), Places(numbers), rows, fingers)
