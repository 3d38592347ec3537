"""The closed loop: a controller tried on a plant that differs from what it knows."""
