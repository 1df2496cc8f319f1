"""Manifests: listed objects, splits, and errors."""

from collections import Counter

import pytest
import yaml

from pipeline.config.manifest import _sizes, load_manifest
from pipeline.config.sources import checksum, fingerprint
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import shipped_files
from tests.small_manifests import CUBE, folder, manifest


def test_every_built_in_manifest_loads():
    names = list(shipped_files("manifest"))
    assert names == [
        "directory",
        "four-classes",
        "hand-sized-test",
        "hand-sized",
        "household",
        "one-of-each",
        "procedural",
        "pybullet-objects",
        "single-image",
        "thirteen-classes",
        "toy",
        "warehouse",
        "weights",
    ]
    for name in names:
        assert load_manifest(name).name == name


def test_hand_sized_test_is_hand_sized_and_a_source_to_test_on():
    """Objects that are made and networks that are trained with the one stay those of the other."""
    ours, theirs = load_manifest("hand-sized"), load_manifest("hand-sized-test")
    *same, added = theirs.sources
    assert (tuple(same), theirs.seed, theirs.splits) == (ours.sources, ours.seed, ours.splits)
    assert (added.split, len(set(added.objects)), added.diagonals) == ("test", 30, (0.06, 0.2))


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


def test_source_with_a_split_is_left_out_of_the_random_split():
    drawn = {"kind": "procedural", "licence": "x", "seed": 0, "count": {"bottle": 4}}
    stated = {"kind": "pybullet", "licence": "x", "split": "test", "files": {"duck": {"file": "duck.obj"}, "bunny": {"file": "bunny.obj"}}}
    alone, both = ({item.object_id: item.split for item in manifest(*sources).objects()} for sources in ((drawn,), (drawn, stated)))
    assert both == alone | {"duck": "test", "bunny": "test"}
    counts = {"train": 2, "valid": 1, "test": 1}
    assert Counter(item.split for item in manifest(drawn, stated, splits=counts).objects()) == {"train": 2, "valid": 1, "test": 3}


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


def test_objects_folder_goes_to_the_source_without_a_path(tmp_path):
    for name in "abc":
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.obj").write_text(CUBE)
    named, other, nameless = folder("directory", tmp_path / "a"), folder("directory", tmp_path / "c"), folder("directory")
    assert [item.object_id for item in manifest(named, nameless).objects(tmp_path / "b")] == ["a", "b"]
    assert [item.object_id for item in manifest(named).objects(tmp_path / "b")] == ["b"]
    remedies = "each states its `path`, so leave --objects out", "state the `path` of all but one"
    for sources, remedy in zip(((named, other), (nameless, nameless)), remedies, strict=True):
        with pytest.raises(InvalidInput, match=rf"2 sources of m take a folder, and --objects .* names one: {remedy}"):
            manifest(*sources).objects(tmp_path / "b")


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
        ({"splits": {"train": 0.7, "valid": 0.3, "test": 0.15}}, r"= 1.15; shares must sum to 1, counts be whole"),
        ({"descriptoin": "x"}, "there is no entry descriptoin, did you mean description\\?"),
        (
            {"sources": [{"kind": "cloud", "licence": "x"}]},
            r"unknown kind of source cloud; choose from [^;]*procedural\. The file's entries",
        ),
        ({"seed": -1}, "seed"),
        *(({"name": f"m{character}"}, "name: .*contains the control character") for character in "\0\n\x1b\u202e\u2066"),
        ({"sources": []}, "sources"),
        ({"sources": [{"kind": "directory", "up": "z"}]}, "licence"),
        ({"sources": [{"kind": "directory", "licence": "x", "files": {}}]}, r"there is no entry sources\.0\.files"),
        ({"sources": [{"licence": "x"}]}, r"file .*mine\.yaml: sources\.0: names no kind; write one of pybullet, "),
        ({"sources": [{"kind": "directory", "licence": "x", "metres_per_unit": "mm"}]}, r"metres_per_unit: .* \(it is 'mm'\)"),
        ({"sources": [{"kind": "directory", "licence": "x", "metres_per_unit": 1e-300}]}, r"metres_per_unit: .* \(it is 1e-300\)"),
    ],
)
def test_fault_in_a_manifest_file_is_named(tmp_path, change, reason):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(load_manifest("directory").model_dump(mode="json") | change))
    with pytest.raises(InvalidInput, match=reason):
        load_manifest(str(path))


def test_up_of_a_pybullet_file_overrides_that_of_its_source():
    files = {"duck": {"file": "duck.obj"}, "bunny": {"file": "bunny.obj", "up": "x"}}
    named = manifest({"kind": "pybullet", "licence": "x", "up": "y", "files": files})
    assert {item.object_id: item.source["up"] for item in named.objects()} == {"duck": "y", "bunny": "x"}
    assert named.with_units(None, "z").objects()[1].source["up"] == "z"


def test_units_are_those_of_sources_that_state_none(tmp_path):
    for name in ("stated", "bare"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.obj").write_text(CUBE)
    stated, bare = (folder("directory", tmp_path / name) for name in ("stated", "bare"))
    mixed = manifest(stated | {"metres_per_unit": 1.0}, bare).with_units("mm", "y").objects()
    assert {item.object_id: item.source["metres_per_unit"] for item in mixed} == {"stated": 1.0, "bare": 0.001}
    with pytest.raises(InvalidInput, match="all sources of manifest m state metres_per_unit; leave --units mm out"):
        manifest(stated | {"metres_per_unit": 1.0}).with_units("mm", None)


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


def test_names_in_any_script_are_accepted():
    source = {"kind": "pybullet", "licence": "x", "files": {"duck": {"file": "duck.obj"}}, "category": "می\u200cخواهم 杯\u3000"}
    assert manifest(source).objects()[0].category == source["category"]


HERE, DRAWN = folder("directory", "here"), {"kind": "procedural", "licence": "x", "seed": 0, "count": {"bottle": 1}}
DUCK = {"kind": "pybullet", "licence": "x", "files": {"duck": {"file": "duck.obj"}}}


@pytest.mark.parametrize(
    ("sources", "options", "message"),
    [
        ([HERE], {"splits": {"train": 1298, "valid": 258, "test": 175}}, r"1298 \+ 258 \+ 175 = 1731 objects, the sources list 1"),
        ([HERE | {"split": "test"}], {"splits": {"train": 1, "valid": 1, "test": 0}}, "2 objects, the sources list 0 without the 1"),
        ([HERE, {"kind": "pybullet", "licence": "x"}], {}, "manifest m: a pybullet source names no objects; give it some"),
        ([DRAWN | {"count": {"bottle": 2**31}}], {}, "a source has more than 200000 objects"),
        ([folder("directory", "~nosuchuser/meshes")], {}, "~nosuchuser/meshes is no folder"),
        ([folder("directory")], {}, "give a folder of meshes with --objects DIR"),
        ([folder("directory", "empty")], {}, "no mesh files below"),
        ([HERE, HERE], {}, "two objects are called a"),
        ([DRAWN, DRAWN | {"seed": 1}], {}, "called bottle-0000: a procedural one and .* let one procedural source make both"),
        ([folder("directory", "zarr")], {}, r"cannot name an object; .* the first no '\.', and not zarr\.json: rename it, or its file"),
        ([DUCK | {"category": " "}], {}, "duck has no category; name one"),
        ([DUCK | {"category": "mu\x1bg"}], {}, "'mu.*g' contains the control character"),
        ([DUCK | {"files": {"duck": {"file": "dukc.obj"}}}], {}, r"no 'dukc.obj' in .*; correct the path of duck"),
    ],
)
def test_sources_that_cannot_be_listed_are_refused(tmp_path, monkeypatch, sources, options, message):
    for name in ("here/a.obj", "zarr/zarr.json.obj", "empty/a.txt"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(CUBE)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput, match=message):
        manifest(*sources, **options).objects()


def test_built_in_manifest_without_its_folder_or_with_one_too_many_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput, match=r"data/meshes/household is no folder; give a folder .*`make household`"):
        load_manifest("household").objects()
    with pytest.raises(InvalidInput, match="manifest toy names its own objects: leave --objects"):
        load_manifest("toy").objects(tmp_path)
