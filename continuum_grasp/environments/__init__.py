"""Reinforcement learning: closed loops as environments of gymnasium, many plants at once in compiled vector lanes.

Importing this package registers the environments of ``TASKS`` with gymnasium, where that is installed.
"""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.environments.single import FingerEnv as FingerEnv
    from continuum_grasp.environments.tasks import TASKS as TASKS
    from continuum_grasp.environments.vector import Ended as Ended
    from continuum_grasp.environments.vector import FingerVectorEnv as FingerVectorEnv

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)

from importlib.util import find_spec  # noqa: E402

if find_spec("gymnasium") is not None:
    from continuum_grasp.environments.tasks import register

    register()
