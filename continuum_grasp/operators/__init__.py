"""The finger as differentiable functions of JAX and PyTorch arrays."""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.operators.for_jax import JaxOperators as JaxOperators
    from continuum_grasp.operators.for_torch import TorchOperators as TorchOperators

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
