"""The command line: lists, runs and errors."""

import json
import re
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import trimesh
import typer
import yaml
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.cli.options import make_executor
from pipeline.config.settings import value_text
from pipeline.formats.description_file import shipped_files
from pipeline.tradeoff.sweep import point_folder
from stages.registry import STAGES, load_stage, make_request
from stages.sample_surfaces import SurfaceSettings
from tests.command_line import invoke, vt

RUN = ["run", "sample-surfaces"]


def test_stages_lists_every_setting_with_its_reason():
    output = vt("stages")
    for name in STAGES:
        assert name in output
        for setting, info in load_stage(name).settings_type.model_fields.items():
            assert setting in output
            assert info.description


def test_stages_shows_folders_that_are_read_and_defaults_as_set_takes_them():
    output = vt("stages")
    assert "reads touch, grasps, models/unet; writes charts" in output
    reads = load_stage("evaluate").reads(load_stage("evaluate").settings_type())
    assert [name for name in reads if name.startswith("models/")]
    assert f"reads {', '.join(reads)}; writes evaluation" in output
    for word in ("False", "None", "(", "'"):
        assert all(word not in value_text(info.default) for name in STAGES for info in load_stage(name).settings_type.model_fields.values())
    assert f"configurations {value_text(load_stage('evaluate').settings_type.model_fields['configurations'].default)} " in output


def test_up_to_date_run_imports_neither_executor_nor_torch(tmp_path):
    source = {"kind": "pybullet", "licence": "zlib", "up": "y", "files": {"duck": {"file": "duck.obj"}}}
    splits = {"train": 1, "valid": 0, "test": 0}
    manifest = {"name": "one", "description": "d", "seed": 0, "splits": splits, "sources": [source]}
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(manifest))
    command = [*RUN, "--manifest", str(tmp_path / "one.yaml"), "--data", str(tmp_path / "data")]
    vt(*command, "--executor", "serial")
    slow = "assert not {'distributed', 'matplotlib', 'scipy.stats', 'torch'} & sys.modules.keys()"
    program = f"import sys; from pipeline.cli import app; app(sys.argv[1:], standalone_mode=False); {slow}"
    completed = subprocess.run([sys.executable, "-c", program, *command], capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    assert "up to date, 1 object\n" in completed.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "fly"], "unknown stage fly; choose from sample-surfaces"),
        ([*RUN, "--manifest", "moon"], "there is no manifest 'moon'; built in are"),
        ([*RUN, "--manifest", "four-clases"], "there is no manifest 'four-clases', did you mean four-classes? built in are"),
        (["run", "simulate-grasp"], "unknown stage simulate-grasp, did you mean simulate-grasps? choose from"),
        ([*RUN, "--preset", "standart"], "unknown preset standart, did you mean standard?"),
        ([*RUN, "--set", "simulate-grasps.atempts=9"], "did you mean attempts?"),
        ([*RUN, "--set", "simulate-grasp.attempts=9"], "unknown stage simulate-grasp, did you mean simulate-grasps?"),
        (["run", "train-gcn", "--set", "configuration=toch"], "unknown configuration toch, did you mean touch?"),
        (["run", "evaluate", "--set", "configurations=[ocluded]"], "unknown configuration ocluded, did you mean occluded?"),
        ([*RUN, "--set", "train-gcn.configuration=toch"], "unknown configuration toch, did you mean touch?"),
        ([*RUN, "--set", "simulate-touch.tracer=spere"], "tracer: Input should be 'ray' or 'sphere', did you mean sphere?"),
        ([*RUN, "--set", "hand=alegro_right"], "there is no hand 'alegro_right', did you mean allegro_right?"),
        ([*RUN, "--set", "simulate-grasps.sensor=gelsight_min"], "there is no sensor 'gelsight_min', did you mean gelsight_mini?"),
        ([*RUN, "--set", "simulate-touch.sensors=[nope.yaml]"], "there is no sensor 'nope.yaml'; built in are"),
        ([*RUN, "--set", "scene=suplement"], "there is no scene 'suplement', did you mean supplement?"),
        ([*RUN, "--set", "resolution=9"], "settings of render-vision: resolution: Input should be greater than or equal to 16"),
        ([*RUN, "--set", "evaluate.accelerator=gpu"], "settings of evaluate: accelerator: Input should be 'auto', 'cpu' or 'cuda'"),
        ([*RUN, "--data", "pyproject.toml/d"], "pyproject.toml is a file; name a folder"),
        ([*RUN, "--set", "evaluate.grasps=[2]"], "must be unique and include 1"),
        ([*RUN, "--object", "bottle-01"], "has no object bottle-01, did you mean bottle-"),
        ([*RUN, "--preset", "best"], "unknown preset best; choose from draft, standard, paper"),
        ([*RUN, "--set", "points=many"], "points: Input should be a valid integer"),
        *(([*RUN, "--set", f"points={one}"], "is not valid YAML: ") for one in ("2001-99-99", "!!float x", "9" * 5000, "[" * 3000)),
        (["sweep", "train-gcn", "--grid", "epochs=2001-99-99"], "--grid epochs=2001-99-99: write SETTING=VALUE,VALUE"),
        ([*RUN, "--set", "pionts=5"], "there is no entry pionts, did you mean points? Its settings are object_seconds, points"),
        ([*RUN, "--set", "points"], "write STAGE.SETTING=VALUE"),
        ([*RUN, "--set", "fly.points=5"], "unknown stage fly"),
        ([*RUN, "--data", "nonexistent", "--shards", "2", "--shard", "2"], "shards are numbered 0 to 1"),
        ([*RUN, "--object", "nobody"], "has no object nobody"),
        (["run", "simulate-touch", "--data", "nonexistent"], "vt-pipeline run sample-surfaces --data nonexistent"),
        (["status", "/nonexistent"], "is not a data directory"),
        (["summary", "/nonexistent"], "error: /nonexistent is not a data directory; make one with"),
        (["statsu"], "unknown command statsu, did you mean status?"),
        (["check", "data_manifests"], "run `vt-pipeline check directory --objects data_manifests`"),
        (["advise", "--manifest", "directory", "--objects", "a/mugs", "--error", "5%"], "--data data/directory-mugs/draft --preset draft"),
        (["status", "~nosuchuser/data"], "is not a data directory"),
        ([*RUN, "--manifest", "directory", "--objects", "~nosuchuser/meshes", "--data", "nonexistent"], "is no folder"),
        (["check", "~nosuchuser/hand.yaml"], "~nosuchuser/hand.yaml does not exist"),
        (["sweep", "evaluate", "--grid", "points=100,200"], "evaluate trains nothing: sweep over settings of train-unet"),
        (["sweep", "train-gnc", "--grid", "epochs=1"], "unknown stage train-gnc, did you mean train-gcn?"),
        (["advise", "--within", "1h", "--data", "s3://bucket/data"], "give the folder that `vt-pipeline tradeoff` measured into"),
        (["advise", "--within", "1h", "--data", "~/a b"], f"run `vt-pipeline tradeoff sample-surfaces --data '{Path.home()}/a b' --preset"),
        (["check", "gelsight", "--configuration", "nonsense"], "nonsense"),
        (["check", "gelsight", "--configuration", "implicit-any"], "only an observation is checked against models"),
        (["sweep", "train-gcn", "--grid", "epochs=1", "--grid", "epochs=2"], "--grid epochs=2: name each setting once"),
        (["sweep", "train-gcn", "--grid", "gcn_features=16,32,16", "--dry-run"], "16 is named twice; name each value once"),
        (["sweep", "train-gcn", "--grid", "train-gcn.epochs=1,2"], "and without its stage: SETTING=VALUE,VALUE"),
        (["tradeoff", "train-unet", "--until", "evaluate"], "--until evaluate measures whole pipelines; leave train-unet out"),
        (["status", "pyproject.toml"], "pyproject.toml is not a data directory; make one with `vt-pipeline run`, or name another"),
        (["summary", "pyproject.toml"], "pyproject.toml is not a data directory; make one with"),
        (["predict", "a.ply", "--grasp", "3"], "--grasp is of a data directory: name --data and --object"),
        (["predict", "a.ply", "--observation", "a.yaml", "--view", "3"], "--view is of a data directory"),
        ([*RUN, "--set", "evaluate.configurations=touch"], "configurations: it must be a list, [VALUE, …]"),
        (["sweep", "train-gcn", "--grid", "epochs=[1,"], "--grid epochs=[1,: write SETTING=VALUE,VALUE"),
        ([*RUN, "--objects", "/nonexistent"], "manifest toy names its own objects: leave --objects"),
        (["sweep", "train-implicit"], "the supplement has no grid for train-implicit: name one, --grid"),
        (
            ["run", "simulate-grasps", "--set", "grasps=20", "--set", "attempts=4"],
            "20 grasps need more than 4 attempts, which yield at most 16; ask for fewer grasps, or for at least 5 attempts",
        ),
        ([*RUN, "--object", "a", "--object", "b"], "--object is given 2 times; it takes one value: run the command once for each"),
        (["validate", "/nonexistent"], "holds no records; looked for ARTIFACT/NNNN-of-NNNN.json"),
    ],
)
def test_error_names_the_value_and_the_remedy(arguments, message):
    assert message in vt(*arguments, fails=True)


def test_stages_are_refused_together_before_the_first_one_runs(tmp_path):
    printed = vt("run", "sample-surfaces", "train-unet", "--data", tmp_path / "data", "--shard", "0", fails=True)
    assert "train-unet processes all objects at once; run it without --object and --shard" in printed
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("raised", "message"),
    [
        (OSError("no room"), "error: no room"),
        (TimeoutError(), "error: TimeoutError; run the same command again, what is finished is kept"),
        (KeyboardInterrupt(), "error: interrupted; run the same command again, what is finished is kept"),
        (KeyError("x"), "this is a bug"),
    ],
)
def test_exceptions_of_commands_give_clear_errors(monkeypatch, raised, message):
    def fails():
        raise raised

    monkeypatch.setattr("pipeline.checks.doctor.examine", fails)
    code, output = invoke("doctor")
    assert code
    assert message in output


def test_model_folder_is_not_a_data_directory(tmp_path):
    (tmp_path / "model.json").write_text("{}")
    assert "nothing has been made" in vt("status", str(tmp_path))
    assert "holds no records" in vt("validate", str(tmp_path), fails=True)


def test_dry_run_prints_the_forecast_and_writes_nothing(tmp_path):
    assert "would make 25 of 25 objects, about" in vt(*RUN, "--data", str(tmp_path / "data"), "--dry-run")
    assert "would be made from 20 objects, about" in vt("run", "train-unet", "--data", str(tmp_path / "data"), "--dry-run")
    assert not (tmp_path / "data").exists()


def test_low_disk_space_is_warned_of(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage._replace(free=1000))
    output = vt(*RUN, "--data", str(tmp_path), "--object", "duck", "--set", "points=100", "--executor", "serial")
    assert "warning: sample-surfaces writes about 0 MB, and 0 MB are free" in output
    assert "made 1 object" in output


def test_sweep_with_an_invalid_point_runs_none(tmp_path):
    output = vt("sweep", "train-gcn", "--grid", "gcn_layers=3,1001", "--dry-run", "--data", str(tmp_path), fails=True)
    assert "gcn_layers" in output
    assert "sweeps/" not in output


def test_folder_of_a_point_of_a_sweep_has_a_short_name_of_its_own():
    short = point_folder("train-gcn", "models/gcn/touch", {"gcn_layers": 3})
    assert short == "sweeps/train-gcn/touch/gcn_layers=3"
    long = [point_folder("train-gcn", "models/gcn/touch", {"pretrained": f"/{'x' * 300}/{number}"}) for number in range(2)]
    assert long[0] != long[1]
    assert max(map(len, long)) < 180


def test_objects_that_left_the_manifest_or_their_split_are_named(tmp_path):
    sources = [{"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": 2}}]
    described = {"name": "m", "description": "d", "seed": 0, "splits": {"train": 2, "valid": 0, "test": 0}, "sources": sources}
    file = tmp_path / "m.yaml"
    options = ["--data", str(tmp_path / "data"), "--manifest", str(file), "--set", "points=50", "--executor", "serial"]
    for count, splits in ((2, {"train": 2, "valid": 0, "test": 0}), (1, {"train": 0, "valid": 0, "test": 1})):
        sources[0]["count"] = {"bottle": count}
        file.write_text(yaml.safe_dump(described | {"splits": splits}))
        forecast = vt("run", "sample-surfaces", *options, "--dry-run")
        printed = vt("run", "sample-surfaces", *options)
    assert "would publish 1 finished row, about" in forecast
    assert "1 object no longer in the manifest (bottle-0001), whose rows are dropped; 1 object in another split" in printed


def test_several_stages_run_in_their_order_in_one_process(tmp_path):
    options = ["--data", str(tmp_path), "--object", "duck", "--set", "points=100", "--set", "queries=10", "--executor", "serial"]
    for what in ("made 1 object in", "up to date, 1 object"):
        printed = vt("run", "sample-distances", "sample-surfaces", *options)
        assert re.findall(rf"(\S+) {tmp_path}/\S+: {what}", printed) == ["sample-surfaces", "sample-distances"]


def test_run_of_one_object_leaves_the_others_missing(tmp_path):
    vt(*RUN, "--data", str(tmp_path), "--object", "duck", "--set", "points=100")
    assert "would make 24 of 25" in vt(*RUN, "--data", str(tmp_path), "--dry-run", "--set", "points=100")
    status = json.loads(vt("status", str(tmp_path), "--json"))["surfaces"]
    assert (status["objects"], len(status["missing"])) == (1, 24)
    assert "incomplete surfaces: 24 objects not made yet" in vt("status", str(tmp_path))


def test_report_of_a_missing_folder_names_it(tmp_path):
    output = vt("report", str(tmp_path / "nowhere"), fails=True)
    assert output.startswith(f"error: {tmp_path}/nowhere is not a data directory; make one with"), output


def test_recipe_of_an_incomplete_dataset_names_the_missing_shard(tmp_path):
    command = ["--data", str(tmp_path), "--object", "knife-0000", "--shards", "2", "--set", "points=100", "--executor", "serial"]
    vt(*RUN, *command)
    output = vt("recipe", str(tmp_path), fails=True)
    assert "0000-of-0002 has not been made; run sample-surfaces for all shards, then write the recipe" in output


def test_one_object_with_other_settings_is_not_published_and_names_the_remedy(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    for name in ("a", "b"):
        trimesh.creation.box().export(folder / f"{name}.ply")
    command = [*RUN, "--manifest", "directory", "--objects", str(folder), "--data", str(tmp_path / "d"), "--executor", "serial", "--set"]
    vt(*command, "points=100")
    output = vt(*command, "points=90", "--object", "a")
    assert "not published, because other rows are damaged, have left the manifest, or were made with other settings" in output
    assert "to look at a alone, run each stage from the first with another --data" in output


def test_folders_of_meshes_have_separate_data_directories(tmp_path):
    places = []
    for name in ("mugs", "bowls"):
        folder = tmp_path / name
        folder.mkdir()
        trimesh.creation.box().export(folder / "one.ply")
        places.append(make_request("sample-surfaces", "directory", objects=folder).data)
    assert places == [Path("data/directory-mugs/draft"), Path("data/directory-bowls/draft")]
    dry = subprocess.run(["make", "-n", "dataset", "MANIFEST=directory", f"OBJECTS={tmp_path / 'mugs'}/"], capture_output=True, text=True)
    assert f"--data '{places[0]}'" in dry.stdout


def test_failures_with_one_reason_are_reported_together(tmp_path):
    folder = tmp_path / "my meshes"
    folder.mkdir()
    trimesh.creation.box().export(folder / "box.stl")
    for name in "abcdefg":
        (folder / f"{name}.off").write_text("OFF\n0 0 0\n")
    command = [*RUN, "--manifest", "directory", "--objects", str(folder), "--data", str(tmp_path / "d"), "--set", "points=100"]
    output = vt(*command, "--executor", "serial")
    assert re.search(r"made 1 object in \d+\.\d s, 7 failed", output)
    assert "failed a, b, c, d, e, … (7 objects): ….off" in output
    alone = vt(*command, "--object", "a", "--retry", "--executor", "serial")
    assert re.search(r"made 0 objects in .* s, 1 failed failed a: a\.off", alone)
    later = ["run", "sample-distances", *command[2:-1], "queries=10", "--executor", "serial"]
    assert re.search(r"made 1 object in .* s; 7 objects failed in an earlier stage", vt(*later))
    for again, failed in ((later, "; 7 objects failed in an earlier stage"), ([*command, "--executor", "serial"], ", 7 failed")):
        for option in ([], ["--dry-run"]):
            assert f"up to date, 8 objects{failed}" in vt(*again, *option)


def test_unreadable_file_is_counted_as_a_failure_of_the_first_stage(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.stl")
    (tmp_path / "empty.obj").write_text("")
    command = [*RUN, "--manifest", "directory", "--objects", str(tmp_path), "--data", str(tmp_path / "d"), "--set", "points=100"]
    assert ", 1 failed failed empty: " in vt(*command, "--executor", "serial")


def test_dry_run_checks_the_hand_file_before_inputs_exist(tmp_path):
    hand = tmp_path / "hand.yaml"
    hand.write_text("name: x\nurdf: x.urdf\nfingres: []\n")
    output = vt("run", "simulate-grasps", "--data", str(tmp_path / "d"), "--dry-run", "--set", f"hand={hand}", fails=True)
    assert "there is no entry fingres, did you mean fingers?" in output


@pytest.mark.parametrize(("address", "warns"), [("tcp://HOST:8786", True), ("HOST:8786", True), ("tls://HOST:8786", False)])
def test_scheduler_without_authentication_is_warned_of(capsys, address, warns):
    make_executor("processes", 0, address)
    output = " ".join(capsys.readouterr().err.split())
    assert (f"warning: whoever reaches {address} can run code as you" in output) == warns


def test_help_groups_commands_and_options_under_short_first_lines() -> None:
    output = vt("--help")
    for panel in ("Make", "Learn", "Describe", "Look and export", "Maintain"):
        assert f"─ {panel} ─" in output
    assert "--install-completion" in output
    options = vt("run", "--help")
    for panel in ("Objects and data", "Settings", "How to run"):
        assert f"─ {panel} ─" in options
    commands = typer.main.get_command(app)
    for name in commands.list_commands(None):
        assert len(commands.get_command(None, name).help.splitlines()[0]) <= 80, name


def test_version_equals_the_package_version() -> None:
    assert invoke("--version") == (0, f"vt-pipeline {version('vt-pipeline')}")


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("run sim", ["simulate-grasps", "simulate-touch", "simulate-presses", "simulate-slides"]),
        ("run sample-surfaces --preset d", ["draft"]),
        ("run sample-surfaces --object duc", ["duck"]),
        ("run sample-surfaces --manifest no-such --object duc", []),
        ("run sample-surfaces --manifest fo", ["four-classes"]),
        ("run sample-surfaces --set simulate-", ["simulate-grasps.", "simulate-touch.", "simulate-presses.", "simulate-slides."]),
        ("run sample-surfaces --set sample-s", [f"sample-surfaces.{name}=" for name in SurfaceSettings.model_fields]),
        ("run sample-surfaces --set simulate-grasps.attem", ["simulate-grasps.attempts=50"]),
        ("run sample-surfaces --set simulate-grasps.sensor", [f"simulate-grasps.sensor={name}" for name in shipped_files("sensor")]),
        ("run sample-surfaces --set simulate-touch.tracer", ["simulate-touch.tracer=ray", "simulate-touch.tracer=sphere"]),
        ("run sample-surfaces --set simulate-touch.tracer=", ["simulate-touch.tracer=ray", "simulate-touch.tracer=sphere"]),
        ("run sample-surfaces --set simulate-touch.tracer=sp", ["simulate-touch.tracer=sphere"]),
        ("run sample-surfaces --set simulat-touch.tracer=sp", []),
        ("run sample-surfaces --set simulate-touch.trace=", []),
        ("check gelsight_", ["gelsight_mini"]),
        ("submit sim", ["simulate-grasps", "simulate-touch", "simulate-presses", "simulate-slides"]),
    ],
)
def test_shell_completes_names(words: str, completed: list[str]) -> None:
    environment = {"_VT_PIPELINE_COMPLETE": "complete_bash", "COMP_WORDS": f"vt-pipeline {words}", "COMP_CWORD": str(len(words.split()))}
    result = CliRunner().invoke(app, [], prog_name="vt-pipeline", env=environment)
    assert result.output.split() == completed
