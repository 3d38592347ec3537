"""Options of commands that have no place beside others, or with such a file."""

from __future__ import annotations

from continuum_grasp.scene.consumer import Consumer

LOOPS = Consumer("mpc of a closed loop", {"--trials": "is for missions"})
MISSIONS = Consumer("mpc of a mission", {"--compare": "is not for missions"})
TRIALS = Consumer("mpc --trials", {"--animate": "is for one mission, not for --trials"})
DESIGN = Consumer("identify --design", {"--apply": "has no effect on --design"})
