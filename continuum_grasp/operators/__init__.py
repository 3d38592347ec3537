"""The finger as differentiable functions of JAX and PyTorch arrays."""

from lazy_loader import attach_stub

__all__ = ["JaxOperators", "TorchOperators"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
