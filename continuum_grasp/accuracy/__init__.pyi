from .choose import Chosen as Chosen
from .choose import choose_fidelity as choose_fidelity
from .choose import resolve_fidelity as resolve_fidelity
from .report import COUNTS as COUNTS
from .report import AccuracyReport as AccuracyReport
from .report import accuracy_report as accuracy_report
from .space import motion_within as motion_within
from .space import refined as refined
