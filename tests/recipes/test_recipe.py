"""Recipes: datasets remade from them, and errors that name the remedy."""

from __future__ import annotations

import importlib.metadata
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from trimesh.visual import TextureVisuals
from typer.testing import CliRunner

import pipeline
from pipeline.cli import app
from pipeline.errors import InvalidInput
from pipeline.recipes.recipe import Recipe, read_recipe
from pipeline.recipes.remake import _check_stages
from tests.command_line import vt

OWN = {"simulate-grasps.hand": "robot/hand.yaml", "simulate-grasps.sensor": "gels/my_gel.yaml", "render-vision.scene": "my_scene.yaml"}
"""Description files of the publisher."""
TEXTS = [
    "gels/my_gel.yaml",
    "my_scene.yaml",
    "robot/hand.yaml",
    "robot/meshes/material.mtl",
    "robot/package.xml",
    "robot/urdf/gripper.urdf",
]
"""Files among them that the recipe holds as text."""
FILES = ["gels/untouched.png", "robot/meshes/material_0.png", "robot/meshes/palm.obj"]
"""Files of which it holds the SHA-256."""
QUICK = ("sample-surfaces.points=300", "simulate-grasps.attempts=3", "simulate-grasps.grasps=2", "simulate-grasps.ik_samples=64")
ASSETS = Path(pipeline.__file__).parent / "assets"
STAGES = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")


def recipe_of(data: Path, *options: object) -> str:
    """Return the lines that `recipe` prints."""
    return CliRunner().invoke(app, ["recipe", str(data), *map(str, options)]).output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder of meshes, one with a material, and a manifest of the meshes and a procedural object."""
    folder = tmp_path_factory.mktemp("publisher")
    (folder / "meshes").mkdir()
    trimesh.creation.icosphere(2, 30).export(folder / "meshes" / "ball.ply")
    box = trimesh.creation.box((50, 60, 40)).export(file_type="obj")
    (folder / "meshes" / "box.obj").write_text(f"mtllib box.mtl\nusemtl skin\n{box}")
    (folder / "meshes" / "box.mtl").write_text("newmtl skin\nKd 0.5 0.2 0.1\n")
    _write_own_files(folder / "own")
    sources = [
        {"kind": "directory", "licence": "CC0", "path": "meshes", "metres_per_unit": 0.001, "url": "https://example.org/meshes"},
        {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": 1}},
    ]
    splits = {"train": 0.5, "valid": 0.25, "test": 0.25}
    manifest = {"name": "things", "description": "Things.", "seed": 3, "splits": splits, "sources": sources}
    (folder / "things.yaml").write_text(yaml.safe_dump(manifest))
    return folder


def _write_own_files(folder: Path) -> None:
    """Write a sensor with a photograph as its background, a hand with a mesh that has a texture, and a scene."""
    for name in ("gels", "robot/urdf", "robot/meshes"):
        (folder / name).mkdir(parents=True)
    gel = yaml.safe_load((ASSETS / "sensors" / "gel_16mm.yaml").read_text())
    colours = yaml.safe_load((ASSETS / "sensors" / "gelsight.yaml").read_text())["calibrated"] | {"background": "untouched.png"}
    gel |= {"rows": 24, "cols": 24, "calibrated": colours}
    del gel["lights"]
    (folder / "gels" / "my_gel.yaml").write_text(f"# of our own\n{yaml.safe_dump(gel)}")
    levels = np.arange(24 * 24 * 3, dtype=np.uint8).reshape(24, 24, 3)
    Image.fromarray(levels).save(folder / "gels" / "untouched.png")
    shutil.copy(ASSETS / "scenes" / "supplement.yaml", folder / "my_scene.yaml")
    hand = (ASSETS / "hands" / "two_finger_gripper.yaml").read_text()
    (folder / "robot" / "hand.yaml").write_text(hand.replace("model: ", "model: urdf/").replace("urdf/two_finger_", "urdf/"))
    urdf = (ASSETS / "hands" / "two_finger_gripper.urdf").read_text()
    mesh = '<mesh filename="package://robot/meshes/palm.obj"/></geometry>'
    urdf, count = re.subn('<box size="0.06 0.17 0.05"/></geometry>(<material name="shell"/>)?', mesh, urdf)
    assert count == 2
    (folder / "robot" / "urdf" / "gripper.urdf").write_text(urdf)
    (folder / "robot" / "package.xml").write_text("<package/>")
    palm = trimesh.creation.box((0.06, 0.17, 0.05))
    palm.visual = TextureVisuals(np.random.default_rng(0).random((8, 2)), image=Image.fromarray(levels))
    palm.export(folder / "robot" / "meshes" / "palm.obj")


@pytest.fixture(scope="module")
def published(folder: Path) -> Path:
    """Make a dataset and its recipe, as a publisher does."""
    own_settings = [f"{setting}={folder / 'own' / name}" for setting, name in OWN.items()]
    settings = [part for assignment in (*QUICK, *own_settings, "render-vision.resolution=32") for part in ("--set", assignment)]
    for stage in STAGES:
        options = ["--manifest", folder / "things.yaml", "--data", folder / "data", "--executor", "serial", *settings]
        vt("run", stage, *options)
    path = folder / "things.recipe.yaml"
    path.write_text(recipe_of(folder / "data", "--files-url", "https://example.org/hand"))
    return path


@pytest.fixture(scope="module")
def remade(published: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Remake the dataset elsewhere in three shards without the publisher's files; return the folder and the output."""
    place, publisher = tmp_path_factory.mktemp("reader"), published.parent
    shutil.copytree(publisher / "meshes", place / "mine")
    for name in FILES:
        (place / "own" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(publisher / "own" / name, place / "own" / name)
    away = [(publisher / name, publisher / f"{name}-away") for name in ("meshes", "own")]
    for here, there in away:
        here.rename(there)
    output = vt("remake", published, *options_of(place), "--shards", 3)
    for here, there in away:
        there.rename(here)
    return place, output


def options_of(place: Path, data: Path | None = None) -> list[object]:
    options = ["--objects", place / "mine", "--descriptions", place / "own", "--data", data or place / "data"]
    return [*options, "--executor", "serial"]


def change_recipe(recipe: Path, place: Path, change: Callable[[dict[str, Any]], None], *, sealed: bool = True) -> Path:
    """Change a recipe; `sealed` also updates its checksums, as an attacker would."""
    content = yaml.safe_load(recipe.read_text())
    change(content)
    path = place / "changed.recipe.yaml"
    if sealed:
        path.write_text(Recipe.model_validate(content).text())
    else:
        lines = "".join(f"  {line}\n" for line in content.pop("objects").splitlines())
        path.write_text(f"{yaml.safe_dump(content)}objects: |\n{lines}")
    return path


def remake_with(recipe: Path, remade: tuple[Path, str]) -> str:
    """Run the same command with another recipe, which fails; rows of the same keys are reused."""
    return vt("remake", recipe, *options_of(remade[0]), fails=True)


def test_dataset_remade_in_other_shards_is_equal(remade: tuple[Path, str]) -> None:
    assert "12 rows compared, all equal" in remade[1]
    assert json.loads((remade[0] / "data" / "dataset.json").read_text()) == {"shards": 3}


@pytest.mark.slow
def test_dataset_remade_by_two_workers_is_equal(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    options = [option for option in options_of(remade[0], tmp_path / "d") if option not in ("--executor", "serial")]
    assert "12 rows compared, all equal" in vt("remake", published, *options, "--workers", 2, "--shards", 2)


def test_recipe_is_small_and_survives_a_round_trip(published: Path, tmp_path: Path) -> None:
    text, recipe = published.read_text(), read_recipe(published)
    assert recipe.text() == text
    assert len(text) - sum(map(len, recipe.texts.values())) < 10_000
    lines = text.partition("\nobjects: |\n")[2].splitlines(keepends=True)
    assert len(lines) == 3
    assert max(map(len, lines)) <= 200
    assert str(published.parent) not in text
    (windows := tmp_path / "windows.recipe.yaml").write_bytes(text.replace("\n", "\r\n").encode())
    assert read_recipe(windows).text() == text


def test_full_digests_are_written_with_rows(published: Path, tmp_path: Path) -> None:
    (whole := tmp_path / "whole.recipe.yaml").write_text(recipe_of(published.parent / "data", "--rows"))
    short, long = read_recipe(published).rows, read_recipe(whole).rows
    assert {name: tuple(digest[:16] for digest in row.digests) for name, row in long.items()} == {
        n: row.digests for n, row in short.items()
    }
    assert {len(digest) for row in long.values() for digest in row.digests} == {64}


def test_published_rows_are_compared_without_computing(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    assert "12 rows compared, all equal" in vt("validate", published.parent / "data", "--recipe", published)
    other = change_recipe(published, tmp_path, lambda content: content.update(objects=_other_digest(content["objects"], "ball", 1)))
    assert "simulate-grasps: other rows of ball" in vt("validate", remade[0] / "data", "--recipe", other, fails=True)


def test_sample_is_made_and_compared(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    output = vt("remake", published, *options_of(remade[0], tmp_path / "d"), "--sample", 1)
    assert "1 object of 3 to make" in output
    assert "4 rows compared, all equal" in output
    output = vt("remake", published, *options_of(remade[0], tmp_path / "d"), "--sample", 1, fails=True)
    assert "holds a dataset, whose other rows a sample would replace; name a new folder" in output


def test_changed_byte_of_a_mesh_is_named(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    shutil.copytree(remade[0] / "mine", tmp_path / "mine")
    options = ["--objects", tmp_path / "mine", "--descriptions", remade[0] / "own", "--data", tmp_path / "d"]
    mesh = tmp_path / "mine" / "ball.ply"
    content = bytearray(mesh.read_bytes())
    content[-1] ^= 1
    mesh.write_bytes(content)
    (tmp_path / "mine" / "box.mtl").write_text("newmtl skin\nKd 0.5 0.2 0.2\n")
    output = vt("remake", published, *options, fails=True)
    assert f"2 sources changed: ball: {mesh} has SHA-256" in output
    assert f"box: {tmp_path / 'mine' / 'box.obj'}, or a file that it names, has SHA-256" in output
    assert "download them from https://example.org/meshes" in output
    assert not (tmp_path / "d").exists()


def test_missing_and_extra_sources_are_named(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    shutil.copytree(remade[0] / "mine", tmp_path / "mine")
    options = ["--objects", tmp_path / "mine", "--descriptions", remade[0] / "own", "--data", tmp_path / "d"]
    (tmp_path / "mine" / "ball.ply").unlink()
    output = vt("remake", published, *options, fails=True)
    assert "1 object of the recipe not found (ball)" in output
    assert read_recipe(published).rows["ball"].source in output
    shutil.copytree(remade[0] / "mine", tmp_path / "mine", dirs_exist_ok=True)
    trimesh.creation.box().export(tmp_path / "mine" / "another.ply")
    assert "1 object not in the recipe (another)" in vt("remake", published, *options, fails=True)


@pytest.mark.parametrize("sealed", [False, True])
def test_changed_setting_is_named(published: Path, remade: tuple[Path, str], tmp_path: Path, *, sealed: bool) -> None:
    def change(content: dict[str, Any]) -> None:
        content["stages"]["sample-surfaces"]["settings"]["points"] = 301

    other = change_recipe(published, tmp_path, change, sealed=sealed)
    output = vt("remake", other, *options_of(remade[0], tmp_path / "d"), "--sample", 1, fails=True)
    if not sealed:
        assert "its sample-surfaces changed since it was written" in output
        return
    assert re.search(r"differs in 4 of 4 rows sample-surfaces: other rows of \w+", output)
    assert "3 rows of later stages, made from these, differ too" in output
    assert "settings of sample-surfaces that differ from preset draft: points=301" in output


def test_library_of_another_version_is_named_if_rows_differ(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        content["versions"]["trimesh"] = "99.0"
        content["objects"] = _other_digest(content["objects"], "box", 0)

    output = remake_with(change_recipe(published, tmp_path, change), remade)
    assert "differs in 1 of 12 rows sample-surfaces: other rows of box" in output
    version = importlib.metadata.version("trimesh")
    assert f"may come of this: trimesh is {version} here, 99.0 there: pip install trimesh==99.0" in output


def test_changed_digests_are_named(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    changed_recipe = change_recipe(
        published, tmp_path, lambda content: content.update(objects=_other_digest(content["objects"], "box", 3)), sealed=False
    )
    assert "its objects changed since it was written" in remake_with(changed_recipe, remade)

    def root(content: dict[str, Any]) -> None:
        content["stages"]["simulate-touch"]["roots"][0] = "1" * 64

    assert "simulate-touch: each row agrees, but not the root of shard 0" in remake_with(change_recipe(published, tmp_path, root), remade)

    def constants(content: dict[str, Any]) -> None:
        content["stages"]["render-vision"]["constants"] = "1" * 64

    assert "render-vision: the arrays that all objects share differ" in remake_with(change_recipe(published, tmp_path, constants), remade)


def test_dataset_of_other_inputs_or_without_rows_has_no_recipe(published: Path, tmp_path: Path) -> None:
    shutil.copytree(published.parent, tmp_path / "p")
    (tmp_path / "p" / "meshes" / "ball.ply").write_bytes((tmp_path / "p" / "meshes" / "ball.ply").read_bytes() + b"\n")
    output = vt("recipe", tmp_path / "p" / "data", "--manifest", tmp_path / "p" / "things.yaml", fails=True)
    assert "surfaces/0000-of-0001 is out of date: sample-surfaces of vt-pipeline" in output
    manifest = tmp_path / "p" / "things.yaml"
    shutil.copy(published.parent / "meshes" / "ball.ply", tmp_path / "p" / "meshes" / "ball.ply")
    manifest.write_text(manifest.read_text().replace("CC0", "CC-BY-4.0"))
    output = vt("recipe", tmp_path / "p" / "data", "--manifest", manifest, fails=True)
    assert "has licence 'CC0' and file 'ball.ply' there, and others in the manifest; delete that folder" in output
    assert "surfaces has not been made; run `vt-pipeline run sample-surfaces --data" in vt("recipe", tmp_path, fails=True)


def test_recipe_without_images_can_be_remade_and_one_without_what_a_stage_reads_cannot(published: Path, remade: tuple[Path, str]) -> None:
    recipe = read_recipe(published)
    names = list(recipe.stages)

    def with_stages(*chosen: str) -> Recipe:
        return recipe.model_copy(update={"stages": {name: recipe.stages[name] for name in chosen}})

    _check_stages(with_stages(*(name for name in names if name != "render-vision")))
    for chosen in (names[1:], [names[0], names[-1]], names[::-1]):
        with pytest.raises(InvalidInput, match="is out of place"):
            _check_stages(with_stages(*chosen))


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("stages", "simulate-grasps", "settings", "hand"), "/etc/hostname", "unknown hand /etc/hostname"),
        (("stages", "simulate-grasps", "settings", "hand"), "../hand.yaml", "unknown hand ../hand.yaml"),
        (("stages", "simulate-grasps", "settings", "hand"), "my_hand.yaml", "unknown hand my_hand.yaml"),
        (("stages", "simulate-grasps", "settings", "hand"), "robot/meshes/palm.obj", "unknown hand robot/meshes/palm.obj"),
        (("stages", "simulate-grasps", "settings", "hand"), {"a": [1]}, "unknown hand {'a': [1]}"),
        (("texts", "../x.yaml"), "a: 1", "'../x.yaml' must be a path below its folder"),
        (("texts", "robot/.ssh/x.yaml"), "a: 1", "'robot/.ssh/x.yaml' must be a path below its folder"),
        (("texts", "setup.py"), "a: 1", "'setup.py' is no name of a text file"),
        (("texts", f"{'x' * 255}.yaml"), "a: 1", "x' must be a path below its folder"),
        (("texts", "my_scene.yaml/x.yaml"), "a: 1", "x.yaml cannot be written"),
        (("files", "/etc/hostname"), "0" * 64, "'/etc/hostname' must be a path below its folder"),
        (("files_url",), "file:///etc/hostname", "files_url: String should match pattern"),
        (("stages", "simulate-touch", "settings", "sensors"), ["/tmp/x.yaml"], "unknown sensor /tmp/x.yaml"),
        (("stages", "render-vision", "settings", "scene"), "~/scene.yaml", "unknown scene ~/scene.yaml"),
        (("manifest", "sources", 0, "path"), "/etc", "must be"),
        (("manifest", "sources", 0, "path"), "..", "must be a path below its folder"),
        (("manifest", "sources", 0, "path"), "x" * 256, "must be a path below its folder"),
        (("manifest", "sources", 0, "url"), "javascript:alert(1)", "url: String should match pattern"),
        (("manifest", "name"), "a\x1b[2J", "contains the control character"),
        (("versions", "numpy"), "2; rm -rf ~", "versions.numpy: String should match pattern"),
        (("shards",), 2, "has 1 roots, its shards are 2"),
        (("recipe",), 2, "has version 2, this vt-pipeline reads 1"),
        (("stages", "sample-surfaces", "settings", "ponts"), 3, "there is no entry ponts, did you mean points?"),
        (("stages", "sample-surfaces", "code"), "x", "code: String should match pattern"),
        (("objects",), "", "it has no objects"),
        (("objects",), "../../x ~0123456789abcdef" + " 0123456789abcdef" * 4 + "\n", "line 1 of its objects"),
    ],
)
def test_hostile_entry_is_refused_with_a_clear_error(
    published: Path, remade: tuple[Path, str], tmp_path: Path, place: tuple[Any, ...], value: Any, message: str
) -> None:
    def change(content: dict[str, Any]) -> None:
        for step in place[:-1]:
            content = content[step]
        content[place[-1]] = value

    path = change_recipe(published, tmp_path, change, sealed=False)
    try:
        content = yaml.safe_load(path.read_text())
        path.write_text(Recipe.model_validate(content).text())  # sealed if it is valid
    except ValueError:
        pass
    output = remake_with(path, remade)
    assert "this is a bug" not in output
    assert message in output


@pytest.mark.parametrize(
    "source",
    [
        {"kind": "pybullet", "licence": "x", "files": {"a": {"file": "../../../etc/hostname"}}},
        {"kind": "pybullet", "licence": "x", "files": {"a": {"file": "/etc/hostname"}}},
        {"kind": "shapenet", "licence": "x", "synsets": {"a": ".."}},
        {"kind": "shapenet", "licence": "x", "synsets": {"a": "1"}, "meshes": "../.."},
        {"kind": "shapenet", "licence": "x", "synsets": {"a": "1"}, "renderings": "/tmp"},
    ],
)
def test_source_outside_its_folder_is_refused(published: Path, tmp_path: Path, source: dict[str, Any]) -> None:
    path = change_recipe(published, tmp_path, lambda content: content["manifest"]["sources"].append(source), sealed=False)
    with pytest.raises(InvalidInput, match="must be a path below its folder"):
        read_recipe(path)


def test_recipe_carries_the_hand_sensor_and_scene_of_the_publisher(published: Path, remade: tuple[Path, str]) -> None:
    recipe = read_recipe(published)
    settings = {
        f"{stage}.{setting}": value for stage, stage_entry in recipe.stages.items() for setting, value in stage_entry.settings.items()
    }
    assert {setting: settings[setting] for setting in OWN} == OWN
    assert settings["render-vision.hand"] == "robot/hand.yaml"
    assert settings["simulate-touch.sensors"] == ["gels/my_gel.yaml"] * 2
    assert sorted(recipe.texts) == TEXTS
    assert sorted(recipe.files) == FILES
    for name in TEXTS:
        assert (remade[0] / "own" / name).read_text() == recipe.texts[name] == (published.parent / "own" / name).read_text()
    assert "    # of our own\n    calibrated:" in published.read_text()  # comments are kept for readers


def test_missing_or_changed_description_files_are_named(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    sha256_of = read_recipe(published).files
    output = vt("remake", published, "--objects", remade[0] / "mine", "--data", tmp_path / "d", fails=True)
    place = tmp_path / "d" / "descriptions"
    assert f"3 hand, sensor or scene files to restore: {place / FILES[0]} is missing" in output
    assert all(sha256_of[name] in output for name in FILES)
    assert "Download them from https://example.org/hand" in output
    assert not (tmp_path / "d").exists()
    shutil.copytree(remade[0] / "own", place)
    (place / "gels" / "my_gel.yaml").write_text((place / "gels" / "my_gel.yaml").read_text().replace("diffuse: 1.0", "diffuse: 1.5"))
    (place / FILES[1]).write_bytes((place / FILES[1]).read_bytes() + b"x")
    output = vt("remake", published, "--objects", remade[0] / "mine", "--data", tmp_path / "d", fails=True)
    assert f"2 hand, sensor or scene files to restore: {place / 'gels' / 'my_gel.yaml'} has SHA-256" in output
    assert f"the recipe says {sha256_of[FILES[1]]}" in output


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("robot/hand.yaml", "urdf/gripper.urdf", "/etc/gripper.urdf"),
        ("robot/hand.yaml", "urdf/gripper.urdf", "../../gripper.urdf"),
        ("robot/hand.yaml", "sensor: gel_16mm", "sensor: ~/gel.yaml"),
        ("gels/my_gel.yaml", "untouched.png", "../../../untouched.png"),
        ("robot/urdf/gripper.urdf", "package://robot/meshes/palm.obj", "../../../palm.obj"),
    ],
)
def test_description_file_that_names_a_file_elsewhere_is_refused(
    published: Path, remade: tuple[Path, str], tmp_path: Path, name: str, old: str, new: str
) -> None:
    def change(content: dict[str, Any]) -> None:
        assert old in content["texts"][name]
        content["texts"][name] = content["texts"][name].replace(old, new)
        del content["texts"]["robot/package.xml"]

    own = tmp_path / "here" / "own"
    for file in FILES:
        (own / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(remade[0] / "own" / file, own / file)
    shutil.copy(remade[0] / "own" / "robot" / "meshes" / "palm.obj", tmp_path / "here")
    (tmp_path / "package.xml").write_text("<package/>")  # loading the hand would accept a mesh from here
    options = ["--objects", remade[0] / "mine", "--descriptions", own, "--data", tmp_path / "d"]
    output = vt("remake", change_recipe(published, tmp_path, change), *options, fails=True)
    named = re.escape(new.removeprefix("sensor: "))
    assert re.search(rf"the recipe's {name.replace('urdf/gripper.urdf', 'hand.yaml')} names '\S*{named}', which may lie outside", output)
    assert not (tmp_path / "d").exists()


def test_description_file_that_names_a_missing_file_is_refused(published: Path, remade: tuple[Path, str], tmp_path: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        texts = content["texts"]
        texts["gels/my_gel.yaml"] = texts["gels/my_gel.yaml"].replace("untouched.png", "other.png")
        texts["robot/hand.yaml"] = texts["robot/hand.yaml"].replace("sensor: gel_16mm", "sensor: ../gels/my_gel.yaml")
        content["stages"]["simulate-grasps"]["settings"]["sensor"] = None

    shutil.copytree(remade[0] / "own", tmp_path / "own")
    for name in ("gels/my_gel.yaml", "robot/hand.yaml"):
        (tmp_path / "own" / name).unlink()
    options = ["--objects", remade[0] / "mine", "--descriptions", tmp_path / "own", "--data", tmp_path / "d"]
    output = vt("remake", change_recipe(published, tmp_path, change), *options, fails=True)
    assert f"simulate-grasps: {tmp_path / 'own' / 'robot' / '..' / 'gels' / 'other.png'} cannot be read" in output


def _other_digest(lines: str, name: str, column: int) -> str:
    """Change the digest of an object's row."""
    changed_lines = []
    for line in lines.splitlines():
        words = line.split(" ")
        if words[0] == name:
            words[2 + column] = "0" * 16
        changed_lines.append(" ".join(words))
    return "\n".join(changed_lines) + "\n"
