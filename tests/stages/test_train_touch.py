"""`train-touch` on random presses of a small calibrated sensor: what is learnt from, that it learns, and how the model is used."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.local_network import LocalNetwork, pixel_positions
from pipeline.kernels.touch.depth_maps import scaled_gel
from pipeline.kernels.touch.sensor import Gel, resample
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models.touch_model import LocalTouchModel, load_touch_model, shipped_touch_model
from pipeline.real_touch import random_presses, save_sensor_network
from pipeline.store.directory import DataDirectory
from pipeline.training.presses import Presses
from stages.train_touch import PressLearner, TouchTrainingSettings, train_local_network
from tests.stages import ball_dataset as spheres

SENSOR = resample(load_sensor("gelsight"), 36, 48).model_copy(update={"membrane": 0.0, "gel": Gel(modulus=1e5)})
SETTINGS: dict[str, Any] = {"epochs": 20, "batch_size": 8, "window": 24, "width": 8, "learning_rate": 1e-2}
OFF = dict.fromkeys(("image_gain", "image_noise", "image_mix", "image_depth", "image_blur", "image_drift"), 0.0)


@pytest.fixture(scope="module")
def presses() -> Presses:
    return random_presses(SENSOR, 48, 0, gel=(0.5, 1.5))


@pytest.fixture(scope="module")
def trained(presses: Presses, tmp_path_factory: pytest.TempPathFactory) -> tuple[LocalTouchModel, dict[str, Any]]:
    settings = TouchTrainingSettings.model_validate(SETTINGS | OFF)
    valid = random_presses(SENSOR, 8, 1, gel=(1.0, 1.0))
    network, facts = train_local_network(presses, valid, settings, folder=tmp_path_factory.mktemp("training"), seed=0)
    return LocalTouchModel(network, presses.sensor, presses.untouched), facts


def learner(presses: Presses, **changes: Any) -> PressLearner:
    return PressLearner(LocalNetwork(4), presses, presses, TouchTrainingSettings.model_validate(SETTINGS | changes))


def generators(count: int, seed: int = 0) -> list[torch.Generator]:
    return [torch.Generator().manual_seed(seed + number) for number in range(count)]


def test_presses_follow_from_the_seed_and_have_the_drawn_gel(presses: Presses) -> None:
    again = random_presses(SENSOR, 3, 0, gel=(0.5, 1.5))
    for number in range(3):
        for one, other in zip(presses.read(number), again.read(number), strict=True):
            np.testing.assert_array_equal(one, other)
    assert {press.image.shape for press in map(presses.read, range(len(presses)))} == {(36, 48, 3)}
    thicker = scaled_gel(SENSOR, 2.0).gel
    assert thicker is not None
    assert thicker.thickness == 2 * SENSOR.w
    drawn_in = load_sensor("gelsight").model_copy(update={"membrane": 0.0009, "gel": None})
    assert scaled_gel(drawn_in, 2.0).membrane == 2 * drawn_in.membrane


def test_windows_are_crops_of_presses(presses: Presses) -> None:
    windows = learner(presses, **OFF).read([5, 6], generators(2))
    assert windows.change.shape == (2, 3, 24, 24)
    whole = 1e3 * presses.read(5).indentation
    x, y = windows.position[0]
    col, row = (round(float((part[0, 0] + 1) / 2 * size - 0.5)) for part, size in ((x, 48), (y, 36)))
    np.testing.assert_array_equal(windows.depth[0], whole[row : row + 24, col : col + 24])
    change = presses.read(5).image.astype(float) - presses.untouched
    np.testing.assert_array_equal(windows.change[0].permute(1, 2, 0), change[row : row + 24, col : col + 24])


@pytest.mark.parametrize("precision", ["64-true", "bf16-mixed"])
def test_network_trains_in_every_precision(presses: Presses, tmp_path: Path, precision: str) -> None:
    settings, usual = (TouchTrainingSettings.model_validate(SETTINGS | {"epochs": 1, "precision": one}) for one in (precision, "32-true"))
    losses = []
    for number, chosen in enumerate((settings, usual)):
        (folder := tmp_path / str(number)).mkdir()
        losses.append(train_local_network(presses, presses, chosen, folder=folder, seed=0)[1]["best"]["loss"])
    assert losses[0] == pytest.approx(losses[1], rel=0.05)


def test_network_learns_to_read_depth_and_keeps_the_last_epoch(
    trained: tuple[LocalTouchModel, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After few steps slopes drift all over the image: only with its rim pinned does depth show what was learned."""
    monkeypatch.setattr("pipeline.models.touch_model.free_pressed_rim", lambda depth, slopes, pitch: depth)
    model, facts = trained
    assert facts["best_epoch"] == facts["epochs"] - 1
    unseen = random_presses(SENSOR, 24, 7, gel=(1.0, 1.0))
    pressed = [unseen.read(number) for number in range(len(unseen))]
    reading = model.read(np.stack([press.image for press in pressed]))
    truth = np.stack([press.indentation for press in pressed])
    assert np.abs(reading.indentation - truth).mean() < 0.8 * np.abs(truth).mean()
    assert (reading.indentation >= 0).all()
    nothing = model.read(presses_at_rest := unseen.untouched[None])
    assert nothing.indentation.max() < 1e-4  # presses are up to 1.2 mm deep
    assert not nothing.contact.any()
    assert model.maps(presses_at_rest)[0] == pytest.approx(SENSOR.w, abs=1e-4)


def test_validation_reads_whole_presses_as_photographs_are_read(presses: Presses, trained: tuple[LocalTouchModel, dict[str, Any]]) -> None:
    model, _ = trained
    stored = [presses.read(item) for item in range(len(presses))]
    images, depths = (np.stack([getattr(press, name) for press in stored]) for name in ("image", "indentation"))
    with torch.inference_mode():
        read = PressLearner(model.network, presses, presses, TouchTrainingSettings()).validate(model.network)["depth_error_um"]
        change = torch.from_numpy(images.astype(np.float32) - presses.untouched).permute(0, 3, 1, 2)
        pitch = (1e3 * presses.sensor.pitch[0], 1e3 * presses.sensor.pitch[1])
        shape = model.network(change, pixel_positions(*presses.sensor.shape), pitch)
    assert read == pytest.approx(1e3 * np.abs(shape.depth.numpy() - 1e3 * depths).mean(), rel=1e-4)


def test_models_are_saved_and_read_other_pixel_counts(trained: tuple[LocalTouchModel, dict[str, Any]], tmp_path: Path) -> None:
    save_sensor_network(trained[0], tmp_path / "model")
    model = load_touch_model(tmp_path / "model", "cpu")
    assert isinstance(model, LocalTouchModel)
    press = random_presses(SENSOR, 1, 9, gel=(1.0, 1.0)).read(0)
    own, same = model.read(press.image[None]), trained[0].read(press.image[None])
    np.testing.assert_array_equal(own.indentation, same.indentation)
    larger = np.repeat(np.repeat(press.image, 2, axis=0), 2, axis=1)[None]
    assert model.read(larger).indentation[0, ::2, ::2] == pytest.approx(own.indentation[0], abs=2e-4)
    assert model.clouds(larger)[0].shape == (int(model.maps(larger)[1].sum()), 3)
    assert model.clouds(larger[:0]) == []
    with pytest.raises(InvalidInput, match="1 times as wide as high"):
        model.read(np.zeros((1, 40, 40, 3), np.uint8))
    with pytest.raises(InvalidInput, match=r"the untouched photograph is uint8 \(4, 4, 3\)"):
        model.read(press.image[None], np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(InvalidInput, match="reads uint8"):
        model.read(press.image[None].astype(float))
    sensor = load_sensor("gelsight")
    assert sensor.calibrated is not None
    optics = sensor.calibrated.model_copy(update={"background": ((100.0, 100.0, 100.0),)})
    model.check_sensor(sensor.model_copy(update={"calibrated": optics, "noise": 3.0, "given_height": sensor.height}))
    with pytest.raises(InvalidInput, match=r"the tactile images are gel_16mm's, and calibrated, .*name, .* differ: run train-touch"):
        model.check_sensor(load_sensor("gel_16mm"))


def test_local_network_with_a_threshold_is_an_error(trained: tuple[LocalTouchModel, dict[str, Any]], tmp_path: Path) -> None:
    save_sensor_network(trained[0], tmp_path)
    path = tmp_path / "model.json"
    path.write_text(path.read_text().replace('"network": "local"', '"network": "local", "mask_threshold": 0.001'))
    with pytest.raises(StoreError, match="a local network finds contact itself"):
        load_touch_model(tmp_path, "cpu")


def test_depth_is_read_against_the_current_untouched_photograph(trained: tuple[LocalTouchModel, dict[str, Any]]) -> None:
    model, _ = trained
    darker = replace(model, untouched=model.untouched // 2)
    press = random_presses(SENSOR, 1, 9, gel=(1.0, 1.0)).read(0)
    np.testing.assert_array_equal(darker.read(press.image[None], model.untouched).indentation, model.read(press.image[None]).indentation)


def test_the_pretrained_network_of_the_datasets_sensor_is_taken_without_presses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spheres.make_data(tmp_path / "data", 2, ("train", "valid"))
    objects, stated = spheres.objects(2, ("train", "valid")), "train-touch.pretrained=shipped"
    with pytest.raises(InvalidInput, match="no pretrained network reads photographs of sensor gel_16mm"):
        spheres.run_stage(tmp_path / "data", "train-touch", objects, stated)
    save_sensor_network(LocalTouchModel(LocalNetwork(4), spheres.SENSOR, untouched_image(spheres.SENSOR)), tmp_path / "shipped")
    monkeypatch.setattr("pipeline.models.touch_model.shipped_sensor_network", lambda name: tmp_path / "shipped")
    spheres.run_stage(tmp_path / "data", "train-touch", objects, stated)
    shipped_touch_model.cache_clear()
    made, shipped = (tmp_path / "shipped", DataDirectory(tmp_path / "data").verified_folder("models/touch"))
    assert (made / "model.safetensors").read_bytes() == (shipped / "model.safetensors").read_bytes()
