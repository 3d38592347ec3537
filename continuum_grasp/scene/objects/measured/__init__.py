"""Measured curves, of pictures and digitized points, as lines and arcs within their noise."""
