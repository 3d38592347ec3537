"""The table as CSV, for spreadsheets and other programs."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from continuum_grasp.results import replacing
from continuum_grasp.sweeps.folder import TABLE, lines_of, read_plan
from continuum_grasp.sweeps.lines import decode
from continuum_grasp.sweeps.plan import keys_of

__all__ = ["CSV", "write_csv"]

CSV = "table.csv"
_FIRST, _LAST = ("index", "scene"), ("message",)


def write_csv(folder: Path) -> Path:
    """Write ``table.csv``, in the order of the scenes; holds one row in memory at a time.

    Raises
    ------
    InputError
        There is no sweep in the folder.
    OSError
        The file cannot be written.
    """
    plan = read_plan(folder)
    keys, numbers = keys_of(plan), list(plan["columns"])
    places = np.full(int(plan["scenes"]), -1, dtype=np.int64)
    for place, _, row in lines_of(folder / TABLE):
        if 0 <= row["index"] < len(places) and places[row["index"]] < 0:
            places[row["index"]] = place
    rest = ("status", "reason", *numbers, *_LAST)
    with (
        open(folder / TABLE, "rb") as table,
        replacing(folder / CSV) as temporary,
        open(temporary, "w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file)
        writer.writerow([*_FIRST, *keys, *rest])
        for place in places[places >= 0]:
            table.seek(place)
            row = decode(table.readline()) or {}
            values = row.get("values", {})
            cells = [*(row.get(name) for name in _FIRST), *map(values.get, keys), *map(row.get, rest)]
            writer.writerow([json.dumps(cell) if isinstance(cell, bool) else cell for cell in cells])
    return folder / CSV
