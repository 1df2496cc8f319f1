"""Every stage, run from the command line on three objects: made, skipped, killed, changed."""

import base64
import gzip
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.labelled import open_artifact
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetStage
from pipeline.errors import StoreError
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import local_points
from stages.registry import GRASP_STAGES, load_stage
from tests.command_line import vt
from tests.contrib.exports.test_exports import elastic  # noqa: F401

ROOT = Path(__file__).parents[1]
ASSIGNMENTS = [
    *("sample-surfaces.points=2000", "simulate-grasps.attempts=6", "simulate-grasps.ik_samples=512"),
    *("simulate-presses.presses=5", "simulate-presses.pixels=40"),
    *("simulate-slides.slides=2", "simulate-slides.steps=8", "simulate-slides.rate=4", "simulate-slides.pixels=40"),
    *("train-unet.width=4", "train-unet.epochs=2", "train-unet.batch_size=8", "fit-charts.max_iterations=10"),
    *("train-touch.width=4", "train-touch.epochs=2", "train-touch.batch_size=8"),
    *("train-gcn.epochs=2", "train-gcn.gcn_layers=3", "train-gcn.gcn_features=12", "train-gcn.encoder_width=0.25"),
    *(
        "train-gcn.batch_size=4",
        "train-gcn.loss_points=300",
        "checkpoint_seconds=0",
        "evaluate.configurations=[occluded-touch]",
        "evaluate.points=1000",
    ),
    *("evaluate.grasps=[1,5]", "train-implicit.epochs=2", "train-implicit.features=8", "train-implicit.encoder_width=0.1"),
]
UNEXPLAINED = ("min D", "looked up", "2A/", "closure 0", "sampling floor", "supplement's")
"""Words that mean nothing to a reader of pages."""
SHARDED = [name for name in GRASP_STAGES if not isinstance(load_stage(name), DatasetStage)]
SEEN = {"train-unet": 2, "train-touch": 2, "train-gcn": 2, "train-implicit": 2, "evaluate": 2}
"""Number of the three objects that a dataset stage reads."""


@pytest.fixture(scope="module")
def manifest(tmp_path_factory) -> Path:
    """Write a manifest of three objects: a procedural one, and two from files."""
    path = tmp_path_factory.mktemp("manifest") / "three.yaml"
    sources = [
        {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": 1}},
        {"kind": "pybullet", "licence": "zlib", "up": "z", "files": {"duck": {"file": "duck.obj", "up": "y"}}, "random_urdfs": 1},
    ]
    splits = {"train": 1, "valid": 1, "test": 1}
    path.write_text(yaml.safe_dump({"name": "three", "description": "d", "seed": 0, "splits": splits, "sources": sources}))
    return path


def run_of(stage: str, manifest: Path, data: Path, *more: str) -> list[str]:
    """Return the arguments that run a stage."""
    sets = [part for assignment in ASSIGNMENTS for part in ("--set", assignment)]
    return ["run", stage, "--manifest", str(manifest), "--data", str(data), *sets, *more]


def digests(data: Path) -> dict[str, str]:
    report = json.loads(vt("status", data, "--json"))
    assert all(not account.get("failures") and not account.get("stale") for account in report.values()), report
    return {name: account["digest"] for name, account in report.items()}


@pytest.fixture(scope="module")
def made(manifest, tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("data")
    for stage in GRASP_STAGES:  # renderings also run in worker processes
        vt(*run_of(stage, manifest, data, *(("--workers", "2") if stage == "render-vision" else ("--executor", "serial"))))
    return data


def test_every_artifact_exists_and_is_valid(made):
    artifacts = {load_stage(name).output.name for name in SHARDED}
    folders = {"models/unet", "models/touch", "models/gcn/occluded-touch", "models/implicit/implicit-unoccluded", "evaluation"}
    assert set(digests(made)) == artifacts | folders
    assert vt("validate", str(made)).count(": valid") == len(artifacts | folders) + (made / "report").exists()


def test_second_run_changes_no_file(manifest, made):
    before = {path: path.stat().st_mtime_ns for path in made.rglob("*")}
    for stage in GRASP_STAGES:
        assert f"up to date, {SEEN.get(stage, 3)} objects" in vt(*run_of(stage, manifest, made))
    assert {path: path.stat().st_mtime_ns for path in made.rglob("*")} == before


@pytest.mark.slow
def test_killed_and_continued_stages_give_equal_digests(manifest, made, tmp_path):
    for stage in GRASP_STAGES:
        leftovers = ".work/models/**/.checkpoint.safetensors" if stage.startswith("train") else ".work/*/rows/*/*.row"
        if stage != "evaluate":  # one model of one object: nothing to keep
            kill_midway(run_of(stage, manifest, tmp_path, "--workers", "1"), tmp_path, leftovers)
        output = vt(*run_of(stage, manifest, tmp_path, "--executor", "serial"))
        assert "made 3 objects" not in output  # at least one piece was kept
    assert digests(tmp_path) == digests(made)


def kill_midway(run: list[str], data: Path, leftovers: str) -> None:
    """Kill a run, and nothing else, as soon as it has finished an object or step; its workers must end by themselves."""
    command = [sys.executable, "-m", "pipeline", *run]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        while not [*data.glob(leftovers)]:
            assert process.poll() is None, "the run ended before it could be killed"
            time.sleep(0.002)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    deadline = time.monotonic() + 20
    while group_lives(process.pid):
        assert time.monotonic() < deadline, "a worker outlives the run that was killed"
        time.sleep(0.05)


def group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow  # tests/recipes/test_recipe.py remakes a dataset in other shards
def test_digests_do_not_depend_on_shards(manifest, made, tmp_path):
    for stage in SHARDED:
        if stage == "fit-charts":  # with the model made above: whole runs are compared in another test
            shutil.copytree(made / "models", tmp_path / "models")
            for family in ("gcn", "implicit"):
                shutil.rmtree(tmp_path / "models" / family)
        for number in (1, 0):
            vt(*run_of(stage, manifest, tmp_path, "--shards", "2", "--shard", str(number), "--executor", "serial"))
    whole = digests(made)
    assert digests(tmp_path) == {name: whole[name] for name in digests(tmp_path)}
    assert len(digests(tmp_path)) == len(SHARDED) + 2  # the copied models that read tactile images
    assert "up to date" in vt(*run_of("simulate-touch", manifest, tmp_path))


def test_grasps_are_read_as_tensors(made):
    arrays = ("points", "occluded", "tactile_image", "depth", "sensor_pose", "touch_success", "local_points", "local_count", "untouched")
    train = GraspDataset(made, arrays)
    assert len(train) == 5
    item = train[3]
    assert (item["object_id"], item["grasp"]) == (train.items[3][0], 3)
    assert item["points"].shape == (2000, 3)
    assert item["occluded"].shape == (1, 256, 256, 3)
    assert item["tactile_image"].shape == (4, 100, 100, 3)
    depth, count = item["depth"].numpy(), item["local_count"].numpy()
    np.testing.assert_array_equal(count, (depth < np.float32(6.8e-3)).sum(axis=(1, 2)))
    for index, pose in enumerate(item["sensor_pose"].numpy()):  # as `simulate-touch` stores them on request
        np.testing.assert_array_equal(item["local_points"][index], local_points(depth[index], pose, load_sensor("gel_16mm"))[0])
    items_of_split = {split: GraspDataset(made, ["points"], split).items for split in ("train", "valid", "test")}
    assert len({name for items in items_of_split.values() for name, _ in items}) == 3


def test_missing_artifact_or_array_is_named(made, tmp_path):
    with pytest.raises(StoreError, match="no artifact has an array taste"):
        GraspDataset(made, ["taste"])
    with pytest.raises(StoreError, match="is not a data directory"):
        GraspDataset(tmp_path, ["points"])
    shutil.copy(made / "dataset.json", tmp_path)
    with pytest.raises(StoreError, match=r"surfaces has not been made; run `vt-pipeline run sample-surfaces --data .*` first"):
        GraspDataset(tmp_path, ["points"])


def test_xarray_opens_the_same_store_with_labels(made):
    touch, grasps = open_artifact(made, "touch"), open_artifact(made, "grasps")
    thumb = touch.depth.sel(object="duck", sensor="thumb", grasp=0)
    assert thumb.dims == ("row", "col")
    assert thumb.attrs["units"] == "m"
    rows = ObjectRows(made, ["depth"], split=None)
    np.testing.assert_array_equal(thumb, rows.read("depth", "duck", 0)[list(touch.sensor).index("thumb")])
    assert grasps.joint_angles.sel(joint="joint_0.0").shape == (3, 5)
    assert grasps.sel(object="duck").category == "object"


def test_summary_draws_contact_sheets_once(made):
    assert "% successful" in vt("summary", str(made))
    sheets = sorted(made.glob("contact-sheet*.png"))
    assert sheets
    before = [path.stat().st_mtime_ns for path in sheets]
    vt("summary", str(made))
    assert [path.stat().st_mtime_ns for path in sheets] == before


def test_summary_without_renderings_prints_statistics_only(made, tmp_path):
    for name in ("surfaces", "grasps", "touch"):
        shutil.copytree(made / name, tmp_path / name)
    output = vt("summary", tmp_path)
    assert "% successful" in output
    assert "no contact sheets: vision has not been made" in output


def test_report_shows_tables_figures_and_scenes_of_the_evaluation(made):
    tables = vt("report", str(made), "--no-pages")
    output = vt("report", str(made))
    assert output.startswith(tables)
    assert "report: " not in tables
    assert output.count("Table 3:") == 1
    assert "Do the orderings of Smith et al. 2020 hold?" in output
    report = made / "report"
    assert (report / "figures" / "reconstructions.png").stat().st_size > 10_000
    with Image.open(report / "figures" / "local-shape.png") as picture:
        assert (np.asarray(picture.convert("L"))[:, -5:] > 250).all(), "labels at the right are not cut"
    pages = {path.name: path.read_text() for path in report.rglob("*.html")}
    assert {"index.html", "gallery.html", "figures.html", "results.html", "about.html", "duck.html"} < pages.keys()
    links = [(page.parent, link) for page in report.rglob("*.html") for link in re.findall(r'(?:href|src)="([^"]+)"', pages[page.name])]
    assert not [link for folder, link in links if not link.startswith(("data:", "#")) and not (folder / link).exists()]
    results = pages["results.html"]
    assert results.index("mean distance, mm") < results.index("Table 3")
    assert results.index("F-score at 5&nbsp;mm") < results.index("× 9000")
    assert "Do the orderings of Smith et al. 2020 hold?" in results
    assert pages["index.html"].count("figures/overview-") == 6
    assert "reconstruction: occluded-touch" in pages["index.html"]
    assert "steps not settled" in pages["index.html"]
    assert 'src="duck.slide.webp"' in pages["duck.html"]
    for name, page in pages.items():
        visible = re.sub(r'data:[^"]+', "", page)
        assert not [words for words in UNEXPLAINED if words in visible], name
    test = GraspDataset(made, ["points"], "test").items[0][0]
    assert re.search(r'<option value="occluded-touch-[15]" selected>occluded-touch, [15] grasps?, [0-9.]+ mm', pages[f"{test}.html"])
    scene = trimesh.load(io.BytesIO(scene_of(report / "objects" / "duck.mesh.js")), file_type="glb")
    assert any(getattr(mesh.visual, "uv", None) is not None and mesh.visual.material.baseColorTexture for mesh in scene.geometry.values())
    nodes = {f"grasp-{grasp}-{part}" for grasp in range(5) for part in ("hand", "sensors", "touched", "charts")}
    assert {"object"} | nodes <= set(scene.graph.nodes)
    before = {path: path.stat().st_mtime_ns for path in (report / "objects").iterdir()}
    vt("report", made)
    assert {path: path.stat().st_mtime_ns for path in (report / "objects").iterdir()} == before


@pytest.mark.slow
def test_report_shows_the_results_of_another_training_seed(made, tmp_path):
    data = shutil.copytree(made, tmp_path / "data")
    (data / "evaluation.json").rename(data / "evaluation-seed-1.json")
    shutil.rmtree(data / "report", ignore_errors=True)
    vt("report", data, "--most", "1")
    assert "Table 3" in (data / "report" / "results.html").read_text()
    assert (data / "report" / "figures" / "reconstructions.png").exists()


def test_export_writes_the_scene_of_one_object(made, tmp_path):
    vt("export", made, tmp_path / "duck.glb", "--object", "duck")
    nodes = set(trimesh.load(tmp_path / "duck.glb").graph.nodes)
    assert {"object", "grasp-0-hand", "grasp-4-sensors"} <= nodes


def scene_of(script: Path) -> bytes:
    """Decode the glTF scene that a page loads as a script."""
    return gzip.decompress(base64.b64decode(script.read_text().split('"')[3]))


@pytest.mark.parametrize("page", ["README.md", "docs/guide/reading.md"])
def test_python_code_in_the_documents_runs(page, made, elastic):  # noqa: F811
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)
    assert blocks
    for block in blocks:
        exec(block.replace("data/toy/draft", str(made)).replace("data/mini/draft", str(elastic)), {})  # as a reader would paste it


def test_predict_writes_a_mesh_file_for_one_grasp(made, tmp_path):
    test = GraspDataset(made, ["points"], "test").items[0][0]
    options = ["--data", str(made), "--object", test, "--grasp", "2", "--configuration", "occluded-touch"]
    vt("predict", str(tmp_path / "out.ply"), *options)
    apart, joined = (trimesh.load(tmp_path / name, process=False) for name in ("out.ply", "out-joined.ply"))
    assert len(apart.vertices) >= 1824
    assert len(joined.vertices) == len(apart.vertices) - 1824 + 1154
    assert np.isfinite(apart.vertices).all()
    output = vt("predict", str(tmp_path / "closed.ply"), *options, "--surface", "closed", "--resolution", "64")
    assert "closed.ply: closed, " in output
    assert trimesh.load(tmp_path / "closed.ply", process=False).is_watertight


def test_sweep_trains_every_point_once_and_ranks_them(manifest, made):
    sets = [part for assignment in [*ASSIGNMENTS, "train-gcn.configuration=none", "train-gcn.epochs=1"] for part in ("--set", assignment)]
    command = ["sweep", "train-gcn", "--manifest", str(manifest), "--data", str(made), *sets]
    first = vt(*command, "--grid", "gcn_features=6,12", "--grid", "learning_rate=1e-3")
    assert first.count("up to date") == 0
    assert "best loss" in first
    again = vt(*command, "--grid", "gcn_features=6,12", "--grid", "learning_rate=1e-3")
    assert again.count("up to date") == 2
    assert vt(*command, "--dry-run").count("sweeps/train-gcn/none/") == 3**3  # the supplement's grid
