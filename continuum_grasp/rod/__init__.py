"""The exact elastic rod by numpy and scipy: the independent reference of the finger model.

The names here are loaded when they are first used.
"""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.rod.elastica import Elastica as Elastica
    from continuum_grasp.rod.elastica import solve_elastica as solve_elastica
    from continuum_grasp.rod.frequencies import natural_frequencies as natural_frequencies

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
