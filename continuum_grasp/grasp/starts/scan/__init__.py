"""Postures of one finger that touch an object, by scans over curvatures and contact positions."""
