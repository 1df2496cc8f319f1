"""Packages can add sensors, stages and schemas; broken packages are named and do not affect other commands."""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from pipeline.dataset.object_rows import ObjectRows
from pipeline.formats.description_file import description_path
from tests.stages import ball_dataset as balls

EXAMPLE = Path(__file__).parents[1] / "examples" / "plugin"

COMMANDS = """
import json, sys
from typer.testing import CliRunner
from pipeline.cli import app
imported = "vt_press" in sys.modules
said = []
for words in json.loads(sys.argv[1]):
    if words[0] == "=":
        said.append([0, " ".join(str(eval(words[1])).split())])
        continue
    result = CliRunner().invoke(app, words)
    said.append([result.exit_code, " ".join(result.output.split())])
print(json.dumps([imported, "vt_press.stage" in sys.modules, said]))
"""


def install(folder: Path, name: str, groups: dict[str, dict[str, str]], files: dict[str, str]) -> None:
    """Write the files and the metadata with entry points that `pip install --target` would write."""
    for file, text in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(text)
    metadata = folder / f"{name.replace('-', '_')}-0.1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.4\nName: {name}\nVersion: 0.1.0\n")
    lines = [line for group, entries in groups.items() for line in (f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()))]
    (metadata / "entry_points.txt").write_text("\n".join(lines))


def install_example(folder: Path) -> None:
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    shutil.copytree(EXAMPLE / "vt_press", folder / "vt_press", ignore=shutil.ignore_patterns("__pycache__"))
    install(folder, project["name"], project["entry-points"], {})


def run_with(site: Path, *commands: list[str]) -> tuple[bool, bool, list[tuple[int, str]]]:
    """Run commands in one process that finds packages in `site`; return whether the example is imported before and after, and outputs."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(EXAMPLE.parents[1])]), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", COMMANDS, json.dumps(commands)]
    completed = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    before, after, outputs = json.loads(completed.stdout)
    return before, after, [(code, words) for code, words in outputs]


@pytest.fixture(scope="module")
def balls_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Make touches of one ball; return its data directory and the options that name its manifest."""
    folder = tmp_path_factory.mktemp("balls")
    balls.make_data(folder / "data", 1)
    (folder / "meshes").mkdir()
    trimesh.creation.box().export(folder / "meshes" / "a.stl")
    manifest = {"name": "balls", "description": "d", "seed": 0, "splits": {"train": 0, "valid": 0, "test": 1}}
    source = {"kind": "directory", "licence": "MIT", "up": "z"}
    (folder / "balls.yaml").write_text(yaml.safe_dump(manifest | {"sources": [source]}))
    return folder / "data", ["--manifest", str(folder / "balls.yaml"), "--objects", str(folder / "meshes"), "--data", str(folder / "data")]


def test_stage_of_another_package_runs_and_its_key_follows_its_code(balls_run: tuple[Path, list[str]], tmp_path: Path) -> None:
    data, options = balls_run
    site = tmp_path / "site"
    install_example(site)
    run = ["run", "measure-press", *options]
    serial = [*run, "--executor", "serial"]
    expression = (
        f"__import__('pipeline.dataset.object_rows').dataset.object_rows.ObjectRows({str(data)!r}, ['press'], 'test').read('press', 'a')[0]"
    )
    before, after, outputs = run_with(
        site,
        [*run, "--workers", "1"],
        serial,
        ["status", str(data)],
        ["validate", str(data)],
        ["stages"],
        [*serial, "--set", "leest=1"],
        ["=", expression],
        ["check", "gel_25mm", "--picture", str(tmp_path / "gel.png")],
    )
    words = [line for _, line in outputs]
    assert (before, after) == (False, True)
    assert "made 1 object " in words[0]
    assert "up to date, 1 object" in words[1]
    assert "press" in words[2]
    assert outputs[3][0] == 0, words[3]
    assert "press/0000-of-0001.json" in words[3].replace(" ", "")
    assert "measure-press How deep each touch presses into the gel. reads touch; writes press" in words[4]
    assert "did you mean least?" in words[5]
    nearest = ObjectRows(data, ["depth"], "test").read("depth", "a")[0].min(axis=(-2, -1))
    np.testing.assert_allclose(np.array(words[6].strip("[]").split(), float), np.maximum(balls.SENSOR.w - nearest, 0), atol=1e-6)
    assert "sensor gel_25mm, no faults" in words[7]

    code = site / "vt_press" / "measurements.py"
    code.write_text(code.read_text().replace("thickness - depth", "2 * thickness - depth"))
    changed, by_preset = run_with(site, serial, [*serial, "--preset", "paper"])[2]
    assert "made 1 object " in changed[1]
    assert "made 1 object " in by_preset[1]
    assert json.loads((data / "press" / "0000-of-0001.json").read_text())["settings"] == {"least": 1e-4}


@pytest.mark.slow
def test_broken_packages_are_named_and_other_commands_work(balls_run: tuple[Path, list[str]], tmp_path: Path) -> None:
    data, options = balls_run
    site, sensor = tmp_path / "site", description_path("sensor", "gel_16mm").read_text()
    groups = {
        "vt_pipeline.stages": {"fly": "vt_broken.stage:Fly", "simulate-touch": "vt_broken.stage:Fly"},
        "vt_pipeline.schemas": {"wing": "vt_broken.schema:WING"},
        "vt_pipeline.sensors": {"x": "vt_broken.sensors"},
        "vt_pipeline.hands": {"x": "vt_broken.nowhere"},
    }
    files = {"__init__.py": "", "stage.py": "import rotor\n", "schema.py": "WING = 1\n"}
    sensors = {"sensors/gel_16mm.yaml": sensor, "sensors/gel_9mm.yaml": sensor}
    install(site, "vt-broken", groups, {f"vt_broken/{name}": text for name, text in (files | sensors).items()})
    shutil.copytree(data, damaged := tmp_path / "damaged")
    shutil.copytree(data / "touch", damaged / "wing")
    dry_run = ["--dry-run", "--data", str(tmp_path / "data")]
    _, _, outputs = run_with(
        site,
        ["run", "fly", *options],
        ["run", "simulate-touch", *options],
        ["run", "sample-surfaces", *dry_run, "--set", "hand=allegro_right"],
        ["run", "simulate-grasps", *dry_run, "--set", "hand=nobody"],
        ["stages"],
        ["status", str(data)],
        ["validate", str(data)],
        ["check", "gel_16mm"],
        ["check", "gel_9mm", "--picture", str(tmp_path / "gel.png")],
        ["status", str(damaged)],
        ["validate", str(damaged)],
    )
    assert [code for code, _ in outputs] == [1, 1, 0, 1, 0, 0, 0, 1, 0, 1, 1]
    words = [line for _, line in outputs]
    assert "fly of package vt-broken: vt_broken.stage:Fly cannot be imported: ModuleNotFoundError: No module named 'rotor'" in words[0]
    assert "line 1); fix it, or `pip uninstall vt-broken`" in words[0]
    assert "stage simulate-touch is provided by more than one package: vt-pipeline, vt-broken" in words[1]
    assert "package vt-broken names vt_broken.nowhere as its folder of hands, which has no YAML files" in words[3]
    assert "vt_broken.stage:Fly cannot be imported" in words[4]
    assert "evaluate-single-image" in words[4]
    assert "sensor gel_16mm is provided by more than one package: vt-pipeline, vt-broken" in words[7]
    for line in words[9:]:
        assert "vt_broken.schema:WING of package vt-broken is not an Artifact called wing" in line
