"""Mesh files of reconstructions: accuracy, joined charts, vertices that are refused, and the colours that an image shows."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import StageError
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.kernels.vision.camera import Camera, projection_matrix
from pipeline.models.reconstruction import Reconstruction, join_vision_charts
from pipeline.reconstruct.mesh_files import seen_colors, write_charts
from tests.stages import ball_dataset as spheres

SPHERE = vision_charts(0)
SIZE = spheres.SIDE**2


def surface(scale: float, offset: float, touches: int = 1) -> Reconstruction:
    """Make the sphere with random touch charts, scaled and moved."""
    _, square = chart_square(spheres.SIDE)
    rng = np.random.default_rng(0)
    vertices = np.concatenate([SPHERE.vertices, rng.uniform(-1, 1, (touches * SIZE, 3))]) * scale + offset
    first = len(SPHERE.vertices) + SIZE * np.arange(touches)
    faces = np.concatenate([SPHERE.faces, (square.numpy()[None] + first[:, None, None]).reshape(-1, 3)])
    return Reconstruction(vertices, faces, len(SPHERE.vertices), SPHERE.position, spheres.SIDE)


def read(path: Path) -> np.ndarray:
    whole = trimesh.load_scene(path, process=False).to_mesh().vertices
    return whole[:, [0, 2, 1]] * [1, -1, 1] if path.suffix == ".glb" else whole


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (0.25, 0.6), (10.0, 0.0), (0.25, 10.0)])
def test_mesh_file_error_is_within_the_documented_bound(tmp_path: Path, suffix: str, scale: float, offset: float) -> None:
    """Errors are at most half of the eighth decimal along each axis for OBJ, and the rounding of float32 for PLY and GLB."""
    reconstruction = surface(scale, offset)
    bound = 1.01 * np.sqrt(3) * (5e-9 if suffix == ".obj" else 6e-8 * np.abs(reconstruction.vertices).max())
    write_charts(tmp_path / f"apart{suffix}", reconstruction)
    write_charts(tmp_path / f"joined{suffix}", reconstruction, joined=True)
    for name, vertices in (
        ("apart", reconstruction.vertices),
        ("joined", np.concatenate([join_vision_charts(reconstruction)[0], reconstruction.vertices[reconstruction.vision :]])),
    ):
        distances = cloud_distances(read(tmp_path / f"{name}{suffix}"), vertices)  # the order of parts may differ
        assert len(distances.predicted) == len(distances.truth)
        assert max(distances.predicted.max(), distances.truth.max()) <= bound**2


def test_coinciding_vertices_are_joined_without_moving() -> None:
    reconstruction = surface(1.0, 10.0, touches=0)
    vertices, faces = join_vision_charts(reconstruction)
    np.testing.assert_allclose(vertices[SPHERE.position], reconstruction.vertices, rtol=1e-15, atol=0)
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("vertex", [0, -1])
def test_vertices_that_are_not_finite_are_refused(tmp_path: Path, vertex: int, value: float) -> None:
    reconstruction = surface(1.0, 0.0)
    reconstruction.vertices[vertex, 1] = value
    for joined in (False, True):
        with pytest.raises(StageError, match=r"1 of \d+ vertices hold NaN or infinity"):
            write_charts(tmp_path / "mesh.obj", reconstruction, joined=joined)
    assert not list(tmp_path.iterdir())


SIDE = 64
CAMERA = Camera(name="camera", position=(0, 0, 1), rotation=(0, 0, 0), focal=(100, 100), centre=(32, 32), resolution=SIDE)
IMAGE = np.full((SIDE, SIDE, 3), 200, np.uint8)
IMAGE[:, :32], IMAGE[:, 32:] = (255, 0, 0), (0, 0, 255)  # red where x is negative
EVERYWHERE = np.ones((SIDE, SIDE), bool)
NEAR, FAR = (trimesh.creation.icosphere(3, radius).apply_translation([0, 0, z]) for radius, z in ((0.1, 0.2), (0.25, -0.3)))
BALLS = trimesh.util.concatenate([NEAR, FAR])


def looked_up(shown=EVERYWHERE, camera=CAMERA):
    return seen_colors(np.asarray(BALLS.vertices), np.asarray(BALLS.faces), IMAGE, projection_matrix(camera), shown)


def test_vertices_that_face_the_camera_have_the_colour_of_their_pixel():
    colors, seen = looked_up()
    red = BALLS.vertices[:, 0] < -1e-6
    top = np.arange(len(BALLS.vertices)) < len(NEAR.vertices)
    top &= BALLS.vertices[:, 2] > 0.25
    assert seen[top].all()
    assert (colors[seen & red] == [255, 0, 0]).all()
    assert (colors[seen & (BALLS.vertices[:, 0] > 1e-6)] == [0, 0, 255]).all()
    assert (colors[~seen] == 0).all()


def test_vertices_turned_away_or_occluded_are_not_seen():
    _, seen = looked_up()
    assert not seen[: len(NEAR.vertices)][NEAR.vertices[:, 2] < 0.2].any()
    beside = np.linalg.norm(FAR.vertices[:, :2], axis=1) * 0.8 / (1 - FAR.vertices[:, 2])  # where the ray passes the near ball's height
    up = FAR.vertices[:, 2] > -0.2
    assert not seen[len(NEAR.vertices) :][up & (beside < 0.09)].any()
    assert seen[len(NEAR.vertices) :][up & (beside > 0.11)].all()
    assert (up & (beside > 0.11)).any()


def test_unmarked_pixels_and_cameras_that_look_away_give_no_colour():
    assert not looked_up(shown=~EVERYWHERE)[1].any()
    assert not looked_up(camera=CAMERA.model_copy(update={"rotation": (180.0, 0.0, 0.0)}))[1].any()
    assert not looked_up(camera=CAMERA.model_copy(update={"centre": (-1000.0, 32.0)}))[1].any()
