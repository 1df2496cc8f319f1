"""Animations of slides and lifts: what their frames show, and those that `summary` draws."""

import io
import shutil

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from pipeline.dataset.object_rows import ObjectRows
from pipeline.drawing.contact_sheet import sequence_animations
from pipeline.drawing.sequence_pictures import Drawn, animate, draw_field, first_sequence
from pipeline.formats.sensor_file import load_sensor
from pipeline.store.directory import DataDirectory
from schemas.touch import TOUCH
from stages.registry import resolve
from stages.simulate_touch import SimulateTouch
from tests.command_line import vt
from tests.contrib.exports.test_sequence_frames import SLIDES, SMALL, STEPS, data, lifts  # noqa: F401
from tests.stages.lifted_objects import STEPS as LIFT_STEPS
from tests.stages.lifted_objects import lift_assignments
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


def slide(title: str) -> Drawn:
    return Drawn(title, {"": touches()}, [SENSOR])


def frames_of(content: bytes) -> list[np.ndarray]:
    frames = []
    with Image.open(io.BytesIO(content)) as animation:
        assert animation.format == "WEBP"
        for number in range(animation.n_frames):
            animation.seek(number)
            frames.append(np.asarray(animation.convert("RGB")).astype(int))
    return frames


def test_animation_has_a_frame_per_step_in_its_time():
    with Image.open(io.BytesIO(animate([slide("ball")]))) as animation:
        assert animation.n_frames == 4
        animation.seek(1)
        animation.load()
        assert animation.info["duration"] == 100


def test_frames_show_image_contact_and_slip_of_their_step():
    frames = frames_of(animate([slide("ball"), slide("$again$ \x1b")]))
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
    (path,) = sequence_animations(data)
    assert f"all 2 {SLIDES * 2} {SLIDES * STEPS * 2} 0 " in output
    assert f"animation: {path}" in output
    before = path.stat().st_mtime_ns
    assert sequence_animations(data) == [path]
    assert path.stat().st_mtime_ns == before


def test_slides_without_what_an_animation_shows_are_counted_only(tmp_path):
    for stage in ("sample-surfaces", "simulate-slides"):
        run_stage(tmp_path, stage, manifest(), *SMALL, "simulate-slides.store=[force]", "simulate-slides.slides=1")
    output = vt("summary", tmp_path)
    assert "Slides" in output
    assert "gross" not in output
    assert not (tmp_path / "slides.webp").exists()


def test_frames_of_a_lift_show_each_gel_and_what_they_carry_against_the_weight():
    steps = 4
    fingers = {name: touches(steps) for name in ("index", "$\\frac$ \x1b")}
    fingers["index"]["tactile_image"][:] = 40
    weight = np.stack([np.linspace(0, 2, steps), np.linspace(2, 0, steps)])
    frames = frames_of(animate([Drawn("ball, first grasp", fingers, [SENSOR] * 2, weight)]))
    assert len(frames) == steps
    height, width = frames[0].shape[:2]
    column = width * 2 // 7  # two sensors of one share, the forces of one and a half
    for step, frame in enumerate(frames):
        for number, level in enumerate((40, 60 * step)):
            assert frame[height // 4, number * column + column // 2] == pytest.approx([level] * 3, abs=8)
    fields = [frame[height // 2 :, column + 10 : 2 * column - 10] for frame in frames]
    dark = [((part[..., 0] > 200) & (part[..., 2] < 60)).sum() for part in fields]
    assert max(dark[:3]) < 50 < dark[3]  # the thumb's slip


@pytest.mark.parametrize(("micrometres", "said"), [(0, "0 mm"), (2, "0.002 mm"), (300, "0.3 mm")])
def test_field_names_the_farthest_that_any_pixel_moved(micrometres, said):
    shear = np.zeros((4, 30, 40, 2))
    shear[2, 7, 8, 1] = 1e-6 * micrometres  # no arrow starts there
    axes = Figure().subplots()
    draw_field(axes, touches() | {"shear": shear}, SENSOR)
    assert axes.get_title(loc="left") == f"gel moved up to {said}"


def test_summary_counts_lifts_and_animates_their_first_grasps(lifts):  # noqa: F811
    output = vt("summary", lifts)
    (path,) = sequence_animations(lifts)
    assert path.name == "lifts.webp"
    rows = ObjectRows(lifts, ["lift_weight", "lift_imbalance", "lift_held", "lift_settled"], split=None)
    unsettled = sum((~rows.read("lift_settled", name)).any(axis=1).sum() for name in rows.object_ids)
    assert f"all 2 2 {2 * LIFT_STEPS} {unsettled} " in output
    assert "% that slip out" in output
    assert f"animation: {path}" in output
    assert "% successful" in output  # then the grasps
    for object_id in rows.object_ids:
        drawn = first_sequence(rows.collections["touch"].view(object_id), "lift")
        weight, imbalance, held = (rows.read(name, object_id, 0) for name in rows.arrays[:3])
        assert (drawn.weight[0] == weight).all()
        assert (np.abs(drawn.weight[1] - weight)[held] <= imbalance[held] + 1e-4).all()  # what they carry, upwards


def test_steps_of_lifts_that_do_not_settle_are_flagged_and_counted(lifts, tmp_path, monkeypatch):  # noqa: F811
    copied, assignments = shutil.copytree(lifts, tmp_path / "data"), lift_assignments(lifts / "coarse.yaml")
    monkeypatch.setattr("pipeline.kernels.touch.lift.MAX_STEPS", 0)
    run_stage(copied, "simulate-touch", manifest(), *assignments, "simulate-touch.lift_rate=20")
    shard = DataDirectory(copied).collection(TOUCH).first
    unsettled = (~shard.read("lift_settled")).any(axis=2).sum()  # (object, grasp, step)
    assert unsettled > LIFT_STEPS
    assert f"all 2 2 {2 * LIFT_STEPS} {unsettled} " in vt("summary", copied)
    settings = resolve("simulate-touch", "draft", [*assignments, "simulate-touch.lift_rate=20"])
    lines = list(SimulateTouch().describe_shard(settings, shard))
    assert any(line.startswith(f"{unsettled} of {2 * LIFT_STEPS} steps did not settle (lift_settled)") for line in lines)
    assert any(line.startswith("0 of 2 lifts end at rest") for line in lines)


def test_report_shows_the_lift_of_the_first_grasp(lifts, tmp_path):  # noqa: F811
    copied = shutil.copytree(lifts, tmp_path / "data")
    vt("report", copied)
    pages = copied / "report"
    assert "% that end at rest" in (pages / "index.html").read_text()
    for object_id in ObjectRows(copied, ["lift_time"], split=None).object_ids:
        assert f'src="{object_id}.lift.webp"' in (pages / "objects" / f"{object_id}.html").read_text()
        assert len(frames_of((pages / "objects" / f"{object_id}.lift.webp").read_bytes())) == LIFT_STEPS
