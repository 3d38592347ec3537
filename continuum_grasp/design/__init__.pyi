from .evaluation import CaseValues as CaseValues
from .evaluation import DesignNumber as DesignNumber
from .evaluation import Evaluation as Evaluation
from .optimize import optimize_design as optimize_design
from .result import DesignResult as DesignResult
from .result import DesignStatus as DesignStatus
from .result import Influence as Influence
from .result import WorstCase as WorstCase
