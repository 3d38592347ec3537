"""A whole grasp under control: its task, the closed loop that does it, and many plants on which it must."""

from lazy_loader import attach_stub

__all__ = [
    "AssignedMission",
    "BeyondCertificate",
    "Exceeded",
    "MissionController",
    "MissionRun",
    "MissionScene",
    "NotLifted",
    "Outcome",
    "Phases",
    "PlantVariation",
    "Shortfall",
    "Trials",
    "TrialsResult",
    "Turn",
    "assign_mission",
    "check_mission",
    "run_mission",
    "run_trials",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
