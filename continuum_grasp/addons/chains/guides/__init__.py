"""Plants of ``plant.guides``: fingers as chains of hinges with a guide of their tendons at each, the finest plants."""
