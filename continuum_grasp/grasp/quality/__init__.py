"""Indices of quality and resistance to disturbances, by numpy and linear programming."""
