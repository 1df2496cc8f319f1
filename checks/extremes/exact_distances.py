"""Twins in rational arithmetic: whatever the scale and the place, they do not round before the last step."""

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise

import numpy as np

Vector = tuple[Fraction, Fraction, Fraction]


def vectors(points: np.ndarray) -> list[Vector]:
    """Points (N, 3) of any floating type, as they are stored."""
    return [(Fraction(x), Fraction(y), Fraction(z)) for x, y, z in np.asarray(points, np.float64).tolist()]


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def dot(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def nearest_squared(query: np.ndarray, points: np.ndarray) -> list[Fraction]:
    """Of each query (N, 3), the squared distance to the nearest of the points (M, 3)."""
    others = vectors(points)
    return [min(dot(d, d) for d in (minus(q, p) for p in others)) for q in vectors(query)]


def mean(values: Sequence[Fraction]) -> Fraction:
    return sum(values, Fraction(0)) / len(values)


def chamfer(a: np.ndarray, b: np.ndarray) -> float:
    return float(mean(nearest_squared(a, b)) + mean(nearest_squared(b, a)))


def areas(vertices: np.ndarray, faces: np.ndarray) -> list[float]:
    """(F,) the area of each face."""
    corners = vectors(vertices)
    found = []
    for i, j, k in faces.tolist():
        normal = cross(minus(corners[j], corners[i]), minus(corners[k], corners[i]))
        found.append(math.sqrt(dot(normal, normal)) / 2)
    return found


def squared_to_surface(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> list[Fraction]:
    """(N,) from each point the squared distance to the nearest place of a triangle; also to triangles that are segments or points."""
    corners = vectors(vertices)
    triangles = [[corners[i] for i in face] for face in faces.tolist()]
    return [min(_to_triangle(point, triangle) for triangle in triangles) for point in vectors(points)]


def _to_triangle(point: Vector, triangle: list[Vector]) -> Fraction:
    a, b, c = triangle
    best = min(_to_segment(point, start, end) for start, end in pairwise([a, b, c, a]))
    normal = cross(minus(b, a), minus(c, a))
    size = dot(normal, normal)
    if size:
        over = dot(minus(point, a), normal)
        sides = [dot(cross(minus(end, start), minus(point, start)), normal) for start, end in pairwise([a, b, c, a])]
        if min(sides) >= 0:
            best = min(best, over * over / size)
    return best


def _to_segment(point: Vector, start: Vector, end: Vector) -> Fraction:
    along, there = minus(end, start), minus(point, start)
    length = dot(along, along)
    share = min(max(dot(there, along) / length, Fraction(0)), Fraction(1)) if length else Fraction(0)
    rest = (there[0] - share * along[0], there[1] - share * along[1], there[2] - share * along[2])
    return dot(rest, rest)
