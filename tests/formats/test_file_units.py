"""Units and up-axes that mesh files state."""

import io
import os
import stat
import zipfile
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
import trimesh

from pipeline.config.manifest import load_manifest
from pipeline.errors import InvalidInput
from pipeline.formats.file_units import stated_units
from pipeline.formats.mesh_reader import load_mesh
from pipeline.formats.urdf_shapes import shape_of
from tests.collada_text import collada_text

SIDES = (30.0, 20.0, 10.0)


def collada(path: Path, *assets: str) -> Path:
    """Write a box of `SIDES` units whose asset element holds `assets`."""
    path.write_text(collada_text(trimesh.creation.box(SIDES), *assets))
    return path


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_unit_is_read_in_the_encoding_of_the_byte_order_mark(tmp_path: Path, encoding: str) -> None:
    text = collada(tmp_path / "a.dae", "<unit meter='0.0254'/>", "<up_axis>Z_UP</up_axis>").read_text()
    (tmp_path / "a.dae").write_bytes((text + "<!-- -->" * 10_000).encode(encoding))
    assert stated_units(tmp_path / "a.dae") == (0.0254, "z")


@pytest.mark.parametrize(
    ("assets", "expected"),
    [
        (("<unit name='inch' meter='0.0254'/>", "<up_axis>Z_UP</up_axis>"), (0.0254, "z")),
        (('<unit meter="1e-3" name="mm"/>',), (0.001, "y")),
        (("<!-- <unit meter='1'/> <up_axis>Z_UP</up_axis> -->", "<unit meter='0.0254'/>"), (0.0254, "y")),
        (("<up_axis>X_UP</up_axis>",), (None, "x")),
        (("<unit meter='0'/>",), (None, "y")),
        (("<unit meter='nan'/>",), (None, "y")),
        (("<unit meter='1e-300'/>",), (None, "y")),
        (("<unit meter='many'/>",), (None, "y")),
    ],
)
def test_unit_and_axis_of_collada_are_read(tmp_path: Path, assets: tuple[str, ...], expected: tuple[float | None, str]) -> None:
    path = collada(tmp_path / "box.dae", *assets)
    assert stated_units(path) == expected
    assert len(load_mesh(path).faces) == 12  # the file can be read whatever it states


@pytest.mark.parametrize(("unit", "metres"), [(' unit="inch"', 0.0254), ("", 0.001), (' unit="furlong"', None)])
def test_unit_of_3mf_is_read(tmp_path: Path, unit: str, metres: float | None) -> None:
    content = trimesh.creation.box(SIDES).export(file_type="3mf")
    (tmp_path / "made.3mf").write_bytes(content)
    with zipfile.ZipFile(tmp_path / "made.3mf") as source, zipfile.ZipFile(tmp_path / "box.3mf", "w") as archive:
        for name in source.namelist():
            archive.writestr(name, source.read(name).replace(b' unit="millimeter"', unit.encode()))
    assert stated_units(tmp_path / "box.3mf") == (metres, "z")
    assert len(load_mesh(tmp_path / "box.3mf").faces) == 12


def _bad_3mf(path: Path, fault: str) -> None:
    """Write a 3MF file of a box whose archive is damaged."""
    with zipfile.ZipFile(io.BytesIO(trimesh.creation.box(SIDES).export(file_type="3mf"))) as source, zipfile.ZipFile(path, "w") as archive:
        for name in source.namelist():
            archive.writestr(name, source.read(name), zipfile.ZIP_LZMA if fault == "damaged LZMA" else zipfile.ZIP_STORED)
    content = bytearray(path.read_bytes())
    entry = content.index(b"PK\1\2", content.index(b"[Content_Types].xml"))  # the first of the list of members, the model's
    match fault:
        case "name not UTF-8":
            content[entry + 9] |= 8  # marks the name as UTF-8
            content[entry + 46] = 0xFF
        case "member past the end":
            content[entry + 20 : entry + 28] = (2**31 - 1).to_bytes(4, "little") * 2  # compressed and uncompressed size
        case "damaged LZMA":
            start = content.index(b"3D/3dmodel.model") + len("3D/3dmodel.model") + 9
            content[start : start + 200] = bytes([255]) * 200
        case "millions of members":
            content[-10:-6] = (2**28).to_bytes(4, "little")
    path.write_bytes(content)


@pytest.mark.parametrize("fault", ["name not UTF-8", "member past the end", "damaged LZMA", "millions of members"])
def test_damaged_3mf_fails_alone(tmp_path: Path, fault: str) -> None:
    _bad_3mf(tmp_path / "bad.3mf", fault)
    trimesh.creation.box(SIDES).export(tmp_path / "good.ply")
    assert [item.object_id for item in load_manifest("directory").objects(tmp_path)] == ["bad", "good"]
    with pytest.raises(InvalidInput, match=r"^bad\.3mf"):
        load_mesh(tmp_path / "bad.3mf")


def test_other_files_state_no_unit(tmp_path: Path) -> None:
    (tmp_path / "box.stl").write_bytes(trimesh.creation.box(SIDES).export(file_type="stl"))
    (tmp_path / "no.3mf").write_bytes(b"PK\3\4 no archive")
    os.mknod(tmp_path / "socket.dae", stat.S_IFSOCK | 0o600)
    assert {stated_units(tmp_path / name) for name in ("box.stl", "no.3mf", "socket.dae", "missing.dae")} == {(None, None)}


def test_urdf_scale_multiplies_the_unit_of_its_collada_file(tmp_path: Path) -> None:
    collada(tmp_path / "box.dae", "<unit meter='0.001'/>")
    element = fromstring("<visual><geometry><mesh filename='box.dae' scale='2 1 1'/></geometry></visual>")
    shape = shape_of(element, tmp_path, {}, read=lambda file, package: (load_mesh(file, package), ()))
    np.testing.assert_allclose(np.ptp(shape.mesh.vertices, axis=0), [0.06, 0.02, 0.01], atol=1e-9)  # its axes are the link's
