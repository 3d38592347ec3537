"""Whether a result is what its class declares."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from continuum_grasp.results import Result


def assert_declared(result: Result, arrays: Mapping[str, Any] | None = None) -> None:
    """Assert that arrays are declared, that a dimension is one number, with as many labels, and that ``repr`` is short.

    The arrays are those that the result stores where none are given.
    """
    sizes: dict[str, int] = {}
    declared = {one.name: one for one in result.declared()}
    found = result.stored_arrays() if arrays is None else arrays
    assert found
    assert set(found) <= set(declared)
    for name, array in found.items():
        shape = np.shape(array)
        assert len(declared[name].dimensions) == len(shape), name
        for dimension, size in zip(declared[name].dimensions, shape, strict=True):
            assert sizes.setdefault(dimension, size) == size, (name, dimension)
    for one in result.dimensions:
        if not one.labels or isinstance(one.labels, int) or one.name not in sizes:
            continue
        labels = one.labels if isinstance(one.labels, tuple) else _at(result, one.labels)
        first = one.name in ("pose", "model_state")  # of which there may be the first alone
        assert len(labels) == sizes[one.name] or (first and len(labels) > sizes[one.name]), one.name
    assert len(repr(result)) < 1000
    assert "no summary" not in repr(result)


def _at(of: Any, path: str) -> Any:
    for part in path.split("."):
        of = of[part] if isinstance(of, Mapping) else getattr(of, part)
    return of
