"""Many grasps from one scene: grids and random draws, on as many processes as there are."""

from continuum_grasp.sweeps.run import sweep
from continuum_grasp.sweeps.table import SweepTable, sweep_table

__all__ = ["SweepTable", "sweep", "sweep_table"]
