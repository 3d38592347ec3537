"""How far what a package computes is from the same in double precision."""

from __future__ import annotations

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.export.part import Call
from continuum_grasp.export.reals import REALS, Real
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.vectors import arguments_of, sample, split

__all__ = ["check_errors", "rounding_errors"]

_ROWS = 256


def rounding_errors(subject: Subject, narrow: Call, wide: Call, seed: int) -> float:
    """Greatest difference between a function's twins in the package's precision and in double.

    Relative to the greatest value of each output over rows that cover the ranges; both start from the same rounded
    inputs.
    """
    arguments = arguments_of(subject, narrow)
    rows = sample(subject, arguments, seed, _ROWS).astype(subject.real.dtype)
    found, codes = narrow.twin(split(rows, arguments))
    true, _ = wide.twin(split(rows.astype(REALS["double"].dtype), arguments))
    good = codes >= 0
    found, true = found[good].astype(float), true[good]
    scale = np.abs(true).max(axis=0)
    return float((np.abs(found - true).max(axis=0) / np.where(scale > 0.0, scale, 1.0)).max())


def check_errors(real: Real, errors: dict[str, float], asked: float) -> None:
    """Whether the functions are as accurate as asked.

    Raises
    ------
    InputError
        If one is not.
    """
    worst = max(errors, key=lambda name: errors[name])
    if errors[worst] > asked:
        raise InputError(
            f"{real.name} gives {worst} a relative error of {errors[worst]:.1g} within the ranges, "
            f"{asked:.1g} was asked for: take real='double', or a smaller bending_range, or fewer elements",
            key="error",
        )
