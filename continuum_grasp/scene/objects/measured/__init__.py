"""Measured curves, of pictures and digitized points, as lines and arcs within their noise."""

from continuum_grasp.scene.objects.measured.fit import FittedCurve, Sampling, fitted

__all__ = ["FittedCurve", "Sampling", "fitted"]
