"""Finding how fingers hold an object, and proving that they do."""

from lazy_loader import attach_stub

__all__ = [
    "Certificate",
    "Check",
    "Contact",
    "FingerPosture",
    "GraspResult",
    "GraspStatus",
    "GraspTrials",
    "HandResult",
    "Quality",
    "Reason",
    "Robustness",
    "certify",
    "least_normal_force_bound",
    "optimize_grasp",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
