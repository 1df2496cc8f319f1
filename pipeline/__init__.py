"""What the stages stand on: the runner, the store, and kernels."""
