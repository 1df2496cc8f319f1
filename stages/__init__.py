"""The stages, one folder each: a stage opens its inputs, calls kernels and returns a row per object."""
