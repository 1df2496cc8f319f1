"""Description files that a recipe carries may only name files among them."""

from pathlib import Path

import pytest
import yaml

from pipeline.errors import InvalidInput
from pipeline.recipes.own_files import read_files

URDF = '<robot name="a"><link name="palm"><visual><geometry><mesh filename="palm.obj"/></geometry></visual></link></robot>'


def test_texture_of_a_hands_mesh_outside_the_folder_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "hand.yaml").write_text(yaml.safe_dump({"urdf": "hand.urdf"}))
    (folder / "hand.urdf").write_text(URDF)
    (folder / "palm.obj").write_text("mtllib palm.mtl\n")
    (folder / "palm.mtl").write_text("newmtl a\nmap_Kd skin.png\n")
    (folder / "skin.png").write_bytes(b"x")
    assert list(read_files({"hand.yaml": folder / "hand.yaml"})[0]) == ["hand.yaml"]
    (folder / "skin.png").rename(
        tmp_path / "skin.png"
    )  # the folder above is in the package of the URDF, so that loading the hand would open it
    with pytest.raises(InvalidInput, match=r"hand\.yaml names 'skin\.png'"):
        read_files({"hand.yaml": folder / "hand.yaml"})
