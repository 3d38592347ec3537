"""Many grasps from one scene: grids and random draws, on as many processes as there are."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.sweeps.run import sweep as sweep
    from continuum_grasp.sweeps.table import SweepTable as SweepTable
    from continuum_grasp.sweeps.table import sweep_table as sweep_table

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
_GONE = {
    **dict.fromkeys(("Map", "map_of"), "write table.map(x, y, color), or draw it by table.plot(picture='map', ...)"),
    **dict.fromkeys(("Front", "front_of"), "write table.front(x, y), or draw it by table.plot(picture='pareto', ...)"),
    "Progress": "progress is called with a share and a text",
}
__getattr__, __dir__ = lazy_names(__name__, _MODULES, _GONE)
