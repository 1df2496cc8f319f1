"""Geometry in fractions, without rounding."""

from fractions import Fraction

import numpy as np


def cross_product(triangle: np.ndarray) -> list[Fraction]:
    """Cross product of two edges of a triangle (3, 3)."""
    a, b, c = ([Fraction(float(x)) for x in corner] for corner in triangle)
    u, v = [q - p for p, q in zip(a, b, strict=True)], [q - p for p, q in zip(a, c, strict=True)]
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def intersect_ray(face: np.ndarray, x: float, y: float) -> tuple[Fraction, Fraction, Fraction] | None:
    """Intersect a ray along z at (x, y) with a face (3, 3).

    Returns the height of the face's plane, the least barycentric weight (how far inside the rim), and the plane's slope; None where
    the face is edge-on.
    """
    a, b, c = ([Fraction(float(v)) for v in corner] for corner in face)
    u, v = Fraction(x), Fraction(y)

    def area(p: list[Fraction], q: list[Fraction]) -> Fraction:
        return (p[0] - u) * (q[1] - v) - (q[0] - u) * (p[1] - v)

    areas = area(b, c), area(c, a), area(a, b)
    whole = sum(areas, Fraction(0))
    if whole == 0:
        return None
    weights = [part / whole for part in areas]
    z = sum((w * corner[2] for w, corner in zip(weights, (a, b, c), strict=True)), Fraction(0))
    slope = max(abs((b[k] - a[k]) * (c[2] - a[2]) - (c[k] - a[k]) * (b[2] - a[2])) for k in (0, 1)) / abs(whole)
    return z, min(weights), slope
