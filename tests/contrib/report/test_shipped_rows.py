"""The shipped network on any dataset: measured beside networks trained there, shown in pages, left out without its inputs."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from pipeline.config.manifest import load_manifest
from pipeline.config.settings import Settings
from pipeline.config.sources import identity
from pipeline.console import Table
from pipeline.contrib.report.figures import nearest_middle_farthest
from pipeline.contrib.report.report_source import ReportSource, errors_table
from pipeline.contrib.report.results import DEFAULT_SERIES, _ways, summarise
from pipeline.engine.plan import Request
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh_cleaning import bounding_diagonal
from pipeline.models.shipped_weights import DEFAULT, read_card
from pipeline.store.directory import DataDirectory
from pipeline.tables.comparison import scores
from pipeline.tables.evaluation_tables import evaluation_tables
from schemas.surfaces import SURFACES
from schemas.vision import VISION
from stages.evaluate.evaluation_files import read_figures, read_root
from stages.evaluate.scores import fitting_rows, learned_objects, measuring_settings, median_diagonal
from tests.command_line import vt
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset as spheres

SPLITS = ("train", "test")
OBJECTS = spheres.objects(4, SPLITS)
WAYS = ("touch", "occluded", "occluded-touch", "unoccluded", "unoccluded-touch")


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """Make balls with an evaluation of `implicit-any`, whose weights stand for those that ship."""
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 4, SPLITS)
    spheres.make_implicit_model(folder, DEFAULT, spacing=0.05)
    networks = f"configurations=[{DEFAULT}-touch,{DEFAULT}-unoccluded]"
    spheres.run_stage(folder, "evaluate", OBJECTS, "points=300", "grasps=[1]", networks, seed=3)
    with pytest.MonkeyPatch.context() as patch:
        ship(patch, folder)
        vt("report", folder, "--shipped", "--no-pages")
    return folder


def ship(patch: pytest.MonkeyPatch, folder: Path) -> None:
    patch.setattr("stages.evaluate.scores.SHIPPED", folder / "models")
    for module in ("stages.evaluate.scores", "pipeline.models.shipped_weights"):
        patch.setattr(f"{module}.shipped_models", lambda: folder / "models")


def test_shipped_weights_have_the_figures_of_the_evaluated_weights(data):
    directory = DataDirectory(data)
    own, theirs = (read_figures(directory.verified_folder(name)) for name in ("evaluation", "scores/shipped"))
    assert list(read_root(directory.verified_folder("scores/shipped"))["configurations"]) == [f"shipped-{way}" for way in WAYS]
    for way in ("touch", "unoccluded"):
        for metric in ("chamfer", "mean_distance"):
            first = theirs[f"shipped-{way}"].per_case(metric)[:, 0]
            np.testing.assert_array_equal(own[f"{DEFAULT}-{way}"].per_case(metric)[:, 0], first)
    assert theirs["shipped-touch"].per_case("chamfer").shape == (2, 1)  # of the first grasp alone


def test_report_shows_rows_and_meshes_of_the_shipped_network_and_measures_it_once(data, monkeypatch):
    ship(monkeypatch, data)
    with monkeypatch.context() as another:
        another.setattr("pipeline.tables.comparison.shipped_digest", lambda _: "another")
        assert "the pretrained network is another now" in str(scores(DataDirectory(data))["scores/shipped"])
    assert scores(DataDirectory(data)) == {"scores/shipped": None}
    before = DataDirectory(data).verified_folder("scores/shipped")
    printed = vt("report", data, "--shipped", "--no-pages")
    assert all(f"shipped-{way}" in printed for way in WAYS)
    assert DataDirectory(data).verified_folder("scores/shipped") == before
    evaluation = ReportSource(data).evaluation
    assert evaluation is not None
    assert {f"shipped-{way}" for way in WAYS} < set(evaluation.configurations)
    shown = {one.name: one for one in evaluation.predictions("b")}
    given = {row.cells[0]: row.cells[1] for row in errors_table([shown["shipped-touch-1"], shown["shipped-unoccluded-1"]]).rows}
    assert given == {"shipped-touch": 1, "shipped-unoccluded": 0}
    assert "grasp" not in shown["shipped-unoccluded-1"].inputs
    assert shown["shipped-touch-1"].felt
    assert not shown["shipped-unoccluded-1"].felt
    assert len(evaluation.surface("b", shown["shipped-unoccluded-1"])[0])
    errors = {name: np.mean([one.figures["mean_distance"] for one in evaluation.predictions(name)]) for name in evaluation.object_ids}
    assert evaluation.ranked(evaluation.configurations) == sorted(errors, key=errors.get)


@pytest.mark.parametrize(("most", "shown"), [(1, "a"), (2, "ad"), (3, "adg"), (5, "abcdg"), (7, "abcdefg"), (9, "abcdefg")])
def test_a_figure_shows_the_nearest_middling_and_farthest_objects(most, shown):
    assert "".join(nearest_middle_farthest("abcdefg", most)) == shown


def test_rows_without_their_inputs_are_left_out_with_the_reason(data, tmp_path, monkeypatch):
    ship(monkeypatch, data)
    copy = shutil.copytree(data, tmp_path / "data", ignore=shutil.ignore_patterns("charts", "evaluation*", "vision"))
    assert (copy / "scores" / "shipped.json").exists()
    printed = vt("report", copy, "--shipped", "--no-pages")
    assert "the pretrained network is not measured: touch: fit-charts has not been run" in printed
    assert "unoccluded: render-vision has not made it" in printed
    assert "no network has been evaluated" in printed
    assert not (copy / "scores" / "shipped.json").exists(), "it was of images and charts that are gone"


def test_images_of_another_camera_are_turned_to_the_training_camera_as_those_of_a_robot_are(data, tmp_path, monkeypatch):
    ship(monkeypatch, data)
    copy = Path(shutil.copytree(data, tmp_path / "data", ignore=shutil.ignore_patterns("evaluation*")))
    (given,) = (stage for stage in spheres.stages() if stage.output is VISION)
    asked: Any = Request(given, Settings(), "balls", OBJECTS, "draft", 1, copy)
    zoomed_in = {"d": np.diag([2.0, 2, 1])}
    pack(asked, lambda unit: (row := given.row(unit)) | {"projection": zoomed_in.get(unit.name, np.eye(3)) @ row["projection"]})
    assert fitting_rows(DataDirectory(copy), DEFAULT) == ([f"{DEFAULT}-{way}" for way in WAYS], [])
    printed = " ".join(vt("report", copy, "--shipped", "--no-pages").split())
    assert "images are turned and zoomed to the camera that it was trained with" in printed
    assert "shipped-unoccluded" in printed


def test_touches_of_another_gel_are_given_as_points_and_the_table_says_so(data, tmp_path, monkeypatch):
    ship(monkeypatch, data)
    monkeypatch.setattr("stages.evaluate.scores.shipped_chart_sensor", lambda: load_sensor("gelsight_mini"))
    copy = Path(shutil.copytree(data, tmp_path / "data", ignore=shutil.ignore_patterns("charts", "evaluation*")))
    printed = " ".join(vt("report", copy, "--shipped", "--no-pages").split())
    assert "touches are points of the exact depth maps" in printed
    assert "shipped-touch" in printed


@pytest.mark.parametrize(("diagonals", "chosen"), [((0.4, 0.49), "implicit-gels"), ((0.06, 0.2), DEFAULT)])
def test_the_measured_network_is_that_for_the_size_of_the_test_objects(data, tmp_path, monkeypatch, diagonals, chosen):
    """The median diagonal of the test objects, balls of 120 and 160 mm, is 0.485 m; the other network has learned from objects of 0.5 m."""
    copy = Path(shutil.copytree(data, tmp_path / "data", ignore=shutil.ignore_patterns("evaluation*", "scores")))
    spheres.make_implicit_model(copy, "implicit-gels", diagonals, spacing=0.05)
    ship(monkeypatch, copy)
    monkeypatch.setattr("stages.evaluate.scores.learned_objects", lambda *_: ())
    printed = " ".join(vt("report", copy, "--shipped", "--no-pages").split())
    assert f"shipped-…: the pretrained network {chosen}, given the first grasp of each object alone" in printed
    assert ("touches are points of the exact depth maps" in printed) == (chosen == "implicit-gels")
    scored = read_root(DataDirectory(copy).verified_folder("scores/shipped"))
    assert list(scored["configurations"]) == [f"shipped-{way}" for way in WAYS]


def test_failed_test_objects_do_not_count_for_the_size(tmp_path):
    spheres.make_data(tmp_path, 3)
    (given,) = (stage for stage in spheres.stages() if stage.output is SURFACES)
    asked: Any = Request(given, Settings(), "balls", spheres.objects(3), "draft", 1, tmp_path)
    pack(asked, given.row, failed="ab")
    directory = DataDirectory(tmp_path)
    largest = bounding_diagonal(directory.collection(SURFACES).view("c")["meshes/vertices"])
    assert median_diagonal(directory) == largest


@pytest.mark.parametrize("manifest", ["weights", "hand-sized-test"])  # one with objects to test on that are not installed
def test_rows_name_the_test_objects_that_the_network_has_learned_from(data, tmp_path, monkeypatch, manifest):
    ship(monkeypatch, data)
    card = read_card(DEFAULT).model_copy(update={"learned_from": {manifest: 1}})
    monkeypatch.setattr("stages.evaluate.scores.read_card", lambda _: card)
    copy = Path(shutil.copytree(data, tmp_path / "data"))
    (given,) = (stage for stage in spheres.stages() if stage.output is SURFACES)
    learned = next(item for item in load_manifest(manifest.removesuffix("-test")).objects(None) if item.split == "train")
    sources = {name: f"procedural bottle {name}, seed 9" for name in "abcd"} | {"b": identity(learned.source)}
    asked: Any = Request(given, Settings(), "balls", OBJECTS, "draft", 1, copy)
    pack(asked, lambda unit: given.row(unit) | {"source_file": np.array(sources[unit.name]), "source_sha256": np.array("")})
    assert learned_objects(DataDirectory(copy), DEFAULT) == ("b",)
    assert "shipped-…: the pretrained network implicit-any, given the first grasp of each object alone." in vt("report", data, "--no-pages")


def test_a_dataset_without_test_objects_has_a_report_without_shipped_rows(tmp_path, monkeypatch):
    spheres.make_data(tmp_path, 2, ("train",))
    ship(monkeypatch, tmp_path)
    printed = vt("report", tmp_path, "--shipped", "--no-pages")
    assert "the pretrained network is not measured: the dataset has no test objects (`splits` of its manifest)" in printed


def test_the_summary_keeps_a_network_whose_own_meshes_were_scored_under_its_name(tmp_path):
    spheres.make_data(tmp_path, 4, SPLITS)
    spheres.make_model(tmp_path, "touch")
    spheres.run_stage(tmp_path, "evaluate", OBJECTS, "points=300", "grasps=[1]", "configurations=[touch]", seed=3)
    folder = DataDirectory(tmp_path).verified_folder("evaluation")
    scored = Path(shutil.copytree(folder, tmp_path / "scored"))
    root = json.loads((scored / "metrics.json").read_text())
    (scored / "metrics.json").write_text(json.dumps(root | {"settings": root["settings"] | {"method": "touch"}}))
    found = summarise(folder, [scored])
    assert found is not None
    assert list(found.errors) == [DEFAULT_SERIES]
    assert list(found.errors[DEFAULT_SERIES]) == ["touch"]


def test_the_summary_has_three_sentences_and_a_line_of_retrieval(data):
    directory = DataDirectory(data)
    found = summarise(directory.verified_folder("evaluation"), [directory.verified_folder("scores/shipped")])
    assert found is not None
    assert set(found.errors) == {DEFAULT, "shipped"}
    assert list(found.errors["shipped"]) == list(WAYS)
    figures = read_figures(directory.verified_folder("evaluation"))
    touch = figures[f"{DEFAULT}-touch"].per_case("mean_distance")[:, 0].mean()  # of the first grasp, as the pretrained network
    assert found.errors[DEFAULT]["touch"].mean == pytest.approx(1e3 * touch)
    assert found.retrieved["touch"] == pytest.approx(1e3 * figures["training object, by touch"].per_object("mean_distance").mean())
    assert found.retrieved["occluded"] == found.retrieved["unoccluded"]  # both by silhouette
    assert len(found.sentences) == 3
    assert "2 test objects" in found.sentences[0]
    assert "mm with touch alone" in found.sentences[1]
    assert " of 7 networks are nearer than one of 2 training objects" in found.sentences[2]


def test_rows_that_stand_together_are_of_the_same_grasps(data):
    folders = [DataDirectory(data).verified_folder(name) for name in ("evaluation", "scores/shipped")]
    (row,) = (row for row in accuracy(folders).rows if row.cells[0] == f"{DEFAULT}-touch")
    own = read_figures(folders[0])[f"{DEFAULT}-touch"]
    assert row.cells[1].mean == pytest.approx(1e3 * own.per_case("mean_distance")[:, 0].mean())
    (alone,) = (row for row in accuracy(folders[:1]).rows if row.cells[0] == f"{DEFAULT}-touch")
    assert alone.cells[1].mean == pytest.approx(1e3 * own.per_object("mean_distance").mean())
    (together,) = (row for row in accuracy(folders).rows if row.cells[0] == "shipped-touch")
    assert row.cells[1:] == together.cells[1:], "the weights are the same, so are the intervals"
    remarks = [table.title for table in evaluation_tables(folders[0], folders[1:]) if not table.columns]
    assert "All networks and methods with first grasp 0 only, which each of them has." in remarks


def accuracy(folders: list[Path]) -> Table:
    return next(table for table in evaluation_tables(folders[0], folders[1:]) if table.title.startswith("Accuracy"))


def test_scores_take_the_settings_of_the_first_evaluation_whatever_its_seed(data, tmp_path):
    copy = shutil.copytree(data, tmp_path / "data")
    (copy / "evaluation.json").rename(copy / "evaluation-seed-1.json")
    assert measuring_settings(DataDirectory(copy))["points"] == 300


def test_method_that_is_called_as_a_graph_network_is_not_in_the_summary(data, tmp_path):
    directory = DataDirectory(shutil.copytree(data, tmp_path / "data"))
    tested = read_figures(directory.verified_folder("evaluation"))[f"{DEFAULT}-touch"].object_ids
    for name in ("touch", "mine-touch"):
        (tmp_path / name).mkdir()
        for object_id in tested:
            trimesh.creation.icosphere(2, 0.1).apply_translation(spheres.CENTRE).export(tmp_path / name / f"{object_id}.ply")
        vt("score", tmp_path / name, directory.root, "--misplaced")
    scored = [directory.verified_folder(f"scores/{name}") for name in ("touch", "mine-touch")]
    assert summarise(scored[0], []) is None
    summary = summarise(scored[0], scored[1:])
    assert summary is not None
    assert set(summary.errors) == {"mine"}


def test_summary_places_a_method_by_name_only_if_its_inputs_match():
    by_network, scored = {"image": "occluded", "touch": True}, {"image": None, "touch": True}  # of a scored method no image is known
    assert _ways({"occluded-touch": by_network, "mine-touch": scored, "mine-occluded-touch": scored, "mine": scored, "none": scored}) == {
        "occluded-touch": "occluded-touch",
        "mine-touch": "touch",
    }


def test_results_begin_with_the_summary_and_tables_are_folded(data, monkeypatch):
    monkeypatch.setattr("pipeline.contrib.report.html_report.draw_figures", lambda *_: [])
    monkeypatch.setattr("pipeline.contrib.report.html_report.overview_panels", lambda *_: [])
    monkeypatch.setattr("pipeline.contrib.report.html_report.trained_models", lambda *_: {})  # the balls' network has no losses
    vt("report", data)
    page = (data / "report" / "results.html").read_text()
    assert page.index("Networks reconstructed 2") < page.index("figures/errors.svg") < page.index("<details>") < page.index("<table")
    assert page.count("<details>") == page.count("<table") > 5
    assert "<caption>" not in page
    assert "retrieved in its place" in (data / "report" / "figures" / "errors.svg").read_text()
