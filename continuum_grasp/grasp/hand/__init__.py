"""Grasps of hands in space: fingers in planes of their own, an object with six balances."""
