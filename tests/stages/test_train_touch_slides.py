"""`train-touch` on slides: which steps it reads, that it learns from them, and the model that the stage saves."""

from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.local_network import LocalNetwork
from pipeline.kernels.touch.depth_maps import press_gel
from pipeline.kernels.touch.markers import MarkerGrid
from pipeline.kernels.touch.sensor import Gel, pixel_centres
from pipeline.kernels.touch.sliding import measure_steps, resting_image, slide_gel
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models.touch_model import LocalTouchModel, load_touch_model
from pipeline.training.presses import Motion, Presses, SimulatedPress, stored_slides
from stages.train_touch import PressLearner, TouchTrainingSettings, train_local_network
from tests.stages.tiny_dataset import manifest, run_stage

DOTS = MarkerGrid(rows=6, cols=8, radius=5e-4)
SENSOR = load_sensor("gelsight", shape=(36, 48)).model_copy(update={"markers": DOTS, "gel": Gel(modulus=1e5, thickness=0.004)})
OFF = dict.fromkeys(("image_gain", "image_noise", "image_mix", "image_depth", "image_blur", "image_drift"), 0.0)
BALL = 0.006  # m, radius


def slid_balls(count: int, seed: int) -> Presses:
    """Balls that are pressed and pushed aside: the last step of each."""
    rng, steps = np.random.default_rng(seed), []
    x, y = pixel_centres(SENSOR)
    for _ in range(count):
        at, deep = rng.uniform(-0.003, 0.003, 2), rng.uniform(3e-4, 8e-4)
        views = []
        for aside in (np.zeros(2), np.zeros(2), rng.uniform(-4e-4, 4e-4, 2)):
            middle, pose = at + aside, np.eye(4)
            pose[:2, 3] = -middle
            squared = (x[None] - middle[0]) ** 2 + (y[:, None] - middle[1]) ** 2
            height = SENSOR.w + BALL - (deep if views else -1e-5) - np.sqrt(np.maximum(BALL**2 - squared, 0))
            views.append((np.where(squared < BALL**2, height, np.inf).astype(np.float32), pose))
        slid = list(slide_gel(views, SENSOR, 2.0))
        stored = measure_steps(slid[1:], ("tactile_image", "shear", "slip", "force"))
        motion = Motion(stored["tactile_image"][0], stored["shear"][1], stored["slip"][1], stored["force"][1])
        gel = slid[2].gel
        steps.append(SimulatedPress(stored["tactile_image"][1], gel.indentation.astype(np.float32), gel.contact, motion))
    return Presses(SENSOR, resting_image(SENSOR), [str(number) for number in range(count)], steps.__getitem__)


def test_network_learns_given_slides_and_reads_sequences(tmp_path: Path) -> None:
    settings = TouchTrainingSettings.model_validate(OFF | {"source": "slides", "epochs": 60, "batch_size": 4, "width": 4, "window": 16})
    steps = valid = slid_balls(8, 0)
    untrained = LocalNetwork(4, reads_motion=True)
    with torch.inference_mode():
        before = PressLearner(untrained, steps, valid, settings).validate(untrained)["loss"]
    network, facts = train_local_network(steps, valid, settings, folder=tmp_path, seed=0)
    assert {"depth_error_um", "shear_error_um", "force_error_n"} < set(facts["best"])
    assert facts["best"]["loss"] < 0.7 * before
    model, press = LocalTouchModel(network, SENSOR, resting_image(SENSOR)), valid.read(0)
    read = model.read_motion(np.stack([press.motion.before, press.image]))
    assert (read.shear.shape, read.slips.shape, read.force.shape) == ((2, 36, 48, 2), (2, 36, 48), (2, 3))
    assert ((read.slips >= 0) & (read.slips <= 1)).all()


def test_a_network_of_presses_reads_no_motion() -> None:
    model = LocalTouchModel(LocalNetwork(4), SENSOR, resting_image(SENSOR))
    with pytest.raises(InvalidInput, match=r"train-touch\.source=slides"):
        model.read_motion(resting_image(SENSOR)[None])


def test_motion_is_read_in_sequences_of_images_alone() -> None:
    model, image = LocalTouchModel(LocalNetwork(4, reads_motion=True), SENSOR, resting_image(SENSOR)), resting_image(SENSOR)
    with pytest.raises(InvalidInput, match=r"uint8 \(36, 48, 3\); the local network reads"):
        model.read_motion(image)
    with pytest.raises(InvalidInput, match="the untouched photograph is"):
        model.read_motion(image[None], image[1:])


def test_network_that_knows_dots_refuses_tactile_images_without_them() -> None:
    dotted, bare = SENSOR, SENSOR.model_copy(update={"markers": None})
    LocalTouchModel(LocalNetwork(4, reads_motion=True), bare, resting_image(bare)).check_sensor(bare)
    LocalTouchModel(LocalNetwork(4), dotted, untouched_image(dotted)).check_sensor(dotted)  # presses show no dots
    with pytest.raises(InvalidInput, match=r"printed dots.*train-touch\.source=presses"):
        LocalTouchModel(LocalNetwork(4, reads_motion=True), dotted, resting_image(dotted)).check_sensor(dotted)


def test_stage_reads_each_step_with_the_one_before_and_saves_a_model_that_reads_motion(tmp_path: Path) -> None:
    described = yaml.safe_load(description_path("sensor", "gelsight").read_text()) | {"name": "dotted", "markers": DOTS.model_dump()}
    (tmp_path / "dotted.yaml").write_text(yaml.safe_dump(described | {"markers": {"rows": 3, "cols": 4, "radius": 5e-4}}))
    objects, data = manifest(train=1, valid=1), tmp_path / "data"
    run_stage(data, "sample-surfaces", objects)
    slides = ("slides=2", "steps=8", "rate=4", "pixels=40", f"sensor={tmp_path / 'dotted.yaml'}")
    run_stage(data, "simulate-slides", objects, *(f"simulate-slides.{text}" for text in slides))
    stored = stored_slides(data, "train")
    assert len(stored) == 2 * 8
    rows = ObjectRows(data, ["slide_tactile_image", "slide_depth", "slide_force"], "train")
    image, depth, force = (rows.read(name, rows.object_ids[0], 1) for name in ("slide_tactile_image", "slide_depth", "slide_force"))
    step = stored.read(8 + 3)
    assert stored.name(8 + 3).endswith("slide 1 step 3")
    assert (step.image == image[3]).all()
    assert (step.motion.before == image[2]).all()
    assert (step.motion.force == force[3]).all()
    assert step.indentation == pytest.approx(press_gel(depth[3], stored.sensor).indentation, abs=1e-9)
    assert (stored.read(8).motion.before == image[0]).all()  # the first has none before
    folder = run_stage(data, "train-touch", objects, "train-touch.source=slides", "train-touch.epochs=1", "train-touch.window=16")
    read = load_touch_model(folder, "cpu").read_motion(image)
    assert read.shear.shape == (8, 30, 40, 2)
    assert read.force.shape == (8, 3)


def test_steps_that_did_not_settle_are_not_learned_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.kernels.touch.friction.MAX_STEPS", 0)
    objects = manifest(train=1)
    run_stage(tmp_path, "sample-surfaces", objects)
    run_stage(tmp_path, "simulate-slides", objects, *(f"simulate-slides.{text}" for text in ("slides=1", "steps=8", "rate=4", "pixels=40")))
    rows, stored = ObjectRows(tmp_path, ["slide_settled", "slide_force"], "train"), stored_slides(tmp_path, "train")
    (name,) = rows.object_ids
    numbers = np.flatnonzero(rows.read("slide_settled", name, 0))
    assert 0 < len(numbers) < 8
    assert stored.names == [f"{name} slide 0 step {number}" for number in numbers]
    forces = [stored.read(item).motion.force for item in range(len(stored))]
    np.testing.assert_array_equal(forces, rows.read("slide_force", name, 0)[numbers])
