"""Grasps of exact rods: one problem of small blocks, written for any scene, solved by IPOPT."""
