from .result import Constraint as Constraint
from .result import MotionPlan as MotionPlan
from .result import PlanStatus as PlanStatus
from .solve import plan as plan
