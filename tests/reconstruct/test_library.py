"""`vt_pipeline.reconstruct` gives the same surface for files and arrays, and names faults."""

from pathlib import Path

import numpy as np
import pytest

import vt_pipeline as vt
from benchmarks.robot_grasp import write_grasp
from tests.stages import ball_dataset as spheres


@pytest.fixture(scope="module")
def grasp_and_models(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Make a grasp's files, and a folder of models that take an image."""
    data = tmp_path_factory.mktemp("balls")
    spheres.make_data(data, 1)
    spheres.make_model(data, "occluded")
    return write_grasp(data, "a", 0, data / "grasp"), data / "models"


def test_a_file_and_arrays_give_the_same_surface(grasp_and_models: tuple[Path, Path]) -> None:
    path, models = grasp_and_models
    read = vt.load_observation(path)
    assert read.camera is not None
    from_file = vt.reconstruct(str(path), models, "occluded", resolution=64)
    camera = {name: getattr(read.camera, name) for name in ("image", "mask", "intrinsics")} | {"pose": read.camera.pose.array}
    observation = vt.RobotObservation(object={"centre": read.object.centre, "diagonal": read.object.diagonal}, camera=camera)
    from_arrays = vt.reconstruct(observation, str(models), "occluded", resolution=64)
    np.testing.assert_allclose(from_arrays.reconstruction.vertices, from_file.reconstruction.vertices, atol=1e-9)
    assert from_file.closed is not None
    assert "takes no touch: the touches are not used" in " ".join(from_file.remarks)
    assert len(repr(from_file)) < 100
    assert not from_file.files


CAMERA = {"image": np.ones((4, 4, 3), np.uint8), "intrinsics": {"fx": 10, "fy": 10, "cx": 2, "cy": 2}, "pose": np.eye(4)}
TOUCH = {"tactile_image": np.ones((4, 4), np.uint8), "pose": np.eye(4)}


def test_wrong_observation_type_and_invalid_resolution_are_named(grasp_and_models: tuple[Path, Path]) -> None:
    path, models = grasp_and_models
    with pytest.raises(TypeError, match="observation is a RobotObservation or the path of an observation file; this is NoneType"):
        vt.reconstruct(None, models)
    with pytest.raises(vt.InvalidInput, match=r"model occluded needs a photograph: add the entry camera; object.centre is missing"):
        vt.reconstruct(vt.RobotObservation(), models, "occluded")
    for resolution in (0, 63, 401, 64.5, "x"):
        with pytest.raises(vt.InvalidInput, match=f"resolution is {resolution!r}; it must be a whole number, 64 to 400"):
            vt.reconstruct(path, models, resolution=resolution)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (
            {"untouched": None, "camera": CAMERA | {"image": np.ones((4, 4))}},
            r"image is float64 \(4, 4\); it must be uint8 \(rows, cols, 3\)",
        ),
        ({"sensor": "gel_16mm", "touches": [TOUCH]}, r"touches.0 is uint8 \(4, 4\); it must be uint8 \(rows, cols, 3\)"),
        ({"kamera": CAMERA}, r"there is no entry kamera, did you mean camera\? The file's entries are unit, up, object"),
        ({"camera": CAMERA | {"depth": np.full((4, 4), 800, np.int32)}}, r"depth is int32 \(4, 4\); it must be uint16"),  # levels
    ],
)
def test_faults_of_arrays_are_named(entries: dict[str, object], message: str) -> None:
    with pytest.raises(vt.InvalidInput, match=message):
        vt.RobotObservation(**entries)
    assert vt.RobotObservation(camera=CAMERA | {"depth": np.ones((4, 4), np.float32)}).camera is not None
