from .for_jax import JaxOperators as JaxOperators
from .for_torch import TorchOperators as TorchOperators
