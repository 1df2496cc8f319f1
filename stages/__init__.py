"""One room a stage: opens its inputs, calls kernels, returns a row an object."""
