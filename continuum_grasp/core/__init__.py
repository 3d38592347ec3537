"""The model as C: generated, compiled, cached and loaded."""

from continuum_grasp.core.core import Core, compile

__all__ = ["Core", "compile"]
