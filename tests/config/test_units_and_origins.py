"""A user's folder of meshes: units, up-axis, textures, files left out, and the placement that leads back to the file."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.console import abbreviate
from pipeline.dataset.object_rows import ObjectRows
from pipeline.formats.mesh_reader import load_mesh
from tests.command_line import invoke, vt

CORNERS = np.array([[0, 0, 0], [30, 0, 0], [0, 20, 0], [0, 0, 10.0]])
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


def run(folder: Path, data: Path, *more: str) -> str:
    command = ["run", "sample-surfaces", "--manifest", "directory", "--objects", str(folder), "--data", str(data), "--set", "points=100"]
    return vt(*command, "--executor", "serial", *more)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    meshes = tmp_path / "my own meshes"
    meshes.mkdir()
    trimesh.Trimesh(CORNERS + [1000, 0, 0], FACES, process=False).export(meshes / "wedge.ply")
    return meshes


def test_placement_maps_file_vertices_to_the_world_and_back(folder: Path, tmp_path: Path) -> None:
    """The stored vertices are the placed vertices of the file; with mm and y up, distances are those of the file / 1000."""
    output = run(folder, tmp_path / "d", "--units", "mm", "--up", "y")
    assert "scaled to a diagonal" not in output
    names = ["placement", "source_file", "source_sha256", "licence", "metres_per_unit"]
    rows = ObjectRows(tmp_path / "d", names, None)
    placement, file, checksum, licence, unit = (rows.read(name, "wedge") for name in names)
    source = load_mesh(folder / "wedge.ply").vertices
    world = source @ placement[:3, :3].T + placement[:3, 3]
    (shard,) = (tmp_path / "d" / "surfaces").glob("*.zarr")
    import zarr

    stored = np.asarray(zarr.open_group(str(shard), mode="r")["meshes/wedge/vertices"])
    assert np.abs(np.sort(world, axis=0) - np.sort(stored, axis=0)).max() < 1e-9
    back = (stored - placement[:3, 3]) @ np.linalg.inv(placement[:3, :3]).T
    assert np.abs(np.sort(back, axis=0) - np.sort(source, axis=0)).max() / 1000 < 1e-9  # m
    np.testing.assert_allclose(np.ptp(stored, axis=0), [0.03, 0.01, 0.02], atol=1e-9)  # y became z
    assert (str(file), str(licence), float(unit)) == ("wedge.ply", "the user's own", 0.001)
    assert len(str(checksum)) == 64


def test_objects_without_units_are_scaled_and_reported(folder: Path, tmp_path: Path) -> None:
    output = run(folder, tmp_path / "d")
    assert "1 object without a unit, scaled to a diagonal of 0.5 m where it can be read; --units mm (make: UNITS=mm)" in output


def test_file_with_a_unit_among_files_without_is_warned_of(folder: Path, tmp_path: Path) -> None:
    trimesh.Trimesh(CORNERS / 100, FACES, process=False).export(folder / "mug.glb")
    mixed = "warning: sizes are mixed: 1 object (mug) not scaled, because files or manifest state a unit; write a manifest with a folder"
    look = ["check", "directory", "--picture", str(tmp_path / "a.png")]
    for command in (look, ["run", "sample-surfaces", "--manifest", "directory", "--data", str(tmp_path / "d"), "--dry-run"]):
        assert mixed in invoke(*command, "--objects", folder)[1]
    assert "sizes are mixed" not in vt(*look, "--objects", str(folder), "--units", "cm")


def test_files_that_are_not_meshes_are_reported_with_the_reason(folder: Path, tmp_path: Path) -> None:
    (folder / "part.step").write_text("x")
    (tmp_path / "elsewhere").mkdir()
    (folder / "linked").symlink_to(tmp_path / "elsewhere")
    output = run(folder, tmp_path / "d")
    assert "skipped 1 file (part.step): .step cannot be read; convert to one of .obj" in output
    assert "skipped 1 file (linked): links to folders are not followed" in output


def test_missing_textures_are_stored_and_reported(folder: Path, tmp_path: Path) -> None:
    missing = [f"textures/gone-{number}.png" for number in range(6)]
    (folder / "bare.mtl").write_text("\n".join(f"newmtl {name[-5]}\nKd 1 0 0\nmap_Kd {name}" for name in missing))
    lines = [
        "mtllib bare.mtl",
        *(f"v {x} {y} {z}" for x, y, z in CORNERS),
        "usemtl 0",
        *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES),
    ]
    (folder / "bare.obj").write_text("\n".join(lines))
    output = run(folder, tmp_path / "d")
    unread = [f"{name} is missing below the folder of meshes" for name in missing]
    assert f"warning: 1 object not read in full (bare); in bare: {abbreviate(unread)}" in output
    rows = ObjectRows(tmp_path / "d", ["unread"], None)
    assert [str(rows.read("unread", name)) for name in ("bare", "wedge")] == ["\n".join(unread), ""], "all of them are stored"
