"""The finger map: equilibria of one finger that touch, sampled once, combined by the object's balance, and settled.

Read `rod` (one equilibrium, an initial value problem, of the exact rod or of few elements), `fill` (all of a finger),
`balance` (combinations of fingers),
`stability` (what a small motion meets), `settled` (the starts that a search takes).
"""

from continuum_grasp.grasp.finger_map.balance import SETTLED
from continuum_grasp.grasp.finger_map.rod import FEW
from continuum_grasp.grasp.finger_map.settled import ROUGH, Place, SceneMaps, is_mapped, places_of

__all__ = ["FEW", "ROUGH", "SETTLED", "Place", "SceneMaps", "is_mapped", "places_of"]
