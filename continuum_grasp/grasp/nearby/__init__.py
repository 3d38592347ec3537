"""A grasp at scenes nearby: found again from its own numbers, and how it changes with them."""
