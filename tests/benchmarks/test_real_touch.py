"""The benchmark on photographs: its scores, its baselines on simulated photographs, and sets that are described."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from benchmarks.real_touch import __main__ as command
from benchmarks.real_touch.baselines import depth_of, look_up_table
from benchmarks.real_touch.photograph_sets import SETS, PhotographSet, Press, SetDescription, ball_press, distances, read_sets
from benchmarks.real_touch.scores import Reading, ball_radius, mean_scores, score
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.sensor import resample
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image

ROWS, COLS, SCALE = 60, 80, 0.2
SENSOR = resample(load_sensor("gelsight").model_copy(update={"membrane": 0.0, "gel": None}), ROWS, COLS).model_copy(
    update={"width": COLS * SCALE / 1e3, "given_height": ROWS * SCALE / 1e3}
)
RADIUS = 5.0
"""mm, of the balls."""


def ball(x: float, y: float, depth: float) -> np.ndarray:
    rows, cols = np.indices((ROWS, COLS))
    squared = SCALE**2 * ((cols - x) ** 2 + (rows - y) ** 2)
    pressed = np.maximum(np.sqrt(np.maximum(RADIUS**2 - squared, 0)) - RADIUS + depth, 0)
    return tactile_image(np.where(pressed > 0, SENSOR.w - pressed / 1e3, np.inf), SENSOR)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PhotographSet]:
    """Write a set of simulated photographs with its description, and read it."""
    real = tmp_path_factory.mktemp("real")
    folder = real / "set" / "balls"
    folder.mkdir(parents=True)
    rng, lines = np.random.default_rng(0), []
    for number in range(12):
        x, y, depth = *rng.integers([15, 15], [65, 45]), rng.uniform(0.2, 0.8)
        Image.fromarray(ball(x, y, depth)).save(folder / f"{number}.png")
        lines.append(f"{number}.png ({x}, {y}) {round(np.sqrt(2 * RADIUS * depth - depth**2) / SCALE)}")
    (folder / "circles.txt").write_text("\n".join(lines))
    Image.fromarray(untouched_image(SENSOR)).save(folder / "untouched.png")
    Image.fromarray(ball(40, 30, 0.5)).save(folder / "press.png")
    described = {
        "name": "simulated",
        "source": "here",
        "folder": "set/balls",
        "mm_per_pixel": SCALE,
        "untouched": "untouched.png",
        "fitted": {"files": "*.png", "radius": RADIUS, "circles": "circles.txt"},
        "presses": [{"file": "press.png", "depth": 0.5, "at": [40, 30], "radius": RADIUS}],
    }
    path = real / "set.yaml"
    path.write_text(yaml.safe_dump(described))
    return path, read_sets(real, [path])[0]


def test_shipped_descriptions_are_complete() -> None:
    described = {path.stem: SetDescription.model_validate(yaml.safe_load(path.read_text())) for path in SETS.glob("*.yaml")}
    assert len(described["gelsight_sim2real"].presses) == 16
    assert described["gelslam_mini"].tested is not None


def test_photograph_set_is_read(photographs: tuple[Path, PhotographSet]) -> None:
    _, read = photographs
    assert len(read.balls) == 12
    (press,) = read.presses
    assert press.depth.max() == pytest.approx(0.5)
    assert press.footprint[30, 40]
    assert press.footprint.sum() == pytest.approx(np.pi * (0.85 * np.sqrt(2 * 5 * 0.5 - 0.25) / SCALE) ** 2, rel=0.05)


def test_missing_sets_are_reported(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="holds none of the 2 sets; clone them"):
        read_sets(tmp_path, sorted(SETS.glob("*.yaml")))


def test_scores_of_known_errors(photographs: tuple[Path, PhotographSet]) -> None:
    press = photographs[1].presses[0]
    right = score(Reading(press.depth, press.footprint), press, SCALE)
    assert (right.rmse, right.bias, right.shape, right.overlap) == (0, 0, 0, 1)
    assert right.sphere == pytest.approx(0, abs=1e-5)
    assert np.isnan(right.flat)
    shifted = score(Reading(press.depth + 0.1), press, SCALE)
    assert (shifted.rmse, shifted.bias) == pytest.approx((0.1, 0.1))
    assert shifted.shape == pytest.approx(0, abs=1e-12)
    assert np.isnan(shifted.overlap)
    _, cols = np.indices(press.depth.shape)
    flat = Press("flat", press.image, np.full(press.depth.shape, 0.5), press.footprint, flat=True, absolute=True)
    tilted = score(Reading(0.5 + 0.1 * SCALE * cols), flat, SCALE)
    assert tilted.flat == pytest.approx(np.degrees(np.arctan(0.1)))
    means = mean_scores([right, shifted])
    assert means.rmse == pytest.approx(0.05)
    assert means.overlap == 1
    assert np.isnan(means.flat)


def test_contact_on_a_ball_of_unknown_depth_is_compared_with_its_whole_circle(photographs: tuple[Path, PhotographSet]) -> None:
    ball = photographs[1].balls[0]
    press = ball_press(ball, 4.0, SCALE)
    circle = distances(press.depth.shape, ball.contact.x, ball.contact.y) < ball.contact.radius
    assert score(Reading(press.depth, circle), press, SCALE).overlap == 1
    assert score(Reading(press.depth, press.footprint), press, SCALE).overlap == pytest.approx(0.85**2, abs=0.03)


def test_look_up_table_reads_its_training_photographs(photographs: tuple[Path, PhotographSet]) -> None:
    read = photographs[1]
    depth = depth_of(look_up_table(read)(read.presses[0].image), SCALE)
    assert score(Reading(depth), read.presses[0], SCALE).rmse < 0.1


def test_predictions_from_files_are_scored(
    photographs: tuple[Path, PhotographSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, read = photographs
    (tmp_path / "simulated").mkdir()
    np.save(tmp_path / "simulated" / "press.npy", read.presses[0].depth + 0.05)
    arguments: list[Any] = ["benchmark", path.parent, "--set", path, "--predictions", tmp_path]
    monkeypatch.setattr(sys, "argv", [str(word) for word in arguments])
    command.main()
    assert "| predictions | 0.050 | 0.050 | 0.000 |" in capsys.readouterr().out
    np.save(tmp_path / "simulated" / "press.npy", np.zeros((3, 3)))
    with pytest.raises(SystemExit, match=r"is \(3, 3\), the photograph \(60, 80\)"):
        command.main()


def test_radius_of_a_ball_is_fitted_in_the_footprint() -> None:
    rows, cols = np.indices((ROWS, COLS))
    squared = SCALE**2 * ((cols - 40.3) ** 2 + (rows - 29.0) ** 2)
    depth = np.sqrt(np.maximum(RADIUS**2 - squared, 0)) - 3.0
    noise = np.random.default_rng(0).normal(0, 0.002, depth.shape)
    assert ball_radius(depth + noise, squared < 6.0, SCALE) == pytest.approx(RADIUS, rel=0.02)
    assert ball_radius(0.5 * depth, squared < 6.0, SCALE) > 1.5 * RADIUS
