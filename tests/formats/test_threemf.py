"""3MF files: which parts and objects are built, where, and in which colours."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats.file_units import stated_units
from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.mesh_parts import GREY
from pipeline.kernels.geometry.mesh import Mesh

MICROSOFT, OPC = "http://schemas.microsoft.com/3dmanufacturing", "http://schemas.openxmlformats.org/package/2006"
NAMESPACES = {
    "m": f"{MICROSOFT}/material/2015/02",
    "p": f"{MICROSOFT}/production/2015/06",
    "s": f"{MICROSOFT}/slice/2015/07",
    "b": f"{MICROSOFT}/beamlattice/2017/02",
    "o": "http://schemas.3mf.io/3dmanufacturing/booleanoperations/2023/07",
}
MAIN = "3D/3dmodel.model"
BUILD = '<item objectid="1"/>'
BOTH = f'{BUILD}<item objectid="2"/>'
CURA = (
    '<metadatagroup><metadata name="cura:cutting_mesh" type="xs:string">True</metadata></metadatagroup>',
    '<settings><setting key="cutting_mesh">True</setting></settings>',
)
RED, BLUE = [220, 20, 20, 255], [20, 20, 220, 255]
BASES = '<basematerials id="2"><base name="a" displaycolor="#DC1414"/><base name="b" displaycolor="#1414DCFF"/></basematerials>'
COLORS = '<m:colorgroup id="2"><m:color color="#DC1414FF"/><m:color color="#1414DC"/></m:colorgroup>'


def solid(number: int = 1, height: float = 3, attributes: str = "", triangle: str = "", mesh: str = "") -> str:
    """Write a box of 1 × 2 × height as an object."""
    box = trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, height]])
    vertices = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*vertex) for vertex in box.vertices)
    faces = "".join('<triangle v1="{}" v2="{}" v3="{}"{}/>'.format(*face, triangle) for face in box.faces)
    return f'<object id="{number}"{attributes}><mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles>{mesh}</mesh></object>'


def whole(number: int, *components: str) -> str:
    """Write an object of components, from their attributes."""
    return f'<object id="{number}"><components>{"".join(f"<component {of}/>" for of in components)}</components></object>'


def model(resources: str, build: str = BUILD, attributes: str = "") -> str:
    names = " ".join(f'xmlns:{prefix}="{uri}"' for prefix, uri in NAMESPACES.items())
    core = f'xmlns="{MICROSOFT}/core/2015/02"'
    return f"<model {core} {names} {attributes}><resources>{resources}</resources><build>{build}</build></model>"


def write(path: Path, parts: dict[str, str | bytes], main: str | None = None) -> Path:
    """Write a package whose relations name the main model."""
    target = f'<Relationship Id="r" Type="{MICROSOFT}/2013/01/3dmodel" Target="/{main}"/>' if main else ""
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("_rels/.rels", f'<Relationships xmlns="{OPC}/relationships">{target}</Relationships>')
        for name, content in parts.items():
            package.writestr(name, content)
    return path


def read(folder: Path, resources: str, build: str = BUILD, attributes: str = "", **parts: str | bytes) -> Mesh:
    """Read a file with a main model and perhaps others, whose folder is 3D."""
    others = {f"3D/{name}": content for name, content in parts.items()}
    return parse_mesh(write(folder / "a.3mf", {MAIN: model(resources, build, attributes), **others}, MAIN), folder)


def volume(mesh: Mesh) -> float:
    """Compute the volume of a closed mesh, negative if its faces look inside."""
    return float(np.linalg.det(mesh.triangles).sum() / 6)


def colors(mesh: Mesh) -> list[list[int]]:
    """Return the colours of all faces, each once."""
    return np.unique(mesh.look.base_color[mesh.look.face_material], axis=0).tolist()


def test_ids_count_within_their_part(tmp_path: Path) -> None:
    build = '<item objectid="5"/><item objectid="1" p:path="/3D/c.model" transform="1 0 0 0 1 0 0 0 1 0 0 9"/>'
    resources = whole(5, 'p:path="/3D/a.model" objectid="1"', 'p:path="/3D/B.model" objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"')
    parts = {f"{name}.model": model(solid(height=height), "") for name, height in (("a", 3), ("b", 6), ("c", 1))}
    mesh = read(tmp_path, resources, build, 'requiredextensions="p"', **parts)
    assert len(mesh.faces) == 36
    assert volume(mesh) == pytest.approx(6 + 12 + 2)
    assert np.ptp(mesh.vertices, axis=0).tolist() == [6, 2, 10]


@pytest.mark.parametrize(
    ("parts", "main"),
    [
        ({"3D/cube.model": model(solid(), attributes='unit="inch"'), MAIN: model(solid(height=9))}, "3D/cube.model"),
        ({"3d/3DModel.Model": model(solid(), attributes='unit="inch"')}, MAIN),
        ({"3D/cube.model": model(solid(), attributes='unit="inch"')}, None),
        ({"x/a.model": model(solid(height=9)), MAIN: model(solid(), attributes='unit="inch"')}, None),
    ],
)
def test_main_model_and_its_unit_are_those_of_the_relations(tmp_path: Path, parts: dict[str, str | bytes], main: str | None) -> None:
    path = write(tmp_path / "a.3mf", parts, main)
    assert volume(parse_mesh(path, tmp_path)) == pytest.approx(6)
    assert stated_units(path) == (0.0254, "z")


def test_transforms_of_items_and_components_multiply(tmp_path: Path) -> None:
    """The component moves by 1 in x, the item turns by 90° about z and then moves by 10 in y."""
    resources = solid() + whole(2, 'objectid="1" transform="1 0 0 0 1 0 0 0 1 1 0 0"')
    mesh = read(tmp_path, resources, '<item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 10 0"/>')
    assert mesh.vertices.min(axis=0).tolist() == [-2, 11, 0]
    assert mesh.vertices.max(axis=0).tolist() == [0, 12, 3]


def test_mirrored_object_keeps_its_outside(tmp_path: Path) -> None:
    assert volume(read(tmp_path, solid(), '<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>')) == pytest.approx(6)


USES = solid(triangle=' pid="2" p1="0"')


@pytest.mark.parametrize(
    ("resources", "build", "said"),
    [
        (solid() + solid(2, 9, ' type="support"'), BUILD + '<item objectid="2"/>', "object 2 is skipped; it is a support"),
        (
            solid() + solid(2, 9, ' type="other"') + whole(3, 'objectid="1"', 'objectid="2"'),
            '<item objectid="3"/>',
            "object 2 is skipped; it is a helper that is not built",
        ),
        (solid() + solid(2), BUILD + '<item objectid="2" printable="0"/>', "item 2 is skipped; it is marked as not printable"),
        *(
            (solid() + solid(2).replace("<mesh>", f"{setting}<mesh>"), BOTH, "object 2 is skipped; Cura marks it as cutting_mesh")
            for setting in CURA
        ),
        (solid(triangle=' paint_color="4"'), BUILD, "colours that a slicer painted on triangles are not read"),
        (
            '<m:compositematerials id="2"><m:composite values="1"/></m:compositematerials>' + USES,
            BUILD,
            "mixtures of materials (compositematerials) are not read",
        ),
        (
            '<m:multiproperties id="2"><m:multi pindices="0"/></m:multiproperties>' + USES,
            BUILD,
            "layers of properties (multiproperties) are not read",
        ),
        (
            '<m:texture2dgroup id="2" texid="3"><m:tex2coord u="0" v="1"/></m:texture2dgroup>' + USES,
            BUILD,
            "textures (texture2dgroup) are not read",
        ),
        (
            COLORS + solid(triangle=' pid="2" p1="0" p2="1" p3="0"'),
            BUILD,
            "colours that differ at the corners of a triangle are not read, but the first",
        ),
    ],
)
def test_what_is_left_out_is_said(tmp_path: Path, resources: str, build: str, said: str) -> None:
    mesh = read(tmp_path, resources, build)
    assert volume(mesh) == pytest.approx(6)
    assert mesh.unread == (said,)


@pytest.mark.parametrize(
    ("resources", "message"),
    [
        (solid(mesh='<b:beamlattice radius="1"/>'), r"object 1 of .* has a beamlattice, which cannot be read"),
        ('<object id="1"><o:booleanshape objectid="1"/></object>', "object 1 is a booleanshape, which cannot be read"),
        (solid(attributes=' s:meshresolution="lowres" s:slicestackid="9"'), "has its shape in slices beside a mesh of low resolution"),
        ('<object id="1" s:slicestackid="9"><mesh><vertices/><triangles/></mesh></object>', "has slices and no triangles"),
        (solid(2), "names object 1 of .*, which is not there"),
        (whole(1, 'objectid="1"'), "101 levels of components, 100 are the most; one may contain itself"),
        (whole(1, 'objectid="1" p:path="/none.model"'), "names the part /none.model, which is not in the file"),
        (solid(attributes=' type="support"'), "holds no triangle mesh; .*object 1 is skipped"),
        ('<object id="1"><mesh/></object>', "holds no triangle mesh"),
        (solid().replace('v1="', 'v1="9'), r"a face names a vertex outside 0\.\.7"),
    ],
)
def test_shapes_that_cannot_be_read_are_refused(tmp_path: Path, resources: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        read(tmp_path, resources)


def test_extensions_and_units_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"requires .*beamlattice/2017/02, which cannot be read"):
        read(tmp_path, solid(), attributes='requiredextensions="m b"')
    with pytest.raises(InvalidInput, match="its models are in millimeter and in inch"):
        read(tmp_path, whole(1, 'objectid="1" p:path="/3D/a.model"'), **{"a.model": model(solid(), "", 'unit="inch"')})


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"a.txt": "a"}, r"it has no part that ends with \.model"),
        ({MAIN: f"<!DOCTYPE model>{model(solid())}"}, "declares a document type or entities"),
        (
            {MAIN: model(solid()), "Metadata/Slic3r_PE_model.config": '<metadata key="volume_type" value="NegativeVolume"/>'},
            "volumes that modify others",
        ),
        (
            {MAIN: model(solid()), "Metadata/model_settings.config": '<part id="2" subtype="modifier_part"/>'},
            "volumes that modify others",
        ),
    ],
)
def test_packages_of_other_kinds_are_refused(tmp_path: Path, parts: dict[str, str | bytes], message: str) -> None:
    path = write(tmp_path / "a.3mf", parts)
    with pytest.raises(InvalidInput, match=message):
        parse_mesh(path, tmp_path)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(InvalidInput, match="it is no ZIP file, as 3MF files are"):
        parse_mesh(path, tmp_path)


@pytest.mark.parametrize(
    ("resources", "expected"),
    [
        (solid(), [list(GREY)]),
        (BASES + solid(attributes=' pid="2" pindex="1"'), [BLUE]),
        (BASES + solid(attributes=' pid="2" pindex="1"', triangle=' p1="0"'), [RED]),
        (BASES + solid(triangle=' pid="2" p1="1" p2="1" p3="1"'), [BLUE]),
        (COLORS + solid(attributes=' pid="2" pindex="0"'), [RED]),
        (COLORS + BASES.replace('"2"', '"7"') + solid(attributes=' pid="2" pindex="0"', triangle=' pid="7" p1="1"'), [BLUE]),
        (COLORS + solid(attributes=' pid="9" pindex="0"'), [list(GREY)]),
    ],
)
def test_colours_of_objects_and_triangles_are_read(tmp_path: Path, resources: str, expected: list[list[int]]) -> None:
    mesh = read(tmp_path, resources)
    assert colors(mesh) == expected
    assert mesh.look.vertex_color is None
    assert mesh.unread == ()
