"""Sensor and scene files are found by name or path; every unusable entry is named."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from PIL import Image

from pipeline.config.manifest import load_manifest
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path, parse_yaml
from pipeline.formats.hand_file import load_hand
from pipeline.formats.scene_file import load_scene
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.tactile_image import untouched_image


def sensor_file(folder: Path, **changes: Any) -> Path:
    """Write the shipped sensor's file with some entries changed."""
    path = folder / "other.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(description_path("sensor", "gel_16mm").read_text()) | changes))
    return path


def test_sensor_file_is_loaded_by_path(tmp_path: Path) -> None:
    path = sensor_file(tmp_path, name="wide", rows=60, cols=80, width=0.03)
    assert [len(axis) for axis in pixel_centres(load_sensor(path))] == [80, 60]
    assert load_sensor(str(path)) == load_sensor(path)


@pytest.mark.parametrize(
    ("changes", "entry"),
    [
        ({"wdth": 1}, "wdth"),
        ({"width": -1}, r"width: .* \(it is -1\)"),
        ({"name": "my gel"}, r"name: String should match pattern '.*' \(it is 'my gel'\)"),
        ({"surface": {"heights": [[0.006, 0.006], [0.006, 0.006]], "along": "x"}}, "surface: along: x is how a bulge"),
        ({"noise": "some"}, r"noise: Input should be 'none' \(it is 'some'\), or Input should be a valid number"),
        ({"membrane": None}, r"membrane: Input should be a valid number \(it is null\)"),
        ({"name": "a" * 200}, r"name: .* characters\. The file"),
        ({"lights": "red"}, r"lights: it must be a mapping, {NAME: VALUE, …} \(it is 'red'\)"),
        ({"w": float("nan")}, r"w: .* \(it is nan\)"),
        ({"rows": 2**31}, "rows"),
    ],
)
def test_unusable_sensor_entry_is_named_with_its_file(tmp_path: Path, changes: dict[str, object], entry: str) -> None:
    path = sensor_file(tmp_path, **changes)
    with pytest.raises(InvalidInput, match=entry) as error:
        load_sensor(path)
    assert str(path) in str(error.value)


def test_every_unusable_entry_is_named_in_one_line(tmp_path: Path) -> None:
    path = sensor_file(tmp_path, heigth=0.03, rows=48.5)
    with pytest.raises(
        InvalidInput, match=r"rows: .*; there is no entry heigth, did you mean height\? The file's entries are name, width, height, rows"
    ) as error:
        load_sensor(path)
    assert "\n" not in str(error.value)
    path.write_text("name: gel")
    with pytest.raises(InvalidInput, match="entry width is missing; "):
        load_sensor(path)


def test_background_rotated_by_exif_is_upright_at_any_size(tmp_path: Path) -> None:
    described = yaml.safe_load(description_path("sensor", "gelsight").read_text())
    described["calibrated"] |= {"background": "turned.png"}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(described))
    rows, cols = described["rows"], described["cols"]
    exif = Image.Exif()
    exif[0x0112] = 6  # turned by 90° clockwise
    photograph = Image.new("RGB", (rows, cols))
    photograph.paste((200, 200, 200), (0, 0, rows // 2, cols))  # its left half is the upper half when turned
    photograph.save(tmp_path / "turned.png", exif=exif)
    for shape in (None, (20, 30)):
        image = untouched_image(load_sensor(tmp_path / "mine.yaml", shape=shape))
        assert (image[: len(image) // 3] == 200).all()
        assert not image[-len(image) // 3 :].any()


@pytest.mark.parametrize(
    ("kind", "load", "shipped", "path", "entry", "misspelt"),
    [
        ("manifest", load_manifest, "pybullet-objects", ("sources", 0), "random_urdfs", "random_urdf"),
        ("manifest", load_manifest, "toy", ("sources", 0), "count", "counts"),  # of a kind that a package declares
        ("hand", load_hand, "allegro_right", ("fingers", 0, "sensor"), "origin", "orgin"),
        ("sensor", load_sensor, "gelsight_mini", ("calibrated",), "shadows", "shadow"),
        ("scene", load_scene, "supplement", ("cameras", 0), "rotation", "rotaton"),
    ],
)
def test_misspelt_nested_entry_is_guessed(tmp_path: Path, kind, load, shipped, path, entry, misspelt) -> None:
    content = part = yaml.safe_load(description_path(kind, shipped).read_text())
    for step in path:
        part = part[step]
    part[misspelt] = part.pop(entry)
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InvalidInput, match=rf"there is no entry .*\.{misspelt}, did you mean {entry}\?"):
        load(str(tmp_path / "mine.yaml"))


def test_scene_file_with_one_camera_is_refused_with_the_remedy(tmp_path: Path) -> None:
    entries = yaml.safe_load(description_path("scene", "supplement").read_text())
    (camera,) = entries.pop("cameras")
    (tmp_path / "old.yaml").write_text(yaml.safe_dump({**entries, "camera": camera}))
    with pytest.raises(InvalidInput, match=r"old\.yaml: there is no entry camera, did you mean cameras\?"):
        load_scene(tmp_path / "old.yaml")


def test_missing_description_lists_the_shipped_ones() -> None:
    with pytest.raises(InvalidInput, match=r"there is no sensor 'nope'; built in are digit, gel_16mm"):
        load_sensor("nope")
    with pytest.raises(InvalidInput, match=r"there is no scene 'gone\.yaml'; built in are robot, supplement"):
        load_scene("gone.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('a: !!float ""', "has a tag"),
        ("a: &x [1]\nb: *x", "has an alias"),
        ("[" * 99, "nested"),
        ("a: {unit: mm, up: 1, unit: m}", "its entry unit is there twice"),
        ("a: [", r"^a\.yaml cannot be read as YAML: while parsing .*, line 2, column 1$"),  # in one line
    ],
)
def test_aliases_tags_deep_nesting_and_duplicate_entries_are_refused(text: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        parse_yaml(text, "a.yaml")


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"diffuse": 2.0}, "diffuse 2.0 belongs to lights"),
        ({"within": [-8.5, -5, 8.9, 5.8]}, r"within .* lies far beyond the gel, whose rim is 0.00\d+ m and .* in metres"),
        ({"background": 5}, r"calibrated.background: it must be a list, \[VALUE, …\] \(it is 5\), or it must be text"),
    ],
)
def test_calibrated_sensor_refuses_entries_that_contradict_its_colours(tmp_path: Path, changes: dict[str, Any], fault: str) -> None:
    described = yaml.safe_load(description_path("sensor", "gelsight").read_text())
    owner = described if "diffuse" in changes else described["calibrated"]
    owner |= changes
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(described))
    with pytest.raises(InvalidInput, match=fault):
        load_sensor(tmp_path / "mine.yaml")
