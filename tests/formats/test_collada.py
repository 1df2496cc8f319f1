"""COLLADA files: opacity as `<transparent>` and `<transparency>` say, emission where it is the only colour, concave polygons."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import parse_mesh
from pipeline.kernels.geometry.mesh import Mesh


def param(number: int) -> str:
    return (
        f'<newparam sid="surface{number}"><surface type="2D"><init_from>image{number}</init_from></surface></newparam>'
        f'<newparam sid="sampler{number}"><sampler2D><source>surface{number}</source></sampler2D></newparam>'
    )


def source(name: str, numbers: str, axes: str) -> str:
    params = "".join(f'<param name="{axis}" type="float"/>' for axis in axes)
    accessor = f'<accessor source="#{name}-array" count="3" stride="{len(axes)}">{params}</accessor>'
    array = f'<float_array id="{name}-array" count="{len(numbers.split())}">{numbers}</float_array>'
    return f'<source id="{name}">{array}<technique_common>{accessor}</technique_common></source>'


TRIANGLE = (
    '<?xml version="1.0" encoding="utf-8"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>'
    '<library_images><image id="image1"><init_from>a.png</init_from></image><image id="image2"><init_from>b.png</init_from></image>'
    f'</library_images><library_effects><effect id="paint"><profile_COMMON>{param(1)}{param(2)}<technique sid="common"><lambert>SHADER'
    "</lambert></technique></profile_COMMON></effect></library_effects>"
    '<library_materials><material id="material"><instance_effect url="#paint"/></material></library_materials>'
    f'<library_geometries><geometry id="shape"><mesh>{source("corners", "0 0 0 1 0 0 0 1 0", "XYZ")}{source("uv", "0 0 1 0 0 1", "ST")}'
    '<vertices id="vertices"><input semantic="POSITION" source="#corners"/></vertices><triangles count="1" material="skin">'
    '<input semantic="VERTEX" source="#vertices" offset="0"/><input semantic="TEXCOORD" source="#uv" offset="1" set="0"/>'
    "<p>0 0 1 1 2 2</p></triangles></mesh></geometry></library_geometries>"
    '<library_visual_scenes><visual_scene id="scene"><node id="node"><instance_geometry url="#shape"><bind_material><technique_common>'
    '<instance_material symbol="skin" target="#material"/></technique_common></bind_material></instance_geometry></node></visual_scene>'
    '</library_visual_scenes><scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
)
RED = "<diffuse><color>1 0 0 0.5</color></diffuse>"
TEXTURE = '<diffuse><texture texture="sampler1" texcoord="UV"/></diffuse>'


def painted(folder: Path, shader: str, *, encoding: str = "utf-8") -> Mesh:
    """Read a triangle with a shader; the images that it may name are half transparent."""
    text = TRIANGLE.replace("SHADER", shader).replace('encoding="utf-8"', f'encoding="{encoding.removesuffix("-sig")}"')
    (folder / "a.dae").write_bytes(text.encode(encoding))
    for name in ("a.png", "b.png"):
        Image.new("RGBA", (4, 4), (200, 30, 30, 128)).save(folder / name)
    return parse_mesh(folder / "a.dae", folder)


def transparent(color: str, mode: str = "") -> str:
    return (
        f'<transparent opaque="{mode}"><color>{color}</color></transparent>'
        if mode
        else f"<transparent><color>{color}</color></transparent>"
    )


def transparency(number: object) -> str:
    return f"<transparency><float>{number}</float></transparency>"


@pytest.mark.parametrize(
    ("shader", "opacity"),
    [
        (RED, 255),  # alpha of a diffuse colour is none
        (RED + transparent("1 1 1 0.5"), 128),
        (RED + transparent("1 1 1 1", "A_ONE") + transparency(0.25), 64),
        (RED + transparent("0 0 0 0.25", "A_ZERO"), 191),
        (RED + transparent("0.5 0.5 0.5 1", "RGB_ZERO"), 128),
        (RED + transparent("0.2 0.2 0.2 1", "RGB_ONE"), 51),
        (RED + transparent("x") + transparency("nan"), 255),
    ],
)
def test_opacity_is_that_of_the_mode(tmp_path: Path, shader: str, opacity: int) -> None:
    assert painted(tmp_path, shader).look.base_color.tolist() == [[255, 0, 0, opacity]]


@pytest.mark.parametrize(
    ("statement", "alpha", "listed"),
    [
        ("", 255, False),
        ('<transparent><texture texture="sampler1" texcoord="UV"/></transparent>', 128, False),
        ('<transparent opaque="A_ONE"><texture texture="sampler1" texcoord="UV"/></transparent>', 128, False),
        ('<transparent><texture texture="sampler2" texcoord="UV"/></transparent>', 255, True),
        ('<transparent opaque="RGB_ZERO"><texture texture="sampler1" texcoord="UV"/></transparent>', 255, True),
    ],
)
def test_alpha_of_a_texture_counts_if_transparent_names_it(tmp_path: Path, statement: str, alpha: int, listed: bool) -> None:
    mesh = painted(tmp_path, TEXTURE + statement)
    assert mesh.look.textures[0][0, 0].tolist() == [200, 30, 30, alpha]
    assert mesh.unread == (("the texture of opacities of effect paint is not read",) if listed else ())


def test_emission_is_shown_where_it_is_the_only_colour(tmp_path: Path) -> None:
    red, black = "<emission><color>1 0 0 1</color></emission>", "<diffuse><color>0 0 0 1</color></diffuse>"
    assert painted(tmp_path, red + black).look.base_color.tolist() == [[255, 0, 0, 255]]
    assert painted(tmp_path, "<emission><color>0 1 0 1</color></emission>" + RED).look.base_color.tolist() == [[255, 0, 0, 255]]
    emitted = TEXTURE.replace("diffuse>", "emission>")
    assert painted(tmp_path, emitted).look.textures[0][0, 0].tolist() == [200, 30, 30, 255]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "iso-8859-1"])
def test_file_in_another_encoding_keeps_its_texture(tmp_path: Path, encoding: str) -> None:
    mesh = painted(tmp_path, TEXTURE + '<transparent><texture texture="sampler1" texcoord="Größe"/></transparent>', encoding=encoding)
    assert mesh.look.textures[0][0, 0].tolist() == [200, 30, 30, 128]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("<node id", '<node id="skinned"><instance_controller url="#skin"/></node><node id', r"a skin or a morph \(instance_controller\)"),
        ("<instance_geometry", "<skew>45 1 0 0 0 1 0</skew><instance_geometry", "a skewed node"),
        ("<instance_geometry", "<lookat>0 0 5 0 0 0 0 1 0</lookat><instance_geometry", "a node that looks at a point"),
        ("<triangles", '<polygons count="1"><ph><p>0 0 1 1 2 2</p><h>0 0 1 1 2 2</h></ph></polygons><triangles', "polygons with holes"),
        ('<scene><instance_visual_scene url="#scene"/></scene>', "", "shows no scene"),
    ],
)
def test_shapes_that_are_not_computed_are_refused(tmp_path: Path, before: str, after: str, words: str) -> None:
    (tmp_path / "a.dae").write_text(TRIANGLE.replace(before, after, 1))
    with pytest.raises(InvalidInput, match=words):
        parse_mesh(tmp_path / "a.dae", tmp_path)


def test_camera_that_looks_at_a_point_and_comments_are_no_shape(tmp_path: Path) -> None:
    camera = '<node><lookat>0 0 5 0 0 0 0 1 0</lookat><instance_camera url="#camera"/></node><!-- <skew> --><node id'
    (tmp_path / "a.dae").write_text(TRIANGLE.replace("SHADER", RED).replace("<node id", camera))
    assert len(parse_mesh(tmp_path / "a.dae", tmp_path).faces) == 1


def test_clamped_texture_is_said(tmp_path: Path) -> None:
    clamped = TRIANGLE.replace("</source></sampler2D>", "</source><wrap_s>CLAMP</wrap_s></sampler2D>", 1).replace("SHADER", TEXTURE)
    for name in ("a.png", "b.png"):
        Image.new("RGB", (4, 4)).save(tmp_path / name)
    (tmp_path / "a.dae").write_text(clamped)
    assert parse_mesh(tmp_path / "a.dae", tmp_path).unread == ("a.png repeats where coordinates are outside 0 to 1; the file says CLAMP",)


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


@pytest.mark.parametrize(
    "polygons",
    [
        f'<tristrips count="1">{INPUTS}<p>0 0 1 0 3 0 2 0</p></tristrips>',
        f'<trifans count="1">{INPUTS}<p>0 0 1 0 2 0 3 0</p></trifans>',
    ],
)
def test_strips_and_fans_are_read(tmp_path: Path, polygons: str) -> None:
    (tmp_path / "a.dae").write_text(FILE.replace("NUMBERS", "0 0 0 2 0 0 4 4 0 0 4 0").replace("POLYGONS", polygons))
    mesh = parse_mesh(tmp_path / "a.dae", tmp_path)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area == pytest.approx(12)


@pytest.mark.parametrize(
    "damaged", [POLYGONS.replace("#vertices", "#others"), POLYLIST.replace("3 0 0 0", "9 0 0 0"), POLYLIST.replace("4<", "5<")]
)
def test_damaged_polygons_are_refused(tmp_path: Path, damaged: str) -> None:
    (tmp_path / "a.dae").write_text(FILE.replace("NUMBERS", ARROW).replace("POLYGONS", damaged))
    with pytest.raises(InvalidInput, match=r"damaged|no positions"):
        parse_mesh(tmp_path / "a.dae", tmp_path)
