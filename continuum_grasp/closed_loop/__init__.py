"""The closed loop: a controller tried on a plant that differs from what it knows."""

from lazy_loader import attach_stub

__all__ = [
    "ControlRun",
    "Driver",
    "HardwareRun",
    "Metrics",
    "Plant",
    "RealTime",
    "SerialBoard",
    "SimulatedBench",
    "run_closed_loop",
    "run_hardware",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
