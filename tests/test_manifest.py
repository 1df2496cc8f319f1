"""Manifests: listed objects, splits, and errors."""

from collections import Counter
from pathlib import Path

import pytest
import yaml

from pipeline.config.manifest import Manifest, _sizes, load_manifest
from pipeline.config.objects import checksum, fingerprint
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import shipped_files

CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def manifest(*sources: dict, splits: dict | None = None) -> Manifest:
    splits = splits or {"train": 0.5, "valid": 0.25, "test": 0.25}
    return Manifest.model_validate({"name": "m", "description": "d", "seed": 0, "splits": splits, "sources": sources})


def folder(kind: str, path: Path | None = None, **more: object) -> dict:
    return {"kind": kind, "licence": "x", "up": "y", "path": path} | more


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


def test_every_built_in_manifest_loads():
    names = list(shipped_files("manifest"))
    assert names == [
        "directory",
        "four-classes",
        "household",
        "one-of-each",
        "procedural",
        "pybullet-objects",
        "single-image",
        "toy",
        "warehouse",
        "weights",
    ]
    for name in names:
        assert load_manifest(name).name == name


def test_toy_needs_no_files_and_has_every_split():
    objects = load_manifest("toy").objects()
    assert [item.object_id for item in objects] == sorted(item.object_id for item in objects)
    assert Counter(item.category for item in objects) == dict.fromkeys(["bottle", "cellphone", "knife", "rifle", "object"], 5)
    assert Counter(item.split for item in objects) == {"train": 15, "valid": 5, "test": 5}
    for category in ("bottle", "cellphone", "knife", "rifle"):
        assert {item.split for item in objects if item.category == category} == {"train", "valid", "test"}


@pytest.mark.parametrize(
    ("shares", "objects", "sizes"),
    [
        ((0.75, 0.15, 0.1), 100, [75, 15, 10]),
        ((0.75, 0.15, 0.1), 4, [2, 1, 1]),  # rounding alone: 3, 1, 0
        ((0.75, 0.15, 0.1), 3, [1, 1, 1]),
        ((0.75, 0.15, 0.1), 2, [1, 1, 0]),
        ((0.75, 0.15, 0.1), 1, [1, 0, 0]),
        ((0.0, 0.0, 1.0), 3, [0, 0, 3]),
        ((0.05, 0.05, 0.9), 4, [1, 1, 2]),
    ],
)
def test_split_sizes_follow_the_shares_and_are_not_empty_if_possible(shares, objects, sizes):
    assert _sizes(shares, objects) == sizes


def test_pybullet_objects_manifest_has_1004_objects():
    objects = load_manifest("pybullet-objects").objects()
    assert len(objects) == 1004
    assert {"duck", "mug", "teddy", "bunny", "random-000", "random-999"} <= {item.object_id for item in objects}


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


def test_model_without_a_file_is_listed_and_fails_when_read(tmp_path):
    root = warehouse(tmp_path, bottle=2)
    synset = load_manifest("warehouse").sources[0].synsets["bottle"]
    (root / synset / "half-downloaded").mkdir()
    source = {"kind": "shapenet", "licence": "x", "up": "y", "synsets": {"bottle": synset}}
    objects = manifest(source).objects(root)
    assert len(objects) == 3
    with pytest.raises(InvalidInput, match=r"model_normalized\.obj is not there"):
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


def test_source_with_a_split_is_left_out_of_the_random_split():
    drawn = {"kind": "procedural", "licence": "x", "seed": 0, "count": {"bottle": 4}}
    stated = {"kind": "pybullet", "licence": "x", "split": "test", "files": {"duck": {"file": "duck.obj"}, "bunny": {"file": "bunny.obj"}}}
    alone, both = ({item.object_id: item.split for item in manifest(*sources).objects()} for sources in ((drawn,), (drawn, stated)))
    assert both == alone | {"duck": "test", "bunny": "test"}
    counts = {"train": 2, "valid": 1, "test": 1}
    assert Counter(item.split for item in manifest(drawn, stated, splits=counts).objects()) == {"train": 2, "valid": 1, "test": 3}


def test_split_counts_must_sum_to_the_number_of_objects(tmp_path):
    (tmp_path / "a.obj").write_text(CUBE)
    with pytest.raises(InvalidInput, match=r"1298 \+ 258 \+ 175 = 1731 objects, 1 were found"):
        manifest(folder("directory", tmp_path), splits={"train": 1298, "valid": 258, "test": 175}).objects()
    with pytest.raises(InvalidInput, match="= 2 objects, 0 were found without the 1 whose source states its split"):
        manifest(folder("directory", tmp_path, split="test"), splits={"train": 1, "valid": 1, "test": 0}).objects()


def test_source_without_objects_is_refused_beside_others(tmp_path):
    (tmp_path / "a.obj").write_text(CUBE)
    with pytest.raises(InvalidInput, match="manifest m: a pybullet source names no objects; give it some"):
        manifest(folder("directory", tmp_path), {"kind": "pybullet", "licence": "x"}).objects()


def test_counts_of_a_source_are_bounded():
    endless = {"kind": "procedural", "licence": "x", "seed": 0, "count": {"bottle": 2**31}}
    with pytest.raises(InvalidInput, match="a source has more than 200000 objects"):
        manifest(endless).objects()


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
    assert (f"left out {left_out} file" in remarks) == (left_out > 0)


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
        (["object_id,category,file,up,metres_per_unit", "a,cup,a.obj,,mm"], "a has metres_per_unit 'mm'; it must be a number above 0"),
        (["object_id,category,file,up,metres_per_unit", "a,cup,a.obj,,nan"], "a has metres_per_unit 'nan'"),
        (["\udcff"], "cannot be read as CSV in UTF-8"),
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


def test_paths_are_relative_to_the_manifest(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.obj").write_text(CUBE)
    described = manifest(folder("directory", "meshes")).model_dump(mode="json")
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(described))
    monkeypatch.chdir("/")
    (item,) = load_manifest(str(tmp_path / "mine.yaml")).objects()
    assert item.source["file"] == str(tmp_path / "meshes" / "a.obj")
    with pytest.raises(InvalidInput, match=f"did you mean {tmp_path / 'mine.yaml'}"):
        load_manifest(str(tmp_path / "mine.yml"))


def test_missing_household_objects_are_reported_with_the_command_that_gets_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput, match=r"data/meshes/household is no folder; give a folder .*`make household`"):
        load_manifest("household").objects()


def test_objects_folder_that_no_source_uses_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="manifest toy names its own objects: leave --objects"):
        load_manifest("toy").objects(tmp_path)


def test_objects_folder_goes_to_the_source_without_a_path(tmp_path):
    for name in "abc":
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.obj").write_text(CUBE)
    named, other, nameless = folder("directory", tmp_path / "a"), folder("directory", tmp_path / "c"), folder("directory")
    assert [item.object_id for item in manifest(named, nameless).objects(tmp_path / "b")] == ["a", "b"]
    assert [item.object_id for item in manifest(named).objects(tmp_path / "b")] == ["b"]
    remedies = "each states its `path`, so leave --objects out", "state the `path` of all but one"
    for sources, remedy in zip(((named, other), (nameless, nameless)), remedies, strict=True):
        with pytest.raises(InvalidInput, match=rf"2 sources of manifest m take a folder, and --objects .* names one: {remedy}"):
            manifest(*sources).objects(tmp_path / "b")


def test_missing_and_empty_folders_are_errors_with_a_remedy(tmp_path):
    with pytest.raises(InvalidInput, match="give a folder of meshes with --objects DIR"):
        load_manifest("directory").objects()
    with pytest.raises(InvalidInput, match="no mesh files below"):
        load_manifest("directory").objects(tmp_path)


def test_different_checksum_is_an_error(tmp_path):
    (tmp_path / "a.obj").write_text(CUBE)
    right = checksum(manifest(folder("directory", tmp_path)).sources[0].find(None))
    assert len(manifest(folder("directory", tmp_path, sha256=right)).objects()) == 1
    (tmp_path / "a.obj").write_text(CUBE + "# changed\n")
    with pytest.raises(InvalidInput, match=r"have checksum .* the manifest says"):
        manifest(folder("directory", tmp_path, sha256=right)).objects()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"colour": "red"}, "colour"),
        ({"splits": {"train": 0.5, "valid": 0.1, "test": 0.1}}, r"0.5 \+ 0.1 \+ 0.1 = 0.7; shares must sum to 1"),
        ({"splits": {"train": 0.7, "valid": 0.3, "test": 0.15}}, r"= 1.15; shares must sum to 1, counts be whole numbers"),
        ({"descriptoin": "x"}, "there is no entry descriptoin, did you mean description\\?"),
        ({"sources": [{"kind": "cloud", "licence": "x"}]}, r"match any of the expected tags: [^;]*\. Its entries"),
        ({"seed": -1}, "seed"),
        ({"sources": []}, "sources"),
        ({"sources": [{"kind": "cloud", "licence": "x"}]}, "cloud"),
        ({"sources": [{"kind": "directory", "up": "z"}]}, "licence"),
        ({"sources": [{"licence": "x"}]}, r"file .*mine\.yaml: entry sources\.0\.kind is missing"),
        ({"sources": [{"kind": "directory", "licence": "x", "metres_per_unit": "mm"}]}, r"metres_per_unit: .* \(it is 'mm'\)"),
    ],
)
def test_fault_in_a_manifest_file_is_named(tmp_path, change, reason):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(load_manifest("directory").model_dump(mode="json") | change))
    with pytest.raises(InvalidInput, match=reason):
        load_manifest(str(path))


def test_unknown_manifest_lists_the_built_in_ones():
    with pytest.raises(
        InvalidInput, match="built in are directory, four-classes, household, one-of-each, procedural, pybullet-objects, single-image, toy"
    ):
        load_manifest("moon")


def test_duplicate_object_names_are_an_error(tmp_path):
    (tmp_path / "a.obj").write_text(CUBE)
    with pytest.raises(InvalidInput, match="two objects are called a"):
        manifest(folder("directory", tmp_path), folder("directory", tmp_path)).objects()
    drawn = {"kind": "procedural", "licence": "x", "count": {"bottle": 1}}
    with pytest.raises(InvalidInput, match=r"called bottle-0000: a procedural one and .* let one procedural source make the class"):
        manifest(drawn | {"seed": 0}, drawn | {"seed": 1}).objects()


def test_up_of_a_pybullet_file_overrides_that_of_its_source():
    files = {"duck": {"file": "duck.obj"}, "bunny": {"file": "bunny.obj", "up": "x"}}
    named = manifest({"kind": "pybullet", "licence": "x", "up": "y", "files": files})
    assert {item.object_id: item.source["up"] for item in named.objects()} == {"duck": "y", "bunny": "x"}
    assert named.with_units(None, "z").objects()[1].source["up"] == "z"
    with pytest.raises(InvalidInput, match=r"no 'dukc.obj' in .*; correct the path of duck"):
        manifest({"kind": "pybullet", "licence": "x", "files": {"duck": {"file": "dukc.obj"}}}).objects()


def test_fingerprint_depends_on_file_contents_and_not_on_their_folder(tmp_path):
    prints = []
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.obj").write_text(f"mtllib a.mtl\n{CUBE}")
        (tmp_path / name / "a.mtl").write_text("newmtl x\nmap_Kd a.png\n")
        (tmp_path / name / "a.png").write_bytes(b"picture")
        prints.append(fingerprint(manifest(folder("directory", tmp_path / name)).objects()[0].source))
    assert prints[0] == prints[1]
    (tmp_path / "there" / "a.png").write_bytes(b"another")
    assert fingerprint(manifest(folder("directory", tmp_path / "there")).objects()[0].source) != prints[0]


@pytest.mark.parametrize("character", ["\0", "\n", "\x1b", "\u202e", "\u2066"])
def test_names_with_control_characters_are_refused(tmp_path, character):
    source = {"kind": "pybullet", "licence": "x", "files": {"duck": {"file": "duck.obj"}}, "category": f"mu{character}g"}
    with pytest.raises(InvalidInput, match=r"manifest m: 'mu.*g' has the character .*, which steers how text is shown"):
        manifest(source).objects()
    described = {"name": f"m{character}", "description": "d", "seed": 0, "splits": {"train": 1, "valid": 0, "test": 0}}
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(described | {"sources": [source]}))
    with pytest.raises(InvalidInput, match=r"name: .*which steers how text is shown"):
        load_manifest(str(tmp_path / "m.yaml"))


def test_names_in_any_script_are_accepted():
    source = {"kind": "pybullet", "licence": "x", "files": {"duck": {"file": "duck.obj"}}, "category": "می\u200cخواهم 杯\u3000"}
    assert manifest(source).objects()[0].category == source["category"]


def test_entry_of_another_source_kind_is_named(tmp_path):
    source = "{kind: directory, licence: CC0, path: ., files: {can: {file: can.obj, up: z}}}"
    path = tmp_path / "own.yaml"
    path.write_text(f"name: own\ndescription: d\nseed: 0\nsplits: {{train: 1, valid: 0, test: 0}}\nsources:\n  - {source}\n")
    with pytest.raises(InvalidInput, match=r"there is no entry sources\.0\.directory\.files"):
        load_manifest(str(path))
