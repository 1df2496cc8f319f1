"""Files and sensors of hands are kept until a file changes."""

import os
from types import SimpleNamespace

from pipeline.formats import hand_listing
from pipeline.formats.hand_listing import HandListing, list_hand


def test_hand_is_read_again_when_a_file_changes_or_another_appears(tmp_path, monkeypatch):
    file, mesh = tmp_path / "hand" / "hand.yaml", tmp_path / "hand" / "meshes" / "palm.stl"
    mesh.parent.mkdir(parents=True)
    for path in (file, mesh):
        path.write_text("old")
    os.utime(mesh.parent, (0, 0))
    hand = SimpleNamespace(files=[file, mesh], sensors=[SimpleNamespace(sensor="gelsight")], links=())
    loaded = []
    monkeypatch.setattr(hand_listing, "load_hand", lambda name: loaded.append(name) or hand)
    monkeypatch.setattr(hand_listing, "KEPT", tmp_path / "kept" / "hands.json")
    changes = (lambda: None, lambda: None, lambda: mesh.write_text("another"), mesh.with_suffix(".mtl").touch)
    for change, times in zip(changes, (1, 1, 2, 3), strict=True):
        change()
        assert list_hand(file) == HandListing([file, mesh], ["gelsight"])
        assert len(loaded) == times
