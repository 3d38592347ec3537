"""Outlines measured point by point, in CSV tables."""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.drawings.curves import DrawnCurve, distinct
from continuum_grasp.scene.objects.drawings.drawing import Drawing
from continuum_grasp.scene.objects.measured import Sampling
from continuum_grasp.scene.units import units_of

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile
    from continuum_grasp.scene.table import DataTable


class _Column(NamedTuple):
    values: Array
    unit: str | None
    at: int


def read_csv(given: OutlineFile) -> Drawing:
    """Read the columns x and y, or the two of a table without headings; `InputError` has the line of the fault.

    Units in the headings must not contradict the ``scale`` that is given.
    """
    from continuum_grasp.scene.table import DataTable

    table = DataTable.read(given.file, ("x", "y"))
    scale = given.scale
    x, y = _column(table, "x"), _column(table, "y")
    factors = [float(units_of("m")[column.unit]) for column in (x, y) if column.unit]
    if len(factors) == 1:
        bare = x if x.unit is None else y
        raise table.error(f"column {table.headings[bare.at]} has no unit, the other has [{x.unit or y.unit}]", bare.at)
    for column, factor in zip((x, y), factors, strict=False):
        if scale is not None and abs(factor - scale) > 1e-9 * scale:
            message = f"its heading says [{column.unit}], the configuration scale: {scale:g} m; leave one out"
            raise table.error(message, column.at)
    ratio = factors[1] / factors[0] if factors else 1.0
    points = distinct(zip(x.values.tolist(), (ratio * y.values).tolist(), strict=True))
    curves = [DrawnCurve("curve", (), points)] if len(points) > 2 else []
    unread = (heading for at, heading in enumerate(table.headings) if at not in (x.at, y.at))
    ignored = Counter(f"column {heading}" for heading in unread)
    return Drawing(factors[0] if factors else 1.0, curves, ignored, sampling=Sampling())


def _column(table: DataTable, name: str) -> _Column:
    """A column by its heading, in capitals too and with the unit in brackets or behind a low line: X, x [mm], x_mm."""
    lengths = "|".join(map(re.escape, units_of("m")))
    for at, heading in enumerate(table.headings):
        if parts := re.fullmatch(rf"{name}(?:_({lengths}))?", heading, re.IGNORECASE):
            unit = table.units[at] or parts[1]
            if unit is not None and unit not in units_of("m"):
                raise table.error(f"expected a unit of length ({', '.join(units_of('m'))}), got [{unit}]", at)
            return _Column(table.numbers(heading), unit, at)
    raise table.error(f"no column {name!r} (it has {', '.join(table.headings)})", 0)
