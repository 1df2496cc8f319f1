"""Shading normals, corner by corner over all faces."""

import numpy as np


def slow_corner_normals(vertices: np.ndarray, faces: np.ndarray, crease: float) -> np.ndarray:
    """Corner by corner, over all faces."""
    normals = []
    for a, b, c in vertices[faces]:
        normal = np.cross(b - a, c - a)
        normals.append(normal / np.linalg.norm(normal))
    out = np.zeros((len(faces), 3, 3))
    for f, face in enumerate(faces):
        for k, vertex in enumerate(face):
            total = np.zeros(3)
            for g, other in enumerate(faces):
                for j in range(3):
                    if (vertices[other[j]] == vertices[vertex]).all():
                        at, ahead, behind = vertices[other[j]], vertices[other[(j + 1) % 3]], vertices[other[(j + 2) % 3]]
                        u, v = (ahead - at) / np.linalg.norm(ahead - at), (behind - at) / np.linalg.norm(behind - at)
                        cosine = normals[f] @ normals[g]
                        if abs(cosine) > np.cos(crease):
                            total += np.sign(cosine) * 2 * np.arctan2(np.linalg.norm(u - v), np.linalg.norm(u + v)) * normals[g]
            out[f, k] = total / np.linalg.norm(total)
    return out
