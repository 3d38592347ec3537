"""The closed loop: a controller tried on a plant that differs from what it knows."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.closed_loop.drivers import RealTime as RealTime
    from continuum_grasp.closed_loop.drivers import SerialBoard as SerialBoard
    from continuum_grasp.closed_loop.drivers import SimulatedBench as SimulatedBench
    from continuum_grasp.closed_loop.hardware import Driver as Driver
    from continuum_grasp.closed_loop.hardware import HardwareRun as HardwareRun
    from continuum_grasp.closed_loop.hardware import run_hardware as run_hardware
    from continuum_grasp.closed_loop.plant import Plant as Plant
    from continuum_grasp.closed_loop.readings import Metrics as Metrics
    from continuum_grasp.closed_loop.result import ControlRun as ControlRun
    from continuum_grasp.closed_loop.run import run_closed_loop as run_closed_loop

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
_GONE = {
    "Converged": "continuum_grasp.Controller does it, of a scene with controller.sqp_iterations=20 and no estimator",
    "Phase": "setpoints that change over time are points with times in reference, or run_closed_loop(functions=...)",
}
__getattr__, __dir__ = lazy_names(__name__, _MODULES, _GONE)
