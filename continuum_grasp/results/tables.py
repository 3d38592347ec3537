"""Stored arrays as data frames of pandas and data sets of xarray, with labels and units."""

from __future__ import annotations

from importlib import import_module
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError
from continuum_grasp.labels import split_unit
from continuum_grasp.results.declared import Stored

if TYPE_CHECKING:
    import pandas
    import xarray

# Results are Any here: they import this module.


def package(name: str) -> Any:
    """An optional package; an InputError that says how to install it where it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"this needs {name}, which is not installed: pip install {name}") from None


def to_xarray(result: Any) -> xarray.Dataset:
    """See `Result.to_xarray`."""
    xr = package("xarray")
    arrays, coordinates = _arrays(result), {}
    sizes = {name: size for one, value in arrays for name, size in zip(one.dimensions, value.shape, strict=True)}
    for name, size in sizes.items():
        dimension = _dimension(result, name)
        labels, units = _labels(result, name, size)
        about = {"long_name": name if dimension is None else dimension.meaning}
        if dimension is not None and dimension.unit:
            about["units"] = dimension.unit
        if labels is not None:
            coordinates[name] = (name, labels, about)
        if units is not None:
            coordinates[f"{name}_unit"] = (name, units, {"long_name": f"unit along {name}"})
    variables = {
        one.name: (one.dimensions, value, {"units": _unit(one), "long_name": one.meaning})
        for one, value in arrays
        if not _is_label(result, one)
    }
    about = {"kind": result.kind, "name": result.name or "", "status": result.outcome, "warnings": [*result.warnings]}
    found: xarray.Dataset = xr.Dataset(variables, coordinates, about)
    return found


def to_pandas(result: Any, dimension: str | None = None) -> pandas.DataFrame:
    """See `Result.to_pandas`."""
    arrays = _arrays(result)
    known = list(dict.fromkeys(name for one, _ in arrays for name in one.dimensions))
    if not known:
        raise InputError("this result has no arrays to make a table of")
    if dimension is not None and dimension not in known:
        raise InputError(f"expected one of {', '.join(known)}, got {dimension!r}", key="dimension")
    rows = known[0] if dimension is None else dimension
    columns: dict[str, Array] = {}
    units, descriptions, count = {}, {}, 0
    for one, value in arrays:
        if rows not in one.dimensions or _is_label(result, one):
            count = value.shape[one.dimensions.index(rows)] if rows in one.dimensions else count
            continue
        along = np.moveaxis(value, one.dimensions.index(rows), 0)
        count, others = len(along), [name for name in one.dimensions if name != rows]
        found = [_entries(result, name, size) for name, size in zip(others, along.shape[1:], strict=True)]
        for place, entries in zip(np.ndindex(*along.shape[1:]), product(*found), strict=True):
            name = ".".join([one.name, *(label for label, _ in entries)])
            columns[name] = along[(slice(None), *place)]
            units[name] = next((unit for _, unit in entries if unit), "") or _unit(one)
            descriptions[name] = one.meaning
    labels, own = _labels(result, rows, count)
    if own is not None:
        columns = {"unit": own, **columns}
    pd = package("pandas")
    index = pd.Index(np.arange(count) if labels is None else labels, name=rows)
    frame: pandas.DataFrame = pd.DataFrame(columns, index=index)
    frame.attrs = {"units": units, "descriptions": descriptions}
    return frame


def _arrays(result: Any) -> list[tuple[Stored, Array]]:
    """Declared arrays with their values."""
    found = result.stored_arrays()
    return [(one, np.asarray(found[one.name])) for one in result.declared() if one.name in found]


def _dimension(result: Any, name: str) -> Any:
    return next((one for one in result.dimensions if one.name == name), None)


def _is_label(result: Any, one: Stored) -> bool:
    """Whether an array is what its dimension is labeled with."""
    return len(one.dimensions) == 1 and any(
        dimension.name == one.dimensions[0] and dimension.labels == (one.source or one.name)
        for dimension in result.dimensions
    )


def _labels(result: Any, name: str, size: int) -> tuple[Array | None, Array | None]:
    """Labels along a dimension (size,), and their units where they carry some; each None where there are none."""
    dimension = _dimension(result, name)
    labels = None if dimension is None else dimension.labels_of(result, size)
    if labels is None:
        return None, None
    if not all(isinstance(label, str) for label in labels):
        return np.asarray(labels), None
    names, units = zip(*(split_unit(label) for label in labels), strict=True)
    return np.array(names, dtype=str), np.array(units, dtype=str) if any(units) else None


def _entries(result: Any, name: str, size: int) -> list[tuple[str, str]]:
    """Label and unit of each place on a dimension, for the names of columns."""
    labels, units = _labels(result, name, size)
    texts = [str(k) for k in range(size)] if labels is None else [str(label) for label in labels.tolist()]
    return list(zip(texts, [""] * size if units is None else units.tolist(), strict=True))


def _unit(one: Stored) -> str:
    return "" if one.unit == "text" else one.unit


def pareto(x: Array, y: Array, x_greatest: bool = False, y_greatest: bool = False) -> NDArray[np.int64]:
    """Positions of the points that no other point beats: none is as good in both and better in one.

    With increasing x; of equal points the first.
    """
    # Sorted by x, a point belongs to the front where its y is less than that of all before it.
    a, b = (-x if x_greatest else x), (-y if y_greatest else y)
    found, least = [], np.inf
    for k in np.lexsort((np.arange(len(a)), b, a)):
        if b[k] < least:
            found.append(k)
            least = b[k]
    return np.array(found[::-1] if x_greatest else found, dtype=np.int64)
