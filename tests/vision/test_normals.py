import numpy as np
import pytest

from pipeline.kernels.vision import corner_normals as module
from pipeline.kernels.vision.corner_normals import corner_normals
from tests.vision.shapes import CENTRE, ball, box, half_turned


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
                            total += np.sign(cosine) * np.arccos(np.clip(u @ v, -1, 1)) * normals[g]
            out[f, k] = total / np.linalg.norm(total)
    return out


def test_against_the_slow_twin_with_split_vertices_and_mixed_winding() -> None:
    mesh = half_turned(ball(subdivisions=1))
    soup = mesh.vertices[mesh.faces].reshape(-1, 3)  # every corner its own vertex
    faces = np.arange(len(soup), dtype=np.int32).reshape(-1, 3)
    assert corner_normals(soup, faces) == pytest.approx(slow_corner_normals(soup, faces, module.CREASE), abs=1e-12)


def test_a_ball_is_smooth_and_a_box_is_not() -> None:
    mesh = ball(subdivisions=3)
    outward = mesh.vertices[mesh.faces] - CENTRE
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    assert np.einsum("fci,fci->fc", corner_normals(mesh.vertices, mesh.faces), outward).min() > 0.9999
    edged = box()
    normals = corner_normals(edged.vertices, edged.faces)
    assert normals == pytest.approx(np.repeat(normals[:, :1], 3, axis=1), abs=1e-12)


def test_batches_change_nothing(monkeypatch) -> None:
    mesh = ball(subdivisions=2)
    whole = corner_normals(mesh.vertices, mesh.faces)
    monkeypatch.setattr(module, "PAIRS_PER_CHUNK", 50)
    assert (corner_normals(mesh.vertices, mesh.faces) == whole).all()


def test_hubs_and_faces_without_area_have_unit_normals() -> None:
    ring = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    vertices = np.vstack([[0, 0, 1.0], np.column_stack([np.cos(ring), np.sin(ring), 0 * ring])])
    faces = np.column_stack([np.zeros(1000), np.arange(1000) + 1, np.roll(np.arange(1000) + 1, -1)]).astype(np.int32)
    faces = np.vstack([faces, [[1, 1, 2]]]).astype(np.int32)
    normals = corner_normals(vertices, faces)
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(np.ones((1001, 3)))
    assert (normals[:-1, :, 2] > 0.7).all()
