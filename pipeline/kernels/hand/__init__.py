"""Geometry of a robot hand: kinematics, collision shapes, distances to an object, inverse kinematics.

Valid range: finite coordinates in metres within 10 m of the origin, sizes from 1 mm to 1 km; any meshes, open and with slivers too.
"""
