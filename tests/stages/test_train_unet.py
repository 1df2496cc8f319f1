"""`train-unet` on balls pressed into a small sensor: what is learnt from, what is written, and how it is used."""

import itertools
import shutil
import sys
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import torch

from pipeline.config.settings import Settings
from pipeline.config.sources import Object
from pipeline.console import console_on
from pipeline.engine.plan import Request
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StoreError
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.depth_maps import touch_success
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.models.touch_model import load_touch_model
from pipeline.rng import seeded_weights
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import collect_everything
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from stages.train_unet import Touches, TrainUnet, UnetLearner, UnetSettings, depth_errors, load_touches
from tests.engine.tiny_stages import run
from tests.stages.pressed_balls import GRASPS_EACH, SENSOR, SENSORS, Made, depths

SETTINGS: dict[str, Any] = {"width": 2, "epochs": 2, "batch_size": 4, "threads": 1, "accelerator": "cpu", "learning_rate": 0.01}
SPLITS = ("train", "valid", "train", "test", "valid", "train")
OBJECTS = [Object(f"ball-{number}", "balls", {}, name) for number, name in enumerate(SPLITS)]


class RowsInMemory:
    """The rows of a split, as `ObjectRows` gives them."""

    def __init__(self, objects: int, seed: int, touching: bool = True) -> None:
        rng = np.random.default_rng(seed)
        depth = np.stack([depths(rng, touching) for _ in range(objects)])
        tactile_images = np.stack([tactile_image(image, SENSOR) for image in depth.reshape(-1, *SENSOR.shape)]).reshape(*depth.shape, 3)
        self.arrays = {"depth": depth, "tactile_image": tactile_images, "touch_success": touch_success(depth, SENSOR)}
        self.object_ids = [f"ball-{number}" for number in range(objects)]

    def read(self, array: str, object_id: str, grasp: int) -> np.ndarray:
        return self.arrays[array][self.object_ids.index(object_id), grasp]


def touches_of(rows: Any) -> Touches:
    return Touches(rows, np.argwhere(rows.arrays["touch_success"]), SENSOR, untouched_image(SENSOR))


@pytest.fixture(scope="module")
def touches() -> Touches:
    return touches_of(RowsInMemory(4, seed=0))


def learner(touches: Touches, **changes: Any) -> UnetLearner:
    settings = UnetSettings.model_validate(SETTINGS | changes)
    with seeded_weights(0, "test"):
        return UnetLearner(UNet(settings.width), touches, touches, settings)


def everything(trained: UnetLearner) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read all items as one batch."""
    items = range(len(trained.train))
    return trained.read(items, [torch.Generator() for _ in items])


def test_items_are_the_sensors_that_touched(touches: Touches) -> None:
    assert len(touches) == 4 * GRASPS_EACH * (SENSORS - 1)
    assert (touches.where[:, 2] < SENSORS - 1).all()
    tactile_images, depth = touches.read([0, 5])
    for item, index in enumerate(touches.where[[0, 5]]):
        assert (tactile_images[item] == touches.rows.arrays["tactile_image"][tuple(index)]).all()
        assert (depth[item] == touches.rows.arrays["depth"][tuple(index)]).all()
    assert touches.name(5) == "ball-1 grasp 0 sensor 1"


@pytest.mark.parametrize("loss", ["depth", "chamfer"])
def test_loss_falls_and_its_measures_agree(touches: Touches, loss: Literal["depth", "chamfer"]) -> None:
    trained = learner(touches, loss=loss, width=4)
    optimizer = torch.optim.Adam(trained.network.parameters(), lr=0.01)

    def validate() -> dict[str, float]:
        trained.network.eval()
        with torch.no_grad():
            return trained.validate(trained.network)

    first = validate()
    assert first == validate()
    for _ in range(40):
        trained.network.train()
        optimizer.zero_grad()
        trained.loss(trained.network, everything(trained)).backward()
        optimizer.step()
    last = validate()
    with torch.no_grad():
        assert learner(touches, loss=loss, width=4, batch_size=3).validate(trained.network) == pytest.approx(last, rel=1e-5)
    assert last.keys() == {"loss", "depth_rms_um"}
    assert last["loss"] < 0.5 * first["loss"]
    assert last["depth_rms_um"] < 0.8 * first["depth_rms_um"]
    if loss == "depth":  # the one weighs touches, the other pixels; both are means of the same squares
        assert last["loss"] ** 0.5 * SENSOR.width * 1e6 == pytest.approx(last["depth_rms_um"], rel=0.5)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Make a dataset of 6 objects, the folder of a U-Net trained on it, and its facts."""
    data = tmp_path_factory.mktemp("balls")
    make_touches(data, "balls")
    facts = make(data, data / "models", SETTINGS)
    return data, facts | {"digest": hashes_of(data / "models")["model.safetensors"]}


def make_touches(data: Path, manifest: str) -> None:
    """Make rows; for another manifest, equal rows in other groups."""
    for name, output in (("simulate-grasps", GRASPS), ("simulate-touch", TOUCH)):
        run(Request(Made(name, output), Settings(), manifest, OBJECTS, "draft", 0, data))


def make(data: Path, folder: Path, settings: dict[str, Any]) -> dict[str, Any]:
    folder.mkdir()
    return TrainUnet().make(DatasetJob(data, folder, UnetSettings.model_validate(settings), 0, {}, console_on(sys.stdout), "models/unet"))


def test_training_whose_inputs_are_removed_ends_with_an_error_and_resumes(
    trained: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zarr reads zeros where a group is gone."""
    data = Path(shutil.copytree(trained[0], tmp_path / "data", ignore=shutil.ignore_patterns("models")))
    settings = UnetSettings.model_validate(
        SETTINGS | {"checkpoint_seconds": 0, "cache_megabytes": 0}
    )  # as if the dataset were larger than what is kept
    request = Request(TrainUnet(), settings, manifest="balls", objects=OBJECTS, preset="draft", seed=0, data=data)
    read, reads = UnetLearner.read, itertools.count()

    def read_and_replace(self: UnetLearner, *given: Any) -> Any:
        if next(reads) == 3:
            make_touches(data, "spheres")
            collect_everything(DataDirectory(data), older_than=-1)
        return read(self, *given)

    monkeypatch.setattr(UnetLearner, "read", read_and_replace)
    with pytest.raises(StoreError, match=r"it was replaced since it was opened: .* run the same command again"):
        run(request)
    assert run(request) == 5
    assert DataDirectory(data).folder("models/unet").files["model.safetensors"] == trained[1]["digest"]


def test_stage_trains_on_touches_only(trained: tuple[Path, dict[str, Any]]) -> None:
    facts = trained[1]
    assert facts["touches"] == {"train": 3 * GRASPS_EACH * (SENSORS - 1), "valid": 2 * GRASPS_EACH * (SENSORS - 1)}
    assert facts["epochs"] == 2
    assert facts["best"].keys() == {"train_loss", "loss", "depth_rms_um"}
    stage, settings = TrainUnet(), UnetSettings()
    assert stage.inputs(settings) == (TOUCH, GRASPS)
    assert stage.models(settings) == ()
    assert stage.splits(settings) == ("train", "valid")
    assert stage.writes(settings) == "models/unet"


def test_model_folder_is_sufficient_for_prediction(trained: tuple[Path, dict[str, Any]]) -> None:
    model = load_touch_model(trained[0] / "models", "cpu")
    assert model.sensor == SENSOR
    assert (model.untouched == untouched_image(SENSOR)).all()
    assert model.mask_threshold == 0.001
    felt = RowsInMemory(9, seed=1).arrays
    tactile_images = felt["tactile_image"].reshape(-1, *SENSOR.shape, 3)  # 54: more than a batch
    (depth, mask), clouds = model.maps(tactile_images), model.clouds(tactile_images)
    assert depth.shape == mask.shape == tactile_images.shape[:3]
    assert (depth.dtype, mask.dtype) == (np.float32, np.bool_)
    assert ((depth > 0) & (depth < SENSOR.w)).all()
    assert np.abs(depth[50] - model.maps(tactile_images[50:51])[0][0]).max() < 1e-7
    assert (mask.any(axis=(1, 2)) == felt["touch_success"].reshape(-1)).all()
    x, y = pixel_centres(SENSOR)
    for cloud, image, touched in zip(clouds, depth, mask, strict=True):
        assert cloud.dtype == np.float64
        expected = [(x[col], y[row], image[row, col]) for row, col in np.ndindex(SENSOR.shape) if touched[row, col]]
        assert (cloud == np.array(expected).reshape(-1, 3)).all()
    assert model.clouds(tactile_images[:0]) == []


def test_weights_of_the_best_epoch_are_stored(trained: tuple[Path, dict[str, Any]]) -> None:
    data, facts = trained
    model = load_touch_model(data / "models", "cpu")
    valid = load_touches(data, "valid")
    stored = UnetLearner(model.network, valid, valid, UnetSettings.model_validate(SETTINGS))
    with torch.no_grad():
        assert stored.validate(stored.network)["loss"] == pytest.approx(facts["best"]["loss"], rel=1e-6)


def test_trade_measures_the_depth_error_of_each_test_object(trained: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch) -> None:
    data = trained[0]
    monkeypatch.setattr(DataDirectory, "verified_folder", lambda *_: data / "models")
    tactile_images, depth = load_touches(data, "test").read(range(GRASPS_EACH * (SENSORS - 1)))
    differences = (load_touch_model(data / "models", "cpu").maps(tactile_images)[0] - depth)[depth < SENSOR.w]
    assert depth_errors(data, data) == {"ball-3": pytest.approx(1e6 * np.sqrt(np.square(differences).mean()), rel=1e-4)}


def test_tactile_images_of_another_sensor_are_refused(trained: tuple[Path, dict[str, Any]]) -> None:
    model = load_touch_model(trained[0] / "models", "cpu")
    for bad in (np.zeros((2, 30, 20, 3), np.uint8), np.zeros((20, 20, 3), np.uint8), np.zeros((2, 20, 20, 3))):
        for call in (model.maps, model.clouds):
            with pytest.raises(ValueError, match=r"tactile images are .*sensor 'gel_16mm': uint8 \(N, 20, 20, 3\)"):
                call(bad)


def test_folder_without_a_model_is_an_error(trained: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="holds no trained model"):
        load_touch_model(tmp_path, "cpu")
    for name in ("model.safetensors", "model.json"):
        (tmp_path / name).write_bytes((trained[0] / "models" / name).read_bytes())
    with pytest.raises(StoreError, match=r"no trained model that can be used.*untouched.png cannot be read.*run the stage that trains it"):
        load_touch_model(tmp_path, "cpu")
