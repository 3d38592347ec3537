"""The finger as differentiable functions of JAX and PyTorch arrays."""
