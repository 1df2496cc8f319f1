"""Animations of slides: what their frames show, and those that `summary` draws."""

import io

import numpy as np
import pytest
from PIL import Image

from pipeline.drawing.contact_sheet import slide_animation
from pipeline.drawing.sequence_pictures import animate_slides
from pipeline.formats.sensor_file import load_sensor
from tests.command_line import vt
from tests.contrib.exports.test_sequence_frames import SLIDES, SMALL, STEPS, data  # noqa: F401
from tests.stages.tiny_dataset import manifest, run_stage

SENSOR = load_sensor("gelsight", shape=(30, 40))


def touches(steps: int = 4) -> dict[str, np.ndarray]:
    """Return touches whose contact grows, slips in the last step, and moves the gel along x."""
    rows, cols = np.mgrid[:30, :40]
    inside = np.stack([np.hypot(rows - 15, cols - 20) < 3 * step for step in range(steps)])
    shear = np.stack([inside * 1e-4 * step for step, inside in enumerate(inside)])[..., None] * (1.0, 0.0)
    return {
        "time": np.arange(steps) / 10,
        "tactile_image": np.stack([np.full((30, 40, 3), 60 * step, np.uint8) for step in range(steps)]),
        "pressure": 1e4 * inside,
        "shear": shear,
        "slip": shear * (np.arange(steps) == steps - 1)[:, None, None, None],
        "force": np.arange(steps)[:, None] * (-0.1, 0.0, -1.0),
        "torque": np.zeros(steps),
    }


def frames_of(content: bytes) -> list[np.ndarray]:
    frames = []
    with Image.open(io.BytesIO(content)) as animation:
        assert animation.format == "WEBP"
        for number in range(animation.n_frames):
            animation.seek(number)
            frames.append(np.asarray(animation.convert("RGB")).astype(int))
    return frames


def test_animation_has_a_frame_per_step_in_its_time():
    with Image.open(io.BytesIO(animate_slides([("ball", touches())], SENSOR))) as animation:
        assert animation.n_frames == 4
        animation.seek(1)
        animation.load()
        assert animation.info["duration"] == 100


def test_frames_show_image_contact_and_slip_of_their_step():
    frames = frames_of(animate_slides([("ball", touches()), ("$again$ \x1b", touches())], SENSOR))
    third = frames[0].shape[1] // 7 * 2  # the image, the field, the forces
    for step, frame in enumerate(frames):
        middle = frame[frame.shape[0] // 4, third // 2]
        assert middle == pytest.approx([60 * step] * 3, abs=8)
    field = [frame[: frame.shape[0] // 2, third + 10 : 2 * third - 10] for frame in frames]
    orange = [((part[..., 0] > 200) & (part[..., 2] < 190)).sum() for part in field]
    dark = [((part[..., 0] > 200) & (part[..., 2] < 60)).sum() for part in field]
    assert orange[0] < orange[1] < orange[2] < orange[3]
    assert max(dark[:3]) < 50 < dark[3]  # slip is dark


def test_summary_counts_slides_and_animates_a_few_once(data):  # noqa: F811
    output = vt("summary", data)
    (path,) = slide_animation(data)
    assert f"all 2 {SLIDES * 2} {SLIDES * STEPS * 2} 0 " in output
    assert f"animation: {path}" in output
    before = path.stat().st_mtime_ns
    assert slide_animation(data) == [path]
    assert path.stat().st_mtime_ns == before


def test_slides_without_what_an_animation_shows_are_counted_only(tmp_path):
    for stage in ("sample-surfaces", "simulate-slides"):
        run_stage(tmp_path, stage, manifest(), *SMALL, "simulate-slides.store=[force]", "simulate-slides.slides=1")
    output = vt("summary", tmp_path)
    assert "Slides" in output
    assert "gross" not in output
    assert not (tmp_path / "slides.webp").exists()
