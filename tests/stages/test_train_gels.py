"""`implicit-gels`: trained and evaluated on depth maps of any sensor, without touch charts."""

import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from pipeline.errors import StoreError
from pipeline.kernels.geometry.mesh_cleaning import bounding_diagonal
from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.models.families import load_reconstructor
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from pipeline.store.directory import DataDirectory
from pipeline.training.items import Items
from stages.evaluate.evaluation_files import read_figures
from stages.registry import resolve
from stages.train_implicit import ImplicitLearner, TrainImplicit
from tests.stages import ball_dataset as spheres

NAME = "implicit-gels"
SPLITS = ("train", "valid", "test")
SETTINGS = (
    *(f"train-implicit.configuration={NAME}", "train-implicit.features=16", "train-implicit.blocks=1", "train-implicit.epochs=1"),
    *("train-implicit.queries=50", "train-implicit.validation_queries=50", "train-implicit.encoder_width=0.125"),
    *("train-implicit.spacing=0.04", f"evaluate.configurations=[{NAME}-touch]", "evaluate.points=200", "evaluate.grasps=[1]"),
)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("balls")
    spheres.make_data(made, 3, SPLITS)
    folder = Path(shutil.copytree(made, tmp_path_factory.mktemp("bare") / "data", ignore=shutil.ignore_patterns("charts")))
    for stage in ("train-implicit", "evaluate"):
        spheres.run_stage(folder, stage, spheres.objects(3, SPLITS), *SETTINGS)
    return folder


def test_items_hold_points_of_gels_with_their_width_beside_the_object(data):
    items = Items(data, "train", resolve("train-implicit", "draft", SETTINGS).inputs, 2, learned=TrainImplicit.arrays)
    seen = items.fixed_view(1, 2, 2).scaled(spheres.CENTRE)  # of touches alone
    assert len(seen.touches) == 2 * spheres.SENSORS
    assert [touch.touched for touch in seen.touches] == [sensor != grasp for grasp in (1, 0) for sensor in range(4)]
    scale = 0.5 / items.rows.diagonal("a")
    assert {round(touch.width, 6) for touch in seen.touches} == {round(scale * spheres.SENSOR.width, 6)}
    points = np.concatenate([touch.points for touch in seen.touches])
    np.testing.assert_allclose(np.linalg.norm(points - spheres.CENTRE, axis=1), 0.1 * scale, atol=2e-4)


def test_touches_of_a_grasp_are_found_once(data):
    items = Items(data, "train", resolve("train-implicit", "draft", SETTINGS).inputs, 2, learned=TrainImplicit.arrays)
    first, again = (items.fixed_view(1, 2, 2).touches for _ in range(2))
    assert all(one is other for one, other in zip(first, again, strict=True))


def test_items_can_be_sent_to_the_processes_of_a_training(data):
    items = Items(data, "train", resolve("train-implicit", "draft", SETTINGS).inputs, 2, learned=TrainImplicit.arrays)
    sent = pickle.loads(pickle.dumps(items)).fixed_view(1, 2, 2).touches
    for one, other in zip(items.fixed_view(1, 2, 2).touches, sent, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def test_points_to_learn_at_can_be_drawn_near_touches(data):
    resolved = resolve("train-implicit", "draft", (*SETTINGS, "train-implicit.near_touches=0.6"))
    items = Items(data, "train", resolved.inputs, 2, learned=TrainImplicit.arrays)
    learner = ImplicitLearner(ImplicitNetwork(resolved.network(5)), items, items, resolved, seed=0)
    observations = [items.fixed_view(1, 2, 2)]
    queries, distances = learner.targets(items, [1], observations, [torch.Generator().manual_seed(2)], validates=False)
    middles = np.array([touch.points.mean(axis=0) for touch in observations[0].scaled(spheres.CENTRE).touches if touch.touched])
    points = items.scaled(items.rows.read("query_points", "a"), "a")
    limit = np.quantile(cKDTree(middles).query(points)[0], 1 / 16)
    near = cKDTree(middles).query(queries[0].numpy())[0] <= 1.001 * limit
    assert near[:30].all()  # of 50
    assert not near[30:].all()
    expected = items.scale("a") * items.rows.read("signed_distance", "a")[cKDTree(points).query(queries[0].numpy())[1]]
    np.testing.assert_allclose(distances[0].numpy(), expected, rtol=1e-5)


def test_objects_face_any_way_in_training_with_their_touches_and_cameras(data):
    resolved = resolve("train-implicit", "draft", (*SETTINGS, "train-implicit.near_touches=1.0", "train-implicit.dropped_grasps=0.0"))
    items = Items(data, "train", resolved.inputs, 2, learned=TrainImplicit.arrays)
    learner = ImplicitLearner(ImplicitNetwork(resolved.network(5)), items, items, resolved, seed=0)
    batch = learner.read([0, 1, 0], [torch.Generator().manual_seed(seed) for seed in range(3)])
    assert len({seen.turn for seen in batch.observations}) == 3
    points = items.scaled(items.rows.read("query_points", "a"), "a")
    for seen, queries in zip(batch.observations, batch.targets[0], strict=True):
        as_it_is, turned = (
            cKDTree([touch.points.mean(axis=0) for touch in view.scaled(spheres.CENTRE).touches if touch.touched])
            for view in (replace(seen, turn=0.0), seen)
        )
        limit = np.quantile(as_it_is.query(points)[0], 1 / 16)
        assert turned.query(queries.numpy())[0].max() < 1.001 * limit


def test_model_states_the_gels_that_it_learned_from_and_no_charts(data):
    trained = load_reconstructor(NAME, DataDirectory(data).verified_folder(f"models/implicit/{NAME}")).trained
    assert trained.charts is None
    sphere = spheres.surfaces(spheres.Unit(name="a"))["meshes/vertices"]
    assert trained.gels == pytest.approx([spheres.SENSOR.width / bounding_diagonal(sphere)] * 2)


def test_it_is_evaluated_and_predicts_without_charts(data, tmp_path):
    figures = read_figures(DataDirectory(data).verified_folder("evaluation"))
    assert np.isfinite(figures[f"{NAME}-touch"].per_object("chamfer")).all()
    prediction = predict(tmp_path / "a.ply", StoredGrasps(data, "c", [0]), PredictOptions(data / "models", f"{NAME}-touch"), "closed")
    assert prediction.touched.tolist() == [False, True, True, True]
    assert not any(line.startswith("warning: gels") for line in prediction.remarks)


def test_network_of_charts_still_needs_them(data):
    with pytest.raises(StoreError, match="charts"):
        spheres.run_stage(data, "train-implicit", spheres.objects(3, SPLITS), *SETTINGS, "train-implicit.configuration=implicit-touch")
