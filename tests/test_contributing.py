"""The recipes of CONTRIBUTING.md work: followed in a copy of the repository, they add a stage, a setting and an array that run."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from pipeline.config.manifest import load_manifest
from pipeline.dataset.object_rows import ObjectRows
from pipeline.formats.sensor_file import load_sensor
from tests.stages import ball_dataset as spheres

ROOT = Path(__file__).parents[1]
COPIED = ("pipeline", "stages", "schemas", "data_manifests", "docs", "Makefile", "pyproject.toml")
LIMITS = {"Add a stage": 6, "Add a setting": 2, "Add an array": 3, "Add a hand, a sensor or a camera": 1}
"""Files that a recipe may touch."""

RUN = """
import sys
from pathlib import Path
from pipeline.cli import app
from tools import reference_pages
Path("docs/settings.md").write_text(reference_pages.regenerated(Path("docs/settings.md").read_text(), reference_pages.settings()))
app(["run", "measure-contact", *sys.argv[1:]])
"""


def code_blocks(recipe: str) -> list[tuple[str, str, str]]:
    """Language, file and text of a recipe's code blocks that name a file."""
    section = (ROOT / "CONTRIBUTING.md").read_text().partition(f"\n## {recipe}\n")[2].partition("\n## ")[0]
    return re.findall(r"^```(\w+) (\S+)\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)


def follow(recipe: str, repository: Path) -> None:
    """Do what a recipe's code blocks say."""
    for language, name, text in code_blocks(recipe):
        path = repository / name
        if language == "diff":
            lines = text.splitlines(keepends=True)
            before, after = ("".join(line[1:] for line in lines if line[0] in kept) for kept in (" -", " +"))
            assert path.read_text().count(before) == 1, f"{name} does not hold {before!r} once"
            path.write_text(path.read_text().replace(before, after))
        else:
            assert not path.exists(), f"{name} is there already"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)


@pytest.mark.parametrize("recipe", LIMITS)
def test_recipe_touches_few_files(recipe):
    assert 1 <= len({name for _, name, _ in code_blocks(recipe)}) <= LIMITS[recipe]


def test_stage_setting_and_array_added_by_the_recipes_run(tmp_path):
    copy, data, meshes = tmp_path / "repository", tmp_path / "data", tmp_path / "meshes"
    copy.mkdir()
    for name in COPIED:
        part = ROOT / name
        shutil.copytree(part, copy / name, ignore=shutil.ignore_patterns("__pycache__")) if part.is_dir() else shutil.copy(part, copy)
    for recipe in ("Add a stage", "Add a setting", "Add an array"):
        follow(recipe, copy)
    subprocess.run([sys.executable, "-m", "ruff", "check", "--quiet", "stages", "schemas"], cwd=copy, check=True)
    subprocess.run([sys.executable, "-m", "ruff", "format", "--check", "--quiet", "stages", "schemas"], cwd=copy, check=True)

    spheres.make_data(data, 1)  # of one ball, called a
    meshes.mkdir()
    trimesh.creation.box().export(meshes / "a.stl")
    manifest = {"name": "balls", "description": "d", "seed": 0, "splits": {"train": 0, "valid": 0, "test": 1}}
    source = {"kind": "directory", "licence": "MIT", "up": "z"}
    (tmp_path / "balls.yaml").write_text(yaml.safe_dump(manifest | {"sources": [source]}))
    options = ["--manifest", tmp_path / "balls.yaml", "--objects", meshes, "--data", data, "--set", "least_press=0.001", "--workers", "1"]
    done = subprocess.run(
        [sys.executable, "-c", RUN, *map(str, options)],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "made 1 object " in done.stdout
    assert "`least_press`" in (copy / "docs" / "settings.md").read_text()

    record = json.loads((data / "contact" / "0000-of-0001.json").read_text())
    assert record["settings"] == {"least_press": 0.001}
    rows = ObjectRows(data, ["depth", "touch_success"], "test")
    pressed = (rows.read("depth", "a") < spheres.SENSOR.w - 0.001).sum(axis=(-2, -1))
    area = _read(data / "contact" / record["location"], "contact_area")
    np.testing.assert_allclose(area[0], pressed * (spheres.SENSOR.width / spheres.SENSOR.cols) ** 2, rtol=1e-6)
    assert (_read(data / "contact" / record["location"], "press")[0] > 0).tolist() == rows.read("touch_success", "a").tolist()


def _read(group: Path, name: str) -> np.ndarray:
    import zarr

    return np.asarray(zarr.open_array(str(group / name), mode="r"))


def test_manifest_of_the_recipe_names_two_objects(tmp_path):
    (text,) = re.findall(r"^```yaml\n(name: two\n.*?)^```$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE | re.DOTALL)
    (tmp_path / "two.yaml").write_text(text)
    assert len(load_manifest(str(tmp_path / "two.yaml")).objects()) == 2


def test_sensor_of_the_recipe_is_a_sensor(tmp_path):
    follow("Add a hand, a sensor or a camera", tmp_path)
    assert load_sensor(tmp_path / "my_gel.yaml").shape == (64, 64)
