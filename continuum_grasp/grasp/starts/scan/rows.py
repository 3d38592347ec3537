"""Columns of equal length in a dataclass: a row of all of them belongs together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np


@dataclass(frozen=True)
class Rows:
    """Dataclasses whose fields are arrays with one axis of rows first, or such dataclasses."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def take(self, index: Any) -> Self:
        """Some of the rows."""
        found = {
            name: value.take(index) if isinstance(value, Rows) else value[index] for name, value in vars(self).items()
        }
        return replace(self, **found)

    def followed_by(self, others: Sequence[Self]) -> Self:
        """All of its rows, then those of others."""

        def joined(name: str) -> Any:
            first, *more = (getattr(each, name) for each in (self, *others))
            return first.followed_by(more) if isinstance(first, Rows) else np.concatenate([first, *more])

        return replace(self, **{name: joined(name) for name in vars(self)})
