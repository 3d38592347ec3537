"""The finger map: equilibria of one finger that touch, sampled once, and combined by the balance of the object.

Read `maps` (the maps of a scene), `rod` (one equilibrium, an initial value problem), `fill` (all equilibria of a
finger), `balance` (combinations of fingers, settled to the least tension).
"""

from continuum_grasp.grasp.finger_map.balance import WEIGHTS, ObjectBalance, Settled
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.finger_map.maps import Place, SceneMaps, is_mapped, places_of
from continuum_grasp.grasp.finger_map.rod import FOR_STARTS, FULL, MapFinger, rough_distance

__all__ = [
    "FOR_STARTS",
    "FULL",
    "WEIGHTS",
    "FingerMap",
    "MapFinger",
    "ObjectBalance",
    "Place",
    "SceneMaps",
    "Settled",
    "is_mapped",
    "places_of",
    "rough_distance",
]
