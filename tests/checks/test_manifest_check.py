"""`vt-pipeline check` of a manifest reads every object: size, unit, faces, textures and faults."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from pipeline.checks import manifest_check
from pipeline.checks.description_checks import check_file, described_file
from pipeline.checks.manifest_check import MeshFiles
from pipeline.errors import InvalidInput
from tests.command_line import vt

SODA = """mtllib soda.mtl
usemtl m
v 0 0 0\nv 66 0 0\nv 0 66 0\nv 0 0 120
vt 0 0\nvt 1 0\nvt 0 1
f 1/1 2/2 3/3\nf 1/1 2/2 4/3
"""


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    """Write a box in mm, a can without its texture, and a file that is no mesh."""
    folder = tmp_path / "meshes"
    (folder / "boxes").mkdir(parents=True)
    trimesh.creation.box((80, 60, 120)).export(folder / "boxes" / "tea.stl")
    (folder / "soda.obj").write_text(SODA)
    (folder / "soda.mtl").write_text("newmtl m\nmap_Kd textures/soda.png\n")
    (folder / "broken.ply").write_text("ply\nnothing")
    return folder


def check(tmp_path: Path, folder: Path, **stated: str) -> list[str]:
    return check_file(described_file("directory", tmp_path / "a.png"), MeshFiles(folder, **stated))


def test_picture_shows_the_meshes(tmp_path: Path, meshes: Path) -> None:
    check(tmp_path, meshes)
    with Image.open(tmp_path / "a.png") as picture:
        gray = np.asarray(picture.convert("L"))
    lowest = gray[-150:-20]  # beyond the bars: two meshes on the scene's background
    assert np.ptp(lowest, axis=0).max() > 50
    assert len(np.unique(lowest)) > 30  # shaded


def row(lines: list[str], name: str) -> list[str]:
    """Split the row of an object, whose cells are two spaces apart or more."""
    (found,) = (line for line in lines if line.startswith(f"  {name} "))
    return [cell.strip() for cell in found.split("  ") if cell.strip()]


def test_sizes_units_textures_and_files_that_are_no_meshes_are_listed(tmp_path: Path, meshes: Path) -> None:
    lines = check(tmp_path, meshes, units="mm")
    assert lines[0].endswith("manifest directory, 3 objects, 1 of them cannot be used")
    assert row(lines, "boxes-tea") == ["boxes-tea", "0.08 × 0.06 × 0.12", "mm, --units", "12", "0", "yes"]
    assert row(lines, "soda") == ["soda", "0.066 × 0.066 × 0.12", "mm, --units", "2", "0, 1 missing or unread", "no"]
    (fault,) = (line for line in lines if line.startswith("fault:"))
    assert fault.startswith("fault: broken: broken.ply: it has no header that begins with ply")
    (warning,) = (line for line in lines if line.startswith("warning:"))
    assert warning == "warning: 1 object not read in full (soda); in soda: textures/soda.png is missing below the folder of meshes"
    assert (tmp_path / "a.png").exists()


def test_unlikely_unit_is_reported_for_objects_of_implausible_size(tmp_path: Path, meshes: Path) -> None:
    assert "warning: boxes-tea is 156 m large: is the unit mm?" in check(tmp_path, meshes, units="m")
    trimesh.creation.box((0.1, 0.2, 0.3)).export(meshes / "case.glb")
    lines = check(tmp_path, meshes, units="mm")
    assert row(lines, "case")[2] == "mm, --units (its file: m)"
    assert "warning: case is 0.000374 m large: is the unit m?" in lines


def test_objects_without_a_unit_are_scaled_and_the_likely_unit_is_named(tmp_path: Path, meshes: Path) -> None:
    trimesh.creation.box((0.1, 0.2, 0.3)).export(meshes / "case.glb")
    lines = check(tmp_path, meshes)
    assert row(lines, "case")[1:3] == ["0.1 × 0.3 × 0.2", "m, its file"]  # y is up
    assert row(lines, "boxes-tea")[1:3] == ["0.256 × 0.192 × 0.384", "none: scaled"]
    assert any(line.startswith("2 objects without a unit, scaled to") for line in lines)  # the broken file is not counted
    assert "their files state diagonals from 152 to 156 without a unit, half of them at most 156: 0.16 m if the unit is mm" in lines


def test_sizes_of_many_objects_are_summarised_and_only_faults_are_listed(tmp_path: Path, meshes: Path, monkeypatch) -> None:
    monkeypatch.setattr(manifest_check, "LISTED", 2)
    for number in range(3):
        trimesh.creation.box((80, 60, 130 + number)).export(meshes / "boxes" / f"{number}.stl")
    lines = check(tmp_path, meshes, units="mm")
    assert row(lines, "largest") == ["largest", "0.166", "166", "12", "boxes-2"]
    assert row(lines, "soda")[4] == "0, 1 missing or unread"
    assert not any(line.startswith("  boxes-tea ") for line in lines)


def test_command_exits_with_1_if_an_object_cannot_be_used(tmp_path: Path, meshes: Path) -> None:
    arguments = ["check", "directory", "--objects", meshes, "--units", "mm", "--picture", tmp_path / "a.png"]
    vt(*arguments, fails=True)
    (meshes / "broken.ply").unlink()
    assert "manifest directory, 2 objects, no faults" in vt(*arguments)


def test_only_a_manifest_takes_a_folder_and_units(tmp_path: Path, meshes: Path) -> None:
    with pytest.raises(InvalidInput, match="is a scene file; only a manifest takes a folder of objects"):
        check_file(described_file("supplement", tmp_path / "a.png"), MeshFiles(meshes))
    with pytest.raises(InvalidInput, match="names its own objects"):
        check_file(described_file("one-of-each", tmp_path / "a.png"), MeshFiles(meshes))


def test_one_file_in_several_splits_is_reported(tmp_path: Path) -> None:
    for split in ("train", "test"):
        (tmp_path / split).mkdir()
        trimesh.creation.box().export(tmp_path / split / f"{split}.stl")
    sources = [{"kind": "directory", "licence": "CC0", "path": str(tmp_path / split), "split": split} for split in ("train", "test")]
    described = {"name": "twice", "description": "d", "seed": 0, "splits": {"train": 0.5, "valid": 0.25, "test": 0.25}, "sources": sources}
    (tmp_path / "twice.yaml").write_text(yaml.safe_dump(described))
    lines = check_file(described_file(str(tmp_path / "twice.yaml"), tmp_path / "p.png"), MeshFiles(None))
    assert "warning: the same file in several splits: test (test), train (train)" in lines
