"""Sensor files and where their pixels are."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.kernels.touch.sensor import load_sensor, pixel_centres, ray_origins, sensor_path
from tests.touch.scenes import SENSOR, pose_at


def variant(tmp_path: Path, **changes: object) -> Path:
    content = yaml.safe_load(sensor_path("gel_16mm").read_text())
    content.update(changes)
    path = tmp_path / "other.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_supplements_sensor() -> None:
    assert (SENSOR.width, SENSOR.rows, SENSOR.cols, SENSOR.w, SENSOR.range) == (0.01641, 100, 100, 0.0068, 0.05)
    assert hash(SENSOR) == hash(load_sensor("gel_16mm"))


def test_pixels_and_rays() -> None:
    x, y = pixel_centres(SENSOR)
    assert x[0] == pytest.approx((0.5 / 100 - 0.5) * 0.01641)
    assert y[99] == pytest.approx((99.5 / 100 - 0.5) * 0.01641)
    pose = pose_at(np.array([1.0, 2, 3]), np.array([0.3, -0.2, 0.9]), 0.01, 0.7)
    origins = ray_origins(pose, SENSOR)
    assert origins.shape == (100, 100, 3)
    assert np.allclose(origins[10, 20], pose[:3] @ [x[20], y[10], 0, 1], atol=1e-15)


def test_another_sensor_is_another_file(tmp_path: Path) -> None:
    sensor = load_sensor(variant(tmp_path, name="wide", rows=60, cols=80, width=0.03))
    assert ray_origins(np.eye(4), sensor).shape == (60, 80, 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wdth": 1}, "wdth"),
        ({"width": -1}, "width"),
        ({"rows": 1}, "rows"),
        ({"noise": "some"}, "noise"),
        ({"lights": {}}, "lights"),
        ({"w": float("nan")}, "w"),
    ],
)
def test_senseless_files_are_named(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    path = variant(tmp_path, **changes)
    with pytest.raises(ValueError, match=message) as error:
        load_sensor(path)
    assert str(path) in str(error.value)


def test_missing_sensor_lists_those_there_are() -> None:
    with pytest.raises(FileNotFoundError, match="gel_16mm"):
        load_sensor("nope")
