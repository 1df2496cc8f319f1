"""Train the networks that read photographs of the shipped calibrated sensors, from their files alone, and write them with cards.

`python -m benchmarks.ship_sensor_weights [--real FOLDER]`; with the photographs of docs/sensors.md, cards have the errors on those too.
With `--errors` nothing is trained: cards get the errors of the shipped networks as photographs are read today.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
import yaml
from pydantic import Field
from scipy.ndimage import distance_transform_edt

from benchmarks.ball_photographs import gelsight_balls, mini_balls
from benchmarks.provenance import commit
from benchmarks.real_touch.photograph_sets import Press, ball_press
from benchmarks.real_touch.scores import Reading, mean_scores, score
from benchmarks.ship_weights import check_size
from pipeline.entries import Entries
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import press_gel
from pipeline.kernels.touch.press_shapes import press_relief
from pipeline.kernels.touch.sensor import MM, Sensor, pixel_centres, resample_longer_side
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.models.shipped_weights import CARD, SENSORS, SHIPPED, TrainedOn
from pipeline.models.touch_model import LocalTouchModel, load_touch_model
from pipeline.real_touch import PRESSES, save_sensor_network, train_sensor_network
from pipeline.rng import numpy_rng
from stages.train_touch import TouchTrainingSettings

FITTED_TO = {
    "gelsight": "the even ones of 48 photographs in the package taxim 1.4.1 (MIT licence, copyright 2021 CMURoboTouch)",
    "gelsight_mini": "44 photographs in the repository rpl-cmu/gelslam, which states no licence for them",
    "digit": None,
}
"""The shipped sensors with networks, and what their sensor files were fitted to; None where nothing was fitted."""
HELD_OUT = {"gelsight": "the odd ones in taxim 1.4.1", "gelsight_mini": "23 in rpl-cmu/gelslam"}
"""Photographs on which errors are measured."""
TRAINED_ON = "simulated presses of random shapes into the sensor file {}.yaml, and no photograph; its numbers were fitted to {}"
NO_PHOTOGRAPH = "nothing: its lamps are a guess, and photographs of a real one are not read well before it is calibrated"
NOT_FOR = (
    "other sensors of the same make than those whose colours the file holds (calibrate your own), slopes and depths "
    "beyond what the file states, and any use in which a wrong depth does harm"
)
SIMULATED = "simulated balls"
RADII, DEPTHS = (2e-3, 5e-3), (2e-4, 1e-3)
"""m, least and greatest, of the simulated balls and of how deep they are pressed in."""
BALLS = 40
AWAY, STRAY = 0.25, 0.1
"""How far from a ball's circle contact counts as away from it, in radii, and the share of the circle that it may cover."""


class SensorError(Entries):
    """Mean errors of the depth that a network reads in images of balls.

    Of the shape alone where the depth of a ball is not known.
    """

    images: int = Field(ge=1)  # how many
    depth_mm: float | None = Field(default=None, ge=0)  # root of the mean squared error in the contact
    shape_mm: float = Field(ge=0)  # the same without the mean error
    normals_deg: float = Field(ge=0)  # mean angle between normals in the contact
    contact_iou: float = Field(ge=0, le=1)  # intersection over union with the ball's contact
    stray: float = Field(ge=0, le=1)  # share of the images in which contact away from the ball covers over `STRAY` of its circle


class SensorCard(Entries):
    """The card of a pretrained network that reads a sensor's photographs."""

    sensor: str  # name of the built-in sensor
    presses: int = Field(ge=1)  # simulated
    trained_on: tuple[TrainedOn, ...] = Field(min_length=1)
    commit: str  # of the code that trained it
    command: str
    # by kind of images that it was not trained on: simulated; photographs if any
    errors: dict[str, SensorError] = Field(min_length=1)
    not_for: str  # uses that it is not meant for


def sensor_card_path(sensor: str, weights: Path = SHIPPED) -> Path:
    """Return the path of the card of a sensor's network."""
    return weights / SENSORS / CARD.format(sensor)


def square_pixels(sensor: Sensor) -> Sensor:
    """Give a sensor square pixels, which a DIGIT's are not: errors are measured in them."""
    return resample_longer_side(sensor, max(sensor.shape))


def simulated_balls(sensor: Sensor, count: int) -> list[Press]:
    """Press balls of random sizes into a sensor's gel, with their middles anywhere in the middle half of it."""
    (x, y), presses = pixel_centres(sensor), []
    for number in range(count):
        rng = numpy_rng(number, sensor.name, SIMULATED)
        radius, depth = rng.uniform(*RADII), rng.uniform(*DEPTHS)
        across, down = rng.uniform(-0.25, 0.25) * sensor.width, rng.uniform(-0.25, 0.25) * sensor.height
        squared = radius**2 - (x[None] - across) ** 2 - (y[:, None] - down) ** 2
        state = press_gel(press_relief(np.where(squared > 0, np.sqrt(np.maximum(squared, 0)), -np.inf), sensor, depth), sensor)
        image = render_gel(state.indentation, sensor, rng)
        presses.append(Press(f"{number}", image, MM * state.indentation, state.contact, flat=False, absolute=True))
    return presses


def photographed_balls(name: str, real: Path, scale: float) -> tuple[str, list[Press], np.ndarray]:
    """Read the photographs of balls that a shipped sensor was not fitted to: what they are, with their shapes, and the untouched one."""
    balls = gelsight_balls() if name == "gelsight" else mini_balls(real, "9.500")
    photographs = balls.photographs[1::2] if name == "gelsight" else balls.photographs
    description = f"photographs of balls of {MM * balls.radius:g} mm radius, to which nothing was fitted: {HELD_OUT[name]}"
    return description, [ball_press(photograph, MM * balls.radius, scale) for photograph in photographs], balls.untouched


def errors_of(model: LocalTouchModel, presses: list[Press], untouched: np.ndarray, scale: float) -> SensorError:
    """Average a network's errors over presses; `scale` is mm per pixel."""
    scores, stray = [], []
    for press in presses:
        indentation, contact, _ = model.read(press.image[None], untouched)
        scores.append(score(Reading(MM * indentation[0].astype(float), contact[0]), press, scale))
        size = press.touched.sum()
        away = distance_transform_edt(~press.touched) > AWAY * np.sqrt(size / np.pi)
        stray.append((contact[0] & away).sum() > STRAY * size)
    mean = mean_scores(scores)
    return SensorError(
        images=len(presses),
        depth_mm=None if np.isnan(mean.rmse) else round(mean.rmse, 4),
        shape_mm=round(mean.shape, 4),
        normals_deg=round(mean.sphere, 2),
        contact_iou=round(mean.overlap, 3),
        stray=round(float(np.mean(stray)), 3),
    )


def all_errors(model: LocalTouchModel, name: str, real: Path | None) -> dict[str, SensorError]:
    """Measure a network on simulated balls and, with `real`, on the photographs that its sensor was not fitted to."""
    sensor = square_pixels(load_sensor(name))
    scale = MM * sensor.pitch[1]
    errors = {SIMULATED: errors_of(model, simulated_balls(sensor, BALLS), untouched_image(sensor), scale)}
    if real is not None and FITTED_TO[name] is not None:
        description, balls, untouched = photographed_balls(name, real, scale)
        errors[description] = errors_of(model, balls, untouched, scale)
    return errors


def measure_again(name: str, real: Path | None = None, weights: Path = SHIPPED) -> SensorCard:
    """Write the errors of a shipped network, as it reads today, into its card; without `real`, those on photographs stay."""
    card = SensorCard.model_validate(yaml.safe_load(sensor_card_path(name, weights).read_text()))
    model = load_touch_model(weights / SENSORS / name, "cpu")
    assert isinstance(model, LocalTouchModel)
    card = card.model_copy(update={"errors": card.errors | all_errors(model, name, real)})
    write_card(card, weights)
    return card


def write_card(card: SensorCard, weights: Path) -> None:
    """Write the card of a sensor's network."""
    text = yaml.safe_dump(card.model_dump(mode="json", exclude_none=True), sort_keys=False, width=140, allow_unicode=True)
    sensor_card_path(card.sensor, weights).write_text(text)


def ship(
    name: str,
    weights: Path = SHIPPED,
    real: Path | None = None,
    *,
    presses: int = PRESSES,
    settings: TouchTrainingSettings | None = None,
) -> SensorCard:
    """Train the network of a shipped sensor, and write it with its card; `presses` and `settings` as `train_sensor_network` takes them."""
    sources, fitted_to = commit(), FITTED_TO[name]
    model, _ = train_sensor_network(square_pixels(load_sensor(name)), presses=presses, settings=settings)
    card = SensorCard(
        sensor=name,
        presses=presses,
        trained_on=(
            TrainedOn(
                source=TRAINED_ON.format(name, NO_PHOTOGRAPH if fitted_to is None else f"{fitted_to}, none of which ships"),
                licence="MIT (made by this project)",
            ),
        ),
        commit=sources,
        command="make sensor-weights" + " REAL=FOLDER" * (real is not None),
        errors=all_errors(model, name, real),
        not_for=NOT_FOR,
    )
    save_sensor_network(model, weights / SENSORS / name)
    write_card(card, weights)
    check_size(weights)
    return card


def main() -> None:
    """Train, measure and write all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--real", type=Path, help="folder with a clone of rpl-cmu/gelslam; the package taxim must be installed too")
    parser.add_argument("--errors", action="store_true", help="train nothing: measure the shipped networks again")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    for name in FITTED_TO:
        card = (measure_again if arguments.errors else ship)(name, real=arguments.real)
        print("\n".join(f"{name}, {label}: {error}" for label, error in card.errors.items()), flush=True)


if __name__ == "__main__":
    main()
