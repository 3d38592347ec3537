"""Closed loops by the package and by other solvers of receding-horizon problems, compiled and run side by side."""
