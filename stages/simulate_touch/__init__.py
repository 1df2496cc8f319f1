"""The stage `simulate-touch`."""
