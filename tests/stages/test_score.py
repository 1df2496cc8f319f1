"""`vt-pipeline score`: our own predictions get the figures of `evaluate` to the last digit, and what cannot be scored is named."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from checks.fuzz.target import seal
from pipeline.config.settings import Settings
from pipeline.contrib.report.results import Results
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.plan import Request
from pipeline.errors import InvalidInput
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from pipeline.store.directory import DataDirectory
from pipeline.tables.comparison import scores
from schemas.vision import VISION
from stages.evaluate.evaluation_files import METRICS, read_figures
from stages.evaluate.scored_files import find_faults, find_files, misplacement, read_surface
from stages.evaluate.scores import files_digest
from tests.command_line import vt
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset as spheres

NETWORK = "implicit-touch"
SPLITS = ("train", "test")
OBJECTS = spheres.objects(6, SPLITS)
TESTED = [item.object_id for item in OBJECTS if item.split == "test"]
CASES = [(1, first) for first in range(5)] + [(2, first) for first in range(5)]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 6, SPLITS)
    spheres.make_implicit_model(folder, NETWORK, touch_reach=0.05, spacing=0.05)
    spheres.run_stage(folder, "evaluate", OBJECTS, "points=500", "grasps=[1,2]", f"configurations=[{NETWORK}]", "tau=2e-4", seed=3)
    return folder


@pytest.fixture(scope="module")
def predictions(data, tmp_path_factory) -> Path:
    """Write the network's reconstructions in every case, as a user would."""
    folder = tmp_path_factory.mktemp("files") / "own"
    for given, first in CASES:
        (place := folder / (f"grasps-{given}-from-{first}" if first else f"grasps-{given}")).mkdir(parents=True)
        for object_id in TESTED:
            grasps = [(first + step) % 5 for step in range(given)]
            suffix = ".glb" if object_id == TESTED[0] else ".ply"
            predict(place / f"{object_id}{suffix}", StoredGrasps(data, object_id, grasps), PredictOptions(data / "models", NETWORK))
    return folder


@pytest.fixture
def folder(predictions, tmp_path) -> Path:
    """Copy the reconstructions from the first grasp."""
    return shutil.copytree(predictions / "grasps-1", tmp_path / "method")


def scored(data: Path, name: str) -> Path:
    return DataDirectory(data).verified_folder(f"scores/{name}")


def test_score_of_network_predictions_equals_evaluate(data, predictions):
    printed = vt("score", predictions, data)
    ours, theirs = read_figures(DataDirectory(data).verified_folder("evaluation")), read_figures(scored(data, "own"))
    assert len(ours[NETWORK].rows) > 100
    assert ours[NETWORK].available("iou").size == ours[NETWORK].available("watertight").size == len(TESTED)
    assert sorted(ours[NETWORK].rows) == sorted(theirs["own"].rows)
    assert {name: ours[name].rows for name in ours if name != NETWORK}.items() <= {name: theirs[name].rows for name in theirs}.items()
    own, evaluated = (
        json.loads((place / METRICS).read_text()) for place in (scored(data, "own"), DataDirectory(data).verified_folder("evaluation"))
    )
    assert own["means"]["own"] == evaluated["means"][NETWORK]
    assert "metrics.json" in printed
    assert own["settings"]["points"] == 500  # those of the evaluation
    assert own["vt_pipeline"]


def test_unchanged_files_are_not_measured_again_and_changed_ones_are(data, folder):
    first = vt("score", folder, data, "--name", "again")
    before = scored(data, "again")
    assert vt("score", folder, data, "--name", "again") == first
    assert scored(data, "again") == before
    shutil.copy(folder / f"{TESTED[1]}.ply", folder / f"{TESTED[2]}.ply")
    vt("score", folder, data, "--name", "again")
    assert scored(data, "again") != before


def test_digest_covers_files_that_a_gltf_names(tmp_path):
    (tmp_path / "a.gltf").write_text('{"buffers": [{"uri": "a.bin"}]}')
    digests = set()
    for content in (b"vertices", b"others"):
        (tmp_path / "a.bin").write_bytes(content)
        digests.add(files_digest(tmp_path))
    assert len(digests) == 2
    (tmp_path / "a.gltf").write_text("no glTF")
    assert files_digest(tmp_path) not in digests


def test_each_fault_of_a_folder_is_named_and_no_score_is_written(data, folder):
    first, second, third = TESTED
    (folder / f"{first}.glb").unlink()
    trimesh.creation.icosphere(2, 150.0).export(folder / f"{second}.ply")  # its ball has a radius of 0.16 m
    moved = trimesh.load(folder / f"{third}.ply", process=False)
    moved.apply_translation(-spheres.CENTRE - [0, 0, 0.5]).export(folder / f"{third}.ply")
    (folder / "typo.ply").write_bytes((folder / f"{second}.ply").read_bytes())
    moved.export(folder / f"{third}.stl")
    (folder / "a.obj").write_text("of the training split")
    (folder / f"._{third}.ply").write_text("what macOS leaves")
    (folder / "grasps_5").mkdir()
    (folder / "grasps-9").mkdir()
    (folder / "grasps-9" / f"{first}.ply").write_text("")
    words = vt("score", folder, data, "--name", "faulty", fails=True)
    for fault in (
        f"1 of 3 test objects have no file: {first}",
        "times as large as the object, as if it were in mm",
        f"{third}.ply: its middle is at (",
        "it is not in the world's frame",
        "typo.ply: the dataset has no object typo",
        f"{third}.stl: {third}.ply is of the same object and grasps",
        f"grasps-9/{first}.ply: it is of 9 grasps, but the dataset holds 5 grasps",
        "grasps_5: folders are called grasps-N",
    ):
        assert fault in words, fault
    assert "scores/faulty" not in scores(DataDirectory(data))


def test_misplaced_reconstructions_are_measured_on_request(data, tmp_path):
    bar = trimesh.creation.box((0.02, 0.02, 0.2))
    for object_id in TESTED:
        bar.copy().apply_translation([90, 90, 90]).export(tmp_path / f"{object_id}.ply")
    assert "--misplaced" in vt("score", tmp_path, data, "--name", "far", fails=True)
    vt("score", tmp_path, data, "--name", "far", "--misplaced")
    assert read_figures(scored(data, "far"))["far"].available("iou").tolist() == [0, 0, 0]


def test_open_reconstructions_do_not_raise_the_overlap_of_the_others(data, folder):
    mesh = trimesh.load(folder / f"{TESTED[1]}.ply", process=False)
    mesh.faces = mesh.faces[1:]
    mesh.export(folder / f"{TESTED[1]}.ply")
    vt("score", folder, data, "--name", "open")
    figures, whole = read_figures(scored(data, "open"))["open"], read_figures(DataDirectory(data).verified_folder("evaluation"))[NETWORK]
    assert figures.available("watertight").tolist() == [1, 0, 1]
    assert figures.available("iou").tolist() == [value * (row != 1) for row, value in enumerate(whole.available("iou"))]


def test_a_detail_with_many_vertices_is_not_taken_for_the_size(tmp_path):
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.1, 0.1, (2000, 3)) + spheres.CENTRE
    box, detail = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.icosphere(5, 0.001)
    trimesh.util.concatenate([box, detail]).apply_translation(spheres.CENTRE).export(tmp_path / "a.ply")
    assert not list(find_faults(find_files(tmp_path, ["a"], [], 1, 5), {"a": points}.__getitem__, misplaced=False))


def test_files_with_y_up_are_distinguished_from_bad_ones(tmp_path):
    rng = np.random.default_rng(0)
    truth = {name: rng.normal(size=(2000, 3)) * [0.02, 0.02, 0.1] + spheres.CENTRE for name in "abc"}  # upright rods
    for name, points in truth.items():
        x, y, z = (points - spheres.CENTRE).T
        np.save(tmp_path / f"{name}.npy", spheres.CENTRE + np.stack([x, z, -y], axis=1))
    files = find_files(tmp_path, list(truth), [], 1, 5)
    (fault,) = find_faults(files, truth.__getitem__, misplaced=False)
    assert "the files have y up" in fault
    for name, points in truth.items():
        np.save(tmp_path / f"{name}.npy", points * [3, 1, 0.8] - [0, 0, -0.12])
    assert not list(find_faults(files, truth.__getitem__, misplaced=False))


def test_invalid_method_name_or_folder_is_refused(data, tmp_path):
    assert "no folder" in vt("score", tmp_path / "none", data, fails=True)
    assert "no file of a test object" in vt("score", tmp_path, data, fails=True)
    assert "a method's name" in vt("score", tmp_path, data, "--name", "a/b", fails=True)
    assert "--name shipped: that is the pretrained network" in vt("score", tmp_path, data, "--name", "shipped", fails=True)


def test_dataset_without_occluded_images_is_scored(data, folder, tmp_path):
    place = Path(shutil.copytree(data, tmp_path / "data"))
    (given,) = (stage for stage in spheres.stages() if stage.output is VISION)
    asked: Any = Request(stage=given, settings=Settings(), manifest="balls", objects=OBJECTS, preset="draft", seed=1, data=place)
    pack(asked, lambda unit: {name: array for name, array in given.row(unit).items() if name != "occluded"})
    assert "most similar silhouette" in vt("score", folder, place)


def test_scores_have_rows_beside_the_networks_with_their_grasps_and_no_empty_table(data, folder, predictions):
    vt("score", folder, data, "--name", "other")
    assert "two, 2 grasps" in vt("score", predictions / "grasps-2", data, "--name", "two", "--grasps", 2)
    directory, names = DataDirectory(data), ["scores/other", "scores/two"]
    assert set(names) <= set(scores(directory))
    beside = {table.title.partition(":")[0]: table for table in Results(directory, ["evaluation"], names).tables}
    accuracy = next(table for title, table in beside.items() if title.startswith("Accuracy"))
    assert [row.cells[0] for row in accuracy.rows][:3] == [NETWORK, "other", "two, 2 grasps"]
    assert None not in accuracy.rows[2].cells  # surfaces have normals and an inside, from however many grasps
    (row,) = (row for row in beside["Table 3"].rows if row.cells[0] == "other")
    assert row.cells[2] is None  # two grasps were not given
    assert "other" in vt("report", data, "--no-pages")
    assert "scores/other" in vt("status", data)
    vt("validate", data)
    alone = Results(directory, [], ["scores/two"]).tables
    assert "3 objects" in alone[0].title
    assert all(table.rows for table in alone if table.columns)
    assert "Table 2" not in " ".join(table.title for table in alone)


def test_point_clouds_are_scored_by_their_distances_alone(data, tmp_path):
    rows = ObjectRows(data, ["points"], "test")
    first, second, third = (rows.read("points", object_id) for object_id in TESTED)
    trimesh.PointCloud(first).export(tmp_path / f"{TESTED[0]}.ply")
    np.save(tmp_path / f"{TESTED[1]}.npy", second)
    np.save(tmp_path / f"{TESTED[2]}.npy", third[:300])
    assert "1 point cloud with fewer than 500 points, 300 or more" in vt("score", tmp_path, data, "--name", "truth")
    figures = read_figures(scored(data, "truth"))["truth"]
    assert (figures.per_object("mean_distance") < 0.03).all()  # 500 of 2000 points: what sampling leaves
    assert not len(figures.available("normal_consistency"))
    assert not len(figures.available("iou"))


def test_unusable_files_are_named(data, tmp_path):
    np.save(tmp_path / f"{TESTED[1]}.npy", np.zeros((0, 3)))
    header = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    (tmp_path / f"{TESTED[0]}.ply").write_bytes(header + b"nan 0 0\n")
    (tmp_path / f"{TESTED[2]}.ply").write_bytes(b"not a mesh")
    printed = vt("score", tmp_path, data, fails=True)
    for words in (f"{TESTED[0]}.ply: ", "NaN", f"{TESTED[1]}.npy: it holds no point", f"{TESTED[2]}.ply: "):
        assert words in printed
    with (tmp_path / "a.npy").open("wb") as file:
        np.savez(file, points=np.zeros((5, 3)))
    with pytest.raises(InvalidInput, match=r"a\.npy"):
        read_surface(tmp_path / "a.npy")


def test_outdated_scores_are_not_reported(data, folder, tmp_path, monkeypatch):
    copy = shutil.copytree(data, tmp_path / "data")
    vt("score", folder, copy, "--name", "old")
    with monkeypatch.context() as patch:
        patch.setattr("stages.evaluate.evaluation_files.VERSION", 99)
        assert "not of schema version 99" in str(scores(DataDirectory(copy))["scores/old"])
    seal(copy / "scores/old.json", lambda record: {"inputs": record["inputs"] | {"surfaces": "0" * 64}})
    assert scores(DataDirectory(copy))["scores/old"]
    assert "scores/old is outdated" in vt("report", copy, "--no-pages")


def test_misplacement_names_unit_and_axis_and_accepts_bad_reconstructions():
    points = np.random.default_rng(0).normal(size=(2000, 3)) * [0.1, 0.05, 0.02] + spheres.CENTRE
    assert misplacement(points, points) is None
    assert misplacement(points * 0.5 + 0.5 * spheres.CENTRE + 0.1, points) is None  # bad, not elsewhere
    above = points + [0, 0, 0.4]
    turned = points[:, [0, 2, 1]] * [1, 1, -1]
    for surface, truth, words in (
        (points * 100, points, "in cm"),
        (points * 1000, points, "in mm"),
        (points / 1000, points, "0.001 times as large"),
        (points - spheres.CENTRE * 3, points, "not in the world's frame"),
        (above[:, [0, 2, 1]] * [1, -1, 1], above, "this file's z does"),
        (turned, points, "turned by 90° about x: the file has y up"),
    ):
        assert words in str(misplacement(surface, truth))
    assert "turned" not in str(misplacement(turned - [0, 5, 0], points))


def test_surfaces_are_read_as_the_world_has_them(tmp_path):
    """Without vertices that no face uses; glTF's y is up; STL shares no vertices."""
    box, ball = trimesh.creation.box((0.1, 0.2, 0.3)), trimesh.creation.icosphere(2)
    trimesh.Trimesh(np.vstack([[9.0, 9, 9], box.vertices]), box.faces + 1, process=False).export(tmp_path / "box.ply")
    made = read_surface(tmp_path / "box.ply")
    np.testing.assert_allclose(made.vertices[made.faces], box.triangles, atol=1e-7)
    assert len(made.vertices) == len(box.vertices)
    box.export(tmp_path / "box.glb")
    assert np.ptp(read_surface(tmp_path / "box.glb").vertices, axis=0) == pytest.approx([0.1, 0.3, 0.2])
    ball.export(tmp_path / "ball.stl")
    assert len(read_surface(tmp_path / "ball.stl").vertices) == len(ball.vertices)
