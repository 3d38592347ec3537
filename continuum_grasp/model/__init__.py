"""The physics of the finger and of what it touches, written once as CasADi expressions."""

from continuum_grasp.model.finger_model import FingerModel
from continuum_grasp.model.parameters import ModelOptions
from continuum_grasp.model.stumpff import stumpff
from continuum_grasp.model.system import System

__all__ = ["FingerModel", "ModelOptions", "System", "stumpff"]
