"""`vt-pipeline advise`, on real objects: what it says fits, and what it says where nothing does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh
import yaml
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.cli.advise import AIMS
from pipeline.cli.request import make_request
from pipeline.config.manifest import load_manifest
from pipeline.errors import StoreError
from pipeline.tuning.advice import duration
from pipeline.tuning.probe import probe, some_of
from stages.registry import load_stage


def manifest(folder: Path, count: int) -> str:
    source = {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"cellphone": count}}
    path = folder / f"{count}.yaml"
    path.write_text(
        yaml.safe_dump({"name": "few", "description": "d", "seed": 0, "splits": {"train": 1, "valid": 0, "test": 0}, "sources": [source]})
    )
    return str(path)


def ask(*words: str) -> tuple[int, str, str]:
    """Exit status, standard output, and all output with the line ends of the terminal taken out."""
    result = CliRunner().invoke(app, ["advise", *words])
    return result.exit_code, result.stdout, " ".join(result.output.split())


def test_what_is_advised_keeps_the_error_and_says_how_to_get_it(tmp_path):
    code, said, everything = ask("--manifest", manifest(tmp_path, 2), "--error", "simulate-touch=0.05um", "--json")
    assert code == 0, everything
    advice = json.loads(said)
    assert tuple(advice["stages"]) == AIMS["dataset"]
    assert advice["objects"] == 2
    assert advice["stages"]["simulate-touch"]["bound"] <= 0.05
    assert all(stage["seconds"] > 0 < stage["megabytes"] for stage in advice["stages"].values())
    assert sum(stage["seconds"] for stage in advice["stages"].values()) == pytest.approx(advice["seconds"], abs=0.3)
    assert advice["command"].startswith(f"make dataset MANIFEST={tmp_path / '2.yaml'} PRESET=standard")
    assert all(line in advice["command"] for line in advice["set"])


def test_a_time_that_is_too_short_is_refused_once_this_machine_was_tried(tmp_path):
    code, said, everything = ask("--manifest", manifest(tmp_path, 2), "--budget", "0.1s")
    assert code != 0
    assert said == ""
    assert "trying out" in everything
    assert "the fastest measured settings take" in everything
    assert duration("0.1s") == 0.1


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "either --budget or --error"),
        (["--budget", "1min", "--error", "1um"], "either --budget or --error"),
        (["--budget", "soon"], "'soon' is no time"),
        (["--budget", "1min", "--for", "glory"], "it is dataset or train"),
        (["--budget", "1min", "--manifest", "nowhere"], "nowhere"),
        (["--error", "simulate-grasps=0.1%"], "stays below"),
        (["--error", "train-unet=900um"], "not chosen for train-unet here"),
        (["--error", "3 furlongs"], "no stage is measured so"),
        (["--budget", "1min", "--for", "train"], "a training needs two"),
    ],
)
def test_what_cannot_be_answered_is_refused_at_once(tmp_path, words, complaint):
    given = [] if "--manifest" in words else ["--manifest", manifest(tmp_path, 1)]
    code, _, everything = ask(*given, *words)
    assert code != 0
    assert complaint in everything
    assert "trying out" not in everything


def test_objects_that_cannot_be_made_say_why(tmp_path):
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    trimesh.Trimesh([[0, 0, 0]] * 3, [[0, 1, 2]], process=False).export(meshes / "point.ply")
    asked = make_request(load_stage("sample-surfaces"), "directory", "draft", tmp_path / "data", meshes, [], None, workers=1)
    with pytest.raises(StoreError, match="none of 1 objects tried can be made; point"):
        probe(asked, asked.objects)


def test_some_objects_are_spread_and_the_last_is_to_stop_by():
    everything = load_manifest("toy").objects(None)
    some = some_of(everything, 4)
    assert [one.split for one in some] == ["train"] * (len(some) - 1) + ["valid"]
    assert len({one.category for one in some}) > 1
    assert [one.object_id for one in some_of(everything, 100)] == [one.object_id for one in everything]


@pytest.mark.slow
def test_a_training_is_tried_by_an_epoch(tmp_path):
    code, said, everything = ask("--manifest", manifest(tmp_path, 3), "--for", "train", "--error", "fit-charts=1000um", "--json")
    assert code == 0, everything
    advice = json.loads(said)
    assert tuple(advice["stages"]) == AIMS["train"]
    assert "with cloud=true" in advice["stages"]["fit-charts"]["metric"]
    assert "train-gcn.configuration=touch" in advice["set"]
    assert "CONFIGURATIONS=touch" in advice["command"]
