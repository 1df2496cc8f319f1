"""Depth of every ray against all faces, in float64."""

from dataclasses import dataclass

import numpy as np

CHUNK = 2_000_000
"""Ray-face pairs at a time, for memory."""


@dataclass
class BruteForce:
    """Depth of every ray, |cos| between ray and normal there (1 for a miss), and what float64 leaves open.

    `doubtful` is True where the ray passes, up to the range, within `RIM` (in barycentric coordinates) of some face's
    rim, which it may or may not meet, or meets a face at less than `FLAT` radians.
    """

    depth: np.ndarray
    cosine: np.ndarray
    doubtful: np.ndarray


RIM = 1e-9
FLAT = 1e-3


def brute_force(triangles: np.ndarray, origins: np.ndarray, direction: np.ndarray, reach: float) -> BruteForce:
    """Möller & Trumbore 1997 in the world frame: all rays against all faces, rims included."""
    shape = origins.shape[:-1]
    origins = origins.reshape(-1, 3)
    depth = np.full(len(origins), np.inf)
    cosine = np.ones(len(origins))
    doubtful = np.zeros(len(origins), bool)
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(direction, edge2)
    det = (edge1 * p).sum(-1)
    area = np.linalg.norm(np.cross(edge1, edge2), axis=-1)
    kept = np.abs(det) > 1e-15 * area
    triangles, edge1, edge2, p, det, area = (a[kept] for a in (triangles, edge1, edge2, p, det, area))
    step = max(1, CHUNK // max(1, len(triangles)))
    for first in range(0, len(origins) if len(triangles) else 0, step):
        s = origins[first : first + step, None] - triangles[None, :, 0]
        u = np.einsum("rfk,fk->rf", s, p) / det
        q = np.cross(s, edge1)
        v = q @ direction / det
        t = np.einsum("rfk,fk->rf", q, edge2) / det
        margin = np.minimum(np.minimum(u, v), 1 - u - v)
        ahead = (t >= -1e-9) & (t <= reach)
        met = np.where((margin >= 0) & ahead, np.maximum(t, 0), np.inf)
        face = met.argmin(axis=1)
        depth[first : first + step] = met.min(axis=1)
        cosine[first : first + step] = np.where(np.isfinite(met.min(axis=1)), (np.abs(det) / area)[face], 1)
        steep = np.abs(det) < FLAT * area
        doubtful[first : first + step] = (ahead & ((np.abs(margin) < RIM) | (steep & (margin > -RIM)))).any(axis=1)
    return BruteForce(depth.reshape(shape), cosine.reshape(shape), doubtful.reshape(shape))
