"""The grasp as a nonlinear problem (NLP), and IPOPT on it."""
