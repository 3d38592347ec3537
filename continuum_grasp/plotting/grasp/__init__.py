"""Pictures of grasps."""
