"""Publishing replaces a folder atomically."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest

from pipeline.store.atomic import move_folder


def test_published_folder_stays_whole_until_its_replacement_is_in_place(tmp_path, monkeypatch):
    source, target = tmp_path / "work/new", tmp_path / "data/group.zarr"
    for folder, content in ((source, "new"), (target, "old")):
        folder.mkdir(parents=True)
        (folder / "zarr.json").write_text(content)
    removed, rmtree = [], shutil.rmtree

    def remove(folder: Path, **options: bool) -> None:
        removed.append(folder)
        rmtree(folder, **options)

    monkeypatch.setattr(shutil, "rmtree", remove)
    move_folder(source, target)
    assert target not in removed
    assert (target / "zarr.json").read_text() == "new"
    assert [path.name for path in target.parent.iterdir()] == [target.name], "nothing is left of the old one"


MEMORY = Path("/dev/shm")


@pytest.mark.skipif(not MEMORY.is_dir() or MEMORY.stat().st_dev == os.stat(tempfile.gettempdir()).st_dev, reason="there is one disk")
def test_folder_is_published_through_a_link_to_another_disk(tmp_path):
    with tempfile.TemporaryDirectory(dir=MEMORY) as elsewhere:
        (tmp_path / "data").symlink_to(elsewhere)
        for content in ("first", "second"):
            (source := tmp_path / "work" / "new").mkdir(parents=True)
            (source / "zarr.json").write_text(content)
            move_folder(source, tmp_path / "data" / "group.zarr")
            assert not source.exists()
            assert (Path(elsewhere) / "group.zarr" / "zarr.json").read_text() == content
        assert os.listdir(elsewhere) == ["group.zarr"]
