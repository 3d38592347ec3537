"""Reinforcement learning: closed loops as environments of gymnasium, many plants at once in compiled vector lanes.

Importing this package registers the environments of ``TASKS`` with gymnasium, where that is installed.
"""

from importlib.util import find_spec

from lazy_loader import attach_stub

__all__ = ["TASKS", "Ended", "FingerEnv", "FingerVectorEnv"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)

if find_spec("gymnasium") is not None:
    from continuum_grasp.environments.tasks import register

    register()
