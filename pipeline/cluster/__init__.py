"""Run stages on Slurm and on other schedulers."""
