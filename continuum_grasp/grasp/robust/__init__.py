"""Grasps that hold although the object is not quite where and what it should be."""
