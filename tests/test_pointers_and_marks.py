"""Git LFS pointers are named, and byte-order marks skipped, in every kind of file that is read."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.config.manifest import load_manifest
from pipeline.config.sources import Object, fingerprint, identity
from pipeline.contrib.calibration.ball_photographs import CIRCLES, _read_circles
from pipeline.errors import PipelineError
from pipeline.formats.file_content import MESH_SUFFIXES
from pipeline.formats.image_file import read_depth, read_image, read_mask
from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.rendering_folder import read_renderings
from pipeline.formats.sensor_file import load_sensor
from pipeline.formats.urdf import parse_urdf
from pipeline.kernels.touch.sensor import Sensor
from pipeline.models.model_files import DESCRIPTION, WEIGHTS, read_description, read_weights
from pipeline.models.shipped_weights import card_path, read_card
from pipeline.recipes.recipe import read_recipe
from pipeline.reconstruct.observation_file import read_observation
from pipeline.store.storage import read_bytes
from stages.sample_surfaces import SampleSurfaces, SurfaceSettings
from tests.collada_text import collada_text

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:" + 64 * "5" + "\nsize 70000\n"
BOX = trimesh.creation.box()
MARKED = ["utf-8-sig", "utf-16", "utf-32"]


def read_rendering(path: Path) -> object:
    for number in range(24):
        Image.new("RGBA", (137, 137)).save(path.with_name(f"{number:02d}.png"))
    return read_renderings(path.parent)


READERS: dict[str, Callable[[Path], object]] = {
    "photograph.png": read_image,
    "mask.png": read_mask,
    "depth.png": read_depth,
    "depth.npy": read_depth,
    "sensor.yaml": load_sensor,
    "observation.yaml": read_observation,
    "manifest.yaml": lambda path: load_manifest(str(path)),
    "recipe.yaml": read_recipe,
    "hand.urdf": parse_urdf,
    "rendering_metadata.txt": read_rendering,
    CIRCLES: _read_circles,
    DESCRIPTION: lambda path: read_description(path.parent, Sensor),
    WEIGHTS: lambda path: read_weights(path.parent),
    "dataset.json": read_bytes,
}


@pytest.mark.parametrize("name", READERS)
def test_pointer_in_place_of_a_file_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(POINTER)
    with pytest.raises(PipelineError, match=rf"{name} is a Git LFS pointer; run `git lfs pull`"):
        READERS[name](tmp_path / name)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<!DOCTYPE html><title>404</title>", "a web page"),
        (b"404: Not Found", "an error message of a server"),
        (b"\x1f\x8b\x08\0", "compressed, or an archive"),
    ],
)
def test_other_content_in_place_of_a_mesh_is_named(tmp_path: Path, suffix: str, content: bytes, words: str) -> None:
    (tmp_path / f"a{suffix}").write_bytes(content)
    with pytest.raises(PipelineError, match=rf"^a{suffix} is {words}"):
        parse_mesh(tmp_path / f"a{suffix}", tmp_path)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_pointer_in_place_of_a_mesh_is_named_by_its_reader_and_its_key(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text(POINTER)
    source = {"file": str(path), "root": str(tmp_path)}
    for read in (lambda: parse_mesh(path, tmp_path), lambda: fingerprint(source), lambda: identity(source)):
        with pytest.raises(PipelineError, match=rf"a{suffix} is a Git LFS pointer; run `git lfs pull`"):
            read()


def test_photograph_that_a_sensor_file_names_and_a_card_are_named_as_pointers(tmp_path: Path) -> None:
    background = "calibrated: {coefficients: [[[0], [0]], [[0], [0]], [[0], [0]]], background: untouched.png}"
    text = f"name: a\nwidth: 0.02\nheight: 0.02\nrows: 4\ncols: 4\nw: 0.002\nrange: 0.01\nnoise: none\n{background}\n"
    (tmp_path / "a.yaml").write_text(text)
    (tmp_path / "untouched.png").write_text(POINTER)
    with pytest.raises(PipelineError, match=r"untouched\.png is a Git LFS pointer"):
        load_sensor(tmp_path / "a.yaml")
    card = card_path(tmp_path, "implicit-any")
    card.parent.mkdir(parents=True, exist_ok=True)
    card.write_text(POINTER)
    with pytest.raises(PipelineError, match="is a Git LFS pointer"):
        read_card("implicit-any", tmp_path)


def test_pointers_among_objects_cause_no_other_warning(tmp_path: Path) -> None:
    sources = []
    for name in ("a.obj", "b.glb"):
        (tmp_path / name).write_text(POINTER)
        sources.append({"file": str(tmp_path / name), "metres_per_unit": 1.0 if name == "b.glb" else None})
    BOX.export(tmp_path / "c.stl")
    sources.append({"file": str(tmp_path / "c.stl"), "metres_per_unit": None})
    objects = [Object(Path(source["file"]).stem, "object", source) for source in sources]
    (line,) = SampleSurfaces().describe_objects(SurfaceSettings(), objects)
    assert line.startswith("1 object without a unit, scaled")


@pytest.mark.parametrize("encoding", MARKED)
@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "stl", "dae", "gltf"])
def test_mark_before_a_mesh_is_skipped(tmp_path: Path, suffix: str, encoding: str) -> None:
    if suffix == "gltf":
        files = trimesh.Scene(BOX).export(file_type="gltf")
        for name, content in files.items():
            (tmp_path / name).write_bytes(content)
        text = files["model.gltf"].decode()
    elif suffix == "dae":
        text = collada_text(BOX)
    else:
        options = {"ply": {"encoding": "ascii"}}.get(suffix, {})
        exported = BOX.export(file_type="stl_ascii" if suffix == "stl" else suffix, **options)
        text = exported.decode() if isinstance(exported, bytes) else exported
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(text.encode(encoding))
    mesh = parse_mesh(path, tmp_path)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [1, 1, 1])
    assert len(mesh.faces) == 12


def test_mark_before_a_binary_ply_is_skipped_and_one_in_the_header_of_a_binary_stl_is_not(tmp_path: Path) -> None:
    ply, stl = (BOX.export(file_type=kind) for kind in ("ply", "stl"))
    (tmp_path / "a.ply").write_bytes(b"\xef\xbb\xbf" + ply)
    (tmp_path / "a.stl").write_bytes(b"\xef\xbb\xbf" + stl[3:])
    for name in ("a.ply", "a.stl"):
        assert len(parse_mesh(tmp_path / name, tmp_path).faces) == 12


LINE = "15 25 0 0.7 25\n"
TEXTS = {
    "observation.yaml": "a: 1\n",
    "hand.urdf": '<?xml version="1.0" encoding="utf-8"?><robot name="a"/>',
    "rendering_metadata.txt": 24 * LINE,
    CIRCLES: "name,x,y,radius\na.png,5,5,9\n",
}


@pytest.mark.parametrize("encoding", MARKED)
@pytest.mark.parametrize("name", TEXTS)
def test_mark_before_a_text_is_skipped(tmp_path: Path, name: str, encoding: str) -> None:
    texts = []
    for number, coded in enumerate(("utf-8", encoding)):
        path = tmp_path / str(number) / name
        path.parent.mkdir()
        path.write_bytes(TEXTS[name].replace("utf-8", coded.removesuffix("-sig")).encode(coded))
        content = READERS[name](path)
        texts.append(content[1] if name == "rendering_metadata.txt" else content.attrib if name == "hand.urdf" else content)
    assert texts[0] == texts[1]
    assert texts[0]
