"""Learning: closed loops as environments of gymnasium, fingers as differentiable functions of JAX and PyTorch.

Importing this package registers the environments of ``TASKS`` with gymnasium, where that is installed.
"""

from importlib.util import find_spec

from lazy_loader import attach_stub

__all__ = ["TASKS", "Ended", "FingerEnv", "FingerVectorEnv", "JaxOperators", "TorchOperators"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)

if find_spec("gymnasium") is not None:
    from continuum_grasp.addons.learning.environments.tasks import register

    register()
