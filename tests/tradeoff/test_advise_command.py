"""`vt-pipeline advise` on real objects and made-up figures."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh
import yaml
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.cli.request import make_request
from pipeline.config.manifest import load_manifest
from pipeline.console import errors
from pipeline.errors import StoreError
from pipeline.tradeoff.advice import STAGES_OF, Advice, Question
from pipeline.tradeoff.choice import Choice
from pipeline.tradeoff.measurements import Measurement
from pipeline.tradeoff.trial import measure_speed, trial_objects
from stages.registry import load_stage, resolve
from tests.tradeoff.studies import measurement, study

METRICS = {
    "sample-surfaces": "coverage, mm",
    "simulate-grasps": "missing, %",
    "render-vision": "difference, levels",
    "simulate-touch": "depth, um",
    "train-unet": "depth, um",
    "fit-charts": "residual, um",
    "train-gcn": "Chamfer",
}
FIXED = {"fit-charts": {"cloud": "true"}}


@pytest.fixture(autouse=True)
def figures(monkeypatch):
    """Made-up figures: of every stage `standard`, and of touch a setting of another error."""

    def made(stage: str, label: str, error: float, **changed: object) -> Measurement:
        settings = resolve(stage, "standard", []).accuracy() | changed
        return measurement(label, 0.1, error, metric=METRICS[stage], kind="setting" if changed else "preset", **settings)

    studies = {name: study(name, made(name, "standard", 8), fixed=FIXED.get(name, {})) for name in METRICS}
    better = made("simulate-touch", "gel_bits=24", 0.03, gel_bits=24)
    studies["simulate-touch"] = replace(studies["simulate-touch"], measurements=(*studies["simulate-touch"].measurements, better))
    for name in ("train-unet", "train-gcn"):
        studies[name] = replace(studies[name], whole_dataset=True)
    monkeypatch.setattr("pipeline.tradeoff.advice.load_studies", lambda: studies)


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


def test_advice_keeps_the_error_and_gives_the_command(tmp_path):
    code, said, everything = ask("--manifest", manifest(tmp_path, 2), "--error", "simulate-touch=0.05um", "--json")
    assert code == 0, everything
    advice = json.loads(said)
    assert tuple(advice["stages"]) == STAGES_OF["dataset"]
    assert advice["objects"] == 2
    assert advice["stages"]["simulate-touch"]["bound"] <= 0.05
    assert advice["set"] == ["simulate-touch.gel_bits=24"]
    assert all("commit abc1234" in stage["measured"] and "changed since" in stage["measured"] for stage in advice["stages"].values())
    assert all(stage["seconds"] > 0 for stage in advice["stages"].values())
    assert sum(stage["seconds"] for stage in advice["stages"].values()) == pytest.approx(advice["seconds"], abs=0.3)
    assert advice["command"].startswith(f"make dataset MANIFEST={tmp_path / '2.yaml'} PRESET=standard")
    assert advice["command"].endswith("SET=simulate-touch.gel_bits=24")


def test_the_command_holds_whatever_files_are_called():
    question = Question("train", "a 'b'.yaml", Path("$(touch x)"), goal=1.0, units="mm", up="y")
    words = ["make", "train", "MANIFEST=a 'b'.yaml", "OBJECTS=$(touch x)", "UNITS=mm", "UP=y", "PRESET=standard", "CONFIGURATIONS=touch"]
    assert shlex.split(Advice(question, 1, ()).command) == words


def test_too_short_a_time_is_refused_after_trying_this_machine(tmp_path):
    code, said, everything = ask("--manifest", manifest(tmp_path, 2), "--budget", "0.1s")
    assert code != 0
    assert said == ""
    assert "trying out" in everything
    assert "the fastest measured settings take" in everything


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "either --budget or --error"),
        (["--budget", "1min", "--error", "1um"], "either --budget or --error"),
        (["--budget", "soon"], "'soon' is not a time"),
        (["--budget", "1min", "--for", "glory"], "it is dataset or train"),
        (["--budget", "1min", "--manifest", "nowhere"], "nowhere"),
        (["--error", "simulate-grasps=0.1%"], "stays below"),
        (["--error", "train-unet=900um"], "not chosen for train-unet here"),
        (["--error", "3 furlongs"], "no stage is measured so"),
        (["--budget", "1min", "--for", "train"], "a training needs two"),
    ],
)
def test_impossible_questions_are_refused_without_a_trial(tmp_path, words, complaint):
    given = [] if "--manifest" in words else ["--manifest", manifest(tmp_path, 1)]
    code, _, everything = ask(*given, *words)
    assert code != 0
    assert complaint in everything
    assert "trying out" not in everything


def test_interrupted_advice_says_that_nothing_is_kept(monkeypatch):
    def stop(question, log):
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.cli.advise.advise_settings", stop)
    code, _, everything = ask("--budget", "1min")
    assert code != 0
    assert "interrupted; what was tried out is removed" in everything


def test_trial_of_objects_that_all_fail_says_why(tmp_path):
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    trimesh.Trimesh([[0, 0, 0]] * 3, [[0, 1, 2]], process=False).export(meshes / "point.ply")
    stage = load_stage("sample-surfaces")
    asked = make_request(stage, "directory", "draft", data=tmp_path / "data", objects=meshes, assignments=[], seed=None)
    coarse = study("sample-surfaces", measurement("coarse", 1, 1))
    with pytest.raises(StoreError, match="none of 1 objects tried can be made; point"):
        measure_speed(asked, Choice(coarse, coarse.measurements[0], 1.0), errors)


def test_trial_objects_are_spread_and_the_last_is_for_validation():
    everything = load_manifest("toy").objects(None)
    some = trial_objects(everything, 4)
    assert [one.split for one in some] == ["train"] * (len(some) - 1) + ["valid"]
    assert len({one.category for one in some}) > 1
    assert [one.object_id for one in trial_objects(everything, 100)] == [one.object_id for one in everything]


@pytest.mark.slow
def test_training_is_tried_for_one_epoch(tmp_path):
    code, said, everything = ask("--manifest", manifest(tmp_path, 3), "--for", "train", "--error", "fit-charts=1000um", "--json")
    assert code == 0, everything
    advice = json.loads(said)
    assert tuple(advice["stages"]) == STAGES_OF["train"]
    assert "with cloud=true" in advice["stages"]["fit-charts"]["metric"]
    assert "train-gcn.configuration=touch" in advice["set"]
    assert "CONFIGURATIONS=touch" in advice["command"]
