"""The commands that a report prints."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import trimesh
import yaml
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.reports.provenance import commands, records
from pipeline.store.directory import DataDirectory
from pipeline.store.record import ShardRecord
from stages.registry import resolve


def test_a_command_names_what_differs_from_the_preset_and_nothing_else(tmp_path):
    settings = resolve("simulate-grasps", "draft", ["grasps=2"]).results()
    said = {"location": "g", "stage": "simulate-grasps", "key": "0" * 64, "settings": settings, "speed_settings": {}, "preset": "draft"}
    said |= {"seed": 3, "manifest": "toy", "models": {}, "versions": {}, "processor": {}, "schema_version": 1, "rows": ()}
    record = ShardRecord.model_validate({**said, "constants_digest": "0" * 64, "metadata": {}})
    (line,) = commands(DataDirectory(tmp_path), {"grasps": record})
    told = f"--manifest toy --preset draft --seed 3 --data {tmp_path} --set simulate-grasps.grasps=2"
    assert line == f"vt-pipeline run simulate-grasps {told}"


def test_commands_that_are_pasted_into_a_shell_make_the_same_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "Ann's meshes"
    folder.mkdir()
    trimesh.creation.box((80, 60, 40)).export(folder / "box.stl")
    source = {"kind": "directory", "licence": "mine"}
    described = {"name": "mine", "description": "d", "seed": 0, "splits": {"train": 1, "valid": 0, "test": 0}, "sources": [source]}
    Path("my manifest.yaml").write_text(yaml.safe_dump(described))
    asked = ["run", "sample-surfaces", "--manifest", "my manifest.yaml", "--objects", folder.name, "--units", "mm", "--up", "y"]
    asked += ["--data", "my data", "--seed", "7", "--shards", "2", "--set", "points=100", "--executor", "serial"]
    assert CliRunner().invoke(app, asked).exit_code == 0
    directory = DataDirectory("my data")
    (line,) = commands(directory, records(directory))
    (record,) = directory.shard_records()
    before = record.read_text()
    shutil.rmtree("my data")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["sh", "-c", line], check=True, env={**os.environ, "PATH": path}, stdout=subprocess.DEVNULL)
    assert json.loads(record.read_text())["rows"][0]["digest"] == json.loads(before)["rows"][0]["digest"]
    assert CliRunner().invoke(app, asked).output.count("up to date") == 2
