"""Hands of others, from wheels that `make test-hands` installs: hand files of ours, and what their grasps reach."""
