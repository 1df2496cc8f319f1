"""The report: pages of a dataset and its evaluations."""
