"""The stage on a pressed ball: arrays as declared, squares where nothing touched, charts where something did."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import igl
import numpy as np
import pytest
import torch
from pydantic import ValidationError

from pipeline.engine.stage import Unit
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.charts.touch_chart import FitOptions, chart_square
from pipeline.kernels.networks.local_network import LocalNetwork
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.depth_maps import local_points, touch_success
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.models.touch_model import save_touch_model
from pipeline.store.rows import Row
from schemas.charts import StopRule
from stages.fit_charts import NETWORKS, ChartSettings, FitCharts

STAGE = FitCharts()
SENSOR = load_sensor("gel_16mm")
SIZES = {"grasp": 2, "sensor": 2, "vertex": 81, "xyz": 3, "face": 128, "corner": 3}
TRUE = ChartSettings(cloud="true")


def depth_of(height: float, radius: float = 0.012) -> np.ndarray:
    """(rows, cols) float32: a ball pressed in until its lowest point is `height` m above the sensor plane."""
    x, y = np.meshgrid(*pixel_centres(SENSOR))
    with np.errstate(invalid="ignore"):
        z = height + radius - np.sqrt(radius**2 - x**2 - y**2)
    return np.where(np.isfinite(z), z, np.inf).astype(np.float32)


def poses() -> np.ndarray:
    """(2, 2, 4, 4) rigid motions of no particular direction."""
    made = np.tile(np.eye(4), (2, 2, 1, 1))
    rng = np.random.default_rng(3)
    for pose in made.reshape(-1, 4, 4):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        pose[:3, :3] = axes * np.sign(np.linalg.det(axes))
        pose[:3, 3] = rng.normal(scale=0.2, size=3)
    return made


class GivenRow(dict[str, np.ndarray]):
    """Arrays, and their shard."""

    shard: SimpleNamespace


def task(heights: tuple[float, ...] = (0.003, 1.0, 0.0055, 0.00675), name: str = "ball", **sensor: Any) -> tuple[Unit, dict[str, Any]]:
    """Three sensors that touch or nearly do and one in the air."""
    depth = np.stack([depth_of(height) for height in heights]).reshape(2, 2, 100, 100)
    tactile_images = np.stack([tactile_image(one, SENSOR) for one in depth.reshape(4, 100, 100)]).reshape(2, 2, 100, 100, 3)
    touch = GivenRow(depth=depth, tactile_image=tactile_images)
    touch.shard = SimpleNamespace(path="touch", attributes={"sensors": [SENSOR.model_copy(update=sensor).model_dump(mode="json")] * 2})
    return Unit(name), {"touch": touch, "grasps": {"sensor_pose": poses(), "touch_success": touch_success(depth, SENSOR)}}


def run(settings: ChartSettings, one: tuple[Unit, dict[str, Any]], models: dict[str, Path] | None = None) -> Row:
    with STAGE.session(settings, models or {}) as process:
        return process(*one)


@pytest.fixture(scope="module")
def row() -> Row:
    return run(TRUE, task())


def test_arrays_are_as_declared(row: Row) -> None:
    for name, array in {**row, **STAGE.constants(TRUE)}.items():
        declared = STAGE.output.arrays[name]
        assert array.shape == tuple(SIZES[d] for d in declared.dims if d != "object"), name
        assert array.dtype == declared.dtype, name
    assert {"vertices", "residual", "iterations", "stop_rule"} == set(row)


def test_chart_without_touch_is_the_square(row: Row) -> None:
    assert row["stop_rule"].tolist() == [[StopRule.threshold, StopRule.no_touch], [StopRule.threshold, StopRule.no_touch]]
    square = chart_square()[0].numpy() * SENSOR.width
    for at in ((0, 1), (1, 1)):
        placed = square @ poses()[at][:3, :3].T + poses()[at][:3, 3]
        np.testing.assert_allclose(row["vertices"][at], placed, atol=1e-7)
        assert row["residual"][at] == row["iterations"][at] == 0


def test_chart_of_a_touch_lies_on_its_points(row: Row) -> None:
    depth = task()[1]["touch"]["depth"]
    for at in ((0, 0), (1, 0)):
        points, count = local_points(depth[at], poses()[at], SENSOR)
        chart = row["vertices"][at].astype(np.float64)
        squared, *_ = igl.point_mesh_squared_distance(points[:count].astype(np.float64), chart, chart_square()[1].numpy())
        measured = float(np.sqrt(np.mean(squared)))
        assert measured <= TRUE.residual_limit + 1e-7
        np.testing.assert_allclose(row["residual"][at], measured, atol=1e-7)
        assert 0 < row["iterations"][at] < TRUE.max_iterations


def test_seed_depends_on_object_and_sensor(row: Row) -> None:
    assert all(array.tobytes() == row[name].tobytes() for name, array in run(TRUE, task()).items())
    few = ChartSettings(cloud="true", max_iterations=3)
    assert not np.array_equal(run(few, task())["vertices"], run(few, task(name="other"))["vertices"])
    # the same touch once more elsewhere changes nothing here
    assert run(few, task((0.003, 0.004, 0.0055, 1.0)))["vertices"][1, 0].tobytes() == run(few, task())["vertices"][1, 0].tobytes()


def test_object_without_touch_has_a_row() -> None:
    row = run(TRUE, task((1.0, 0.01, 0.0068, 0.03)))
    assert (row["stop_rule"] == StopRule.no_touch).all()
    assert row["vertices"].shape == (2, 2, 81, 3)
    assert row["vertices"].dtype == np.float32


def trained(folder: Path, sensor: Sensor = SENSOR, constant: float = 0.6) -> dict[str, Path]:
    """Save a U-Net that predicts one depth, `constant` of the gel, wherever something touches."""
    network = UNet(1)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        *_, bias = network.parameters()
        bias.fill_(np.log(constant / (1 - constant)))
    folder.mkdir()
    save_touch_model(folder, network, sensor=sensor, untouched=untouched_image(sensor), mask_threshold=0.001)
    return {NETWORKS["predicted"]: folder}


def test_predicted_points_come_from_the_u_net(tmp_path: Path) -> None:
    settings = ChartSettings(tight=True)
    assert STAGE.models(settings) == ("models/unet",)
    assert STAGE.models(TRUE) == ()
    row = run(settings, task(), trained(tmp_path / "unet"))
    assert row["stop_rule"][:, 0].tolist() == [StopRule.threshold] * 2
    local = (row["vertices"][0, 0] - poses()[0, 0, :3, 3]) @ poses()[0, 0, :3, :3]  # the sensor's frame
    assert np.median(np.abs(local[:, 2] - 0.6 * SENSOR.w)) < 3e-4  # vertices of crumpled slivers beyond the rim hang loose


def test_points_of_a_local_network_are_an_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that reads no depth and contact everywhere: its points are the gel at rest."""
    monkeypatch.setattr("pipeline.models.touch_model.free_pressed_rim", lambda depth, *_: depth)  # which has one slope everywhere
    network = LocalNetwork(1)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        *_, bias = network.parameters()
        bias.fill_(1.0)
    save_touch_model(tmp_path, network, sensor=SENSOR, untouched=untouched_image(SENSOR))
    settings = ChartSettings(cloud="local", tight=True)
    assert STAGE.models(settings) == ("models/touch",)
    row = run(settings, task(), {NETWORKS["local"]: tmp_path})
    local = (row["vertices"][0, 0] - poses()[0, 0, :3, 3]) @ poses()[0, 0, :3, :3]  # the sensor's frame
    assert np.median(np.abs(local[:, 2] - SENSOR.w)) < 3e-4


def test_touch_missed_by_the_u_net_keeps_the_square(tmp_path: Path) -> None:
    blind = task()
    blind[1]["touch"]["tactile_image"][:] = untouched_image(SENSOR)
    row = run(ChartSettings(), blind, trained(tmp_path / "unet"))
    assert row["stop_rule"].tolist() == [[StopRule.too_few_points, StopRule.no_touch]] * 2
    assert np.isfinite(row["vertices"]).all()


def test_faults_of_an_object_are_invalid_input(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="knows sensor other"):
        run(ChartSettings(), task(), trained(tmp_path / "unet", SENSOR.model_copy(update={"name": "other"})))
    bent = task()
    bent[1]["grasps"]["sensor_pose"][0, 1, 0, 0] += 1
    with pytest.raises(InvalidInput, match="not a rigid motion"):
        run(ChartSettings(cloud="true", max_iterations=1), bent)


def test_settings_give_the_fit_options_of_the_kernel() -> None:
    letter = {"step_samples": 4000, "cloud_points": None, "check_every": 1, "learning_rate": 3e-3}
    assert ChartSettings.model_validate(letter | {"residual_limit": None}).fit_options(SENSOR.width) == FitOptions(**letter)
    assert ChartSettings(residual_limit=None).fit_options(SENSOR.width) == FitOptions()
    tight = ChartSettings(tight=True).fit_options(SENSOR.width)
    assert tight.halt == 2.3e-4
    np.testing.assert_allclose((tight.residual_limit or 0) * SENSOR.width, 1e-4)
    assert ChartSettings.model_validate({"cloud": True}).cloud == "true"  # how YAML reads `true`
    with pytest.raises(ValidationError, match="it is 8"):
        ChartSettings(side=8)


def test_session_restores_the_number_of_threads() -> None:
    threads = torch.get_num_threads()
    with STAGE.session(TRUE, {}):
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == threads
