"""The finger as differentiable functions of JAX and PyTorch arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp._lazy import lazy_names

_MODULES = {
    "continuum_grasp.operators.for_jax": ("JaxOperators",),
    "continuum_grasp.operators.for_torch": ("TorchOperators",),
}
__all__ = [name for names in _MODULES.values() for name in names]

if TYPE_CHECKING:
    from continuum_grasp.operators.for_jax import JaxOperators as JaxOperators
    from continuum_grasp.operators.for_torch import TorchOperators as TorchOperators

__getattr__, __dir__ = lazy_names(__name__, _MODULES)
