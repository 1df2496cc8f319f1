"""The commands that a report prints."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import trimesh
import yaml

from pipeline.contrib.report.provenance import commands, records, settings_tables
from pipeline.store.directory import DataDirectory
from pipeline.store.record import ShardRecord
from stages.registry import resolve
from tests.command_line import vt
from tests.stages import ball_dataset


def record_of(stage: str, settings: dict[str, Any], **speed: Any) -> ShardRecord:
    said = {"location": "g", "stage": stage, "key": "0" * 64, "settings": settings, "speed_settings": speed, "preset": "draft"}
    said |= {"seed": 3, "manifest": "toy", "models": {}, "versions": {}, "processor": {}, "schema_version": 1, "rows": ()}
    return ShardRecord.model_validate({**said, "constants_digest": "0" * 64, "metadata": {}})


def test_command_names_only_settings_that_differ_from_the_preset(tmp_path):
    record = record_of("simulate-grasps", resolve("simulate-grasps", "draft", ["grasps=2"]).results())
    (line,) = commands(DataDirectory(tmp_path), {"grasps": record})
    told = f"--manifest toy --preset draft --seed 3 --data {tmp_path} --set simulate-grasps.grasps=2"
    assert line == f"vt-pipeline run simulate-grasps {told}"


def test_command_names_the_folder_that_a_stage_cannot_do_without(tmp_path):
    record = record_of("read-grasps", resolve("read-grasps", "draft", ()).results(), folder="/my grasps", object_seconds=60)
    (line,) = commands(DataDirectory(tmp_path), {"grasps": record})
    assert line.endswith("--set 'read-grasps.folder=/my grasps'")
    assert "object_seconds" not in line


def test_points_of_sweeps_have_no_command(tmp_path):
    settings = resolve("train-gcn", "draft", ()).results()
    origins = {"models/gcn/touch": record_of("train-gcn", settings)}
    origins["sweeps/train-gcn/touch/epochs=3"] = record_of("train-gcn", settings | {"epochs": 3})
    (line,) = commands(DataDirectory(tmp_path), origins)
    assert "--set" not in line


def test_settings_that_follow_the_inputs_are_not_named_as_set(tmp_path):
    ball_dataset.make_data(tmp_path, 1)
    directory, settings = DataDirectory(tmp_path), resolve("render-vision", "draft", ()).results()
    for hand, count in ((ball_dataset.HAND["hand"], 0), ("allegro_left", 1)):
        origins = {"vision": record_of("render-vision", settings | {"hand": hand})}
        (line,) = commands(directory, origins)
        (table,) = settings_tables(directory, origins)
        assert line.count("--set") == [row.cells[2] for row in table.rows].count("set") == count


@pytest.mark.slow
def test_commands_run_in_a_shell_reproduce_the_dataset(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "Ann's meshes"
    folder.mkdir()
    trimesh.creation.box((80, 60, 40)).export(folder / "box.stl")
    source = {"kind": "directory", "licence": "mine"}
    described = {"name": "mine", "description": "d", "seed": 0, "splits": {"train": 1, "valid": 0, "test": 0}, "sources": [source]}
    Path("my manifest.yaml").write_text(yaml.safe_dump(described))
    arguments = ["run", "sample-surfaces", "--manifest", "my manifest.yaml", "--objects", folder.name, "--units", "mm", "--up", "y"]
    arguments += ["--data", "my data", "--seed", "7", "--shards", "2", "--set", "points=100", "--executor", "serial"]
    vt(*arguments)
    directory = DataDirectory("my data")
    (line,) = commands(directory, records(directory))
    (record,) = directory.shard_records()
    before = record.read_text()
    shutil.rmtree("my data")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["sh", "-c", line], check=True, env={**os.environ, "PATH": path}, stdout=subprocess.DEVNULL)
    assert json.loads(record.read_text())["rows"][0]["digest"] == json.loads(before)["rows"][0]["digest"]
    assert vt(*arguments).count("up to date") == 2
