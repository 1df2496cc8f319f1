"""Rigid transforms, equal to the last bit on every x86-64 processor.

`@` and `np.linalg` hand small matrices to BLAS and LAPACK, which round differently from one processor to the next. So do the sines of
numpy and of the C library. Here products are added in a fixed order, and sines are rounded from extended precision.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled


def compose(
    left: Array,  # (..., N, K)
    right: Array,  # (..., K, M); leading dimensions broadcast
) -> Array:  # (..., N, M)
    """Multiply matrices, as `left @ right` does."""
    if left.shape[-1] != right.shape[-2]:
        raise ValueError(f"matrices of shapes {left.shape} and {right.shape} have no product")
    product = 0.0 + left[..., :, :1] * right[..., :1, :]  # 0.0 + makes a negative zero positive, as a sum does
    for k in range(1, left.shape[-1]):
        product += left[..., :, k : k + 1] * right[..., k : k + 1, :]
    return np.asarray(product)


def transform_points(
    pose: Array,  # (..., 4, 4), from the points' frame to the target frame
    points: Array,  # (..., P, 3) m; leading dimensions broadcast
) -> Array:  # (..., P, 3) target frame, m
    """Transform points by poses."""
    turned = np.einsum("...ij,...pj->...pi", pose[..., :3, :3], points)  # einsum calls no BLAS unless it is asked to optimise
    return np.asarray(turned + pose[..., None, :3, 3])


def invert_pose(pose: Array) -> Array:
    """Invert rigid transforms (..., 4, 4), whose axes are orthonormal."""
    inverse = pose.copy()
    inverse[..., :3, :3] = np.swapaxes(pose[..., :3, :3], -1, -2)
    inverse[..., :3, 3] = -np.einsum("...ij,...j->...i", inverse[..., :3, :3], pose[..., :3, 3])
    return inverse


def pose_of(
    rotation: ArrayLike,  # (3, 3), or one times a scale
    position: ArrayLike,  # (3,)
) -> Array:  # (4, 4)
    """Make the matrix that turns (and scales), then shifts."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def scaling_about(centre: ArrayLike, factor: float) -> Array:
    """Make the scaling (4, 4) by a factor that leaves a point (3,) where it is."""
    scaling = np.diag([factor, factor, factor, 1.0])
    scaling[:3, 3] = (1 - factor) * np.asarray(centre, np.float64)
    return scaling


def frame_and_scale(similarity: Array) -> tuple[Array, float]:
    """Split a rigid transform with one scale (4, 4) into the rigid one, and the scale."""
    scale = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
    frame = similarity.copy()
    frame[:3, :3] /= scale
    return frame, scale


def invert_similarity(similarity: Array) -> Array:
    """Invert a rigid transform with one scale (4, 4): its axes are orthogonal, and the scale is their length."""
    squared = float((similarity[:3, 0] ** 2).sum())
    inverse = invert_pose(similarity)
    inverse[:3] /= squared
    return inverse


@compiled
def solve_3x3(matrix: Array, target: Array) -> Array:
    """Solve `matrix` (3, 3) x = `target` (3,) by Cramer's rule, whose error grows with the matrix's condition."""
    crosses = np.empty((3, 3))  # of the two columns after each
    for k in range(3):
        a, b = matrix[:, (k + 1) % 3], matrix[:, (k + 2) % 3]
        for i in range(3):
            crosses[k, i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]
    determinant = crosses[0, 0] * matrix[0, 0] + crosses[0, 1] * matrix[1, 0] + crosses[0, 2] * matrix[2, 0]
    solution: Array = (crosses[:, 0] * target[0] + crosses[:, 1] * target[1] + crosses[:, 2] * target[2]) / determinant
    return solution


def solve_linear(matrix: Array, target: Array) -> Array:  # (N,)
    """Solve `matrix` (N, N) x = `target` (N,) by elimination with pivots."""
    rows = np.column_stack([matrix, target])
    for k in range(len(rows)):
        pivot = k + int(np.abs(rows[k:, k]).argmax())
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k] /= rows[k, k]
        others = np.arange(len(rows)) != k
        rows[others] -= rows[others, k : k + 1] * rows[k]
    return np.asarray(rows[:, -1])


def length(vectors: ArrayLike) -> Array:
    """Compute the Euclidean lengths (...) of vectors (..., N); `np.linalg.norm` without an axis would call BLAS."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def unit_vectors(vectors: ArrayLike) -> Array:
    """Scale vectors (..., N) to length 1; zero stays zero."""
    return np.asarray(np.asarray(vectors) / np.maximum(length(vectors), np.finfo(np.float64).tiny)[..., None])


def sin_cos(angles: ArrayLike) -> tuple[Array, Array]:
    """Compute sines and cosines of angles (...), rad, rounded from extended precision."""
    extended = np.asarray(angles, np.longdouble)
    return np.sin(extended).astype(np.float64), np.cos(extended).astype(np.float64)


def rotation_from_euler(angles: ArrayLike) -> Array:
    """Compute the rotation (3, 3) by angles (3,), rad, about the fixed x axis first, then y, then z: R = Rz Ry Rx."""
    (sx, sy, sz), (cx, cy, cz) = sin_cos(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return compose(compose(about_z, about_y), about_x)
