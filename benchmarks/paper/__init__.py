"""The equations of the paper itself, doi:10.1155/2014/308283, as printed and corrected, to compare with.

``PaperModel`` is a finger model whose inertia, weight and Jacobians are the paper's. What was wrong in print, how it is
known and what it does is in ``docs/errata.md``; ``slips`` has the closed forms, ``appendix.txt`` the polynomials, with
both readings side by side.
"""

from benchmarks.paper.kinematics import Terms, TwoArcs
from benchmarks.paper.model import VARIANTS, PaperModel, paper_errors

__all__ = ["VARIANTS", "PaperModel", "Terms", "TwoArcs", "paper_errors"]
