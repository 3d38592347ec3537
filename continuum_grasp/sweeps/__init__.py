"""Many grasps from one scene: grids and random draws, on as many processes as there are."""

from continuum_grasp.sweeps.maps import Front, Map, front_of, map_of
from continuum_grasp.sweeps.run import Progress, sweep
from continuum_grasp.sweeps.table import SweepTable, sweep_table

__all__ = ["Front", "Map", "Progress", "SweepTable", "front_of", "map_of", "sweep", "sweep_table"]
