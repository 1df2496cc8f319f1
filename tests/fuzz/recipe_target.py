"""Recipes of strangers: they are read, their sources are checked and stages are requested but not run."""

from __future__ import annotations

import hashlib
import io
import os
import sys
import tempfile
import zlib
from contextlib import suppress
from pathlib import Path

import yaml
from PIL import Image

from pipeline.config.manifest import Manifest
from pipeline.dataset.recipe import Recipe, RecipeRow, StageRecipe, object_lines, read_recipe
from pipeline.dataset.recipe_comparison import compare
from pipeline.engine import keys
from pipeline.engine.stage import ObjectStage
from pipeline.export.recipe_writing import source_hash
from pipeline.export.remake import prepare_remake
from pipeline.formats.description_file import parse_yaml
from pipeline.store.directory import DataDirectory
from stages.registry import DATASET, load_stage, resolve
from tests.fuzz.target import Files, Target

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "pipeline" / "assets"
MESH = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
MESHES = {"meshes/a.obj": MESH, "meshes/one/b.obj": MESH, "meshes/two/0123/x/model.obj": MESH}
SPLITS = {"train": 0.5, "valid": 0.25, "test": 0.25}


HAND = (ASSETS / "hands" / "two_finger_gripper.yaml").read_bytes().replace(b"urdf: ", b"urdf: urdf/")
GEL = (ASSETS / "sensors" / "gel_16mm.yaml").read_bytes().partition(b"# P of")[0]
COLOURS = b"calibrated: {coefficients: [" + b", ".join([b"[[0.0], [0.0]]"] * 3) + b"], background: untouched.png}\n"
TEXTS = {
    "robot/hand.yaml": HAND.replace(b"sensor: gel_16mm", b"sensor: ../gel.yaml"),
    "robot/urdf/two_finger_gripper.urdf": (ASSETS / "hands" / "two_finger_gripper.urdf")
    .read_bytes()
    .replace(b'<box size="0.06 0.17 0.05"/>', b'<mesh filename="../palm.obj"/>'),
    "gel.yaml": GEL.replace(b"100", b"4") + COLOURS,
    "scene.yaml": (ASSETS / "scenes" / "supplement.yaml").read_bytes(),
}


def _png() -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (4, 4), (90, 80, 70)).save(file, "PNG")
    return file.getvalue()


BESIDE = {"robot/palm.obj": MESH, "untouched.png": _png()}
"""Files of a hand and a sensor in the user's folder; `TEXTS` are the texts of hand, sensor and scene that recipes hold."""
ELSEWHERE = ("../../secret.obj", "../secret.obj", "../../../secret.obj", "/etc/hostname", "~/secret.obj", "package://etc/hostname")
"""Names of files that a recipe must not lead to; `_secrets` writes some."""


class Recipes(Target):
    """Recipes; most of them, if still YAML, get the checksums of their content and the mutated hand, sensor and scene."""

    def __init__(self) -> None:
        super().__init__()
        self.opened: list[tuple[Path, str]] | None = None
        sys.addaudithook(self._note)

    def sound(self) -> list[Files]:
        folder: dict[str, object] = {"kind": "directory", "licence": "CC0", "url": "https://example.org"}
        shapenet: dict[str, object] = {"kind": "shapenet", "licence": "x", "path": "two", "synsets": {"m": "0123"}}
        knife: dict[str, object] = {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"knife": 1}}
        duck: dict[str, object] = {"kind": "pybullet", "licence": "zlib", "files": {"duck": {"file": "duck.obj", "up": "y"}}}
        own = {f"own/{name}": content for name, content in BESIDE.items()} | {f"texts/{name}": content for name, content in TEXTS.items()}
        return [
            {"my.recipe.yaml": _recipe(sources, stages).encode(), **MESHES, **own}
            for sources in ([folder], [folder | {"path": "one"}, shapenet], [knife, duck])
            for stages in (1, 2, 4)
        ]

    def read(self, folder: Path, files: Files) -> None:
        path, mark = folder / "my.recipe.yaml", zlib.crc32(b"".join(files.values()))
        for leftover in set((folder / "own").rglob("*")) - {folder / name for name in files}:  # files of an earlier recipe
            if not leftover.is_dir():
                leftover.unlink()
        if mark % 3:
            _seal(path, mark)
        for place in (folder, folder / "robot"):
            place.mkdir(exist_ok=True)
            (place / "secret.obj").write_bytes(MESH)
        try:
            self.opened = []
            self._remake(path, mark)
        finally:
            opened, self.opened = self.opened, None
            _check_opened(opened or [], folder)

    def _remake(self, path: Path, mark: int) -> None:
        folder = path.parent
        recipe = read_recipe(path)
        named = any(getattr(source, "kind", "") in ("directory", "catalogue", "shapenet") for source in recipe.manifest.sources)
        remake = prepare_remake(recipe, folder / "meshes" if named else None, folder / "own", 1 if mark % 3 else None)
        list(remake.requests(folder / "data"))
        compare(recipe, DataDirectory(folder / "data"))

    def _note(self, event: str, arguments: tuple[object, ...]) -> None:
        """Record which files are opened while a recipe is read, and in which mode."""
        if event == "open" and self.opened is not None and isinstance(arguments[0], str | bytes | os.PathLike):
            self.opened.append((Path(os.fsdecode(arguments[0])), str(arguments[1])))


def _recipe(sources: list[dict[str, object]], stages: int) -> str:
    """Write a recipe of existing objects with placeholder digests."""
    manifest = {"name": "m", "description": "d", "seed": 0, "splits": SPLITS, "sources": sources}
    stage_recipes = {}
    with tempfile.TemporaryDirectory() as root:
        for name, content in (TEXTS | BESIDE).items():
            (Path(root) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(root) / name).write_bytes(content)
        named = {"hand": "robot/hand.yaml", "scene": "scene.yaml", "sensors": ["gel.yaml"] * 2}
        for name in DATASET[:stages]:
            stage = load_stage(name)
            assert isinstance(stage, ObjectStage)
            usual = resolve(name, "draft", []).results()
            mine = {setting: value for setting, value in named.items() if setting in usual}
            here = {
                setting: [f"{root}/{one}" for one in value] if isinstance(value, list) else f"{root}/{value}"
                for setting, value in mine.items()
            }
            stage_recipes[name] = StageRecipe(
                settings=usual | mine,
                schema_version=stage.output.version,
                code="0" * 64,
                files=keys.assets_digest(stage.assets(stage.settings_type.model_validate(usual | here))),
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
    carried = {
        "texts": {name: content.decode() for name, content in TEXTS.items()},
        "files": {name: hashlib.sha256(content).hexdigest() for name, content in BESIDE.items()},
    }
    entries = {
        "manifest": manifest,
        "preset": "draft",
        "seed": 0,
        "shards": 1,
        "stages": stage_recipes,
        "versions": {"numpy": "2.4.6"},
        **carried,
    }
    return Recipe.model_validate({**entries, "processors": ["x"], "objects": object_lines(rows)}).text()


def _seal(path: Path, mark: int) -> None:
    """Update the checksums to the content with its mutated description files; some name a file elsewhere."""
    folder = path.parent
    with suppress(ValueError, yaml.YAMLError, RecursionError, TypeError):
        content = parse_yaml(path.read_text())
        texts = {name: (folder / "texts" / name).read_bytes().decode(errors="replace") for name in TEXTS}
        if mark % 5 == 0:
            name = ("untouched.png", "../palm.obj", "urdf/two_finger_gripper.urdf", "../gel.yaml")[mark // 30 % 4]
            elsewhere = ELSEWHERE[mark // 120 % len(ELSEWHERE)]
            texts = {owner: text.replace(name, elsewhere) for owner, text in texts.items()}
        content["texts"] = texts
        content["files"] = {name: hashlib.sha256((folder / "own" / name).read_bytes()).hexdigest() for name in BESIDE}
        path.write_text(Recipe.model_validate(content).text())


def _check_opened(opened: list[tuple[Path, str]], folder: Path) -> None:
    """Check that all opened files lie in folders of the user or in packages, and that files were written only below `own`."""
    user_paths = [folder / "meshes", folder / "own", folder / "my.recipe.yaml"]
    packages = [ROOT, Path(sys.prefix), Path(sys.base_prefix), Path("/proc"), Path("/dev/null")]
    for path, mode in opened:
        real = path.resolve()
        allowed = [folder / "own"] if set(mode) & set("wax+") else user_paths if real.is_relative_to(folder.resolve()) else packages
        if not any(real.is_relative_to(place.resolve()) for place in allowed):
            raise AssertionError(f"a recipe leads to {path}, opened as {mode}")
