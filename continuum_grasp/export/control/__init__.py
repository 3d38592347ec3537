"""Estimator and controller of a closed loop, as parts of a package."""
