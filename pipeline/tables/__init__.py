"""Tables of a dataset and its evaluations."""
