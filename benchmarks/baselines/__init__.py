"""What continuum_grasp is measured against: the paper's equations and other libraries."""

VARIABLE = "CONTINUUM_GRASP_PEERS_PYTHON"
"""Names the interpreter that has the other libraries; see ``release_peers``."""
