"""Arguments of controllers and estimators as arrays of the right size, else ``InputError``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, split_unit


def named(
    key: str,
    value: Mapping[str, Any],
    names: Sequence[str],
    default: ArrayLike | None = None,
    groups: Mapping[str, slice] = MappingProxyType({}),
) -> Array:
    """Convert numbers by name to a vector in the order of ``names`` (with units), ``default`` where one is not given.

    A name of ``groups`` stands for all entries of its slice that are not given by their own. ``InputError`` for unknown
    names, for a value that is no number, and without a default for missing names.
    """
    order = [split_unit(name).name for name in names]
    places: dict[str, Any] = {**groups, **{name: k for k, name in enumerate(order)}}
    unknown = [name for name in value if name not in places]
    missing = [name for name in order if name not in value] if default is None else []
    if unknown or missing:
        odd = (
            f"there is no {', '.join(CheckedArgument(None, name).shown() for name in unknown)}"
            if unknown
            else f"{', '.join(missing)} missing"
        )
        raise InputError(f"{odd}: expected {', '.join(places) or 'none'}", key=key)
    entries = np.zeros(len(order)) if default is None else np.array(default, dtype=float)
    for name, place in places.items():
        if name in value:
            try:
                entries[place] = CheckedArgument(name, value[name]).doubles()
            except (TypeError, ValueError) as error:
                raise CheckedArgument(f"{key}.{name}", value[name]).refused("expected a number") from error
    return entries
