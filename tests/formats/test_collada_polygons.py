"""Concave polygons of COLLADA files are cut as they are drawn."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.formats.collada import cut_concave
from pipeline.formats.mesh_file import parse_mesh

ARROW = "0 0 0 4 -3 0 2 0 0 4 3 0"
"""A quadrilateral of area 6, concave at its third corner; a fan from the second one would cover another area."""

FILE = (
    '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/><library_geometries>'
    '<geometry id="shape"><mesh><source id="corners"><float_array id="numbers" count="12">NUMBERS</float_array><technique_common>'
    '<accessor source="#numbers" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>'
    '<param name="Z" type="float"/></accessor></technique_common></source><vertices id="vertices">'
    '<input semantic="POSITION" source="#corners"/></vertices>POLYGONS</mesh></geometry></library_geometries><library_visual_scenes>'
    '<visual_scene id="scene"><node id="node"><instance_geometry url="#shape"/></node></visual_scene></library_visual_scenes>'
    '<scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
)
INPUTS = '<input semantic="VERTEX" source="#vertices" offset="0"/><input semantic="NORMAL" source="#corners" offset="1"/>'
POLYLIST = f'<polylist count="1" material="a">{INPUTS}<vcount>4</vcount><p>1 0 2 0 3 0 0 0</p></polylist>'
POLYGONS = f'<polygons material="a" count="1">{INPUTS}<p>1 0 2 0 3 0 0 0</p></polygons>'


@pytest.mark.parametrize("polygons", [POLYLIST, POLYGONS])
def test_concave_polygon_is_not_filled(tmp_path: Path, polygons: str) -> None:
    (tmp_path / "a.dae").write_text(FILE.replace("NUMBERS", ARROW).replace("POLYGONS", polygons))
    mesh = parse_mesh(tmp_path / "a.dae", tmp_path)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area == pytest.approx(6)
    normals = np.cross(*np.moveaxis(np.diff(mesh.vertices[mesh.faces], axis=1), 1, 0))
    assert (normals[:, 2] > 0).all()


@pytest.mark.parametrize("polygons", [POLYLIST, POLYGONS.replace("#vertices", "#others")])
def test_convex_polygons_and_those_that_are_not_understood_stay(polygons: str) -> None:
    numbers = "0 0 0 1 0 0 1 1 0 0 1 0" if polygons == POLYLIST else ARROW
    content = FILE.replace("NUMBERS", numbers).replace("POLYGONS", polygons).encode()
    assert cut_concave(content) == content
