"""Placeholder."""
def add_disturbances(problem):
    raise NotImplementedError
