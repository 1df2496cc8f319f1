"""Publishing replaces a folder atomically."""

from __future__ import annotations

import shutil
from pathlib import Path

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
