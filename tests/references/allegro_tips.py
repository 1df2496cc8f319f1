"""Tip frames of the Allegro hand, written out joint by joint from the table in its documentation."""

import math

import numpy as np


def tip_frame(finger: str, angles: np.ndarray) -> np.ndarray:
    """(4, 4) frame of a finger's tip link in the palm's, for the joint vector (16,), rad."""
    if finger == "thumb":
        a, b, c, d = angles[12:16]
        base = _shift(-0.0182, 0.019333, -0.045987) @ _turn("z", -1.5707963) @ _turn("y", -1.6580628) @ _turn("x", -a)
        upper = base @ _shift(-0.027, 0.005, 0.0399) @ _turn("z", b) @ _shift(0, 0, 0.0177) @ _turn("y", c)
        return upper @ _shift(0, 0, 0.0514) @ _turn("y", d) @ _shift(0, 0, 0.0303)
    first = {"index": 0, "middle": 4, "ring": 8}[finger]
    y, z, roll = {"index": (0.0435, -0.001542, -0.0872665), "middle": (0, 0.0007, 0), "ring": (-0.0435, -0.001542, 0.0872665)}[finger]
    a, b, c, d = angles[first : first + 4]
    lower = _shift(0, y, z) @ _turn("x", roll) @ _turn("z", a) @ _shift(0, 0, 0.0164) @ _turn("y", b)
    return lower @ _shift(0, 0, 0.054) @ _turn("y", c) @ _shift(0, 0, 0.0384) @ _turn("y", d) @ _shift(0, 0, 0.0147)


def _shift(x: float, y: float, z: float) -> np.ndarray:
    return np.array([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def _turn(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    rows = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]], "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}
    matrix = np.eye(4)
    matrix[:3, :3] = rows[axis]
    return matrix
