"""Grasps solved another way: geometry by scans and roots, forces by linear programming.

Nothing of the package's own mechanics, starts or certificate is used; of the package only the scene's classes are read.
Units are SI, positions are in the world frame.
"""
