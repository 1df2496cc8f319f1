import io
import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from rich.console import Console

from pipeline.console import show_tables
from pipeline.contrib.report.orderings import Verdict, orderings, orderings_table
from pipeline.contrib.report.results import trainings_table
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.make import plans
from pipeline.engine.plan import Request
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError, StoreError
from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.geometry.mesh import sample_triangles
from pipeline.kernels.metrics.bootstrap import Interval
from pipeline.kernels.metrics.cloud_distances import cloud_distances, sampled_area, sampling_floor
from pipeline.models.observation import stored_observation
from pipeline.models.reconstruction import DeformationReconstructor, Reconstructor
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory, shard_of
from pipeline.tables.comparison import read_values
from pipeline.tables.evaluation_tables import evaluation_tables
from stages.evaluate.baselines import BASELINE_PREFIX
from stages.evaluate.evaluation_files import (
    TABLES_ZARR,
    Figures,
    evaluations,
    read_figures,
    read_root,
    read_surfaces,
    read_table,
    write_evaluation,
)
from stages.evaluate.measure import Network, make_cases
from stages.evaluate.protocols import GraspProtocol
from stages.evaluate.stage import MEASURED, Evaluate, EvaluationSettings
from tests.stages import ball_dataset as spheres

COUNT = 3
SETTINGS = {"points": 500}
CONFIGURATIONS = ("none", "touch", "occluded", "occluded-touch", "unoccluded", "unoccluded-touch")


def request(data: Path, **settings: Any) -> Request[Any]:
    chosen = EvaluationSettings(**(SETTINGS | settings))
    return Request(stage=Evaluate(), settings=chosen, manifest="balls", objects=spheres.objects(COUNT), preset="draft", seed=0, data=data)


def evaluate(data: Path, place: str = "evaluation", **settings: Any) -> tuple[Path, str]:
    (plan,) = plans(replace(request(data, **settings), folder=place))
    console = Console(file=io.StringIO(), record=True, width=200)
    plan.make(console)
    folder = plan.directory.folder_path(plan.units[0].name)
    show_tables(evaluation_tables(folder), console)
    return folder, console.export_text()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, COUNT)
    for name in CONFIGURATIONS:
        spheres.make_model(folder, name, still=name == "none")
    return folder


@pytest.fixture(scope="module")
def evaluation(data):
    return evaluate(data)


def protocol_of(data: Path, *names: str) -> GraspProtocol:
    networks = [Network(name, DeformationReconstructor(DataDirectory(data).verified_folder(f"models/gcn/{name}"))) for name in names]
    return GraspProtocol(DatasetJob(data, data, EvaluationSettings(points=500), 0, {}, Console(), "evaluation"), networks)


def figures(folder: Path, network: str) -> Figures:
    return read_figures(folder)[network]


def flat_radius(radius: float) -> float:
    """How far the flat faces of the undeformed sphere around the box of a ball are from its centre, on average over their area, m."""
    sphere = vision_charts(0)
    triangles = np.sqrt(3) * radius * sphere.vertices[sphere.faces]
    points, _ = sample_triangles(triangles, 20_000, np.random.default_rng(0))
    return float(np.linalg.norm(points, axis=1).mean())


def test_cases_contain_each_different_input_once():
    numbers = (1, 2, 3, 4, 5)
    assert [case.firsts for case in make_cases(5, numbers, touch=False, occluded=False)] == [(0, 1, 2, 3, 4)]
    assert [(case.first, case.grasps) for case in make_cases(5, numbers, touch=False, occluded=True)] == [(g, ()) for g in range(5)]
    felt = make_cases(5, numbers, touch=True, occluded=False)
    assert len(felt) == 4 * 5 + 1
    assert len({frozenset(case.grasps) for case in felt}) == len(felt)
    assert len(make_cases(5, numbers, touch=True, occluded=True)) == 25
    for cases in (felt, make_cases(5, numbers, touch=True, occluded=True)):
        filled = sorted((first, case.grasp_count) for case in cases for first in case.firsts)
        assert filled == [(first, given) for first in range(5) for given in numbers]
        assert all(case.grasps[0] == case.first and len(set(case.grasps)) == len(case.grasps) for case in cases)


def test_undeformed_sphere_has_the_chamfer_distance_of_two_spheres(evaluation):
    values = figures(evaluation[0], "none")
    objects = read_table(evaluation[0], "objects")
    assert values.per_case("chamfer").shape == (COUNT, 5)
    rings = [values.ring(number) for number in values.rings]
    for row, radius in enumerate((0.1, 0.12, 0.14)):
        assert values.per_case("chamfer")[row, 0] == pytest.approx(2 * (flat_radius(radius) - radius) ** 2, rel=0.05)
        means = [means[row] for means, sites in rings if sites[row]]
        assert np.mean(means) == pytest.approx((flat_radius(radius) - radius) ** 2, rel=0.1)
        assert objects["area"][row] == pytest.approx(4 * np.pi * radius**2, rel=0.15)
        assert objects["floor"][row] == pytest.approx(2 * objects["area"][row] / (np.pi * 500))
        assert objects["diagonal"][row] == pytest.approx(2 * np.sqrt(3) * radius, rel=0.01)
        apart = flat_radius(radius) - radius
        assert values.per_object("mean_distance")[row] == pytest.approx(apart, rel=0.05)
    assert (values.per_case("chamfer") == values.per_case("chamfer")[:, :1]).all()


def test_repeated_grasps_that_are_measured_again_are_named(data, monkeypatch, capsys):
    monkeypatch.setattr("stages.evaluate.protocols.grasp_counts", lambda grasps, names: dict.fromkeys(names, 5) | {names[1]: 2})
    name = protocol_of(data, "none").objects.object_ids[1]
    printed = " ".join(capsys.readouterr().out.split())
    assert f"warning: grasps of 1 object that read-grasps repeated ({name}) count again in all figures; read-grasps.grasps=2" in printed


@pytest.mark.parametrize(("apart", "expected"), [(0.002, (1, 1)), (0.004, (1, 0)), (0.02, (0, 0))])
def test_f_scores_count_points_within_their_distance(data, apart, expected):
    """Shells of a ball of radius 0.1 m, of diagonal 0.346 m: 1 % of it is 3.5 mm."""
    protocol = protocol_of(data, "none")
    name = protocol.objects.object_ids[0]
    directions = protocol.objects.points(name) - spheres.CENTRE
    shell = spheres.CENTRE + directions * (1 + apart / 0.1)
    measured = protocol.distance_figures(cloud_distances(shell, protocol.objects.points(name)), name)
    assert (measured["f_5mm"], measured["f_1percent"]) == expected
    assert measured["mean_distance"] == pytest.approx(apart, rel=1e-3)


def test_surface_quality_of_a_sphere_equals_closed_forms(evaluation):
    values = figures(evaluation[0], "none")
    assert values.available("area_ratio") == pytest.approx([(flat_radius(radius) / radius) ** 2 for radius in (0.1, 0.12, 0.14)], rel=0.15)
    assert (values.available("dihedral") < 15).all()
    assert values.available("seam_gap") == pytest.approx([0.0] * COUNT)
    assert values.available("spike") == pytest.approx([(np.sqrt(3) - 1) * radius for radius in (0.1, 0.12, 0.14)], abs=0.01)
    assert (values.available("normal_consistency") > 0.95).all()
    assert (values.available("crossing") == 0).all()
    assert f"{1000 * values.available('spike').mean():.3g} / {1000 * np.median(values.available('spike')):.3g}" in evaluation[1]
    moved = figures(evaluation[0], "occluded")
    assert (moved.available("seam_gap") > 0).all()
    assert (moved.available("dihedral") > values.available("dihedral")).all()


def test_closed_meshes_are_measured_on_request(data, evaluation):
    assert not len(figures(evaluation[0], "none").available("watertight"))
    names = ("none", "touch")
    folder, printed = evaluate(data, "shut", configurations=names, grasps=(1, 7), closed_resolution=64)
    assert "evaluate.grasps: 7 skipped: the dataset holds 5 grasps of each object" in printed
    assert list(read_root(folder)["configurations"]) == [*names]
    for name in names:
        assert figures(folder, name).available("watertight").tolist() == [1] * COUNT
    still, moved = (figures(folder, name).available("iou") for name in names)
    assert still == pytest.approx([3**-1.5] * COUNT, abs=0.02)  # balls in larger ones
    for shared in (still, moved):
        assert f"{shared.mean():.3f} / {np.median(shared):.3f}" in printed
    assert "intersection over union" in printed
    assert figures(folder, "none").available("spike").tolist() == figures(evaluation[0], "none").available("spike").tolist()


def test_retrieval_baselines_return_training_objects(tmp_path, monkeypatch):
    balls = {"a": "train", "b": "test", "c": "test", "d": "train", "e": "test"}  # of radius 0.1, 0.12, …
    spheres.make_data(tmp_path, len(balls), ("train", "test", "test"))
    for name in ("unoccluded", "touch"):
        spheres.make_model(tmp_path, name)
    protocol = protocol_of(tmp_path, "unoccluded", "touch")
    objects = protocol.objects
    assert objects.object_ids == [name for name, split in balls.items() if split == "test"]
    floors = [sampling_floor(sampled_area(objects.points(name)), objects.count) for name in objects.object_ids]
    scaled = {name.removeprefix(BASELINE_PREFIX): one.per_object("chamfer") for name, one in protocol.baselines().items()}
    for how, distances in scaled.items():  # every ball, scaled to the size of the one in question, is that one
        assert distances == pytest.approx(floors, rel=0.2), how
    monkeypatch.setattr(ObjectRows, "diagonal", lambda *_: 0.5)  # as if the balls had one size
    found = {name.removeprefix(BASELINE_PREFIX): one.per_object("chamfer") for name, one in protocol.baselines().items()}
    for how, apart in {"by truth": 0.02, "by touch": 0.02, "by silhouette": 0.02}.items():
        assert found[how] == pytest.approx([2 * apart**2 + floor for floor in floors], rel=0.2), how
    whole = protocol.baselines()
    monkeypatch.setattr("stages.evaluate.baselines.BLOCK", 1)  # as if there were many training objects
    assert {how: one.rows for how, one in protocol.baselines().items()} == {how: one.rows for how, one in whole.items()}
    assert found["typical"] == pytest.approx(
        [2 * apart**2 + floor for apart, floor in zip((0.02, 0.04, 0.08), floors, strict=True)], rel=0.2
    )


def test_objects_without_images_are_not_retrieved_by_silhouette(tmp_path):
    alone = next(shards for shards in itertools.count(2) if [shard_of(name, shards) for name in "abcde"].count(shard_of("a", shards)) == 1)
    spheres.make_data(tmp_path, 5, ("train", "test"), ungrasped="a", shards=alone)  # a shard without a row that came through has no sizes
    spheres.make_model(tmp_path, "unoccluded")
    assert f"{BASELINE_PREFIX}by silhouette" in protocol_of(tmp_path, "unoccluded").baselines()


def test_figure_equals_that_of_a_separate_reconstruction(data, evaluation):
    folder, _ = evaluation
    prediction, values = read_table(folder, "predictions/occluded-touch"), figures(folder, "occluded-touch")
    model = DeformationReconstructor(DataDirectory(data).folder_path("models/gcn/occluded-touch"))
    rows = ObjectRows(data, ["points", "occluded", "projection", "vertices", "stop_rule"], "test")
    row, grasps = 1, [4, 0]
    name = rows.object_ids[row]
    made = model.reconstruct([stored_observation(rows, name, grasps, model.config)])[0]
    case = int(np.flatnonzero((prediction["first_grasp"] == 4) & (prediction["grasps_given"] == 2))[0])
    np.testing.assert_allclose(prediction["vertices"][row, case], made.vertices[: made.vision], atol=1e-6)
    dense = made.vertices[made.faces].mean(axis=1)  # face centres: another sampling of the same surface
    assert cloud_distances(dense, rows.read("points", name)).predicted.mean() < values.per_case("chamfer", 2)[row, 4]


def test_evaluation_has_every_table(evaluation):
    folder, printed = evaluation
    assert {path.name for path in folder.iterdir()} == {"tables.zarr", "metrics.json"}
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["means"]["touch"]["chamfer"]["2"] == pytest.approx(figures(folder, "touch").per_case("chamfer", 2).mean())
    assert metrics["configurations"]["occluded"] == {"image": "occluded", "touch": False}
    tables = {table.title.partition(":")[0]: table for table in evaluation_tables(folder) if table.columns}
    accuracy = tables["Accuracy with one grasp"]
    assert next(iter(tables)) == "Accuracy with one grasp"
    shown = ["mean distance, mm", "F-score at 5 mm, %", "F-score at 1 % of the diagonal, %", "Chamfer × 9000, m²", "normals agree, %"]
    assert accuracy.columns == ["model", *shown, "intersection over union"]
    still = figures(folder, "none")
    expected = {1: 1e3 * still.per_object("mean_distance"), 4: 9000 * still.per_object("chamfer")}
    expected[5] = 100 * still.available("normal_consistency")
    for column, values in expected.items():
        assert accuracy.rows[0].cells[column].mean == pytest.approx(values.mean())
    assert [row.cells[0] for row in accuracy.rows] == [*CONFIGURATIONS, "best value that sampling allows"]
    assert {"Table 2", "Table 3", "Modalities"} <= tables.keys()
    assert tables["Modalities"].columns == ["model", "bottle (2)", "knife (1)", "all (3)", "all, m²"]
    rows = {row.cells[0]: row.cells[1:] for row in tables["Table 3"].rows if not row.cells[0].startswith("  Smith")}
    smallest = rows.pop("what sampling alone gives")
    assert smallest[0] == pytest.approx(9000 * read_table(folder, "objects")["floor"].mean())
    assert list(rows) == ["touch", "occluded-touch", "unoccluded-touch"]
    assert all(cell.low <= cell.mean <= cell.high for row in rows.values() for cell in row)
    (felt,) = (row.cells for row in tables["Modalities"].rows if row.cells[0] == "touch")
    assert felt[3] == rows["touch"][0]
    assert felt[3].mean == pytest.approx(9000 * figures(folder, "touch").per_case("chamfer").mean())
    for words in ("Table 2", "Table 3", "6.687e-05", "1.769", "sampling allows", "F1", "RMS residual", "500 points"):
        assert words in printed


def test_figures_of_the_paper_are_left_out_if_objects_keep_their_sizes(evaluation, tmp_path):
    folder = shutil.copytree(evaluation[0], tmp_path / "evaluation")
    printed = " ".join(title_and_cells(folder))
    assert "6.687e-05" in printed
    assert "other objects, scaled to 0.5 m as these are" in printed
    assert any(one.supplement for one in orderings([folder]))
    zarr.open_group(folder / TABLES_ZARR).attrs["paper_sizes"] = False
    printed = " ".join(title_and_cells(folder))
    assert "6.687e-05" not in printed
    assert "diagonals of these objects are 346 to 485 mm; Smith et al. 2020 scaled its objects to 500 mm" in printed
    verdicts = orderings([folder])
    assert not any(one.supplement for one in verdicts)
    assert "Smith et al. 2020" not in orderings_table(verdicts)[0].columns


def title_and_cells(folder: Path) -> list[str]:
    tables = evaluation_tables(folder)
    return [text for table in tables for text in (table.title, *table.columns, *(cell for row in table.rows for cell in table.text(row)))]


def test_rings_are_measured_around_touches_only(evaluation):
    values = figures(evaluation[0], "touch")
    rows = [figure for figure in values.rows if figure.metric.startswith("local_chamfer_")]
    assert {figure.object_id for figure in rows} == set(values.object_ids)
    for number in values.rings:
        sites = [(figure.object_id, figure.first) for figure in rows if figure.metric == f"local_chamfer_{number}"]
        assert max(map(sites.count, sites)) < spheres.SENSORS  # one of them does not touch
        assert len(sites) == values.ring(number)[1].sum() <= COUNT * 15


def test_evaluation_repeats_to_the_bit_and_depends_on_the_seed(data):
    first, again = (evaluate(data, place, configurations=("none", "occluded"))[0] for place in ("first", "again"))
    assert hashes_of(again) == hashes_of(first)
    by_seven = figures(evaluate(data, "by-seven", batch_size=7, configurations=("occluded",))[0], "occluded")
    np.testing.assert_allclose(by_seven.per_case("chamfer"), figures(again, "occluded").per_case("chamfer"), rtol=1e-5)
    spheres.run_stage(data, "evaluate", spheres.objects(COUNT), "points=500", "configurations=[none]", seed=1, folder="other")
    other = figures(DataDirectory(data).folder_path("other"), "none")
    assert (other.per_case("chamfer") != figures(again, "none").per_case("chamfer")).all()


def test_evaluation_of_first_grasps_has_the_figures_of_these(data, evaluation):
    folder, printed = evaluate(data, "first-only", configurations=("touch", "occluded-touch"), first_only=True)
    for name, number in itertools.product(("touch", "occluded-touch"), (1, 3)):
        own, all_of_them = (figures(of, name).per_case("chamfer", number) for of in (folder, evaluation[0]))
        assert own.shape == (COUNT, 1) < all_of_them.shape
        np.testing.assert_allclose(own[:, 0], all_of_them[:, 0], rtol=1e-5)
    assert "occluded-touch" in printed


def test_killed_run_resumes_with_the_next_configuration(data, evaluation, monkeypatch):
    reconstructed: list[str] = []
    genuine = Reconstructor.reconstruct

    def counted(self, views):
        reconstructed.append(self.trained.configuration)
        if reconstructed.count("occluded") == 1 and self.trained.configuration == "occluded" and len(set(reconstructed)) == 2:
            raise KeyboardInterrupt
        return genuine(self, views)

    monkeypatch.setattr(Reconstructor, "reconstruct", counted)
    with pytest.raises(KeyboardInterrupt):
        evaluate(data, "killed", configurations=("none", "occluded"))
    (plan,) = plans(replace(request(data, configurations=("none", "occluded")), folder="killed"))
    work = plan.directory.work("killed") / plan.key[:16]
    assert [path.name for path in (work / MEASURED / "rows").iterdir()] == ["none"]
    reconstructed.clear()
    folder, _ = evaluate(data, "killed", configurations=("none", "occluded"))
    assert set(reconstructed) == {"occluded"}
    assert not (folder / MEASURED).exists()
    for name in ("none", "occluded"):
        assert figures(folder, name).rows == figures(evaluation[0], name).rows
        vertices, expected_vertices = (read_surfaces(path, name)["vertices"] for path in (folder, evaluation[0]))
        np.testing.assert_array_equal(vertices, expected_vertices)


def test_models_without_touch_need_no_touches_and_models_without_images_no_images():
    stage = Evaluate()
    names = {artifact.name for artifact in stage.inputs(EvaluationSettings(configurations=("none",)))}
    assert names == {"surfaces", "grasps"}
    assert {artifact.name for artifact in stage.inputs(EvaluationSettings(configurations=("touch",)))} == names | {"touch", "charts"}
    assert {artifact.name for artifact in stage.inputs(EvaluationSettings(configurations=("occluded",)))} == names | {"vision"}


def test_networks_without_touch_are_evaluated_without_touch_artifacts(data, evaluation, tmp_path):
    bare = shutil.copytree(data, tmp_path / "bare", ignore=shutil.ignore_patterns("touch", "charts", "evaluation*"))
    folder, printed = evaluate(bare, configurations=("none", "occluded"))
    assert BASELINE_PREFIX + "by touch" not in read_figures(folder)
    for name in ("none", "occluded"):
        assert figures(folder, name).rows == figures(evaluation[0], name).rows  # the rings around touch sites too
    assert "Table 3:" not in printed
    with pytest.raises(StoreError, match="no group charts"):
        read_table(folder, "charts")


def test_orderings_report_each_claim_of_an_evaluation(evaluation):
    verdicts = orderings([evaluation[0]])
    assert verdicts == orderings([evaluation[0]])
    assert not orderings_table([]), "no claim makes no table"
    claims = {one.claim: one for one in verdicts}
    assert {"occluded-touch < occluded", "unoccluded < touch", "touch: 2 grasps < 1", "occluded: ring ×5 < ring ×1"} <= set(claims)
    assert claims["unoccluded-touch: 4 grasps < 3"].supplement == (0.695, 0.689)
    one = claims["touch: 5 grasps < 1"]
    assert one.difference.mean == pytest.approx(one.smaller - one.larger)
    assert one.difference.count == COUNT
    console = Console(record=True, width=200)
    show_tables(orderings_table(verdicts), console)
    printed = console.export_text()
    assert "not there either" in printed
    assert f"of {len(verdicts)}" in printed


def test_implicit_networks_have_the_orderings_of_chart_networks(evaluation, monkeypatch):
    values = {f"implicit-{name}": entry for name, entry in read_values([evaluation[0]]).items() if name != "none"}
    monkeypatch.setattr("pipeline.contrib.report.orderings.read_values", lambda folders: values)
    verdicts = {one.claim: one for one in orderings([evaluation[0]])}
    monkeypatch.undo()
    assert {
        "implicit-occluded-touch < implicit-occluded",
        "implicit-touch: 2 grasps < 1",
        "ring ×1: implicit-occluded-touch < implicit-occluded",
    } <= verdicts.keys()
    same = {one.claim: one for one in orderings([evaluation[0]])}["occluded-touch < occluded"]
    assert verdicts["implicit-occluded-touch < implicit-occluded"].difference.mean == same.difference.mean


@pytest.mark.parametrize(
    ("low", "high", "count", "answer"),
    [
        (-2, -1, 6, "holds"),
        (1, 2, 6, "does not hold"),
        (-1, 1, 60, "undecided"),
        (-2, -1, 5, "undecided"),
        (-np.inf, np.inf, 1, "undecided"),
    ],
)
def test_verdict_needs_a_one_sided_interval_and_enough_objects(low, high, count, answer):
    assert Verdict("a < b", 1.0, 2.0, Interval(-1.0, low, high, count)).answer == answer


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"points": 3000}, StageError, "2000 points"),
        ({"configurations": ("single-image",)}, ValueError, "single-image; choose from none, touch"),
        ({"grasps": (2, 3)}, ValueError, "include 1"),
        ({"accelerator": "abacus"}, ValueError, "abacus"),
        ({"closed_resolution": 63}, ValueError, "greater than or equal to 64"),
    ],
)
def test_invalid_evaluation_settings_give_an_error(data, settings, error, words):
    with pytest.raises(error, match=words):
        evaluate(data, "wrong", **settings)


def test_trainings_that_differ_by_seed_are_evaluated_apart_and_shown_together(tmp_path):
    balls = tmp_path / "balls"
    spheres.make_data(balls, 4, ("train", "test", "test", "test"))
    console = Console(record=True, width=250)
    for seed in (0, 1):
        for name in ("none", "touch"):
            spheres.make_model(balls, name, training_seed=seed)
        base_request = request(balls, configurations=("none", "touch"), grasps=(1, 2), training_seed=seed)
        (plan,) = plans(replace(base_request, objects=spheres.objects(4, ("train", "test", "test", "test"))))
        plan.make(console)
    directory = DataDirectory(balls)
    (balls / "evaluation-single-image.json").write_text("{}")  # another experiment's
    assert evaluations(directory) == ["evaluation", "evaluation-seed-1"]
    folders = [directory.verified_folder(name) for name in evaluations(directory)]
    means = [9000 * values.per_case("chamfer").mean() for values in read_values(folders)["none"].values()]
    assert means[0] != means[1]
    show_tables(trainings_table(folders), console)
    printed = console.export_text()
    assert "2 trainings of each network" in printed
    assert ", ".join(f"{mean:.2f}" for mean in means) in printed
    assert f"{np.mean(means):.3f}" in printed
    (claim,) = (one for one in orderings(folders) if one.claim == "touch < none")
    assert claim.larger == pytest.approx(np.mean(means))
    assert {"evaluation", "evaluation-seed-1"} <= set(directory.folders())
    fewer = zarr.open_group(folders[1] / TABLES_ZARR).attrs
    listed = fewer["configurations"]
    fewer["configurations"] = {"touch": listed["touch"]}
    (claim,) = (one for one in orderings(folders) if one.claim == "touch < none")  # two trainings against one
    assert claim.larger == pytest.approx(means[0])
    fewer["configurations"] = listed
    attributes = zarr.open_group(folders[1] / TABLES_ZARR).attrs
    settings = attributes["settings"]
    attributes["settings"] = settings | {"grasps": [1, 5]}
    with pytest.raises(StoreError, match=r"seed-1-\w+ was made with grasps=\[1, 5\], not \[1, 2\]"):
        read_values(folders)
    attributes["settings"] = {name: value for name, value in settings.items() if name != "rings"}  # as of another version
    for pair in (folders, folders[::-1]):
        with pytest.raises(StoreError, match="with rings="):
            read_values(pair)
    attributes["settings"] = settings
    zarr.open_group(folders[1] / TABLES_ZARR)["objects/object_id"][0] = "another"
    with pytest.raises(StoreError, match="was made with other objects"):
        read_values(folders)


def test_missing_evaluation_is_an_error(tmp_path):
    with pytest.raises(StoreError, match="run evaluate"):
        orderings([tmp_path])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"more": [1.0]}, "its schema declares"),
        ({"area": [1.0, 2.0]}, r"objects/area has shape \(2,\)"),
        ({"floor": [np.nan]}, "objects/floor holds NaN"),
        ({"floor": [np.inf]}, "objects/floor holds NaN or infinity"),
    ],
)
def test_tables_that_violate_their_schema_are_not_written(tmp_path, change, words):
    objects = {"object_id": ["a"], "category": ["ball"], "diagonal": [0.5], "area": [1.0], "floor": [0.5]}
    write_evaluation(tmp_path, {"objects": objects}, {})
    assert read_table(tmp_path, "objects")["floor"] == 0.5
    with pytest.raises(StoreError, match=words):
        write_evaluation(tmp_path, {"objects": objects | change}, {})


def test_evaluation_that_violates_its_schema_is_refused(evaluation, tmp_path):
    folder = shutil.copytree(evaluation[0], tmp_path / "evaluation")
    root = zarr.open_group(str(folder / TABLES_ZARR), mode="r+")
    root["objects"].create_array("floor", shape=(COUNT + 1,), dtype="float64", overwrite=True)[...] = 1
    with pytest.raises(StoreError, match=r"objects/.* has shape"):
        read_table(folder, "objects")
    root["objects"].create_array("floor", shape=(COUNT,), dtype="string", overwrite=True)[...] = "low"
    with pytest.raises(StoreError, match="an array of objects has another type"):
        read_table(folder, "objects")
    root["objects"].create_array("floor", shape=(COUNT,), dtype="float64", overwrite=True)[...] = 1
    root.attrs["configurations"] = {"moon": {"touch": True}}
    with pytest.raises(StoreError, match="has no figures of moon"):
        read_values([folder])
