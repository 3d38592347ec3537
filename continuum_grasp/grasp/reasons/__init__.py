"""Why there is no grasp, and what would repair it."""
