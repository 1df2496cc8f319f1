"""Objects of real size are learned and seen as objects of 0.5 m are: lengths that are not the sensor's follow the objects'."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.geometry.normalise import POSITION, bounding_diagonal
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.kernels.networks.network_configurations import NetworkConfig
from pipeline.kernels.vision.camera import project_points
from pipeline.models.families import load_reconstructor
from pipeline.models.observation import Observation
from pipeline.training.loop import read_metrics
from pipeline.training.reconstruction import size_remarks
from stages.render_vision.settings import VisionSettings
from stages.render_vision.stage import RenderVision
from stages.train_implicit.settings import ImplicitSettings
from tests.kernels.vision.shapes import ball
from tests.stages.tiny_dataset import manifest, run_stage

SMALL = ("train-gcn.gcn_layers=3", "train-gcn.gcn_features=12", "train-gcn.epochs=2", "train-gcn.loss_points=200", "train-gcn.threads=1")
NONE = (
    "train-gcn.configuration=none",
    "train-gcn.validation_items=1",
    *SMALL,
)
SIZES = (0.5, 0.1)
SHRINK = SIZES[1] / SIZES[0]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> dict[float, Path]:
    """Sample the same two bottles in two sizes."""
    made = {size: tmp_path_factory.mktemp("data") for size in SIZES}
    for size, folder in made.items():
        for stage in ("sample-surfaces", "sample-distances"):
            run_stage(folder, stage, manifest(), f"sample-surfaces.diagonal={size}", "sample-distances.queries=500")
    return made


def shrunk(points: Any) -> np.ndarray:
    return np.asarray(POSITION + SHRINK * (np.asarray(points, np.float64) - POSITION))


def test_charts_learn_objects_of_10_cm_as_well_as_objects_of_50_cm(data):
    made, losses = {}, {}
    for size, folder in data.items():
        trained = run_stage(folder, "train-gcn", manifest(), *NONE)
        assert trained is not None
        model = load_reconstructor("none", trained)
        assert model.config.radius == size / 2  # to the bit: normalised objects are learned as ever
        made[size], losses[size] = model.reconstruct([Observation(None)])[0].vertices, [epoch["loss"] for epoch in read_metrics(trained)]
    assert losses[0.1] == pytest.approx(losses[0.5], rel=1e-3)
    assert losses[0.5][-1] < losses[0.5][0]
    assert np.abs(made[0.1] - shrunk(made[0.5])).max() < 1e-3 * 0.05


def test_distances_are_sampled_around_objects_of_10_cm_as_around_objects_of_50_cm(data):
    large, small = (ObjectRows(data[size], ["query_points", "signed_distance"], None) for size in SIZES)
    for name in large.object_ids:
        np.testing.assert_allclose(small.read("query_points", name), shrunk(large.read("query_points", name)), atol=1e-6)
        np.testing.assert_allclose(small.read("signed_distance", name), SHRINK * large.read("signed_distance", name), atol=1e-6)


def test_lengths_of_objects_of_50_cm_equal_those_of_the_settings():
    config = ImplicitSettings(configuration="implicit-unoccluded").network(9, 0.25)
    assert (config.radius, config.band, config.spacing) == (0.25, 0.03, 0.004)
    small = ImplicitSettings(configuration="implicit-unoccluded").network(9, 0.05)
    assert (small.radius, small.band, small.spacing) == pytest.approx((0.05, 0.006, 0.0008))
    assert small.touch_reach == config.touch_reach  # the sensor's
    stated = ImplicitSettings(configuration="implicit-unoccluded", radius=0.05).network(9, 0.25)
    assert stated == small


def camera_of(size: float) -> torch.Tensor:
    """Move a camera towards the object as that gets smaller: images stay the same."""
    matrix = torch.tensor([[200.0, 0, 128, 0], [0, 200, 128, 0], [0, 0, 1, 0]], dtype=torch.float64)
    towards = torch.cat([torch.eye(3, dtype=torch.float64), -torch.tensor([[0.0], [0.0], [0.6 - 2 * size]])], dim=1)
    return matrix @ torch.cat([towards, torch.tensor([[0.0, 0, 0, 1]])])


@pytest.mark.parametrize("family", ["charts", "implicit"])
def test_equal_images_give_equal_shapes_at_any_size(family):
    chance = torch.Generator().manual_seed(0)
    image, queries = torch.rand(1, 3, 256, 256, generator=chance), torch.rand(1, 50, 3, generator=chance) * 0.4 - 0.2
    seen: dict[str, Any] = {"images": image, "touched": torch.zeros(0, dtype=torch.bool), "counts": [0]}
    answers = {}
    for size in SIZES:
        seen |= {"camera": camera_of(size), "touch_vertices": torch.zeros(0, 81, 3)}
        weights = torch.Generator().manual_seed(1)
        if family == "charts":
            sizes: Any = {"encoder_layers": 12, "encoder_width": 0.125, "gcn_layers": 3, "gcn_features": 12}
            network = DeformationNetwork(NetworkConfig(image="unoccluded", radius=size / 2, **sizes), weights).eval()
            answers[size] = network(**seen).detach().numpy()
        else:
            config = ImplicitSettings(configuration="implicit-unoccluded", features=16).network(9, size / 2)
            at = torch.tensor(POSITION, dtype=torch.float32) + queries * (size / 0.5)
            answers[size] = ImplicitNetwork(config, weights).eval()(at, **seen).detach().numpy()
    expected = shrunk(answers[0.5]) if family == "charts" else SHRINK * answers[0.5]
    assert np.abs(answers[0.1] - expected).max() < 1e-3 * np.ptp(expected)


def test_objects_of_very_different_sizes_are_named():
    alike = {"a": 0.1, "b": 0.3}
    assert list(size_remarks(alike, 0.15)) == []
    for radius in (0.02, 2.0):
        (line,) = size_remarks(alike, radius)
        assert f"(radius {radius:g}), and the largest object has 0.3 m (b): leave radius out" in line
    (line,) = size_remarks(alike | {"screw": 0.02, "chair": 0.6}, 0.3)
    assert line.startswith("objects are between 0.02 m (screw) and 0.6 m (chair) large")
    assert "the shape of 2 objects below 0.15 m hardly counts" in line


def test_diagonals_of_objects_that_were_scaled_are_exact():
    rng = np.random.default_rng(0)
    for _ in range(20):
        vertices = rng.normal(size=(100, 3)) * rng.uniform(0.1, 100)
        scaled = (vertices - vertices.mean(axis=0)) * (0.5 / np.linalg.norm(np.ptp(vertices, axis=0))) + POSITION
        assert bounding_diagonal(scaled) == 0.5


def width(settings: VisionSettings, radius: float) -> float:
    """Measure a ball in an image, pixels."""
    matrix = RenderVision().constants(settings)["projection"][0]
    return float(np.ptp(project_points(matrix, ball(radius).vertices), axis=0).max())


def test_run_names_the_zoom_with_which_small_objects_fill_an_image_as_large_ones_do():
    def warnings(settings: VisionSettings, *radii: float) -> list[str]:
        return list(RenderVision().warnings(settings, ((f"ball-{r:g}", {"surfaces": {"points": ball(r).vertices}}) for r in radii)))  # type: ignore[dict-item]

    plain = VisionSettings(hand="allegro_right", occluded=False)
    assert warnings(plain, 0.144, 0.1) == []  # of a diagonal of 0.5 m
    (line,) = warnings(plain, 0.0289, 0.01)
    found = re.search(r"with --set render-vision.zoom=(\S+) \(make: render-vision.zoom=\1 in SET\)", line)
    assert found, line
    zoomed = VisionSettings(**plain.model_dump() | {"zoom": float(found[1])})
    assert warnings(zoomed, 0.0289) == []
    assert width(zoomed, 0.0289) == pytest.approx(width(plain, 0.144), rel=0.1)
    assert width(plain, 0.0289) < 0.25 * width(plain, 0.144)
    assert RenderVision().attributes(zoomed)["scene"]["cameras"][0]["focal"][0] == pytest.approx(float(found[1]) * 406.595)
    (line,) = warnings(plain, 0.0005)  # of a millimetre: what is proposed can be set
    VisionSettings(zoom=float(line.partition("render-vision.zoom=")[2].split()[0]))
    (line,) = warnings(plain, 0.144, 0.01)
    assert line.startswith("1 object smaller than 10 % of the image of camera front (ball-0.01): larger objects leave no room for a zoom")
