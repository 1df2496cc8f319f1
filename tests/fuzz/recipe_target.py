"""Recipes of strangers: what reads them, checks their sources and asks for stages, up to where these would run."""

from __future__ import annotations

import tempfile
import zlib
from contextlib import suppress
from pathlib import Path

import pybullet_data
import yaml

from pipeline.config.manifest import Manifest
from pipeline.dataset.recipe import Recipe, RecipeRow, StageRecipe, object_lines, read_recipe
from pipeline.dataset.recipe_comparison import compare
from pipeline.engine import keys
from pipeline.engine.stage import ObjectStage
from pipeline.export.recipe_writing import DESCRIBED, source_hash
from pipeline.export.remake import Remake, prepare_remake
from pipeline.formats.description_file import parse_yaml, shipped_files
from pipeline.store.directory import DataDirectory
from stages.registry import DATASET, load_stage, resolve
from tests.fuzz.target import Files, Target

ASSETS = Path(__file__).parents[2] / "pipeline" / "assets"
MESH = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
MESHES = {"meshes/a.obj": MESH, "meshes/one/b.obj": MESH, "meshes/two/0123/x/model.obj": MESH}
SPLITS = {"train": 0.5, "valid": 0.25, "test": 0.25}


class Recipes(Target):
    """Recipes; half of those that are YAML still get the checksums of their content."""

    def sound(self) -> list[Files]:
        folder: dict[str, object] = {"kind": "directory", "licence": "CC0", "url": "https://example.org"}
        shapenet: dict[str, object] = {"kind": "shapenet", "licence": "x", "path": "two", "synsets": {"m": "0123"}}
        knife: dict[str, object] = {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"knife": 1}}
        duck: dict[str, object] = {"kind": "pybullet", "licence": "zlib", "files": {"duck": {"file": "duck.obj", "up": "y"}}}
        own = {"own/gel.yaml": (ASSETS / "sensors" / "gel_16mm.yaml").read_bytes()}
        return [
            {"my.recipe.yaml": _recipe(sources, stages).encode(), **MESHES, **own}
            for sources in ([folder], [folder | {"path": "one"}, shapenet], [knife, duck])
            for stages in (1, 2, 4)
        ]

    def read(self, folder: Path, files: Files) -> None:
        path, mark = folder / "my.recipe.yaml", zlib.crc32(files["my.recipe.yaml"])
        if mark % 2:
            _seal(path)
        recipe = read_recipe(path)
        named = any(getattr(source, "kind", "") in ("directory", "catalogue", "shapenet") for source in recipe.manifest.sources)
        asked = prepare_remake(recipe, folder / "meshes" if named else None, folder / "own", 1 if mark % 3 else None)
        _check_places(asked, folder)
        list(asked.requests(folder / "data"))
        compare(recipe, DataDirectory(folder / "data"))


def _recipe(sources: list[dict[str, object]], stages: int) -> str:
    """Write a recipe of objects that are there, with digests of nothing."""
    manifest = {"name": "m", "description": "d", "seed": 0, "splits": SPLITS, "sources": sources}
    told = {}
    for name in DATASET[:stages]:
        stage = load_stage(name)
        assert isinstance(stage, ObjectStage)
        settings = resolve(name, "draft", ["hand=two_finger_gripper", f"simulate-grasps.sensor={ASSETS / 'sensors' / 'gel_16mm.yaml'}"])
        told[name] = StageRecipe(
            settings=settings.results() | ({"sensor": "gel.yaml"} if name == "simulate-grasps" else {}),
            schema_version=stage.output.version,
            code="0" * 64,
            files=keys.assets_digest(stage.assets(settings)) if name != DATASET[-1] else "0" * 64,
            constants="0" * 64,
            roots=("0" * 64,),
        )
    with tempfile.TemporaryDirectory() as root:
        for name, content in MESHES.items():
            (Path(root) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(root) / name).write_bytes(content)
        meshes = Path(root) / "meshes"
        paths = [{"path": meshes / str(source["path"])} if "path" in source else {} for source in sources]
        described = [source | path for source, path in zip(sources, paths, strict=True)]
        named = meshes if sources[0]["kind"] == "directory" and "path" not in sources[0] else None
        items = Manifest.model_validate({**manifest, "sources": described}).objects(named)
        rows = [(item.object_id, RecipeRow(source_hash(item.source), ("0" * 16,) * stages)) for item in items]
    whole = {"manifest": manifest, "preset": "draft", "seed": 0, "shards": 1, "stages": told, "versions": {"numpy": "2.4.6"}}
    return Recipe.model_validate({**whole, "processors": ["x"], "objects": object_lines(rows)}).text()


def _seal(path: Path) -> None:
    with suppress(ValueError, yaml.YAMLError, RecursionError, TypeError):
        content = parse_yaml(path.read_text())
        path.write_text(Recipe.model_validate(content).text())


def _check_places(asked: Remake, folder: Path) -> None:
    """Hold that whatever would be opened lies in a folder that the user gave, or in a package."""
    allowed = [(folder / "meshes").resolve(), (folder / "own").resolve(), Path(pybullet_data.getDataPath()).resolve()]
    opened = [Path(item.source["file"]) for item in asked.items if "file" in item.source]
    for settings in asked.settings.values():
        for name, kind in DESCRIBED.items():
            values = getattr(settings, name, None) or ()
            opened += [Path(value) for value in ((values,) if isinstance(values, str) else values) if value not in shipped_files(kind)]
    for path in opened:
        if not any(path.resolve().is_relative_to(place) for place in allowed):
            raise AssertionError(f"a recipe leads to {path}")
