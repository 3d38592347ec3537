"""The physics of the finger, written once as CasADi expressions."""

from continuum_grasp.model.finger_model import FingerModel

__all__ = ["FingerModel"]
