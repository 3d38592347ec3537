"""A member of a C structure of settings."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Field:
    """A member of a C structure of settings, and its values."""

    member: str
    values: ArrayLike
    whole: bool = False
