"""Objects as convex parts, and the error if their library is missing."""

from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.contrib.exports.convex_parts import convex_parts
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Mesh
from tests.kernels.hand.meshes import centred


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "vt-pipeline" / "convex-parts"


def corner() -> Mesh:
    """Make an L of 5 cm, extruded by 2 cm: two boxes."""
    outline = np.array([[0, 0], [5, 0], [5, 2], [2, 2], [2, 5], [0, 5]]) / 100
    caps = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    points = np.concatenate([np.insert(outline, 2, height, axis=1) for height in (0.0, 0.02)])
    sides = [[[i, j, j + 6], [i, j + 6, i + 6]] for i, j in zip(range(6), [*range(1, 6), 0], strict=True)]
    return centred(trimesh.Trimesh(points, np.concatenate([caps[:, ::-1], caps + 6, *sides]), process=False))


def test_convex_parts_have_the_volume_of_a_concave_object_and_are_cached(cache: Path) -> None:
    mesh, others = corner(), set(cache.glob("*"))
    parts = convex_parts(mesh)
    assert sum(trimesh.convex.convex_hull(part).volume for part in parts) == pytest.approx(16e-4 * 0.02, rel=0.02)
    (stored,) = set(cache.iterdir()) - others
    before = stored.stat().st_mtime_ns
    for part, again in zip(parts, convex_parts(mesh), strict=True):
        np.testing.assert_array_equal(again, part)
    assert stored.stat().st_mtime_ns == before


def test_closed_convex_pieces_are_parts_as_they_are() -> None:
    """A blade in a handle, which overlap: no vertex is moved, and nothing is between them."""
    pieces = [trimesh.creation.box((0.002, 0.02, 0.1)), trimesh.creation.cylinder(radius=0.01, height=0.05, sections=16)]
    pieces[1].apply_translation((0, 0, 0.06))
    mesh = centred(
        trimesh.Trimesh(
            np.concatenate([piece.vertices for piece in pieces]),
            np.concatenate([pieces[0].faces, pieces[1].faces + len(pieces[0].vertices)]),
        )
    )
    parts = sorted(convex_parts(mesh), key=len)
    assert [trimesh.convex.convex_hull(part).volume for part in parts] == pytest.approx([piece.convex_hull.volume for piece in pieces])
    corners = {tuple(vertex) for vertex in mesh.vertices}
    assert all(tuple(vertex) in corners for part in parts for vertex in part)


def test_open_piece_is_split_wherever_it_lies(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A box without one triangle of its lid, below the origin: seen from there it has more than its volume."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.apply_translation((0, 0, -1))
    lid = int((box.face_normals @ (0, 0, 1)).argmax())
    split: list[int] = []

    def run_coacd(mesh: Any, **_: Any) -> list[Any]:
        split.append(len(mesh.indices))
        return []

    monkeypatch.setattr("coacd.run_coacd", run_coacd)
    convex_parts(Mesh.bare(np.array(box.vertices), np.delete(np.array(box.faces), lid, axis=0)))
    assert split == [11]


def test_missing_package_is_reported_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(package: str) -> str:
        raise PackageNotFoundError(package)

    monkeypatch.setattr("pipeline.contrib.exports.convex_parts.version", version)
    with pytest.raises(InvalidInput, match=r"pip install .*'\.\[mujoco\]'"):
        convex_parts(corner())
