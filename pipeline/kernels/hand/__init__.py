"""Geometry of a robot hand: kinematics, collision shapes, distances to an object, inverse kinematics.

Valid range, held by the tests: finite coordinates in metres within 10 m of the origin, sizes from 1 mm to 1 km. Meshes may be open, wound
either way, and hold slivers, doubled faces and faces without area.
"""
