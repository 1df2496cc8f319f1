"""The stage `train-touch`."""
