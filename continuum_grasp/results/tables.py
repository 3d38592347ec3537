"""Stored arrays as data frames of pandas and data sets of xarray, with labels and units."""

from __future__ import annotations

from importlib import import_module
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, InputError, install_line, split_unit
from continuum_grasp.results.declared import Stored, attribute

if TYPE_CHECKING:
    import pandas
    import xarray

# Results are Any here: they import this module.


def package(name: str) -> Any:
    """An optional package; an InputError that says how to install it where it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"this needs {name}, which is not installed: {install_line('data')}") from None


def to_xarray(result: Any) -> xarray.Dataset:
    """See `Result.to_xarray`."""
    xr = package("xarray")
    arrays = _arrays(result)
    coordinates = {}
    sizes = {name: size for stored, value in arrays for name, size in zip(stored.dimensions, value.shape, strict=True)}
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
        stored.name: (stored.dimensions, value, {"units": _unit(stored), "long_name": stored.meaning})
        for stored, value in arrays
        if not _is_label(result, stored)
    }
    about = {"kind": result.kind, "name": result.name or "", "status": result.outcome, "warnings": [*result.warnings]}
    dataset: xarray.Dataset = xr.Dataset(variables, coordinates, about)
    return dataset


def to_pandas(result: Any, dimension: str | None = None) -> pandas.DataFrame:
    """See `Result.to_pandas`."""
    arrays = _arrays(result)
    known = list(dict.fromkeys(name for stored, _ in arrays for name in stored.dimensions))
    if not known:
        raise InputError("this result has no arrays to make a table of")
    if dimension is not None and dimension not in known:
        raise InputError(f"expected one of {', '.join(known)}, got {dimension!r}", key="dimension")
    rows = known[0] if dimension is None else dimension
    columns: dict[str, Array] = {}
    units = {}
    descriptions = {}
    count = 0
    for stored, value in arrays:
        if rows not in stored.dimensions or _is_label(result, stored):
            count = value.shape[stored.dimensions.index(rows)] if rows in stored.dimensions else count
            continue
        along = np.moveaxis(value, stored.dimensions.index(rows), 0)
        count = len(along)
        others = [name for name in stored.dimensions if name != rows]
        other_entries = [_entries(result, name, size) for name, size in zip(others, along.shape[1:], strict=True)]
        for place, entries in zip(np.ndindex(*along.shape[1:]), product(*other_entries), strict=True):
            name = ".".join([stored.name, *(label for label, _ in entries)])
            columns[name] = along[(slice(None), *place)]
            units[name] = next((unit for _, unit in entries if unit), "") or _unit(stored)
            descriptions[name] = stored.meaning
    labels, label_units = _labels(result, rows, count)
    if label_units is not None:
        columns = {"unit": label_units, **columns}
    pd = package("pandas")
    index = pd.Index(np.arange(count) if labels is None else labels, name=rows)
    frame: pandas.DataFrame = pd.DataFrame(columns, index=index)
    frame.attrs = {"units": units, "descriptions": descriptions}
    return frame


def _arrays(result: Any) -> list[tuple[Stored, Array]]:
    """Declared arrays with their values."""
    arrays = result.stored_arrays()
    return [(stored, np.asarray(arrays[stored.name])) for stored in result.declared() if stored.name in arrays]


def _dimension(result: Any, name: str) -> Any:
    return next((dimension for dimension in result.dimensions if dimension.name == name), None)


def _is_label(result: Any, stored: Stored) -> bool:
    """Whether an array is what its dimension is labeled with."""
    return len(stored.dimensions) == 1 and any(
        dimension.name == stored.dimensions[0] and dimension.labels == (stored.source or stored.name)
        for dimension in result.dimensions
    )


def _labels(result: Any, name: str, size: int) -> tuple[Array | None, Array | None]:
    """Labels along a dimension (size,), and their units where they carry some; each None where there are none."""
    stated = getattr(_dimension(result, name), "labels", None)
    if isinstance(stated, int):
        return np.asarray(range(stated, stated + size)), None
    if isinstance(stated, str):
        stated = attribute(result, stated)
    labels = [] if stated is None else list(stated)[:size]
    if not labels or len(labels) < size:
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


def _unit(stored: Stored) -> str:
    return "" if stored.unit == "text" else stored.unit


def pareto(x: Array, y: Array, x_greatest: bool = False, y_greatest: bool = False) -> NDArray[np.int64]:
    """Positions of the points that no other point beats: none is as good in both and better in one.

    With increasing x; of equal points the first.
    """
    # Sorted by x, a point belongs to the front where its y is less than that of all before it.
    a, b = (-x if x_greatest else x), (-y if y_greatest else y)
    front = []
    least = np.inf
    for k in np.lexsort((np.arange(len(a)), b, a)):
        if b[k] < least:
            front.append(k)
            least = b[k]
    return np.array(front[::-1] if x_greatest else front, dtype=np.int64)
