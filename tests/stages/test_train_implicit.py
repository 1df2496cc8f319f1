"""Implicit networks from training to mesh file: what they learn of balls is measured, drawn and written as what charts are."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from pipeline.contrib.report.report_source import Evaluation
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import InvalidInput, StageError
from pipeline.kernels.networks.network_configurations import IMPLICIT_CONFIGURATIONS
from pipeline.kernels.touch.touched_points import chart_touches
from pipeline.models.families import load_reconstructor
from pipeline.models.observation import Observation, observed_arrays, stored_observation
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from pipeline.store.directory import DataDirectory
from pipeline.training.items import Items
from pipeline.training.training_stage import remarks
from schemas.charts import CHARTS
from stages.evaluate.evaluation_files import read_figures, read_surfaces, surface_of
from stages.registry import resolve
from stages.train_implicit import ImplicitSettings, TrainImplicit
from tests.stages import ball_dataset as spheres

NAME = "implicit-touch"
SPLITS = ("train", "train", "valid", "test")
OBJECTS = spheres.objects(6, SPLITS)
"""Balls of 10 to 20 cm radius; the one tested is of 16 cm."""
TRUE_RADIUS = 0.16
SETTINGS = (
    *("train-implicit.configuration=implicit-touch", "train-implicit.features=32", "train-implicit.blocks=1", "train-implicit.epochs=150"),
    *("train-implicit.queries=200", "train-implicit.validation_queries=500", "train-implicit.patience=null"),
    *("train-implicit.band=0.1", "train-implicit.spacing=0.01", "train-implicit.learning_rate=0.01"),
    *("evaluate.configurations=[implicit-touch]", "evaluate.points=500", "evaluate.grasps=[1,5]"),
)


def run_stage(data: Path, stage: str, *assignments: str, folder: str | None = None) -> None:
    spheres.run_stage(data, stage, OBJECTS, *SETTINGS, *assignments, folder=folder)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 6, SPLITS)
    for stage in ("train-implicit", "evaluate"):
        run_stage(folder, stage)
    return folder


def folder_of(data: Path, name: str) -> Path:
    return DataDirectory(data).verified_folder(name)


def test_training_begins_with_the_weights_of_a_trained_network(data, tmp_path):
    spheres.make_data(tmp_path, 6, SPLITS)
    begun = f"train-implicit.pretrained={data}/models"
    run_stage(tmp_path, "train-implicit", begun, "train-implicit.epochs=1", "train-implicit.learning_rate=1e-9")
    network, pretrained = (load_reconstructor(NAME, folder_of(one, f"models/implicit/{NAME}")).network for one in (tmp_path, data))
    for weight, first in zip(network.parameters(), pretrained.parameters(), strict=True):
        assert torch.allclose(weight, first, atol=1e-6)
    assert DataDirectory(tmp_path).folder(f"models/implicit/{NAME}").facts["learned_before"] == [{"manifest": "balls", "items": 4}]
    with pytest.raises(StageError, match="would replace the network that it begins with; train with another training_seed"):
        run_stage(data, "train-implicit", begun, "train-implicit.epochs=1")
    run_stage(data, "train-implicit", begun, "train-implicit.epochs=1", folder="sweeps/train-implicit/one")
    with pytest.raises(StageError, match=r"other sizes; to begin with it, set train-implicit\.features=32$"):
        run_stage(tmp_path, "train-implicit", begun, "train-implicit.features=64")
    with pytest.raises(StageError, match=r"nowhere does not exist, or is empty; name a folder of models"):
        run_stage(tmp_path, "train-implicit", f"train-implicit.pretrained={tmp_path}/nowhere")


def test_mesh_of_a_touched_ball_is_closed_and_of_nearly_its_size(data):
    table = read_surfaces(folder_of(data, "evaluation"), NAME)
    assert table["grasps_given"].tolist() == [1, 5]
    for case in range(2):
        mesh = trimesh.Trimesh(*surface_of(table, 0, case), process=False)
        assert mesh.is_watertight
        assert mesh.volume > 0
        radii = np.linalg.norm(mesh.vertices - spheres.CENTRE, axis=1)
        assert abs(np.median(radii) - TRUE_RADIUS) < 0.04
    figures = read_figures(folder_of(data, "evaluation"))[NAME]
    assert figures.available("seam_gap").tolist() == [0.0]
    worst = max(figures.per_case("chamfer", given).max() for given in figures.grasps)
    assert worst < 2 * 0.06**2  # 0.05 without a useful surface
    assert 0.5 < figures.available("area_ratio")[0] < 2


def test_stored_meshes_equal_those_of_the_model(data):
    model = load_reconstructor(NAME, folder_of(data, f"models/implicit/{NAME}"))
    predicted = model.reconstruct([Observation(None), Observation(None)])
    assert np.array_equal(predicted[0].vertices, predicted[1].vertices)
    assert len(predicted[0].faces)  # one that knows nothing answers something
    assert predicted[0].is_whole
    table = read_surfaces(folder_of(data, "evaluation"), NAME)
    assert table["vertex_count"].sum() == len(table["vertices"])
    assert table["face_count"].sum() == len(table["faces"])
    assert all(surface_of(table, 0, case)[1].max() + 1 == table["vertex_count"][0, case] for case in range(2))


def test_touches_determine_the_size(data):
    model = load_reconstructor(NAME, folder_of(data, f"models/implicit/{NAME}"))
    rows = ObjectRows(data, observed_arrays(model.config), "train")
    predicted = model.reconstruct([stored_observation(rows, name, range(5), model.config) for name in ("a", "f")])
    small, large = (np.median(np.linalg.norm(one.vertices - spheres.CENTRE, axis=1)) for one in predicted)  # of 10 and 20 cm
    assert large > 1.4 * small


def test_mesh_passes_through_touches_off_the_predicted_surface(data):
    model = load_reconstructor(NAME, folder_of(data, f"models/implicit/{NAME}"))
    model.network.config = model.network.config.model_copy(update={"spacing": 0.004})  # touch reaches 10 mm
    side = np.linspace(-0.008, 0.008, 9)
    flat = np.stack([*np.meshgrid(side, side[::-1]), np.zeros((9, 9))], axis=-1).reshape(-1, 3)
    for away in (-0.02, 0.02):
        felt = spheres.CENTRE + flat + [0.003, -0.002, TRUE_RADIUS + away]  # on the ball's top the network expects it 2 cm off
        observation = Observation(None, chart_touches(felt[None], np.array([True])))
        made = model.reconstruct([observation])[0]
        apart = trimesh.proximity.closest_point(trimesh.Trimesh(made.vertices, made.faces, process=False), felt)[1]
        assert apart.max() < 5e-4


def test_untouched_pieces_are_left_out_without_an_image(data, monkeypatch):
    model = load_reconstructor(NAME, folder_of(data, f"models/implicit/{NAME}"))
    middles = [spheres.CENTRE, spheres.CENTRE + [0.2, 0, 0]]
    balls = [(middle, radius) for middle, radius in zip(middles, (0.08, 0.05), strict=True)]

    def distances(code, queries, errors):
        return torch.stack([torch.linalg.norm(queries - torch.tensor(middle), dim=2) - radius for middle, radius in balls]).amin(dim=0)

    monkeypatch.setattr(model.network, "decode_with_touches", distances)
    for touched, pieces in ((middles[0] + [0.08, 0, 0], 1), (middles[1] + [0.05, 0, 0], 2)):
        felt = np.tile(touched, (1, 9, 1)).astype(np.float32)
        (made,) = model.reconstruct([Observation(None, chart_touches(felt, np.array([True])))])
        assert len(trimesh.Trimesh(made.vertices, made.faces, process=False).split()) == pieces


def test_guess_is_a_surface_although_two_evaluations_round_differently(data, monkeypatch):
    model = load_reconstructor(NAME, folder_of(data, f"models/implicit/{NAME}"))
    calls = itertools.count()

    def distances(code, queries, errors):  # nothing is inside
        return torch.linalg.norm(queries - torch.tensor(spheres.CENTRE), dim=2) + 0.1 + 1e-8 * next(calls)

    monkeypatch.setattr(model.network, "decode_with_touches", distances)
    (made,) = model.reconstruct([Observation(None)])
    assert made.is_guess
    assert len(made.faces)


def test_prediction_is_drawn_and_written_as_one_mesh(data, tmp_path):
    table = read_surfaces(folder_of(data, "evaluation"), NAME)
    evaluation = Evaluation([folder_of(data, "evaluation")], DataDirectory(data).collection(CHARTS))
    drawn = evaluation.mesh("d", next(shown for shown in evaluation.predictions("d") if shown.network == NAME and shown.case == 1))
    assert (len(drawn.vertices), len(drawn.faces)) == (table["vertex_count"][0, 1], table["face_count"][0, 1])
    done = predict(tmp_path / "out.glb", StoredGrasps(data, "d", [0, 1]), PredictOptions(data / "models", NAME))
    for path in done.files:
        scene = trimesh.load(path)
        (mesh,) = scene.geometry.values()
        assert mesh.is_watertight
    predict(tmp_path / "closed.ply", StoredGrasps(data, "d"), PredictOptions(data / "models", NAME, resolution=64), "closed")
    assert trimesh.load(tmp_path / "closed.ply").is_watertight
    with pytest.raises(StageError, match=r"no model touch: its models are implicit-touch; choose one of these, or train it with"):
        predict(tmp_path / "out.glb", StoredGrasps(data, "d"), PredictOptions(data / "models", "touch"))


def test_settings_without_effect_and_missing_grasps_are_named(data):
    stated = ["image_noise=3", "dropped_touches=0.5", "dropped_image=0.5", "touch_reach=0.02", "max_grasps=9"]

    def remarks_of(configuration: str) -> list[str]:
        settings = resolve("train-implicit", "draft", [f"train-implicit.{text}" for text in (f"configuration={configuration}", *stated)])
        return [
            line.split(maxsplit=1)[0] if "no effect" in line else line
            for line in remarks(settings, Items(data, "train", settings.inputs, 1, learned=TrainImplicit.arrays))
            if "render-vision.resolution" not in line
        ]

    few = "items have at most 5 grasps, min_grasps is 1 and max_grasps 9: the dataset holds no more of an object (simulate-grasps.grasps)"
    assert remarks_of("implicit-unoccluded") == ["max_grasps=9", "dropped_touches=0.5", "touch_reach=0.02", "dropped_image=0.5"]
    assert remarks_of("implicit-touch") == ["image_noise=3.0", "dropped_image=0.5", few]


def test_each_configuration_reads_its_inputs_only():
    reads = {name: {one.name for one in TrainImplicit().inputs(ImplicitSettings(configuration=name))} for name in IMPLICIT_CONFIGURATIONS}
    assert reads["implicit-touch"] == {"surfaces", "distances", "charts"}
    assert reads["implicit-occluded"] == reads["implicit-unoccluded"] == {"surfaces", "distances", "vision"}
    assert (
        reads["implicit-any"]
        == reads["implicit-occluded-touch"]
        == reads["implicit-unoccluded-touch"]
        == {"surfaces", "distances", "vision", "charts"}
    )


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("configuration=touch", "unknown configuration touch; choose from implicit-touch"),
        ("min_grasps=6", "min_grasps is 6, max_grasps 5"),
        ("learning_rate=1e39", "learning_rate: .*100"),  # beyond float32
        ("features=5000", "features: .*4096"),  # could not be read again
        ("blocks=101", "blocks: .*100"),
        ("spacing=0.001", "spacing: .*0.00125"),  # more cells than a mesh may have
        ("spacing=0.1", "spacing: .*0.05"),
    ],
)
def test_invalid_network_settings_are_refused(assignment, words):
    with pytest.raises(InvalidInput, match=words):
        resolve("train-implicit", "draft", [f"train-implicit.{assignment}"])
