"""Many grasps from one scene: grids and random draws, on as many processes as there are."""

from lazy_loader import attach_stub

__all__ = ["Sweep", "SweepTable", "sweep", "sweep_table"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
