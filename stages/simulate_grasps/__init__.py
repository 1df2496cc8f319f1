"""The room of `simulate-grasps`."""
