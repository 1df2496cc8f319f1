"""Objects of real size are learned and seen as objects of 0.5 m are."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.contrib.toy_objects.source import Procedural
from pipeline.dataset.mesh_rows import mesh_row
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import Unit
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.geometry.mesh_cleaning import POSITION, bounding_diagonal
from pipeline.kernels.touch.touched_points import chart_touches
from pipeline.kernels.vision.camera import project_points, projection_matrix
from pipeline.models.families import load_reconstructor
from pipeline.models.observation import Observation
from pipeline.store.directory import DataDirectory
from pipeline.training.checkpoint import read_metrics
from stages.render_vision.stage import RenderVision, VisionSettings
from stages.sample_surfaces import SurfaceSettings, normalised_mesh
from tests.kernels.vision.shapes import ball
from tests.stages import ball_dataset as spheres
from tests.stages.tiny_dataset import manifest, run_stage

SMALL = ("train-gcn.gcn_layers=3", "train-gcn.gcn_features=12", "train-gcn.epochs=2", "train-gcn.loss_points=200", "train-gcn.threads=1")
NONE = ("train-gcn.configuration=none", "train-gcn.validation_items=1", *SMALL)
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
        assert model.trained.diagonals == (size, size)
        seen = Observation(None, scale=0.5 / size)
        made[size], losses[size] = model.reconstruct([seen])[0].vertices, [epoch["loss"] for epoch in read_metrics(trained)]
    assert losses[0.1] == pytest.approx(losses[0.5], rel=1e-3)
    assert losses[0.5][-1] < losses[0.5][0]
    assert np.abs(made[0.1] - shrunk(made[0.5])).max() < 1e-3 * 0.05


def test_distances_are_sampled_around_objects_of_10_cm_as_around_objects_of_50_cm(data):
    large, small = (ObjectRows(data[size], ["query_points", "signed_distance"], None) for size in SIZES)
    for name in large.object_ids:
        np.testing.assert_allclose(small.read("query_points", name), shrunk(large.read("query_points", name)), atol=1e-6)
        np.testing.assert_allclose(small.read("signed_distance", name), SHRINK * large.read("signed_distance", name), atol=1e-6)


@pytest.mark.parametrize("way", ["occluded-touch", "unoccluded", "touch"])
def test_scaled_observation_gives_the_scaled_surface(tmp_path, way):
    """An image by a camera and a touch, of an object and of one that is a fifth as large, with the camera and the gel as much nearer."""
    spheres.make_model(tmp_path, way)
    model = load_reconstructor(way, DataDirectory(tmp_path).verified_folder(f"models/gcn/{way}"))
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (256, 256, 3), np.uint8) if model.config.image else None
    charts = (
        (POSITION + rng.uniform(-0.1, 0.1, (2, spheres.SIDE**2, 3))).astype(np.float32)
        if model.config.touch
        else np.zeros((0, 9, 3), np.float32)
    )
    matrix = projection_matrix(spheres.CAMERA) if model.config.image else None
    nearer = None if matrix is None else np.column_stack([matrix[:, :3], SHRINK * matrix[:, 3] - (1 - SHRINK) * matrix[:, :3] @ POSITION])
    large = Observation(image, chart_touches(charts, np.ones(len(charts), bool)), matrix)
    small = Observation(image, chart_touches(shrunk(charts), large.touched), nearer, scale=1 / SHRINK)
    whole, part = (model.reconstruct([seen])[0].vertices for seen in (large, small))
    assert np.abs(part - shrunk(whole)).max() < 1e-5


def test_objects_keep_their_size_between_stated_diagonals_and_get_one_of_them_otherwise():
    def placed(kind: str, variant: int, diagonals: tuple[float, float]) -> float:
        source = {"kind": "procedural", "category": kind, "variant": variant, "seed": 0, "diagonals": diagonals}
        mesh, placement, _ = normalised_mesh(source, SurfaceSettings())
        assert diagonals[0] <= bounding_diagonal(mesh.vertices) <= diagonals[1]
        return float(np.linalg.norm(placement[:3, 0]))

    assert placed("mug", 0, (0.01, 1.0)) == pytest.approx(1)
    drawn = [placed("rifle", variant, (0.06, 0.2)) for variant in range(4)]
    assert len(set(drawn)) == 4
    assert drawn[0] == placed("rifle", 0, (0.06, 0.2)) < 0.5
    with pytest.raises(ValueError, match="the least comes first"):
        Procedural(kind="procedural", licence="MIT", seed=0, count={"mug": 1}, diagonals=(0.2, 0.06))


def test_small_objects_are_seen_as_large_as_others_unless_a_zoom_is_set():
    def widths(settings: VisionSettings, radius: float) -> float:
        shape = ball(radius)
        with RenderVision().session(settings, {}) as process:
            row = process(
                Unit("a"), {"surfaces": mesh_row(shape), "grasps": {"hand_pose": np.eye(4)[None], "joint_angles": np.zeros((1, 16))}}
            )
        return float(np.ptp(project_points(row["projection"][0, 0], shape.vertices), axis=0).max())

    plain = VisionSettings(hand="allegro_right", occluded=False, resolution=64)
    assert widths(plain, 0.0289) == pytest.approx(widths(plain, 0.144), rel=0.05)
    assert widths(plain.model_copy(update={"zoom": 1.0}), 0.0289) < 0.25 * widths(plain, 0.144)


def test_objects_that_are_small_or_cut_off_with_a_set_zoom_are_named():
    def warnings(settings: VisionSettings, *radii: float) -> list[str]:
        return list(RenderVision().describe_misfits(settings, ((f"ball-{r:g}", {"surfaces": {"points": ball(r).vertices}}) for r in radii)))  # type: ignore[dict-item]

    plain = VisionSettings(hand="allegro_right", occluded=False)
    assert warnings(plain, 0.144, 0.001) == []
    (line,) = warnings(plain.model_copy(update={"zoom": 1.0}), 0.144, 0.01)
    assert line.startswith("1 object smaller than 10 % of the image of camera front (ball-0.01): leave render-vision.zoom (1) out, or")
    (line,) = warnings(plain.model_copy(update={"zoom": 3.0}), 0.144)
    assert line.startswith("1 object not whole in the image of camera front (ball-0.144): leave render-vision.zoom (3) out, or")


def test_a_hand_without_visual_shapes_is_named(monkeypatch):
    bare = replace(load_hand("allegro_right"), links=tuple(replace(link, visuals=()) for link in load_hand("allegro_right").links))
    monkeypatch.setattr("stages.render_vision.stage.load_hand", lambda name: bare)
    (line,) = RenderVision().describe_misfits(VisionSettings(hand="allegro_right"), ())
    assert line == "hand allegro_right has no visual shapes, so no image shows it: give its URDF <visual> elements"
    assert list(RenderVision().describe_misfits(VisionSettings(hand="allegro_right", occluded=False), ())) == []
