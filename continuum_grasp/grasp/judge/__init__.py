"""The certificate of grasps of rods: what a grasp claims, computed anew from the scene, in the plane and in space."""
