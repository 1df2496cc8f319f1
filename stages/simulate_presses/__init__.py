"""The stage `simulate-presses`."""
