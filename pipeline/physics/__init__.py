"""Hands and objects in a physics engine: closing the fingers, and whether a grasp holds."""
