"""Simulated grasps as observation files: the sensor is the dataset's own."""

from pathlib import Path

import numpy as np
import yaml

from benchmarks.robot_grasp import _sensor_name, write_grasp
from pipeline.formats.sensor_file import load_sensor
from tests.stages import ball_dataset

PIXELS = np.full((100, 100, 3), 80, np.uint8)


def test_observation_names_the_shipped_sensor_of_the_dataset(tmp_path: Path) -> None:
    ball_dataset.make_data(tmp_path / "data", 1)
    observation = yaml.safe_load(write_grasp(tmp_path / "data", "a", 1, tmp_path / "grasp").read_text())
    assert observation["sensor"] == ball_dataset.SENSOR.name
    assert _sensor_name(load_sensor("gelsight_mini"), PIXELS, tmp_path) == "gelsight_mini"
    assert not (tmp_path / "sensor.yaml").exists()


def test_other_sensors_are_written_as_a_file(tmp_path: Path) -> None:
    changed = load_sensor("gelsight_mini").model_copy(update={"w": 0.0041})
    assert _sensor_name(changed, PIXELS, tmp_path) == "sensor.yaml"
    assert load_sensor(tmp_path / "sensor.yaml") == changed
