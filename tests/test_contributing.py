"""The recipes of CONTRIBUTING.md, followed in a copy of the repository, add stages, settings, arrays and networks that run."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from pipeline.config.manifest import load_manifest
from pipeline.dataset.object_rows import ObjectRows
from pipeline.formats.sensor_file import load_sensor
from tests.stages import ball_dataset as spheres
from tests.test_plugins import install, run_with

ROOT = Path(__file__).parents[1]
COPIED = ("pipeline", "stages", "schemas", "data_manifests", "docs", "Makefile", "pyproject.toml")
LIMITS = {"Add a stage": 4, "Add a setting": 1, "Add an array": 2, "Add a hand, a sensor or a camera": 1, "Add a family of networks": 6}
"""Files that a recipe may touch."""

RUN = """
import sys
from pathlib import Path
from pipeline.cli import app
from tools import reference_pages
Path("docs/settings.md").write_text(reference_pages.settings())
app(["run", "measure-contact", *sys.argv[1:]])
"""


LEARN = """
import sys
from pathlib import Path
from pipeline.cli import app
from pipeline.console import console, show_tables
from pipeline.contrib.report.results import Results
from pipeline.store.directory import DataDirectory
from tests.stages import ball_dataset as balls

data, splits = Path(sys.argv[1]), ("train", "valid", "test")
balls.make_data(data, 6, splits)
asked = ["train-ball.epochs=150", "evaluate.configurations=[ball-touch]", "evaluate.points=300", "evaluate.grasps=[1,2]"]
for name in ("train-ball", "evaluate"):
    balls.run_stage(data, name, balls.objects(6, splits), *asked)
show_tables(Results(DataDirectory(data), ["evaluation"]).tables)
app(["predict", str(data / "f.ply"), "--data", str(data), "--configuration", "ball-touch", "--object", "f"])
"""


def code_blocks(recipe: str) -> list[tuple[str, str, str]]:
    """Return language, file and text of the code blocks of a recipe that name a file."""
    section = (ROOT / "CONTRIBUTING.md").read_text().partition(f"\n## {recipe}\n")[2].partition("\n## ")[0]
    return re.findall(r"^```(\w+) (\S+)\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)


def follow(recipe: str, repository: Path) -> None:
    """Apply the code blocks of a recipe."""
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


def copy_with_recipes(folder: Path, recipes: Sequence[str], *more: str) -> Path:
    """Copy the repository and follow recipes in the copy; ruff must accept the added code."""
    copy = folder / "repository"
    for name in (*COPIED, *more):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        part = ROOT / name  # including compiled files of Python and numba
        shutil.copytree(part, copy / name) if part.is_dir() else shutil.copy2(part, copy / name)
    for recipe in recipes:
        follow(recipe, copy)
    for check in (["check"], ["format", "--check"]):
        subprocess.run([sys.executable, "-m", "ruff", *check, "--quiet", "pipeline", "stages", "schemas"], cwd=copy, check=True)
    return copy


def run_python(copy: Path, *words: str) -> str:
    """Run the interpreter in a copy of the repository; return its output."""
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    completed = subprocess.run([sys.executable, *words], cwd=copy, env=environment, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    return completed.stdout


def test_stage_setting_and_array_added_by_the_recipes_run(tmp_path):
    copy = copy_with_recipes(tmp_path, ("Add a stage", "Add a setting", "Add an array"))
    data, meshes = tmp_path / "data", tmp_path / "meshes"
    spheres.make_data(data, 1)  # one ball, called a
    meshes.mkdir()
    trimesh.creation.box().export(meshes / "a.stl")
    manifest = {"name": "balls", "description": "d", "seed": 0, "splits": {"train": 0, "valid": 0, "test": 1}}
    source = {"kind": "directory", "licence": "MIT", "up": "z"}
    (tmp_path / "balls.yaml").write_text(yaml.safe_dump(manifest | {"sources": [source]}))
    options = [
        "--manifest",
        tmp_path / "balls.yaml",
        "--objects",
        meshes,
        "--data",
        data,
        "--set",
        "least_press=0.001",
        "--executor",
        "serial",
    ]
    output = run_python(copy, "-c", RUN, *map(str, options))
    assert "made 1 object " in output
    assert "`least_press`" in (copy / "docs" / "settings.md").read_text()

    record = json.loads((data / "contact" / "0000-of-0001.json").read_text())
    assert record["settings"] == {"least_press": 0.001}
    rows = ObjectRows(data, ["depth", "touch_success"], "test")
    pressed = (rows.read("depth", "a") < spheres.SENSOR.w - 0.001).sum(axis=(-2, -1))
    area = _read(data / "contact" / record["location"], "contact_area")
    np.testing.assert_allclose(area[0], pressed * (spheres.SENSOR.width / spheres.SENSOR.cols) ** 2, rtol=1e-6)
    assert (_read(data / "contact" / record["location"], "press")[0] > 0).tolist() == rows.read("touch_success", "a").tolist()


@pytest.mark.slow
def test_family_of_networks_added_by_the_recipe_is_trained_evaluated_reported_and_used(tmp_path):
    copy = copy_with_recipes(tmp_path, ["Add a family of networks"], "tests")
    output = run_python(copy, "-c", LEARN, str(tmp_path / "data"))
    assert "ball-touch: 2 grasps < 1" in output
    mesh = trimesh.load(tmp_path / "data" / "f.ply")
    radii = np.linalg.norm(mesh.vertices - spheres.CENTRE, axis=1)
    assert mesh.is_watertight
    assert abs(np.median(radii) - 0.15) < 0.06  # balls of 10 to 20 cm radius
    command = ["make", "--dry-run", "--file", copy / "Makefile", "train", "CONFIGURATIONS=touch ball-touch", f"DATA={tmp_path}"]
    plan = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for stage in ("fit-charts", "train-gcn", "train-ball"):
        assert f"run '{stage}' " in plan


def test_export_source_and_command_added_by_the_recipes_run(tmp_path):
    site, data = tmp_path / "site", tmp_path / "data"
    files, groups = {}, {}
    for recipe in ("Add an export", "Add a source of objects", "Add a command"):
        for language, name, text in code_blocks(recipe):
            if language == "toml":
                groups |= tomllib.loads(text)["project"]["entry-points"]
            else:
                files[name] = text
    install(site, "vt-extras", groups, {"vt_extras/__init__.py": "", **files})
    spheres.make_data(data, 2)
    manifest = {"name": "plates", "description": "d", "seed": 0, "splits": {"train": 1, "valid": 0, "test": 0}}
    source = {"kind": "plates", "licence": "CC0", "count": 3}
    (tmp_path / "plates.yaml").write_text(yaml.safe_dump(manifest | {"sources": [source]}))
    run = [
        "run",
        "sample-surfaces",
        "--manifest",
        str(tmp_path / "plates.yaml"),
        "--data",
        str(tmp_path / "plates"),
        "--executor",
        "serial",
    ]
    _, _, outputs = run_with(
        site, run, run, ["export", str(data), str(tmp_path / "points"), "--to", "points"], ["best-touched", str(data)], ["--help"]
    )
    assert [code for code, _ in outputs] == [0] * 5, outputs
    made, again, exported, best, listed = (words for _, words in outputs)
    assert "made 3 objects " in made
    assert "up to date, 3 objects" in again
    assert "points of 2 objects" in exported
    assert np.loadtxt(tmp_path / "points" / "a.xyz").shape[1] == 3
    assert "of its touches succeed" in best
    assert "best-touched" in listed


def _read(group: Path, name: str) -> np.ndarray:
    import zarr

    return np.asarray(zarr.open_array(str(group / name), mode="r"))


def test_manifest_of_the_recipe_names_two_objects(tmp_path):
    (text,) = re.findall(r"^```yaml\n(name: two\n.*?)^```$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE | re.DOTALL)
    (tmp_path / "two.yaml").write_text(text)
    assert len(load_manifest(str(tmp_path / "two.yaml")).objects()) == 2


def test_sensor_of_the_recipe_is_loaded(tmp_path):
    follow("Add a hand, a sensor or a camera", tmp_path)
    assert load_sensor(tmp_path / "my_gel.yaml").shape == (64, 64)
