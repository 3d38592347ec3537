"""The model as C: generated, compiled, cached and loaded, or written out for use elsewhere."""

from continuum_grasp.core.codegen import codegen
from continuum_grasp.core.core import Core, compile

__all__ = ["Core", "codegen", "compile"]
