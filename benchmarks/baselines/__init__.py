"""What continuum_grasp is measured against: the paper's equations and other libraries."""
