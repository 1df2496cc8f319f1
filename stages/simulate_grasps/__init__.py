"""The stage `simulate-grasps`."""
