"""Many grasps from one scene: grids and random draws, on as many processes as there are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp._lazy import lazy_names

_MODULES = {
    "continuum_grasp.sweeps.progress": ("Progress",),
    "continuum_grasp.sweeps.run": ("sweep",),
    "continuum_grasp.sweeps.table": ("SweepTable", "sweep_table"),
}
__all__ = [name for names in _MODULES.values() for name in names]

if TYPE_CHECKING:
    from continuum_grasp.sweeps.progress import Progress as Progress
    from continuum_grasp.sweeps.run import sweep as sweep
    from continuum_grasp.sweeps.table import SweepTable as SweepTable
    from continuum_grasp.sweeps.table import sweep_table as sweep_table

__getattr__, __dir__ = lazy_names(__name__, _MODULES)
