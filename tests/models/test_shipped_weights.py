"""Shipped weights: copied with a card from a data directory, found by `predict` without --models, an error if there are none."""

import shutil
from pathlib import Path

import pytest
import torch
import trimesh
import yaml

from benchmarks import ship_sensor_weights, ship_weights
from benchmarks.ship_sensor_weights import SensorCard, sensor_card_path
from pipeline.errors import StageError, StoreError
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models import shipped_weights
from pipeline.models.families import ROWS
from pipeline.models.shipped_weights import SENSORS, card_path, models_location, read_card, shipped_models, shipped_sensor_network
from pipeline.models.touch_model import save_touch_model, shipped_touch_model
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps
from stages.train_touch import TouchTrainingSettings
from tests.command_line import vt
from tests.engine.tiny_stages import publish
from tests.stages import ball_dataset as spheres

NETWORK = "implicit-any"
TOY = ship_weights.load_manifest("toy")


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 3, ("train", "test"))
    for name in (NETWORK, "implicit-gels"):
        spheres.make_implicit_model(folder, name, spacing=0.05)
    (unet := folder / "made").mkdir()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        save_touch_model(unet, UNet(4), sensor=spheres.SENSOR, untouched=untouched_image(spheres.SENSOR), mask_threshold=1e-3)
    publish(folder, "models/unet", unet, "train-unet")
    return folder


MODULES = ("pipeline.models.shipped_weights", "pipeline.reconstruct.predict", "stages.evaluate.scores", "benchmarks.ship_weights")


@pytest.fixture(scope="module")
def weights(data, tmp_path_factory) -> Path:
    """Ship the weights to a folder of their own, with a manifest in place of the balls', which have none."""
    folder = tmp_path_factory.mktemp("shipped") / "weights"
    tested = TOY.sources[0].model_copy(update={"split": "test", "licence": "of objects to test on"})
    manifest = TOY.model_copy(update={"sources": (*TOY.sources, tested)})
    for old in (f"implicit/{NETWORK}-old/model.json", "implicit/other.json", "unet.json", "sensors/gelsight.card.yaml"):
        (folder / old).parent.mkdir(parents=True, exist_ok=True)
        (folder / old).write_text("old")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ship_weights, "load_manifest", lambda name: manifest)
        for module in MODULES:
            patch.setattr(f"{module}.SHIPPED", folder)
        ship_weights.ship(data)
        ship_weights.ship(data, "implicit-gels")
    return folder


@pytest.fixture
def shipped(weights, tmp_path, monkeypatch) -> Path:
    folder = shutil.copytree(weights, tmp_path / "weights")
    for module in MODULES:
        monkeypatch.setattr(f"{module}.SHIPPED", folder)
    return folder


def test_shipped_network_has_a_card_with_sources_licences_and_errors_by_row_and_class(shipped):
    gels, card = read_card("implicit-gels", shipped), read_card(NETWORK, shipped)
    assert "make gel-weights; " in gels.command
    assert {"implicit-gels-touch", "implicit-gels-occluded-touch"} <= gels.errors.keys()
    assert not gels.errors.keys() & {f"{NETWORK}-touch"}
    assert "make weights; " in card.command
    assert card.learned_from == {"toy": 2}
    assert [source.licence for source in card.trained_on] == [source.licence for source in TOY.sources]
    assert {f"{NETWORK}-touch", f"{NETWORK}-occluded-touch", "training object, by touch"} <= card.errors.keys()
    of_all = card.errors[f"{NETWORK}-touch"]["all"]
    assert of_all.objects == 1
    assert of_all.mean == of_all.median > 0
    assert card.not_for


def test_shipping_replaces_its_files_and_keeps_the_other_networks(shipped, data):
    assert (shipped / "sensors" / "gelsight.card.yaml").read_text() == "old"
    assert (shipped / "implicit" / "other.json").read_text() == "old"
    assert not (shipped / "implicit" / f"{NETWORK}-old").exists()
    assert (shipped / "unet.json").read_text() != "old"
    with pytest.raises(StageError, match="implicit-touch does not ship; choose implicit-any or implicit-gels"):
        ship_weights.ship(data, "implicit-touch")


def test_predict_without_models_uses_the_shipped_network(data, shipped, tmp_path):
    assert shipped_models() == shipped
    bare = shutil.copytree(data, tmp_path / "bare", ignore=shutil.ignore_patterns("models", "evaluation*"))
    vt("predict", tmp_path / "out.ply", "--data", bare, "--object", "b")
    assert trimesh.load(tmp_path / "out.ply").is_watertight
    assert PredictOptions().network() == (shipped, NETWORK)
    source = StoredGrasps(data, "b")
    assert PredictOptions(models_location("shipped")).network(source) == (shipped, NETWORK)
    assert PredictOptions().network(source) == (data / "models", "occluded-touch")  # its own
    assert PredictOptions(None, f"{NETWORK}-touch").network(StoredGrasps(bare, "b")) == (shipped, f"{NETWORK}-touch")
    with pytest.raises(StageError, match="a pretrained network has one training; name models of training seed 1"):
        PredictOptions(training_seed=1).network()
    assert PredictOptions(training_seed=1).network(source) == (data / "models", "occluded-touch")  # where it is said to be missing


def test_missing_shipped_weights_give_an_error_that_names_the_option(tmp_path, monkeypatch):
    for module in ("pipeline.models.shipped_weights", "pipeline.reconstruct.predict"):
        monkeypatch.setattr(f"{module}.SHIPPED", tmp_path / "none")
    with pytest.raises(StageError, match="name a folder of models with --models"):
        PredictOptions().network()
    assert PredictOptions().network(StoredGrasps(tmp_path, "b")) == (tmp_path / "models", "occluded-touch")


@pytest.mark.parametrize(("content", "words"), [("[", "cannot be read as a card"), ("network: 3\n", "network")])
def test_damaged_card_is_named(shipped, content, words):
    card_path(shipped, NETWORK).write_text(content)
    with pytest.raises(StoreError, match=words):
        read_card(NETWORK, shipped)


def _sensor_card(path: Path) -> SensorCard:
    return SensorCard.model_validate(yaml.safe_load(path.read_text()))


def test_shipped_weights_are_small_and_each_has_a_card():
    """Check the weights in the repository, if there are any."""
    for name in {ROWS[name].network for name in shipped_weights.trained_models(shipped_weights.SHIPPED)}:
        card = read_card(name)
        assert card.network == name
        assert {f"{name}-{way}" for way in ("touch", "occluded", "occluded-touch", "unoccluded", "unoccluded-touch")} <= card.errors.keys()
    for card in (shipped_weights.SHIPPED / SENSORS).glob("*.yaml"):
        assert _sensor_card(card).errors
    ship_weights.check_size(shipped_weights.SHIPPED)


def test_a_network_or_all_of_them_that_are_too_large_do_not_ship(tmp_path, monkeypatch):
    for name in "ab":
        (tmp_path / name).write_bytes(bytes(2000))
    ship_weights.check_size(tmp_path)
    monkeypatch.setattr(ship_weights, "MAX_ALL_BYTES", 3e3)
    with pytest.raises(StageError, match=rf"{tmp_path} has \S+ MB, at most \S+ ship"):
        ship_weights.check_size(tmp_path)
    monkeypatch.setattr(ship_weights, "MAX_BYTES", 1e3)
    with pytest.raises(StageError, match=rf"{tmp_path}/[ab] has \S+ MB"):
        ship_weights.check_size(tmp_path)


@pytest.mark.parametrize("name", sorted(ship_sensor_weights.FITTED_TO))
def test_depth_error_on_simulated_balls_is_that_of_the_sensors_card(name):
    """Balls are not those of the training; the reader would refuse a changed sensor file."""
    sensor = ship_sensor_weights.square_pixels(load_sensor(name))
    balls = ship_sensor_weights.simulated_balls(sensor, ship_sensor_weights.BALLS)
    model = shipped_touch_model(load_sensor(name), "cpu")
    error = ship_sensor_weights.errors_of(model, balls, untouched_image(sensor), 1e3 * sensor.pitch[1])
    stated = _sensor_card(sensor_card_path(name)).errors[ship_sensor_weights.SIMULATED]
    assert error.depth_mm < 1.1 * stated.depth_mm < 0.05
    assert error.normals_deg < 1.1 * stated.normals_deg < 5
    assert error.contact_iou > 0.9 * stated.contact_iou > 0.7


def test_network_of_a_sensor_is_shipped_with_a_card(tmp_path):
    settings = TouchTrainingSettings(epochs=1, width=2, batch_size=2, threads=1)
    assert shipped_sensor_network("gelsight_mini", tmp_path) is None
    card = ship_sensor_weights.ship("gelsight_mini", tmp_path, presses=4, settings=settings)
    assert card == _sensor_card(sensor_card_path("gelsight_mini", tmp_path))
    assert card.presses == 4
    assert "no photograph" in card.trained_on[0].source
    assert shipped_sensor_network("gelsight_mini", tmp_path) is not None
    assert ship_sensor_weights.measure_again("gelsight_mini", weights=tmp_path) == card
