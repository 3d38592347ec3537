"""The grasp as a nonlinear programme, and IPOPT on it."""
