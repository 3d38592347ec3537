from .single import FingerEnv as FingerEnv
from .tasks import TASKS as TASKS
from .vector import Ended as Ended
from .vector import FingerVectorEnv as FingerVectorEnv
