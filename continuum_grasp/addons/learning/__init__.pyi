from .environments.single import FingerEnv as FingerEnv
from .environments.tasks import TASKS as TASKS
from .environments.vector import Ended as Ended
from .environments.vector import FingerVectorEnv as FingerVectorEnv
from .operators.for_jax import JaxOperators as JaxOperators
from .operators.for_torch import TorchOperators as TorchOperators
