"""`implicit-any`: one network that is trained on, evaluated with and asked for every combination of inputs."""

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from pipeline.contrib.report.results import trainings_table
from pipeline.errors import InvalidInput
from pipeline.kernels.networks.network_configurations import INPUT_CHOICES
from pipeline.kernels.networks.touch_points import pad_touches
from pipeline.models.families import ROWS, load_reconstructor, model_name, reconstructor_type, rows_of, trained_models
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from pipeline.rng import torch_generator
from pipeline.store.directory import DataDirectory
from pipeline.tables.evaluation_tables import evaluation_tables
from pipeline.training.items import Items
from stages.evaluate.evaluation_files import read_figures, read_root
from stages.registry import resolve
from stages.train_implicit import ImplicitLearner, TrainImplicit
from tests.stages import ball_dataset as spheres

NAME = "implicit-any"
SPLITS = ("train", "valid", "test")
OBJECTS = spheres.objects(3, SPLITS)
SETTINGS = (
    *("train-implicit.configuration=implicit-any", "train-implicit.features=16", "train-implicit.blocks=1", "train-implicit.epochs=2"),
    *("train-implicit.queries=50", "train-implicit.validation_queries=50", "train-implicit.encoder_width=0.125"),
    *("train-implicit.samples_per_object=6", "train-implicit.validation_items=6"),
    *("train-implicit.spacing=0.04", "evaluate.configurations=[implicit-any]", "evaluate.points=200", "evaluate.grasps=[1,5]"),
)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 3, SPLITS)
    for stage in ("train-implicit", "evaluate"):
        spheres.run_stage(folder, stage, OBJECTS, *SETTINGS)
    return folder


def test_training_draws_every_combination_of_inputs_and_validates_them_in_turn(data):
    settings = resolve("train-implicit", "draft", SETTINGS)
    items = Items(data, "train", settings.inputs, 6, learned=TrainImplicit.arrays)
    drawn = [items.random_view(0, 1, 5, torch_generator(0, n), dropped=settings.dropped_inputs) for n in range(200)]
    given = {(seen.image is not None, bool(len(seen.touched))) for seen in drawn}
    assert given == {(False, False), (False, True), (True, False), (True, True)}
    assert {len(seen.touched) // spheres.SENSORS for seen in drawn} == {0, 1, 2, 3, 4, 5}
    shown = [seen.image for seen in drawn if seen.image is not None]
    alone = items.rows.read("unoccluded", items.rows.object_ids[0], camera=0)
    assert 0.35 < np.mean([np.array_equal(image, alone) for image in shown]) < 0.65
    assert 0.1 < 1 - len(shown) / len(drawn) < 0.3
    turns = [items.fixed_view(item, 1, 5) for item in range(6)]
    assert [(seen.image is not None, len(seen.touched)) for seen in turns] == [
        (way.image is not None, spheres.SENSORS if way.touch else 0) for way in INPUT_CHOICES.values()
    ]
    assert np.array_equal(turns[4].image, alone)
    assert settings.touch_dropout == 0.1
    assert resolve("train-implicit", "draft", ["train-implicit.configuration=implicit-touch"]).touch_dropout == 0


def test_networks_with_fixed_inputs_draw_no_input_choices(data):
    settings = resolve("train-implicit", "draft", ["train-implicit.configuration=implicit-occluded-touch"])
    items = Items(data, "train", settings.inputs, 1, learned=TrainImplicit.arrays)
    first, second = torch_generator(0, "a"), torch_generator(0, "a")
    seen = items.random_view(0, 1, 5, first, dropped=settings.dropped_inputs)
    count = int(torch.randint(1, 6, (), generator=second))
    torch.randperm(5, generator=second)
    assert len(seen.touched) == count * spheres.SENSORS
    assert torch.equal(torch.rand(3, generator=first), torch.rand(3, generator=second))


def test_half_of_the_items_with_image_and_touches_are_at_a_wrong_place_and_their_targets_with_them(data):
    """The balls' signed distances are still those of a ball, moved and scaled; items without an image or a touch stay where they are."""
    settings = resolve("train-implicit", "draft", (*SETTINGS, "train-implicit.placement_error=0.03"))
    items = Items(data, "train", settings.inputs, 6, learned=TrainImplicit.arrays)
    network = reconstructor_type(NAME).network_type(settings.network(items.side), torch_generator(0, "weights"))
    learner, plain = (
        ImplicitLearner(network, items, items, chosen, 0) for chosen in (settings, settings.model_copy(update={"placement_error": 0.0}))
    )
    batch, as_stored = (one.read([0] * 100, [torch_generator(0, n) for n in range(100)]) for one in (learner, plain))
    moved = [observation.scale == 1 for observation in batch.observations]  # the others are scaled when they are stacked
    can_move = [seen.image is not None and bool(seen.touched.any()) for seen in as_stored.observations]
    assert 0.3 < sum(moved) / sum(can_move) < 0.7
    for observation, is_moved, may_move, queries, distances in zip(batch.observations, moved, can_move, *batch.targets, strict=True):
        centre, radius = ball_of(queries.numpy().astype(np.float64), distances.numpy().astype(np.float64))
        assert may_move or not is_moved
        assert (np.abs(centre - spheres.CENTRE).max() > 1e-4) == is_moved
        felt = [touch.points for touch in observation.scaled(spheres.CENTRE).touches]
        reach = np.linalg.norm(np.concatenate([np.zeros((0, 3)), *felt]) - centre, axis=1)
        np.testing.assert_allclose(reach, radius, atol=1e-4)


def ball_of(points: np.ndarray, distances: np.ndarray) -> tuple[np.ndarray, float]:
    """Fit a ball to signed distances (N,) of points (N, 3): |p|² - d² = 2 p·c + 2 d r + r² - |c|² is linear in c, r and the rest."""
    columns = np.column_stack([2 * points, 2 * distances, np.ones(len(points))])
    (*centre, radius, _), *_ = np.linalg.lstsq(columns, (points**2).sum(axis=1) - distances**2)
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1) - radius, distances, atol=1e-5)
    return np.array(centre), float(radius)


def test_network_is_evaluated_in_every_row_of_the_tables(data):
    folder = DataDirectory(data).verified_folder("evaluation")
    rows = [f"{NAME}-{way}" for way in INPUT_CHOICES]
    configurations = read_root(folder)["configurations"]
    assert list(configurations) == rows
    assert configurations[f"{NAME}-occluded-touch"] == {"image": "occluded", "touch": True}
    figures = read_figures(folder)
    assert all(np.isfinite(figures[row].per_object("chamfer")).all() for row in rows)
    assert figures[f"{NAME}-touch"].grasps == [1, 5]
    values = [float(figures[row].per_object("chamfer")[0]) for row in rows]
    assert len(set(values)) == len(values)  # each input changes the answer
    accuracy = next(table for table in evaluation_tables(folder) if table.title.startswith("Accuracy"))
    assert [row.cells[0] for row in accuracy.rows][:6] == rows
    assert [row.cells[0] for row in trainings_table([folder])[0].rows] == rows


@pytest.mark.parametrize("way", INPUT_CHOICES)
def test_network_predicts_from_each_combination_of_inputs(data, tmp_path, way):
    done = predict(tmp_path / "out.ply", StoredGrasps(data, "c", [0, 1]), PredictOptions(data / "models", f"{NAME}-{way}"))
    assert trimesh.load(done.files[0]).is_watertight
    assert bool(len(done.touched)) == INPUT_CHOICES[way].touch


def test_network_predicts_from_available_inputs_and_without_input(data, tmp_path):
    both = predict(tmp_path / "a.ply", StoredGrasps(data, "c", [0]), PredictOptions(data / "models", NAME))
    same = predict(tmp_path / "b.ply", StoredGrasps(data, "c", [0]), PredictOptions(data / "models", f"{NAME}-occluded-touch"))
    np.testing.assert_array_equal(both.reconstruction.vertices, same.reconstruction.vertices)
    assert len(predict(tmp_path / "c.ply", None, PredictOptions(data / "models", f"{NAME}-none")).reconstruction.faces)


def test_missing_images_do_not_affect_other_items_of_the_batch(data):
    model = load_reconstructor(NAME, DataDirectory(data).verified_folder(f"models/implicit/{NAME}"))
    items = Items(data, "test", model.config, 6, learned=TrainImplicit.arrays)
    observations = [items.fixed_view(item, 1, 5) for item in range(6)]
    batch = model._batch(observations)
    queries = torch.rand(6, 30, 3, generator=torch.Generator().manual_seed(0)) * 0.4 + torch.tensor([-0.2, -0.2, 0.4])
    with torch.no_grad():
        together = model.network(queries, **vars(batch))
        for number, observation in enumerate(observations):
            alone = model.network(queries[number, None], **vars(model._batch([observation])))
            torch.testing.assert_close(together[number], alone[0], atol=1e-6, rtol=1e-4)


def test_step_without_images_gives_every_weight_a_gradient(data):
    """Processes that share a step wait for each of them."""
    settings = resolve("train-implicit", "draft", SETTINGS)
    network = reconstructor_type(NAME).network_type(settings.network(spheres.SIDE), torch.Generator().manual_seed(0)).train()
    none = pad_touches([(), ()], torch.zeros(1))
    network(torch.rand(2, 5, 3), images=None, camera=None, touches=none).sum().backward()
    assert all(weights.grad is not None for weights in network.encoder.parameters())


def test_names_of_rows_refer_to_the_same_network(data):
    assert model_name(f"{NAME}-touch", 1) == f"models/seed-1/implicit/{NAME}"
    assert ROWS[f"{NAME}-unoccluded"].inputs.image == "unoccluded"
    assert trained_models(data / "models").keys() == {NAME, *rows_of(NAME)}
    assert resolve("evaluate", "draft", ["evaluate.configurations=[implicit-any-touch]"]).configurations == ("implicit-any-touch",)
    with pytest.raises(InvalidInput, match="each once"):
        resolve("evaluate", "draft", ["evaluate.configurations=[implicit-any,implicit-any-touch]"])
    with pytest.raises(InvalidInput, match="take group"):
        resolve("train-implicit", "draft", [*SETTINGS, "train-implicit.encoder_norm=batch", "train-implicit.devices=2"])
