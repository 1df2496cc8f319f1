"""Own files that a recipe carries: what they name must lie among them."""

from pathlib import Path

import pytest
import yaml

from pipeline.errors import InvalidInput
from pipeline.export.own_files import read_files

URDF = '<robot name="a"><link name="palm"><visual><geometry><mesh filename="palm.obj"/></geometry></visual></link></robot>'


def test_texture_of_a_hands_mesh_outside_the_folder_is_refused(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.mkdir()
    (own / "hand.yaml").write_text(yaml.safe_dump({"urdf": "hand.urdf"}))
    (own / "hand.urdf").write_text(URDF)
    (own / "palm.obj").write_text("mtllib palm.mtl\n")
    (own / "palm.mtl").write_text("newmtl a\nmap_Kd skin.png\n")
    (own / "skin.png").write_bytes(b"x")
    assert list(read_files({"hand.yaml": own / "hand.yaml"})[0]) == ["hand.yaml"]
    (own / "skin.png").rename(tmp_path / "skin.png")  # in the package, the folder above the URDF's: the hand's reader would open it
    with pytest.raises(InvalidInput, match=r"hand\.yaml names 'skin\.png'"):
        read_files({"hand.yaml": own / "hand.yaml"})
