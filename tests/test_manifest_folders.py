"""Manifests of folders: their layouts, catalogues, and meshes with companions."""

import os
from collections import Counter
from pathlib import Path

import pytest

from pipeline.config.manifest import Manifest, load_manifest
from pipeline.config.sources import fingerprint
from pipeline.errors import InvalidInput
from tests.small_manifests import CUBE, folder, manifest


def warehouse(root: Path, **counts: int) -> Path:
    synsets = load_manifest("warehouse").sources[0].synsets
    for category, count in counts.items():
        for number in range(count):
            model = root / synsets[category] / f"{number:032x}"
            nested = number % 2 == 0  # both layouts of the two versions of ShapeNetCore
            file = model / "models" / "model_normalized.obj" if nested else model / "model.obj"
            file.parent.mkdir(parents=True)
            file.write_text(CUBE)
    return root


def test_warehouse_layout_is_read_and_counted(tmp_path):
    root = warehouse(tmp_path, bottle=4, knife=2, cellphone=2, rifle=2)
    loaded = load_manifest("warehouse").model_dump()
    loaded["sources"][0]["counts"] = {"bottle": 4, "knife": 2, "cellphone": 2, "rifle": 2}
    loaded["splits"] = {"train": 6, "valid": 2, "test": 2}
    objects = Manifest.model_validate(loaded).objects(root)
    assert Counter(item.category for item in objects) == {"bottle": 4, "knife": 2, "cellphone": 2, "rifle": 2}
    assert Counter(item.split for item in objects) == {"train": 6, "valid": 2, "test": 2}
    assert objects[0].object_id == f"bottle-{0:032x}"
    assert objects[0].source["up"] == "y"


def test_category_that_tables_could_not_tell_from_the_total_is_refused(tmp_path):
    (tmp_path / "all").mkdir()
    (tmp_path / "all" / "cube.obj").write_text(CUBE)
    with pytest.raises(InvalidInput, match=r"cube is of category 'all', as tables call the total; rename its folder"):
        manifest(folder("directory", tmp_path)).objects()


def test_model_without_a_file_is_listed_and_fails_when_read(tmp_path):
    root = warehouse(tmp_path, bottle=2)
    synset = load_manifest("warehouse").sources[0].synsets["bottle"]
    (root / synset / "half-downloaded").mkdir()
    source = {"kind": "shapenet", "licence": "x", "up": "y", "synsets": {"bottle": synset}}
    objects = manifest(source).objects(root)
    assert len(objects) == 3
    with pytest.raises(InvalidInput, match=r"model_normalized\.obj cannot be read"):
        fingerprint(next(item.source for item in objects if "half" in item.object_id))


def test_renderings_are_found_beside_the_meshes_and_do_not_change_fingerprints(tmp_path):
    single = load_manifest("single-image")
    for place in ("ShapeNetCore.v1/04090263/abc/model.obj", "ShapeNetCore.v1/03624134/abc/model.obj"):
        (tmp_path / place).parent.mkdir(parents=True)
        (tmp_path / place).write_text(CUBE)
    objects = single.objects(tmp_path)  # thirteen of its fifteen classes are not there
    assert [item.object_id for item in objects] == ["knife-abc", "rifle-abc"]
    assert objects[1].source["renderings"] == str(tmp_path / "ShapeNetRendering/04090263/abc/rendering")
    assert fingerprint(objects[1].source) == fingerprint(objects[1].source | {"renderings": "elsewhere"})
    (tmp_path / "empty").mkdir()
    with pytest.raises(
        InvalidInput,
        match=r"empty/ShapeNetCore\.v1 is no folder; give a folder laid out as DIR/ShapeNetCore\.v1/SYNSET/MODEL/model\.obj with",
    ):
        single.objects(tmp_path / "empty")
    (tmp_path / "empty/ShapeNetCore.v1").mkdir()
    with pytest.raises(InvalidInput, match=r"ShapeNetCore\.v1 has none of 02691156, 02828884, .*, …; give a folder laid out as"):
        single.objects(tmp_path / "empty")


def test_warehouse_with_other_counts_than_the_supplement_is_refused(tmp_path):
    root = warehouse(tmp_path, bottle=1, knife=1, cellphone=1, rifle=1)
    with pytest.raises(InvalidInput, match="holds 1 models of bottle, the manifest counts 487; complete or prune"):
        load_manifest("warehouse").objects(root)


def test_missing_class_is_named_with_the_expected_path(tmp_path):
    with pytest.raises(InvalidInput, match=r"no models of bottle in .*02876657; looked for MODEL/models/model_normalized.obj"):
        load_manifest("warehouse").objects(warehouse(tmp_path, knife=1))


def test_entries_of_a_folder_are_bounded(tmp_path, monkeypatch):
    (tmp_path / "a.obj").write_text(CUBE)
    (tmp_path / "b.obj").write_text(CUBE)
    monkeypatch.setattr("pipeline.config.folder_sources.MAX_ENTRIES", 1)
    with pytest.raises(InvalidInput, match="has more than 1 files and folders; give the folder of the meshes alone"):
        manifest(folder("directory", tmp_path)).objects()


def test_textures_of_a_shapenet_model_are_companions(tmp_path):
    (item,) = manifest({"kind": "shapenet", "licence": "x", "up": "y", "synsets": {"mug": "1"}}).objects(shapenet_mug(tmp_path))
    assert "../images/a.png" in fingerprint(item.source)["file"]["companions"]


def shapenet_mug(root: Path) -> Path:
    for name, content in {
        "models/model_normalized.obj": f"mtllib model_normalized.mtl\n{CUBE}",
        "models/model_normalized.mtl": "newmtl x\nmap_Kd ../images/a.png\n",
        "images/a.png": "picture",
    }.items():
        (root / "1" / "x" / name).parent.mkdir(parents=True, exist_ok=True)
        (root / "1" / "x" / name).write_text(content)
    return root


YCB = [f"{scan}/{name}" for scan in ("google_16k", "google_64k", "poisson", "tsdf") for name in ("textured.obj", "nontextured.ply")]


LAYOUTS = {
    "YCB": (
        [f"{name}/{file}" for name in ("025_mug", "011_banana", "077_rubiks_cube") for file in YCB],
        {name: ("object", f"{name}/google_16k/textured.obj") for name in ("025_mug", "011_banana", "077_rubiks_cube")},
    ),
    "GSO": (
        ["Blue Cup/meshes/model.obj", "Red_Shoe/meshes/model.obj"],
        {"Blue_Cup": ("object", "Blue Cup/meshes/model.obj"), "Red_Shoe": ("object", "Red_Shoe/meshes/model.obj")},
    ),
    "HOPE, in a folder": (
        ["hope/obj_01/textured.obj", "hope/obj_02/textured.obj", "hope/obj_02/nontextured.obj", "other.stl"],
        {
            "hope-obj_01": ("hope", "hope/obj_01/textured.obj"),
            "hope-obj_02": ("hope", "hope/obj_02/textured.obj"),
            "other": ("object", "other.stl"),
        },
    ),
    "MuJoCo": (
        ["can/visual/can_vis.obj", "can/collision/can_coll_0.obj", "milk/milk.glb", "milk/milk.stl", "milk/milk_collision.obj"],
        {"can": ("object", "can/visual/can_vis.obj"), "milk": ("object", "milk/milk.glb")},
    ),
    "one object": (["mug/google_16k/textured.obj"], {"mug": ("object", "mug/google_16k/textured.obj")}),
    "classes": (
        ["mugs/a.obj", "mugs/b.obj", "cans/meshes/a.obj", "cans/meshes/b.obj", "duck/duck.obj"],
        {
            "mugs-a": ("mugs", "mugs/a.obj"),
            "mugs-b": ("mugs", "mugs/b.obj"),
            "cans-meshes-a": ("cans", "cans/meshes/a.obj"),
            "cans-meshes-b": ("cans", "cans/meshes/b.obj"),
            "duck-duck": ("duck", "duck/duck.obj"),
        },
    ),
    "a class with one file": (["vase/tall 1.stl"], {"vase-tall_1": ("vase", "vase/tall 1.stl")}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_of_a_folder_is_recognised(tmp_path, layout):
    files, expected = LAYOUTS[layout]
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(CUBE)
    directory_manifest = manifest(folder("directory"))
    objects = {
        item.object_id: (item.category, str(Path(item.source["file"]).relative_to(tmp_path)))
        for item in directory_manifest.objects(tmp_path)
    }
    assert objects == expected
    remarks = "\n".join(directory_manifest.remarks(tmp_path))
    assert ("a folder per object: " in remarks) == (layout not in ("classes", "a class with one file"))
    left_out = len(files) - len(expected)
    assert (f"skipped {left_out} file" in remarks) == (left_out > 0)


def test_layout_and_category_of_a_folder_can_be_stated(tmp_path):
    for name in ("a/textured.obj", "b/textured.obj", "c/x.obj", "c/y.obj"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(CUBE)
    listed = {
        layout: {item.object_id: item.category for item in manifest(folder("directory", layout=layout, category="food")).objects(tmp_path)}
        for layout in (None, "files", "folders")
    }
    assert listed[None] == {"a": "food", "b": "food", "c-x": "c", "c-y": "c"}
    assert listed["files"] == {"a-textured": "a", "b-textured": "b", "c-x": "c", "c-y": "c"}
    assert listed["folders"] == {"a": "food", "b": "food", "c": "food"}


def test_ids_and_categories_come_from_paths_in_a_folder(tmp_path):
    for name in ("cups/a b.obj", "cups/c.obj", "cups/c.stl", "bare.PLY", ".hidden/x.obj", "cups/notes.txt"):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(CUBE)
    objects = manifest(folder("directory")).objects(tmp_path)
    assert {item.object_id: item.category for item in objects} == {
        "bare": "object",
        "cups-a_b": "cups",
        "cups-c-obj": "cups",
        "cups-c-stl": "cups",
    }


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        (["object_id,file,up", "a,a.obj,y"], "has no column category; its first line names the columns"),
        (["object_id,category,file,up", "a,cup,a.obj,w"], "a has up 'w'; it must be x, y, z or empty"),
        (["object_id,category,file,up,metres_per_unit", "a,cup,a.obj,,mm"], "a has metres_per_unit 'mm'; it must be a number from 1e-09"),
        (["object_id,category,file,up,metres_per_unit", "a,cup,a.obj,,nan"], "a has metres_per_unit 'nan'"),
        (["\udcff"], "is not text in UTF-8"),
        ([], "has no column object_id, category, file, up"),
    ],
)
def test_unusable_catalogue_is_named_with_the_reason(tmp_path, lines, problem):
    (tmp_path / "catalogue.csv").write_bytes("\n".join(lines).encode(errors="surrogateescape"))
    with pytest.raises(InvalidInput, match=f"catalogue.csv.*{problem}"):
        manifest(folder("catalogue")).objects(tmp_path)


def test_empty_up_in_a_catalogue_is_that_of_the_source(tmp_path):
    lines = "object_id,category,file,up,licence\na,cup,a.obj,,CC0\nb,cup,b.obj,z,CC0\n"
    (tmp_path / "catalogue.csv").write_text(lines, encoding="utf-8-sig")  # with a byte-order mark, as spreadsheets save it
    ups = {item.object_id: item.source["up"] for item in manifest(folder("catalogue", up="x")).objects(tmp_path)}
    assert ups == {"a": "x", "b": "z"}


def test_empty_unit_in_a_catalogue_is_that_of_the_source(tmp_path):
    (tmp_path / "catalogue.csv").write_text("object_id,category,file,up,metres_per_unit\na,cup,a.obj,,0.001\nb,cup,b.obj,,\n")
    objects = manifest(folder("catalogue", metres_per_unit=1.0)).objects(tmp_path)
    assert {item.object_id: item.source["metres_per_unit"] for item in objects} == {"a": 0.001, "b": 1.0}


def test_named_objects_of_a_catalogue_are_taken_alone(tmp_path):
    (tmp_path / "catalogue.csv").write_text("object_id,category,file,up\na,cup,a.obj,\nb,cup,b.obj,\nc,cup,c.obj,\n")
    assert [item.object_id for item in manifest(folder("catalogue", objects=["c", "a"])).objects(tmp_path)] == ["a", "c"]
    with pytest.raises(InvalidInput, match="the catalogue lists no d, e; correct `objects` of the source"):
        manifest(folder("catalogue", objects=["e", "a", "d"])).objects(tmp_path)


def test_name_that_is_not_utf8_is_refused(tmp_path):
    (tmp_path / os.fsdecode(b"caf\xe9.obj")).write_text(CUBE)
    with pytest.raises(InvalidInput, match=r"caf\\udce9\.obj' has bytes that are not UTF-8, or control characters, in its name; rename it"):
        manifest(folder("directory")).objects(tmp_path)


def test_names_with_blanks_of_other_scripts_are_accepted(tmp_path):
    for name in ("花瓶\u3000大.obj", "Scan 9.41\u202fPM.obj", "می\u200cخواهم.obj"):
        (tmp_path / name).write_text(CUBE)
    assert len(manifest(folder("directory")).objects(tmp_path)) == 3


def test_names_in_other_scripts_stay_apart(tmp_path):
    for name in ("杯子/红杯.obj", "杯子/蓝杯.obj", "瓶子/大瓶.obj"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(CUBE)
    objects = manifest(folder("directory")).objects(tmp_path)
    assert len({item.object_id for item in objects}) == 3
    assert sorted(Counter(item.category for item in objects).values()) == [1, 2]
