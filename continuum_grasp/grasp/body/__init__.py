"""Bodies that a grasp holds, in the plane and in space: exact distances, and tables of them for the solver."""
